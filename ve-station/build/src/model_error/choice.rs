//! The faces whose quarters get bounds: those of which a bound of their own tells the most.
//!
//! The bound of a face by its corners is that of the worst face at each of them. A contact may
//! touch any place, and the tolerance may be of any octave. So the gain of bounds of its own is the
//! area of a face, times the octaves by which they may be less, times the root of those of the dial
//! for which the face is as it is. (In proportion to these, faces of the base mesh take all room:
//! `rt-tests accuracy` has 7.8 for 5.1 on `terrain257` at 0.3 mm, 3.6 for 2.6 on fandisk at 0.1.)
//! Bounds take time to find: distances of four points stand for them. The faces with the greatest
//! gains get some, in rounds: a quarter of such a face is like a face, and may get bounds of its
//! own quarters in a later one.

use super::fronts::Fronts;
use super::full_surface::FullSurface;
use super::quarters::quarters_of;
use crate::history::{History, QuarterBounds};
use crate::tuning::quarters::{
    FACES_A_BOUND, FACES_A_TASK, GOOD, LARGE, LEFT, MAX_OCTAVES, ROUNDS,
};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::{ErrorScale, NONE, QuarteredFace};
use std::ops::Range;

/// A face of fronts {E > t}, or a part of it, that may get bounds of its quarters.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    /// Its number in the full mesh.
    face: u32,
    /// The first code of t for which its corners are others; `u16::MAX` in the base mesh.
    end: u16,
    part: u16,
    depth: u32,
    /// Where its corners are, counterclockwise, in the order of the file.
    corners: [DVec3; 3],
    /// The bound that it has without, model units.
    bound: f64,
    /// Area times the root of the codes of the dial for which it is as it is.
    weight: f64,
    /// What bounds of its own may tell: that times octaves.
    gain: f64,
}

/// A face of fronts {E > t} with a large weight.
#[derive(Debug, Clone, Copy)]
struct Large {
    face: u32,
    begin: u16,
    end: u16,
    corners: [u32; 3],
    weight: f64,
}

/// Bounds of the quarters of the faces of a history that get some, ascending. `rounding`: what
/// differences of coordinates lose, model units.
pub fn quarter_bounds(
    history: &History,
    full: &FullSurface<'_>,
    fronts: &Fronts,
    scale: ErrorScale,
    rounding: f64,
) -> Vec<QuarterBounds> {
    let choice = Choice {
        history,
        full,
        fronts,
        tolerances: tolerances(history, scale),
    };
    let most = (full.triangles().len() / FACES_A_BOUND).min(QuarteredFace::MAX as usize);
    let mut waiting = choice.candidates(LARGE * most);
    let mut found: Vec<QuarterBounds> = Vec::with_capacity(most);
    for round in 0..ROUNDS {
        let room = (most - found.len()) / (ROUNDS - round);
        let chosen = take(&mut waiting, room);
        let bounds = chosen.par_iter().map(|of| {
            let bounds = quarters_of(full, of.face, of.corners, of.bound, rounding);
            (of, bounds)
        });
        let says_more = |&(of, bounds): &(&Candidate, [f64; 4])| {
            let less = |&bound: &f64| bound.powi(2) * GOOD < of.bound.powi(2);
            bounds.iter().any(less)
        };
        let bounds: Vec<_> = bounds.filter(says_more).collect();
        let parts = bounds
            .par_iter()
            .filter(|(of, _)| of.depth + 1 < QuarteredFace::MAX_DEPTH);
        waiting.par_extend(parts.flat_map_iter(|&(of, bounds)| choice.parts(of, bounds)));
        found.extend(bounds.iter().map(|&(of, bounds)| QuarterBounds {
            face: of.face,
            end: of.end,
            part: of.part,
            bounds,
        }));
    }
    found
}

/// Takes the greatest gains out.
fn take(waiting: &mut Vec<Candidate>, most: usize) -> Vec<Candidate> {
    let key = |c: &Candidate| (c.face, c.end, c.part);
    let order = |a: &Candidate, b: &Candidate| {
        let by_gain = b.gain.total_cmp(&a.gain);
        by_gain.then_with(|| key(a).cmp(&key(b)))
    };
    waiting.retain(|candidate| candidate.gain > 0.0);
    let most = most.min(waiting.len());
    if (1..waiting.len()).contains(&most) {
        waiting.select_nth_unstable_by(most, order);
    }
    waiting.drain(..most).collect()
}

/// Keeps the largest weights.
fn keep(all: &mut Vec<Large>, most: usize) {
    if (1..all.len()).contains(&most) {
        all.select_nth_unstable_by(most, |a, b| {
            let by_weight = b.weight.total_cmp(&a.weight);
            by_weight.then_with(|| (a.face, a.end).cmp(&(b.face, b.end)))
        });
    }
    all.truncate(most);
}

/// Codes of the tolerances of the dial: from where one in [`LEFT`] of the splits is left to the
/// diagonal.
fn tolerances(history: &History, scale: ErrorScale) -> Range<u32> {
    let mut expected = history.expected.clone();
    let first = if expected.is_empty() {
        0
    } else {
        let place = expected.len() - 1 - expected.len() / LEFT;
        *expected.select_nth_unstable(place).1
    };
    u32::from(first)..u32::from(scale.encode(scale.diagonal()))
}

/// By face of the full mesh: its first corner in the front that the split which makes it leaves.
/// Its first one in any other front of the file descends from it.
fn first_corners(history: &History, faces: usize) -> Vec<u32> {
    let mut first = vec![NONE; faces];
    for left in &history.base {
        first[left.face as usize] = left.corners[0];
    }
    for collapse in &history.collapses {
        first[collapse.fl as usize] = collapse.vt;
        if collapse.fr != NONE {
            first[collapse.fr as usize] = collapse.vu;
        }
    }
    first
}

struct Choice<'a> {
    history: &'a History,
    full: &'a FullSurface<'a>,
    fronts: &'a Fronts,
    tolerances: Range<u32>,
}

impl Choice<'_> {
    /// The faces of the largest weights of which bounds of their own tell something.
    fn candidates(&self, most: usize) -> Vec<Candidate> {
        let triangles = self.full.triangles();
        let tasks = triangles.par_chunks(FACES_A_TASK).enumerate();
        let mut large: Vec<Large> = tasks
            .flat_map_iter(|(task, corners)| {
                let mut found = Vec::new();
                let first = (task * FACES_A_TASK) as u32;
                for (face, &corners) in (first..).zip(corners) {
                    self.add(face, corners, &mut found);
                }
                keep(&mut found, most);
                found
            })
            .collect();
        keep(&mut large, most);
        let first = first_corners(self.history, triangles.len());
        let candidate = |large: &Large| self.candidate(large, first[large.face as usize]);
        large
            .par_iter()
            .map(candidate)
            .filter(|of| of.gain > 0.0)
            .collect()
    }

    /// Adds what a face of the full mesh is in the fronts of the dial.
    fn add(&self, face: u32, corners: [u32; 3], found: &mut Vec<Large>) {
        self.fronts
            .for_each_corners(corners, |corners, begin, end| {
                let codes = begin.max(self.tolerances.start)..end.min(self.tolerances.end);
                let is_coarse = corners.iter().any(|&v| v >= self.history.full_vertices);
                if !codes.is_empty() && is_coarse {
                    let [a, b, c] = corners.map(|v| self.at(v));
                    found.push(Large {
                        face,
                        begin: begin as u16,
                        end: end.min(u16::MAX.into()) as u16,
                        corners,
                        weight: (b - a).cross(c - a).length() * (codes.len() as f64).sqrt(),
                    });
                }
            });
    }

    fn candidate(&self, of: &Large, first: u32) -> Candidate {
        let mut corners = of.corners;
        let place = corners.iter().position(|&v| self.fronts.descends(v, first));
        corners.rotate_left(place.unwrap_or(0));
        self.weighed(Candidate {
            face: of.face,
            end: of.end,
            part: 0,
            depth: 0,
            corners: corners.map(|v| self.at(v)),
            bound: self.bound(corners, of.begin),
            weight: of.weight,
            gain: 0.0,
        })
    }

    /// The quarters of a candidate that has got these bounds.
    fn parts(&self, of: &Candidate, bounds: [f64; 4]) -> impl Iterator<Item = Candidate> + use<'_> {
        let of = *of;
        (0..4).zip(quarters(of.corners)).map(move |(k, corners)| {
            self.weighed(Candidate {
                part: QuarteredFace::part_of(of.part, k),
                depth: of.depth + 1,
                corners,
                bound: bounds[k].min(of.bound),
                weight: of.weight / 4.0,
                ..of
            })
        })
    }

    /// A candidate with its gain: by the farthest of the middles of its quarters.
    fn weighed(&self, mut of: Candidate) -> Candidate {
        let mut far = (of.bound * (-MAX_OCTAVES).exp2()).powi(2);
        for [a, b, c] in quarters(of.corners) {
            let middle = (a + b + c) / 3.0;
            let found = self.full.nearest(middle, of.face, far);
            far = far.max(found.distance_squared);
        }
        let octaves = (of.bound.powi(2) / far).log2().max(0.0) / 2.0;
        of.gain = if octaves.is_finite() {
            of.weight * octaves
        } else {
            0.0
        };
        of
    }

    fn at(&self, vertex: u32) -> DVec3 {
        Vec3::from_array(self.history.positions[vertex as usize]).as_dvec3()
    }

    /// What the corners of a face say that begins at this code, model units.
    fn bound(&self, corners: [u32; 3], begin: u16) -> f64 {
        let history = self.history;
        let radius = |v: u32| {
            let made = v.checked_sub(history.full_vertices);
            made.map_or(0.0, |made| history.radius[made as usize])
        };
        let close = |v: u32| history.close[v as usize] * self.fronts.growth(v, begin);
        let radius = corners.map(radius).into_iter().fold(0.0, f64::max);
        corners.map(close).into_iter().fold(radius, f64::min)
    }
}

/// The quarters of a triangle, in the order of [`spm::QuarterCodes`].
pub fn quarters([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
    [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
}
