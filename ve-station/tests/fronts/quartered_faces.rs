//! The bounds of quarters hold wherever a face has them, and say more than its corners.

use crate::certified_faces::{distance, front_at, full_mesh};
use crate::common::real_meshes_where;
use glam::DVec3;
use spm::{ActiveMesh, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use std::collections::BTreeMap;

/// Steps of the grid of points on each face: a part that is cut twice has four along its side.
const STEPS: u32 = 16;

/// Points of quartered faces.
#[derive(Debug, Default)]
struct Seen {
    points: u32,
    /// Of them those whose quarter's bound is less than the face's.
    less: u32,
    /// Of them those whose bound is at most twice the largest distance found on the face, or where
    /// that is next to nothing.
    near: u32,
}

fn check(
    (mesh, face): (&ActiveMesh, u32),
    distance: impl Fn(DVec3) -> f64,
    nothing: f64,
    seen: &mut Seen,
) {
    let [a, b, c] = mesh.corners(face);
    let error = mesh.certified_error(face);
    let mut bounds = Vec::new();
    let mut most: f64 = 0.0;
    for i in 0..=STEPS {
        for j in 0..=STEPS - i {
            let [s, t] = [i, j].map(|k| f64::from(k) / f64::from(STEPS));
            let point = a * (1.0 - s - t) + b * s + c * t;
            let bound = mesh.certified_distance(face, point);
            let found = distance(point);
            assert!(found <= f64::from(bound), "{found} beyond {bound}");
            most = most.max(found);
            bounds.push(bound);
        }
    }
    seen.points += bounds.len() as u32;
    seen.less += bounds.iter().filter(|&&bound| bound < error).count() as u32;
    let is_near = |bound: &&f32| f64::from(**bound) <= 2.0 * most.max(nothing);
    seen.near += bounds.iter().filter(is_near).count() as u32;
}

/// Checks every `every`th quartered face in the coarsest front in which it has its corners.
fn check_all(name: &str, mesh: SoupMesh, options: &BuildOptions, every: usize) {
    let parts: SpmParts = build_model(mesh, options, &NoProgress).unwrap();
    let full = full_mesh(&parts);
    let [rounding, nothing] = [1e-13, 1e-6].map(|share| share * parts.header.diagonal);
    let mut by_end = BTreeMap::<u16, Vec<u32>>::new();
    let whole = parts
        .quartered
        .iter()
        .filter(|quartered| quartered.part == 0);
    for quartered in whole.step_by(every) {
        by_end
            .entry(quartered.end)
            .or_default()
            .push(quartered.face);
    }
    let mut seen = Seen::default();
    for (end, faces) in by_end {
        let mesh = front_at(&parts, end - 1);
        for face in faces {
            let distance = |point| distance(&full, point) - rounding;
            check((&mesh, face), distance, nothing, &mut seen);
        }
    }
    assert!(seen.points > 0, "{name}: none is quartered");
    assert!(
        5 * seen.less > 3 * seen.points,
        "{name}: quarters say nothing: {seen:?}"
    );
    assert!(
        2 * seen.near > seen.points,
        "{name}: quarters say too little: {seen:?}"
    );
}

#[test]
fn no_point_of_a_quartered_face_is_beyond_its_bound_and_most_are_near_it() {
    for (shape, name) in Shape::ALL {
        let options = BuildOptions {
            base_faces: Some(40),
            regions: Some(4),
        };
        check_all(name, generate(shape, 1200, 3), &options, 1);
    }
}

#[test]
fn no_point_of_a_quartered_face_of_a_real_mesh_is_beyond_its_bound() {
    for (name, mesh) in real_meshes_where(|name| ["cow.obj", "fandisk.obj"].contains(&name)) {
        check_all(&name, mesh, &BuildOptions::default(), 40);
    }
}
