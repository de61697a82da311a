//! The active bounding tree (thesis 3.3): an AABB tree of fixed shape over the faces of the full mesh, of
//! which only the part above active faces exists.

mod key;
mod tree;

pub use key::{depth, is_leaf_key, leaf_key, lowest_common_ancestor};
pub use tree::{AbTree, Child, Node, NodeId};
