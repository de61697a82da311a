//! Two boxes in one set of vectors, as in a node of the AB-tree, so that one comparison tests both.
//!
//! An axis is one vector [lower 0, lower 1, -upper 0, -upper 1]. With the upper sides negated,
//! distance and overlap are the same arithmetic for all four numbers. Everything is f32 and rounded
//! such that a computed distance or gap is never larger than the exact one.

use super::Aabb;
use glam::{BVec4A, DVec3, Vec3, Vec3A, Vec4, Vec4Swizzles};

/// Two boxes; each may be empty.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BoxPair {
    axes: [Vec4; 3],
}

/// A point or a box to compare a [`BoxPair`] with, rounded outwards to f32.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BoxQuery {
    axes: [Vec4; 3],
}

impl BoxQuery {
    /// A stored box, exact.
    #[inline]
    #[must_use]
    pub fn around(aabb: &Aabb) -> Self {
        let axis =
            |k: usize| Vec4::new(aabb.upper[k], aabb.upper[k], -aabb.lower[k], -aabb.lower[k]);
        Self {
            axes: [axis(0), axis(1), axis(2)],
        }
    }

    /// Sum of the three sides.
    #[inline]
    #[must_use]
    pub fn size(&self) -> f32 {
        let [x, y, z] = self.axes;
        let sum = x + y + z;
        sum.x + sum.z
    }
}

impl BoxPair {
    /// The same box twice, around corners that were rounded to f32, widened by twice that rounding.
    #[inline]
    #[must_use]
    pub fn twice_widened(lower: Vec3A, upper: Vec3A) -> Self {
        // The smallest normal number covers the rounding of subnormal ones.
        let rounding = |p: Vec3A| p.abs() * f32::EPSILON + Vec3A::splat(f32::MIN_POSITIVE);
        let (low, high) = (lower - rounding(lower), -upper - rounding(upper));
        let axis = |k: usize| Vec4::new(low[k], low[k], high[k], high[k]);
        Self {
            axes: [axis(0), axis(1), axis(2)],
        }
    }

    /// The box around both, twice.
    #[inline]
    #[must_use]
    pub fn joined(&self) -> Self {
        Self {
            axes: self.axes.map(|axis| axis.min(axis.yxwz())),
        }
    }

    /// The first box of one and the second of the other.
    #[inline]
    #[must_use]
    pub fn mixed(first: &Self, second: &Self) -> Self {
        let of_first = BVec4A::new(true, false, true, false);
        Self {
            axes: [0, 1, 2].map(|k| Vec4::select(of_first, first.axes[k], second.axes[k])),
        }
    }

    /// One of the two, 0 or 1, as a query for another pair.
    #[inline]
    #[must_use]
    pub fn query(&self, index: usize) -> BoxQuery {
        let axes = match index {
            0 => self.axes.map(|axis| -axis.zzxx()),
            _ => self.axes.map(|axis| -axis.wwyy()),
        };
        BoxQuery { axes }
    }

    /// Two empty boxes.
    pub const EMPTY: Self = Self {
        axes: [Vec4::INFINITY; 3],
    };

    /// Two boxes.
    #[inline]
    #[must_use]
    pub fn new([a, b]: [Aabb; 2]) -> Self {
        let axis = |k: usize| Vec4::new(a.lower[k], b.lower[k], -a.upper[k], -b.upper[k]);
        Self {
            axes: [axis(0), axis(1), axis(2)],
        }
    }

    /// One of the two, 0 or 1.
    #[inline]
    #[must_use]
    pub fn get(&self, index: usize) -> Aabb {
        let [x, y, z] = self.axes;
        Aabb {
            lower: Vec3::new(x[index], y[index], z[index]),
            upper: -Vec3::new(x[index + 2], y[index + 2], z[index + 2]),
        }
    }

    /// Sets one of the two, 0 or 1.
    #[inline]
    pub fn set(&mut self, index: usize, to: Aabb) {
        self.take(index, &Self::new([to; 2]));
    }

    /// Takes one of the two, 0 or 1, from another pair. Whole vectors are written: what is written
    /// in pieces and read as a whole waits for the cache.
    #[inline]
    pub fn take(&mut self, index: usize, from: &Self) {
        let is_first = index == 0;
        let chosen = BVec4A::new(is_first, !is_first, is_first, !is_first);
        for (axis, from) in self.axes.iter_mut().zip(from.axes) {
            *axis = Vec4::select(chosen, from, *axis);
        }
    }

    /// The smallest box around both.
    #[inline]
    #[must_use]
    pub fn union(&self) -> Aabb {
        let [x, y, z] = self.axes.map(|axis| axis.min(axis.yxwz()));
        Aabb {
            lower: Vec3::new(x.x, y.x, z.x),
            upper: -Vec3::new(x.z, y.z, z.z),
        }
    }

    /// Whether each shares a point with a box; boundary contact counts.
    #[inline]
    #[must_use]
    pub fn overlap(&self, query: &BoxQuery) -> [bool; 2] {
        let [x, y, z] = [0, 1, 2].map(|k| self.axes[k].cmple(query.axes[k]));
        let within = (x & y & z).bitmask();
        [within & 0b0101 == 0b0101, within & 0b1010 == 0b1010]
    }

    /// Which of the two are within a distance of a point or box; rounding excludes none.
    #[inline]
    #[must_use]
    pub fn within(&self, query: &BoxQuery, bound: BoxBound) -> Within {
        let squared = self.squared(query);
        Within {
            squared,
            which: squared.cmple(Vec4::splat(bound.0)).bitmask() & 0b11,
        }
    }

    /// Squared distances in the first two components, rounded either way.
    #[inline]
    fn squared(&self, query: &BoxQuery) -> Vec4 {
        // A point is beyond at most one of two sides: the other adds 0.
        let beyond = |k: usize| {
            let apart = (self.axes[k] - query.axes[k]).max(Vec4::ZERO);
            apart * apart
        };
        let sides = beyond(0) + beyond(1) + beyond(2);
        sides + sides.zwxy()
    }
}

/// The answer of [`BoxPair::within`].
#[derive(Debug, Clone, Copy)]
pub struct Within {
    squared: Vec4,
    which: u32,
}

impl Within {
    /// Whether the first is within.
    #[inline]
    #[must_use]
    pub fn first(&self) -> bool {
        self.which & 0b01 != 0
    }

    /// Whether the second is within.
    #[inline]
    #[must_use]
    pub fn second(&self) -> bool {
        self.which & 0b10 != 0
    }

    /// Squared distances of both, rounded either way; only for [`BoxBound::includes`].
    #[inline]
    #[must_use]
    pub fn squared(&self) -> [f32; 2] {
        [self.squared.x, self.squared.y]
    }
}

/// A squared distance to compare boxes with, enlarged so that rounding excludes no box at that
/// distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoxBound(f32);

/// Compensates the rounding of the bound itself and of a squared distance in f32: the five
/// roundings of a difference, its square and two sums are less than 4 units of 2^-23.
const GROW: f32 = 1.0 + 8.0 * f32::EPSILON;

impl BoxBound {
    /// Includes everything.
    pub const NONE: Self = Self(f32::INFINITY);

    /// The bound of a squared distance, not negative.
    #[inline]
    #[must_use]
    pub fn squared(bound: f64) -> Self {
        // The square of a very small number may be subnormal or 0.
        Self(bound as f32 * GROW + f32::MIN_POSITIVE)
    }

    /// Whether a distance of [`Within::squared`] is within the bound.
    #[inline]
    #[must_use]
    pub fn includes(self, squared: f32) -> bool {
        squared <= self.0
    }
}

impl BoxQuery {
    /// A point, finite.
    #[inline]
    #[must_use]
    pub fn point(point: DVec3) -> Self {
        Self::between(point, point)
    }

    /// A box by its smallest and its largest corner, finite.
    #[inline]
    #[must_use]
    pub fn between(low: DVec3, high: DVec3) -> Self {
        // One unit in the last place outwards in any case, which avoids an unpredictable branch.
        let max = DVec3::splat(f64::from(f32::MAX));
        let [low, high] = [low, high].map(|corner| corner.clamp(-max, max).as_vec3());
        let room = |corner: Vec3| corner.abs() * f32::EPSILON + Vec3::splat(f32::MIN_POSITIVE);
        let (below, above) = (low - room(low), high + room(high));
        let axis = |k: usize| Vec4::new(above[k], above[k], -below[k], -below[k]);
        Self {
            axes: [axis(0), axis(1), axis(2)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::widened;
    use proptest::prelude::*;

    fn number() -> impl Strategy<Value = f32> {
        prop_oneof![
            -1.0..1.0f32,
            (-1.0..1.0f32).prop_map(|x| x * 1e-30),
            (-1.0..1.0f32).prop_map(|x| x * 1e25),
            Just(0.0)
        ]
    }

    fn some_box() -> impl Strategy<Value = Aabb> {
        prop::array::uniform6(number()).prop_map(|[a, b, c, d, e, f]| {
            Aabb::of_points([Vec3::new(a, b, c), Vec3::new(d, e, f)])
        })
    }

    proptest! {
        #[test]
        fn boxes_come_out_as_they_went_in(a in some_box(), b in some_box(), c in some_box()) {
            let mut pair = BoxPair::new([a, b]);
            for (query, of) in [pair.query(0), pair.query(1)].iter().zip([a, b]) {
                prop_assert_eq!(query.axes, BoxQuery::around(&of).axes);
                let sides = of.upper - of.lower;
                let size = of.upper.abs().max_element() + of.lower.abs().max_element();
                prop_assert!((query.size() - sides.element_sum()).abs() <= 1e-6 * size);
            }
            prop_assert_eq!([pair.get(0), pair.get(1)], [a, b]);
            prop_assert_eq!(pair.union(), a.union(b));
            let joined = pair.joined();
            prop_assert_eq!([joined.get(0), joined.get(1)], [a.union(b); 2]);
            let mixed = BoxPair::mixed(&pair, &BoxPair::new([b, c]));
            prop_assert_eq!([mixed.get(0), mixed.get(1)], [a, c]);
            let wide = BoxPair::twice_widened(a.lower.into(), a.upper.into());
            let expected = widened(a.lower.into(), a.upper.into());
            prop_assert_eq!([wide.get(0), wide.get(1)], [expected; 2]);
            pair.set(1, c);
            prop_assert_eq!([pair.get(0), pair.get(1)], [a, c]);
            pair.set(0, b);
            prop_assert_eq!([pair.get(0), pair.get(1)], [b, c]);
        }

        #[test]
        fn boxes_within_a_distance_are_found_and_hardly_any_others(
            a in some_box(), b in some_box(),
            point in prop::array::uniform3(prop_oneof![-2.0..2.0f64, number().prop_map(f64::from)]),
        ) {
            let point = DVec3::from_array(point);
            let (pair, query) = (BoxPair::new([a, b]), BoxQuery::point(point));
            for (index, of) in [a, b].into_iter().enumerate() {
                let exact = of.distance_squared(point);
                let within = |bound: f64| {
                    let bound = BoxBound::squared(bound);
                    let found = pair.within(&query, bound);
                    let which = [found.first(), found.second()][index];
                    // A box that is put off is judged alike when it is looked at again.
                    assert_eq!(which, bound.includes(found.squared()[index]));
                    which
                };
                prop_assert!(within(exact), "{}", exact);
                prop_assert_eq!(pair.within(&query, BoxBound::NONE).which, 0b11);
                let size = point.abs().max_element().max(f64::from(of.upper.abs().max_element()));
                let size = size.max(f64::from(of.lower.abs().max_element()));
                let slack = 2e-6 * size * (exact.sqrt() + size) + 1e-37;
                if exact > slack && exact < f64::from(f32::MAX) {
                    prop_assert!(!within(exact - slack), "{} {}", exact, slack);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn boxes_overlap_when_they_do_and_when_rounding_cannot_tell(
            a in some_box(), b in some_box(), c in some_box(), nudge in -2i32..3,
        ) {
            // Corners between two neighbours in f32, or on one.
            let eighth = f64::from(nudge) * 0.25 * f64::from(f32::EPSILON);
            let [low, high] = [c.lower, c.upper].map(|p| p.as_dvec3() * (1.0 + eighth));
            let (low, high) = (low.min(high), low.max(high));
            let found = BoxPair::new([a, b]).overlap(&BoxQuery::between(low, high));
            let exact = BoxQuery::between(c.lower.as_dvec3(), c.upper.as_dvec3());
            let exactly = BoxPair::new([a, b]).overlap(&exact);
            for ((found, exactly), of) in found.into_iter().zip(exactly).zip([a, b]) {
                let (lower, upper) = (of.lower.as_dvec3(), of.upper.as_dvec3());
                let truth = lower.cmple(high).all() && upper.cmpge(low).all();
                prop_assert!(found || !truth);
                // Farther apart than two units in the last place of the box asked for, nothing
                // overlaps.
                let room = c.lower.abs().max(c.upper.abs()).as_dvec3() * 3e-7 + 1e-37;
                let apart = lower.cmpgt(c.upper.as_dvec3() + room).any()
                    || upper.cmplt(c.lower.as_dvec3() - room).any();
                prop_assert!(!(exactly && apart));
            }
        }
    }

    #[test]
    fn an_empty_box_is_farther_than_any_other() {
        let far = BoxPair::EMPTY.within(&BoxQuery::point(DVec3::ZERO), BoxBound::squared(1e38));
        assert!(!far.first() && !far.second());
        assert!(BoxPair::EMPTY.get(0).is_empty());
        let all = BoxQuery::between(DVec3::splat(-1e30), DVec3::splat(1e30));
        assert_eq!(BoxPair::EMPTY.overlap(&all), [false; 2]);
    }
}
