//! Header and base mesh of a model, as stored in the file and sent over the wire.

use super::{Certified, CertifiedCode, ErrorScale, LEVELS, QuarteredFace, RegionGrid, Sizes};
use bytemuck::{Pod, Zeroable};

/// The header of a model: everything that a controller needs before its first record.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ModelHeader {
    /// Content hash.
    pub model: u64,
    /// Diagonal of the full mesh's box, model units; it defines the [`crate::ErrorScale`].
    pub diagonal: f64,
    /// Origin of the file's f32 positions, model units.
    pub origin: [f64; 3],
    /// Smallest corner of the full mesh's box.
    pub lower: [f64; 3],
    /// Largest corner of the full mesh's box.
    pub upper: [f64; 3],
    /// The grid of regions.
    pub grid: RegionGrid,
    /// Smallest tolerance of each level, model units. At most n / 4^l VSPs have an expected error
    /// above that of level l, so regions of any tolerance hold about as many. Ascending from 0;
    /// infinite where the grid has no cell of the level, and from level 1 on without expected
    /// errors.
    pub level_tolerances: [f32; LEVELS],
    /// V0.
    pub base_vertices: u32,
    /// F0.
    pub base_faces: u32,
    /// n.
    pub vsps: u32,
    /// Faces of the full mesh.
    pub faces: u32,
    /// Length of the longest path of dependencies.
    pub dependency_depth: u32,
    /// Largest closure of a region, VSPs.
    pub closure_max: u32,
    /// Faces whose quarters have bounds ([`QuarteredFace`]).
    pub quartered: u32,
    /// Zero.
    pub reserved: u32,
}

impl ModelHeader {
    /// The sizes that define ids.
    #[must_use]
    pub fn sizes(&self) -> Sizes {
        Sizes {
            base_vertices: self.base_vertices,
            base_faces: self.base_faces,
            vsps: self.vsps,
            faces: self.faces,
        }
    }

    /// Level of the grid for regions of a tolerance (model units): 0 for the full mesh, otherwise
    /// the coarsest whose smallest tolerance is not above the given one.
    #[must_use]
    pub fn level_of(&self, tolerance: f32) -> u32 {
        let is_reached = |&level: &f32| level.is_finite() && level <= tolerance;
        if tolerance > 0.0 {
            let reached = self
                .level_tolerances
                .iter()
                .take_while(|level| is_reached(level));
            (reached.count() as u32).saturating_sub(1)
        } else {
            0
        }
    }

    /// Grid for regions of a tolerance (model units).
    #[must_use]
    pub fn grid_of(&self, tolerance: f32) -> RegionGrid {
        let level = self.level_of(tolerance);
        self.grid.at_level(level).unwrap_or(self.grid)
    }

    /// Whether the box is that of a surface of f32 positions: it extends along two axes at least,
    /// by no less than two f32 numbers differ, and the diagonal is its own.
    fn bounds_are_valid(&self) -> bool {
        let sides: [f64; 3] = std::array::from_fn(|k| self.upper[k] - self.lower[k]);
        let least = f64::from(f32::from_bits(1));
        let extends = sides.iter().filter(|&&side| side >= least).count();
        let norm = sides.iter().map(|side| side * side).sum::<f64>().sqrt();
        // Sums of three squares in any order differ by a few units in the last place.
        let rounding = 8.0 * f64::EPSILON * norm;
        sides
            .iter()
            .all(|&side| side >= 0.0 && side <= 2.0 * f64::from(f32::MAX))
            && extends >= 2
            && (self.diagonal - norm).abs() <= rounding
    }

    /// Whether the tolerances start at 0, do not decrease and end with the grid.
    fn level_tolerances_are_valid(&self) -> bool {
        self.level_tolerances[0] == 0.0
            && self.level_tolerances.windows(2).all(|w| w[0] <= w[1])
            && (0..).zip(self.level_tolerances).all(|(level, smallest)| {
                self.grid.at_level(level).is_some() || smallest.is_infinite()
            })
    }

    /// Whether the numbers can be those of a model; checked for the file and again for the wire.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let finite = self
            .origin
            .iter()
            .chain(&self.lower)
            .chain(&self.upper)
            .all(|x| x.is_finite());
        let ids = u64::from(self.base_vertices.max(self.base_faces)) + 2 * u64::from(self.vsps);
        let max_faces = u64::from(self.base_faces) + 2 * u64::from(self.vsps);
        finite
            && self.bounds_are_valid()
            && self.grid.is_valid()
            && self.level_tolerances_are_valid()
            && self.base_vertices >= 3
            && self.base_faces >= 1
            && self.faces >= self.base_faces
            && u64::from(self.faces) <= max_faces
            && ids < u64::from(u32::MAX)
            && self.quartered <= QuarteredFace::MAX
            && self.faces < 1 << 30
    }
}

/// A vertex of the base mesh.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct BaseVertex {
    /// Position, model units.
    pub position: [f32; 3],
    /// What is certified of it.
    pub certified: CertifiedCode,
    /// Zero.
    pub reserved: u8,
}

impl ErrorScale {
    /// What is certified of a vertex of the base mesh.
    #[must_use]
    pub fn certified_of_base(self, vertex: &BaseVertex) -> Certified {
        vertex.certified.decode(self, u16::MAX)
    }
}

/// A face of the base mesh with its neighbours, so that a controller need not search for them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct BaseFace {
    /// Corners, counterclockwise, base vertex ids.
    pub corners: [u32; 3],
    /// AB-tree leaf code.
    pub leaf: u32,
    /// Base face across the edge opposite each corner; [`crate::NONE`] at a boundary.
    pub neighbours: [u32; 3],
    /// Zero.
    pub reserved: u32,
}

// The layout of the file (`FORMAT_VERSION`): a change needs a new version. The wire copies these
// types as they are, so it changes with them and not the other way round.
const _: () = {
    use std::mem::offset_of;
    assert!(size_of::<ModelHeader>() == 208);
    assert!(offset_of!(ModelHeader, model) == 0);
    assert!(offset_of!(ModelHeader, diagonal) == 8);
    assert!(offset_of!(ModelHeader, origin) == 16);
    assert!(offset_of!(ModelHeader, lower) == 40);
    assert!(offset_of!(ModelHeader, upper) == 64);
    assert!(offset_of!(ModelHeader, grid) == 88);
    assert!(offset_of!(ModelHeader, level_tolerances) == 136);
    assert!(offset_of!(ModelHeader, base_vertices) == 176);
    assert!(offset_of!(ModelHeader, base_faces) == 180);
    assert!(offset_of!(ModelHeader, vsps) == 184);
    assert!(offset_of!(ModelHeader, faces) == 188);
    assert!(offset_of!(ModelHeader, dependency_depth) == 192);
    assert!(offset_of!(ModelHeader, closure_max) == 196);
    assert!(offset_of!(ModelHeader, quartered) == 200);
    assert!(size_of::<BaseVertex>() == 16 && offset_of!(BaseVertex, certified) == 12);
    assert!(size_of::<BaseFace>() == 32 && offset_of!(BaseFace, leaf) == 12);
    assert!(offset_of!(BaseFace, neighbours) == 16 && offset_of!(BaseFace, reserved) == 28);
};

#[cfg(test)]
mod tests {
    use crate::SpmParts;

    /// What a damaged byte may make of the box: the tick would divide by its sides.
    #[test]
    fn a_box_without_extent_or_with_another_diagonal_is_no_header() {
        let sound = SpmParts::hexagon().header;
        assert!(sound.is_valid());
        let [lower, upper] = [sound.lower, sound.upper];
        let line = [upper[0], lower[1], lower[2]];
        for (low, high) in [
            (lower, lower),
            (upper, lower),
            (lower, line),
            ([f64::NAN, lower[1], lower[2]], upper),
            (lower, [f64::INFINITY, upper[1], upper[2]]),
            (lower, [1e300, upper[1], upper[2]]),
            (lower.map(|x| x * 1e-300), upper.map(|x| x * 1e-300)),
        ] {
            let mut header = sound;
            (header.lower, header.upper) = (low, high);
            let squares = low.iter().zip(&high).map(|(l, h)| (h - l).powi(2));
            header.diagonal = squares.sum::<f64>().sqrt();
            assert!(!header.is_valid(), "{low:?} to {high:?}");
        }
        for diagonal in [
            0.0,
            -sound.diagonal,
            2.0 * sound.diagonal,
            f64::NAN,
            f64::INFINITY,
        ] {
            let mut header = sound;
            header.diagonal = diagonal;
            assert!(!header.is_valid(), "{diagonal}");
        }
    }
}
