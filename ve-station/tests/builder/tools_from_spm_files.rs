//! A tool of a scene is one level of detail of an SPM file: as many faces as fit, the shape of the
//! mesh, at its size.

use glam::DVec3;
use scene::{Overrides, ProbeShape, parse};
use scene_files::DiskFiles;
use spm::{SpmFile, prefix_mesh, prefix_parts, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use std::collections::BTreeMap;

fn spm(shape: Shape) -> Vec<u8> {
    let parts = build_model(
        generate(shape, 8000, 1),
        &BuildOptions::default(),
        &NoProgress,
    )
    .expect("it is built");
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).expect("it is written");
    bytes
}

#[test]
fn a_prefix_is_a_closed_mesh_near_the_full_one_with_as_many_faces_as_fit() {
    let file = SpmFile::open(spm(Shape::Sphere)).expect("it is good");
    for most in [0, 700, 960, 3000, 100_000] {
        let (positions, triangles) = prefix_mesh(&file, most).expect("it fits");
        let header = file.model_header();
        let faces = triangles.len() as u32;
        let least = header.base_faces;
        assert!(
            faces <= most.max(least) && faces + 2 > most.min(header.faces),
            "{faces} of {most}"
        );
        let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        for t in &triangles {
            for k in 0..3 {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
        }
        assert!(
            edges.values().all(|&sum| sum == 0),
            "{most}: every edge has two sides"
        );
        for p in &positions {
            assert!((p.length() - 1.0).abs() < 0.05, "{most}: {p}");
        }
    }
}

#[test]
fn a_prefix_alone_gives_the_same_bits_whatever_number_of_faces_is_asked_for() {
    for shape in [Shape::Sphere, Shape::Relief] {
        let file = SpmFile::open(spm(shape)).expect("it is good");
        for most in [0, 700, 3000, 100_000] {
            let whole = prefix_mesh(&file, most).expect("it fits");
            let parts = prefix_parts(&file, most).expect("it fits");
            assert_eq!(parts.base_faces.len(), whole.1.len());
            let mut bytes = Vec::new();
            write_spm(&parts, &mut bytes).expect("it is written");
            let alone = SpmFile::open(bytes).expect("it is good");
            alone.check_all().expect("it is good");
            for asked in [0, most, 100_000] {
                assert_eq!(prefix_mesh(&alone, asked).expect("it fits"), whole);
            }
        }
    }
}

#[test]
fn a_scene_takes_a_tool_from_a_file_at_its_size() {
    let folder = tempfile::tempdir().expect("there is a folder");
    std::fs::write(folder.path().join("tool.spm"), spm(Shape::Torus)).expect("it is written");
    let text = "[[object]]\nmodel = \"o.spm\"\nsize_m = 0.1\n[[probe]]\nshape = { mesh = { file = \"tool.spm\", size_m = 0.05, faces = 800 } }\n";
    let plan = parse(
        text,
        "test",
        folder.path(),
        &Overrides::default(),
        &DiskFiles,
    )
    .expect("it is good");
    let ProbeShape::Mesh(mesh) = &plan.probes[0].shape else {
        panic!("{:?}", plan.probes[0].shape);
    };
    assert!(
        (790..=800).contains(&mesh.triangles.len()),
        "{}",
        mesh.triangles.len()
    );
    let upper = mesh
        .positions
        .iter()
        .fold(DVec3::NEG_INFINITY, |high, &p| high.max(p));
    let lower = mesh
        .positions
        .iter()
        .fold(DVec3::INFINITY, |low, &p| low.min(p));
    assert!(((upper - lower).max_element() - 0.05).abs() < 1e-9);
}
