//! What the station sends for any regions at any tolerances is a legal mesh, within its certified
//! error.

use crate::common::{load, open};
use glam::{DVec3, UVec3, Vec3};
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, OperationFaces, RegionId, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::collection::{RegionAt, closure};
use std::collections::BTreeSet;

/// The vertex of the front that a vertex of the full mesh has become.
fn active_ancestor(parts: &SpmParts, front: &BTreeSet<u32>, mut vertex: u32) -> u32 {
    while let Some(i) = parts.header.sizes().creator_of_vertex(vertex) {
        if front.contains(&i) {
            break;
        }
        vertex = parts.records[i as usize].vs;
    }
    vertex
}

/// The map of every full-mesh face to the front, linear on faces, moves no point farther than its
/// corners; so the certified error holds when it holds for the corners.
fn check_certified(parts: &SpmParts, front: &BTreeSet<u32>, mesh: &ActiveMesh) {
    let at = |v: u32| Vec3::from_array(parts.position(v)).as_dvec3();
    let mut active = BTreeSet::new();
    mesh.for_each_active_face(|face| {
        active.insert(face);
    });
    for full in &parts.full_faces {
        let image = full.corners.map(|v| active_ancestor(parts, front, v));
        for (v, ancestor) in full.corners.into_iter().zip(image) {
            let moved = at(v).distance(at(ancestor));
            let bound = f64::from(mesh.radius(ancestor));
            assert!(moved <= bound * (1.0 + 1e-6), "{moved} beyond {bound}");
        }
        // A face whose corners stay apart is a face of the front.
        let [a, b, c] = image;
        let made = parts.header.sizes().creator_of_face(full.face);
        let is_in = made.is_none_or(|i| front.contains(&i));
        assert_eq!(is_in, active.contains(&full.face));
        if is_in {
            assert!(a != b && b != c && c != a);
            let mut corners = mesh.face(full.face).corners;
            corners.sort_unstable();
            let mut expected = image;
            expected.sort_unstable();
            assert_eq!(corners, expected);
        }
    }
}

#[test]
fn any_union_of_closures_is_a_legal_mesh_within_its_certified_error() {
    let seed = 11;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (shape, faces) in [
        (Shape::Relief, 12_000),
        (Shape::Terrain, 8000),
        (Shape::Torus, 6000),
    ] {
        let options = BuildOptions {
            base_faces: Some(200),
            regions: Some(16),
        };
        let parts = build_model(generate(shape, faces, 2), &options, &NoProgress).unwrap();
        let file = open(&parts);
        let header = parts.header;
        for _ in 0..12 {
            let mut front = BTreeSet::new();
            let mut asked_for = Vec::new();
            for _ in 0..1 + random.next_u32() % 5 {
                // From the full mesh, over the ladder and between its rungs, to the base mesh.
                let level = random.next_u32() as usize % 6;
                let rung = header.level_tolerances[level];
                let stretch = [1.0, 1.3, 3.0][random.next_u32() as usize % 3];
                let tolerance = if rung.is_finite() {
                    rung * stretch
                } else {
                    0.0
                };
                let cells = UVec3::from_array(header.grid_of(tolerance).cells).as_dvec3();
                let mut unit = || f64::from(random.next_u32()) / 4_294_967_296.0;
                let place = DVec3::new(unit(), unit(), unit());
                let region = match random.next_u32() % 8 {
                    0 => RegionId::WHOLE,
                    _ => RegionId::of_cell((place * cells).as_uvec3()),
                };
                let asked = if random.next_u32() % 8 == 0 {
                    RegionAt {
                        region: RegionId::PREFIX,
                        tolerance_bits: random.next_u32() % (header.vsps / 4),
                    }
                } else {
                    RegionAt::tolerance(region, tolerance)
                };
                front.extend(closure(&file, asked).unwrap());
                asked_for.push(asked.to_string());
            }
            let mut mesh = load(&parts);
            let mut out = OperationFaces::new();
            for &i in &front {
                assert!(mesh.split_is_legal(i), "{shape}: {asked_for:?}");
                mesh.split(i, &mut out).unwrap();
            }
            check_certified(&parts, &front, &mesh);
        }
    }
}
