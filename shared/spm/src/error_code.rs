//! Errors as 16 bits: logarithmic, and rounded up so that a bound stays a bound.

use geometry::portable::{exp2, log2};

/// Converts errors in model units to u16 codes and back.
///
/// Code 0 is exactly zero. Code c > 0 is `scale * 2^((c - 65535) / 2048)`: 32 octaves below the
/// scale in steps of 0.034 %. The scale is twice the diagonal of the model's box. Hardly an error
/// comes near it, but none is ruled out, since a collapse may put its vertex outside of the box:
/// the largest code stands for whatever is beyond the others, and its value is infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ErrorScale(f64);

impl ErrorScale {
    /// Codes an octave.
    pub(crate) const OCTAVE: u16 = 2048;
    /// Codes a step of the expected errors: a sixteenth of an octave.
    pub(crate) const EXPECTED_STEP: u16 = Self::OCTAVE / 16;

    /// The scale for a model whose bounding box has this diagonal (model units, finite, positive).
    #[must_use]
    pub fn for_diagonal(diagonal: f64) -> Self {
        Self(2.0 * diagonal)
    }

    /// The diagonal that it is for, model units.
    #[must_use]
    pub fn diagonal(self) -> f64 {
        self.0 / 2.0
    }

    /// The smallest code whose value is at least `error` (model units, not negative).
    ///
    /// The largest code where no other is enough, or `error` is no number.
    #[must_use]
    pub fn encode(self, error: f64) -> u16 {
        if error.is_nan() {
            return u16::MAX;
        }
        if error <= 0.0 {
            return 0;
        }
        let steps = log2(error / self.0) * f64::from(Self::OCTAVE);
        let mut code = (f64::from(u16::MAX) + steps.ceil()).clamp(1.0, f64::from(u16::MAX)) as u16;
        // Rounding of the logarithm must not lower the bound.
        while code < u16::MAX && self.decode(code) < error {
            code += 1;
        }
        code
    }

    /// As [`ErrorScale::encode`], in the steps of the expected errors.
    ///
    /// They are coarse so that a byte says where a vertex begins (see [`super::CertifiedCode`]).
    #[must_use]
    pub fn encode_expected(self, error: f64) -> u16 {
        let code = self.encode(error);
        let rounded = code.checked_next_multiple_of(Self::EXPECTED_STEP);
        rounded.unwrap_or(u16::MAX)
    }

    /// The largest code whose value is at most `tolerance` (model units, not negative). Errors with
    /// larger codes exceed the tolerance.
    #[must_use]
    pub fn floor(self, tolerance: f64) -> u16 {
        let code = self.encode(tolerance);
        if code > 0 && self.decode(code) > tolerance {
            code - 1
        } else {
            code
        }
    }

    /// The error of a code, model units; infinite for the largest.
    #[must_use]
    pub fn decode(self, code: u16) -> f64 {
        if code == 0 {
            return 0.0;
        }
        if code == u16::MAX {
            return f64::INFINITY;
        }
        self.0 * Self::growth(u16::MAX, code)
    }

    /// How many times as large the error of the second code is as that of the first. Here code 0
    /// stands for an error below all others, and the largest one for the scale.
    pub(crate) fn growth(from: u16, to: u16) -> f64 {
        exp2((f64::from(to) - f64::from(from)) / f64::from(Self::OCTAVE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_code_is_never_below_the_error_and_hardly_above(
            diagonal in 1e-6..1e6f64, octave in -31.0..0.99f64,
        ) {
            let scale = ErrorScale::for_diagonal(diagonal);
            let error = diagonal * octave.exp2();
            let decoded = scale.decode(scale.encode(error));
            prop_assert!(decoded >= error);
            prop_assert!(decoded <= error * 1.001);
            let in_steps = scale.encode_expected(error);
            prop_assert!(in_steps >= scale.encode(error));
            // The last step below the scale is without a limit.
            let is_last = error * 1.046 > 2.0 * diagonal;
            prop_assert!(is_last || scale.decode(in_steps) <= error * 1.046);
            let floor = scale.floor(error);
            prop_assert!(scale.decode(floor) <= error);
            prop_assert!(scale.decode(floor + 1) > error);
            prop_assert_eq!(scale.floor(scale.decode(floor)), floor);
        }
    }

    #[test]
    fn what_is_beyond_the_scale_is_infinite_and_never_less_than_it_was() {
        let scale = ErrorScale::for_diagonal(3.0);
        for error in [5.9999, 6.0, 6.0001, 60.0, 1e300, f64::INFINITY] {
            let decoded = scale.decode(scale.encode(error));
            assert!(decoded >= error, "{error} became {decoded}");
        }
        assert_eq!(scale.decode(scale.encode(6.0001)), f64::INFINITY);
        assert_eq!(scale.encode(f64::NAN), u16::MAX);
        assert!(
            scale.floor(1e300) < u16::MAX,
            "no tolerance accepts the infinite"
        );
    }

    #[test]
    fn zero_is_exact_and_everything_else_is_not_zero() {
        let scale = ErrorScale::for_diagonal(1.0);
        assert_eq!(scale.encode(0.0), 0);
        assert_eq!(scale.decode(0), 0.0);
        assert_eq!(scale.encode(f64::MIN_POSITIVE), 1);
        assert!(scale.decode(1) > 0.0);
    }
}
