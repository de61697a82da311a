//! Our tree over the full mesh, and over a front with every split of the sequence up to some point
//! performed.
//!
//! The full mesh is as any library gets it: nothing is left to refine, vertices and faces are in
//! the order of the tree. (After all splits they are in the order of these: where a query comes to
//! another place, it then reads other cache lines for each face.)

use super::questions::FullMesh;
use crate::failure::Failure;
use crate::models::Model;
use ab_tree::{AbTree, leaf_key};
use hrtc_core::contact::query::Surface;
use spm::{ActiveMesh, BuildSummary, Certified, Handle, NONE, OperationFaces};
use spm_builder::{ManifoldMesh, in_tree_order};
use std::collections::HashMap;
use std::hint::black_box;
use std::time::Instant;

/// The full mesh, or a prefix of the sequence as a front.
pub struct FullFront {
    mesh: ActiveMesh,
    tree: AbTree,
    /// Vertices of the front.
    vertices: usize,
    /// Nanoseconds that it took to put every face into the tree and fit all boxes. No build from
    /// triangles: the leaf codes are in the file, where the builder has ordered the faces.
    pub build_ns: f64,
}

/// Nanoseconds of all that a tree over triangles takes: ordering the faces, storing the mesh, and
/// what [`FullFront`] took to put them into the tree and fit the boxes. On one thread, as a library
/// builds its own; the product orders them once, where it makes the file.
///
/// # Errors
/// When there is no thread for it.
pub fn build_ns<D: AsRef<[u8]>>(
    model: &Model<D>,
    of: &FullMesh,
    front: &FullFront,
) -> Result<f64, Failure> {
    let given = || ManifoldMesh {
        positions: of
            .positions
            .iter()
            .map(|p| p.as_vec3().to_array())
            .collect(),
        triangles: of.faces.clone(),
        copies: vec![false; of.positions.len()],
        locked: vec![false; of.positions.len()],
        summary: BuildSummary::default(),
    };
    let (order, store) = (given(), given());
    let neighbours: Vec<[Handle; 3]> = (0..of.faces.len() as u32)
        .map(|face| front.mesh.face(face).neighbours)
        .collect();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone.map_err(|error| failed(model, &error))?;
    let ns = alone.install(|| {
        let start = Instant::now();
        black_box(in_tree_order(order));
        let (vertices, faces) = (&store.positions, &store.triangles);
        let mut mesh = ActiveMesh::new(vertices.len() as u32, faces.len() as u32, 0);
        for (vertex, &position) in (0u32..).zip(vertices) {
            mesh.set_base_vertex(vertex, position, Certified::EXACT);
        }
        for ((face, &corners), &beside) in (0u32..).zip(faces).zip(&neighbours) {
            mesh.set_base_face(face, corners, beside)?;
        }
        black_box(&mesh);
        Some(start.elapsed().as_nanos() as f64)
    });
    let ns = ns.ok_or_else(|| failed(model, &"a face is damaged"))?;
    Ok(ns + front.build_ns)
}

impl FullFront {
    /// The full mesh: the handle of a face is its place in the order of the tree.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn new<D: AsRef<[u8]>>(model: &Model<D>) -> Result<Self, Failure> {
        let split = split_mesh(model, model.records.len())?;
        let (positions, faces) = model.full_mesh();
        let count = faces.len() as u32;
        let mut places = HashMap::new();
        for place in 0..count {
            let full = model.file.full_face(place);
            let full = full.map_err(|error| failed(model, &error))?;
            places.insert(full.face, place);
        }
        let mut mesh = ActiveMesh::new(positions.len() as u32, count, 0);
        for (vertex, position) in (0u32..).zip(&positions) {
            mesh.set_base_vertex(vertex, position.as_vec3().to_array(), Certified::EXACT);
        }
        for (&handle, &place) in &places {
            let neighbours = split.face(handle).neighbours;
            let neighbours = neighbours.map(|of| places.get(&of).copied().unwrap_or(NONE));
            mesh.set_base_face(place, faces[place as usize], neighbours)
                .ok_or_else(|| failed(model, &"a face is damaged"))?;
        }
        let leaves: Vec<_> = (0..count)
            .map(|place| (place, leaf_key(place, count)))
            .collect();
        Self::over(model, (mesh, positions.len()), &leaves)
    }

    /// Performs the first splits, so many of them, and builds the tree.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn prefix(model: &Model, splits: usize) -> Result<Self, Failure> {
        let mesh = split_mesh(model, splits)?;
        let leaves: Vec<(Handle, u32)> = Self::leaves(model)
            .filter(|&(face, _)| mesh.is_active(face))
            .collect();
        // Each split makes one of a vertex two.
        let vertices = model.file.model_header().base_vertices as usize + splits;
        Self::over(model, (mesh, vertices), &leaves)
    }

    /// Builds the tree over faces with their leaf codes.
    fn over<D: AsRef<[u8]>>(
        model: &Model<D>,
        (mesh, vertices): (ActiveMesh, usize),
        leaves: &[(Handle, u32)],
    ) -> Result<Self, Failure> {
        let handles = leaves.iter().map(|&(face, _)| face + 1).max();
        let start = Instant::now();
        let mut tree = AbTree::new(handles.unwrap_or(0));
        tree.preconstruct(model.file.model_header().faces);
        for &(face, leaf) in leaves {
            if !tree.insert(face, leaf) {
                return Err(failed(model, &"a leaf code is damaged"));
            }
        }
        tree.refit(|face| mesh.face_box(face));
        Ok(Self {
            mesh,
            tree,
            vertices,
            build_ns: start.elapsed().as_nanos() as f64,
        })
    }

    /// Every face of the full mesh with its leaf code.
    fn leaves(model: &Model) -> impl Iterator<Item = (Handle, u32)> + '_ {
        let first = model.file.model_header().base_faces;
        let base = (0u32..)
            .zip(model.file.base_faces())
            .map(|(face, of)| (face, of.leaf));
        let made = model.records.iter().flat_map(move |record| {
            let fl = first + 2 * record.i;
            [(fl, record.leaf_l), (fl + 1, record.leaf_r)]
        });
        base.chain(made.filter(|&(_, leaf)| leaf != NONE))
    }

    /// What is queried.
    #[must_use]
    pub fn surface(&self) -> Surface<'_> {
        Surface {
            mesh: &self.mesh,
            tree: &self.tree,
        }
    }

    /// The mesh, and the tree to be deformed.
    pub fn parts_mut(&mut self) -> (&ActiveMesh, &mut AbTree) {
        (&self.mesh, &mut self.tree)
    }

    /// The mesh.
    #[must_use]
    pub fn mesh(&self) -> &ActiveMesh {
        &self.mesh
    }

    /// Bytes of the tree, and of the mesh that it needs for its queries.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let faces = self.mesh.active_faces() as usize;
        faces * (AbTree::BYTES_PER_FACE + ActiveMesh::BYTES_PER_BASE_FACE)
            + self.vertices * ActiveMesh::BYTES_PER_BASE_VERTEX
    }
}

/// Every face with the first splits performed, so many of them.
fn split_mesh<D: AsRef<[u8]>>(model: &Model<D>, splits: usize) -> Result<ActiveMesh, Failure> {
    let mut mesh = model.active_mesh();
    let mut out = OperationFaces::new();
    for record in &model.records[..splits] {
        mesh.split(record.i, &mut out)
            .map_err(|error| failed(model, &error))?;
    }
    Ok(mesh)
}

fn failed<D>(model: &Model<D>, error: &dyn std::fmt::Display) -> Failure {
    Failure::Run(format!("{}: {error}", model.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use spm_builder::{BuildOptions, NoProgress, SoupMesh};

    #[test]
    fn the_bytes_of_separate_triangles_hold_three_vertices_for_each() {
        const FACES: u32 = 200;
        let mut mesh = SoupMesh::default();
        for face in 0..FACES {
            let [x, y] = [face % 20, face / 20].map(|of| 2.0 * f64::from(of));
            let corners = [[x, y, 0.0], [x + 1.0, y, 0.0], [x, y + 1.0, 0.5]];
            mesh.positions.extend(corners);
            mesh.triangles.push([0, 1, 2].map(|k| 3 * face + k));
        }
        let name = "separate triangles".to_string();
        let model = Model::build(name, mesh, &BuildOptions::default(), &NoProgress);
        let model = model.unwrap_or_else(|error| panic!("{error}"));
        let faces = FACES as usize;
        let of_faces = faces * (AbTree::BYTES_PER_FACE + ActiveMesh::BYTES_PER_BASE_FACE);
        let expected = of_faces + 3 * faces * ActiveMesh::BYTES_PER_BASE_VERTEX;
        let prefix = FullFront::prefix(&model, model.records.len());
        for front in [FullFront::new(&model), prefix] {
            let front = front.unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(front.bytes(), expected);
        }
    }
}
