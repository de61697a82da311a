//! Sizes in bytes.

/// Largest size, bytes: 1 TiB.
const MAX_BYTES: u64 = 1 << 40;

/// Bytes as a scene and the command line write them: `16MiB`, `512KiB`, `2GB`, or a plain number of
/// bytes.
///
/// Not the crate `bytesize`: it also reads `1.5MiB`, `16mib` and `0`, which stay refused here.
///
/// # Errors
/// A sentence with the forms that are understood.
///
/// ```
/// assert_eq!(scene::parse_bytes("16MiB"), Ok(16 << 20));
/// assert!(scene::parse_bytes("1.5MiB").is_err());
/// ```
pub fn parse_bytes(text: &str) -> Result<usize, String> {
    let text = text.trim();
    let digits = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor: Option<u64> = match unit.trim() {
        "" | "B" => Some(1),
        "KiB" => Some(1 << 10),
        "MiB" => Some(1 << 20),
        "GiB" => Some(1 << 30),
        "kB" => Some(1_000),
        "MB" => Some(1_000_000),
        "GB" => Some(1_000_000_000),
        _ => None,
    };
    let bytes = factor
        .zip(number.parse::<u64>().ok())
        .and_then(|(factor, number)| number.checked_mul(factor))
        .filter(|bytes| (1..=MAX_BYTES).contains(bytes))
        .and_then(|bytes| usize::try_from(bytes).ok());
    bytes.ok_or_else(|| {
        format!("\"{text}\" is no size; write a whole number of bytes up to 1024GiB such as \"16MiB\", \"512KiB\" or 16777216")
    })
}
