//! Closest points of segments, and of a segment and a triangle; f64, no epsilon, any scale.

use super::exact_contact::contact_of_segment;
use super::predicates::{side_of_plane, triangle_is_degenerate};
use super::triangle::{closest_point_on_segment, closest_point_on_triangle};
use glam::DVec3;
use std::cmp::Ordering;

/// The closest points of two figures; both lie on their figure within rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPair {
    /// A point of the first figure and one of the second.
    pub points: [DVec3; 2],
    /// Their squared distance; exactly 0 where two triangles, or a segment and a triangle, share a
    /// point.
    pub distance_squared: f64,
}

impl ClosestPair {
    /// No points, infinitely far apart: any pair is nearer.
    pub const NONE: Self = Self {
        points: [DVec3::ZERO; 2],
        distance_squared: f64::INFINITY,
    };

    #[inline]
    pub(super) fn between(on_first: DVec3, on_second: DVec3) -> Self {
        Self {
            points: [on_first, on_second],
            distance_squared: on_first.distance_squared(on_second),
        }
    }

    /// One point that both share.
    pub(super) fn shared(point: DVec3) -> Self {
        Self {
            points: [point; 2],
            distance_squared: 0.0,
        }
    }

    /// The same with the figures exchanged.
    #[must_use]
    pub fn swapped(self) -> Self {
        let [first, second] = self.points;
        Self {
            points: [second, first],
            ..self
        }
    }

    #[inline]
    pub(super) fn keep_nearer(&mut self, other: Self) {
        if other.distance_squared < self.distance_squared {
            *self = other;
        }
    }
}

/// The point of a segment closest to another.
#[inline]
pub(super) fn foot([a, b]: [DVec3; 2], point: DVec3) -> DVec3 {
    a.lerp(b, closest_point_on_segment(a, b, point))
}

/// The closest points of the lines of two segments, if they are inside both segments; otherwise an
/// end of one of them is closest.
///
/// Differences of dot products would cancel on near-parallel segments, so these are cross products.
/// There the position along the segments still has an error of rounding over the angle; the foot on
/// the other segment corrects the distance.
#[inline]
pub(super) fn closest_inner_points(p: [DVec3; 2], q: [DVec3; 2]) -> Option<ClosestPair> {
    let (u, v, between) = (p[1] - p[0], q[1] - q[0], q[0] - p[0]);
    let normal = u.cross(v);
    let square = normal.length_squared();
    let (s, t) = (between.cross(v).dot(normal), between.cross(u).dot(normal));
    if !(square > 0.0 && s > 0.0 && s < square && t > 0.0 && t < square) {
        return None;
    }
    let on_p = p[0] + u * (s / square);
    Some(ClosestPair::between(on_p, foot(q, on_p)))
}

/// The closest points of two segments: inner points, or an end and its foot.
#[must_use]
pub fn closest_points_of_segments(p: [DVec3; 2], q: [DVec3; 2]) -> ClosestPair {
    let mut best = closest_inner_points(p, q).unwrap_or(ClosestPair::NONE);
    for k in 0..2 {
        best.keep_nearer(ClosestPair::between(p[k], foot(q, p[k])));
        best.keep_nearer(ClosestPair::between(foot(p, q[k]), q[k]));
    }
    best
}

/// The closest points of a segment and a triangle; distance 0 exactly where they share a point.
#[must_use]
pub fn closest_points_of_segment_and_triangle(
    segment: [DVec3; 2],
    triangle: [DVec3; 3],
) -> ClosestPair {
    if let Some(at) = piercing_point(segment, triangle) {
        return ClosestPair::shared(at);
    }
    // An end and the triangle, a corner and the segment, or inner points of the segment and an
    // edge.
    let mut best = ClosestPair::NONE;
    for end in segment {
        let closest = closest_point_on_triangle(triangle, end);
        best.keep_nearer(ClosestPair::between(end, closest.point));
    }
    for k in 0..3 {
        let edge = [triangle[k], triangle[(k + 1) % 3]];
        best.keep_nearer(ClosestPair::between(foot(segment, edge[0]), edge[0]));
        if let Some(inner) = closest_inner_points(segment, edge) {
            best.keep_nearer(inner);
        }
    }
    best
}

/// A point that a segment shares with a triangle, by exact signs; `None` for triangles without
/// area, whose edges decide.
fn piercing_point([p, q]: [DVec3; 2], t: [DVec3; 3]) -> Option<DVec3> {
    let side = |x: DVec3| side_of_plane(t[0], t[1], t[2], x);
    let (of_p, of_q) = (side(p), side(q));
    if of_p == of_q && of_p != Ordering::Equal {
        return None;
    }
    let finite = p.is_finite() && q.is_finite() && t.iter().all(|c| c.is_finite());
    if !finite || triangle_is_degenerate(t[0], t[1], t[2]) {
        return None;
    }
    // Where the segment is almost in the plane, its position on the line is inaccurate; the
    // projection puts it on the triangle.
    contact_of_segment(p, q, t)
        .map(|[from, to]| closest_point_on_triangle(t, 0.5 * (from + to)).point)
}

#[cfg(test)]
#[path = "segment_tests.rs"]
mod tests;
