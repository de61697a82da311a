//! What a model is before its first record: its size, its base mesh, and the bounds of quarters.

use super::{Cache, CacheError};
use spm::{BaseFace, BaseVertex, ErrorScale, ModelHeader, QuarteredFace};

impl Cache {
    /// Shares the storage out to a model; once, and again when another one is forgotten.
    ///
    /// # Errors
    /// When the base mesh and the model's largest closure do not fit.
    pub fn begin_model(&mut self, header: &ModelHeader) -> Result<(), CacheError> {
        let slots = self.mesh.reshape(header.base_vertices, header.base_faces);
        match slots {
            Some(slots) if slots >= header.closure_max => {
                self.sizes = header.sizes();
                self.quartered = header.quartered;
                self.scale = ErrorScale::for_diagonal(header.diagonal);
                self.slots = slots;
                self.most_slots = self.most_slots.max(slots);
                self.most_faces = self.most_faces.max(header.base_faces + 2 * slots);
                self.tree.preconstruct(header.faces);
                Ok(())
            }
            _ => Err(CacheError::TooSmall {
                bytes: self.bytes,
                needed: Self::least_bytes(header),
                base_faces: header.base_faces,
            }),
        }
    }

    /// Sets a base vertex; false when its numbers cannot be.
    #[must_use]
    pub fn set_base_vertex(&mut self, vertex: u32, value: &BaseVertex) -> bool {
        if value.reserved != 0 || !value.position.iter().all(|x| x.is_finite()) {
            return false;
        }
        let certified = self.scale.certified_of_base(value);
        self.mesh.set_base_vertex(vertex, value.position, certified);
        true
    }

    /// Sets a base face; false when its numbers cannot be.
    #[must_use]
    pub fn set_base_face(&mut self, face: u32, value: &BaseFace) -> bool {
        value.reserved == 0
            && self
                .mesh
                .set_base_face(face, value.corners, value.neighbours)
                .is_some()
            && self.tree.insert(face, value.leaf)
    }

    /// Adds what is certified of the quarters of the next face of the model's table; false when its
    /// numbers cannot be.
    #[must_use]
    pub fn add_quarters(&mut self, value: &QuarteredFace) -> bool {
        value.is_valid(self.sizes, None) && self.mesh.add_quarters(value, self.scale)
    }

    /// The place in the model's table of the first face whose quarters are not known yet, if any.
    #[must_use]
    pub fn next_quarters(&self) -> Option<u32> {
        let next = self.mesh.quartered() as u32;
        (next < self.quartered).then_some(next)
    }
}
