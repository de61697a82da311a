//! The active bounding tree (thesis 3.3): an AABB tree of fixed shape over the faces of the full
//! mesh, of which only the part above active faces exists.
//!
//! | module | content |
//! |---|---|
//! | `key` | heap keys of nodes, and the fixed shape |
//! | `tree` | insertion, removal, and the refit of what changed |
//!
//! ```
//! use ab_tree::{AbTree, NONE, leaf_key};
//! use geometry::Aabb;
//! use glam::Vec3;
//!
//! // Three active faces, the boxes of which are points on the x axis, of a full mesh of eight.
//! let face_box = |face: u32| Aabb::of_points([Vec3::X * face as f32]);
//! let mut tree = AbTree::new(8);
//! tree.preconstruct(8);
//! for face in [0, 3, 7] {
//!     assert!(tree.insert(face, leaf_key(face, 8)));
//! }
//! tree.refit(face_box);
//! assert_eq!(tree.root_box().upper, Vec3::X * 7.0);
//!
//! tree.remove(7);
//! tree.refit(face_box);
//! assert_eq!(tree.root_box().upper, Vec3::X * 3.0);
//! tree.check(face_box);
//! assert!(tree.leaf_of(7) == 0 && tree.leaf_of(3) != NONE);
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod key;
mod tree;

/// Index of a vertex or a face of an active mesh; [`NONE`] for none.
pub type Handle = u32;
/// No vertex, face, leaf or VSP.
pub const NONE: u32 = u32::MAX;

pub use key::{depth, is_leaf_key, leaf_key, lowest_common_ancestor};
pub use tree::{AbTree, Child, FACE_BIT, Node, NodeId};
