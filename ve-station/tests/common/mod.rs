//! What the tests of the builder share.
#![allow(dead_code)] // each test binary uses a part

use glam::DVec3;
use rand::RngCore;
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::{ActiveMesh, ErrorScale, OperationFaces, SpmFile, SpmParts, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{
    BuildOptions, NoProgress, SoupMesh, build_model, clean, is_mesh_file, read_mesh,
};
use std::io::Write as _;
use std::path::PathBuf;

/// The folder of real meshes beside the checkout; `None`, said aloud, when it is not there.
pub fn models_folder() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/models"));
    if folder.is_dir() {
        return Some(folder);
    }
    let _ = writeln!(
        std::io::stderr(),
        "skipped: {} is not there",
        folder.display()
    );
    None
}

/// Every real mesh, by name.
pub fn real_meshes() -> Vec<(String, SoupMesh)> {
    real_meshes_where(|_| true)
}

/// The real meshes whose name is wanted.
pub fn real_meshes_where(wanted: impl Fn(&str) -> bool) -> Vec<(String, SoupMesh)> {
    let Some(folder) = models_folder() else {
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| is_mesh_file(path))
        .collect();
    paths.sort();
    let name = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().into_owned();
    paths
        .iter()
        .filter(|path| wanted(&name(path)))
        .map(|path| (name(path), read_mesh(path).unwrap()))
        .collect()
}

/// Generated meshes and hand-made ones with rims, holes and cuts.
pub fn made_meshes() -> Vec<(String, SoupMesh)> {
    let mut all: Vec<(String, SoupMesh)> = Shape::ALL
        .iter()
        .map(|&(shape, name)| (name.to_string(), generate(shape, 3000, 5)))
        .collect();
    all.push(("strip".to_string(), grid(600, 1, |_, _| true)));
    all.push((
        "holes".to_string(),
        grid(40, 40, |i, j| i % 7 != 3 || j % 5 != 2),
    ));
    // Diagonal neighbours of the chessboard share a vertex only: every inner vertex is a bow-tie.
    all.push((
        "chessboard".to_string(),
        grid(12, 12, |i, j| (i + j) % 2 == 0),
    ));
    all.push(("double sheet".to_string(), {
        let mut sheet = grid(20, 20, |_, _| true);
        let back: Vec<[u32; 3]> = sheet.triangles.iter().map(|t| [t[0], t[2], t[1]]).collect();
        sheet.triangles.extend(back);
        sheet
    }));
    all
}

/// A flat grid of squares, of which `keep` says which are there.
pub fn grid(columns: u32, rows: u32, keep: impl Fn(u32, u32) -> bool) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            mesh.positions.push([f64::from(i), f64::from(j), 0.0]);
        }
    }
    let at = |i: u32, j: u32| j * (columns + 1) + i;
    for j in 0..rows {
        for i in (0..columns).filter(|&i| keep(i, j)) {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Builds with few base faces, so that small meshes are simplified too.
pub fn build(mesh: &SoupMesh, base_faces: Option<u32>) -> SpmParts {
    let options = BuildOptions {
        base_faces,
        regions: None,
    };
    build_model(mesh.clone(), &options, &NoProgress).unwrap()
}

/// The mesh of the parts with all records loaded into the slots of their numbers, none performed.
pub fn load(parts: &SpmParts) -> ActiveMesh {
    let header = &parts.header;
    let scale = ErrorScale::for_diagonal(header.diagonal);
    let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps)
        .with_quarters(parts.quartered.len());
    for (k, vertex) in (0u32..).zip(&parts.base_vertices) {
        mesh.set_base_vertex(k, vertex.position, scale.certified_of_base(vertex));
    }
    for (k, face) in (0u32..).zip(&parts.base_faces) {
        mesh.set_base_face(k, face.corners, face.neighbours)
            .unwrap();
    }
    assert!(mesh.base_is_consistent());
    for quartered in &parts.quartered {
        assert!(mesh.add_quarters(quartered, scale));
    }
    for record in &parts.records {
        mesh.load(
            record.i,
            record,
            record.vs,
            record.fn_,
            scale.certified(record),
        );
    }
    mesh
}

/// Performs every split, ascending.
pub fn refine(mesh: &mut ActiveMesh, parts: &SpmParts) {
    let mut out = OperationFaces::new();
    for i in 0..parts.header.vsps {
        mesh.split(i, &mut out).unwrap();
    }
}

/// A face as the bits of its corners, the least one first, orientation kept.
pub type FaceBits = [[u32; 3]; 3];

pub fn face_bits(corners: [[f32; 3]; 3]) -> FaceBits {
    let mut bits = corners.map(|p| p.map(f32::to_bits));
    let least = (0..3).min_by_key(|&k| bits[k]).unwrap();
    bits.rotate_left(least);
    bits
}

/// The active faces as bits, sorted.
pub fn active_faces(mesh: &ActiveMesh) -> Vec<FaceBits> {
    let mut all = Vec::new();
    mesh.for_each_active_face(|f| {
        all.push(face_bits(
            mesh.corners(f).map(|p: DVec3| p.as_vec3().to_array()),
        ));
    });
    all.sort_unstable();
    all
}

/// The faces of the cleaned input as bits, sorted.
pub fn input_faces(mesh: &SoupMesh) -> Vec<FaceBits> {
    let cleaned = clean(mesh.clone()).unwrap();
    let mut all: Vec<FaceBits> = cleaned
        .triangles
        .iter()
        .map(|t| face_bits(t.map(|v| cleaned.positions[v as usize])))
        .collect();
    all.sort_unstable();
    all
}

/// The parts as an open file.
pub fn open(parts: &SpmParts) -> SpmFile<Vec<u8>> {
    let mut bytes = Vec::new();
    write_spm(parts, &mut bytes).unwrap();
    SpmFile::open(bytes).unwrap()
}

/// Goes through the splits in ascending order and performs each legal one with the given chance in
/// percent; then, if `down`, through all in descending order and undoes each with the same chance.
///
/// (A walk of random numbers hardly leaves the base mesh: few splits are legal there.)
pub fn random_front(
    parts: &SpmParts,
    random: &mut Xoshiro256PlusPlus,
    chance: u32,
    down: bool,
) -> ActiveMesh {
    let mut active = load(parts);
    let mut out = OperationFaces::new();
    let vsps = parts.header.vsps;
    for i in 0..vsps {
        if active.split_is_legal(i) && (down || random.next_u32() % 100 < chance) {
            active.split(i, &mut out).unwrap();
        }
    }
    for i in (0..vsps).rev().filter(|_| down) {
        if active.collapse_is_legal(i) && random.next_u32() % 100 < chance {
            active.collapse(i, &mut out).unwrap();
        }
    }
    active
}
