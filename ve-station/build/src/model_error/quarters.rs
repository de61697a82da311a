//! The quarters of faces of fronts {E > t}: how far their points are from the full mesh.
//!
//! The distance from one face of the full mesh is a convex function, so over a piece of a face it
//! is largest at a corner of the piece, and bounds the distance from the full mesh all over the
//! piece. A quarter begins as one piece. While the largest bound is far above what is found at
//! points, its piece is cut: along the outline of the face that is nearest to its middle, whose
//! bound is close to the distance inside, and where that does not cut it, in half. Wherever it
//! ends, the pieces cover the quarter, and their largest bound is one of the quarter.

use super::choice::quarters;
use super::full_surface::FullSurface;
use crate::tuning::quarters::{GOOD, MIN_CUT, PIECES};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use spm::NONE;
use std::collections::BinaryHeap;

/// Bounds of the quarters of a triangle near a face of the full mesh, model units; where one is not
/// below `useless` it may be any. `rounding`: what differences of coordinates lose.
pub fn quarters_of(
    full: &FullSurface<'_>,
    face: u32,
    corners: [DVec3; 3],
    useless: f64,
    rounding: f64,
) -> [f64; 4] {
    let [a, b, c] = corners;
    let cover = Cover {
        full,
        normal: (b - a).cross(c - a).normalize_or_zero(),
        // A bound is hardly less than what is found beyond this.
        useless: useless.powi(2) / GOOD,
        rounding,
    };
    quarters(corners).map(|corners| cover.bound(corners, face))
}

/// The search for the bound of a quarter.
struct Cover<'a> {
    full: &'a FullSurface<'a>,
    /// Of the face.
    normal: DVec3,
    /// What is found where the bound says nothing, squared.
    useless: f64,
    rounding: f64,
}

/// A convex piece of a quarter.
#[derive(Debug, Clone, Copy)]
struct Piece {
    corners: [DVec3; Self::MAX_CORNERS],
    count: usize,
    /// A bound of the distance from the full mesh, squared.
    bound: f64,
    /// A face of the full mesh near to it.
    face: u32,
    /// Whether that is the one that is nearest to its middle.
    is_looked_at: bool,
}

impl Piece {
    const MAX_CORNERS: usize = 8;

    fn new(corners: &[DVec3]) -> Self {
        let mut all = [DVec3::ZERO; Self::MAX_CORNERS];
        all[..corners.len()].copy_from_slice(corners);
        Self {
            corners: all,
            count: corners.len(),
            bound: f64::INFINITY,
            face: NONE,
            is_looked_at: false,
        }
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn middle(&self) -> DVec3 {
        self.corners().iter().sum::<DVec3>() / self.count as f64
    }

    /// The parts on both sides of a line: where a linear function is positive, and where it is
    /// negative. What has hardly anything on one side is not cut, so that no search goes on along
    /// a line that it cut already.
    fn cut(&self, height: impl Fn(DVec3) -> f64) -> [Option<Self>; 2] {
        let mut heights = [0.0; Self::MAX_CORNERS];
        for (found, corner) in heights.iter_mut().zip(self.corners()) {
            *found = height(*corner);
        }
        let of = |sign: f64| {
            let mut part = Self { count: 0, ..*self };
            for k in 0..self.count {
                let next = (k + 1) % self.count;
                let (from, to) = (sign * heights[k], sign * heights[next]);
                if from >= 0.0 {
                    part.push(self.corners[k])?;
                }
                if (from < 0.0 && to > 0.0) || (from > 0.0 && to < 0.0) {
                    let share = from / (from - to);
                    let edge = self.corners[next] - self.corners[k];
                    part.push(self.corners[k] + edge * share)?;
                }
            }
            Some(part)
        };
        let heights_of = || heights[..self.count].iter();
        let most = heights_of().fold(0.0_f64, |most, h| most.max(h.abs()));
        let is_on = |sign: f64| heights_of().any(|h| sign * h > most * MIN_CUT);
        if !is_on(-1.0) {
            return [Some(*self), None];
        }
        if !is_on(1.0) {
            return [None, Some(*self)];
        }
        match [of(1.0), of(-1.0)] {
            [Some(inside), Some(outside)] => [Some(inside), Some(outside)],
            // Too many corners. Any part may stand for a piece: its bound is its own.
            _ => [None, Some(*self)],
        }
    }

    fn push(&mut self, corner: DVec3) -> Option<()> {
        *self.corners.get_mut(self.count)? = corner;
        self.count += 1;
        Some(())
    }

    /// Two parts of about half its size.
    fn halves(&self) -> [Option<Self>; 2] {
        let middle = self.middle();
        let from_middle = self.corners().iter().map(|&corner| corner - middle);
        let along = from_middle.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()));
        let along = along.unwrap_or(DVec3::ZERO);
        self.cut(|corner| along.dot(corner - middle))
    }
}

/// A piece that waits, by the bits of its bound, which are in the order of the bounds.
type Waiting = (u64, usize);

impl Cover<'_> {
    fn bound(&self, corners: [DVec3; 3], face: u32) -> f64 {
        let mut found = 0.0;
        let first = self.bounded(Piece::new(&corners), face);
        let mut waiting = BinaryHeap::<Waiting>::from([(first.bound.to_bits(), 0)]);
        let mut pieces = vec![first];
        for _ in 0..PIECES {
            let Some((_, place)) = waiting.pop() else {
                break;
            };
            let largest = &mut pieces[place];
            if largest.bound <= f64::max(found * GOOD, self.rounding.powi(2))
                || found >= self.useless
            {
                waiting.push((largest.bound.to_bits(), place));
                break;
            }
            if !largest.is_looked_at {
                // Most pieces are not the largest ones ever: what bounds those beside them will do.
                let nearest = self.full.nearest(largest.middle(), largest.face, found);
                found = found.max(nearest.distance_squared);
                *largest = self.bounded(*largest, nearest.face);
                largest.is_looked_at = true;
                waiting.push((largest.bound.to_bits(), place));
                continue;
            }
            let cut = *largest;
            self.cut(&cut, |part, face| {
                let part = self.bounded(part, face);
                waiting.push((part.bound.to_bits(), pieces.len()));
                pieces.push(part);
            });
        }
        let most = waiting
            .peek()
            .map_or(f64::INFINITY, |&(bits, _)| f64::from_bits(bits));
        // Squares and the root are rounded too, and what is cut moves by as much as coordinates.
        most.sqrt() * (1.0 + 8.0 * f64::EPSILON) + self.rounding
    }

    /// A piece with its bound by a face of the full mesh.
    fn bounded(&self, mut piece: Piece, face: u32) -> Piece {
        let corners = self.full.corners(face);
        let away = |&corner: &DVec3| closest_point_on_triangle(corners, corner).distance_squared;
        // What is no number bounds nothing.
        let farther = |most: f64, away: f64| if away <= most { most } else { away };
        let farthest = piece.corners().iter().map(away).fold(0.0, farther);
        piece.face = face;
        piece.bound = piece.bound.min(farthest);
        piece.is_looked_at = false;
        piece
    }

    /// Cuts a piece, at the outline of its face seen along the normal of the coarse one.
    fn cut(&self, piece: &Piece, mut each: impl FnMut(Piece, u32)) {
        let corners = self.full.corners(piece.face);
        let mut rest = Some(*piece);
        let mut outside = [None; 3];
        for k in 0..3 {
            let Some(part) = rest else { break };
            let [from, to, opposite] = [1, 2, 0].map(|j| corners[(k + j) % 3]);
            let across = (to - from).cross(self.normal);
            let inwards = across * across.dot(opposite - from).signum();
            [rest, outside[k]] = part.cut(|corner| inwards.dot(corner - from));
        }
        let is_cut = outside.iter().chain([&rest]).flatten().count() > 1;
        if !is_cut {
            let halves = piece.halves().into_iter().flatten();
            halves.for_each(|half| each(half, piece.face));
            return;
        }
        if let Some(inside) = rest {
            each(inside, piece.face);
        }
        let across = self.full.neighbours()[piece.face as usize];
        for (part, next) in outside.into_iter().zip(across) {
            let hint = if next == NONE { piece.face } else { next };
            if let Some(part) = part {
                each(part, hint);
            }
        }
    }
}
