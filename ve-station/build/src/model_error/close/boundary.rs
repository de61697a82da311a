//! Sides of faces of the full mesh that lie on its rims. A side is three times the face and the
//! corner opposite it.

use super::super::full_surface::FullSurface;
use spm::NONE;

/// The rims of a manifold: a vertex of a rim starts one side on it, and ends one.
pub struct Boundary {
    /// Vertex and the side that it starts, by vertex.
    starts: Vec<(u32, u32)>,
    /// Vertex and the side that it ends, by vertex.
    ends: Vec<(u32, u32)>,
}

/// Start and end of a side, its face on the left.
pub fn ends_of(full: &FullSurface<'_>, side: u32) -> [u32; 2] {
    let corners = full.triangles()[side as usize / 3];
    [1, 2].map(|k| corners[(side as usize + k) % 3])
}

impl Boundary {
    pub fn new(full: &FullSurface<'_>) -> Self {
        let mut boundary = Self {
            starts: Vec::new(),
            ends: Vec::new(),
        };
        for (face, across) in (0u32..).zip(full.neighbours()) {
            for k in (0..3).filter(|&k| across[k as usize] == NONE) {
                let side = 3 * face + k;
                let [start, end] = ends_of(full, side);
                boundary.starts.push((start, side));
                boundary.ends.push((end, side));
            }
        }
        boundary.starts.sort_unstable();
        boundary.ends.sort_unstable();
        boundary
    }

    /// The side that a vertex starts, [`NONE`] away from rims.
    pub fn started_by(&self, vertex: u32) -> u32 {
        find(&self.starts, vertex)
    }

    /// The side that a vertex ends, [`NONE`] away from rims.
    pub fn ended_by(&self, vertex: u32) -> u32 {
        find(&self.ends, vertex)
    }
}

fn find(sides: &[(u32, u32)], vertex: u32) -> u32 {
    let place = sides.binary_search_by_key(&vertex, |side| side.0);
    place.map_or(NONE, |place| sides[place].1)
}
