//! The faces of the fronts {E > t}: which corners a face has, and for which t.
//!
//! A vertex is active where the VSP that makes it is in the front and the one that splits it is
//! not: for a range of t. Each face takes the active ancestors of its corners; so the corners that
//! it has over all t are known from the three chains of ancestors alone.

use crate::history::History;
use spm::{Certified, NONE};

/// One more than any code of E: up to it the base mesh is active.
pub const END: u32 = 1 << 16;

/// When vertices are active.
pub struct Fronts {
    /// By vertex: the one that it collapses into.
    parent: Vec<u32>,
    /// By vertex: code of t from which on it is not active, [`END`] in the base mesh.
    end: Vec<u32>,
}

impl Fronts {
    pub fn new(history: &History) -> Self {
        let vertices = history.positions.len();
        let mut fronts = Self {
            parent: vec![NONE; vertices],
            end: vec![END; vertices],
        };
        let collapses = history.collapses.iter().zip(&history.expected);
        for (made, (collapse, &code)) in (history.full_vertices..).zip(collapses) {
            for child in [collapse.vt, collapse.vu] {
                fronts.parent[child as usize] = made;
                fronts.end[child as usize] = code.into();
            }
        }
        fronts
    }

    /// How many times C of a vertex is the bound of a face at it that begins at this code.
    pub fn growth(&self, vertex: u32, begin: u16) -> f64 {
        let end = self.end[vertex as usize].min(u16::MAX.into());
        Certified::growth(begin, end as u16)
    }

    /// Whether a vertex descends from another one, or is it.
    pub fn descends(&self, mut vertex: u32, from: u32) -> bool {
        while vertex != NONE && vertex != from {
            vertex = self.parent[vertex as usize];
        }
        vertex == from
    }

    /// Visits the corners that a face of the full mesh has in the fronts {E > t}, from fine to
    /// coarse, the code of t from which on it has them, and the first one for which it has others.
    pub fn for_each_corners(
        &self,
        full_corners: [u32; 3],
        mut visit: impl FnMut([u32; 3], u32, u32),
    ) {
        let (mut corners, mut from) = (full_corners, 0u32);
        loop {
            let ends = corners.map(|v| self.end[v as usize]);
            let end = ends[0].min(ends[1]).min(ends[2]);
            if end > from {
                visit(corners, from, end);
            }
            if end == END {
                return;
            }
            for vertex in &mut corners {
                while self.end[*vertex as usize] == end {
                    *vertex = self.parent[*vertex as usize];
                }
            }
            let [a, b, c] = corners;
            // Two corners have met: the face is not of this front, nor of a coarser one.
            if a == b || b == c || c == a {
                return;
            }
            from = end;
        }
    }
}
