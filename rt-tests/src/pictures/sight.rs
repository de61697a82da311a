//! From where a touch is seen: the touched side, with the surface below and the force upwards.

use super::moment::{Fineness, Moment, ShownFace, ShownProbe};
use glam::{DQuat, DVec3};
use picture::Camera;
use scene::ProbeShape;
use std::f64::consts::{PI, TAU};

/// Angles between the normal and the eye that are tried, the one that shows most first: an arrow
/// along the normal is seen from the side, and the surface not too flat.
const TILTS: [f64; 4] = [0.28 * PI, 0.21 * PI, 0.13 * PI, 0.05 * PI];
/// Directions around the normal that are tried.
const AROUND: usize = 16;
/// Half width of a close-up: at least so many radii of what the tip touches, so much of the probe,
/// and at most so much of the object.
const MIN_RADII: f64 = 5.0;
const MIN_EXTENT: f64 = 0.8;
const MAX_SHARE: f64 = 0.3;
/// A close-up looks so far above the contact, half widths: there the force is.
pub const RAISED: f64 = 0.15;
/// Length of the arrow of a normal, half widths of the picture.
pub const NORMAL_LENGTH: f64 = 0.8;
/// Fits of an overview that has room for its arrows, whose length follows from the fit: each is off
/// by 0.4 times as much as the one before, or 0.8 times with touches from opposite sides.
const FITS: usize = 5;
/// The close-up shows this share of the original faces' area, with as much around it.
const ORIGINAL_SHARE: f64 = 0.8;
const AROUND_ORIGINAL: f64 = 1.3;
/// Gap between the contact and the line of sight from it, half widths.
const GAP: f64 = 0.05;

/// Directions in which a touch is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// From the touch to the eye.
    pub eye: DVec3,
    /// Upwards in the picture: away from the surface.
    pub up: DVec3,
}

impl Sight {
    /// The sight of a probe's touch that shows the most of it: nothing of the object is between the
    /// eye and the contact, if that can be.
    #[must_use]
    pub fn of_probe(moment: &Moment, probe: &ShownProbe, half_width: f64) -> Self {
        let up = upwards(probe);
        let side = up.any_orthonormal_vector();
        let tried = TILTS.iter().flat_map(|tilt| {
            (0..AROUND).map(move |k| {
                let around = DQuat::from_axis_angle(up, TAU * k as f64 / AROUND as f64);
                let eye = tilt.cos() * up + tilt.sin() * (around * side);
                Self { eye, up }
            })
        });
        let mut first = None;
        for sight in tried {
            first.get_or_insert(sight);
            if sight.is_free(moment, probe, half_width) {
                return sight;
            }
        }
        first.unwrap_or(Self { eye: DVec3::Z, up })
    }

    /// Whether nothing of the touched object is between the eye and the contact.
    #[must_use]
    pub fn is_free(&self, moment: &Moment, probe: &ShownProbe, half_width: f64) -> bool {
        let faces = touched_faces(moment, probe);
        let at = probe.position().unwrap_or_default() + GAP * half_width * self.up;
        let far = at + self.eye * reach(faces, at);
        !faces.iter().any(|face| crosses(face, at, far))
    }

    /// The same sight of a surface with another normal, turned as little as can be.
    #[must_use]
    pub fn turned_to(&self, up: DVec3) -> Self {
        let turn = DQuat::from_rotation_arc(self.up, up);
        Self {
            eye: (turn * self.eye).normalize(),
            up,
        }
    }

    /// A camera that shows the touched objects whole, in a picture of such a shape.
    #[must_use]
    pub fn overview(&self, moment: &Moment, aspect: f64) -> Camera {
        let objects = moment
            .probes
            .iter()
            .filter_map(|probe| Some(probe.touch.as_ref()?.object));
        let mut touched: Vec<usize> = objects.collect();
        if touched.is_empty() {
            touched = moment.objects.iter().map(|of| of.object).collect();
        }
        let objects = moment.objects.iter();
        let objects = objects.filter(|of| touched.contains(&of.object));
        let corners = objects.flat_map(|of| of.faces.iter().flat_map(|face| face.corners));
        let corners: Vec<DVec3> = corners.collect();
        let around = |tips: &[DVec3]| {
            let points = corners.iter().chain(tips).copied();
            Camera::around(points, self.eye, self.up, aspect)
        };
        let mut camera = around(&[]);
        for _ in 0..FITS {
            let length = NORMAL_LENGTH * camera.half_width();
            let probes = moment.probes.iter().filter(|probe| probe.touch.is_some());
            let tips = probes.filter_map(|probe| Some(probe.position()? + length * upwards(probe)));
            camera = around(&tips.collect::<Vec<_>>());
        }
        camera
    }

    /// A camera that looks at a touch from near.
    #[must_use]
    pub fn close_up(&self, at: DVec3, half_width: f64) -> Camera {
        self.look_at(at + RAISED * half_width * self.up, half_width)
    }

    /// A camera with a point in its middle.
    #[must_use]
    pub fn look_at(&self, target: DVec3, half_width: f64) -> Camera {
        Camera::new(target, self.eye, self.up, half_width)
    }
}

/// Away from the surface at a probe: along the normal, without a contact upwards in the world.
#[must_use]
pub fn upwards(probe: &ShownProbe) -> DVec3 {
    let contact = probe
        .touch
        .as_ref()
        .and_then(|touch| touch.contacts.first());
    let Some(contact) = contact else {
        return DVec3::Z;
    };
    // A sheet is touched from either side.
    let out = probe.force.dot(contact.normal);
    if out < 0.0 {
        -contact.normal
    } else {
        contact.normal
    }
}

/// Half of the width that shows a probe's touch: the original faces around it.
#[must_use]
pub fn half_width(moment: &Moment, probe: &ShownProbe, shape: &ProbeShape) -> f64 {
    let faces = touched_faces(moment, probe);
    let at = probe.position().unwrap_or_default();
    let mut originals: Vec<(f64, f64)> = faces
        .iter()
        .filter(|face| face.fineness == Fineness::Original)
        .map(|face| {
            let [a, b, c] = face.corners;
            let middle = (a + b + c) / 3.0;
            (middle.distance(at), (b - a).cross(c - a).length())
        })
        .collect();
    originals.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut left = ORIGINAL_SHARE * originals.iter().map(|of| of.1).sum::<f64>();
    let last = originals.iter().find(|of| {
        left -= of.1;
        left <= 0.0
    });
    let radius = last.map_or(0.0, |of| AROUND_ORIGINAL * of.0);
    let most = MAX_SHARE * reach(faces, at);
    let least = (MIN_RADII * shape.patch_m()).max(MIN_EXTENT * shape.extent_m());
    radius.min(most).max(least)
}

/// Faces of the object that a probe touches.
fn touched_faces<'a>(moment: &'a Moment, probe: &ShownProbe) -> &'a [ShownFace] {
    let touch = probe.touch.as_ref();
    let object = touch.and_then(|touch| moment.object(touch.object));
    object.map_or(&[], |object| &object.faces)
}

/// The farthest that a face is from a point.
fn reach(faces: &[ShownFace], from: DVec3) -> f64 {
    let corners = faces.iter().flat_map(|face| face.corners);
    corners.fold(0.0, |far: f64, p| far.max(p.distance(from)))
}

/// Whether a line crosses a face.
fn crosses(face: &ShownFace, from: DVec3, to: DVec3) -> bool {
    let [a, b, c] = face.corners;
    let along = to - from;
    let across = along.cross(c - a);
    let volume = (b - a).dot(across);
    if volume == 0.0 {
        return false;
    }
    let start = from - a;
    let u = start.dot(across) / volume;
    let around = start.cross(b - a);
    let v = along.dot(around) / volume;
    let t = (c - a).dot(around) / volume;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (0.0..=1.0).contains(&t)
}
