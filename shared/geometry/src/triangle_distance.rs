//! Closest points of two triangles.

use super::segment::{ClosestPair, closest_inner_points};
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
