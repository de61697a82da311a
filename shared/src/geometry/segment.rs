//! Closest points of segments, and of a segment and a triangle; f64, no epsilon, any scale.

use super::exact_contact::contact_of_segment;
use super::predicates::triangle_is_degenerate;
use super::triangle::{closest_point_on_segment, closest_point_on_triangle};
use glam::DVec3;

/// The closest points of two figures; both lie on their figure within rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPair {
    /// A point of the first figure and one of the second.
    pub points: [DVec3; 2],
    /// Their squared distance; exactly 0 where two triangles, or a segment and a triangle, share a point.
    pub distance_squared: f64,
}

impl ClosestPair {
    /// No points, infinitely far apart: any pair is nearer.
    pub const NONE: Self = Self {
        points: [DVec3::ZERO; 2],
        distance_squared: f64::INFINITY,
    };

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

    pub(super) fn keep_nearer(&mut self, other: Self) {
        if other.distance_squared < self.distance_squared {
            *self = other;
        }
    }
}

/// The closest points of two segments; a segment of no length is a point.
#[must_use]
pub fn closest_points_of_segments(first: [DVec3; 2], second: [DVec3; 2]) -> ClosestPair {
    let [p, q] = [first, second];
    let (u, v, between) = (p[1] - p[0], q[1] - q[0], q[0] - p[0]);
    // Cross products, not differences of dot products, which cancel on near-parallel segments. Where the lines
    // come closest within both segments that is the answer.
    let normal = u.cross(v);
    let square = normal.length_squared();
    let (s, t) = (between.cross(v).dot(normal), between.cross(u).dot(normal));
    let mut best = ClosestPair::NONE;
    if square > 0.0 && s > 0.0 && s < square && t > 0.0 && t < square {
        best = ClosestPair::between(p[0] + u * (s / square), q[0] + v * (t / square));
        // The other one's point is then the foot of this one's, so rounding of near-parallel ones is made good.
        let foot = closest_point_on_segment(q[0], q[1], best.points[0]);
        best.keep_nearer(ClosestPair::between(best.points[0], q[0] + v * foot));
        if normal.length_squared() > 1e-12 * u.length_squared() * v.length_squared() {
            return best;
        }
    }
    for end in p {
        let t = closest_point_on_segment(q[0], q[1], end);
        best.keep_nearer(ClosestPair::between(end, q[0].lerp(q[1], t)));
    }
    for end in q {
        let s = closest_point_on_segment(p[0], p[1], end);
        best.keep_nearer(ClosestPair::between(p[0].lerp(p[1], s), end));
    }
    best
}

/// The closest points of a segment and a triangle; distance 0 exactly where they share a point.
#[must_use]
pub fn closest_points_of_segment_and_triangle(
    segment: [DVec3; 2],
    triangle: [DVec3; 3],
) -> ClosestPair {
    let [p, q] = segment;
    if let Some(at) = piercing_point(segment, triangle) {
        return ClosestPair::shared(at);
    }
    let mut best = ClosestPair::NONE;
    for end in [p, q] {
        let closest = closest_point_on_triangle(triangle, end);
        best.keep_nearer(ClosestPair::between(end, closest.point));
    }
    for k in 0..3 {
        let edge = [triangle[k], triangle[(k + 1) % 3]];
        best.keep_nearer(closest_points_of_segments(segment, edge));
    }
    best
}

/// A point that a segment shares with a triangle, by exact signs. Triangles without area are left to their edges.
fn piercing_point([p, q]: [DVec3; 2], t: [DVec3; 3]) -> Option<DVec3> {
    let finite = p.is_finite() && q.is_finite() && t.iter().all(|c| c.is_finite());
    if !finite || triangle_is_degenerate(t[0], t[1], t[2]) {
        return None;
    }
    contact_of_segment(p, q, t).map(|[from, to]| 0.5 * (from + to))
}

#[cfg(test)]
#[path = "segment_tests.rs"]
mod tests;
