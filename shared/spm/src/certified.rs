//! What is certified of a vertex: its part in the bounds of the faces at it, in three bytes.
//!
//! The *bound* of a face holds both ways: every point of the face is so near to the full mesh, and
//! so is the part of the full mesh that belongs to the face. Its corners give two of them.
//!
//! - The largest R of its corners, for every front: R is the distance to the farthest full-mesh
//!   descendant, and what belongs to the face is what descends from it.
//! - The least C of its corners, for a face of a front {E > t}: C is the largest error, as the
//!   builder certifies it, of the faces at the vertex in all these fronts, and what belongs to the
//!   face is the patch of that certificate. A vertex is active in such a front for a range of t:
//!   from E of the VSP that splits it on, up to E of the one that makes it. A face whose corners
//!   are active for a common t is a face of that front, whatever the other faces are.

use super::ErrorScale;
use bytemuck::{Pod, Zeroable};

/// The three bytes.
///
/// | byte | is |
/// |---|---|
/// | radius | R in steps of an eighth of an octave, rounded up; 0 is zero, 255 without limit |
/// | close | C below 16 E' in steps of a sixteenth of an octave, rounded up; 0 if it is above |
/// | begin | E below E' in such steps, rounded up; 255 if no VSP splits the vertex |
///
/// E is that of the VSP that splits the vertex, E' that of the one that makes it; for a vertex of
/// the base mesh E' is the largest code.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct CertifiedCode {
    /// R.
    pub radius: u8,
    /// C.
    pub close: u8,
    /// The first code of t for which the vertex is active.
    pub begin: u8,
}

/// What is certified of a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Certified {
    /// R, model units.
    pub radius: f32,
    /// C, model units.
    pub close: f32,
    /// The vertex is active in the fronts {E > t} for codes of t from this one on.
    pub begin: u16,
    /// And up to the one before this.
    pub end: u16,
}

impl CertifiedCode {
    /// Codes of errors a step of R.
    const RADIUS_STEP: u16 = 256;
    /// And of the others.
    const STEP: i32 = 128;
    /// How far the largest C is above E.
    const ABOVE: i32 = 4 * 2048;
    const UNLIMITED: u8 = u8::MAX;
    const NEVER_SPLIT: u8 = u8::MAX;

    /// The code for R and C (model units) of a vertex that a VSP of error code `end` makes and one
    /// of
    /// `begin` splits.
    #[must_use]
    pub fn new(scale: ErrorScale, radius: f64, close: f64, begin: Option<u16>, end: u16) -> Self {
        let steps = scale.encode(radius).div_ceil(Self::RADIUS_STEP);
        let top = i32::from(end) + Self::ABOVE;
        let below = top - i32::from(scale.encode(close));
        let last = i32::from(u8::MAX);
        Self {
            radius: steps.min(Self::UNLIMITED.into()) as u8,
            close: if below < 0 {
                0
            } else {
                (below / Self::STEP + 1).min(last) as u8
            },
            begin: begin.map_or(Self::NEVER_SPLIT, |begin| {
                let below = i32::from(end.saturating_sub(begin));
                (below / Self::STEP).min(last - 1) as u8
            }),
        }
    }

    /// What it stands for, given the error code of the VSP that makes the vertex.
    #[must_use]
    pub fn decode(self, scale: ErrorScale, end: u16) -> Certified {
        let radius = match self.radius {
            Self::UNLIMITED => u16::MAX,
            steps => u16::from(steps) * Self::RADIUS_STEP,
        };
        let close = match self.close {
            0 => u16::MAX,
            steps => {
                let below = (i32::from(steps) - 1) * Self::STEP;
                let code = i32::from(end) + Self::ABOVE - below;
                code.clamp(1, u16::MAX.into()) as u16
            }
        };
        Certified {
            radius: rounded_up(scale.decode(radius)),
            close: rounded_up(scale.decode(close)),
            begin: match self.begin {
                Self::NEVER_SPLIT => 0,
                steps => end.saturating_sub(u16::from(steps) * Self::STEP as u16),
            },
            end,
        }
    }
}

impl Certified {
    /// A vertex of the full mesh in no other front.
    pub const EXACT: Self = Self::of_radius(0.0);

    /// R alone, model units.
    #[must_use]
    pub const fn of_radius(radius: f32) -> Self {
        Self {
            radius,
            close: f32::INFINITY,
            begin: 0,
            end: 0,
        }
    }

    /// The least C of some vertices that are active for a common t; infinite for others.
    pub(crate) fn close_of(vertices: [Self; 3]) -> f32 {
        let begin = vertices.iter().fold(0, |begin, v| begin.max(v.begin));
        let end = vertices.iter().fold(u16::MAX, |end, v| end.min(v.end));
        let least = || vertices.iter().fold(f32::INFINITY, |c, v| c.min(v.close));
        if begin < end { least() } else { f32::INFINITY }
    }
}

/// The least f32 that is not below.
pub(crate) fn rounded_up(exact: f64) -> f32 {
    let rounded = exact as f32;
    if f64::from(rounded) < exact {
        rounded.next_up()
    } else {
        rounded
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_code_is_below_what_it_stands_for_and_hardly_above(
            octaves in prop::array::uniform2(-28.0..0.5f64),
            end in 1u16..=u16::MAX, below in prop::option::of(0u16..60_000),
        ) {
            let scale = ErrorScale::for_diagonal(3.0);
            let [radius, close] = octaves.map(|octave| 3.0 * octave.exp2());
            let begin = below.map(|below| end.saturating_sub(below));
            let decoded = CertifiedCode::new(scale, radius, close, begin, end).decode(scale, end);
            prop_assert!(f64::from(decoded.radius) >= radius);
            prop_assert!(f64::from(decoded.radius) <= radius * 1.1);
            prop_assert!(f64::from(decoded.close) >= close);
            let expected = scale.decode(end);
            if close < 15.0 * expected && close > expected / 2000.0 {
                prop_assert!(f64::from(decoded.close) <= close * 1.05);
            }
            // Active for no t for which it is not, and for hardly fewer.
            let begin = begin.unwrap_or(0);
            prop_assert!(decoded.begin >= begin);
            let reach = end.saturating_sub(254 * 128);
            prop_assert!(below.is_none() || decoded.begin < begin.max(reach) + 128);
            prop_assert_eq!(decoded.end, end);
        }
    }

    #[test]
    fn zero_is_zero_and_what_is_beyond_has_no_limit() {
        let scale = ErrorScale::for_diagonal(1.0);
        let decoded = |radius, close| {
            CertifiedCode::new(scale, radius, close, None, 40_000).decode(scale, 40_000)
        };
        assert_eq!(decoded(0.0, 0.0).radius, 0.0);
        assert!(decoded(0.0, 0.0).close > 0.0);
        assert_eq!(decoded(3.0, 1.0).radius, f32::INFINITY);
        assert_eq!(decoded(f64::INFINITY, f64::INFINITY).close, f32::INFINITY);
    }

    #[test]
    fn a_face_is_of_a_front_where_its_corners_are() {
        let vertex = |close, begin, end| Certified {
            radius: 9.0,
            close,
            begin,
            end,
        };
        let [a, b, c] = [vertex(3.0, 10, 20), vertex(2.0, 15, 30), vertex(4.0, 0, 16)];
        assert_eq!(Certified::close_of([a, b, c]), 2.0);
        let later = vertex(1.0, 16, 40);
        assert_eq!(Certified::close_of([a, later, c]), f32::INFINITY);
        assert_eq!(Certified::close_of([Certified::EXACT; 3]), f32::INFINITY);
    }
}
