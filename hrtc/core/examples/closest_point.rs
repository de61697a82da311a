//! From a mesh file to a closest-point query:
//! `cargo run -p hrtc-core --example closest_point -- bunny.obj 0.1 0.2 0.3`.
//! Without arguments the mesh is a generated torus and the point the origin.

use ab_tree::AbTree;
use glam::DVec3;
use hrtc_core::contact::query::{Surface, closest_point};
use spm::{ActiveMesh, ErrorScale, OperationFaces, SpmParts};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model, read_mesh};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let soup = match arguments.first() {
        Some(path) => read_mesh(Path::new(path))?,
        None => generate("torus".parse::<Shape>()?, 2000, 1),
    };
    let number = |k: usize| arguments.get(k).map_or(Ok(0.0), |text| text.parse::<f64>());
    let point = DVec3::new(number(1)?, number(2)?, number(3)?);

    let parts = build_model(soup, &BuildOptions::default(), &NoProgress)?;
    let (mesh, tree) = full_front(&parts)?;
    let surface = Surface {
        mesh: &mesh,
        tree: &tree,
    };
    let (nearest, work) = closest_point(surface, point, None);
    let closest = nearest.ok_or("the mesh has no faces")?.closest;
    println!("{} faces, closest point {}", tree.faces(), closest.point);
    println!("distance {}", closest.distance_squared.sqrt());
    println!("{} nodes, {} faces tested", work.nodes, work.faces);
    Ok(())
}

/// The front with every split performed, and its tree.
fn full_front(parts: &SpmParts) -> Result<(ActiveMesh, AbTree), Box<dyn Error>> {
    let header = &parts.header;
    let scale = ErrorScale::for_diagonal(header.diagonal);
    let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps);
    let mut tree = AbTree::new(header.base_faces + 2 * header.vsps);
    tree.preconstruct(header.faces);
    for (vertex, base) in (0u32..).zip(&parts.base_vertices) {
        mesh.set_base_vertex(vertex, base.position, scale.certified_of_base(base));
    }
    for (face, base) in (0u32..).zip(&parts.base_faces) {
        mesh.set_base_face(face, base.corners, base.neighbours)
            .ok_or_else(|| format!("base face {face} names a missing vertex"))?;
        tree.insert(face, base.leaf);
    }
    tree.refit(|face| mesh.face_box(face));
    for record in &parts.records {
        mesh.load(
            record.i,
            record,
            record.vs,
            record.fn_,
            scale.certified(record),
        );
    }
    let mut changed = OperationFaces::new();
    for slot in 0..header.vsps {
        mesh.split(slot, &mut changed)
            .map_err(|error| format!("split {slot}: {error:?}"))?;
        for (&face, leaf) in changed.made_or_removed().iter().zip(changed.leaves) {
            tree.insert(face, leaf);
        }
        for &face in changed.deformed() {
            tree.deform(face);
        }
    }
    tree.refit(|face| mesh.face_box(face));
    Ok((mesh, tree))
}
