//! The distance to a triangle, and nothing else: what the builder asks for some ten times a face
//! and level.
//!
//! (The narrow phase of the touch wants the point, its weights and no cancellation on slivers; a
//! sample of an estimate does not.)

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
    bb: f64,
    bc: f64,
    cc: f64,
}

impl Triangle {
    /// From its corners.
    #[inline]
    pub fn new([a, b, c]: [DVec3; 3]) -> Self {
        let (ab, ac) = (b - a, c - a);
        Self {
            a,
            ab,
            ac,
            normal: ab.cross(ac),
            bb: ab.dot(ab),
            bc: ab.dot(ac),
            cc: ac.dot(ac),
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
        let Self {
            ab, ac, bb, bc, cc, ..
        } = *self;
        let ap = point - self.a;
        let (pb, pc) = (ap.dot(ab), ap.dot(ac));
        // Twice the area squared, and the coordinates in its measure.
        let whole = bb * cc - bc * bc;
        let at_b = cc * pb - bc * pc;
        let at_c = bb * pc - bc * pb;
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
            squared = squared.min(along(ap, ab, pb, bb));
        }
        if at_b <= 0.0 {
            squared = squared.min(along(ap, ac, pc, cc));
        }
        if at_a <= 0.0 {
            let (bp, edge) = (ap - ab, ac - ab);
            squared = squared.min(along(bp, edge, bp.dot(edge), edge.dot(edge)));
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

/// Squared distance from an edge: the point from its start, the edge, their product and the edge's
/// square.
#[inline]
fn along(from_start: DVec3, edge: DVec3, product: f64, square: f64) -> f64 {
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
    use geometry::closest_point_on_triangle;
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
    }

    #[test]
    fn a_point_of_a_triangle_without_area_is_near_its_edges() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0];
        let squared = |corners, point| Triangle::new(corners).distance(point).squared;
        assert_eq!(squared(corners, DVec3::new(1.5, 2.0, 0.0)), 4.0);
        assert_eq!(squared([DVec3::X; 3], DVec3::ZERO), 1.0);
    }
}
