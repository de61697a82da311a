//! The trace of a coarse edge: a path over the full mesh from the foot of one end to that of the
//! other, the same for both faces at the edge.
//!
//! Any path will do for the bound; near ones make it small. Between two vertices it follows a plane
//! through both feet; between two vertices beside each other on a rim it follows the rim. On a
//! plane a vertex of the full mesh counts as above it or below, never as on it, so the path crosses
//! sides only, and rounding moves where it crosses them, not which. Where no plane leads there, it
//! is a detour.

use super::super::descendants::Descendants;
use super::super::full_surface::FullSurface;
use super::boundary::{Boundary, ends_of};
use super::foot::Foot;
use crate::tuning::close::{GOOD, MAX_STEPS};
use geometry::closest_point_on_segment;
use glam::DVec3;
use spm::NONE;

/// A side of the full mesh that a trace crosses: the ends left and right of the path.
pub type Crossing = (u32, u32);

/// Traces, one after the other.
#[derive(Debug, Default)]
pub struct Paths {
    /// The sides that they cross.
    pub crossings: Vec<Crossing>,
    /// Their corners, each with the face that holds the path to the next one; [`NONE`] at the last.
    pub corners: Vec<(DVec3, u32)>,
}

/// An end of a path.
type Mark = [usize; 2];

impl Paths {
    pub fn clear(&mut self) {
        self.truncate([0; 2]);
    }

    pub fn mark(&self) -> Mark {
        [self.crossings.len(), self.corners.len()]
    }

    fn truncate(&mut self, [crossings, corners]: Mark) {
        self.crossings.truncate(crossings);
        self.corners.truncate(corners);
    }

    fn drop_between(&mut self, first: Mark, last: Mark) {
        self.crossings.drain(first[0]..last[0]);
        self.corners.drain(first[1]..last[1]);
    }

    /// The path goes on from a corner through a face.
    pub fn go_on(&mut self, corner: DVec3, face: u32) {
        self.corners.push((corner, face));
    }

    pub fn arrive(&mut self, corner: DVec3) {
        self.corners.push((corner, NONE));
    }
}

/// What traces are made of.
pub struct Traces<'a> {
    pub full: &'a FullSurface<'a>,
    pub boundary: Boundary,
    pub descendants: &'a Descendants,
}

/// A coarse edge: ends, where they are, and their feet.
#[derive(Clone, Copy)]
pub struct Edge<'a> {
    pub ends: [u32; 2],
    pub at: [DVec3; 2],
    pub feet: [&'a Foot; 2],
}

impl Edge<'_> {
    /// The larger one of the distances of its feet, squared.
    pub fn foot_distance_squared(&self) -> f64 {
        let away = |k: usize| self.feet[k].point.distance_squared(self.at[k]);
        away(0).max(away(1))
    }

    /// How far a point is from it, squared.
    pub fn distance_squared(&self, point: DVec3) -> f64 {
        let [a, b] = self.at;
        (a + (b - a) * closest_point_on_segment(a, b, point)).distance_squared(point)
    }

    fn reversed(&self) -> Self {
        let mut reversed = *self;
        reversed.ends.reverse();
        reversed.at.reverse();
        reversed.feet.reverse();
        reversed
    }
}

/// A face on the path, and on which side of the plane its corners are.
#[derive(Clone, Copy)]
struct Step {
    face: u32,
    corners: [u32; 3],
    /// Distances in some measure.
    heights: [f64; 3],
}

impl Step {
    fn is_crossed(&self, side: usize) -> bool {
        (self.heights[(side + 1) % 3] < 0.0) != (self.heights[(side + 2) % 3] < 0.0)
    }
}

impl Traces<'_> {
    /// Traces an edge: adds the path and returns its largest squared distance from the edge.
    /// `None`, and nothing added, when it does not arrive, or strays farther than `limit`, squared.
    pub fn trace(&self, edge: &Edge<'_>, limit: f64, out: &mut Paths) -> Option<f64> {
        let first = out.mark();
        let found = self.any_trace(edge, limit, out);
        if found.is_none() {
            out.truncate(first);
        }
        found
    }

    fn any_trace(&self, edge: &Edge<'_>, limit: f64, out: &mut Paths) -> Option<f64> {
        let [from, to] = edge.feet;
        if from.side != NONE && to.side != NONE {
            return self.along_boundary(edge, out);
        }
        let normal = |foot: &Foot| {
            let [a, b, c] = self.full.corners(foot.face);
            (b - a).cross(c - a).normalize_or_zero()
        };
        // In folds, what is up over all descendants may be along the edge; at creases the side that
        // is farther along may lead the long way round.
        let ups = [from.up + to.up, normal(from) + normal(to)];
        let first = out.mark();
        let mut best: Option<f64> = None;
        let mut kept = first;
        for (up, start) in ups.into_iter().flat_map(|up| [(up, 0), (up, 1)]) {
            // No farther than the best one either: it would be dropped.
            let nearer = best.unwrap_or(limit);
            let found = self.follow(edge, (up, start), nearer, out);
            match found.filter(|&most| best.is_none_or(|best| most < best)) {
                Some(most) => {
                    out.drop_between(first, kept);
                    kept = out.mark();
                    best = Some(most);
                    if most <= limit * GOOD {
                        break;
                    }
                }
                None => out.truncate(kept),
            }
        }
        best.or_else(|| self.detour(edge, limit, out))
    }

    /// Faces that the trace of an edge may take.
    pub fn most_steps(&self, edge: &Edge<'_>) -> usize {
        let descendants = edge.ends.map(|end| self.descendants.count(end) as usize);
        MAX_STEPS.0 + MAX_STEPS.1 * (descendants[0] + descendants[1])
    }

    fn follow(
        &self,
        edge: &Edge<'_>,
        (up, start): (DVec3, usize),
        limit: f64,
        out: &mut Paths,
    ) -> Option<f64> {
        let [from, to] = edge.feet;
        let mut most = edge.foot_distance_squared();
        out.go_on(from.point, from.face);
        if from.face == to.face {
            out.arrive(to.point);
            return Some(most);
        }
        let along = to.point - from.point;
        let across = along.cross(up);
        let height = |vertex: u32| across.dot(self.full.position(vertex) - from.point);
        let corners = self.full.triangles()[from.face as usize];
        let mut step = Step {
            face: from.face,
            corners,
            heights: corners.map(height),
        };
        let mut side = self.first_side(&step, along, start)?;
        for _ in 0..self.most_steps(edge) {
            let at = self.crossing_point(&step, side);
            let away = edge.distance_squared(at);
            if away > limit || away.is_nan() {
                return None;
            }
            most = most.max(away);
            let (i, j) = ((side + 1) % 3, (side + 2) % 3);
            let (u, v) = (step.corners[i], step.corners[j]);
            // It leaves the face, so what the side leads to is on its left.
            out.crossings.push((v, u));
            let known = [(u, step.heights[i]), (v, step.heights[j])];
            step.face = self.full.neighbours()[step.face as usize][side];
            out.go_on(at, step.face);
            if step.face == to.face {
                out.arrive(to.point);
                return Some(most);
            }
            // A rim, or once round.
            if step.face == NONE || step.face == from.face {
                return None;
            }
            step.corners = self.full.triangles()[step.face as usize];
            let mut across_it = 0;
            for k in 0..3 {
                let corner = step.corners[k];
                step.heights[k] = match known.iter().find(|(vertex, _)| *vertex == corner) {
                    Some((_, height)) => *height,
                    None => {
                        across_it = k;
                        height(corner)
                    }
                };
            }
            side = (across_it + 1) % 3;
            if !step.is_crossed(side) {
                side = (across_it + 2) % 3;
            }
        }
        None
    }

    /// Of the two sides that are crossed the one that is farther along, or the other.
    fn first_side(&self, step: &Step, along: DVec3, start: usize) -> Option<usize> {
        let ahead = |side: usize| along.dot(self.crossing_point(step, side));
        let crossed = (0..3).filter(|&side| step.is_crossed(side));
        let order = |a: &usize, b: &usize| ahead(*a).total_cmp(&ahead(*b));
        match start {
            0 => crossed.max_by(order),
            _ => crossed.min_by(order),
        }
    }

    /// Where the plane crosses a side.
    fn crossing_point(&self, step: &Step, side: usize) -> DVec3 {
        let (i, j) = ((side + 1) % 3, (side + 2) % 3);
        let [a, b] = [i, j].map(|k| self.full.position(step.corners[k]));
        let (from, to) = (step.heights[i], step.heights[j]);
        a + (b - a) * (from / (from - to))
    }

    /// Follows the rim, over descendants of both ends alone: no other path leaves nothing of the
    /// full mesh beyond it.
    fn along_boundary(&self, edge: &Edge<'_>, out: &mut Paths) -> Option<f64> {
        let first = out.mark();
        if let Some(most) = self.forward_along_boundary(edge, out) {
            return Some(most);
        }
        out.truncate(first);
        let most = self.forward_along_boundary(&edge.reversed(), out)?;
        for crossing in &mut out.crossings[first[0]..] {
            *crossing = (crossing.1, crossing.0);
        }
        Some(most)
    }

    fn forward_along_boundary(&self, edge: &Edge<'_>, out: &mut Paths) -> Option<f64> {
        let [from, to] = edge.feet;
        let mut most = 0.0_f64;
        for (foot, at) in edge.feet.into_iter().zip(edge.at) {
            most = most.max(foot.point.distance_squared(at));
            most = most.max(foot.on_boundary.distance_squared(at));
        }
        out.go_on(from.point, from.face);
        out.go_on(from.on_boundary, from.face);
        if from.side == to.side {
            out.go_on(to.on_boundary, to.face);
            out.arrive(to.point);
            return Some(most);
        }
        // It leaves the mesh across one side and comes back across the other.
        let [start, end] = ends_of(self.full, from.side);
        out.crossings.push((end, start));
        let mut vertex = end;
        loop {
            let is_own = |&end: &u32| self.descendants.descends(vertex, end);
            if !edge.ends.iter().any(is_own) {
                return None;
            }
            let at = self.full.position(vertex);
            most = most.max(edge.distance_squared(at));
            let side = self.boundary.started_by(vertex);
            let [start, end] = ends_of(self.full, side);
            out.go_on(at, side / 3);
            if side == to.side {
                out.crossings.push((start, end));
                out.go_on(to.on_boundary, to.face);
                out.arrive(to.point);
                return Some(most);
            }
            // Once round.
            if side == from.side {
                return None;
            }
            vertex = end;
        }
    }
}
