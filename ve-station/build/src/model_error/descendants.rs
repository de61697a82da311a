//! The vertices of the full mesh in an order in which the descendants of every vertex lie side by
//! side.

use crate::history::History;
use spm::NONE;
use std::ops::Range;

/// Where each vertex of a history, and its descendants, lie in that order. Memory: 8 B a vertex.
pub struct Descendants {
    /// By vertex: place of its first descendant; of a vertex of the full mesh its own.
    first: Vec<u32>,
    /// By vertex that a collapse made: their number.
    count: Vec<u32>,
    full: u32,
}

impl Descendants {
    pub fn new(history: &History) -> Self {
        let full = history.full_vertices;
        let mut found = Self {
            first: vec![NONE; history.positions.len()],
            count: Vec::with_capacity(history.collapses.len()),
            full,
        };
        for collapse in &history.collapses {
            let count = found.count(collapse.vt) + found.count(collapse.vu);
            found.count.push(count);
        }
        // From the base mesh down: parents come after their children.
        let mut end = 0;
        for (k, collapse) in history.collapses.iter().enumerate().rev() {
            let made = full + k as u32;
            if found.first[made as usize] == NONE {
                found.first[made as usize] = end;
                end += found.count(made);
            }
            let first = found.first[made as usize];
            found.first[collapse.vt as usize] = first;
            found.first[collapse.vu as usize] = first + found.count(collapse.vt);
        }
        for first in &mut found.first[..full as usize] {
            if *first == NONE {
                *first = end;
                end += 1;
            }
        }
        found
    }

    /// Number of descendants; 1 of a vertex of the full mesh.
    pub fn count(&self, vertex: u32) -> u32 {
        match vertex.checked_sub(self.full) {
            Some(made) => self.count[made as usize],
            None => 1,
        }
    }

    /// Places of the descendants.
    pub fn places(&self, vertex: u32) -> Range<u32> {
        let first = self.first[vertex as usize];
        first..first + self.count(vertex)
    }

    /// Whether a vertex of the full mesh descends from another vertex, or is it.
    pub fn descends(&self, leaf: u32, from: u32) -> bool {
        self.places(from).contains(&self.first[leaf as usize])
    }
}
