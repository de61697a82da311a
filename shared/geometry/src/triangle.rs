//! Closest points and overlap of single triangles, in f64 and without any epsilon.

use crate::portable::atan2;
use glam::DVec3;

/// A point of a triangle closest to a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// The point, in the frame of the query.
    pub point: DVec3,
    /// Its barycentric weights over the corners; they sum to one.
    pub weights: [f64; 3],
    /// Squared distance to the query point.
    pub distance_squared: f64,
}

impl ClosestPoint {
    #[inline(always)]
    fn at(corners: [DVec3; 3], weights: [f64; 3], query: DVec3) -> Self {
        let point = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        Self {
            point,
            weights,
            distance_squared: point.distance_squared(query),
        }
    }
}

/// Signed solid angle of a triangle seen from a point, in -2 pi..=2 pi, positive where its corners
/// appear clockwise. Over a closed mesh the sum is 4 pi inside and 0 outside (van Oosterom and
/// Strackee 1983).
#[must_use]
pub fn solid_angle(corners: [DVec3; 3], point: DVec3) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - point);
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    let volume = a.dot(b.cross(c));
    let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    2.0 * atan2(volume, denominator)
}

/// Parameter in 0..=1 of the point of segment `a b` closest to `query`; 0 for a segment of no
/// length.
#[must_use]
#[inline]
pub fn closest_point_on_segment(a: DVec3, b: DVec3, query: DVec3) -> f64 {
    let ab = b - a;
    let length_squared = ab.length_squared();
    if length_squared > 0.0 {
        ((query - a).dot(ab) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    }
}

/// Closest point on a triangle, by Voronoi regions (Ericson 2005, section 5.1.5).
///
/// A triangle without area is treated as its longest edge: no epsilon, any scale.
// A call would pass a hundred bytes through memory and take a third of its time, since they are
// written in other pieces than they are read.
#[inline(always)]
#[must_use]
pub fn closest_point_on_triangle(corners: [DVec3; 3], query: DVec3) -> ClosestPoint {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (b - a, c - a, query - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ClosestPoint::at(corners, [1.0, 0.0, 0.0], query);
    }
    let bp = query - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return ClosestPoint::at(corners, [0.0, 1.0, 0.0], query);
    }
    let cp = query - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return ClosestPoint::at(corners, [0.0, 0.0, 1.0], query);
    }
    // The signs of these decide between face and edges. Differences of products of dot products
    // would cancel on slivers, so these are products with the normal.
    let normal = ab.cross(ac);
    let wc = normal.dot(ap.cross(bp));
    let wa = normal.dot(bp.cross(cp));
    let wb = normal.dot(cp.cross(ap));
    let sum = wa + wb + wc;
    let has_area = sum > 0.0 && sum.is_normal();
    let inside = [wc > 0.0, wa > 0.0, wb > 0.0];
    if has_area && inside == [true; 3] {
        let inverse = 1.0 / sum;
        return ClosestPoint::at(corners, [wa * inverse, wb * inverse, wc * inverse], query);
    }
    closest_point_on_edges(corners, query, inside, has_area)
}

/// Closest point on the edges that the query is beyond; on all three for a triangle without area.
#[inline(always)]
fn closest_point_on_edges(
    corners: [DVec3; 3],
    query: DVec3,
    inside: [bool; 3],
    has_area: bool,
) -> ClosestPoint {
    let on_edge = |i: usize, j: usize| {
        let t = closest_point_on_segment(corners[i], corners[j], query);
        let mut weights = [0.0; 3];
        weights[i] = 1.0 - t;
        weights[j] = t;
        ClosestPoint::at(corners, weights, query)
    };
    let mut best = ClosestPoint {
        point: corners[0],
        weights: [1.0, 0.0, 0.0],
        distance_squared: f64::INFINITY,
    };
    // Mostly beyond one edge alone.
    let mut keep_nearer = |candidate: ClosestPoint| {
        if candidate.distance_squared < best.distance_squared {
            best = candidate;
        }
    };
    match inside {
        [false, true, true] if has_area => keep_nearer(on_edge(0, 1)),
        [true, false, true] if has_area => keep_nearer(on_edge(1, 2)),
        [true, true, false] if has_area => keep_nearer(on_edge(2, 0)),
        _ => {
            // Beyond two edges, or a triangle without area.
            for (edge, (i, j)) in [(0, 1), (1, 2), (2, 0)].into_iter().enumerate() {
                if !(has_area && inside[edge]) {
                    keep_nearer(on_edge(i, j));
                }
            }
        }
    }
    best
}

/// Whether a triangle and a closed box share a point, by separating axes (Akenine-Möller 2001) in
/// f64.
///
/// A tie is an overlap, so a face on the wall between two cells belongs to both.
#[must_use]
pub fn triangle_overlaps_box(corners: [DVec3; 3], lower: DVec3, upper: DVec3) -> bool {
    let low = corners[0].min(corners[1]).min(corners[2]);
    let high = corners[0].max(corners[1]).max(corners[2]);
    if low.cmpgt(upper).any() || high.cmplt(lower).any() {
        return false;
    }
    let centre = (lower + upper) * 0.5;
    let half = (upper - lower) * 0.5;
    let v = corners.map(|p| p - centre);
    let edges = [v[1] - v[0], v[2] - v[1], v[0] - v[2]];
    // The slack covers the rounding of the projections, so a tie stays an overlap. It scales with
    // the data, so the answer is the same in any unit.
    let separated = |axis: DVec3| {
        let p = v.map(|x| axis.dot(x));
        let radius = half.dot(axis.abs());
        let min = p[0].min(p[1]).min(p[2]);
        let max = p[0].max(p[1]).max(p[2]);
        let slack = 8.0
            * f64::EPSILON
            * (radius
                + v.iter()
                    .map(|x| axis.abs().dot(x.abs()))
                    .fold(0.0, f64::max));
        min > radius + slack || max < -radius - slack
    };
    if separated(edges[0].cross(edges[1])) {
        return false;
    }
    for edge in edges {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            if separated(edge.cross(axis)) {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use parry3d_f64::query::PointQuery;
    use parry3d_f64::shape::Triangle;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn closest_point_equals_parry_in_f64_at_any_scale(
            corners in prop::array::uniform3(vector()),
            query in vector(),
            exponent in -6..6i32,
        ) {
            let scale = 10f64.powi(exponent);
            let scaled = corners.map(|c| c * scale);
            let ours = closest_point_on_triangle(scaled, query * scale);
            let triangle = Triangle::new(corners[0], corners[1], corners[2]);
            let theirs = triangle.project_local_point(query, false).point.distance(query) * scale;
            prop_assert!((ours.distance_squared.sqrt() - theirs).abs() <= 1e-9 * scale);
            let sum: f64 = ours.weights.iter().sum();
            prop_assert!((sum - 1.0).abs() < 1e-12);
            prop_assert!(ours.weights.iter().all(|&w| w >= 0.0));
        }

        #[test]
        fn a_triangle_without_area_answers_as_its_edges(
            a in vector(), d in vector(), t in -1.0..2.0f64, query in vector(),
        ) {
            let corners = [a, a + d, a + d * t];
            let ours = closest_point_on_triangle(corners, query);
            let mut best = f64::INFINITY;
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let s = closest_point_on_segment(corners[i], corners[j], query);
                best = best.min(corners[i].lerp(corners[j], s).distance(query));
            }
            prop_assert!((ours.distance_squared.sqrt() - best).abs() <= 1e-7);
        }

        /// To a margin far above the rounding of either.
        #[test]
        fn overlap_agrees_with_what_the_walls_cut_off(
            corners in prop::array::uniform3(vector()),
            centre in vector(), half in 0.05..0.5f64,
        ) {
            let (lower, upper) = (centre - half, centre + half);
            if triangle_overlaps_box(corners, lower, upper) {
                prop_assert!(!cut_to_box(corners, lower - 1e-9, upper + 1e-9).is_empty());
            } else {
                prop_assert!(cut_to_box(corners, lower + 1e-9, upper - 1e-9).is_empty());
            }
        }
    }

    /// What is left of a triangle in a box, by one wall after the other (Sutherland and Hodgman
    /// 1974).
    fn cut_to_box(corners: [DVec3; 3], lower: DVec3, upper: DVec3) -> Vec<DVec3> {
        let mut polygon = corners.to_vec();
        for axis in 0..3 {
            for (sign, wall) in [(1.0, upper[axis]), (-1.0, -lower[axis])] {
                let beyond = |p: DVec3| sign * p[axis] - wall;
                let mut left = Vec::new();
                for (k, &p) in polygon.iter().enumerate() {
                    let next = polygon[(k + 1) % polygon.len()];
                    let (from, to) = (beyond(p), beyond(next));
                    if from <= 0.0 {
                        left.push(p);
                    }
                    if (from <= 0.0) != (to <= 0.0) {
                        left.push(p.lerp(next, from / (from - to)));
                    }
                }
                polygon = left;
            }
        }
        polygon
    }

    #[test]
    fn solid_angles_over_a_closed_mesh_tell_inside_from_outside() {
        let corner = |k: usize| {
            DVec3::ZERO
                .with_x([0.0, 1.0][k & 1])
                .with_y([0.0, 1.0][k >> 1 & 1])
                .with_z([0.0, 1.0][k >> 2])
        };
        // A tetrahedron of a cube's corners, each face seen from outside counterclockwise.
        let faces = [[0, 2, 1], [0, 1, 4], [0, 4, 2], [1, 2, 4]].map(|face| face.map(corner));
        let whole = |point: DVec3| {
            faces
                .iter()
                .map(|&face| solid_angle(face, point))
                .sum::<f64>()
        };
        let turn = 4.0 * std::f64::consts::PI;
        for inside in [
            DVec3::splat(0.1),
            DVec3::new(0.5, 0.3, 0.1),
            DVec3::splat(0.333),
        ] {
            assert!((whole(inside) - turn).abs() < 1e-12 * turn, "{inside}");
        }
        for outside in [
            DVec3::splat(-0.1),
            DVec3::splat(0.334),
            DVec3::new(5.0, 0.1, 0.1),
        ] {
            assert!(whole(outside).abs() < 1e-12 * turn, "{outside}");
        }
    }

    #[test]
    fn corners_and_edges_on_the_wall_of_a_box_count_as_overlap() {
        let (lower, upper) = (DVec3::ZERO, DVec3::ONE);
        let wall = [
            DVec3::new(1.0, 0.2, 0.2),
            DVec3::new(2.0, 0.2, 0.2),
            DVec3::new(2.0, 0.8, 0.2),
        ];
        assert!(triangle_overlaps_box(wall, lower, upper));
        let beyond = wall.map(|p| p + DVec3::new(1e-12, 0.0, 0.0));
        assert!(!triangle_overlaps_box(beyond, lower, upper));
    }
}
