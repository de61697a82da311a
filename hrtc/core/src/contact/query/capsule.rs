//! A capsule against the front: a segment with a radius.

use super::{Ending, NearestToSegment, Surface, Work, closest_to_segment, faces_near_segment};
use glam::DVec3;
use spm::Handle;
use std::ops::ControlFlow;

/// A capsule in the model's frame and units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// Ends of its axis.
    pub axis: [DVec3; 2],
    /// Its radius.
    pub radius: f64,
}

/// A face at a capsule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapsuleContact {
    /// The face.
    pub face: Handle,
    /// Distance of the capsule's surface to the face: negative by its depth in the capsule, `-radius` where the axis
    /// meets the face, whatever the side that the axis lies on.
    pub distance: f64,
    /// The point of the axis closest to the face.
    pub on_axis: DVec3,
    /// The point of the face closest to the axis.
    pub on_face: DVec3,
}

impl Capsule {
    fn contact(&self, nearest: NearestToSegment) -> CapsuleContact {
        let [on_axis, on_face] = nearest.closest.points;
        CapsuleContact {
            face: nearest.face,
            distance: nearest.closest.distance_squared.sqrt() - self.radius,
            on_axis,
            on_face,
        }
    }
}

/// The answer of [`closest_to_capsule`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestToCapsule {
    /// The closest or deepest face found.
    pub contact: Option<CapsuleContact>,
    /// No face is nearer than this, whatever the ending; at least `-radius`.
    pub at_least: f64,
    /// Whether the contact is the closest of all.
    pub ending: Ending,
    /// What it cost.
    pub work: Work,
}

/// The face closest to a capsule, or deepest in it; see [`closest_to_segment`].
#[must_use]
pub fn closest_to_capsule(
    surface: Surface<'_>,
    capsule: Capsule,
    budget: u32,
    hint: Option<Handle>,
) -> ClosestToCapsule {
    let found = closest_to_segment(surface, capsule.axis, budget, hint);
    ClosestToCapsule {
        contact: found.nearest.map(|nearest| capsule.contact(nearest)),
        at_least: found.at_least - capsule.radius,
        ending: found.ending,
        work: found.work,
    }
}

/// Calls `visit` with every face within `margin` of a capsule's surface or in it, until it breaks or `budget` nodes
/// were visited.
pub fn faces_near_capsule(
    surface: Surface<'_>,
    capsule: Capsule,
    margin: f64,
    budget: u32,
    mut visit: impl FnMut(CapsuleContact) -> ControlFlow<()>,
) -> (Ending, Work) {
    let distance = capsule.radius + margin;
    faces_near_segment(surface, capsule.axis, distance, budget, |nearest| {
        visit(capsule.contact(nearest))
    })
}
