//! C: a close bound of the fronts {E > t}, one number a vertex.
//!
//! Let T be a face of such a front. Each corner has a *foot* on the full mesh, each edge a *trace*,
//! a path over the full mesh between the feet of its ends. The traces of T's edges enclose its
//! *patch*. The bound of T is the largest of
//!
//! - the distances of its corners from their feet, and of each trace from its edge,
//! - the distances of the patch's vertices from T.
//!
//! *The patch is so near to T.* It consists of pieces of flat faces, and the distance from T is a
//! convex function. So it is largest at corners of the pieces, which are vertices of the full mesh
//! or lie on traces.
//!
//! *T is so near to the full mesh.* Take each point of the patch to the nearest point of T, and
//! connect that along a line, for a point of a trace, with the nearest point of its edge (for a
//! foot, with its corner). The outer ends of the lines run once round T. If a point of T were met
//! neither by the map nor by a line, the map of the patch would be a surface beside that point with
//! a boundary that goes round it, which cannot be. So every point of T is met, and it is no farther
//! from the full mesh than what is taken to it.
//!
//! *The patches of a front cover the full mesh*: each trace bounds the patches on both of its
//! sides, and where the front has a rim it runs along the full mesh's. So together the patches have
//! no boundary, and every point of a part of the full mesh lies in equally many: in one, unless the
//! bounds are as large as the part. It is so near to the face in whose patch it lies.
//!
//! Nothing else is asked of traces: they may cross each other. Where one does not arrive, or where
//! they enclose no patch, the bound of T is the largest R of its corners. Beside such a face, or
//! where a front {E > t} meets another one, patches and what R counts need not cover the full mesh
//! between them: of what neither covers, R alone is certified.
//!
//! C of a vertex is the least number from which the bounds of its faces follow, over every t for
//! which it is active (see [`spm::Certified::growth`]). So for a face whose corners are active for
//! a common t, which makes it a face of that front, what follows from C of each corner is a bound,
//! and so is the least of that.

mod boundary;
mod detour;
mod foot;
mod patch;
mod trace;

use super::descendants::Descendants;
use super::fronts::Fronts;
use super::full_surface::FullSurface;
use crate::history::History;
use crate::progress::Progress;
use crate::tuning::close::{FACES_A_TASK, LIMIT_OF_EDGE, LIMIT_OF_RADIUS, PATCH};
use boundary::Boundary;
use foot::{Foot, feet};
use glam::{DVec3, Vec3};
use patch::{Rings, Search};
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use trace::{Crossing, Edge, Traces};

/// C of the vertices of a history, model units, given R of those that collapses made. The same bits
/// for any number of threads. Memory: 80 B a vertex, 24 B a face, 8 B a vertex and thread.
pub fn close_bounds(
    history: &History,
    full: &FullSurface<'_>,
    (descendants, fronts): (&Descendants, &Fronts),
    rounding: f64,
    progress: &dyn Progress,
) -> Vec<f64> {
    let faces = full.triangles().len();
    progress.phase("certifying fronts", faces as u64);
    let vertices = history.full_vertices as usize;
    let boundary = Boundary::new(full);
    let work = Work {
        history,
        feet: feet(history, full, &boundary, descendants),
        fronts,
        rings: Rings::new(full, vertices),
        traces: Traces {
            full,
            boundary: &boundary,
            descendants,
        },
        rounding,
        bounds: history
            .positions
            .iter()
            .map(|_| AtomicU64::new(0))
            .collect(),
    };
    let tasks = faces.div_ceil(FACES_A_TASK);
    // Few searches: each has 8 B a vertex of its own.
    let turn = tasks.div_ceil(4 * rayon::current_num_threads()).max(1);
    (0..tasks).into_par_iter().with_min_len(turn).for_each_init(
        || Search::new(vertices),
        |search, task| {
            let first = task * FACES_A_TASK;
            work.certify(first..faces.min(first + FACES_A_TASK), search);
        },
    );
    // The bits of numbers that are not negative are in their order.
    let bounds = work.bounds.into_iter();
    bounds
        .map(|bits| f64::from_bits(bits.into_inner()))
        .collect()
}

/// What differences of coordinates lose, and points on sides, model units.
pub fn rounding(history: &History) -> f64 {
    let coordinates = history.positions.iter().flatten();
    let largest = coordinates.fold(0.0_f32, |most, x| most.max(x.abs()));
    32.0 * f64::EPSILON * f64::from(largest)
}

struct Work<'a> {
    history: &'a History,
    feet: Vec<Foot>,
    fronts: &'a Fronts,
    rings: Rings,
    traces: Traces<'a>,
    rounding: f64,
    /// By vertex: the bits of C so far.
    bounds: Vec<AtomicU64>,
}

/// The traces of a task's edges.
#[derive(Default)]
struct Traced {
    /// By ends, the smaller first: the trace's crossings, and its largest squared distance,
    /// infinite where there is none.
    edges: HashMap<(u32, u32), (u32, u32, f64), BuildHasherDefault<PairHasher>>,
    crossings: Vec<Crossing>,
}

/// Hashes pairs of vertices.
#[derive(Default)]
struct PairHasher(u64);

impl Hasher for PairHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 32
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u32(byte.into());
        }
    }

    fn write_u32(&mut self, word: u32) {
        // The fraction of the golden ratio.
        self.0 = (self.0.rotate_left(29) ^ u64::from(word)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
}

impl Work<'_> {
    fn at(&self, vertex: u32) -> DVec3 {
        Vec3::from_array(self.history.positions[vertex as usize]).as_dvec3()
    }

    fn radius(&self, vertex: u32) -> f64 {
        let made = vertex.checked_sub(self.history.full_vertices);
        made.map_or(0.0, |made| self.history.radius[made as usize])
    }

    /// Raises C of the corners of some faces.
    fn certify(&self, faces: std::ops::Range<usize>, search: &mut Search) {
        let mut traced = Traced::default();
        for &full_corners in &self.traces.full.triangles()[faces] {
            self.fronts
                .for_each_corners(full_corners, |corners, begin, _| {
                    if corners == full_corners {
                        // A face of the full mesh: its bound is 0.
                        return;
                    }
                    let bound = self.bound(corners, &mut traced, search);
                    for corner in corners {
                        // Only where a vertex ends is beyond the codes.
                        let close = bound / self.fronts.growth(corner, begin as u16);
                        self.bounds[corner as usize].fetch_max(close.to_bits(), Relaxed);
                    }
                });
        }
    }

    /// The bound of a face.
    fn bound(&self, corners: [u32; 3], traced: &mut Traced, search: &mut Search) -> f64 {
        let radius = corners
            .map(|v| self.radius(v))
            .into_iter()
            .fold(0.0, f64::max);
        let mut most = 0.0_f64;
        search.begin();
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let ends = (a.min(b), a.max(b));
            let known = traced.edges.get(&ends).copied();
            let (first, last, distance) = known.unwrap_or_else(|| self.trace(ends, traced));
            most = most.max(distance);
            search.add(&traced.crossings[first as usize..last as usize], b < a);
        }

        if most > radius * radius {
            return radius;
        }
        let descendants = |v| self.traces.descendants.count(v) as usize;
        let (at_least, each) = PATCH;
        let limit = at_least + each * corners.map(descendants).into_iter().sum::<usize>();
        let at = corners.map(|v| self.at(v));
        let found = search.farthest(&self.rings, self.traces.full, at, limit);
        found.map_or(radius, |patch| {
            // Squares and the root are rounded too.
            let bound = most.max(patch).sqrt() * (1.0 + 8.0 * f64::EPSILON) + self.rounding;
            bound.min(radius)
        })
    }

    fn trace(&self, ends: (u32, u32), traced: &mut Traced) -> (u32, u32, f64) {
        let at = [ends.0, ends.1].map(|v| self.at(v));
        let edge = Edge {
            ends: [ends.0, ends.1],
            at,
            feet: [ends.0, ends.1].map(|v| &self.feet[v as usize]),
        };
        // Farther away it is of no use, at most of its faces.
        let radius = self.radius(ends.0).max(self.radius(ends.1)) * LIMIT_OF_RADIUS;
        let limit = radius
            .powi(2)
            .max(at[0].distance_squared(at[1]) * LIMIT_OF_EDGE);
        let first = traced.crossings.len();
        let distance = self.traces.trace(&edge, limit, &mut traced.crossings);
        if distance.is_none() {
            traced.crossings.truncate(first);
        }
        let last = traced.crossings.len();
        let found = (first as u32, last as u32, distance.unwrap_or(f64::INFINITY));
        traced.edges.insert(ends, found);
        found
    }
}

#[cfg(test)]
mod tests;
