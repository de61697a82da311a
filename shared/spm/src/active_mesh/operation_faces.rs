//! The faces that a split, a collapse or a step of a vertex changes.

use super::{Handle, NONE};
use glam::Vec3;

/// Why the faces around a vertex are not collected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FanError {
    /// They are not what a record says.
    Broken,
    /// There are more than [`OperationFaces::MAX_FACES`].
    TooLarge,
}

/// The faces that one operation changes, in storage that is allocated once.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OperationFaces {
    /// Faces created (split) or removed (collapse): fl, then fr where there is one.
    pub pair: [Handle; 2],
    /// Number of valid entries of `pair`: 0 for a step, else 1 or 2.
    pub pair_count: usize,
    /// Leaf codes of the pair.
    pub leaves: [u32; 2],
    #[cfg_attr(feature = "serde", serde(with = "serde_big_array::BigArray"))]
    pub(super) deformed: [Handle; Self::MAX_FACES],
    /// Number of deformed faces in the fan of vt; all of them for a step.
    pub(super) of_t: usize,
    pub(super) count: usize,
    /// Current corner of the faces of vt, and that of the faces of vu.
    pub(super) moved: [Handle; 2],
    /// Position of that corner before the operation.
    pub(super) from: [Vec3; 2],
    /// R of the split vertex.
    pub(super) radius: f32,
    /// Whether the pair was created.
    pub(super) made: bool,
    /// Most deformed faces that may be collected.
    limit: usize,
}

impl OperationFaces {
    /// Largest number of deformed faces. On the fronts of the builder's sequence fans are far
    /// smaller; on others a vertex may have all the faces that it has in the full mesh. What would
    /// change more waits, see [`super::OperationError::TooManyFaces`].
    pub const MAX_FACES: usize = 512;

    /// Empty storage.
    #[must_use]
    pub fn new() -> Self {
        Self {
            pair: [NONE; 2],
            pair_count: 0,
            leaves: [NONE; 2],
            deformed: [NONE; Self::MAX_FACES],
            of_t: 0,
            count: 0,
            moved: [NONE; 2],
            from: [Vec3::ZERO; 2],
            radius: 0.0,
            made: false,
            limit: Self::MAX_FACES,
        }
    }

    /// What would change more faces than this waits from now on, as if they were more than
    /// [`Self::MAX_FACES`].
    pub fn set_limit(&mut self, faces: usize) {
        self.limit = faces.min(Self::MAX_FACES);
    }

    /// Faces that stay but change their shape.
    #[must_use]
    pub fn deformed(&self) -> &[Handle] {
        &self.deformed[..self.count]
    }

    /// The deformed faces of vt, and those of vu.
    #[must_use]
    pub fn fans(&self) -> (&[Handle], &[Handle]) {
        self.deformed().split_at(self.of_t)
    }

    /// The created or removed faces.
    #[must_use]
    pub fn made_or_removed(&self) -> &[Handle] {
        &self.pair[..self.pair_count]
    }

    pub(super) fn push(&mut self, face: Handle) -> Result<(), FanError> {
        let free = self.deformed[..self.limit].get_mut(self.count);
        *free.ok_or(FanError::TooLarge)? = face;
        self.count += 1;
        Ok(())
    }
}

impl Default for OperationFaces {
    fn default() -> Self {
        Self::new()
    }
}
