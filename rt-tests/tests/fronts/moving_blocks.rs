//! Blocks of regions move over a model through a cache that is too small for it: after any history
//! of loads, evictions and reloads the front is that of a fresh load, bit for bit.

use glam::DVec3;
use rand::{RngCore, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use rt_tests::models::Model;
use rt_tests::models::local_front::LocalFront;
use rt_tests::models::path::path;
use rt_tests::models::surface::Surface;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress};

/// The active faces as bits of their corners, and the performed VSPs: all that a front is.
fn front(local: &LocalFront<'_>) -> (Vec<u32>, Vec<[[u64; 3]; 3]>) {
    let mesh = local.cache().mesh();
    let mut faces = Vec::new();
    mesh.for_each_active_face(|face| {
        let mut bits = mesh
            .corners(face)
            .map(|p: DVec3| p.to_array().map(f64::to_bits));
        let least = (0..3).min_by_key(|&k| bits[k]).unwrap();
        bits.rotate_left(least);
        faces.push(bits);
    });
    faces.sort_unstable();
    (local.performed(), faces)
}

#[test]
fn loads_evictions_and_reloads_end_in_the_mesh_of_a_fresh_load() {
    let seed = 11;
    println!("seed {seed}");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    for shape in [Shape::Relief, Shape::Terrain] {
        let name = shape.to_string();
        let options = BuildOptions::default();
        let mesh = generate(shape, 30_000, 1);
        let model = Model::build(name.clone(), mesh, &options, &NoProgress).unwrap();
        let header = model.file.model_header();
        let full = Surface::new(model.full_triangles());
        // Room for some blocks only.
        let room = header.closure_max * 8 + header.base_faces.max(header.base_vertices);
        let mut local = LocalFront::with_slots(&model, room).unwrap();
        let mut compared = 0;
        for _ in 0..6 {
            for near in path(&full, header.grid.cell * 0.4, 60, &mut random) {
                let cells = local.cells_near(near.point, 0.0, header.grid.cell * 0.2);
                local.want(&cells).unwrap();
                // Sometimes the next block comes before this one is done, or undone.
                match random.next_u32() % 4 {
                    0 => assert!(local.split_some(random.next_u32() % 64).unwrap() < 64),
                    1 => assert!(local.collapse_some(random.next_u32() % 64) < 64),
                    _ => local.settle().unwrap(),
                }
                if random.next_u32().is_multiple_of(8) {
                    local.settle().unwrap();
                    local.cache().mesh().check();
                    local
                        .cache()
                        .tree()
                        .check(|face| local.cache().mesh().face_box(face));
                    let mut fresh = LocalFront::new(&model).unwrap();
                    fresh.want(&cells).unwrap();
                    fresh.settle().unwrap();
                    assert!(front(&local) == front(&fresh), "{name}");
                    compared += 1;
                }
            }
        }
        let evicted = local.cache().evicted();
        println!("{name}: {compared} fronts equal, {evicted} records evicted");
        assert!(compared > 20, "{name}: {compared}");
        assert!(evicted > u64::from(header.closure_max), "{name}: {evicted}");
    }
}
