//! What is exported is read back as what it was: the thesis's text formats and plain meshes, full
//! and coarse.

use crate::common::{FaceBits, active_faces, build, face_bits, made_meshes, real_meshes_where};
use crate::common::{grid, input_faces, load, refine};
use spm::{OperationFaces, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_file, read_mesh, write_spm_file};
use std::path::Path;
use ve_station::export::{Detail, ExportError, ExportFormat, export};

fn models() -> Vec<(String, SoupMesh)> {
    let real = ["cow.obj", "fandisk.obj", "busted.stl", "stanford-bunny.obj"];
    made_meshes()
        .into_iter()
        .chain(real_meshes_where(|name| real.contains(&name)))
        .collect()
}

/// The faces of a mesh file as bits of f32, sorted.
fn faces_of(path: &Path) -> Vec<FaceBits> {
    let mesh = read_mesh(path).unwrap();
    let at = |v: u32| mesh.positions[v as usize].map(|x| x as f32 + 0.0);
    let mut all: Vec<FaceBits> = mesh
        .triangles
        .iter()
        .map(|t| face_bits(t.map(at)))
        .collect();
    all.sort_unstable();
    all
}

/// With what is almost zero as zero: the sum of a position of one and a difference that leads to
/// 1e-17 has no such digits in f64, so the thesis's formats cannot hold it.
fn snapped(mut faces: Vec<FaceBits>, extent: f32) -> Vec<FaceBits> {
    for bits in faces.as_flattened_mut().as_flattened_mut() {
        if f32::from_bits(*bits).abs() < extent * 2f32.powi(-27) {
            *bits = 0;
        }
    }
    // The corner that comes first may be another one now.
    for face in &mut faces {
        *face = face_bits(face.map(|corner| corner.map(f32::from_bits)));
    }
    faces.sort_unstable();
    faces
}

/// Refines as the export does.
fn front(parts: &SpmParts, most_faces: u32) -> Vec<FaceBits> {
    let mut mesh = load(parts);
    let mut out = OperationFaces::new();
    for record in &parts.records {
        if mesh.active_faces() + 1 + u32::from(record.has_right_face()) > most_faces {
            break;
        }
        mesh.split(record.i, &mut out).unwrap();
    }
    active_faces(&mesh)
}

#[test]
fn every_format_holds_the_front_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let spm = folder.path().join("model.spm");
    for (name, mesh) in models() {
        let parts = build(&mesh, Some(30));
        write_spm_file(&parts, &spm).unwrap();
        let half = parts.header.base_faces / 2 + parts.header.faces / 2;
        let full = (Detail::Full, input_faces(&mesh));
        let coarse = (Detail::Faces(half), front(&parts, half));
        for (detail, expected) in [full, coarse] {
            for (ending, format) in ExportFormat::ENDINGS {
                let output = folder.path().join(format!("out.{ending}"));
                let done = export(&spm, &output, None, detail).unwrap();
                assert_eq!(done.faces as usize, expected.len(), "{name} {ending}");
                assert_eq!(done.file_bytes, std::fs::metadata(&output).unwrap().len());
                let found = faces_of(&output);
                if format == ExportFormat::Stl {
                    // The format has no vertices, so its reader may join near ones.
                    assert_eq!(found.len(), expected.len(), "{name} {ending}");
                } else if matches!(format, ExportFormat::Cdpm | ExportFormat::SpmText) {
                    let extent = parts.header.diagonal as f32;
                    let found = snapped(found, extent);
                    let expected = snapped(expected.clone(), extent);
                    assert!(found == expected, "{name}: {ending} at {detail:?} differs");
                } else {
                    assert!(found == expected, "{name}: {ending} at {detail:?} differs");
                }
            }
        }
    }
}

#[test]
fn a_text_of_the_thesis_builds_a_model_of_the_same_full_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let [spm, again] = ["a.spm", "b.spm"].map(|name| folder.path().join(name));
    for (name, mesh) in [
        ("relief", generate(Shape::Relief, 3000, 2)),
        ("holes", grid(40, 40, |i, j| i % 7 != 3 || j % 5 != 2)),
    ] {
        let parts = build(&mesh, Some(30));
        write_spm_file(&parts, &spm).unwrap();
        for ending in ["cdpm", "spmtxt"] {
            let text = folder.path().join(format!("text.{ending}"));
            export(&spm, &text, None, Detail::Full).unwrap();
            let report = build_file(&text, &again, &BuildOptions::default(), &NoProgress).unwrap();
            let mut refined = load(&report.parts);
            refine(&mut refined, &report.parts);
            assert!(
                active_faces(&refined) == input_faces(&mesh),
                "{name} {ending}"
            );
            assert_eq!(report.parts.summary.vertices, parts.summary.vertices);
        }
    }
}

#[test]
fn the_layout_is_that_of_the_appendices() {
    let folder = tempfile::tempdir().unwrap();
    let spm = folder.path().join("sphere.spm");
    let parts = build(&generate(Shape::Sphere, 4096, 0), Some(50));
    write_spm_file(&parts, &spm).unwrap();
    let (base_vertices, base_faces) = (parts.header.base_vertices, parts.header.base_faces);
    let (vsps, faces) = (parts.header.vsps, parts.header.faces);
    let text = |ending: &str| {
        let path = folder.path().join(format!("sphere.{ending}"));
        export(&spm, &path, None, Detail::Full).unwrap();
        std::fs::read_to_string(path).unwrap()
    };
    let counts = format!(
        "# 3D model: {faces} faces {} vertices {vsps} VSPs",
        base_vertices + vsps
    );

    let cdpm = text("cdpm");
    assert!(cdpm.starts_with(&counts));
    let starts =
        |text: &str, with: &str| text.lines().filter(|l| l.starts_with(with)).count() as u32;
    assert_eq!(starts(&cdpm, "v "), base_vertices);
    assert_eq!(starts(&cdpm, "f "), base_faces);
    assert_eq!(starts(&cdpm, "v* "), vsps);
    for line in cdpm.lines().filter(|line| line.starts_with("v* ")) {
        // Vertex, six differences, two third vertices, count, and as many faces and more.
        let (head, groups) = line.split_once(" & ").unwrap();
        let head: Vec<&str> = head.split(' ').collect();
        assert_eq!(head.len(), 1 + 1 + 6 + 2, "{line}");
        assert!(
            !head[8].starts_with('-') && head[9].starts_with('-'),
            "{line}"
        );
        let groups: Vec<usize> = groups.split(' ').map(|w| w.parse().unwrap()).collect();
        assert!(groups[0] < groups.len(), "{line}");
    }

    let spm_text = text("spmtxt");
    let lines: Vec<&str> = spm_text.lines().collect();
    assert!(lines[0] == counts);
    assert_eq!(lines[2], format!("b {base_faces} {base_vertices}"));
    assert_eq!(
        lines[3],
        format!("$ {faces} {} {vsps}", base_vertices + vsps)
    );
    let mut cells: Vec<usize> = lines[4..12]
        .iter()
        .flat_map(|line| line.split(' ').map(|w| w.parse().unwrap()))
        .collect();
    assert_eq!(cells.len(), 512);
    // Following the links from every cell comes by every leaf of a split once.
    let mut leaves = 0;
    let records: Vec<Vec<i64>> = lines
        .iter()
        .filter_map(|line| line.strip_prefix("v* "))
        .map(|line| {
            let words = line.replace(" & ", " ");
            words
                .split(' ')
                .map(|w| w.parse::<f64>().unwrap() as i64)
                .collect()
        })
        .collect();
    for (cell, at) in cells.iter_mut().enumerate() {
        while *at != 0 {
            let links = &records[*at - 1][12..16];
            let ends: Vec<&[i64]> = links
                .chunks(2)
                .filter(|l| l[0] == cell as i64 + 1)
                .collect();
            leaves += ends.len();
            let next = ends[0][1] as usize;
            assert!(next == 0 || next > *at, "links ascend");
            *at = next;
        }
    }
    assert_eq!(leaves as u32, vsps + base_vertices - starts_unsplit(&parts));
    // Sphere: 17 fields and two faces of eight.
    for (k, record) in records.iter().enumerate() {
        assert_eq!(record.len(), 17 + 2 * 8, "split {k}");
        assert_eq!(record[0], k as i64 + 1);
        assert_eq!(record[2], i64::from(base_vertices) + 2 * k as i64 + 1);
        assert_eq!(record[5], i64::from(base_vertices) + k as i64 + 1);
        assert_eq!(record[17], i64::from(base_faces) + 2 * k as i64 + 1);
        assert_eq!(record[25], -(i64::from(base_faces) + 2 * k as i64 + 2));
    }
}

/// Base vertices that are vertices of the full mesh: no split ends in them.
fn starts_unsplit(parts: &SpmParts) -> u32 {
    let split = |v: u32| parts.records.iter().any(|r| r.vs == v);
    (0..parts.header.base_vertices)
        .filter(|&v| !split(v))
        .count() as u32
}

#[test]
fn a_model_far_from_its_origin_is_exported_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let spm = folder.path().join("far.spm");
    let mut mesh = generate(Shape::Relief, 1000, 1);
    for p in &mut mesh.positions {
        *p = [p[0] + 4.5e6, p[1] - 3.0e6, p[2] + 1.0e5];
    }
    write_spm_file(&build(&mesh, Some(30)), &spm).unwrap();
    for ending in ["obj", "ply", "stl", "off", "cdpm", "spmtxt"] {
        let output = folder.path().join(format!("far.{ending}"));
        export(&spm, &output, None, Detail::Full).unwrap();
        let read = read_mesh(&output).unwrap();
        assert_eq!(read.triangles.len(), mesh.triangles.len());
        for p in &read.positions {
            let nearest = mesh
                .positions
                .iter()
                .map(|q| (0..3).map(|k| (p[k] - q[k]).abs()).fold(0.0, f64::max))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < 1e-6, "{ending}: {nearest}");
        }
    }
}

#[test]
fn what_cannot_be_exported_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    write_spm_file(&build(&generate(Shape::Torus, 500, 0), None), &at("a.spm")).unwrap();
    let said = |input: &str, output: &str, detail| -> String {
        let result: Result<_, ExportError> = export(&at(input), &at(output), None, detail);
        result.unwrap_err().to_string()
    };
    assert!(said("none.spm", "a.obj", Detail::Full).contains("none.spm"));
    assert!(said("a.spm", "a.vrml", Detail::Full).contains(".cdpm"));
    assert!(said("a.spm", "a.spm", Detail::Full).contains("a.spm"));
    assert!(said("a.spm", "a.obj", Detail::Tolerance(f64::NAN)).contains("--tolerance"));
    assert!(said("a.spm", "no/a.obj", Detail::Full).contains("no/a.obj"));
}
