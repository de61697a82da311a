//! Signed distance from a front, from the closest point: the exact side of the face's plane, or of
//! the pseudo-normal of an edge or a corner (Baerentzen and Aanaes 2005).

use geometry::side_of_plane;
use glam::DVec3;
use hrtc_core::contact::query::{Nearest, Surface};
use spm::{Handle, NONE};
use std::cmp::Ordering;

/// Faces around a corner at the most; beyond, the pseudo-normal is of those met first.
const MAX_AROUND: usize = 512;

/// Distance of a point from the front, negative behind it, given its closest point.
///
/// Right wherever the front is a closed surface that does not cross itself, and near an open one
/// everywhere but beyond its rims. Where a front crosses itself (coarse ones may) it is the side of
/// the nearest sheet. Faces without area have no part in it.
#[must_use]
pub fn signed_distance(surface: Surface<'_>, point: DVec3, nearest: &Nearest) -> f64 {
    let distance = nearest.closest.distance_squared.sqrt();
    let [a, b, c] = surface.mesh.corners(nearest.face);
    let weights = nearest.closest.weights;
    let behind = match weights.map(|w| w > 0.0) {
        [true, true, true] => side_of_plane(a, b, c, point) == Ordering::Less,
        [_, true, true] => behind_edge(surface, point, nearest, 0),
        [true, _, true] => behind_edge(surface, point, nearest, 1),
        [true, true, _] => behind_edge(surface, point, nearest, 2),
        [true, _, _] => behind_corner(surface, point, nearest, 0),
        [_, true, _] => behind_corner(surface, point, nearest, 1),
        _ => behind_corner(surface, point, nearest, 2),
    };
    if behind { -distance } else { distance }
}

/// Unit normal of a face; zero without area.
fn normal(surface: Surface<'_>, face: Handle) -> DVec3 {
    let [a, b, c] = surface.mesh.corners(face);
    (b - a).cross(c - a).normalize_or_zero()
}

fn behind_edge(surface: Surface<'_>, point: DVec3, nearest: &Nearest, opposite: usize) -> bool {
    let across = surface.mesh.face(nearest.face).neighbours[opposite];
    let mut pseudo = normal(surface, nearest.face);
    if across != NONE {
        pseudo += normal(surface, across);
    }
    (point - nearest.closest.point).dot(pseudo) < 0.0
}

/// The faces around a corner, weighted by their angles there.
fn behind_corner(surface: Surface<'_>, point: DVec3, nearest: &Nearest, corner: usize) -> bool {
    let mesh = surface.mesh;
    let vertex = mesh.face(nearest.face).corners[corner];
    let mut pseudo = DVec3::ZERO;
    let mut add = |face: Handle, index: usize| {
        let corners = mesh.corners(face);
        let at = corners[index];
        let (u, v) = (corners[(index + 1) % 3] - at, corners[(index + 2) % 3] - at);
        let angle = u.cross(v).length().atan2(u.dot(v));
        pseudo += normal(surface, face) * angle;
    };
    // Once round, or to a rim and then the other way from the start.
    for side in [1, 2] {
        let (mut face, mut index) = (nearest.face, corner);
        for step in 0..MAX_AROUND {
            if step > 0 || side == 1 {
                add(face, index);
            }
            let next = mesh.face(face).neighbours[(index + side) % 3];
            if next == NONE {
                break;
            }
            let Some(at) = mesh.face(next).corners.iter().position(|&v| v == vertex) else {
                break;
            };
            if next == nearest.face {
                return (point - nearest.closest.point).dot(pseudo) < 0.0;
            }
            (face, index) = (next, at);
        }
    }
    (point - nearest.closest.point).dot(pseudo) < 0.0
}
