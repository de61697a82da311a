//! The quarters of base faces: how far their points are from the full mesh.
//!
//! The distance from one face of the full mesh is a convex function, so over a piece of a base face
//! it is largest at a corner of the piece, and bounds the distance from the full mesh all over the
//! piece. A quarter begins as one piece. While the largest bound is far above what is found at
//! points, its piece is cut: along the outline of the face that is nearest to its middle, whose
//! bound is close to the distance inside, and where that does not cut it, in half. Wherever it
//! ends, the pieces cover the quarter, and their largest bound is one of the quarter.

use super::full_surface::FullSurface;
use crate::history::{History, LeftFace};
use crate::tuning::quarters::{GOOD, MIN_CUT, PIECES};
use geometry::closest_point_on_triangle;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::NONE;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Bounds of the quarters of each base face, model units: those at its corners, and the one between
/// them. `rounding`: what differences of coordinates lose.
pub fn quarter_bounds(history: &History, full: &FullSurface<'_>, rounding: f64) -> Vec<[f64; 4]> {
    let base = history.base.par_iter();
    base.map(|face| of_face(history, full, face, rounding))
        .collect()
}

fn of_face(history: &History, full: &FullSurface<'_>, face: &LeftFace, rounding: f64) -> [f64; 4] {
    let at = |v: u32| Vec3::from_array(history.positions[v as usize]).as_dvec3();
    let [a, b, c] = face.corners.map(at);
    if face.corners.iter().all(|&v| v < history.full_vertices) {
        return [0.0; 4];
    }
    let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
    let quarters = [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]];
    let cover = Cover {
        full,
        normal: (b - a).cross(c - a).normalize_or_zero(),
        rounding,
    };
    quarters.map(|corners| cover.bound(corners, face.face))
}

/// The search for the bound of a quarter.
struct Cover<'a> {
    full: &'a FullSurface<'a>,
    /// Of the base face.
    normal: DVec3,
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
    const MAX_CORNERS: usize = 12;

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

impl PartialEq for Piece {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Piece {}

impl PartialOrd for Piece {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Piece {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

impl Cover<'_> {
    fn bound(&self, corners: [DVec3; 3], face: u32) -> f64 {
        let mut found = 0.0;
        let mut waiting = BinaryHeap::from([self.bounded(Piece::new(&corners), face)]);
        for _ in 0..PIECES {
            let Some(mut largest) = waiting.pop() else {
                break;
            };
            if !largest.is_looked_at {
                // Most pieces are not the largest ones ever: what bounds those beside them will do.
                let nearest = self.full.nearest(largest.middle(), largest.face, found);
                found = found.max(nearest.distance_squared);
                largest = self.bounded(largest, nearest.face);
                largest.is_looked_at = true;
                waiting.push(largest);
                continue;
            }
            if largest.bound <= f64::max(found * GOOD, self.rounding * self.rounding) {
                waiting.push(largest);
                break;
            }
            self.cut(&largest, |part, face| {
                waiting.push(self.bounded(part, face))
            });
        }
        let most = waiting.peek().map_or(f64::INFINITY, |piece| piece.bound);
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

    /// Cuts a piece, at the outline of its face seen along the normal of the base face.
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

#[cfg(test)]
mod tests {
    use crate::generate::{Shape, generate};
    use crate::{BuildOptions, NoProgress, build_model};
    use geometry::closest_point_on_triangle;
    use glam::{DVec3, Vec3};
    use spm::{ErrorScale, SpmParts};

    /// Steps of the grid of points on each face, even.
    const STEPS: u32 = 12;

    fn full_mesh(parts: &SpmParts) -> Vec<[DVec3; 3]> {
        let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3();
        parts.full_faces.iter().map(|f| f.corners.map(at)).collect()
    }

    fn distance(full: &[[DVec3; 3]], point: DVec3) -> f64 {
        let squared = |&face: &[DVec3; 3]| closest_point_on_triangle(face, point).distance_squared;
        let least = full.iter().map(squared).fold(f64::INFINITY, f64::min);
        least.sqrt()
    }

    #[test]
    fn no_point_of_a_quarter_is_beyond_its_bound_and_some_are_near_it() {
        for shape in [Shape::Relief, Shape::Torus, Shape::Terrain, Shape::Wedge] {
            let options = BuildOptions {
                base_faces: Some(40),
                regions: Some(4),
            };
            let parts = build_model(generate(shape, 1200, 3), &options, &NoProgress).unwrap();
            let scale = ErrorScale::for_diagonal(parts.header.diagonal);
            let rounding = 1e-13 * parts.header.diagonal;
            let full = full_mesh(&parts);
            let (mut coarse, mut near) = (0, 0);
            for face in &parts.base_faces {
                let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3();
                let [a, b, c] = face.corners.map(at);
                let quarters = face.quarters.decode(scale);
                let mut most: f64 = 0.0;
                for i in 0..=STEPS {
                    for j in 0..=STEPS - i {
                        let [s, t] = [i, j].map(|k| f64::from(k) / f64::from(STEPS));
                        let weights = [1.0 - s - t, s, t];
                        let point = a * weights[0] + b * s + c * t;
                        let bound = f64::from(quarters.at(weights));
                        let found = distance(&full, point);
                        assert!(found <= bound + rounding, "{shape}: {found} beyond {bound}");
                        most = most.max((found + rounding) / bound);
                    }
                }
                coarse += 1;
                near += u32::from(most > 0.8);
            }
            assert!(2 * near > coarse, "{shape}: {near} of {coarse} are near");
        }
    }
}
