//! What is certified of the quarters of a base face, in four bytes.
//!
//! A base face may be large beside the path of a contact, and lie along flats and shores at once:
//! one number would be that of its worst point. The lines between the middles of its sides cut it
//! in four, one quarter at each corner and one between them. The bound of a quarter holds one way:
//! no point of it is farther from the full mesh. A contact is a point, and asks for no more.

use super::ErrorScale;
use super::certified::rounded_up;
use bytemuck::{Pod, Zeroable};

/// The four bytes: those of the quarters at the corners, then that of the one between. A byte is
/// how far the bound is below the scale, in steps of an eighth of an octave, rounded up; 0 if it
/// is above: without limit.
#[repr(transparent)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QuarterCodes([u8; 4]);

/// What is certified of the quarters of a base face, model units.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quarters([f32; 4]);

impl QuarterCodes {
    /// Codes of errors a step.
    const STEP: u16 = 256;

    /// The codes of these bounds, model units: those of the quarters at the corners, then that of
    /// the one between.
    #[must_use]
    pub fn new(scale: ErrorScale, bounds: [f64; 4]) -> Self {
        Self(bounds.map(|bound| ((u16::MAX - scale.encode(bound)) / Self::STEP) as u8))
    }

    /// What they stand for.
    #[must_use]
    pub fn decode(self, scale: ErrorScale) -> Quarters {
        let code = |below: u8| u16::MAX - u16::from(below) * Self::STEP;
        Quarters(self.0.map(|below| rounded_up(scale.decode(code(below)))))
    }
}

impl Quarters {
    /// No bound.
    pub const UNKNOWN: Self = Self([f32::INFINITY; 4]);

    /// The bound at a point with these weights of the corners, which add up to one; model units.
    #[must_use]
    pub fn at(&self, weights: [f64; 3]) -> f32 {
        let at_corner = weights.iter().position(|&weight| weight >= 0.5);
        self.0[at_corner.unwrap_or(3)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_code_is_below_what_it_stands_for_and_hardly_above(octave in -28.0..0.5f64) {
            let scale = ErrorScale::for_diagonal(3.0);
            let bound = 3.0 * octave.exp2();
            let codes = QuarterCodes::new(scale, [0.0, bound, f64::INFINITY, f64::NAN]);
            let Quarters(found) = codes.decode(scale);
            prop_assert!(f64::from(found[1]) >= bound && f64::from(found[1]) <= bound * 1.1);
            prop_assert!(found[0] > 0.0 && found[0] < 1e-8);
            prop_assert!(found[2..] == [f32::INFINITY; 2]);
        }
    }

    #[test]
    fn zero_bytes_are_no_bound() {
        let scale = ErrorScale::for_diagonal(1.0);
        assert_eq!(QuarterCodes::default().decode(scale), Quarters::UNKNOWN);
    }

    #[test]
    fn a_quarter_is_at_the_corner_with_half_of_the_weight() {
        let quarters = Quarters([0.0, 1.0, 2.0, 3.0]);
        assert_eq!(quarters.at([0.6, 0.3, 0.1]), 0.0);
        assert_eq!(quarters.at([0.25, 0.5, 0.25]), 1.0);
        assert_eq!(quarters.at([0.0, 0.0, 1.0]), 2.0);
        assert_eq!(quarters.at([0.4, 0.4, 0.2]), 3.0);
    }
}
