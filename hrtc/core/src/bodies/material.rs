//! Motion of the material of a body at a place.

use crate::contact::motion::{Placement, Twist};
use geometry::Pose;
use glam::DVec3;

/// Displacement (metres) and rotation (radians) of the material at a place (world, metres) from one
/// pose of its body to another.
///
/// The lever arm r of the place is relative to the mean of the two positions, so that the
/// displacement by the rotation, `ω × r`, is perpendicular to it. The chord from a start pose to an
/// end pose would point inwards, and a radial force would seem to do work.
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
