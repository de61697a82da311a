//! Whether and how two triangles meet: exact answers, no epsilon, no allocation.
//!
//! The signs of the corners about each other's plane decide most pairs; plain f64 with a bound of its rounding
//! gives them, Shewchuk's predicates where that is too near zero. Two triangles that each reach to both sides of the
//! other's plane meet where their intervals on the common line overlap, which two more signs tell (Devillers and
//! Guigue 2002, after Moeller 1997). All else, planes in common and corners in planes and triangles without area,
//! is decided in [`super::exact_contact`].

use super::exact_contact::{contact_in_plane, contact_of_degenerate, coplanar_contact};
use super::predicates::{side_of_plane, triangle_is_degenerate};
use glam::DVec3;
use std::cmp::Ordering::{self, Equal, Greater, Less};

/// How two closed triangles meet. The case is exact; the points carry the rounding of f64.
///
/// The case does not depend on the order of the two, on the order of their corners, or on scale, as long as the
/// products of three differences neither overflow (coordinates below 1e100) nor underflow (above 1e-70, or 0).
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
    /// They share only points of the rim of one of them: a point (`from == to`) or a segment.
    Touching {
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
    /// They meet, and at least one of them is a segment or a point.
    Degenerate {
        /// One end of what they share.
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

    /// A point of what they share.
    #[must_use]
    pub fn point(&self) -> Option<DVec3> {
        match *self {
            Self::Disjoint => None,
            Self::Crossing { from, to }
            | Self::Touching { from, to }
            | Self::Degenerate { from, to } => Some(0.5 * (from + to)),
            Self::Coplanar { centre } => Some(centre),
        }
    }
}

/// Coordinates beyond this would overflow the predicates: such triangles, and those that are not finite, meet nothing.
const LARGEST: f64 = 1e100;
/// Rounding of a plane distance from three differences, in units of the product of their largest components: each
/// difference, product and sum of the 3 x 2 terms adds half an ulp, 48 in all.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

fn in_range(a: [DVec3; 3], b: [DVec3; 3]) -> bool {
    // NaN fails the comparison.
    let within = |corner: &DVec3| corner.abs().cmplt(DVec3::splat(LARGEST)).all();
    a.iter().all(within) && b.iter().all(within)
}

/// Corners seen from a plane: exact signs, and distances times the length of the normal as f64 has them.
#[derive(Clone, Copy)]
struct Sides {
    signs: [Ordering; 3],
    distances: [f64; 3],
}

impl Sides {
    #[inline]
    fn of(plane: [DVec3; 3], corners: [DVec3; 3]) -> Self {
        let (u, v) = (plane[1] - plane[0], plane[2] - plane[0]);
        let normal = u.cross(v);
        let largest = u.abs().max_element() * v.abs().max_element() * ROUNDING;
        let offsets = corners.map(|corner| corner - plane[0]);
        let distances = offsets.map(|offset| normal.dot(offset));
        let mut signs = [Equal; 3];
        for k in 0..3 {
            let bound = largest * offsets[k].abs().max_element();
            signs[k] = if distances[k] > bound {
                Greater
            } else if distances[k] < -bound {
                Less
            } else {
                side_of_plane(plane[0], plane[1], plane[2], corners[k])
            };
        }
        Self { signs, distances }
    }

    #[inline]
    fn on_one_side(&self) -> bool {
        self.signs[0] != Equal && self.signs[0] == self.signs[1] && self.signs[1] == self.signs[2]
    }

    #[inline]
    fn on_both_sides(&self) -> bool {
        self.signs.contains(&Greater) && self.signs.contains(&Less)
    }

    /// The corner that no other corner is strictly on the side of.
    #[inline]
    fn lone(&self) -> usize {
        let lone = |k: usize| {
            let sign = self.signs[k];
            sign != Equal && self.signs[(k + 1) % 3] != sign && self.signs[(k + 2) % 3] != sign
        };
        if lone(0) {
            0
        } else if lone(1) {
            1
        } else {
            2
        }
    }

    /// Where the edge between two corners meets the plane.
    fn crossing(&self, corners: [DVec3; 3], from: usize, to: usize) -> DVec3 {
        let (near, far) = (self.distances[from].abs(), self.distances[to].abs());
        let sum = near + far;
        let fraction = if sum > 0.0 { near / sum } else { 0.5 };
        corners[from].lerp(corners[to], fraction)
    }
}

/// How two triangles meet.
#[must_use]
pub fn triangle_pair(a: [DVec3; 3], b: [DVec3; 3]) -> TrianglePair {
    let of_b = Sides::of(a, b);
    if of_b.on_one_side() {
        return TrianglePair::Disjoint;
    }
    let of_a = Sides::of(b, a);
    if of_a.on_one_side() {
        return TrianglePair::Disjoint;
    }
    if of_a.on_both_sides() && of_b.on_both_sides() {
        intervals_on_the_common_line(a, of_a, b, of_b)
    } else {
        special_position(a, of_a, b, of_b)
    }
}

/// Both reach to both sides of the other's plane.
fn intervals_on_the_common_line(
    a: [DVec3; 3],
    of_a: Sides,
    b: [DVec3; 3],
    of_b: Sides,
) -> TrianglePair {
    let (pa, pb) = (of_a.lone(), of_b.lone());
    let (mut qa, mut ra) = ((pa + 1) % 3, (pa + 2) % 3);
    let (mut qb, mut rb) = ((pb + 1) % 3, (pb + 2) % 3);
    // As if each lone corner were above the other's plane: turning a triangle over swaps its other two.
    if of_a.signs[pa] == Less {
        (qb, rb) = (rb, qb);
    }
    if of_b.signs[pb] == Less {
        (qa, ra) = (ra, qa);
    }
    let first = side_of_plane(a[pa], a[qa], b[pb], b[qb]);
    if first == Greater {
        return TrianglePair::Disjoint;
    }
    let second = side_of_plane(a[pa], a[ra], b[rb], b[pb]);
    if second == Greater {
        return TrianglePair::Disjoint;
    }
    if !in_range(a, b) {
        return TrianglePair::Disjoint;
    }
    let on_a = [of_a.crossing(a, pa, qa), of_a.crossing(a, pa, ra)];
    if first == Equal || second == Equal {
        let at = on_a[usize::from(first != Equal)];
        return TrianglePair::Touching { from: at, to: at };
    }
    let on_b = [of_b.crossing(b, pb, qb), of_b.crossing(b, pb, rb)];
    // The two inner ends of four on a line.
    let along = on_a[1] - on_a[0];
    let place = |point: DVec3| along.dot(point - on_a[0]);
    let (least, most) = if place(on_b[0]) <= place(on_b[1]) {
        (on_b[0], on_b[1])
    } else {
        (on_b[1], on_b[0])
    };
    TrianglePair::Crossing {
        from: if place(least) > 0.0 { least } else { on_a[0] },
        to: if place(most) < place(on_a[1]) {
            most
        } else {
            on_a[1]
        },
    }
}

/// A corner in a plane, a plane in common, or a triangle without area.
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
    // One of them only reaches up to the other's plane: what it has in that plane is a corner or an edge.
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
        Some([from, to]) => TrianglePair::Touching { from, to },
        None => TrianglePair::Disjoint,
    }
}

#[cfg(test)]
#[path = "triangle_pair_tests.rs"]
mod tests;
