//! E: the expected error of a VSP, sampled when its edge collapses.
//!
//! Let P be the faces round the vertex that the collapse makes, and L(P) the vertices of the full
//! mesh that hang on them. Then (facts, progressive meshes 5: the formula that calibrated best)
//!
//! own(i) = max( max over samples p of P of dist(p, full mesh), max over v in L(P) of dist(v, P) ).
//!
//! Samples are the vertex and a barycentric grid on each face, finer where more vertices hang.
//! Every vertex hangs on one face: a collapse pools those of the faces that it changes or removes,
//! and each goes to the nearest of the new ones.
//!
//! It is rounded up by a sixteenth of an octave at most (see [`ErrorScale::encode_expected`]).
//!
//! E(i) is the largest own of i and of everything that depends on i, so that {E > t} is a front for
//! every t. What depends on VSP i collapsed before it: its E is known already and waits at the
//! faces and vertices that i needs. A sample only matters if it is beyond that, so most end at the
//! first triangle looked at.
//!
//! Collapses of a round share no face: they are sampled in parallel, each by itself, so the result
//! is the same bits for any number of threads. (Lists are kept in atomics for that, without any
//! order among them.)
//!
//! Memory: 6 B a face, 6 B a vertex, and the full surface.

use super::full_surface::FullSurface;
use super::triangle::Triangle;
use crate::history::{Collapse, FanFace, MAX_FACES_ROUND_A_VERTEX, Round};
use crate::tuning::error::STEPS;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::{ErrorScale, NONE};
use std::sync::atomic::{AtomicU16, AtomicU32, Ordering::Relaxed};

/// Expected errors of the collapses so far.
pub struct ExpectedErrors<'a> {
    full: FullSurface<'a>,
    scale: ErrorScale,
    /// By face: a vertex that hangs on it.
    first: Vec<AtomicU32>,
    /// By vertex: the next one that hangs on the same face.
    next: Vec<AtomicU32>,
    /// By face: the largest E of the collapses that remove a face next to it.
    adjacent: Vec<AtomicU16>,
    /// E of each collapse.
    codes: Vec<u16>,
}

/// The faces round the vertex that a collapse makes.
#[derive(Default)]
struct Patch {
    faces: Vec<Triangle>,
}

impl Patch {
    /// The face nearest to a point, and the squared distance; that of one face is known.
    fn nearest(&self, point: DVec3, known: Option<(usize, f64)>) -> (usize, f64) {
        let mut best = (0, f64::INFINITY);
        for (k, face) in self.faces.iter().enumerate() {
            let squared = match known {
                Some((place, squared)) if place == k => squared,
                _ => face.distance(point).squared,
            };
            if squared < best.1 {
                best = (k, squared);
            }
        }
        best
    }
}

impl<'a> ExpectedErrors<'a> {
    /// Before the first collapse. Faces must be in AB-tree order; `neighbours` are those across the
    /// edges opposite their corners, [`NONE`] at boundaries.
    pub fn new(
        positions: &'a [[f32; 3]],
        triangles: &'a [[u32; 3]],
        neighbours: Vec<[u32; 3]>,
        scale: ErrorScale,
    ) -> Self {
        let mut first = vec![NONE; triangles.len()];
        let mut next = vec![NONE; positions.len()];
        let mut hangs = vec![false; positions.len()];
        for (face, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                if !std::mem::replace(&mut hangs[vertex as usize], true) {
                    next[vertex as usize] = std::mem::replace(&mut first[face], vertex);
                }
            }
        }
        Self {
            full: FullSurface::new(positions, triangles, neighbours),
            scale,
            first: first.into_iter().map(AtomicU32::new).collect(),
            next: next.into_iter().map(AtomicU32::new).collect(),
            adjacent: triangles.iter().map(|_| AtomicU16::new(0)).collect(),
            codes: Vec::new(),
        }
    }

    /// Samples the collapses of a round; rounds come in the order in which they were done.
    pub fn sample(&mut self, round: &Round) {
        let made = round.made.par_iter();
        let codes: Vec<u16> = made
            .map_init(Patch::default, |patch, made| {
                self.sample_collapse(&made.collapse, made.point, (round.fan(made), patch))
            })
            .collect();
        self.codes.extend(codes);
    }

    /// Codes of E, in the order of the collapses, and the full surface.
    pub fn finish(self) -> (Vec<u16>, FullSurface<'a>) {
        (self.codes, self.full)
    }

    fn sample_collapse(
        &self,
        collapse: &Collapse,
        point: [f32; 3],
        (fan, patch): (&[FanFace], &mut Patch),
    ) -> u16 {
        patch.faces.clear();
        patch.faces.extend(fan.iter().map(|face| {
            let corners = [point, face.from, face.to];
            Triangle::new(corners.map(|at| Vec3::from_array(at).as_dvec3()))
        }));

        let made = |vertex: u32| {
            let made = (vertex as usize).checked_sub(self.next.len());
            made.map_or(0, |made| self.codes[made])
        };
        let removed = [collapse.fl, collapse.fr]
            .into_iter()
            .filter(|&f| f != NONE);
        let known = removed
            .clone()
            .map(|face| self.adjacent[face as usize].load(Relaxed))
            .fold(made(collapse.vt).max(made(collapse.vu)), u16::max);
        let known_squared = self.scale.decode(known).powi(2);

        let mut most = known_squared;
        let hanging = self.deal(patch, fan, removed, &mut most);
        self.sample_grids(patch, fan, hanging, &mut most);
        let code = if most > known_squared {
            known.max(self.scale.encode_expected(most.sqrt()))
        } else {
            known
        };
        for face in collapse.fn_.into_iter().filter(|&f| f != NONE) {
            let adjacent = &self.adjacent[face as usize];
            adjacent.store(code.max(adjacent.load(Relaxed)), Relaxed);
        }
        code
    }

    /// Hangs the vertices of the faces of the patch and of the removed ones on the nearest faces of
    /// the patch; raises `most` to the largest squared distance. Returns their number.
    fn deal(
        &self,
        patch: &Patch,
        fan: &[FanFace],
        removed: impl Iterator<Item = u32>,
        most: &mut f64,
    ) -> u32 {
        let mut heads = [NONE; MAX_FACES_ROUND_A_VERTEX];
        let mut count = 0;
        let kept = fan.iter().enumerate().map(|(k, face)| (Some(k), face.face));
        for (before, face) in kept.chain(removed.map(|face| (None, face))) {
            let mut vertex = self.first[face as usize].load(Relaxed);
            while vertex != NONE {
                let point = self.full.position(vertex);
                let known = before.map(|k| (k, patch.faces[k].distance(point)));
                // On its face, or right above it and nearer than what counts: no other needs a
                // look.
                let stays = known.filter(|(_, found)| {
                    found.squared == 0.0 || (found.is_above() && found.squared <= *most)
                });
                let place = stays.map(|(k, _)| k).unwrap_or_else(|| {
                    let known = known.map(|(k, found)| (k, found.squared));
                    let (place, distance_squared) = patch.nearest(point, known);
                    *most = most.max(distance_squared);
                    place
                });
                let following = self.next[vertex as usize].load(Relaxed);
                self.next[vertex as usize].store(heads[place], Relaxed);
                heads[place] = vertex;
                vertex = following;
                count += 1;
            }
        }
        for (face, head) in fan.iter().zip(heads) {
            self.first[face.face as usize].store(head, Relaxed);
        }
        count
    }

    /// Raises `most` to the largest squared distance from a sample of the patch to the full mesh.
    fn sample_grids(&self, patch: &Patch, fan: &[FanFace], hanging: u32, most: &mut f64) {
        let total: f64 = patch.faces.iter().map(Triangle::twice_area).sum();
        let (least, greatest, each) = STEPS;
        let mut at_point = fan[0].face;
        let mut look = |point: DVec3, hint: u32| {
            let found = self.full.nearest(point, hint, *most);
            *most = most.max(found.distance_squared);
            found.face
        };
        at_point = look(patch.faces[0].first(), at_point);
        for (triangle, face) in patch.faces.iter().zip(fan) {
            let share = f64::from(hanging) * triangle.twice_area() / total;
            let steps = (each * share.sqrt()).ceil().clamp(least, greatest);
            let [along, across] = triangle.sides().map(|side| side / steps);
            let steps = steps as u32;
            let mut row_hint = at_point;
            // Rows away from the vertex; the last one is the outer boundary of the patch, which did
            // not move.
            for row in 1..steps {
                let start = triangle.first() + along * f64::from(row);
                row_hint = look(start, row_hint);
                let mut hint = row_hint;
                // The spoke that the row ends at is where the next face starts, unless there is
                // none.
                let end = if face.is_last { row + 1 } else { row };
                for column in 1..end {
                    hint = look(start + across * f64::from(column), hint);
                }
            }
        }
    }
}
