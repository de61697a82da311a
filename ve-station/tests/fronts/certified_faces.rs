//! The certified error of a face bounds its distance from the full mesh, in any front, and while
//! its vertices move.

use crate::common::load;
use geometry::closest_point_on_triangle;
use glam::{DVec3, Vec3};
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, OperationFaces, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};

/// Samples of faces, and what they say.
#[derive(Debug, Default)]
struct Seen {
    coarse: u32,
    /// Of them those whose bound is less than a fifth of the largest R of their corners.
    close: u32,
    moving: u32,
    /// Of them those whose bound is less than half of that.
    close_while_moving: u32,
    /// Points whose quarter's bound is less than four fifths of the face's.
    close_in_quarter: u32,
    /// Of them those of faces that move.
    close_in_moving_quarter: u32,
}

pub fn full_mesh(parts: &SpmParts) -> Vec<[DVec3; 3]> {
    let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3();
    parts.full_faces.iter().map(|f| f.corners.map(at)).collect()
}

pub fn distance(full: &[[DVec3; 3]], point: DVec3) -> f64 {
    let squared = |&face| closest_point_on_triangle(face, point).distance_squared;
    full.iter()
        .map(squared)
        .fold(f64::INFINITY, f64::min)
        .sqrt()
}

/// Checks every `every`th face.
fn check(
    (parts, full): (&SpmParts, &[[DVec3; 3]]),
    mesh: &ActiveMesh,
    every: usize,
    random: &mut impl RngCore,
    seen: &mut Seen,
) {
    let rounding = 1e-13 * parts.header.diagonal;
    let mut faces = Vec::new();
    mesh.for_each_active_face(|face| faces.push(face));
    let first = random.next_u32() as usize % every;
    for &face in faces.iter().skip(first).step_by(every) {
        let (bound, radius) = (mesh.certified_error(face), mesh.face_radius(face));
        assert!(bound <= radius && (bound == 0.0) == (radius == 0.0));
        let is_moving = mesh.any_geomorphing(&[face]);
        seen.coarse += u32::from(radius > 0.0);
        seen.close += u32::from(bound < 0.2 * radius);
        seen.moving += u32::from(is_moving);
        seen.close_while_moving += u32::from(is_moving && bound < 0.5 * radius);
        let [a, b, c] = mesh.corners(face);
        for _ in 0..3 {
            let mut unit = || f64::from(random.next_u32()) / 4_294_967_296.0;
            let (s, t) = (unit(), unit());
            let point = a.lerp(b, s).lerp(c, t);
            let distance = distance(full, point);
            let at_point = mesh.certified_distance(face, point);
            assert!(at_point <= bound && (at_point == 0.0) == (radius == 0.0));
            let is_close = at_point < 0.8 * bound;
            seen.close_in_quarter += u32::from(is_close);
            seen.close_in_moving_quarter += u32::from(is_close && is_moving);
            let bound = f64::from(at_point) + rounding;
            assert!(distance <= bound, "{distance} beyond {bound}");
        }
    }
}

pub fn front_at(parts: &SpmParts, code: u16) -> ActiveMesh {
    let mut mesh = load(parts).with_geomorphs(12);
    let mut out = OperationFaces::new();
    for record in parts.records.iter().filter(|record| record.e > code) {
        mesh.split(record.i, &mut out).unwrap();
    }
    mesh
}

/// Starts and advances geomorphs of splits and collapses next to a front.
fn stir(parts: &SpmParts, mesh: &mut ActiveMesh, random: &mut impl RngCore) {
    let mut out = OperationFaces::new();
    for _ in 0..2000 {
        let i = random.next_u32() % parts.header.vsps;
        if !mesh.can_start_geomorph() {
            break;
        }
        if mesh.split_is_legal(i) {
            mesh.split(i, &mut out).unwrap();
            mesh.start_split_geomorph(&out);
        } else if mesh.collapse_is_legal(i) {
            mesh.start_collapse_geomorph(i);
        }
    }
    for index in 0..mesh.geomorphs().len() {
        let geomorph = mesh.geomorphs()[index];
        if mesh.faces_around_geomorph(&geomorph, &mut out).is_some() {
            let way = f64::from(random.next_u32() % 101) / 100.0;
            let done = geomorph.done() + (1.0 - geomorph.done()) * way;
            mesh.step_geomorph(index, done, &out);
        }
    }
    mesh.finish_geomorphs();
}

#[test]
fn no_face_is_farther_from_the_full_mesh_than_certified_at_rest_or_moving() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
    for (shape, faces) in [
        (Shape::Relief, 3000),
        (Shape::Torus, 2500),
        (Shape::Wedge, 1500),
    ] {
        let options = BuildOptions {
            base_faces: Some(100),
            regions: Some(8),
        };
        let parts = build_model(generate(shape, faces, 4), &options, &NoProgress).unwrap();
        let full = full_mesh(&parts);
        let model = (&parts, &full[..]);
        let mut codes: Vec<u16> = parts.records.iter().map(|record| record.e).collect();
        codes.sort_unstable();
        let mut seen = Seen::default();
        for share in [0.0, 0.3, 0.6, 0.9, 0.99, 1.0] {
            let place = (codes.len() - 1) as f64 * share;
            let mut mesh = front_at(&parts, codes[place as usize]);
            check(model, &mesh, 5, &mut random, &mut seen);
            for _ in 0..6 {
                stir(&parts, &mut mesh, &mut random);
                check(model, &mesh, 7, &mut random, &mut seen);
            }
        }
        let at_rest_or_nearly = seen.close * 2 > seen.coarse;
        let moving = seen.moving > 200 && seen.close_while_moving * 4 > seen.moving;
        assert!(
            at_rest_or_nearly && moving,
            "{shape}: too little is close: {seen:?}"
        );
        // Of a wedge mostly flat faces move, whose bounds are near already.
        let in_moving = if shape == Shape::Wedge { 4 } else { 20 };
        assert!(
            seen.close_in_quarter * 20 > seen.coarse && seen.close_in_moving_quarter > in_moving,
            "{shape}: quarters say too little: {seen:?}"
        );
        // Other fronts: a chance for each split.
        let mut mesh = load(&parts);
        let mut out = OperationFaces::new();
        for i in 0..parts.header.vsps {
            if mesh.split_is_legal(i) && !random.next_u32().is_multiple_of(5) {
                mesh.split(i, &mut out).unwrap();
            }
        }
        check(model, &mesh, 1, &mut random, &mut seen);
    }
}
