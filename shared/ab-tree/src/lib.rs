//! The active bounding tree (thesis 3.3): an AABB tree of fixed shape over the faces of the full mesh, of
//! which only the part above active faces exists.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod key;
mod tree;

/// A vertex or a face of an active mesh, by its place in it; [`NONE`] for none.
pub type Handle = u32;
/// No vertex, face, leaf or VSP.
pub const NONE: u32 = u32::MAX;

pub use key::{depth, is_leaf_key, leaf_key, lowest_common_ancestor};
pub use tree::{AbTree, Child, Node, NodeId};
