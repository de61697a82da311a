//! The strongest touch from near, in axes that go with it, so that a camera at rest looks at the
//! touched side.

use super::super::moment::{Moment, ShownFace, ShownObject};
use super::super::sight::{Sight, half_width, upwards};
use super::layout::Eye;
use super::shapes::{EDGE_BYTES, FACE_BYTES, color, edges, largest_error, mesh, transform};
use super::space::Arrows;
use geometry::{Pose, closest_point_on_triangle};
use glam::{DMat3, DQuat, DVec3};
use rerun::{RecordingStream, RecordingStreamResult};
use scene::ProbeShape;

/// Share of the way to the normal, and to the width of a new touch, that the view goes in a
/// picture.
const TURN: f64 = 0.35;
/// Lengths of arrows, as shares of half the view's width.
const FORCE_SHARE: f64 = 2.5;
const NORMAL_SHARE: f64 = 0.3;
/// The camera of this view, in half widths: it sees the normal from the side.
pub const NEAR_EYE: Eye = Eye {
    position: DVec3::new(0.0, -1.7, 1.2),
    target: DVec3::new(0.0, 0.0, 0.1),
    up: DVec3::Z,
};
/// The entity whose axes go with the touch.
const AXES: &str = "touch/axes";

/// The view from near.
#[derive(Debug, Default)]
pub struct Near {
    /// The object that was touched last.
    pub object: Option<usize>,
    /// The probe that is seen, while it touches.
    probe: Option<usize>,
    /// Whether it touched in the picture before.
    was_touching: bool,
    sight: Option<Sight>,
    half_width: Option<f64>,
}

impl Near {
    /// The probe to be seen: the strongest one, and that until its touch ends.
    pub fn probe(&mut self, moment: &Moment) -> usize {
        let is_touching = |&k: &usize| moment.probes[k].touch.is_some();
        if let Some(k) = self.probe.filter(is_touching) {
            return k;
        }
        let strongest = moment.strongest();
        if is_touching(&strongest) && self.probe != Some(strongest) {
            // Another place: nothing to go on from.
            (self.sight, self.half_width) = (None, None);
            self.probe = Some(strongest);
        }
        self.probe.unwrap_or(strongest)
    }

    /// Shows the surface around a probe; the entity for the probe, lengths of its arrows, and bytes
    /// of meshes sent.
    ///
    /// # Errors
    /// When the stream refuses.
    pub fn show(
        &mut self,
        stream: &RecordingStream,
        moment: &Moment,
        probe: usize,
        shape: &ProbeShape,
    ) -> RecordingStreamResult<(&'static str, Arrows, usize)> {
        let shown = &moment.probes[probe];
        let at = shown.position().unwrap_or_default();
        if let Some(touch) = &shown.touch {
            self.object = Some(touch.object);
            let goal = half_width(moment, shown, shape);
            let half = self
                .half_width
                .map_or(goal, |half| half + TURN * (goal - half));
            self.half_width = Some(half);
            let before = self.sight.map(|sight| {
                let up = sight.up.lerp(upwards(shown), TURN);
                sight.turned_to(up.normalize_or(sight.up))
            });
            // Another side is chosen between two touches only: else the camera would jump.
            let kept = before.filter(|of| self.was_touching || of.is_free(moment, shown, half));
            self.sight = Some(kept.unwrap_or_else(|| Sight::of_probe(moment, shown, half)));
        }
        self.was_touching = shown.touch.is_some();
        let half_width = self.half_width.unwrap_or_else(|| shape.extent_m());
        // The probe comes to the origin, the eye to its place, half the width to 1.
        let turn = self.sight.map_or(DQuat::IDENTITY, |of| turn_to_eye(&of));
        let axes = Pose {
            position: -(turn * at) / half_width,
            orientation: turn,
        };
        let scale = (1.0 / half_width) as f32;
        stream.log(AXES, &transform(&axes).with_scale(scale))?;
        let bytes = show_patch(stream, moment.objects.first(), at, half_width)?;
        let arrows = Arrows {
            force: FORCE_SHARE * half_width,
            normal: NORMAL_SHARE * half_width,
        };
        Ok((AXES, arrows, bytes))
    }
}

/// The turn of the world that brings the eye of a sight to the camera, and upwards upwards.
fn turn_to_eye(sight: &Sight) -> DQuat {
    let axes = |eye: DVec3, up: DVec3| {
        let across = up.cross(eye).normalize_or(eye.any_orthonormal_vector());
        DMat3::from_cols(eye, across, eye.cross(across))
    };
    let camera = (NEAR_EYE.position - NEAR_EYE.target).normalize();
    let turn = axes(camera, DVec3::Z) * axes(sight.eye, sight.up).transpose();
    DQuat::from_mat3(&turn)
}

/// Sends the faces around a place, the refined ones with their edges; bytes of them.
fn show_patch(
    stream: &RecordingStream,
    object: Option<&ShownObject>,
    at: DVec3,
    half_width: f64,
) -> RecordingStreamResult<usize> {
    let all = object.map_or(&[][..], |of| &of.faces);
    let is_near = |face: &&ShownFace| {
        let closest = closest_point_on_triangle(face.corners, at).point;
        closest.distance(at) <= half_width
    };
    let faces: Vec<&ShownFace> = all.iter().filter(is_near).collect();
    let largest = largest_error(all);
    let colored = faces.iter();
    let colored = colored.map(|face| (face.corners, color(face, largest)));
    stream.log(format!("{AXES}/surface"), &mesh(colored))?;
    let edged = faces.iter().map(|face| &face.corners);
    stream.log(format!("{AXES}/edges"), &edges(edged))?;
    Ok(faces.len() * (FACE_BYTES + EDGE_BYTES))
}
