//! The distance to a triangle, and nothing else: what the builder asks for some ten times a face
//! and level.
//!
//! (The narrow phase of the touch wants the point and its weights too; a sample of an estimate does
//! not.)

use glam::DVec3;

/// How far a point is from a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    /// Squared, model units.
    pub squared: f64,
    /// The corner opposite the side beyond which the point lies, 3 when it is above or below the
    /// inside.
    pub beyond: usize,
}

impl Distance {
    /// Whether the point lies above or below the inside of the triangle.
    pub fn is_above(&self) -> bool {
        self.beyond == 3
    }
}

/// A triangle from which the distances of many points are asked for.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    a: DVec3,
    ab: DVec3,
    ac: DVec3,
    /// As long as twice the area.
    normal: DVec3,
    /// Square to the sides ac and ab, in the plane, towards b and c: products with them do not
    /// cancel on slivers as f32 leaves them, whose third corner is a unit away from a side.
    /// (Differences of products of `ab` and `ac` do, and made distances up to 80 times too small or
    /// too large.)
    to_b: DVec3,
    to_c: DVec3,
}

impl Triangle {
    /// From its corners.
    #[inline]
    pub fn new([a, b, c]: [DVec3; 3]) -> Self {
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        Self {
            a,
            ab,
            ac,
            normal,
            to_b: ac.cross(normal),
            to_c: normal.cross(ab),
        }
    }

    /// The first corner.
    pub fn first(&self) -> DVec3 {
        self.a
    }

    /// The sides from the first corner to the second, and from that to the third.
    pub fn sides(&self) -> [DVec3; 2] {
        [self.ab, self.ac - self.ab]
    }

    /// Twice the area.
    pub fn twice_area(&self) -> f64 {
        self.normal.length()
    }

    /// Squared distance of a point, by the signs of its barycentric coordinates.
    #[inline]
    pub fn distance(&self, point: DVec3) -> Distance {
        let ap = point - self.a;
        // Twice the area squared, and the coordinates in its measure.
        let whole = self.normal.length_squared();
        let (at_b, at_c) = (ap.dot(self.to_b), ap.dot(self.to_c));
        let at_a = whole - at_b - at_c;
        if at_a > 0.0 && at_b > 0.0 && at_c > 0.0 {
            let height = ap.dot(self.normal);
            return Distance {
                squared: height * height / whole,
                beyond: 3,
            };
        }
        // Where a coordinate is not positive, the nearest point may lie on the edge opposite its
        // corner.
        let mut squared = f64::INFINITY;
        if at_c <= 0.0 {
            squared = squared.min(along(ap, self.ab));
        }
        if at_b <= 0.0 {
            squared = squared.min(along(ap, self.ac));
        }
        if at_a <= 0.0 {
            squared = squared.min(along(ap - self.ab, self.ac - self.ab));
        }
        let beyond = if at_a < at_b && at_a < at_c {
            0
        } else if at_b < at_c {
            1
        } else {
            2
        };
        Distance { squared, beyond }
    }
}

/// Squared distance from an edge: the point from its start, and the edge.
#[inline]
fn along(from_start: DVec3, edge: DVec3) -> f64 {
    let (product, square) = (from_start.dot(edge), edge.length_squared());
    let share = if product <= 0.0 {
        0.0
    } else if product >= square {
        1.0
    } else {
        product / square
    };
    (from_start - edge * share).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{closest_point_on_triangle, triangle_is_degenerate};
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn it_is_the_distance_of_the_closest_point(
            corners in prop::array::uniform3(vector()), point in vector(), flat in 0.0..1.0f64,
        ) {
            // Half of them are slivers.
            let [a, b, c] = corners;
            let corners = [a, b, if flat < 0.5 { a.lerp(b, 2.0 * flat) + c * 1e-4 } else { c }];
            let ours = Triangle::new(corners).distance(point);
            let theirs = closest_point_on_triangle(corners, point);
            prop_assert!((ours.squared.sqrt() - theirs.distance_squared.sqrt()).abs() < 1e-6);
            if ours.is_above() {
                prop_assert!(theirs.weights.iter().all(|&w| w > -1e-6));
            }
        }

        /// Slivers as f32 leaves them: the third corner is the f32 next to a point of the edge.
        #[test]
        fn above_a_sliver_of_f32_it_is_the_height(
            ends in prop::array::uniform2(vector()), along in 0.05..0.95f64,
            weights in prop::array::uniform3(0.05..1.0f64), height in 0.01..1.0f64,
        ) {
            let rounded = |p: DVec3| p.as_vec3().as_dvec3();
            let [a, b] = ends.map(rounded);
            let corners = [a, b, rounded(a.lerp(b, along))];
            prop_assume!(!triangle_is_degenerate(corners[0], corners[1], corners[2]));
            let [ab, ac] = [b - a, corners[2] - a];
            let sum: f64 = weights.iter().sum();
            let inside = (0..3).map(|k| corners[k] * (weights[k] / sum)).sum::<DVec3>();
            let point = inside + ab.cross(ac).normalize() * height;
            let ours = Triangle::new(corners).distance(point).squared.sqrt();
            let theirs = closest_point_on_triangle(corners, point).distance_squared.sqrt();
            prop_assert!((ours - theirs).abs() <= 1e-3 * theirs, "{ours} of {theirs}");
        }
    }

    #[test]
    fn a_point_of_a_triangle_without_area_is_near_its_edges() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        let squared = |corners, point| Triangle::new(corners).distance(point).squared;
        assert_eq!(squared(corners, DVec3::new(1.5, 2.0, 0.0)), 4.0);
        assert_eq!(squared([DVec3::X; 3], DVec3::ZERO), 1.0);
    }
}
