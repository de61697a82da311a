//! What a split, a collapse or a step of a vertex touched.

use super::{Handle, NONE};
use glam::Vec3;

/// The faces that one operation touched, in storage that is made once.
#[derive(Debug, Clone)]
pub struct OperationFaces {
    /// Faces made (split) or removed (collapse): fl, then fr where there is one.
    pub pair: [Handle; 2],
    /// How many of `pair` are valid: none of a step, else 1 or 2.
    pub pair_count: usize,
    /// Leaf codes of the pair.
    pub leaves: [u32; 2],
    pub(super) deformed: [Handle; Self::MAX],
    /// How many of the deformed faces are of vt; of a step all.
    pub(super) of_t: usize,
    pub(super) count: usize,
    /// The corner that the faces of vt have now, and that of the faces of vu.
    pub(super) moved: [Handle; 2],
    /// Where these faces had that corner before.
    pub(super) from: [Vec3; 2],
    /// R of the vertex that was split, there.
    pub(super) radius: f32,
    /// Whether the pair was made.
    pub(super) made: bool,
}

impl OperationFaces {
    /// The most faces around one vertex that an operation can move; the builder keeps fans far smaller.
    pub const MAX: usize = 512;

    /// Empty storage.
    #[must_use]
    pub fn new() -> Self {
        Self {
            pair: [NONE; 2],
            pair_count: 0,
            leaves: [NONE; 2],
            deformed: [NONE; Self::MAX],
            of_t: 0,
            count: 0,
            moved: [NONE; 2],
            from: [Vec3::ZERO; 2],
            radius: 0.0,
            made: false,
        }
    }

    /// Faces whose shape changed but which stay.
    #[must_use]
    pub fn deformed(&self) -> &[Handle] {
        &self.deformed[..self.count]
    }

    /// Those of them that are of vt, then those of vu.
    #[must_use]
    pub fn fans(&self) -> (&[Handle], &[Handle]) {
        self.deformed().split_at(self.of_t)
    }

    /// The made or removed faces.
    #[must_use]
    pub fn made_or_removed(&self) -> &[Handle] {
        &self.pair[..self.pair_count]
    }

    pub(super) fn push(&mut self, face: Handle) -> Option<()> {
        *self.deformed.get_mut(self.count)? = face;
        self.count += 1;
        Some(())
    }
}

impl Default for OperationFaces {
    fn default() -> Self {
        Self::new()
    }
}
