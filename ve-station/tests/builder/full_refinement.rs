//! The full refinement of every mesh is its cleaned input, bit for bit, and every front between is
//! sound.

use crate::common::{
    active_faces, build, input_faces, load, made_meshes, open, random_front, real_meshes, refine,
};
use ab_tree::is_leaf_key;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{Certified, ErrorScale, NONE, OperationFaces, SpmParts};
use std::collections::BTreeSet;

/// Ids are dense, leaves are shared out exactly once, and no fan is larger than the builder
/// promises.
fn check_records(name: &str, parts: &SpmParts) {
    let sizes = parts.header.sizes();
    let mut leaves: Vec<u32> = parts.base_faces.iter().map(|f| f.leaf).collect();
    let mut split = BTreeSet::new();
    for (i, record) in (0u32..).zip(&parts.records) {
        record.validate(i, sizes).unwrap();
        assert!(record.dependencies(sizes).all(|d| d < i), "{name} {i}");
        assert!(split.insert(record.vs), "{name}: a vertex is split twice");
        leaves.push(record.leaf_l);
        leaves.extend((record.leaf_r != NONE).then_some(record.leaf_r));
    }
    leaves.sort_unstable();
    leaves.dedup();
    assert_eq!(leaves.len() as u32, sizes.faces, "{name}");
    assert!(leaves.iter().all(|&leaf| is_leaf_key(leaf, sizes.faces)));
}

fn check_refinement(name: &str, mesh: &spm_builder::SoupMesh, base_faces: Option<u32>) {
    let parts = build(mesh, base_faces);
    check_records(name, &parts);
    let mut active = load(&parts);
    active.check();
    let base = active_faces(&active);
    refine(&mut active, &parts);
    active.check();
    assert!(
        active_faces(&active) == input_faces(mesh),
        "{name}: full refinement differs"
    );
    let full: Vec<_> = {
        let file = open(&parts);
        let mut all: Vec<_> = (0..parts.header.faces)
            .map(|p| {
                let corners = file.leaf_corners(p).unwrap();
                crate::common::face_bits(corners.map(|c| c.as_vec3().to_array()))
            })
            .collect();
        all.sort_unstable();
        all
    };
    assert!(
        full == input_faces(mesh),
        "{name}: the file's full mesh differs"
    );
    let mut out = OperationFaces::new();
    for i in (0..parts.header.vsps).rev() {
        active.collapse(i, &mut out).unwrap();
    }
    assert!(
        active_faces(&active) == base,
        "{name}: the base mesh differs"
    );
    let header = &parts.header;
    println!(
        "{name}: {} faces, base {}, chain {}",
        header.faces, header.base_faces, header.dependency_depth
    );
}

#[test]
fn full_refinement_of_made_meshes_equals_their_input() {
    for (name, mesh) in made_meshes() {
        check_refinement(&name, &mesh, None);
        check_refinement(&name, &mesh, Some(1));
    }
}

#[test]
fn full_refinement_of_real_meshes_equals_their_input() {
    for (name, mesh) in real_meshes() {
        check_refinement(&name, &mesh, None);
    }
}

#[test]
fn the_certified_error_bounds_the_distance_to_the_full_mesh_on_random_fronts() {
    let seed = 11;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for (name, mesh) in made_meshes() {
        let parts = build(&mesh, Some(20));
        let mut coarse = 0;
        let file = open(&parts);
        if parts.header.vsps == 0 {
            continue;
        }
        let ways = [
            (80, false),
            (95, false),
            (99, false),
            (10, true),
            (50, true),
            (90, true),
        ];
        for (chance, down) in ways {
            let active = random_front(&parts, &mut random, chance, down);
            active.check();
            active.for_each_active_face(|face| {
                let bound = f64::from(active.certified_error(face));
                let [a, b, c] = active.corners(face);
                for point in [(a + b + c) / 3.0, (a + b) * 0.5, a] {
                    let (_, closest) = file.closest_point(point).unwrap();
                    let distance = closest.distance_squared.sqrt();
                    // The point itself is rounded in f64; the radius to f32.
                    let rounding = 1e-6 * bound + 1e-15 * parts.header.diagonal;
                    assert!(distance <= bound + rounding, "{name}: {distance} > {bound}");
                }
                coarse += u32::from(bound > 0.0);
            });
        }
        println!("{name}: {coarse} coarse faces on six fronts");
        // The bound says something only where it is not zero. (Of the chessboard most is locked.)
        assert!(coarse >= parts.header.vsps.min(500), "{name}: {coarse}");
    }
}

#[test]
fn r_reaches_the_farthest_descendant_and_hardly_farther() {
    for (name, mesh) in made_meshes() {
        let parts = build(&mesh, Some(10));
        let sizes = parts.header.sizes();
        let scale = ErrorScale::for_diagonal(parts.header.diagonal);
        let mut parent = std::collections::BTreeMap::new();
        for record in &parts.records {
            parent.insert(sizes.vt(record.i), record.vs);
            parent.insert(sizes.vt(record.i) + 1, record.vs);
        }
        let at = |v: u32| glam::Vec3::from_array(parts.position(v)).as_dvec3();
        let mut farthest = std::collections::BTreeMap::<u32, f64>::new();
        let used = parts.full_faces.iter().flat_map(|f| f.corners);
        for leaf in used.collect::<BTreeSet<u32>>() {
            farthest.insert(leaf, 0.0);
            let mut above = leaf;
            while let Some(&next) = parent.get(&above) {
                above = next;
                let most = farthest.entry(above).or_default();
                *most = most.max(at(above).distance(at(leaf)));
            }
        }
        let check = |vertex: u32, certified: Certified| {
            let (r, true_r) = (f64::from(certified.radius), farthest[&vertex]);
            assert!(
                r >= true_r && r <= true_r * 1.1,
                "{name}: R {r} of {true_r}"
            );
        };
        for (v, vertex) in (0u32..).zip(&parts.base_vertices) {
            check(v, scale.certified_of_base(vertex));
        }
        for record in &parts.records {
            let [t, u] = scale.certified(record);
            check(sizes.vt(record.i), t);
            check(sizes.vt(record.i) + 1, u);
        }
    }
}
