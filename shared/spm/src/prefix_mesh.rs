//! The mesh of a prefix of the sequence: one level of detail as plain triangles (thesis chapter 3).

use super::{
    ActiveMesh, BaseFace, BaseVertex, BuildSummary, FileError, FullFace, Handle, LEVELS,
    ModelHeader, NONE, OperationFaces, RegionGrid, RegionId, Section, SpmFile, SpmParts,
};
use crate::{Certified, CertifiedCode};
use ab_tree::leaf_key;
use bytemuck::Zeroable;
use glam::{DVec3, UVec3};
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
    let mesh = prefix(file, max_faces)?;
    let origin = DVec3::from_array(file.model_header().origin);
    let numbered = Numbered::of(&mesh);
    let position = |&vertex: &Handle| mesh.position(vertex).as_dvec3() + origin;
    let positions = numbered.vertices.iter().map(position).collect();
    Ok((positions, numbered.triangles))
}

/// The same as a model of its own without splits: of it [`prefix_mesh`] gives the same bits again,
/// for any number of faces.
///
/// # Errors
/// As those of [`prefix_mesh`].
pub fn prefix_parts<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    max_faces: u32,
) -> Result<SpmParts, FileError> {
    let mesh = prefix(file, max_faces)?;
    let Numbered {
        faces,
        vertices,
        triangles,
    } = Numbered::of(&mesh);
    let number = |face: &Handle| faces.binary_search(face).map_or(NONE, |place| place as u32);
    let count = faces.len() as u32;
    let header = file.model_header();
    let (lower, upper) = (
        DVec3::from_array(header.lower),
        DVec3::from_array(header.upper),
    );
    let mut level_tolerances = [f32::INFINITY; LEVELS];
    level_tolerances[0] = 0.0;
    let base_face = |((k, face), &corners): ((u32, &Handle), &[u32; 3])| BaseFace {
        corners,
        leaf: leaf_key(k, count),
        neighbours: mesh.face(*face).neighbours.map(|of| number(&of)),
        reserved: 0,
    };
    let base_vertex = |&vertex: &Handle| BaseVertex {
        position: mesh.position(vertex).to_array(),
        certified: CertifiedCode::default(),
        reserved: 0,
    };
    let full_face = |(face, &corners): (u32, &[u32; 3])| FullFace { corners, face };
    let mut parts = SpmParts {
        header: ModelHeader {
            diagonal: header.diagonal,
            origin: header.origin,
            lower: header.lower,
            upper: header.upper,
            grid: RegionGrid::new(lower, upper, 1).unwrap_or(RegionGrid::zeroed()),
            level_tolerances,
            base_vertices: vertices.len() as u32,
            base_faces: count,
            faces: count,
            ..ModelHeader::zeroed()
        },
        summary: BuildSummary::default(),
        base_vertices: vertices.iter().map(base_vertex).collect(),
        base_faces: (0..).zip(&faces).zip(&triangles).map(base_face).collect(),
        quartered: Vec::new(),
        records: Vec::new(),
        regions: vec![RegionId::of_cell(UVec3::ZERO)],
        seed_offsets: vec![0, 0],
        seeds: Vec::new(),
        full_faces: (0..).zip(&triangles).map(full_face).collect(),
        base_splits: vec![NONE; vertices.len()],
        hierarchy: Vec::new(),
    };
    parts.seal();
    Ok(parts)
}

/// The mesh after all splits of the prefix.
fn prefix<D: AsRef<[u8]>>(file: &SpmFile<D>, max_faces: u32) -> Result<ActiveMesh, FileError> {
    let header = file.model_header();
    // A split creates at least one face.
    let slots = header.vsps.min(max_faces.saturating_sub(header.base_faces));
    let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, slots);
    for (k, vertex) in (0u32..).zip(file.base_vertices()) {
        mesh.set_base_vertex(k, vertex.position, Certified::EXACT);
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
        mesh.load(i, &record, record.vs, record.fn_, [Certified::EXACT; 2]);
        if !mesh.split_is_legal(i) {
            return Err(FileError::Inconsistent(Section::Records));
        }
        mesh.split(i, &mut out)
            .map_err(|_| FileError::Inconsistent(Section::Records))?;
    }
    Ok(mesh)
}

/// Active faces, and their vertices numbered as the faces first name them.
#[derive(Default)]
struct Numbered {
    /// Ascending.
    faces: Vec<Handle>,
    vertices: Vec<Handle>,
    /// Corners by these numbers.
    triangles: Vec<[u32; 3]>,
}

impl Numbered {
    fn of(mesh: &ActiveMesh) -> Self {
        let mut all = Self::default();
        let mut places = BTreeMap::new();
        mesh.for_each_active_face(|face| {
            all.faces.push(face);
            all.triangles.push(mesh.face(face).corners.map(|vertex| {
                *places.entry(vertex).or_insert_with(|| {
                    all.vertices.push(vertex);
                    all.vertices.len() as u32 - 1
                })
            }));
        });
        all
    }
}
