//! The faces whose quarters get bounds: those of which a bound of their own tells the most.
//!
//! The bound of a face by its corners is that of the worst face at each of them. A contact may
//! touch any place, and the tolerance may be of any octave. So the gain of bounds of its own is the
//! area of each quarter, times the octaves by which its bound is less, times the root of those of
//! the dial for which the face is as it is. (In proportion to these, with bounds that were found in
//! another manner, faces of the base mesh take all room: `rt-tests accuracy` has 7.8 for 5.1 on
//! `terrain257` at 0.3 mm, 3.6 for 2.6 on fandisk at 0.1.) The greatest gains get into the table,
//! one by one: a quarter of a face that got bounds is like a face, and may get bounds of its own
//! quarters.

use super::close::{LargeFace, PartBounds, Patches};
use crate::history::{History, QuarterBounds};
use crate::tuning::quarters::{DEPTH, FACES_A_BOUND, FACES_A_TASK, LARGE, LEFT, MAX_OCTAVES};
use geometry::portable::log2;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::{ErrorScale, NONE, QuarteredFace};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::ops::Range;

/// A face of fronts {E > t} whose quarters may get bounds.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// What its parts are found by.
    pub large: LargeFace,
    /// The first code of t for which its corners are others; `u16::MAX` in the base mesh.
    end: u16,
    /// Counterclockwise.
    corners: [u32; 3],
    /// Area times the root of the codes of the dial for which it is as it is.
    weight: f64,
}

/// A candidate with its bounds.
struct Bounded<'a> {
    face: u32,
    end: u16,
    /// The bound that it has without, model units.
    bound: f64,
    weight: f64,
    parts: &'a PartBounds,
}

/// A part of a candidate that may be cut in four.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Part {
    /// What that tells, as ordered bits.
    gain: u64,
    /// Of equal gains the first.
    key: Reverse<(u32, u16, u16)>,
    candidate: usize,
    depth: u32,
    /// Among the parts of this depth.
    place: usize,
}

/// The candidates of a history, ascending by face and code: those with the largest weights.
pub fn candidates(patches: &Patches<'_>, scale: ErrorScale) -> Vec<Candidate> {
    let triangles = patches.full().triangles();
    let choice = Choice {
        patches,
        tolerances: tolerances(patches.history(), scale),
        first_corners: first_corners(patches.history(), triangles.len()),
    };
    let most = LARGE * most_bounds(patches);
    let tasks = triangles.par_chunks(FACES_A_TASK).enumerate();
    let mut all: Vec<Candidate> = tasks
        .flat_map_iter(|(task, corners)| {
            let mut found = Vec::new();
            let first = (task * FACES_A_TASK) as u32;
            for (face, &corners) in (first..).zip(corners) {
                choice.add(face, corners, &mut found);
            }
            keep(&mut found, most);
            found
        })
        .collect();
    keep(&mut all, most);
    all.sort_unstable_by_key(|of| (of.large.face, of.large.begin));
    for of in &mut all {
        of.large.first = choice.first(of);
    }
    all
}

/// The most faces whose quarters get bounds.
fn most_bounds(patches: &Patches<'_>) -> usize {
    let faces = patches.full().triangles().len();
    (faces / FACES_A_BOUND).min(QuarteredFace::MAX as usize)
}

/// Bounds of the quarters of the candidates that get some, given C of all vertices and the bounds
/// of the candidates' parts. The same for any number of threads.
pub fn quarter_bounds(
    patches: &Patches<'_>,
    close: &[f64],
    candidates: &[Candidate],
    parts: &[Option<PartBounds>],
) -> Vec<QuarterBounds> {
    let most = most_bounds(patches);
    let bounded = candidates.iter().zip(parts).filter_map(|(of, parts)| {
        Some(Bounded {
            face: of.large.face,
            end: of.end,
            bound: bound(patches, close, of),
            weight: of.weight,
            parts: parts.as_ref()?,
        })
    });
    let candidates: Vec<Bounded<'_>> = bounded.collect();
    let whole = (0..candidates.len()).map(|of| part(&candidates, of, 0, 0));
    let mut waiting: BinaryHeap<Part> = whole.collect();
    let mut found = Vec::with_capacity(most);
    while found.len() < most
        && let Some(greatest) = waiting.pop().filter(|part| part.gain > 0)
    {
        let Part {
            candidate,
            depth,
            place,
            key: Reverse((face, end, part_number)),
            ..
        } = greatest;
        found.push(QuarterBounds {
            face,
            end,
            part: part_number,
            bounds: candidates[candidate].parts.quarters(depth, place),
        });
        if depth + 1 < DEPTH {
            let quarters = (0..4).map(|k| part(&candidates, candidate, depth + 1, 4 * place + k));
            waiting.extend(quarters);
        }
    }
    found
}

/// A part of a candidate with its gain.
fn part(candidates: &[Bounded<'_>], of: usize, depth: u32, place: usize) -> Part {
    let candidate = &candidates[of];
    let number = (0..depth).rev().fold(0, |number, level| {
        QuarteredFace::part_of(number, (place >> (2 * level)) % 4)
    });
    Part {
        gain: candidate.gain(depth, place).to_bits(),
        key: Reverse((candidate.face, candidate.end, number)),
        candidate: of,
        depth,
        place,
    }
}

impl Bounded<'_> {
    /// What bounds of the quarters of a part tell, when the parts that hold it have theirs.
    fn gain(&self, depth: u32, place: usize) -> f64 {
        let without = match depth {
            0 => self.bound,
            _ => self.parts.quarters(depth - 1, place / 4)[place % 4].min(self.bound),
        };
        let octaves = |bound: f64| log2(without / bound).clamp(0.0, MAX_OCTAVES);
        let quarters = self.parts.quarters(depth, place).map(octaves);
        self.weight * quarters.iter().sum::<f64>() / f64::from(1 << (2 * (depth + 1)))
    }
}

/// Keeps the largest weights.
fn keep(all: &mut Vec<Candidate>, most: usize) {
    if (1..all.len()).contains(&most) {
        all.select_nth_unstable_by(most, |a, b| {
            let by_weight = b.weight.total_cmp(&a.weight);
            by_weight.then_with(|| (a.large.face, a.end).cmp(&(b.large.face, b.end)))
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

/// What a face says without bounds of its own, by its corners, model units.
fn bound(patches: &Patches<'_>, close: &[f64], of: &Candidate) -> f64 {
    let growth = |v: u32| patches.fronts().growth(v, of.large.begin);
    let close = |v: u32| close[v as usize] * growth(v);
    let radius = patches.radius(of.corners);
    of.corners.map(close).into_iter().fold(radius, f64::min)
}

struct Choice<'a> {
    patches: &'a Patches<'a>,
    tolerances: Range<u32>,
    first_corners: Vec<u32>,
}

impl Choice<'_> {
    /// Adds what a face of the full mesh is in the fronts of the dial.
    fn add(&self, face: u32, corners: [u32; 3], found: &mut Vec<Candidate>) {
        let full_vertices = self.patches.history().full_vertices;
        let fronts = self.patches.fronts();
        fronts.for_each_corners(corners, |corners, begin, end| {
            let codes = begin.max(self.tolerances.start)..end.min(self.tolerances.end);
            let is_coarse = corners.iter().any(|&v| v >= full_vertices);
            if !codes.is_empty() && is_coarse {
                let [a, b, c] = corners.map(|v| self.at(v));
                found.push(Candidate {
                    large: LargeFace {
                        face,
                        begin: begin as u16,
                        first: 0,
                    },
                    end: end.min(u16::MAX.into()) as u16,
                    corners,
                    weight: (b - a).cross(c - a).length() * (codes.len() as f64).sqrt(),
                });
            }
        });
    }

    /// The place of the corner that comes first in the file.
    fn first(&self, of: &Candidate) -> usize {
        let first = self.first_corners[of.large.face as usize];
        let fronts = self.patches.fronts();
        let place = of.corners.iter().position(|&v| fronts.descends(v, first));
        place.unwrap_or(0)
    }

    fn at(&self, vertex: u32) -> DVec3 {
        Vec3::from_array(self.patches.history().positions[vertex as usize]).as_dvec3()
    }
}
