//! The space-partitioned progressive mesh (thesis 5.3).
//!
//! An SPM is a base mesh, n vertex split records (VSPs) and a sparse grid of regions. Ids are implicit:
//! with V0 base vertices and F0 base faces, VSP i makes the vertices V0 + 2i (vt) and V0 + 2i + 1 (vu)
//! and the faces F0 + 2i (fl) and F0 + 2i + 1 (fr, unused at a rim).
//!
//! ```text
//!            vl                         vl
//!          / | \                      / | \
//!     fn0 /  |  \ fn1            fn0 / fl  \ fn1
//!        /   |   \      split i     /  / \  \
//!       +---vs----+    -------->   +--vt--vu-+
//!        \   |   /     <--------    \  \ /  /
//!     fn2 \  |  / fn3  collapse i fn2 \ fr / fn3
//!          \ | /                      \ | /
//!            vr                         vr
//! ```
//!
//! The *dependencies* of VSP i are the VSPs that made vs and fn0..fn3. A set of VSPs that holds every
//! dependency of its members is a *front*, and every front is a legal mesh.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod active_mesh;
mod error_code;
mod file;
mod header;
mod hierarchy;
mod prefix_mesh;
mod record;
mod regions;

pub use ab_tree::{Handle, NONE};
pub use active_mesh::{ActiveMesh, DamagedRecord, Face, FrontWalk, Geomorph, OperationFaces, Slot};
pub use error_code::ErrorScale;
pub use file::{
    BLOCK_BYTES, BuildSummary, FORMAT_VERSION, FileError, FullFace, Section, SpmFile, SpmHeader,
    SpmParts, write_spm,
};
pub use header::{BaseFace, BaseVertex, ModelHeader};
pub use hierarchy::{ReachScale, VspNode};
pub use prefix_mesh::prefix_mesh;
pub use record::{RecordError, Sizes, VspRecord};
pub use regions::{LEVELS, RegionGrid, RegionId};
