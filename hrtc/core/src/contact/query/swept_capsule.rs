//! A capsule that moves along a segment without turning: how far it gets before it touches a face.
//!
//! The distance from a segment that moves along a line to a triangle is a convex function of the parameter, as it is for a
//! point, so Newton's method of `swept_sphere` serves both. Boxes are asked in the order in which the capsule can reach
//! them, and what the first of those not asked says is the bound of an answer that ran out of budget.

use super::slanting::ROUNDING;
use super::swept_sphere::{first_within, touching_gap};
use super::{Capsule, Ending, STACK, Surface, Work};
use ab_tree::Child;
use geometry::{
    Aabb, ClosestPair, closest_point_on_triangle, closest_points_of_segment_and_triangle,
};
use glam::DVec3;
use spm::Handle;

/// The first touch of a swept capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapsuleTouch {
    /// Fraction of the motion that is free, 0..1.
    pub fraction: f64,
    /// The face touched.
    pub face: Handle,
    /// The point of the axis, where it is then, closest to the face.
    pub on_axis: DVec3,
    /// The point of the face closest to the axis.
    pub on_face: DVec3,
    /// From the face to the axis, unit length. Where the axis meets the face it is the face's normal, and where that has
    /// none the way back.
    pub normal: DVec3,
}

/// The answer of [`swept_capsule`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptCapsule {
    /// The first touch found; `None` when the capsule gets through, or the budget was spent before.
    pub touch: Option<CapsuleTouch>,
    /// Fraction of the motion before which no face is touched, whatever the ending, 0..1.
    pub free: f64,
    /// Whether the touch is the first of all.
    pub ending: Ending,
    /// What it cost.
    pub work: Work,
}

/// The first touch of a capsule (model frame and units) that moves by `motion`; of no length it is a sphere, and the answer
/// that of [`super::swept_sphere()`].
///
/// A face in the capsule at the start stops it only if the motion goes towards that face, or if the axis meets it. When
/// `budget` nodes were visited the ending says so, and `free` still is no more than the truth. A capsule or a motion that is
/// not finite, or a negative radius, touches nothing and has nothing free.
#[must_use]
pub fn swept_capsule(
    surface: Surface<'_>,
    capsule: Capsule,
    motion: DVec3,
    budget: u32,
) -> SweptCapsule {
    let mut work = Work::default();
    let mut ending = Ending::Complete;
    let Capsule { axis, radius } = capsule;
    let is_capsule = axis.iter().all(|end| end.is_finite()) && (0.0..f64::MAX).contains(&radius);
    if !(is_capsule && motion.is_finite()) {
        return SweptCapsule {
            touch: None,
            free: 0.0,
            ending,
            work,
        };
    }
    let touch = touching_gap(axis[0].abs().max(axis[1].abs()), motion, radius);
    let sweep = Sweep::new(capsule, motion, touch);
    let mut best: Option<(f64, Handle)> = None;
    let mut free = 1.0;
    let mut stack = [(0.0, Child::Node(0)); STACK];
    let mut count = 0;
    if let Some(root) = surface.tree.root() {
        stack[0] = (0.0, root);
        count = 1;
    }
    while count > 0 {
        count -= 1;
        let (entry, child) = stack[count];
        if best.is_some() && entry >= free {
            continue;
        }
        match child {
            Child::Face(face) => {
                work.faces += 1;
                let corners = surface.mesh.corners(face);
                let reached = first_within(motion, [radius, touch], free, |shift| {
                    let closest = closest_to_face(axis, shift, corners);
                    let [on_axis, on_face] = closest.points;
                    (on_axis - on_face, closest.distance_squared)
                });
                if let Some(fraction) = reached {
                    free = fraction;
                    best = Some((fraction, face));
                }
            }
            Child::Node(_) if work.nodes == budget => {
                count += 1;
                let unvisited = count as u32;
                ending = Ending::OutOfBudget { unvisited };
                break;
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let children = node.children();
                let entries = [0, 1].map(|k| sweep.entry(&node.boxes().get(k)));
                let first = usize::from(entries[1] < entries[0]);
                for side in [1 - first, first] {
                    if entries[side] <= free {
                        stack[count] = (entries[side], children[side]);
                        count += 1;
                    }
                }
            }
        }
    }
    let touch = best.map(|found| {
        let corners = surface.mesh.corners(found.1);
        touch_of(corners, axis, motion, touch, found)
    });
    let open = stack[..count].iter();
    SweptCapsule {
        touch,
        free: open.fold(free, |least, &(entry, _)| least.min(entry)),
        ending,
        work,
    }
}

/// The closest points of an axis that was moved and a face.
#[inline]
fn closest_to_face(axis: [DVec3; 2], shift: DVec3, corners: [DVec3; 3]) -> ClosestPair {
    let moved = axis.map(|end| end + shift);
    if axis[0] == axis[1] {
        let closest = closest_point_on_triangle(corners, moved[0]);
        return ClosestPair {
            points: [moved[0], closest.point],
            distance_squared: closest.distance_squared,
        };
    }
    closest_points_of_segment_and_triangle(moved, corners)
}

/// What is known about the touch of a face; closer than `touch` there is no direction from it to the axis.
fn touch_of(
    corners: [DVec3; 3],
    axis: [DVec3; 2],
    motion: DVec3,
    touch: f64,
    (fraction, face): (f64, Handle),
) -> CapsuleTouch {
    let [on_axis, on_face] = closest_to_face(axis, motion * fraction, corners).points;
    let offset = on_axis - on_face;
    let normal = if offset.length() > touch {
        offset.normalize_or_zero()
    } else {
        let [a, b, c] = corners;
        let across = (b - a).cross(c - a).normalize_or_zero();
        across * -across.dot(motion).signum()
    };
    CapsuleTouch {
        fraction,
        face,
        on_axis,
        on_face,
        normal: normal
            .try_normalize()
            .unwrap_or(-motion.normalize_or_zero()),
    }
}

/// All that the capsule passes over, as boxes are held against it.
struct Sweep {
    /// The box around the capsule at the start.
    low: DVec3,
    high: DVec3,
    motion: DVec3,
    start: DVec3,
    reach: f64,
    /// Directions that may separate a box from the parallelogram that the axis passes over, besides those of the box: normal
    /// to one of its sides and an edge of the box, and its own normal. With each the range of the parallelogram along it.
    directions: [(DVec3, f64, f64); 7],
}

impl Sweep {
    fn new(Capsule { axis, radius }: Capsule, motion: DVec3, touch: f64) -> Self {
        let [start, end] = axis;
        let way = end - start;
        // A face counts as touched a little before it is.
        let reach = radius + 2.0 * touch;
        let [x, y, z] = DVec3::AXES;
        let directions = [
            way.cross(x),
            way.cross(y),
            way.cross(z),
            motion.cross(x),
            motion.cross(y),
            motion.cross(z),
            way.cross(motion),
        ];
        let directions = directions.map(|direction| {
            let [of_way, of_motion] = [way, motion].map(|side| direction.dot(side));
            let low = of_way.min(0.0) + of_motion.min(0.0);
            let high = of_way.max(0.0) + of_motion.max(0.0);
            (direction, low, high)
        });
        Self {
            low: start.min(end) - reach,
            high: start.max(end) + reach,
            motion,
            start,
            reach,
            directions,
        }
    }

    /// A fraction of the motion before which no face in a box is touched; infinity when none is.
    fn entry(&self, aabb: &Aabb) -> f64 {
        let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
        let room = ROUNDING * (lower.abs() + upper.abs() + self.low.abs() + self.high.abs());
        let (before, beyond) = (lower - self.high - room, upper - self.low + room);
        let (mut entry, mut exit) = (0.0f64, 1.0f64);
        for k in 0..3 {
            let speed = self.motion[k];
            if speed == 0.0 {
                if before[k] > 0.0 || beyond[k] < 0.0 {
                    return f64::INFINITY;
                }
                continue;
            }
            let (one, other) = (before[k] / speed, beyond[k] / speed);
            entry = entry.max(one.min(other) * (1.0 - ROUNDING));
            exit = exit.min(one.max(other) * (1.0 + ROUNDING));
        }
        if entry > exit || self.passes_beside(lower, upper) {
            return f64::INFINITY;
        }
        entry
    }

    /// Whether one of the directions separates the box from all that the capsule passes over, beyond rounding.
    fn passes_beside(&self, lower: DVec3, upper: DVec3) -> bool {
        let half = 0.5 * (upper - lower) + self.reach;
        let between = 0.5 * (lower + upper) - self.start;
        let size = between.abs() + half + self.start.abs();
        self.directions.iter().any(|&(direction, low, high)| {
            let along = direction.abs();
            let place = direction.dot(between);
            let room = ROUNDING * (along.dot(size) + high - low);
            let extent = along.dot(half) + room;
            place - extent > high || place + extent < low
        })
    }
}
