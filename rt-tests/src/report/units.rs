//! Numbers with their units as a person reads them.

/// A share in percent, rounded down to hundredths, so that 100 is the whole; "none" of nothing.
#[must_use]
pub fn percent(part: u64, whole: u64) -> String {
    if whole == 0 {
        return "none".to_string();
    }
    // In whole numbers: in floating point 1.15 % has fewer than 115 hundredths.
    let hundredths = u128::from(part) * 10_000 / u128::from(whole);
    format!("{}.{:02} %", hundredths / 100, hundredths % 100)
}

/// A share of 1 in percent, with three digits.
#[must_use]
pub fn percent_of(share: f64) -> String {
    format!("{} %", digits(100.0 * share))
}

/// A whole number with a narrow space between the thousands.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// Bytes in binary units.
#[must_use]
pub fn bytes(count: u64) -> String {
    let count = count as f64;
    match count {
        c if c >= 1048576.0 => format!("{:.1} MiB", c / 1048576.0),
        c if c >= 1024.0 => format!("{:.1} KiB", c / 1024.0),
        c => format!("{c} B"),
    }
}

/// A length in metres, with three digits and the unit that suits it.
#[must_use]
pub fn length(metres: f64) -> String {
    let (value, unit) = match metres.abs() {
        0.0 => return "0".to_string(),
        m if m < 1e-10 => return "below 0.1 nm".to_string(),
        m if m < 1e-6 => (metres * 1e9, "nm"),
        m if m < 1e-3 => (metres * 1e6, "µm"),
        m if m < 1.0 => (metres * 1e3, "mm"),
        _ => (metres, "m"),
    };
    format!("{} {unit}", digits(value))
}

/// A number with at most three digits and at most three decimals, without zeros at its end.
#[must_use]
pub fn digits(value: f64) -> String {
    let decimals = (2.0 - value.abs().max(1e-3).log10().floor()).clamp(0.0, 3.0) as usize;
    without_zeros(format!("{value:.decimals$}"))
}

/// A number as the label of an axis: three digits, or two with an exponent when very small or
/// large.
#[must_use]
pub fn axis_label(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_string();
    }
    if !(1e-4..1e6).contains(&size) {
        return format!("{value:.1e}").replace(".0e", "e");
    }
    let decimals = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    without_zeros(format!("{value:.decimals$}"))
}

fn without_zeros(text: String) -> String {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (100.0, "100"),
            (0.0, "0"),
            (0.25, "0.25"),
            (2.5, "2.5"),
            (1e-7, "1e-7"),
            (1e6, "1e6"),
            (1.2e6, "1.2e6"),
            (1e10, "1e10"),
            (-2.5e-5, "-2.5e-5"),
            (17_600.0, "17600"),
            (-3.0, "-3"),
        ] {
            assert_eq!(axis_label(value), text);
        }
        assert_eq!(length(1.5e-6), "1.5 µm");
        assert_eq!(length(0.0), "0");
        assert_eq!(length(1e-12), "below 0.1 nm");
        assert_eq!(length(2.345), "2.35 m");
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(percent(99_999, 100_000), "99.99 %");
        assert_eq!(percent(1, 1), "100.00 %");
        assert_eq!(percent(115, 10_000), "1.15 %");
        assert_eq!(percent(u64::MAX - 1, u64::MAX), "99.99 %");
        assert_eq!(percent(0, 0), "none");
        assert_eq!(bytes(3 << 20), "3.0 MiB");
    }
}
