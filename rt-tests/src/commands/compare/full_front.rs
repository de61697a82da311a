//! Our tree over a front with every split of the sequence up to some point performed: at the end,
//! the full mesh.

use crate::failure::Failure;
use crate::models::Model;
use ab_tree::AbTree;
use hrtc_core::contact::query::Surface;
use spm::{ActiveMesh, Handle, NONE, OperationFaces};
use std::time::Instant;

/// A prefix of the sequence as a front, mostly the full mesh.
pub struct FullFront {
    mesh: ActiveMesh,
    tree: AbTree,
    /// Nanoseconds that it took to put every face into the tree and fit all boxes.
    pub build_ns: f64,
}

impl FullFront {
    /// Performs every split and builds the tree.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn new(model: &Model) -> Result<Self, Failure> {
        Self::prefix(model, model.records.len())
    }

    /// Performs the first splits, so many of them, and builds the tree.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn prefix(model: &Model, splits: usize) -> Result<Self, Failure> {
        let failed =
            |error: &dyn std::fmt::Display| Failure::Run(format!("{}: {error}", model.name));
        let header = model.file.model_header();
        let mut mesh = model.active_mesh();
        let mut out = OperationFaces::new();
        for record in &model.records[..splits] {
            mesh.split(record.i, &mut out)
                .map_err(|error| failed(&error))?;
        }
        let leaves: Vec<(Handle, u32)> = Self::leaves(model)
            .filter(|&(face, _)| mesh.is_active(face))
            .collect();
        let start = Instant::now();
        let mut tree = AbTree::new(header.base_faces + 2 * header.vsps);
        tree.preconstruct(header.faces);
        for &(face, leaf) in &leaves {
            if !tree.insert(face, leaf) {
                return Err(failed(&"a leaf code is damaged"));
            }
        }
        tree.refit(|face| mesh.face_box(face));
        Ok(Self {
            mesh,
            tree,
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
        let vsps = self.mesh.performed() as usize;
        faces * AbTree::BYTES_PER_FACE + vsps * ActiveMesh::BYTES_PER_SLOT
    }
}
