//! What is certified of a vertex: its part in the bounds of the faces at it, in three bytes.
//!
//! The *bound* of a face holds both ways: every point of the face is so near to the full mesh, and
//! so is the part of the full mesh that belongs to the face. Its corners give two of them.
//!
//! - The largest R of its corners, for every front: R is the distance to the farthest full-mesh
//!   descendant, and what belongs to the face is what descends from it.
//! - The least of what C says of its corners, for a face of a front {E > t}: what belongs to the
//!   face is the patch of the builder's certificate. A vertex is active in such a front for a range
//!   of t: from E of the VSP that splits it on, up to E of the one that makes it. A face whose
//!   corners are active for a common t is a face of that front, whatever the other faces are.
//!
//! The faces at a vertex get coarser while it is active. Most are about as far off as E where they
//! begin: the largest E that splits a corner. Not so where E hardly says anything: of flats it is
//! zero, or that of what depends on them. So C is the bound of the faces at the vertex that begin
//! four octaves of E before it ends, or earlier. A later one has as many times C as its E is
//! larger.

use super::ErrorScale;
use bytemuck::{Pod, Zeroable};
use std::ops::Range;

/// The three bytes.
///
/// | byte | is |
/// |---|---|
/// | radius | R in steps of an eighth of an octave, rounded up; 0 is zero, 255 without limit |
/// | close | C below 4 E' in steps of a sixteenth of an octave, rounded up; 0 if it is above |
/// | begin | E below E' in such steps, rounded up; 255 if no VSP splits the vertex |
///
/// E is that of the VSP that splits the vertex, E' that of the one that makes it. For a vertex of
/// the base mesh E' is the largest code, and C counts from there. Expected errors are in such
/// steps, so that no face is taken to be of no front for want of bits.
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
    const STEP: u16 = ErrorScale::EXPECTED_STEP;
    /// How far the largest C is above E'.
    const ABOVE: u16 = 2 * ErrorScale::OCTAVE;
    const UNLIMITED: u8 = u8::MAX;
    const NEVER_SPLIT: u8 = u8::MAX;

    /// The code for R and C (model units) of a vertex that a VSP of error code `end` makes and one
    /// of `begin` splits.
    #[must_use]
    pub fn new(scale: ErrorScale, radius: f64, close: f64, begin: Option<u16>, end: u16) -> Self {
        let steps = scale.encode(radius).div_ceil(Self::RADIUS_STEP);
        Self {
            radius: steps.min(Self::UNLIMITED.into()) as u8,
            close: match Self::largest_close(end).checked_sub(scale.encode(close)) {
                None => 0,
                Some(below) => (below / Self::STEP + 1).min(u8::MAX.into()) as u8,
            },
            begin: begin.map_or(Self::NEVER_SPLIT, |begin| {
                let below = Self::latest_begin(end).saturating_sub(begin.into());
                let steps = below / u32::from(Self::STEP);
                steps.min(u32::from(Self::NEVER_SPLIT) - 1) as u8
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
                let below = (u16::from(steps) - 1) * Self::STEP;
                // Code 0 would be exact.
                Self::largest_close(end).saturating_sub(below).max(1)
            }
        };
        let begin = match self.begin {
            Self::NEVER_SPLIT => 0,
            steps => {
                let below = u32::from(steps) * u32::from(Self::STEP);
                let begin = Self::latest_begin(end).saturating_sub(below);
                begin.min(u16::MAX.into()) as u16
            }
        };
        Certified {
            radius: rounded_up(scale.decode(radius)),
            close: rounded_up(scale.decode(close)),
            begin,
            end,
        }
    }

    /// Where `close` counts from.
    fn largest_close(end: u16) -> u16 {
        end.saturating_add(Self::ABOVE)
    }

    /// Where `begin` counts from: E' is in steps but for the largest code, which is one below.
    fn latest_begin(end: u16) -> u32 {
        u32::from(end).next_multiple_of(Self::STEP.into())
    }
}

impl Certified {
    /// Codes before its end for which the faces at a vertex get coarser.
    const GROWING: u16 = 4 * ErrorScale::OCTAVE;

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

    /// How many times C of a vertex active up to the code `end` is the bound of a face at it that
    /// begins at the code `begin`.
    #[must_use]
    pub fn growth(begin: u16, end: u16) -> f64 {
        let first = end.saturating_sub(Self::GROWING);
        ErrorScale::growth(first, begin.max(first))
    }

    /// The codes of t for which all corners of a face are active, if there are any.
    pub(crate) fn common(corners: [Self; 3]) -> Option<Range<u16>> {
        let begin = corners.iter().fold(0, |begin, v| begin.max(v.begin));
        let end = corners.iter().fold(u16::MAX, |end, v| end.min(v.end));
        (begin < end).then_some(begin..end)
    }

    /// The bound of a face by C of its corners: the least one where they are active for a common
    /// t; infinite for others.
    pub(crate) fn close_of(corners: [Self; 3]) -> f32 {
        let Some(common) = Self::common(corners) else {
            return f32::INFINITY;
        };
        let bound = |v: &Self| f64::from(v.close) * Self::growth(common.start, v.end);
        let least = corners.iter().map(bound).fold(f64::INFINITY, f64::min);
        // The powers, the builder's quotient and the product are rounded.
        rounded_up(least * (1.0 + 8.0 * f64::EPSILON))
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

    fn any_end() -> impl Strategy<Value = u16> {
        // Those of VSPs, the base mesh's, and what a damaged file may have.
        prop_oneof![
            (1u16..512).prop_map(|steps| steps * 128),
            Just(u16::MAX),
            any::<u16>()
        ]
    }

    proptest! {
        #[test]
        fn no_code_is_below_what_it_stands_for_and_hardly_above(
            octaves in prop::array::uniform2(-28.0..0.5f64),
            end in any_end(), below in prop::option::of(0u16..60_000),
        ) {
            let scale = ErrorScale::for_diagonal(3.0);
            let [radius, close] = octaves.map(|octave| 3.0 * octave.exp2());
            let begin = below.map(|below| end.saturating_sub(below));
            let decoded = CertifiedCode::new(scale, radius, close, begin, end).decode(scale, end);
            prop_assert!(f64::from(decoded.radius) >= radius);
            prop_assert!(f64::from(decoded.radius) <= radius * 1.1);
            prop_assert!(f64::from(decoded.close) >= close);
            // Not beyond 4 E', and so for steps of sixteen octaves.
            let largest = end.saturating_add(4096);
            let code = scale.encode(close);
            if code < largest && code > largest.saturating_sub(15 * 2048) {
                prop_assert!(f64::from(decoded.close) <= close * 1.05);
            }
            // Active for no t for which it is not, and for hardly fewer.
            let begin = begin.unwrap_or(0);
            prop_assert!(decoded.begin >= begin);
            let reach = end.saturating_sub(254 * 128);
            let latest = u32::from(begin.max(reach)) + 128;
            prop_assert!(below.is_none() || u32::from(decoded.begin) < latest);
            prop_assert_eq!(decoded.end, end);
        }

        #[test]
        fn what_is_less_has_no_larger_code(
            octaves in prop::array::uniform2(-33.0..2.0f64), begins in any::<[u16; 2]>(),
            end in any_end(),
        ) {
            let scale = ErrorScale::for_diagonal(1.0);
            let of = |k: usize| {
                let error = octaves[k].exp2();
                CertifiedCode::new(scale, error, error, Some(begins[k]), end).decode(scale, end)
            };
            let (less, more) = if octaves[0] < octaves[1] { (0, 1) } else { (1, 0) };
            prop_assert!(of(less).radius <= of(more).radius && of(less).close <= of(more).close);
            let (earlier, later) = if begins[0] < begins[1] { (0, 1) } else { (1, 0) };
            prop_assert!(of(earlier).begin <= of(later).begin);
        }

        #[test]
        fn any_bytes_are_bounds(bytes in any::<[u8; 3]>(), end in any::<u16>()) {
            let code: CertifiedCode = bytemuck::cast(bytes);
            let decoded = code.decode(ErrorScale::for_diagonal(1.0), end);
            prop_assert!(decoded.radius >= 0.0 && decoded.close > 0.0);
            prop_assert!(Certified::close_of([decoded; 3]) >= decoded.close);
        }

        #[test]
        fn no_bound_of_a_face_is_below_one_that_c_was_made_of(
            faces in prop::collection::vec((0u16..512, -30.0..0.0f64), 1..9),
            begin in 0u16..400, life in 1u16..300, is_of_base: bool,
        ) {
            let scale = ErrorScale::for_diagonal(0.5);
            let end = if is_of_base { u16::MAX } else { (begin + life).min(511) * 128 };
            let begin = begin * 128;
            // They begin while the vertex is active.
            let faces: Vec<_> = faces.into_iter().map(|(at, octave)| {
                ((at * 128).clamp(begin, end - 1) / 128 * 128, octave.exp2())
            }).collect();
            let part = |&(begin, bound): &(u16, f64)| bound / Certified::growth(begin, end);
            let close = faces.iter().map(part).fold(0.0, f64::max);
            let code = CertifiedCode::new(scale, 1.0, close, Some(begin), end);
            let vertex = code.decode(scale, end);
            for (begin, bound) in faces {
                let corner = Certified { begin, end: u16::MAX, ..Certified::of_radius(1.0) };
                let found = Certified::close_of([corner, vertex, corner]);
                prop_assert!(f64::from(found) >= bound, "{found} below {bound}");
            }
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
        for beyond in [f64::INFINITY, f64::NAN] {
            assert_eq!(decoded(beyond, beyond).radius, f32::INFINITY);
            assert_eq!(decoded(beyond, beyond).close, f32::INFINITY);
        }
    }

    #[test]
    fn where_expected_errors_begin_is_exact() {
        let scale = ErrorScale::for_diagonal(1.0);
        let expected = |octave: f64| scale.encode_expected(octave.exp2());
        for (end, begin) in [(-1.0, -1.1), (-3.3, -9.0), (0.9, -14.0), (-17.3, -30.0)] {
            let (end, begin) = (expected(end), expected(begin));
            let code = CertifiedCode::new(scale, 1.0, 1.0, Some(begin), end);
            assert_eq!(code.decode(scale, end).begin, begin);
        }
        let begin = expected(-14.0);
        let code = CertifiedCode::new(scale, 1.0, 1.0, Some(begin), u16::MAX);
        assert_eq!(code.decode(scale, u16::MAX).begin, begin);
    }

    #[test]
    fn a_face_is_of_a_front_where_its_corners_are() {
        let vertex = |close, begin, end| Certified {
            radius: 9.0,
            close,
            begin,
            end,
        };
        let octaves = |of: u16| 2048 * of;
        let is_about = |found: f32, bound: f32| found >= bound && found < bound * 1.001;
        let a = vertex(3.0, octaves(10), octaves(20));
        let b = vertex(1.0, octaves(15), octaves(30));
        let c = vertex(4.0, 0, octaves(16));
        // It begins an octave before c ends, and fifteen before b does.
        assert!(is_about(Certified::close_of([a, a, c]), 3.0));
        assert!(is_about(Certified::close_of([a, b, c]), 1.0));
        let late = vertex(5.0, octaves(15), octaves(17));
        assert!(is_about(Certified::close_of([c, c, late]), 20.0));
        let base = vertex(1.5, octaves(12), u16::MAX);
        assert!(is_about(Certified::close_of([a, a, base]), 1.5));
        let later = vertex(1.0, octaves(16), octaves(31));
        assert_eq!(Certified::close_of([a, later, c]), f32::INFINITY);
        assert_eq!(Certified::close_of([Certified::EXACT; 3]), f32::INFINITY);
    }
}
