//! The patch of a coarse face: the part of the full mesh that the traces of its edges enclose.

use super::super::full_surface::FullSurface;
use super::plane::{Plane, Seen};
use super::trace::Crossing;
use spm::NONE;

/// The vertices beside each vertex of the full mesh. Memory: 4 B a vertex, 12 B a face.
pub struct Rings {
    first: Vec<u32>,
    around: Vec<u32>,
}

impl Rings {
    pub fn new(full: &FullSurface<'_>, vertices: usize) -> Self {
        let mut first = vec![0u32; vertices + 1];
        for_each_beside(full, |vertex, _| first[vertex as usize + 1] += 1);
        for vertex in 0..vertices {
            first[vertex + 1] += first[vertex];
        }
        let mut place = first.clone();
        let mut around = vec![0; first[vertices] as usize];
        for_each_beside(full, |vertex, beside| {
            around[place[vertex as usize] as usize] = beside;
            place[vertex as usize] += 1;
        });
        Self { first, around }
    }

    /// The vertices beside one.
    pub fn of(&self, vertex: u32) -> &[u32] {
        let [from, to] = [0, 1].map(|k| self.first[vertex as usize + k] as usize);
        &self.around[from..to]
    }
}

/// Visits each vertex with each one beside it.
fn for_each_beside(full: &FullSurface<'_>, mut visit: impl FnMut(u32, u32)) {
    for (corners, across) in full.triangles().iter().zip(full.neighbours()) {
        for k in 0..3 {
            let [vertex, next, before] = [0, 1, 2].map(|j| corners[(k + j) % 3]);
            visit(vertex, next);
            // Inside, the face across names the one before as its next.
            if across[(k + 1) % 3] == NONE {
                visit(vertex, before);
            }
        }
    }
}

/// Room for searches. Memory: 8 B a vertex.
pub struct Search {
    /// By vertex: the last search that found it inside, and the last one in which it ended a
    /// crossing.
    inside: Vec<u32>,
    at_crossing: Vec<u32>,
    number: u32,
    /// Sides that the traces cross: the end inside, and the one outside.
    crossed: Vec<Crossing>,
    /// What is inside, with how it is seen from the face.
    found: Vec<(u32, Seen)>,
}

impl Search {
    pub fn new(vertices: usize) -> Self {
        Self {
            inside: vec![0; vertices],
            at_crossing: vec![0; vertices],
            number: 0,
            crossed: Vec::new(),
            found: Vec::new(),
        }
    }

    /// Begins a face: without edges.
    pub fn begin(&mut self) {
        self.crossed.clear();
    }

    /// Adds the trace of an edge; its left is inside, unless it goes `backward`. What is crossed
    /// there and back is not crossed.
    pub fn add(&mut self, trace: &[Crossing], backward: bool) {
        let before = self.crossed.len();
        for &(left, right) in trace {
            let (inside, outside) = if backward {
                (right, left)
            } else {
                (left, right)
            };
            let opposite = |&c: &Crossing| c == (outside, inside);
            match self.crossed[..before].iter().position(opposite) {
                // Once each: a second one stays, and is no edge of a patch.
                Some(place) => self.crossed[place] = (inside, inside),
                None => self.crossed.push((inside, outside)),
            }
        }
    }

    /// The largest distance of a vertex of the patch from a face; `None` when the traces enclose no
    /// patch of at most `limit` vertices.
    ///
    /// A vertex is inside once or not at all, so that each side with one end inside is crossed, and
    /// outwards, and no other side is.
    pub fn farthest(
        &mut self,
        rings: &Rings,
        full: &FullSurface<'_>,
        plane: &Plane,
        limit: usize,
    ) -> Option<f64> {
        self.begin_search();
        self.crossed.retain(|side| side.0 != side.1);
        for k in 0..self.crossed.len() {
            let (inside, outside) = self.crossed[k];
            self.at_crossing[inside as usize] = self.number;
            self.at_crossing[outside as usize] = self.number;
            self.take(inside, full, plane);
        }
        let number = self.number;
        if self
            .crossed
            .iter()
            .any(|side| self.inside[side.1 as usize] == number)
        {
            return None;
        }
        let mut most = 0.0_f64;
        let (mut next, mut outwards) = (0, 0);
        while let Some(&(vertex, seen)) = self.found.get(next) {
            next += 1;
            most = most.max(seen.away);
            for &beside in rings.of(vertex) {
                if self.inside[beside as usize] == number {
                    continue;
                }
                if self.at_crossing[beside as usize] == number {
                    // All ends inside are found: this one is outside, and this side has to be
                    // crossed.
                    if !self.crossed.contains(&(vertex, beside)) {
                        return None;
                    }
                    outwards += 1;
                    continue;
                }
                self.take(beside, full, plane);
            }
            if self.found.len() > limit {
                return None;
            }
        }
        // Fewer where one is crossed twice.
        (outwards == self.crossed.len()).then_some(most)
    }

    /// The vertices inside that the last search found, as they are seen from the face.
    pub fn inside(&self) -> &[(u32, Seen)] {
        &self.found
    }

    /// Whether the last search found a vertex inside.
    pub fn holds(&self, vertex: u32) -> bool {
        self.inside[vertex as usize] == self.number
    }

    /// Begins a search: nothing is inside.
    pub fn begin_search(&mut self) {
        self.found.clear();
        if self.number == u32::MAX {
            self.inside.fill(0);
            self.at_crossing.fill(0);
            self.number = 0;
        }
        self.number += 1;
    }

    /// Takes a vertex inside.
    pub fn take(&mut self, vertex: u32, full: &FullSurface<'_>, plane: &Plane) {
        if self.inside[vertex as usize] != self.number {
            self.inside[vertex as usize] = self.number;
            self.found.push((vertex, plane.see(full.position(vertex))));
        }
    }
}
