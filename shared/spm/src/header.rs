//! Header and base mesh of a model, as they lie in the file and cross the wire.

use super::{LEVELS, RegionGrid, Sizes};
use bytemuck::{Pod, Zeroable};

/// The head of a model: all that a controller must know before its first record.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct ModelHeader {
    /// Content hash.
    pub model: u64,
    /// Diagonal of the full mesh's box, model units: fixes the [`crate::ErrorScale`].
    pub diagonal: f64,
    /// The file's origin, which its f32 positions are relative to, model units.
    pub origin: [f64; 3],
    /// Smallest corner of the full mesh's box.
    pub lower: [f64; 3],
    /// Largest corner of the full mesh's box.
    pub upper: [f64; 3],
    /// The grid of regions.
    pub grid: RegionGrid,
    /// The smallest tolerance of each level, model units: at `ladder[l]` at most n / 4^l VSPs have a larger
    /// expected error, so that a region of any tolerance holds about as many. Does not decrease; `ladder[0]`
    /// is 0; infinite where the grid has no cell of that level left, and from 1 on without expected errors.
    pub ladder: [f32; LEVELS],
    /// V0.
    pub base_vertices: u32,
    /// F0.
    pub base_faces: u32,
    /// n.
    pub vsps: u32,
    /// Faces of the full mesh.
    pub faces: u32,
    /// The longest chain of dependencies.
    pub chain: u32,
    /// The largest closure of a region, VSPs.
    pub closure_max: u32,
    /// Zero.
    pub reserved: [u32; 2],
}

impl ModelHeader {
    /// The sizes that fix ids.
    #[must_use]
    pub fn sizes(&self) -> Sizes {
        Sizes {
            base_vertices: self.base_vertices,
            base_faces: self.base_faces,
            vsps: self.vsps,
            faces: self.faces,
        }
    }

    /// The level of the grid in which regions of a tolerance (model units) are named: 0 for the full mesh, else
    /// the coarsest whose rung of the ladder is not above the tolerance.
    #[must_use]
    pub fn level_of(&self, tolerance: f32) -> u32 {
        let is_reached = |&rung: &f32| rung.is_finite() && rung <= tolerance;
        if tolerance > 0.0 {
            let reached = self.ladder.iter().take_while(|rung| is_reached(rung));
            (reached.count() as u32).saturating_sub(1)
        } else {
            0
        }
    }

    /// The grid in which regions of a tolerance (model units) are named.
    #[must_use]
    pub fn grid_of(&self, tolerance: f32) -> RegionGrid {
        let level = self.level_of(tolerance);
        self.grid.at_level(level).unwrap_or(self.grid)
    }

    /// Whether the ladder starts at 0, does not decrease and ends where the grid does.
    fn ladder_is_valid(&self) -> bool {
        self.ladder[0] == 0.0
            && self.ladder.windows(2).all(|w| w[0] <= w[1])
            && (0..)
                .zip(self.ladder)
                .all(|(level, rung)| self.grid.at_level(level).is_some() || rung.is_infinite())
    }

    /// Whether the numbers can be a model at all; checked at the file and again at the wire.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let finite = self
            .origin
            .iter()
            .chain(&self.lower)
            .chain(&self.upper)
            .all(|x| x.is_finite());
        let ordered = self.lower.iter().zip(&self.upper).all(|(l, u)| l <= u);
        let ids = u64::from(self.base_vertices.max(self.base_faces)) + 2 * u64::from(self.vsps);
        let made = u64::from(self.base_faces) + 2 * u64::from(self.vsps);
        finite
            && ordered
            && self.diagonal.is_normal()
            && self.diagonal > 0.0
            && self.grid.is_valid()
            && self.ladder_is_valid()
            && self.base_vertices >= 3
            && self.base_faces >= 1
            && self.faces >= self.base_faces
            && u64::from(self.faces) <= made
            && ids < u64::from(u32::MAX)
            && self.faces < 1 << 30
    }
}

/// A vertex of the base mesh.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct BaseVertex {
    /// Position, model units.
    pub position: [f32; 3],
    /// Code of R.
    pub r: u32,
}

/// A face of the base mesh, 32 bytes, with its neighbours: a controller must not search for them.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct BaseFace {
    /// Corners, counterclockwise, base vertex ids.
    pub corners: [u32; 3],
    /// AB-tree leaf code.
    pub leaf: u32,
    /// Base face across the edge opposite each corner; [`crate::NONE`] at a rim.
    pub neighbours: [u32; 3],
    /// Zero.
    pub reserved: u32,
}
