//! First contact of a moving sphere with the front.
//!
//! The distance of a point on a line from a triangle is a convex function of the parameter. So
//! Newton's method on `distance - radius` from the start never passes the first root: every iterate
//! is a safe position, and cylinders, edges and vertices need no cases.

use super::{Stack, Surface, Work};
use ab_tree::Child;
use geometry::{Aabb, BoxQuery, closest_point_on_triangle};
use glam::DVec3;
use spm::Handle;

/// First contact of a swept sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepHit {
    /// Free fraction of the motion, 0 to 1.
    pub fraction: f64,
    /// The face.
    pub face: Handle,
}

/// Newton steps per face; the last iterate is short of the contact, so safe.
const STEPS: usize = 24;
/// Relative rounding error of positions and of a separating-axis test, with a margin.
const ROUNDING: f64 = 32.0 * f64::EPSILON;
/// Gap that counts as contact, as a fraction of the radius; see [`contact_gap`].
const CONTACT_GAP: f64 = 1e-9;

/// The first touch of a sphere of `radius` moving from `start` by `motion`; `None` when it gets
/// through.
///
/// A face that overlaps the sphere at the start stops it only if the motion approaches that face.
/// The contact of a sphere of radius 0 may be lost in rounding on an oblique motion.
#[must_use]
pub fn swept_sphere(
    surface: Surface<'_>,
    start: DVec3,
    motion: DVec3,
    radius: f64,
) -> (Option<SweepHit>, Work) {
    let (hit, _, work) = swept_sphere_budget(surface, (start, motion), radius, u32::MAX);
    (hit, work)
}

/// The same, but no node or face is begun after `max_work` of them. Returns as well the share of
/// the motion that is free: up to the hit, or up to the nearest of what was not visited, whatever
/// its direction.
#[must_use]
pub fn swept_sphere_budget(
    surface: Surface<'_>,
    (start, motion): (DVec3, DVec3),
    radius: f64,
    max_work: u32,
) -> (Option<SweepHit>, f64, Work) {
    let mut work = Work::default();
    let mut best: Option<SweepHit> = None;
    // A face counts as contact slightly before it is reached.
    let reach = radius + 2.0 * contact_gap(start, motion, radius);
    let mut fraction = 1.0;
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    while let Some(child) = next {
        if work.nodes + work.faces >= max_work {
            let room = stack.distance_squared(surface, child, start).sqrt() - reach;
            // Without a motion and without room the quotient is no number: nothing is free.
            let free = (room / motion.length()).max(0.0).min(fraction);
            return (best.filter(|hit| hit.fraction <= free), free, work);
        }
        next = match child {
            Child::Face(face) => {
                work.faces += 1;
                let corners = surface.mesh.corners(face);
                if let Some(t) = first_contact(corners, start, motion, radius, fraction) {
                    fraction = t;
                    best = Some(SweepHit { fraction: t, face });
                }
                None
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let end = start + motion * fraction;
                let (low, high) = (start.min(end) - reach, start.max(end) + reach);
                let met = node.boxes().overlap(&BoxQuery::between(low, high));
                let is_in_path = |side: usize| {
                    met[side] && !misses_box(&node.boxes().get(side), start, end, reach)
                };
                stack.descend([is_in_path(0), is_in_path(1)], node.children())
            }
        };
        if next.is_none() {
            next = stack.pop().map(|(_, child)| child);
        }
    }
    (best, fraction, work)
}

/// Whether the plane of an edge direction of the box and the segment separates them, beyond
/// rounding.
fn misses_box(aabb: &Aabb, start: DVec3, end: DVec3, reach: f64) -> bool {
    let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
    let half = 0.5 * (upper - lower) + reach;
    let between = 0.5 * (lower + upper) - start;
    gaps_across(between, half, end - start).max_element() > 0.0
}

/// Gaps between a box and a segment along `motion` x X, `motion` x Y and `motion` x Z, times the
/// lengths of these; 0 within rounding. `between` leads from the segment's start to the centre of
/// the box, `half` is half its extent. The box of an oblique segment is much larger than the
/// segment, so these axes are tested too.
#[inline]
fn gaps_across(between: DVec3, half: DVec3, motion: DVec3) -> DVec3 {
    let (along, apart) = (motion.abs(), between.abs());
    let gap = |one: usize, other: usize| {
        let product = between[one] * motion[other] - between[other] * motion[one];
        let most = half[one] * along[other] + half[other] * along[one];
        let rounding = apart[one] * along[other] + apart[other] * along[one];
        (product.abs() - most - ROUNDING * (most + rounding)).max(0.0)
    };
    DVec3::new(gap(1, 2), gap(2, 0), gap(0, 1))
}

/// First parameter below `limit` at which the sphere touches the triangle.
pub(super) fn first_contact(
    corners: [DVec3; 3],
    start: DVec3,
    motion: DVec3,
    radius: f64,
    limit: f64,
) -> Option<f64> {
    let gap_of_contact = contact_gap(start, motion, radius);
    first_within(motion, [radius, gap_of_contact], limit, |shift| {
        let centre = start + shift;
        let closest = closest_point_on_triangle(corners, centre);
        (centre - closest.point, closest.distance_squared)
    })
}

/// Gap that counts as contact: a fraction of the radius, or rounding if that is more.
fn contact_gap(start: DVec3, motion: DVec3, radius: f64) -> f64 {
    let size = (start.abs() + motion.abs()).max_element();
    (CONTACT_GAP * radius).max(ROUNDING * size)
}

/// First parameter below `limit` at which a convex body that moves by `motion` is within `radius`
/// of a convex body at rest, up to a gap that counts as contact; `None` if it does not come near or
/// only moves away.
///
/// `apart` maps a displacement to the vector from the resting to the moving body and the squared
/// distance.
#[inline]
fn first_within(
    motion: DVec3,
    [radius, gap_of_contact]: [f64; 2],
    limit: f64,
    apart: impl Fn(DVec3) -> (DVec3, f64),
) -> Option<f64> {
    let mut t = 0.0;
    for _ in 0..STEPS {
        let (offset, distance_squared) = apart(motion * t);
        let distance = distance_squared.sqrt();
        let gap = distance - radius;
        // It approached until here; the remaining gap is rounding.
        if t > 0.0 && gap <= gap_of_contact {
            return Some(t);
        }
        // Rate of the distance along the motion; negative while approaching. A point on the face
        // has no direction: it counts as stopped.
        let rate = if distance > 0.0 {
            offset.dot(motion) / distance
        } else {
            f64::NEG_INFINITY
        };
        if rate >= 0.0 {
            return None;
        }
        if gap <= gap_of_contact {
            return Some(t);
        }
        t -= gap / rate;
        if t >= limit {
            return None;
        }
    }
    Some(t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        /// The position found touches the face, and no sampled position before it overlaps it.
        #[test]
        fn the_touch_is_the_first(
            corners in prop::array::uniform3(vector()),
            start in vector(), end in vector(),
            radius in 0.01..0.3f64, exponent in -6..6i32,
        ) {
            let s = 10f64.powi(exponent);
            let (corners, start, motion, radius) =
                (corners.map(|c| c * s), start * s, (end - start) * s, radius * s);
            let gap = |t: f64| {
                closest_point_on_triangle(corners, start + motion * t).distance_squared.sqrt() - radius
            };
            prop_assume!(gap(0.0) > 0.0);
            match first_contact(corners, start, motion, radius, 1.0) {
                Some(t) => {
                    prop_assert!(gap(t) >= -1e-9 * radius && gap(t) < 1e-3 * radius, "{}", gap(t) / radius);
                    for k in 0..100 {
                        prop_assert!(gap(t * f64::from(k) / 100.0) >= -1e-9 * radius);
                    }
                }
                None => {
                    for k in 0..=100 {
                        prop_assert!(gap(f64::from(k) / 100.0) >= -1e-8 * radius);
                    }
                }
            }
        }
    }
}
