//! Closest points of two triangles, and of a capsule and a triangle.

use super::segment::{ClosestPair, closest_inner_points, closest_points_of_segment_and_triangle};
use super::triangle::closest_point_on_triangle;
use super::triangle_pair::triangle_pair;
use glam::DVec3;

/// The closest points of two triangles; distance 0 exactly where they meet.
#[must_use]
pub fn closest_points_of_triangles(a: [DVec3; 3], b: [DVec3; 3]) -> ClosestPair {
    if let Some(point) = triangle_pair(a, b).point() {
        return ClosestPair::shared(point);
    }
    let mut best = ClosestPair::NONE;
    for corner in a {
        let closest = closest_point_on_triangle(b, corner);
        best.keep_nearer(ClosestPair::between(corner, closest.point));
    }
    for corner in b {
        let closest = closest_point_on_triangle(a, corner);
        best.keep_nearer(ClosestPair::between(closest.point, corner));
    }
    // Corners and edges are done; inner points of two edges remain.
    for k in 0..3 {
        for l in 0..3 {
            let edges = [[a[k], a[(k + 1) % 3]], [b[l], b[(l + 1) % 3]]];
            if let Some(inner) = closest_inner_points(edges[0], edges[1]) {
                best.keep_nearer(inner);
            }
        }
    }
    best
}

/// Lower bound of the squared distance of two triangles, 0 where none is found: the gap between
/// them along either normal. It costs a tenth of [`closest_points_of_triangles`].
#[must_use]
pub fn distance_squared_bound_of_triangles(a: [DVec3; 3], b: [DVec3; 3]) -> f64 {
    gap_along_normal(a, b).max(gap_along_normal(b, a))
}

/// Gap along the normal of `a`. Any direction bounds the distance, so the normal need not be exact;
/// only the positions along it have rounding.
fn gap_along_normal(a: [DVec3; 3], b: [DVec3; 3]) -> f64 {
    let (u, v) = (a[1] - a[0], a[2] - a[0]);
    let normal = u.cross(v);
    let offsets = b.map(|corner| corner - a[0]);
    let [of_u, of_v] = [normal.dot(u), normal.dot(v)];
    let positions = offsets.map(|offset| normal.dot(offset));
    let (min_b, max_b) = (
        positions[0].min(positions[1]).min(positions[2]),
        positions[0].max(positions[1]).max(positions[2]),
    );
    let (min_a, max_a) = (of_u.min(of_v).min(0.0), of_u.max(of_v).max(0.0));
    let gap = (min_b - max_a).max(min_a - max_b);
    let extent = [u, v, offsets[0], offsets[1], offsets[2]]
        .iter()
        .fold(0.0f64, |max, offset| max.max(offset.abs().max_element()));
    let rounding = 16.0 * f64::EPSILON * normal.abs().max_element() * extent;
    let gap = (gap - rounding).max(0.0);
    let bound = gap * gap / normal.length_squared() * (1.0 - 1e-12);
    if bound.is_finite() { bound } else { 0.0 }
}

/// Signed distance of a capsule and a triangle with the closest points, the first on the axis.
/// Negative values, down to `-radius`, are the depth of the triangle in the capsule.
#[must_use]
pub fn capsule_triangle_distance(
    axis: [DVec3; 2],
    radius: f64,
    triangle: [DVec3; 3],
) -> (f64, ClosestPair) {
    let closest = closest_points_of_segment_and_triangle(axis, triangle);
    (closest.distance_squared.sqrt() - radius, closest)
}
