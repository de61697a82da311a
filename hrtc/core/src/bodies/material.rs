//! The motion of what lies at a place of a body.

use crate::contact::motion::{Placement, Twist};
use geometry::Pose;
use glam::DVec3;

/// By how much the material at a place (world, metres) moves from one pose of its body to another.
///
/// The place is taken to be where it is in the middle of the motion, so that what turns moves across its radius: a
/// chord would lead inwards, and a force along the radius would seem to do work.
#[must_use]
pub fn material_motion(before: &Pose, now: &Pose, at: DVec3) -> Twist {
    let placement = |pose: &Pose| Placement {
        centre: pose.position,
        orientation: pose.orientation,
    };
    let Twist { linear, angular } = placement(before).to(&placement(now));
    let arm = at - 0.5 * (before.position + now.position);
    Twist {
        linear: linear + angular.cross(arm),
        angular,
    }
}
