//! A body of a pair query: a tree whose boxes and corners are given in the frame of the query.
//!
//! The frame is that of one body, mostly the larger one. The other is a [`Placed`] body, whose
//! boxes are transformed when they are visited, or a tool, whose vertices were moved and whose tree
//! was refitted before.

use super::Surface;
use ab_tree::{Child, NodeId};
use geometry::{Aabb, BoxPair, Similarity};
use glam::DVec3;
use spm::{Handle, NONE};

/// A body of a pair query.
pub trait Body {
    /// The root of its tree; `None` for an empty body.
    fn root(&self) -> Option<Child>;

    /// A box in the query's frame that bounds the body.
    fn root_box(&self) -> Aabb;

    /// The children of a node and their boxes in the query's frame.
    fn children(&self, node: NodeId) -> ([Child; 2], BoxPair);

    /// The corners of a face in the query's frame; the same bits for every call and for all faces
    /// that share the vertex.
    fn corners(&self, face: Handle) -> [DVec3; 3];

    /// Whether a face is active: a hint of an earlier tick may name one that has gone.
    fn has(&self, face: Handle) -> bool;
}

impl Body for Surface<'_> {
    #[inline]
    fn root(&self) -> Option<Child> {
        self.tree.root()
    }

    fn root_box(&self) -> Aabb {
        *self.tree.root_box()
    }

    #[inline]
    fn children(&self, node: NodeId) -> ([Child; 2], BoxPair) {
        let node = self.tree.node(node);
        (node.children(), *node.boxes())
    }

    #[inline]
    fn corners(&self, face: Handle) -> [DVec3; 3] {
        self.mesh.corners(face)
    }

    fn has(&self, face: Handle) -> bool {
        face != NONE && self.mesh.is_active(face)
    }
}

/// A body transformed into the query's frame, box by box when visited: for two large fronts of
/// which a query visits little.
#[derive(Debug, Clone, Copy)]
pub struct Placed<B> {
    /// The body in its own frame.
    pub body: B,
    /// From its own frame to the query's.
    pub to_query: Similarity,
}

impl<B: Body> Body for Placed<B> {
    #[inline]
    fn root(&self) -> Option<Child> {
        self.body.root()
    }

    fn root_box(&self) -> Aabb {
        self.to_query.box_around(&self.body.root_box())
    }

    #[inline]
    fn children(&self, node: NodeId) -> ([Child; 2], BoxPair) {
        let (children, boxes) = self.body.children(node);
        let moved = [0, 1].map(|side| self.to_query.box_around(&boxes.get(side)));
        (children, BoxPair::new(moved))
    }

    #[inline]
    fn corners(&self, face: Handle) -> [DVec3; 3] {
        self.body
            .corners(face)
            .map(|corner| self.to_query.point(corner))
    }

    fn has(&self, face: Handle) -> bool {
        self.body.has(face)
    }
}

impl<B: Body> Body for &B {
    #[inline]
    fn root(&self) -> Option<Child> {
        (*self).root()
    }

    fn root_box(&self) -> Aabb {
        (*self).root_box()
    }

    #[inline]
    fn children(&self, node: NodeId) -> ([Child; 2], BoxPair) {
        (*self).children(node)
    }

    #[inline]
    fn corners(&self, face: Handle) -> [DVec3; 3] {
        (*self).corners(face)
    }

    fn has(&self, face: Handle) -> bool {
        (*self).has(face)
    }
}
