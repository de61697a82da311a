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
//! Nothing else is asked of traces: they may cross each other. Then a point counts as often as they
//! go round it (see [`winding`]), and the patch is where that is not 0 times: what is said above is
//! true of pieces that count so often. Where a trace does not arrive, or where they enclose no
//! patch, the bound of T is the largest R of its corners. Beside such a face, or
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
mod parts;
mod patch;
mod plane;
mod trace;
mod winding;

pub use parts::PartBounds;

use super::descendants::Descendants;
use super::fronts::Fronts;
use super::full_surface::FullSurface;
use crate::history::History;
use crate::progress::Progress;
use crate::tuning::close::{FACES_A_TASK, LIMIT_OF_EDGE, LIMIT_OF_RADIUS, PATCH};
use boundary::Boundary;
use foot::{Foot, feet};
use glam::{DVec3, Vec3};
use parts::PartSearch;
use patch::{Rings, Search};
use plane::Plane;
use rayon::prelude::*;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use trace::{Crossing, Edge, Paths, Traces};

/// A face of fronts {E > t} whose parts get bounds.
#[derive(Debug, Clone, Copy)]
pub struct LargeFace {
    /// Its number in the full mesh.
    pub face: u32,
    /// The first code of t for which its corners are as they are.
    pub begin: u16,
    /// Which of the corners that its face of the full mesh took on comes first in the file.
    pub first: usize,
}

/// The patches of the faces of fronts {E > t}. Memory: 80 B a vertex, 24 B a face.
pub struct Patches<'a> {
    history: &'a History,
    fronts: &'a Fronts,
    feet: Vec<Foot>,
    rings: Rings,
    traces: Traces<'a>,
    rounding: f64,
}

/// C of the vertices of a history, model units, given R of those that collapses made, and bounds of
/// the parts of some faces in their order; `None` where a face has no patch. The same bits for any
/// number of threads. Memory: 12 B a vertex and thread, 4 B a face and thread.
pub fn close_bounds(
    patches: &Patches<'_>,
    large: &[LargeFace],
    progress: &dyn Progress,
) -> (Vec<f64>, Vec<Option<PartBounds>>) {
    let faces = patches.full().triangles().len();
    progress.phase("certifying fronts", faces as u64);
    let positions = patches.history.positions.iter();
    let bounds: Vec<AtomicU64> = positions.map(|_| AtomicU64::new(0)).collect();
    let tasks = faces.div_ceil(FACES_A_TASK);
    // Few searches: each has room of its own.
    let turn = tasks.div_ceil(4 * rayon::current_num_threads()).max(1);
    let tasks = (0..tasks).into_par_iter().with_min_len(turn);
    let parts = tasks.map_init(
        || (Traced::default(), patches.search(), patches.part_search()),
        |(traced, search, room), task| {
            traced.clear();
            let first = task * FACES_A_TASK;
            let faces = first..faces.min(first + FACES_A_TASK);
            let [from, to] = [faces.start, faces.end]
                .map(|end| large.partition_point(|large| (large.face as usize) < end));
            patches.certify(faces, &large[from..to], (traced, search, room), &bounds)
        },
    );
    let parts = parts.flatten_iter().collect();
    // The bits of numbers that are not negative are in their order.
    let bounds = bounds.into_iter();
    let bounds = bounds.map(|bits| f64::from_bits(bits.into_inner()));
    (bounds.collect(), parts)
}

/// What differences of coordinates lose, and points on sides, model units.
fn rounding(history: &History) -> f64 {
    let coordinates = history.positions.iter().flatten();
    let largest = coordinates.fold(0.0_f32, |most, x| most.max(x.abs()));
    32.0 * f64::EPSILON * f64::from(largest)
}

/// The traces of a task's edges.
#[derive(Default)]
pub struct Traced {
    /// By ends, the smaller first.
    edges: HashMap<(u32, u32), Trace, BuildHasherDefault<PairHasher>>,
    paths: Paths,
}

/// Where the path of an edge lies, and its largest squared distance from the edge; infinite where
/// there is none.
#[derive(Debug, Clone, Copy)]
struct Trace {
    first: [usize; 2],
    last: [usize; 2],
    distance_squared: f64,
}

impl Traced {
    /// Without edges, in the room of those before.
    fn clear(&mut self) {
        self.edges.clear();
        self.paths.clear();
    }

    /// The sides that a trace crosses.
    fn crossings(&self, of: &Trace) -> &[Crossing] {
        &self.paths.crossings[of.first[0]..of.last[0]]
    }

    /// The corners of a trace, each with the face that holds the path to the next one.
    fn corners(&self, of: &Trace) -> &[(DVec3, u32)] {
        &self.paths.corners[of.first[1]..of.last[1]]
    }
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

impl<'a> Patches<'a> {
    /// Of a history on its full mesh.
    pub fn new(
        history: &'a History,
        full: &'a FullSurface<'a>,
        (descendants, fronts): (&'a Descendants, &'a Fronts),
    ) -> Self {
        let boundary = Boundary::new(full);
        Self {
            history,
            feet: feet(history, full, &boundary, descendants),
            fronts,
            rings: Rings::new(full, history.full_vertices as usize),
            traces: Traces {
                full,
                boundary,
                descendants,
            },
            rounding: rounding(history),
        }
    }

    /// Room for searches.
    fn search(&self) -> Search {
        Search::new(self.history.full_vertices as usize)
    }

    /// What the patches are of.
    pub fn history(&self) -> &'a History {
        self.history
    }

    /// Where they lie.
    pub fn full(&self) -> &'a FullSurface<'a> {
        self.traces.full
    }

    /// When vertices are active.
    pub fn fronts(&self) -> &'a Fronts {
        self.fronts
    }

    fn at(&self, vertex: u32) -> DVec3 {
        Vec3::from_array(self.history.positions[vertex as usize]).as_dvec3()
    }

    /// The largest R of the corners of a face.
    pub fn radius(&self, corners: [u32; 3]) -> f64 {
        let of = |vertex: u32| {
            let made = vertex.checked_sub(self.history.full_vertices);
            made.map_or(0.0, |made| self.history.radius[made as usize])
        };
        corners.map(of).into_iter().fold(0.0, f64::max)
    }

    /// Raises C of the corners of some faces; returns bounds of the parts of the large ones, which
    /// are in order.
    fn certify(
        &self,
        faces: Range<usize>,
        large: &[LargeFace],
        (traced, search, room): (&mut Traced, &mut Search, &mut PartSearch),
        bounds: &[AtomicU64],
    ) -> Vec<Option<PartBounds>> {
        let mut parts = Vec::with_capacity(large.len());
        for (face, &full_corners) in faces.clone().zip(&self.full().triangles()[faces]) {
            self.fronts
                .for_each_corners(full_corners, |corners, begin, _| {
                    if corners == full_corners {
                        // A face of the full mesh: its bound is 0.
                        return;
                    }
                    let radius = self.radius(corners);
                    let patch = self.patch(corners, traced, search);
                    let close = patch.as_ref().map(|patch| patch.bound);
                    let bound = close.map_or(radius, |close| close.min(radius));
                    for corner in corners {
                        // Only where a vertex ends is beyond the codes.
                        let close = bound / self.fronts.growth(corner, begin as u16);
                        bounds[corner as usize].fetch_max(close.to_bits(), Relaxed);
                    }
                    let next = large.get(parts.len());
                    let is_next =
                        |of: &&LargeFace| (of.face as usize, of.begin.into()) == (face, begin);
                    if let Some(of) = next.filter(is_next) {
                        let found = (&*traced, &*search);
                        parts.push(patch.and_then(|patch| {
                            self.parts((corners, of.first), &patch, found, room)
                        }));
                    }
                });
        }
        parts
    }

    /// The patch of a face, whose vertices the search holds; `None` where there is none, or where
    /// it says no more than R does.
    fn patch(&self, corners: [u32; 3], traced: &mut Traced, search: &mut Search) -> Option<Patch> {
        let mut most = 0.0_f64;
        search.begin();
        let edges = [0, 1, 2].map(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let ends = (a.min(b), a.max(b));
            let known = traced.edges.get(&ends).copied();
            let trace = known.unwrap_or_else(|| self.trace(ends, traced));
            most = most.max(trace.distance_squared);
            search.add(traced.crossings(&trace), b < a);
            trace
        });
        if most > self.radius(corners).powi(2) {
            return None;
        }
        let descendants = |v| self.traces.descendants.count(v) as usize;
        let (at_least, each) = PATCH;
        let limit = at_least + each * corners.map(descendants).into_iter().sum::<usize>();
        let plane = Plane::new(corners.map(|v| self.at(v)), self.rounding);
        let simple = search.farthest(&self.rings, self.full(), &plane, limit);
        let farthest = simple.or_else(|| {
            let sides = (0..3).flat_map(|k| {
                let backward = corners[(k + 1) % 3] < corners[k];
                let crossings = traced.crossings(&edges[k]).iter();
                crossings.map(move |&(left, right)| match backward {
                    false => (left, right),
                    true => (right, left),
                })
            });
            search.farthest_wound(sides, &self.rings, (self.full(), &plane), limit)
        })?;
        Some(Patch {
            edges,
            bound: plane.rounded_up(most.sqrt().max(farthest)),
            plane,
        })
    }

    fn trace(&self, ends: (u32, u32), traced: &mut Traced) -> Trace {
        let at = [ends.0, ends.1].map(|v| self.at(v));
        let edge = Edge {
            ends: [ends.0, ends.1],
            at,
            feet: [ends.0, ends.1].map(|v| &self.feet[v as usize]),
        };
        // Farther away it is of no use, at most of its faces.
        let radius = self.radius([ends.0, ends.1, ends.1]) * LIMIT_OF_RADIUS;
        let limit = radius
            .powi(2)
            .max(at[0].distance_squared(at[1]) * LIMIT_OF_EDGE);
        let first = traced.paths.mark();
        let distance_squared = self.traces.trace(&edge, limit, &mut traced.paths);
        let found = Trace {
            first,
            last: traced.paths.mark(),
            distance_squared: distance_squared.unwrap_or(f64::INFINITY),
        };
        traced.edges.insert(ends, found);
        found
    }
}

/// The patch of a face: the traces of its edges, and the bound.
struct Patch {
    plane: Plane,
    edges: [Trace; 3],
    bound: f64,
}

#[cfg(test)]
mod tests;
