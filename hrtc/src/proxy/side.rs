//! The side of the surface on which a point lies, by the angle-weighted pseudo-normal of the closest feature
//! (Baerentzen and Aanaes 2005).

use crate::query::{Nearest, Surface};
use glam::DVec3;
use shared::spm::{Handle, NONE};

/// Faces around a vertex that are taken into account at the most.
const FAN: usize = 64;

/// The unit pseudo-normal at a closest point, `None` where the faces there have no area.
#[must_use]
pub fn pseudo_normal(surface: Surface<'_>, nearest: &Nearest) -> Option<DVec3> {
    let face = nearest.face;
    let weights = nearest.closest.weights;
    let zero = |k: usize| weights[k] == 0.0;
    let vertex = (0..3).find(|&k| zero((k + 1) % 3) && zero((k + 2) % 3));
    if let Some(k) = vertex {
        return around_vertex(surface, face, surface.mesh.face(face).corners[k]);
    }
    let mut sum = unit_normal(surface, face).unwrap_or(DVec3::ZERO);
    if let Some(k) = (0..3).find(|&k| zero(k)) {
        let neighbour = surface.mesh.face(face).neighbours[k];
        if neighbour != NONE {
            sum += unit_normal(surface, neighbour).unwrap_or(DVec3::ZERO);
        }
    }
    sum.try_normalize()
}

fn unit_normal(surface: Surface<'_>, face: Handle) -> Option<DVec3> {
    let [a, b, c] = surface.mesh.corners(face);
    (b - a).cross(c - a).try_normalize()
}

fn around_vertex(surface: Surface<'_>, first: Handle, vertex: Handle) -> Option<DVec3> {
    let mut sum = DVec3::ZERO;
    let mut left = FAN;
    // Counterclockwise, and where a rim ends that, clockwise from the start.
    for (step, skip_first) in [(1, false), (2, true)] {
        let mut face = first;
        let mut skip = skip_first;
        while face != NONE && left > 0 {
            let links = surface.mesh.face(face);
            let Some(k) = links.corners.iter().position(|&c| c == vertex) else {
                break;
            };
            if !skip {
                let corners = surface.mesh.corners(face);
                let (u, v) = (
                    corners[(k + 1) % 3] - corners[k],
                    corners[(k + 2) % 3] - corners[k],
                );
                if let Some(normal) = u.cross(v).try_normalize() {
                    sum += normal * u.angle_between(v);
                }
                left -= 1;
            }
            skip = false;
            face = links.neighbours[(k + step) % 3];
            if face == first {
                return sum.try_normalize();
            }
        }
    }
    sum.try_normalize()
}
