//! A coarse face and its plane, and how points are seen from there.

use geometry::closest_point_on_triangle;
use glam::DVec3;

/// Length over height of a face from which nothing can be seen: as much of its normal is lost.
const SLIVER: f64 = 1024.0;

/// A coarse face and its plane.
pub struct Plane {
    corners: [DVec3; 3],
    normal: DVec3,
    /// Of the weights of the corners, and how long they are.
    gradients: [DVec3; 3],
    lengths: [f64; 3],
    /// What distances lose by rounding.
    rounding: f64,
    is_sliver: bool,
}

/// A point seen from a face.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// The weights of the corners, of the plane's point below it.
    pub weights: [f64; 3],
    /// How far it is from the face.
    pub away: f64,
    /// How far the plane's point is.
    pub beside: f64,
}

impl Plane {
    /// `rounding`: what differences of coordinates lose.
    pub fn new(corners: [DVec3; 3], rounding: f64) -> Self {
        let [a, b, c] = corners;
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        let twice_area = normal.length();
        let normal = normal / twice_area;
        let at_b = ac.cross(normal) / twice_area;
        let at_c = normal.cross(ab) / twice_area;
        let gradients = [-at_b - at_c, at_b, at_c];
        let lengths = gradients.map(DVec3::length);
        let longest = ab.length().max(ac.length()).max(ab.distance(ac));
        let sliver = longest * lengths[0].max(lengths[1]).max(lengths[2]);
        let is_sliver = !(normal.is_finite() && sliver < SLIVER);
        Self {
            corners,
            normal,
            gradients,
            lengths,
            // The normal is known worse in proportion.
            rounding: if is_sliver {
                rounding
            } else {
                rounding * sliver
            },
            is_sliver,
        }
    }

    pub fn corners(&self) -> &[DVec3; 3] {
        &self.corners
    }

    /// Whether weights mean nothing.
    pub fn is_sliver(&self) -> bool {
        self.is_sliver
    }

    #[inline]
    pub fn see(&self, point: DVec3) -> Seen {
        if self.is_sliver {
            let closest = closest_point_on_triangle(self.corners, point);
            return Seen {
                weights: closest.weights,
                away: closest.distance_squared.sqrt(),
                beside: f64::INFINITY,
            };
        }
        let from_first = point - self.corners[0];
        let (at_b, at_c) = (
            self.gradients[1].dot(from_first),
            self.gradients[2].dot(from_first),
        );
        let weights = [1.0 - at_b - at_c, at_b, at_c];
        let height = self.normal.dot(from_first);
        if weights.iter().all(|&weight| weight >= 0.0) {
            return Seen {
                weights,
                away: height.abs(),
                beside: 0.0,
            };
        }
        let below = point - self.normal * height;
        let beside_squared = closest_point_on_triangle(self.corners, below).distance_squared;
        Seen {
            weights,
            away: (height * height + beside_squared).sqrt(),
            beside: beside_squared.sqrt(),
        }
    }

    /// The length of a vector seen along the normal.
    pub fn in_plane(&self, vector: DVec3) -> f64 {
        (vector - self.normal * self.normal.dot(vector)).length()
    }

    /// The most that a displacement of this length in the plane changes the weight of a corner.
    pub fn weight_of(&self, corner: usize, length: f64) -> f64 {
        length * self.lengths[corner]
    }

    /// What the weight of a corner loses by rounding.
    pub fn slack(&self, corner: usize) -> f64 {
        self.weight_of(corner, self.rounding)
    }

    /// A bound of a distance that was computed to be this.
    pub fn rounded_up(&self, distance: f64) -> f64 {
        // Squares and the root are rounded too.
        distance * (1.0 + 8.0 * f64::EPSILON) + self.rounding
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    /// What differences of coordinates up to 1 lose.
    const ROUNDING: f64 = 32.0 * f64::EPSILON;

    proptest! {
        #[test]
        fn a_point_is_as_far_as_the_closest_point_of_the_face(
            corners in prop::array::uniform3(vector()), point in vector(), flat in 0.0..1.0f64,
        ) {
            // Half of them are slivers.
            let [a, b, c] = corners;
            let c = if flat < 0.5 { a.lerp(b, 2.0 * flat) + c * 1e-4 } else { c };
            let plane = Plane::new([a, b, c], ROUNDING);
            let seen = plane.see(point);
            let exact = closest_point_on_triangle([a, b, c], point).distance_squared.sqrt();
            prop_assert!(plane.rounded_up(seen.away) >= exact, "{} {exact}", seen.away);
            prop_assert!(seen.away <= exact * (1.0 + 1e-6) + 1e-9);
            if !plane.is_sliver() {
                let [u, v, w] = seen.weights;
                let below = a * u + b * v + c * w;
                let off = point - below;
                prop_assert!(plane.in_plane(off) < 1e-9, "{off}");
                let beside = closest_point_on_triangle([a, b, c], below).distance_squared.sqrt();
                prop_assert!((seen.beside - beside).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn from_a_face_without_area_only_distances_are_seen() {
        let plane = Plane::new([DVec3::ZERO, DVec3::X, DVec3::X * 2.0], ROUNDING);
        assert!(plane.is_sliver());
        assert_eq!(plane.see(DVec3::new(1.5, 2.0, 0.0)).away, 2.0);
    }
}
