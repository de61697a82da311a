//! What the builder counts, cuts and bounds, on the meshes that decided its rules.

use crate::common::{build, grid, load, made_meshes, models_folder, real_meshes};
use spm::ModelHeader;
use spm::{NONE, OperationFaces};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_file, build_model};

#[test]
fn real_meshes_have_the_counts_that_are_known_of_them() {
    // Vertices after cutting, faces, unreferenced vertices, vertices added by the cut.
    let known: [(&str, u64, u32, u64, u64); 14] = [
        ("blub.obj", 7106, 14208, 0, 0),
        ("bunny20k.obj", 18886, 37576, 0, 0),
        ("busted.stl", 1941, 3878, 0, 0),
        ("cow.obj", 2904, 5804, 0, 1),
        ("cube_with_fold.ply", 26, 48, 0, 0),
        ("dragon.obj", 50000, 100_000, 0, 0),
        ("dragon25k.obj", 25380, 50760, 0, 0),
        ("fandisk.obj", 6475, 12946, 0, 0),
        ("featuretype.stl", 1722, 3476, 0, 0),
        ("rocker-arm.obj", 10044, 20088, 0, 0),
        ("sphere.obj", 2050, 4096, 0, 0),
        ("spot.obj", 2930, 5856, 0, 0),
        ("stanford-bunny.obj", 34834, 69451, 1113, 0),
        ("terrain257.obj", 66049, 131_072, 0, 0),
    ];
    for (name, mesh) in real_meshes() {
        if let Some(&(_, vertices, faces, unreferenced, cut)) =
            known.iter().find(|(known, ..)| *known == name)
        {
            let parts = build(&mesh, None);
            let summary = parts.summary;
            assert_eq!(summary.vertices, vertices, "{name}");
            assert_eq!(parts.header.faces, faces, "{name}");
            assert_eq!(summary.unreferenced_vertices, unreferenced, "{name}");
            assert_eq!(summary.cut_vertices, cut, "{name}");
            assert!(
                parts.header.dependency_depth <= 40,
                "{name}: chain {}",
                parts.header.dependency_depth
            );
        }
    }
}

#[test]
fn chains_stay_short_where_every_edge_costs_the_same() {
    let flat = [
        ("strip", grid(20_000, 1, |_, _| true)),
        ("flat grid", grid(128, 128, |_, _| true)),
        ("terrain with a lake", generate(Shape::Terrain, 60_000, 1)),
        ("plate", generate(Shape::Plate, 20_000, 0)),
    ];
    for (name, mesh) in flat {
        let ModelHeader {
            dependency_depth: chain,
            vsps,
            closure_max,
            ..
        } = build(&mesh, None).header;
        println!("{name}: {vsps} splits, chain {chain}, closure {closure_max}");
        assert!(vsps > 1000 && chain <= 40, "{name}: {chain}");
    }
}

#[test]
fn what_is_dropped_is_counted() {
    let mut mesh = grid(4, 4, |_, _| true);
    mesh.positions
        .extend([[f64::NAN, 0.0, 0.0], [9.0, 9.0, 9.0], [1e300, 0.0, 0.0]]);
    mesh.triangles.extend([
        [0, 1, 25],   // not finite
        [0, 1, 27],   // beyond f32
        [0, 1, 9999], // no such vertex
        [0, 0, 1],    // a corner twice
        [0, 1, 2],    // on a line
        [6, 0, 1],    // a face that is there, turned round
    ]);
    let parts = build(&mesh, None);
    let summary = parts.summary;
    assert_eq!(summary.read_faces, 38);
    assert_eq!(summary.not_finite_vertices, 2);
    assert_eq!(summary.not_finite_faces, 2);
    assert_eq!(summary.out_of_range_faces, 1);
    assert_eq!(summary.zero_area_faces, 2);
    assert_eq!(summary.duplicate_faces, 1);
    assert_eq!(summary.unreferenced_vertices, 1);
    assert_eq!(parts.header.faces, 32);
}

#[test]
fn a_model_far_from_its_origin_keeps_its_shape() {
    let near = generate(Shape::Relief, 1000, 1);
    let offset = [4.5e6, -3.0e6, 1.0e5];
    let moved = |mesh: &SoupMesh| SoupMesh {
        positions: mesh
            .positions
            .iter()
            .map(|p| [p[0] + offset[0], p[1] + offset[1], p[2] + offset[2]])
            .collect(),
        triangles: mesh.triangles.clone(),
    };
    let parts = build(&moved(&near), None);
    assert_eq!(build(&near, None).header.origin, [0.0; 3]);
    for k in 0..3 {
        assert!((parts.header.origin[k] - offset[k]).abs() < 2.0);
        let least = near
            .positions
            .iter()
            .map(|p| p[k])
            .fold(f64::INFINITY, f64::min);
        let lower = parts.header.origin[k] + parts.header.lower[k];
        assert!((lower - offset[k] - least).abs() < 1e-6);
    }
}

#[test]
fn a_scaled_model_simplifies_alike() {
    let mesh = generate(Shape::Relief, 4000, 2);
    let chain = build(&mesh, None).header.dependency_depth;
    for exponent in [-20, 20] {
        // A power of two scales every bit pattern exactly.
        let scale = 2f64.powi(exponent);
        let scaled = SoupMesh {
            positions: mesh
                .positions
                .iter()
                .map(|p| p.map(|x| f64::from(x as f32) * scale))
                .collect(),
            triangles: mesh.triangles.clone(),
        };
        let header = build(&scaled, None).header;
        assert_eq!(header.dependency_depth, chain);
        assert_eq!(
            header.grid.divisions,
            build(&mesh, None).header.grid.divisions
        );
    }
}

#[test]
fn copies_of_a_cut_vertex_stay_where_they_are_on_every_front() {
    let mut copies = 0;
    for (name, mesh) in made_meshes().into_iter().chain(real_meshes()) {
        let parts = build(&mesh, Some(1));
        let mut vertices: Vec<u32> = parts.full_faces.iter().flat_map(|f| f.corners).collect();
        vertices.sort_unstable();
        vertices.dedup();
        let mut places: Vec<([u32; 3], u32)> = vertices
            .iter()
            .map(|&v| (parts.position(v).map(f32::to_bits), v))
            .collect();
        places.sort_unstable();
        for same in places
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|same| same.len() > 1)
        {
            // A vertex of the base mesh that is one of the full mesh never moves.
            for &(_, v) in same {
                assert!(v < parts.header.base_vertices, "{name}: copy {v} moves");
                copies += 1;
            }
        }
    }
    assert!(copies > 100, "nothing was cut: {copies}");
}

/// Splits at rims: of one face, and of two faces where one of the two ends lies on the rim.
#[test]
fn rims_split_in_all_their_ways() {
    let mesh = grid(40, 40, |i, j| i % 7 != 3 || j % 5 != 2);
    let parts = build(&mesh, Some(10));
    let one_face = parts.records.iter().filter(|r| !r.has_right_face()).count();
    let touching = parts
        .records
        .iter()
        .filter(|r| r.has_right_face() && r.fn_.contains(&NONE))
        .count();
    assert!(one_face > 20 && touching > 5, "{one_face} {touching}");
    // The gap: an inner edge with one end on the rim leaves the fan of vs in two pieces.
    let mut active = load(&parts);
    let mut out = OperationFaces::new();
    for i in 0..parts.header.vsps {
        active.split(i, &mut out).unwrap();
        active.check();
    }
}

#[test]
fn options_are_obeyed_and_bad_ones_refused() {
    let mesh = generate(Shape::Relief, 5000, 1);
    let options = BuildOptions {
        base_faces: Some(500),
        regions: Some(32),
    };
    let parts = build_model(mesh.clone(), &options, &NoProgress).unwrap();
    assert!(parts.header.base_faces <= 500 && parts.header.base_faces >= 498);
    assert_eq!(parts.header.grid.divisions, 32);
    for regions in [0, 3, 2048] {
        let options = BuildOptions {
            regions: Some(regions),
            ..options
        };
        assert!(build_model(mesh.clone(), &options, &NoProgress).is_err());
    }
}

#[test]
fn the_same_file_gives_the_same_bytes_and_appears_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("mesh.obj");
    spm_builder::write_mesh(&generate(Shape::Torus, 3000, 0), &mesh).unwrap();
    let outputs = ["a.spm", "b.spm"].map(|name| folder.path().join(name));
    for output in &outputs {
        build_file(&mesh, output, &BuildOptions::default(), &NoProgress).unwrap();
    }
    let [a, b] = outputs.map(|output| std::fs::read(output).unwrap());
    assert!(a == b);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn models_with_nothing_to_simplify_build_too() {
    if models_folder().is_none() {
        return;
    }
    for (name, mesh) in real_meshes() {
        if mesh.triangles.len() < 100 {
            let parts = build(&mesh, None);
            assert_eq!(parts.header.vsps, 0, "{name}");
            assert_eq!(parts.header.base_faces, parts.header.faces, "{name}");
        }
    }
}
