//! The foot of each vertex of a history: a point of the full mesh near it, where its traces end.
//!
//! It lies inside a face, so that a plane through it crosses two sides of that face; a vertex with
//! a descendant on a rim has its foot beside the rim.

use super::super::descendants::Descendants;
use super::super::full_surface::FullSurface;
use super::boundary::{Boundary, ends_of};
use crate::history::History;
use crate::tuning::close::{BOUNDARY_STEPS, INWARDS};
use geometry::{closest_point_on_segment, closest_point_on_triangle};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::NONE;

/// A point inside a face of the full mesh.
#[derive(Debug, Clone, Copy)]
pub struct Foot {
    /// The face.
    pub face: u32,
    /// The point.
    pub point: DVec3,
    /// Upwards there, over all descendants: a unit, or zero.
    pub up: DVec3,
    /// The side on the rim that it lies beside, [`NONE`] away from rims.
    pub side: u32,
    /// The point of that side.
    pub on_boundary: DVec3,
}

/// The feet of all vertices of a history.
pub fn feet(
    history: &History,
    full: &FullSurface<'_>,
    boundary: &Boundary,
    descendants: &Descendants,
) -> Vec<Foot> {
    let (hints, ups) = hints_and_ups(history, full);
    let sides = sides_on_boundaries(history, full, boundary, descendants);
    (0..history.positions.len())
        .into_par_iter()
        .with_min_len(256)
        .map(|vertex| {
            let at = Vec3::from_array(history.positions[vertex]).as_dvec3();
            let mut foot = Foot {
                face: hints[vertex],
                point: at,
                up: ups[vertex].normalize_or_zero(),
                side: sides[vertex],
                on_boundary: at,
            };
            if foot.face == NONE {
                return foot;
            }
            if foot.side != NONE {
                foot.face = foot.side / 3;
                foot.on_boundary = nearest_on_side(full, foot.side, at);
                foot.point = foot.on_boundary;
            } else if vertex >= history.full_vertices as usize {
                foot.face = full.nearest(at, foot.face, 0.0).face;
                foot.point = closest_point_on_triangle(full.corners(foot.face), at).point;
            }
            let [a, b, c] = full.corners(foot.face);
            foot.point += ((a + b + c) / 3.0 - foot.point) * INWARDS;
            foot
        })
        .collect()
}

/// By vertex: a face at a descendant near it, and the sum of the normals, as long as twice the
/// areas, at all of them.
fn hints_and_ups(history: &History, full: &FullSurface<'_>) -> (Vec<u32>, Vec<DVec3>) {
    let mut hints = vec![NONE; history.positions.len()];
    let mut ups = vec![DVec3::ZERO; history.positions.len()];
    for (face, corners) in (0u32..).zip(full.triangles()) {
        let [a, b, c] = full.corners(face);
        let normal = (b - a).cross(c - a);
        for &vertex in corners {
            hints[vertex as usize] = face;
            ups[vertex as usize] += normal;
        }
    }
    let made = history.full_vertices as usize..;
    for (made, collapse) in made.zip(&history.collapses) {
        let [t, u] = [collapse.vt, collapse.vu].map(|v| v as usize);
        let at = Vec3::from_array(history.positions[made]);
        let away = |child: usize| {
            let corner = full.triangles().get(hints[child] as usize).map(|of| of[0]);
            let near = |v: u32| Vec3::from_array(history.positions[v as usize]);
            corner.map_or(f32::INFINITY, |v| near(v).distance_squared(at))
        };
        hints[made] = hints[if away(u) < away(t) { u } else { t }];
        ups[made] = ups[t] + ups[u];
    }
    (hints, ups)
}

/// By vertex: the side near it among those on the rim that begin at a descendant.
fn sides_on_boundaries(
    history: &History,
    full: &FullSurface<'_>,
    boundary: &Boundary,
    descendants: &Descendants,
) -> Vec<u32> {
    let count = history.full_vertices as usize;
    let mut sides = vec![NONE; history.positions.len()];
    for (vertex, side) in sides[..count].iter_mut().enumerate() {
        *side = boundary.started_by(vertex as u32);
    }
    for (made, collapse) in (history.full_vertices..).zip(&history.collapses) {
        let at = Vec3::from_array(history.positions[made as usize]).as_dvec3();
        let distance = |side: u32| nearest_on_side(full, side, at).distance_squared(at);
        let of_children = [collapse.vt, collapse.vu].map(|v| sides[v as usize]);
        let mut best = (NONE, f64::INFINITY);
        for start in of_children.into_iter().filter(|&side| side != NONE) {
            // Along the rim both ways while it comes nearer.
            for is_forward in [true, false] {
                let mut side = start;
                for _ in 0..BOUNDARY_STEPS {
                    if side == NONE || !descendants.descends(ends_of(full, side)[0], made) {
                        break;
                    }
                    let here = distance(side);
                    if here < best.1 {
                        best = (side, here);
                    } else if side != start {
                        break;
                    }
                    let [from, to] = ends_of(full, side);
                    side = if is_forward {
                        boundary.started_by(to)
                    } else {
                        boundary.ended_by(from)
                    };
                }
            }
        }
        sides[made as usize] = best.0;
    }
    sides
}

fn nearest_on_side(full: &FullSurface<'_>, side: u32, at: DVec3) -> DVec3 {
    let [from, to] = ends_of(full, side).map(|vertex| full.position(vertex));
    from + (to - from) * closest_point_on_segment(from, to, at)
}
