//! Updates of the tree where a patch of faces was deformed, beside parry's partial refit of the
//! same faces.

use super::full_front::FullFront;
use super::row::{Row, Who};
use super::timing::time;
use crate::models::Model;
use crate::models::surface::unit;
use crate::peers::parry::{Mesh, ParryF32, ParryF64};
use ab_tree::{AbTree, Child, depth};
use geometry::{Aabb, BoxPair};
use glam::{DVec3, Vec3};
use rand::Rng;
use spm::{ActiveMesh, Handle, ModelHeader, NONE};
use std::collections::HashSet;

/// Faces of a patch, as deformed by about eight splits.
pub const PATCH: usize = 64;
/// Patches. All are moved, then all are moved back, so that none is met with its faces in the
/// caches from the update before.
const PATCHES: usize = 2000;
/// By how much a patch is moved, in parts of the diagonal.
const SHIFT: f32 = 1e-3;

/// The patch of an update, and whether it is moved or moved back.
fn asked(k: usize) -> (usize, bool) {
    (k % PATCHES, k < PATCHES)
}

/// So many faces around one of `faces`, by its place there: nearest by adjacency first. Where its
/// piece of the mesh has no more, the faces that follow go on with theirs; fewer where the mesh
/// has no more.
pub fn patch(mesh: &ActiveMesh, faces: &[Handle], first: usize, count: usize) -> Vec<Handle> {
    let count = count.min(faces.len());
    let mut patch = Vec::with_capacity(count);
    let mut found = HashSet::new();
    let mut next = 0;
    let (before, from) = faces.split_at(first);
    for &begin in from.iter().chain(before) {
        if patch.len() == count {
            break;
        }
        if found.insert(begin) {
            patch.push(begin);
        }
        while patch.len() < count && next < patch.len() {
            let face = mesh.face(patch[next]);
            next += 1;
            for neighbour in face.neighbours {
                if neighbour != NONE && patch.len() < count && found.insert(neighbour) {
                    patch.push(neighbour);
                }
            }
        }
    }
    patch
}

/// The largest coordinate of the positions as they are stored, model units.
fn largest_stored(header: &ModelHeader) -> f64 {
    let corners = [header.lower, header.upper].map(DVec3::from_array);
    let origin = DVec3::from_array(header.origin);
    let largest = corners.map(|corner| (corner - origin).abs().max_element());
    largest[0].max(largest[1])
}

/// Moves the faces of a patch and brings the boxes of the tree up to date.
fn update(mesh: &ActiveMesh, tree: &mut AbTree, patch: &[Handle], by: Vec3) {
    for &face in patch {
        tree.deform(face);
    }
    tree.refit(|face| moved(mesh.face_box(face), by));
}

fn moved(at: Aabb, by: Vec3) -> Aabb {
    Aabb {
        lower: at.lower + by,
        upper: at.upper + by,
    }
}

/// Whether every box from the root to a face is what it should be: that of the face `at`, and above
/// it the box around the two below. The box of the root alone knows nothing of most patches.
fn path_is_right(tree: &AbTree, face: Handle, at: Aabb) -> bool {
    let leaf = tree.leaf_of(face);
    let mut child = tree.root();
    while let Some(Child::Node(id)) = child {
        let node = tree.node(id);
        let below = depth(leaf) - depth(node.key()) - 1;
        let index = (leaf >> below & 1) as usize;
        let next = node.children()[index];
        let due = match next {
            Child::Face(_) => BoxPair::new([at; 2]),
            Child::Node(id) => tree.node(id).boxes().joined(),
        };
        let stored = match index {
            0 => BoxPair::mixed(node.boxes(), &due),
            _ => BoxPair::mixed(&due, node.boxes()),
        };
        if stored != due {
            return false;
        }
        child = Some(next);
    }
    child == Some(Child::Face(face))
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
        .map(|first| patch(front.mesh(), &handles, first, PATCH))
        .collect();
    let header = model.file.model_header();
    let shift = Vec3::splat(SHIFT * header.diagonal as f32);
    let of = |k: usize| {
        let (patch, is_moved) = asked(k);
        let by = if is_moved { shift } else { Vec3::ZERO };
        (&patches[patch], by)
    };
    let size = |aabb: &Aabb| f64::from((aabb.upper - aabb.lower).length());
    let (mesh, tree) = front.parts_mut();
    let mut ours = |k: usize| {
        let (patch, by) = of(k);
        update(mesh, tree, patch, by);
        size(tree.root_box())
    };
    let mut of_single = |k: usize| {
        let (patch, by) = of(k);
        single.update(patch, by)
    };
    let mut of_double = |k: usize| {
        let (patch, by) = of(k);
        double.update(patch, by)
    };
    let timed = time(
        2 * PATCHES,
        &mut [&mut ours, &mut of_single, &mut of_double],
    );
    let expected = timed[2].answers.clone();
    // The same again, without a clock.
    let is_wrong = |k: &usize| {
        let (patch, by) = of(*k);
        update(mesh, tree, patch, by);
        let is_right = |&face: &Handle| path_is_right(tree, face, moved(mesh.face_box(face), by));
        !patch.iter().all(is_right)
    };
    let wrong = (0..2 * PATCHES).filter(is_wrong).count() as u64;
    // Boxes are the same numbers for all but for the rounding of shifted coordinates.
    let tolerance = 4.0 * f64::from(f32::EPSILON) * (header.diagonal + largest_stored(&header));
    [Who::OursFull, Who::ParryF32, Who::ParryF64]
        .into_iter()
        .zip(timed)
        .map(|(who, timed)| {
            let of_paths = if who == Who::OursFull { wrong } else { 0 };
            let differ = timed.differ(&expected, tolerance) + of_paths;
            Row::new("update64", model, who, timed.ns, differ)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::limits::wrong;
    use super::super::questions::FullMesh;
    use super::*;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;
    use spm::Certified;
    use spm_builder::generate::{Shape, generate};
    use spm_builder::{BuildOptions, NoProgress};

    #[test]
    fn every_patch_is_moved_and_moved_back_and_none_twice_in_a_row() {
        let all: Vec<(usize, bool)> = (0..2 * PATCHES).map(asked).collect();
        assert!(all.windows(2).all(|pair| pair[0].0 != pair[1].0));
        for patch in 0..PATCHES {
            let of_patch = all.iter().filter(|(of, _)| *of == patch);
            let moves: Vec<bool> = of_patch.map(|&(_, is_moved)| is_moved).collect();
            assert_eq!(moves, [true, false], "patch {patch}");
        }
    }

    #[test]
    fn an_update_that_does_nothing_or_leaves_a_box_out_is_wrong() {
        let mesh = generate(Shape::Relief, 3000, 1);
        let name = "relief".to_string();
        let model = Model::build(name, mesh, &BuildOptions::default(), &NoProgress);
        let model = model.unwrap_or_else(|error| panic!("{error}"));
        let mut front = FullFront::new(&model).unwrap_or_else(|error| panic!("{error}"));
        let mut handles = Vec::new();
        front.mesh().for_each_active_face(|face| handles.push(face));
        let patch = patch(front.mesh(), &handles, 700, PATCH);
        let by = Vec3::splat(SHIFT * model.file.model_header().diagonal as f32);
        let (mesh, tree) = front.parts_mut();
        let right = |tree: &AbTree, by: Vec3| {
            let is_right =
                |&&face: &&Handle| path_is_right(tree, face, moved(mesh.face_box(face), by));
            patch.iter().filter(is_right).count()
        };
        assert_eq!(right(tree, Vec3::ZERO), PATCH);
        // Nothing is done, and then all but one face.
        assert_eq!(right(tree, by), 0);
        update(mesh, tree, &patch[1..], by);
        assert_eq!(right(tree, by), PATCH - 1);
        update(mesh, tree, &patch, by);
        assert_eq!(right(tree, by), PATCH);
        update(mesh, tree, &patch, Vec3::ZERO);
        assert_eq!(right(tree, Vec3::ZERO), PATCH);
    }

    /// Forty diagonals from the origin, where the coordinates have a step of 2^-16 and what a patch
    /// is moved by is no multiple of it but ends in half a step: rounded as far as it can be.
    #[test]
    fn an_update_far_from_the_origin_is_right_up_to_rounding() {
        let mut mesh = generate(Shape::Relief, 3000, 1);
        let positions = mesh.positions.iter().map(|&at| DVec3::from_array(at));
        let lower = positions.clone().fold(DVec3::INFINITY, DVec3::min);
        let upper = positions.fold(DVec3::NEG_INFINITY, DVec3::max);
        let diagonal = 262.5 / 65_536.0 / f64::from(SHIFT);
        let scale = diagonal / (upper - lower).length();
        for at in &mut mesh.positions {
            *at = (DVec3::from_array(*at) * scale + DVec3::X * 40.0 * diagonal).to_array();
        }
        let name = "far relief".to_string();
        let model = Model::build(name, mesh, &BuildOptions::default(), &NoProgress);
        let model = model.unwrap_or_else(|error| panic!("{error}"));
        let header = model.file.model_header();
        assert_eq!(header.origin, [0.0; 3], "it was moved to the origin");
        let mut front = FullFront::new(&model).unwrap_or_else(|error| panic!("{error}"));
        let full = FullMesh::new(&model);
        let (positions, faces) = (&full.positions, &full.faces);
        let mut single = ParryF32::new(positions, faces).expect("parry takes it");
        let mut double = ParryF64::new(positions, faces).expect("parry takes it");
        let random = &mut Xoshiro256PlusPlus::seed_from_u64(1);
        let rows = rows(&model, &mut front, &mut single, &mut double, random);
        assert_eq!(wrong(&rows), [""; 0]);
    }

    /// Pieces of one face each: a patch goes on with the next piece, and around the end.
    #[test]
    fn a_patch_has_as_many_faces_as_were_asked_for_over_any_pieces() {
        const PIECES: u32 = 40;
        let mut mesh = ActiveMesh::new(3 * PIECES, PIECES, 0);
        for vertex in 0..3 * PIECES {
            let at = [vertex as f32, (vertex % 2) as f32, 0.0];
            mesh.set_base_vertex(vertex, at, Certified::EXACT);
        }
        for piece in 0..PIECES {
            let corners = [0, 1, 2].map(|k| 3 * piece + k);
            mesh.set_base_face(piece, corners, [NONE; 3])
                .expect("all are there");
        }
        let faces: Vec<Handle> = (0..PIECES).collect();
        for (first, count) in [(0, 1), (7, 33), (39, 12), (3, 40), (0, 64)] {
            let mut patch = patch(&mesh, &faces, first, count);
            assert_eq!(patch[0], faces[first]);
            patch.sort_unstable();
            patch.dedup();
            assert_eq!(patch.len(), count.min(faces.len()));
        }
    }
}
