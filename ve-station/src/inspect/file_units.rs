//! Whether a model's size can be meant in metres, and what else it may be meant in.

/// Sizes that are touched, metres: from a screw to a car.
const TOUCHED_M: std::ops::RangeInclusive<f64> = 5e-3..=5.0;
/// Units in which meshes are made, and how many metres they are.
const UNITS: [(&str, f64); 4] = [
    ("centimetres", 0.01),
    ("millimetres", 0.001),
    ("inches", 0.0254),
    ("micrometres", 1e-6),
];

/// Asks back when a longest side is implausible in metres; empty when it is not.
#[must_use]
pub fn question(longest_side: f64) -> String {
    if TOUCHED_M.contains(&longest_side) || !(longest_side.is_finite() && longest_side > 0.0) {
        return String::new();
    }
    let meant = UNITS
        .iter()
        .filter(|(_, m)| TOUCHED_M.contains(&(m * longest_side)));
    let meant: Vec<String> = meant
        .map(|(name, m)| {
            let size = rounded(m * longest_side);
            format!("{name} (metres_per_unit = {m}, {size} m long)")
        })
        .collect();
    let guess = match &meant[..] {
        [] => String::new(),
        _ => format!(" Is it in {}?", meant.join(" or ")),
    };
    format!(
        "The longest side is {}: in metres that is not a thing that a hand strokes.{guess} \
         A scene says metres_per_unit, or by size_m the longest side in metres.",
        rounded(longest_side)
    )
}

/// A number with three digits, however small, up to twelve decimals.
#[must_use]
pub fn rounded(number: f64) -> String {
    let digits = (2.0 - number.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{number:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_hundred_metres_were_millimetres() {
        let asked = question(200.0);
        assert!(asked.contains("longest side is 200:"), "{asked}");
        let meant = "centimetres (metres_per_unit = 0.01, 2 m long) or millimetres \
                     (metres_per_unit = 0.001, 0.2 m long)";
        assert!(asked.contains(meant), "{asked}");
        assert!(question(0.15).is_empty() && question(0.0).is_empty());
        let strange = question(1e12);
        assert!(!strange.contains("Is it in"), "{strange}");
        assert!(question(0.0005).contains("longest side is 0.0005:"));
    }

    #[test]
    fn a_small_tolerance_is_not_written_as_zero() {
        let numbers = [0.0, 2.3e-10, 2.7612e-3, 12.345, 1234.4];
        let expected = ["0", "0.00000000023", "0.00276", "12.3", "1234"];
        assert_eq!(numbers.map(rounded), expected);
    }
}
