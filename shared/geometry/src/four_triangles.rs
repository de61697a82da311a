//! Bounds of the distances of a point from four triangles side by side, in f32: most triangles of a
//! search are ruled out by them, and only the rest is looked at in f64.
//!
//! Whatever point of a triangle is taken for the closest one, its distance is an upper bound, and
//! the corner that is nearest in its direction gives a lower one. So rounding, slivers and
//! triangles without area only widen the bounds; both are tight where the guess is good.

use glam::{DVec3, Vec3, Vec4};

/// Rounding of both bounds in parts of the largest coordinate seen from the point: 13 units of
/// 2^-23 for the lower one (corners 1, products 4, length 4, comparison 4), 20 for the upper one
/// (corners 1, weights 12, length 4, sum 3), with a margin.
const ROUNDING: f32 = 32.0 * f32::EPSILON;
/// Rounding of the point itself, in parts of its largest coordinate: half a unit an axis.
const OF_POINT: f32 = 2.0 * f32::EPSILON;
/// Weights are used where their sum is between these: no product of them is lost or too large.
const SUMS: [f32; 2] = [1e-30, 1e30];
/// Coordinates below have products that are numbers, and sums of three of them.
const LARGEST: f32 = 1e18;
/// Squared lengths below are not sure to a few units.
const SHORT: f32 = 1e-30;

/// Four vectors.
#[derive(Debug, Clone, Copy)]
struct Vectors([Vec4; 3]);

impl Vectors {
    #[inline(always)]
    fn dot(&self, other: &Self) -> Vec4 {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a * x + b * y + c * z
    }

    #[inline(always)]
    fn minus(&self, other: &Self) -> Self {
        Self([0, 1, 2].map(|k| self.0[k] - other.0[k]))
    }

    #[inline(always)]
    fn cross(&self, other: &Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }

    #[inline(always)]
    fn select(mask: glam::BVec4A, chosen: &Self, other: &Self) -> Self {
        Self([0, 1, 2].map(|k| Vec4::select(mask, chosen.0[k], other.0[k])))
    }

    /// The point of the edge from here nearest to the origin.
    #[inline(always)]
    fn nearest_towards(&self, end: &Self) -> Self {
        let along = end.minus(self);
        let (from, to) = (self.dot(&along), end.dot(&along));
        // No number for an edge of no length: then its start.
        let part = (from / (from - to)).max(Vec4::ZERO).min(Vec4::ONE);
        Self([0, 1, 2].map(|k| self.0[k] + along.0[k] * part))
    }
}

/// Bounds of the distances of a point from four triangles.
#[derive(Debug, Clone, Copy)]
pub struct FourDistances {
    /// The least product of a corner with the displacement of the point guessed.
    least: Vec4,
    /// The squared length of that displacement.
    squared: Vec4,
    room: Vec4,
}

impl FourDistances {
    /// From any numbers; where they overflow, no triangle is ruled out.
    #[inline(always)]
    #[must_use]
    pub fn new(triangles: [[Vec3; 3]; 4], point: DVec3) -> Self {
        let rounded = point.as_vec3();
        let corner = |j: usize| {
            let [p, q, r, s] = triangles.map(|corners| corners[j] - rounded);
            Vectors([
                Vec4::new(p.x, q.x, r.x, s.x),
                Vec4::new(p.y, q.y, r.y, s.y),
                Vec4::new(p.z, q.z, r.z, s.z),
            ])
        };
        let corners @ [a, b, c] = [corner(0), corner(1), corner(2)];
        let displacement = Self::displacement_to_nearest(&a, &b, &c);
        let [of_a, of_b, of_c] = corners.map(|corner| {
            let [x, y, z] = corner.0.map(Vec4::abs);
            x.max(y).max(z)
        });
        let size = of_a.max(of_b).max(of_c);
        let room = size * ROUNDING + Vec4::splat(rounded.abs().max_element() * OF_POINT);
        // Which of two a minimum returns when one is no number hangs on their order.
        let is_sure = size.cmplt(Vec4::splat(LARGEST));
        Self {
            least: displacement
                .dot(&a)
                .min(displacement.dot(&b))
                .min(displacement.dot(&c)),
            squared: displacement.dot(&displacement),
            room: Vec4::select(is_sure, room, Vec4::INFINITY),
        }
    }

    /// About the nearest point of each triangle, on it in any case.
    #[inline(always)]
    fn displacement_to_nearest(a: &Vectors, b: &Vectors, c: &Vectors) -> Vectors {
        let [ab, bc, ca] = [
            a.nearest_towards(b),
            b.nearest_towards(c),
            c.nearest_towards(a),
        ];
        let [of_ab, of_bc, of_ca] = [ab.dot(&ab), bc.dot(&bc), ca.dot(&ca)];
        let edge = Vectors::select(of_bc.cmplt(of_ab), &bc, &ab);
        let edge = Vectors::select(of_ca.cmplt(of_ab.min(of_bc)), &ca, &edge);
        let normal = b.minus(a).cross(&c.minus(a));
        let [wa, wb, wc] = [
            normal.dot(&b.cross(c)),
            normal.dot(&c.cross(a)),
            normal.dot(&a.cross(b)),
        ];
        let sum = wa + wb + wc;
        let [few, many] = SUMS.map(Vec4::splat);
        let inside = wa.min(wb).min(wc).cmpgt(Vec4::ZERO) & sum.cmpgt(few) & sum.cmplt(many);
        let inverse = Vec4::ONE / sum;
        let [wa, wb, wc] = [wa, wb, wc].map(|weight| weight * inverse);
        let face = [0, 1, 2].map(|k| a.0[k] * wa + b.0[k] * wb + c.0[k] * wc);
        Vectors::select(inside, &Vectors(face), &edge)
    }

    /// Those that may be within a distance, as bits.
    #[inline(always)]
    #[must_use]
    pub fn within(&self, distance: f32) -> u32 {
        let reach = Vec4::splat(distance) + self.room;
        let limit = self.squared.max(Vec4::splat(SHORT)) * (reach * reach);
        let beyond = self.least.cmpgt(Vec4::ZERO) & (self.least * self.least).cmpgt(limit);
        // What is no number is not beyond.
        !beyond.bitmask() & 0b1111
    }

    /// A distance that one of them is not nearer than, and one that it is not farther than; the
    /// second may be no number where it overflows.
    #[inline(always)]
    #[must_use]
    pub fn of(&self, triangle: usize) -> [f32; 2] {
        let squared = self.squared[triangle];
        // Subnormal squares are not precise.
        let upper = (squared + f32::MIN_POSITIVE).sqrt();
        let least = self.least[triangle];
        let lower = if least.is_finite() {
            least / squared.max(SHORT).sqrt()
        } else {
            f32::NEG_INFINITY
        };
        let room = self.room[triangle];
        [lower - room, upper + room]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closest_point_on_triangle;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-1.0..1.0f32).prop_map(Vec3::from_array)
    }

    /// Any, slivers, and those without area.
    fn triangle() -> impl Strategy<Value = [Vec3; 3]> {
        let parts = (vector(), vector(), vector(), -1.0..2.0f32, 0..6);
        parts.prop_map(|(a, b, c, t, kind)| match kind {
            0 => [a, b, a + (b - a) * t],
            1 => [a, b, a + (b - a) * t + c * 1e-6],
            2 => [a, a, b],
            3 => [a; 3],
            4 => [a, a + b * 1e-3, a + c * 1e-3],
            _ => [a, b, c],
        })
    }

    fn exactly(corners: [Vec3; 3], point: DVec3) -> f64 {
        let corners = corners.map(|corner| corner.as_dvec3());
        closest_point_on_triangle(corners, point)
            .distance_squared
            .sqrt()
    }

    proptest! {
        #[test]
        fn the_distance_is_between_the_bounds_at_any_scale(
            triangles in prop::array::uniform4(triangle()),
            query in vector(), near in 0..4usize, exponent in -35..35i32,
        ) {
            let scale = 10f32.powi(exponent);
            let triangles = triangles.map(|corners| corners.map(|corner| corner * scale));
            let query = query.as_dvec3() * f64::from(scale);
            let at = triangles[near].map(|corner| corner.as_dvec3());
            // Anywhere, close to one, on one of its corners.
            for point in [query, at[0] + query * 1e-3, at[0].lerp(at[1], 0.3), at[2]] {
                let bounds = FourDistances::new(triangles, point);
                for (k, &corners) in triangles.iter().enumerate() {
                    let exact = exactly(corners, point);
                    let [lower, upper] = bounds.of(k).map(f64::from);
                    let is_within = lower <= exact && (upper >= exact || upper.is_nan());
                    prop_assert!(is_within, "{lower} {exact} {upper}");
                    let rounded = (exact as f32) * (1.0 + f32::EPSILON);
                    prop_assert!(bounds.within(rounded) >> k & 1 == 1);
                }
            }
        }

        #[test]
        fn of_good_triangles_hardly_more_than_rounding_is_between_them(
            a in vector(), b in vector(), c in vector(), query in vector(),
        ) {
            let area = (b - a).cross(c - a).length();
            prop_assume!(area > 0.3);
            let corners = [a, b, c];
            let exact = exactly(corners, query.as_dvec3());
            prop_assume!(exact > 0.1);
            let bounds = FourDistances::new([corners; 4], query.as_dvec3());
            let [lower, upper] = bounds.of(3).map(f64::from);
            prop_assert!(exact - lower < 2e-4 && upper - exact < 2e-4, "{lower} {exact} {upper}");
            prop_assert_eq!(bounds.within((exact - 3e-4) as f32), 0);
        }
    }

    #[test]
    fn from_beyond_all_numbers_nothing_is_ruled_out() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for far in [1e15, 1e25, 1e38, 1e100, f64::NAN] {
            let bounds = FourDistances::new([corners; 4], DVec3::new(far, 0.5 * far, 1.0));
            assert_eq!(bounds.within(f32::INFINITY), 0b1111);
            let [_, upper] = bounds.of(0);
            let is_short = f64::from(upper) < far;
            assert!(!is_short, "{upper}");
        }
    }
}
