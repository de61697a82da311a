//! The space-partitioned progressive mesh (thesis 5.3).
//!
//! An SPM is a base mesh, n vertex split records (VSPs) and a sparse grid of regions. Ids are
//! implicit: with V0 base vertices and F0 base faces, VSP i makes the vertices V0 + 2i (vt) and V0
//! + 2i + 1 (vu) and the faces F0 + 2i (fl) and F0 + 2i + 1 (fr, unused at a boundary).
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
//! The *dependencies* of VSP i are the VSPs that create vs and fn0..fn3. A set of VSPs that
//! contains every dependency of its members is a *front*, and every front is a legal mesh.
//!
//! | module | content |
//! |---|---|
//! | `record` | vertex split records and implicit ids |
//! | `header` | header and base mesh of a model |
//! | `regions` | the grid of regions |
//! | `hierarchy` | the vertex hierarchy and its bounds |
//! | `error_code` | errors as 16 bits |
//! | `certified` | what is certified of a vertex |
//! | `quarters` | what is certified of the quarters of some faces |
//! | `active_mesh` | the surface of a front: splits, collapses, geomorphs |
//! | `file` | the SPM file |
//! | `prefix_mesh` | one level of detail as plain triangles |
//!
//! ```
//! use spm::{ActiveMesh, ErrorScale, OperationFaces, SpmFile, SpmParts, write_spm};
//!
//! let mut bytes = Vec::new();
//! write_spm(&SpmParts::hexagon(), &mut bytes)?;
//! let file = SpmFile::open(bytes)?;
//! let header = file.model_header();
//! assert_eq!((header.base_faces, header.vsps, header.faces), (6, 1, 8));
//!
//! let scale = ErrorScale::for_diagonal(header.diagonal);
//! // The base mesh, then its only split.
//! let mut mesh = ActiveMesh::new(header.base_vertices, header.base_faces, header.vsps)
//!     .with_quarters(header.quartered as usize);
//! for (vertex, base) in (0..).zip(file.base_vertices()) {
//!     mesh.set_base_vertex(vertex, base.position, scale.certified_of_base(base));
//! }
//! for (face, base) in (0..).zip(file.base_faces()) {
//!     mesh.set_base_face(face, base.corners, base.neighbours);
//! }
//! for quartered in file.quartered_faces() {
//!     assert!(mesh.add_quarters(quartered, scale));
//! }
//! let record = file.record(0)?;
//! mesh.load(0, &record, record.vs, record.fn_, scale.certified(&record));
//! mesh.split(0, &mut OperationFaces::new())?;
//! assert_eq!(mesh.active_faces(), 8);
//! mesh.check();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod active_mesh;
mod certified;
mod error_code;
mod file;
mod header;
mod hierarchy;
mod prefix_mesh;
mod quarters;
mod record;
mod regions;
#[cfg(feature = "serde")]
pub mod reserved;

pub use ab_tree::{Handle, NONE};
pub use active_mesh::{
    ActiveMesh, Face, FrontWalk, Geomorph, OperationError, OperationFaces, Slot,
};
pub use certified::{Certified, CertifiedCode};
pub use error_code::ErrorScale;
pub use file::{
    BLOCK_BYTES, BuildSummary, FORMAT_VERSION, FileError, FullFace, Section, SpmFile, SpmHeader,
    SpmParts, write_spm,
};
pub use header::{BaseFace, BaseVertex, ModelHeader};
pub use hierarchy::{BoundsScale, VspNode};
pub use prefix_mesh::{prefix_mesh, prefix_parts};
pub use quarters::{QuarterCodes, QuarteredFace};
pub use record::{RecordError, Sizes, VspRecord};
pub use regions::{LEVELS, RegionGrid, RegionId};
