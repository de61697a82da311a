//! Quadrics: weighted sums of squared distances to planes (Garland and Heckbert 1997), in f64.

use glam::DVec3;
use nalgebra::{Matrix3, Vector3, Vector6};
use std::ops::Add;

/// p ↦ pᵀ A p + 2 b·p + c with A symmetric.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Quadric {
    /// xx, xy, xz, yy, yz, zz of A: 24 B a vertex less than a Matrix3.
    a: Vector6<f64>,
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    /// Squared distance to the plane through a point with a unit normal, times a weight.
    pub(super) fn of_plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let (normal, point) = (Vector3::from(normal), Vector3::from(point));
        let d = -normal.dot(&point);
        let n = normal * weight;
        Self {
            a: Vector6::new(
                n.x * normal.x,
                n.x * normal.y,
                n.x * normal.z,
                n.y * normal.y,
                n.y * normal.z,
                n.z * normal.z,
            ),
            b: n * d,
            c: weight * d * d,
        }
    }

    /// A.
    fn matrix(&self) -> Matrix3<f64> {
        let a = &self.a;
        Matrix3::new(a[0], a[1], a[2], a[1], a[3], a[4], a[2], a[4], a[5])
    }

    /// Its value.
    pub(super) fn at(&self, p: DVec3) -> f64 {
        let p = Vector3::from(p);
        p.dot(&(self.matrix() * p)) + 2.0 * self.b.dot(&p) + self.c
    }

    /// The point where it is least, when that is well defined: not on planes and straight creases.
    pub(super) fn minimum(&self) -> Option<DVec3> {
        let a = self.matrix();
        let [x, y, z] = [a.column(0), a.column(1), a.column(2)];
        // The inverse is the adjugate, whose columns are these cross products, by the determinant:
        // the test for a well defined point needs no decomposition.
        let first = y.cross(&z);
        let determinant = x.dot(&first);
        let trace = a.trace();
        if determinant <= 1e-6 * trace * trace * trace {
            return None;
        }
        let adjugate = Matrix3::from_columns(&[first, z.cross(&x), x.cross(&y)]);
        let point = DVec3::from(adjugate * (-self.b / determinant));
        point.is_finite().then_some(point)
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            a: self.a + other.a,
            b: self.b + other.b,
            c: self.c + other.c,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_planes_meet_at_the_minimum_and_two_have_none() {
        let corner = DVec3::new(0.25, -0.5, 0.125);
        let plane = |n: DVec3| Quadric::of_plane(n, corner, 2.0);
        let two = plane(DVec3::X) + plane(DVec3::Y);
        assert_eq!(two.minimum(), None);
        let three = two + plane(DVec3::Z);
        assert!((three.minimum().unwrap() - corner).length() < 1e-15);
        assert!((three.at(corner + DVec3::ONE) - 6.0).abs() < 1e-12);
    }
}
