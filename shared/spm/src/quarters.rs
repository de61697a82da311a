//! What is certified of the quarters of a face, in four bytes, and the faces that have such bytes.
//!
//! A face may be large beside the path of a contact, and lie along flats and shores at once: one
//! number would be that of its worst point. The lines between the middles of its sides cut it in
//! four, one quarter at each corner and one between them. The bound of a quarter holds one way: no
//! point of it is farther from the full mesh. A contact is a point, and asks for no more.
//!
//! A model has a table of such faces, those of which it tells the most, and of quarters that are
//! cut in four again. A face of a front has the corners that it has in the front {E > t} where they
//! are all active for a common t (see [`super::CertifiedCode`]). It has others for other t, so its
//! number and the code from which on it has others name the corners.

use super::certified::rounded_up;
use super::{Certified, ErrorScale, Sizes};
use bytemuck::{Pod, Zeroable};

/// The four bytes: those of the quarters at the corners, then that of the one between. A byte is
/// how far the bound is below the scale, in steps of an eighth of an octave, rounded up; 0 if it
/// is above: without limit.
#[repr(transparent)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QuarterCodes([u8; 4]);

/// A face of fronts {E > t} whose quarters have bounds, as stored in the file and sent over the
/// wire.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QuarteredFace {
    /// The face, an id.
    pub face: u32,
    /// The least code at which a corner ends (see [`Certified::end`]); `u16::MAX` in the base mesh.
    pub end: u16,
    /// Which part of the face is cut in four: 0 the whole, 1 + k its quarter k, and so on: 4 p + 1
    /// + k the quarter k of part p. Quarter 3 is the one between the corners.
    pub part: u16,
    /// The bounds.
    pub quarters: QuarterCodes,
}

// The layout of the file (`FORMAT_VERSION`): a change needs a new version.
const _: () = {
    use std::mem::offset_of;
    assert!(size_of::<QuarteredFace>() == 12);
    assert!(offset_of!(QuarteredFace, end) == 4 && offset_of!(QuarteredFace, part) == 6);
    assert!(offset_of!(QuarteredFace, quarters) == 8);
};

/// The quartered faces of a model, ascending, as far as they are known.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct QuarterTable {
    #[cfg_attr(feature = "serde", serde(with = "crate::reserved"))]
    faces: Vec<QuarteredFace>,
    scale: ErrorScale,
}

impl QuarterCodes {
    /// Codes of errors a step.
    const STEP: u16 = 256;

    /// The codes of these bounds, model units: those of the quarters at the corners, then that of
    /// the one between.
    #[must_use]
    pub fn new(scale: ErrorScale, bounds: [f64; 4]) -> Self {
        Self(bounds.map(|bound| ((u16::MAX - scale.encode(bound)) / Self::STEP) as u8))
    }

    /// The bound of a quarter, model units.
    #[must_use]
    pub fn bound(self, quarter: usize, scale: ErrorScale) -> f32 {
        let code = u16::MAX - u16::from(self.0[quarter]) * Self::STEP;
        rounded_up(scale.decode(code))
    }

    /// The quarter in which a point with these weights of the corners lies, which add up to one,
    /// and its weights of the corners of the quarter.
    fn place([a, b, c]: [f64; 3]) -> (usize, [f64; 3]) {
        // The corner of the face comes first, then those on its sides, counterclockwise.
        match [a, b, c].iter().position(|&weight| weight >= 0.5) {
            Some(0) => (0, [2.0 * a - 1.0, 2.0 * b, 2.0 * c]),
            Some(1) => (1, [2.0 * b - 1.0, 2.0 * c, 2.0 * a]),
            Some(_) => (2, [2.0 * c - 1.0, 2.0 * a, 2.0 * b]),
            // The middles of the sides, from that of the first two corners on.
            None => (3, [a + b - c, b + c - a, c + a - b]),
        }
    }
}

impl QuarteredFace {
    /// The most that a model has: about as many bytes as the base mesh has by default.
    pub const MAX: u32 = 2048;

    /// Times that a face may be cut in four.
    pub const MAX_DEPTH: u32 = 3;
    /// Parts of a face that may be cut.
    const PARTS: u16 = 1 + 4 + 16;

    /// By which they ascend.
    #[must_use]
    pub fn key(&self) -> (u32, u16, u16) {
        (self.face, self.end, self.part)
    }

    /// The part that is a quarter of a part.
    #[must_use]
    pub fn part_of(part: u16, quarter: usize) -> u16 {
        4 * part + 1 + quarter as u16
    }

    /// Whether it can be one of a model, after one with this key.
    #[must_use]
    pub fn is_valid(&self, sizes: Sizes, before: Option<(u32, u16, u16)>) -> bool {
        self.part < Self::PARTS
            && u64::from(self.face) < u64::from(sizes.base_faces) + 2 * u64::from(sizes.vsps)
            && before.is_none_or(|before| before < self.key())
    }
}

impl QuarterTable {
    pub fn with_room(faces: usize) -> Self {
        Self {
            faces: Vec::with_capacity(faces),
            scale: ErrorScale::for_diagonal(1.0),
        }
    }

    pub fn clear(&mut self) {
        self.faces.clear();
    }

    pub fn len(&self) -> usize {
        self.faces.len()
    }

    /// Adds the next face; false when there is no room for it, or it is not above the last one.
    /// The scale is that of the model.
    pub fn push(&mut self, face: QuarteredFace, scale: ErrorScale) -> bool {
        let has_room = self.faces.len() < self.faces.capacity();
        let is_next = self.faces.last().is_none_or(|last| last.key() < face.key());
        if has_room && is_next {
            self.faces.push(face);
            self.scale = scale;
        }
        has_room && is_next
    }

    /// The bound at a point of a face with these corners, if there is one: `weights` gives the
    /// point's weights of them; model units.
    pub fn at(
        &self,
        face: u32,
        corners: [Certified; 3],
        weights: impl FnOnce() -> [f64; 3],
    ) -> Option<f32> {
        let end = Certified::common(corners)?.end;
        let of = |part| {
            let key = (face, end, part);
            let place = self.faces.binary_search_by_key(&key, QuarteredFace::key);
            Some(self.faces[place.ok()?].quarters)
        };
        let (mut part, mut quarters, mut weights) = (0, of(0)?, weights());
        let mut bound = f32::INFINITY;
        for _ in 0..QuarteredFace::MAX_DEPTH {
            let (quarter, inside) = QuarterCodes::place(weights);
            bound = bound.min(quarters.bound(quarter, self.scale));
            part = QuarteredFace::part_of(part, quarter);
            let Some(cut) = of(part) else { break };
            (quarters, weights) = (cut, inside);
        }
        Some(bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn quartered((face, end, part): (u32, u16, u16), bounds: [f64; 4]) -> QuarteredFace {
        QuarteredFace {
            face,
            end,
            part,
            quarters: QuarterCodes::new(ErrorScale::for_diagonal(8.0), bounds),
        }
    }

    proptest! {
        #[test]
        fn no_code_is_below_what_it_stands_for_and_hardly_above(octave in -28.0..0.5f64) {
            let scale = ErrorScale::for_diagonal(3.0);
            let bound = 3.0 * octave.exp2();
            let codes = QuarterCodes::new(scale, [0.0, bound, f64::INFINITY, f64::NAN]);
            let found = [0, 1, 2, 3].map(|quarter| codes.bound(quarter, scale));
            prop_assert!(f64::from(found[1]) >= bound && f64::from(found[1]) <= bound * 1.1);
            prop_assert!(found[0] > 0.0 && found[0] < 1e-8);
            prop_assert!(found[2..] == [f32::INFINITY; 2]);
        }

        #[test]
        fn a_table_finds_what_was_put_into_it_and_nothing_else(
            mut keys in prop::collection::vec((0u32..20, 1u16..5, Just(0u16)), 0..60),
        ) {
            keys.sort_unstable();
            keys.dedup();
            let scale = ErrorScale::for_diagonal(3.0);
            let faces: Vec<QuarteredFace> =
                keys.iter().map(|&key| quartered(key, [f64::from(key.0) + 0.1; 4])).collect();
            let mut table = QuarterTable::with_room(faces.len());
            for (k, &face) in faces.iter().enumerate() {
                prop_assert!(table.push(face, scale));
                prop_assert!(!table.push(faces[k / 2], scale), "out of order");
            }
            prop_assert_eq!(table.len(), faces.len());
            prop_assert!(!table.push(quartered((99, 0, 0), [1.0; 4]), scale), "one too many");
            let corner = |begin, end| Certified { begin, end, ..Certified::of_radius(1.0) };
            let find = |face, ends: [Certified; 3]| table.at(face, ends, || [1.0, 0.0, 0.0]);
            for face in 0..20 {
                for end in 1..5 {
                    let found = find(face, [corner(0, 7), corner(0, end), corner(0, end)]);
                    let entry = faces.iter().find(|entry| entry.key() == (face, end, 0));
                    prop_assert_eq!(found, entry.map(|entry| entry.quarters.bound(0, scale)));
                }
            }
            // Corners that are never active together.
            prop_assert_eq!(find(1, [corner(3, 4), corner(0, 3), corner(0, 3)]), None);
        }

        #[test]
        fn a_quarter_holds_the_point_with_its_weights(
            [s, t] in prop::array::uniform2(0.0..1.0f64), fold: bool,
        ) {
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            // On the lines between quarters too.
            let s = if fold { 0.5 - t / 2.0 } else { s };
            let corners = [[0.0, 0.0], [8.0, 1.0], [2.0, 6.0]];
            let at = |corners: [[f64; 2]; 3], weights: [f64; 3]| {
                [0, 1].map(|k| (0..3).map(|j| weights[j] * corners[j][k]).sum::<f64>())
            };
            let weights = [1.0 - s - t, s, t];
            let (quarter, inside) = QuarterCodes::place(weights);
            let middle = |j: usize, k: usize| [0, 1].map(|x| (corners[j][x] + corners[k][x]) / 2.0);
            let [ab, bc, ca] = [middle(0, 1), middle(1, 2), middle(2, 0)];
            let [a, b, c] = corners;
            let cut = [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]][quarter];
            let (whole, part) = (at(corners, weights), at(cut, inside));
            prop_assert!((0..2).all(|k| (whole[k] - part[k]).abs() < 1e-12));
            prop_assert!(inside.iter().all(|&weight| weight >= -1e-12));
        }
    }

    #[test]
    fn a_quarter_that_is_cut_again_has_bounds_of_its_own_quarters() {
        let corners = [Certified {
            begin: 0,
            end: 9,
            ..Certified::of_radius(1.0)
        }; 3];
        let scale = ErrorScale::for_diagonal(8.0);
        let mut table = QuarterTable::with_room(3);
        let mut add = |part, bounds| table.push(quartered((5, 9, part), bounds), scale);
        assert!(add(0, [4.0, 3.0, 2.0, 1.0]));
        assert!(add(2, [2.5, 2.0, 9.0, 0.5]));
        assert!(add(12, [0.1, 0.2, 0.3, 0.4]));
        let at = |weights: [f64; 3]| table.at(5, corners, || weights);
        // Bounds are rounded up by less than a tenth.
        let is_near = |found: Option<f32>, bound: f32| {
            found.is_some_and(|found| (bound..1.1 * bound).contains(&found))
        };
        assert!(is_near(at([0.8, 0.1, 0.1]), 4.0));
        assert!(is_near(at([0.1, 0.9, 0.0]), 2.5));
        let no_more_than_the_whole = at([0.4, 0.5, 0.1]);
        assert!(is_near(no_more_than_the_whole, 3.0));
        assert!(is_near(at([1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0]), 0.4));
        assert_eq!(table.at(6, corners, || [1.0, 0.0, 0.0]), None);
    }

    #[test]
    fn zero_bytes_are_no_bound() {
        let scale = ErrorScale::for_diagonal(1.0);
        for quarter in 0..4 {
            assert_eq!(QuarterCodes::default().bound(quarter, scale), f32::INFINITY);
        }
    }
}
