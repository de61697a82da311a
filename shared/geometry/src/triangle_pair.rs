//! Intersection of two triangles: exact answers, no epsilon, no allocation.
//!
//! The signs of the corners about each other's plane decide most pairs. Plain f64 with a bound of
//! its rounding gives them, and Shewchuk's predicates where the value is too near zero. Two
//! triangles that both have corners on both sides of the other's plane meet where their intervals
//! on the common line overlap, which two more signs tell (Devillers and Guigue 2002, after Möller
//! 1997). The rest, common planes, corners in planes and triangles without area, is in
//! [`super::exact_contact`].

use super::exact_contact::{contact_in_plane, contact_of_degenerate, coplanar_contact};
use super::predicates::{side_of_plane, triangle_is_degenerate};
use glam::DVec3;
use std::cmp::Ordering::{self, Equal, Greater, Less};

/// Intersection of two closed triangles. The case is exact; the points have the rounding of f64.
///
/// The case does not depend on the order of the two, on the order of their corners, or on scale,
/// while the products of three differences neither overflow (coordinates below 1e100) nor underflow
/// (above 1e-70, or 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrianglePair {
    /// They share no point.
    Disjoint,
    /// Their inner points cross, in this segment.
    Crossing {
        /// One end.
        from: DVec3,
        /// The other end.
        to: DVec3,
    },
    /// They share only boundary points of one of them: a point (`from == to`) or a segment.
    Boundary {
        /// One end.
        from: DVec3,
        /// The other end.
        to: DVec3,
    },
    /// They lie in one plane and overlap in an area.
    Coplanar {
        /// A point of the area.
        centre: DVec3,
    },
    /// They share a point, and at least one of them is a segment or a point.
    Degenerate {
        /// One end of the intersection.
        from: DVec3,
        /// The other end.
        to: DVec3,
    },
}

impl TrianglePair {
    /// Whether they share a point.
    #[inline]
    #[must_use]
    pub fn meets(&self) -> bool {
        !matches!(self, Self::Disjoint)
    }

    /// A point of the intersection.
    #[must_use]
    pub fn point(&self) -> Option<DVec3> {
        match *self {
            Self::Disjoint => None,
            Self::Crossing { from, to }
            | Self::Boundary { from, to }
            | Self::Degenerate { from, to } => Some(0.5 * (from + to)),
            Self::Coplanar { centre } => Some(centre),
        }
    }
}

/// Largest coordinate: beyond it the predicates overflow. Larger or non-finite triangles meet
/// nothing.
const MAX_COORDINATE: f64 = 1e100;
/// Rounding of a plane distance from three differences, in units of the product of their largest
/// components: each difference, product and sum of the 3 x 2 terms adds half an ulp, 48 in all.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

fn in_range(a: [DVec3; 3], b: [DVec3; 3]) -> bool {
    // NaN fails the comparison.
    let within = |corner: &DVec3| corner.abs().cmplt(DVec3::splat(MAX_COORDINATE)).all();
    a.iter().all(within) && b.iter().all(within)
}

/// Distances of corners from a plane, times the length of its normal, each with an error up to
/// `rounding`.
///
/// Decisions use no branch for each corner: its side is random, and a mispredicted branch costs
/// more than all the arithmetic of a pair.
#[derive(Clone, Copy)]
struct Distances {
    of: [f64; 3],
    rounding: f64,
}

impl Distances {
    #[inline]
    fn from(plane: &Facet, corners: &[DVec3; 3]) -> Self {
        let offsets = corners.map(|corner| corner - plane.corners[0]);
        let [p, q, r] = offsets.map(DVec3::abs);
        Self {
            of: offsets.map(|offset| plane.normal.dot(offset)),
            rounding: plane.rounding * p.max(q).max(r).max_element(),
        }
    }

    /// Whether all corners are strictly on one side in spite of rounding.
    #[inline]
    fn surely_on_one_side(&self) -> bool {
        let [x, y, z] = self.of;
        let above = (x > self.rounding) & (y > self.rounding) & (z > self.rounding);
        let below = (x < -self.rounding) & (y < -self.rounding) & (z < -self.rounding);
        above | below
    }

    /// Whether the sides of all corners are certain in spite of rounding.
    #[inline]
    fn surely_off(&self) -> bool {
        let [x, y, z] = self.of.map(|distance| distance.abs() > self.rounding);
        x & y & z
    }

    /// The sides of corners that are surely off the plane.
    #[inline]
    fn sides(self) -> Sides {
        let signs = self.of.map(|d| if d > 0.0 { Greater } else { Less });
        Sides {
            signs,
            distances: self.of,
        }
    }

    /// The sides of the corners, by exact predicates where rounding matters.
    fn exact_sides(self, plane: [DVec3; 3], corners: [DVec3; 3]) -> Sides {
        let mut signs = self.sides().signs;
        for k in 0..3 {
            // NaN is not sure.
            let sure = self.of[k].abs() > self.rounding;
            if !sure {
                signs[k] = side_of_plane(plane[0], plane[1], plane[2], corners[k]);
            }
        }
        Sides {
            signs,
            distances: self.of,
        }
    }
}

/// Sides of corners about a plane: exact signs, and distances times the length of the normal in
/// f64.
#[derive(Clone, Copy)]
struct Sides {
    signs: [Ordering; 3],
    distances: [f64; 3],
}

impl Sides {
    fn on_one_side(&self) -> bool {
        self.signs[0] != Equal && self.signs[0] == self.signs[1] && self.signs[1] == self.signs[2]
    }

    fn on_both_sides(&self) -> bool {
        self.signs.contains(&Greater) && self.signs.contains(&Less)
    }

    /// The corner that is alone on its side.
    #[inline]
    fn lone(&self) -> usize {
        let lone = |k: usize| {
            let sign = self.signs[k];
            let (next, last) = (self.signs[NEXT[k]], self.signs[LAST[k]]);
            (sign != Equal) & (next != sign) & (last != sign)
        };
        let of_the_others = if lone(1) { 1 } else { 2 };
        if lone(0) { 0 } else { of_the_others }
    }

    /// Intersection of the edge between two corners with the plane.
    #[inline]
    fn crossing(&self, corners: [DVec3; 3], from: usize, to: usize) -> DVec3 {
        let (near, far) = (self.distances[from].abs(), self.distances[to].abs());
        let sum = near + far;
        let fraction = if sum > 0.0 { near / sum } else { 0.5 };
        corners[from].lerp(corners[to], fraction)
    }
}

/// The corner after each.
const NEXT: [usize; 3] = [1, 2, 0];
/// The corner before each.
const LAST: [usize; 3] = [2, 0, 1];

/// A triangle and its plane, for several pairs with it.
#[derive(Debug, Clone, Copy)]
pub struct Facet {
    corners: [DVec3; 3],
    /// Not normalised.
    normal: DVec3,
    /// Rounding of [`Distances`], over the largest component of the third difference.
    rounding: f64,
}

impl Facet {
    /// A point: the content of an unused place.
    pub const NOWHERE: Self = Self {
        corners: [DVec3::ZERO; 3],
        normal: DVec3::ZERO,
        rounding: 0.0,
    };

    /// Accepts any numbers; a triangle that is not finite meets nothing.
    #[inline]
    #[must_use]
    pub fn new(corners: [DVec3; 3]) -> Self {
        let (u, v) = (corners[1] - corners[0], corners[2] - corners[0]);
        Self {
            corners,
            normal: u.cross(v),
            rounding: u.abs().max_element() * v.abs().max_element() * ROUNDING,
        }
    }

    /// Intersection with another triangle.
    #[inline]
    #[must_use]
    pub fn pair_with(&self, other: &Self) -> TrianglePair {
        let of_other = Distances::from(self, &other.corners);
        let of_own = Distances::from(other, &self.corners);
        if of_other.surely_on_one_side() | of_own.surely_on_one_side() {
            return TrianglePair::Disjoint;
        }
        let (a, b) = (self.corners, other.corners);
        if of_own.surely_off() & of_other.surely_off() {
            return intervals_on_the_common_line(a, of_own.sides(), b, of_other.sides());
        }
        near_a_plane(a, of_own, b, of_other)
    }
}

/// Intersection of two triangles.
#[must_use]
pub fn triangle_pair(a: [DVec3; 3], b: [DVec3; 3]) -> TrianglePair {
    Facet::new(a).pair_with(&Facet::new(b))
}

/// Pairs with a corner so near to the plane of the other that f64 does not decide its side.
#[cold]
fn near_a_plane(a: [DVec3; 3], of_a: Distances, b: [DVec3; 3], of_b: Distances) -> TrianglePair {
    let (of_a, of_b) = (of_a.exact_sides(b, a), of_b.exact_sides(a, b));
    if of_a.on_one_side() || of_b.on_one_side() {
        TrianglePair::Disjoint
    } else if of_a.on_both_sides() && of_b.on_both_sides() {
        intervals_on_the_common_line(a, of_a, b, of_b)
    } else {
        special_position(a, of_a, b, of_b)
    }
}

/// Pairs with corners on both sides of each other's plane.
fn intervals_on_the_common_line(
    a: [DVec3; 3],
    of_a: Sides,
    b: [DVec3; 3],
    of_b: Sides,
) -> TrianglePair {
    let (pa, pb) = (of_a.lone(), of_b.lone());
    // Brings each lone corner above the other's plane: flipping a triangle swaps its other two
    // corners.
    let others = |lone: usize, turned: bool| {
        let (next, last) = (NEXT[lone], LAST[lone]);
        if turned { (last, next) } else { (next, last) }
    };
    let (qa, ra) = others(pa, of_b.signs[pb] == Less);
    let (qb, rb) = others(pb, of_a.signs[pa] == Less);
    // Sides of b's corners about the planes through a's lone corner and one edge of each triangle.
    let (u, v) = (a[qa] - a[pa], a[ra] - a[pa]);
    let [p, q, r] = [pb, qb, rb].map(|k| b[k] - a[pa]);
    let of_first = u.cross(p).dot(q);
    let of_second = v.cross(r).dot(p);
    let largest = p.abs().max(q.abs()).max(r.abs());
    let extent = largest.max_element();
    let rounding = u.abs().max(v.abs()).max_element() * extent * extent * ROUNDING;
    if (of_first > rounding) | (of_second > rounding) {
        return TrianglePair::Disjoint;
    }
    if !in_range(a, b) {
        return TrianglePair::Disjoint;
    }
    let on_a = [of_a.crossing(a, pa, qa), of_a.crossing(a, pa, ra)];
    let surely = (of_first < -rounding) & (of_second < -rounding);
    if !surely {
        let first = side_of_plane(a[pa], a[qa], b[pb], b[qb]);
        let second = side_of_plane(a[pa], a[ra], b[rb], b[pb]);
        if first == Greater || second == Greater {
            return TrianglePair::Disjoint;
        }
        if first == Equal || second == Equal {
            let at = on_a[usize::from(first != Equal)];
            return TrianglePair::Boundary { from: at, to: at };
        }
    }
    let on_b = [of_b.crossing(b, pb, qb), of_b.crossing(b, pb, rb)];
    // The two inner ones of four ends on a line.
    let along = on_a[1] - on_a[0];
    let along_line = |point: DVec3| along.dot(point - on_a[0]);
    let (first, last) = if along_line(on_b[0]) <= along_line(on_b[1]) {
        (on_b[0], on_b[1])
    } else {
        (on_b[1], on_b[0])
    };
    TrianglePair::Crossing {
        from: if along_line(first) > 0.0 {
            first
        } else {
            on_a[0]
        },
        to: if along_line(last) < along_line(on_a[1]) {
            last
        } else {
            on_a[1]
        },
    }
}

/// Pairs with a corner in a plane, a common plane, or a triangle without area.
#[cold]
fn special_position(a: [DVec3; 3], of_a: Sides, b: [DVec3; 3], of_b: Sides) -> TrianglePair {
    if !in_range(a, b) {
        return TrianglePair::Disjoint;
    }
    let flat = |t: [DVec3; 3]| triangle_is_degenerate(t[0], t[1], t[2]);
    if flat(a) || flat(b) {
        return match contact_of_degenerate(a, b) {
            Some([from, to]) => TrianglePair::Degenerate { from, to },
            None => TrianglePair::Disjoint,
        };
    }
    if of_b.signs == [Equal; 3] {
        return coplanar_contact(a, b);
    }
    // One of them has only a corner or an edge in the other's plane.
    let (part_of, signs, whole) = if of_a.on_both_sides() {
        (b, of_b.signs, a)
    } else {
        (a, of_a.signs, b)
    };
    let mut part = [DVec3::ZERO; 3];
    let mut count = 0;
    for k in 0..3 {
        if signs[k] == Equal {
            part[count] = part_of[k];
            count += 1;
        }
    }
    match contact_in_plane(&part[..count], whole) {
        Some([from, to]) => TrianglePair::Boundary { from, to },
        None => TrianglePair::Disjoint,
    }
}

#[cfg(test)]
#[path = "triangle_pair_tests.rs"]
mod tests;
