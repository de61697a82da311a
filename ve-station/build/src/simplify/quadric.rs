//! Quadrics: weighted sums of squared distances to planes (Garland and Heckbert 1997), in f64.

use glam::DVec3;
use std::ops::Add;

/// p ↦ pᵀ A p + 2 b·p + c with A symmetric.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Quadric {
    /// xx, xy, xz, yy, yz, zz of A.
    a: [f64; 6],
    b: DVec3,
    c: f64,
}

impl Quadric {
    /// Squared distance to the plane through a point with a unit normal, times a weight.
    pub(super) fn of_plane(normal: DVec3, point: DVec3, weight: f64) -> Self {
        let d = -normal.dot(point);
        let n = normal * weight;
        Self {
            a: [
                n.x * normal.x,
                n.x * normal.y,
                n.x * normal.z,
                n.y * normal.y,
                n.y * normal.z,
                n.z * normal.z,
            ],
            b: n * d,
            c: weight * d * d,
        }
    }

    /// Its value.
    pub(super) fn at(&self, p: DVec3) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        let ap = DVec3::new(
            xx * p.x + xy * p.y + xz * p.z,
            xy * p.x + yy * p.y + yz * p.z,
            xz * p.x + yz * p.y + zz * p.z,
        );
        p.dot(ap) + 2.0 * self.b.dot(p) + self.c
    }

    /// The point where it is least, when that is well defined: not on planes and straight creases.
    pub(super) fn minimum(&self) -> Option<DVec3> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        // The adjugate: cofactors of the symmetric matrix.
        let (cxx, cxy, cxz) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let determinant = xx * cxx + xy * cxy + xz * cxz;
        let trace = xx + yy + zz;
        if determinant <= 1e-6 * trace * trace * trace {
            return None;
        }
        let (cyy, cyz, czz) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let b = -self.b / determinant;
        let point = DVec3::new(
            cxx * b.x + cxy * b.y + cxz * b.z,
            cxy * b.x + cyy * b.y + cyz * b.z,
            cxz * b.x + cyz * b.y + czz * b.z,
        );
        point.is_finite().then_some(point)
    }
}

impl Add for Quadric {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let mut a = self.a;
        for (sum, x) in a.iter_mut().zip(other.a) {
            *sum += x;
        }
        Self {
            a,
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
