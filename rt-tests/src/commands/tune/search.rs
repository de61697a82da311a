//! The dial: the tolerance at which a limit is just kept, by bisection.

use crate::failure::Failure;

/// Ratio of neighbouring tolerances at which the search ends.
pub const STEP: f64 = 1.1;

/// The last tolerance below an edge and the first one beyond it, within [`STEP`] of each other:
/// `is_below` is true up to the edge, and of `low`, and false of `high`.
///
/// # Errors
/// When a trial fails.
pub fn edge(
    (mut low, mut high): (f64, f64),
    is_below: &mut dyn FnMut(f64) -> Result<bool, Failure>,
) -> Result<(f64, f64), Failure> {
    while high > STEP * low {
        let middle = rounded((low * high).sqrt());
        if is_below(middle)? {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok((low, high))
}

/// Three digits, as the settings print it.
#[must_use]
pub fn rounded(value: f64) -> f64 {
    if value <= 0.0 {
        return 0.0;
    }
    // The decimal digits, not a power of ten: what is printed is then what is used.
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_edge_is_found_wherever_it_lies() {
        for at in [1.3e-7, 5e-4, 0.09] {
            let mut trials = 0;
            let found = edge((1e-7, 0.1), &mut |tolerance| {
                trials += 1;
                Ok(tolerance <= at)
            });
            let (low, high) = found.unwrap_or_else(|error| panic!("{error}"));
            assert!(low <= at && at < high && high <= STEP * low * 1.01, "{at}");
            assert!(trials <= 10, "{trials}");
        }
        let failed = edge((1e-7, 0.1), &mut |_| {
            Err(Failure::Run("no trial".to_string()))
        });
        assert!(failed.is_err());
    }

    #[test]
    fn what_is_printed_is_what_is_used() {
        for value in [1.2345e-4, 9.999e-6, 0.15, 0.0] {
            let rounded = rounded(value);
            assert_eq!(format!("{rounded}").parse::<f64>(), Ok(rounded));
            assert!((rounded - value).abs() <= 0.005 * value);
        }
    }
}
