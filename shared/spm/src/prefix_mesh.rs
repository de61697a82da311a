//! The mesh of a prefix of the sequence: one level of detail as plain triangles (thesis chapter 3).

use super::{ActiveMesh, FileError, OperationFaces, Section, SpmFile};
use glam::DVec3;
use std::collections::BTreeMap;

/// Positions and triangles of the finest prefix with at most `max_faces` faces; the base mesh where
/// even that has more. Positions are in the coordinates of the mesh file that the model was built
/// from.
///
/// # Errors
/// When a block is damaged, or the records do not fit the base mesh.
pub fn prefix_mesh<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    max_faces: u32,
) -> Result<(Vec<DVec3>, Vec<[u32; 3]>), FileError> {
    let header = file.model_header();
    // A split creates at least one face.
    let slots = header.vsps.min(max_faces.saturating_sub(header.base_faces));
    let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, slots);
    for (k, vertex) in (0u32..).zip(file.base_vertices()) {
        mesh.set_base_vertex(k, vertex.position, 0.0);
    }
    for (k, face) in (0u32..).zip(file.base_faces()) {
        mesh.set_base_face(k, face.corners, face.neighbours)
            .ok_or(FileError::Inconsistent(Section::BaseFaces))?;
    }
    let mut out = OperationFaces::new();
    let mut faces = header.base_faces;
    for i in 0..slots {
        let record = file.record(i)?;
        faces += 1 + u32::from(record.has_right_face());
        if faces > max_faces {
            break;
        }
        mesh.load(i, &record, record.vs, record.fn_, [0.0; 2]);
        if !mesh.split_is_legal(i) {
            return Err(FileError::Inconsistent(Section::Records));
        }
        mesh.split(i, &mut out)
            .map_err(|_| FileError::Inconsistent(Section::Records))?;
    }
    let origin = DVec3::from_array(header.origin);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut places = BTreeMap::new();
    mesh.for_each_active_face(|face| {
        triangles.push(mesh.face(face).corners.map(|vertex| {
            *places.entry(vertex).or_insert_with(|| {
                positions.push(mesh.position(vertex).as_dvec3() + origin);
                positions.len() as u32 - 1
            })
        }));
    });
    Ok((positions, triangles))
}
