//! Updates of the tree where a patch of faces was deformed, beside parry's partial refit of the
//! same faces.

use super::full_front::FullFront;
use super::row::{Row, Who};
use super::timing::time;
use crate::models::Model;
use crate::models::surface::unit;
use crate::peers::parry::{Mesh, ParryF32, ParryF64};
use geometry::Aabb;
use glam::Vec3;
use rand::Rng;
use spm::{ActiveMesh, Handle, NONE};
use std::collections::HashSet;

/// Faces of a patch, as deformed by about eight splits.
pub const PATCH: usize = 64;
/// Patches.
const PATCHES: usize = 2000;
/// By how much a patch is moved, in parts of the diagonal.
const SHIFT: f32 = 1e-3;

/// So many faces around one, nearest by adjacency first; fewer where its piece of the mesh has no
/// more.
pub fn patch(mesh: &ActiveMesh, first: Handle, count: usize) -> Vec<Handle> {
    let mut patch = vec![first];
    let mut found = HashSet::from([first]);
    let mut next = 0;
    while patch.len() < count && next < patch.len() {
        let face = mesh.face(patch[next]);
        next += 1;
        for neighbour in face.neighbours {
            if neighbour != NONE && patch.len() < count && found.insert(neighbour) {
                patch.push(neighbour);
            }
        }
    }
    patch
}

/// A row for each contender: one update moves a patch, or moves it back. All compute the boxes
/// from the corners of the faces, as a tick does.
pub fn rows(
    model: &Model,
    front: &mut FullFront,
    single: &mut ParryF32,
    double: &mut ParryF64,
    random: &mut impl Rng,
) -> Vec<Row> {
    let mut handles = Vec::new();
    front.mesh().for_each_active_face(|face| handles.push(face));
    // Faces of parry by the same numbers: those of the full mesh in the order of the tree.
    let patches: Vec<Vec<u32>> = (0..PATCHES)
        .map(|_| (unit(random) * handles.len() as f64) as usize)
        .map(|first| patch(front.mesh(), handles[first], PATCH))
        .collect();
    let shift = Vec3::splat(SHIFT * model.file.model_header().diagonal as f32);
    // Every patch is moved and moved back.
    let by = |k: usize| {
        if k.is_multiple_of(2) {
            shift
        } else {
            Vec3::ZERO
        }
    };
    let size = |aabb: &Aabb| f64::from((aabb.upper - aabb.lower).length());
    let (mesh, tree) = front.parts_mut();
    let mut ours = |k: usize| {
        for &face in &patches[k / 2] {
            tree.deform(face);
        }
        tree.refit(|face| {
            let at = mesh.face_box(face);
            Aabb {
                lower: at.lower + by(k),
                upper: at.upper + by(k),
            }
        });
        size(tree.root_box())
    };
    let mut of_single = |k: usize| single.update(&patches[k / 2], by(k));
    let mut of_double = |k: usize| double.update(&patches[k / 2], by(k));
    let timed = time(
        2 * PATCHES,
        &mut [&mut ours, &mut of_single, &mut of_double],
    );
    let expected = timed[2].answers.clone();
    // Boxes are the same numbers for all but for the rounding of the shift.
    let tolerance = f64::from(f32::EPSILON) * model.file.model_header().diagonal * 4.0;
    [Who::OursFull, Who::ParryF32, Who::ParryF64]
        .into_iter()
        .zip(timed)
        .map(|(who, timed)| {
            let differ = timed.differ(&expected, tolerance);
            Row::new("update64", model, who, timed.ns, differ)
        })
        .collect()
}
