//! The vertex split record: 64 bytes, one cache line, the same in the file, on the wire and in the
//! cache.

use super::{Certified, CertifiedCode, ErrorScale};
use ab_tree::NONE;
use bytemuck::{Pod, Zeroable};
use thiserror::Error;

/// Vertex split record i (thesis 5.3.1.3), with absolute positions and implicit ids.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct VspRecord {
    /// Its index in the sequence, 0..n.
    pub i: u32,
    /// The split vertex.
    pub vs: u32,
    /// Neighbours of the new faces: fn0 across (vl, vt), fn1 across (vl, vu), fn2 across (vr, vt),
    /// fn3 across (vr, vu); [`NONE`] at a boundary.
    pub fn_: [u32; 4],
    /// AB-tree leaf code of fl: the heap index of its leaf.
    pub leaf_l: u32,
    /// AB-tree leaf code of fr; [`NONE`] when the split creates one face only.
    pub leaf_r: u32,
    /// Position of vt, model units.
    pub pos_t: [f32; 3],
    /// Position of vu, model units.
    pub pos_u: [f32; 3],
    /// What is certified of vt and of vu.
    pub certified: [CertifiedCode; 2],
    /// Code of the expected error E(i) (see [`super::ErrorScale`]); the largest is beyond any
    /// tolerance.
    pub e: u16,
}

// The layout of the file (`FORMAT_VERSION`): a change needs a new version.
const _: () = {
    use std::mem::offset_of;
    assert!(size_of::<VspRecord>() == 64);
    assert!(offset_of!(VspRecord, vs) == 4 && offset_of!(VspRecord, fn_) == 8);
    assert!(offset_of!(VspRecord, leaf_l) == 24 && offset_of!(VspRecord, leaf_r) == 28);
    assert!(offset_of!(VspRecord, pos_t) == 32 && offset_of!(VspRecord, pos_u) == 44);
    assert!(offset_of!(VspRecord, certified) == 56 && offset_of!(VspRecord, e) == 62);
};

/// Sizes of a model, which define its implicit ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sizes {
    /// V0, vertices of the base mesh.
    pub base_vertices: u32,
    /// F0, faces of the base mesh.
    pub base_faces: u32,
    /// n, number of VSPs.
    pub vsps: u32,
    /// Faces of the full mesh, and so leaves of the AB-tree.
    pub faces: u32,
}

impl Sizes {
    /// The VSP that creates a vertex, `None` for a base vertex.
    #[must_use]
    pub fn creator_of_vertex(&self, v: u32) -> Option<u32> {
        v.checked_sub(self.base_vertices).map(|k| k / 2)
    }

    /// The VSP that creates a face, `None` for a base face.
    #[must_use]
    pub fn creator_of_face(&self, f: u32) -> Option<u32> {
        f.checked_sub(self.base_faces).map(|k| k / 2)
    }

    /// vt of VSP i; vu is the next id.
    #[must_use]
    pub fn vt(&self, i: u32) -> u32 {
        self.base_vertices + 2 * i
    }

    /// fl of VSP i; fr is the next id.
    #[must_use]
    pub fn fl(&self, i: u32) -> u32 {
        self.base_faces + 2 * i
    }
}

/// Why a record cannot belong to a model of the given sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum RecordError {
    /// The record's own number is out of range or not the expected one.
    #[error("vertex split record {0} is not at its place")]
    Number(u32),
    /// A vertex or face that does not exist before the split.
    #[error("vertex split record {0} refers to a vertex or face that does not exist before it")]
    Reference(u32),
    /// A position that is not finite.
    #[error("vertex split record {0} has a position that is not a finite number")]
    Position(u32),
    /// A leaf code that is not a leaf of the AB-tree.
    #[error("vertex split record {0} has a leaf code outside the bounding tree")]
    Leaf(u32),
}

impl ErrorScale {
    /// What is certified of vt and vu of a record.
    #[must_use]
    pub fn certified(self, record: &VspRecord) -> [Certified; 2] {
        record.certified.map(|code| code.decode(self, record.e))
    }
}

impl VspRecord {
    /// Whether the split creates two faces; one at a boundary.
    #[must_use]
    pub fn has_right_face(&self) -> bool {
        self.leaf_r != NONE
    }

    /// The VSPs that must be performed before this one, with repetitions, at most five.
    pub fn dependencies(&self, sizes: Sizes) -> impl Iterator<Item = u32> + use<> {
        let of_faces = self.fn_;
        sizes.creator_of_vertex(self.vs).into_iter().chain(
            of_faces
                .into_iter()
                .filter(|&f| f != NONE)
                .filter_map(move |f| sizes.creator_of_face(f)),
        )
    }

    /// Checks everything that a single record allows to check.
    ///
    /// # Errors
    /// The first fault, with the number of the record.
    pub fn validate(&self, expected: u32, sizes: Sizes) -> Result<(), RecordError> {
        if self.i != expected || self.i >= sizes.vsps {
            return Err(RecordError::Number(expected));
        }
        let before_vertices = u64::from(sizes.base_vertices) + 2 * u64::from(self.i);
        let before_faces = u64::from(sizes.base_faces) + 2 * u64::from(self.i);
        let face_ok = |f: u32| f == NONE || u64::from(f) < before_faces;
        let left_exists = self.fn_[0] != NONE || self.fn_[1] != NONE;
        let right_exists = self.fn_[2] != NONE || self.fn_[3] != NONE;
        if u64::from(self.vs) >= before_vertices
            || !self.fn_.into_iter().all(face_ok)
            || !left_exists
            || right_exists != self.has_right_face()
        {
            return Err(RecordError::Reference(self.i));
        }
        if !self.pos_t.iter().chain(&self.pos_u).all(|x| x.is_finite()) {
            return Err(RecordError::Position(self.i));
        }
        let leaf_ok = |key| ab_tree::is_leaf_key(key, sizes.faces);
        if !leaf_ok(self.leaf_l) || (self.has_right_face() && !leaf_ok(self.leaf_r)) {
            return Err(RecordError::Leaf(self.i));
        }
        Ok(())
    }
}
