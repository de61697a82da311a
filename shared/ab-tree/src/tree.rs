//! The part of the AB-tree above active faces, as a compressed binary trie over heap keys.
//!
//! The full tree of thesis 3.3 has a node for every full-mesh face. Here a node exists only where
//! both of its children hold active faces; sequences of nodes with a single active child are
//! skipped. So there is one node fewer than active faces, whatever the size of the full mesh. A
//! node keeps its heap key, so the shape is that of the thesis. The statuses of Figure 3.8 are:
//! *inactive* = no node, *deformed* = a listed node, *active* = any other.
//!
//! A node is one cache line and holds the boxes of its two children, so a query reads one line to
//! test both.

mod refit;

use super::key::{depth, is_leaf_key, lowest_common_ancestor};
use super::{Handle, NONE};
use geometry::{Aabb, BoxPair};
use refit::LISTED;
use std::ops::Range;

/// Index of a node; [`NONE`] for none.
pub type NodeId = u32;

/// A child of a node, or the root: a node or an active face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Child {
    /// An inner node.
    Node(NodeId),
    /// A leaf: the face itself.
    Face(Handle),
}

/// Marks a face in [`Node::packed_children`].
pub const FACE_BIT: u32 = 1 << 31;

impl Child {
    fn pack(self) -> u32 {
        match self {
            Self::Node(id) => id,
            Self::Face(face) => face | FACE_BIT,
        }
    }

    #[inline]
    fn unpack(packed: u32) -> Self {
        if packed & FACE_BIT == 0 {
            Self::Node(packed)
        } else {
            Self::Face(packed & !FACE_BIT)
        }
    }
}

/// An inner node: 64 bytes.
#[repr(C, align(64))]
#[derive(Debug, Clone, Copy)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Node {
    boxes: BoxPair,
    children: [u32; 2],
    parent: NodeId,
    key: u32,
}

const _: () = assert!(size_of::<Node>() == 64);

/// Key of a node that is not in the tree.
const UNUSED_KEY: u32 = 0;

impl Node {
    const UNUSED: Self = Self {
        boxes: BoxPair::EMPTY,
        children: [0; 2],
        parent: NONE,
        key: UNUSED_KEY,
    };

    /// Boxes of the left and the right child.
    #[inline]
    #[must_use]
    pub fn boxes(&self) -> &BoxPair {
        &self.boxes
    }

    /// The left and the right child.
    #[inline]
    #[must_use]
    pub fn children(&self) -> [Child; 2] {
        self.children.map(Child::unpack)
    }

    /// The same in one number each: that of a node, or the handle of a face and [`FACE_BIT`].
    #[inline]
    #[must_use]
    pub fn packed_children(&self) -> [u32; 2] {
        self.children
    }

    /// Its heap key.
    #[inline]
    #[must_use]
    pub fn key(&self) -> u32 {
        self.key
    }
}

/// An AABB tree over the active faces of one object. Sized once; no operation allocates or
/// recurses.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AbTree {
    /// Faces of the full mesh, which define the shape.
    full_faces: u32,
    /// Those that were ever used, so that the room for the others is not written.
    nodes: Vec<Node>,
    /// For each node: bit 0 = the left child is a deformed face, bit 1 = the right one; with either
    /// goes [`LISTED`].
    deformed: Vec<u8>,
    /// The node that was listed last, [`NONE`] for none: listed are nodes with a deformed face, or
    /// whose own boxes changed since the last refit; each once, some of them released since.
    last_listed: NodeId,
    /// For each node that was ever used: of a listed one, the one that was listed before it.
    listed_before: Vec<NodeId>,
    /// For each face handle: the node above it, and its leaf key (0 = not in the tree; then the
    /// node says nothing). Both begin as zeros, whose room the system does not write.
    face_node: Vec<NodeId>,
    face_key: Vec<u32>,
    root: Option<Child>,
    /// First free node, linked through `parent`.
    free: NodeId,
    faces: u32,
    root_box: Aabb,
    root_face_deformed: bool,
}

impl AbTree {
    /// Bytes for each face of its capacity.
    pub const BYTES_PER_FACE: usize = size_of::<Node>() + 1 + 4 + 4 + 4;

    /// Allocates room for `capacity` face handles. Nodes take memory as they are used, unless the
    /// process has locked its memory.
    #[must_use]
    pub fn new(capacity: u32) -> Self {
        assert!(capacity < FACE_BIT, "face handles have 31 bits");
        let capacity = capacity as usize;
        Self {
            full_faces: 0,
            nodes: Vec::with_capacity(capacity),
            deformed: vec![0; capacity],
            last_listed: NONE,
            listed_before: Vec::with_capacity(capacity),
            face_node: vec![0; capacity],
            face_key: vec![0; capacity],
            root: None,
            free: NONE,
            faces: 0,
            root_box: Aabb::EMPTY,
            root_face_deformed: false,
        }
    }

    /// Empties the tree at once for every query. [`AbTree::forget_faces`] of all handles that were
    /// in use must follow, in as many steps as the caller likes, before a face is inserted. Nothing
    /// is freed or allocated.
    pub fn begin_clear(&mut self) {
        self.root = None;
        self.free = NONE;
        self.nodes.clear();
        self.listed_before.clear();
        self.last_listed = NONE;
        self.faces = 0;
        self.root_box = Aabb::EMPTY;
        self.root_face_deformed = false;
    }

    /// Makes handles unused, after [`AbTree::begin_clear`].
    pub fn forget_faces(&mut self, faces: Range<Handle>) {
        self.face_key[faces.start as usize..faces.end as usize].fill(0);
    }

    /// Defines the shape by the number of faces of the full mesh (ACTIVE-PRECONSTRUCT); the tree
    /// must be empty.
    pub fn preconstruct(&mut self, full_faces: u32) {
        assert!(
            self.faces == 0,
            "the shape of a tree is fixed while it is empty"
        );
        self.full_faces = full_faces;
    }

    /// The root, `None` for an empty tree.
    #[inline]
    #[must_use]
    pub fn root(&self) -> Option<Child> {
        self.root
    }

    /// Box of the whole tree; refitted trees only.
    #[must_use]
    pub fn root_box(&self) -> &Aabb {
        &self.root_box
    }

    /// A node.
    #[inline]
    #[must_use]
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id as usize]
    }

    /// Leaf key of a face of the tree; 0 for one that is not in it.
    #[inline]
    #[must_use]
    pub fn leaf_of(&self, face: Handle) -> u32 {
        self.face_key[face as usize]
    }

    /// Number of faces in the tree.
    #[must_use]
    pub fn faces(&self) -> u32 {
        self.faces
    }

    fn key_of(&self, child: Child) -> u32 {
        match child {
            Child::Node(id) => self.nodes[id as usize].key,
            Child::Face(face) => self.face_key[face as usize],
        }
    }

    fn set_parent(&mut self, child: Child, parent: NodeId) {
        match child {
            Child::Node(id) => self.nodes[id as usize].parent = parent,
            Child::Face(face) => self.face_node[face as usize] = parent,
        }
    }

    #[inline]
    fn child_index(&self, node: NodeId, child: Child) -> usize {
        let children = self.nodes[node as usize].children;
        let index = usize::from(children[1] == child.pack());
        debug_assert_eq!(children[index], child.pack());
        index
    }

    /// Adds an active face at its leaf code, deformed (set I of ACTIVE-UPDATE).
    ///
    /// Returns false without any change when the code is no leaf or is taken (a damaged record).
    pub fn insert(&mut self, face: Handle, leaf: u32) -> bool {
        self.insert_near(face, leaf, NONE)
    }

    /// The same as [`AbTree::insert`], but the search starts at the face `near` if that is in the
    /// tree. Neighbours on the surface are mostly neighbours in the tree, and the descent from the
    /// root is the largest cost of a split.
    pub fn insert_near(&mut self, face: Handle, leaf: u32, near: Handle) -> bool {
        if !is_leaf_key(leaf, self.full_faces) || self.face_key[face as usize] != 0 {
            return false;
        }
        let Some(root) = self.root else {
            self.root = Some(Child::Face(face));
            self.face_key[face as usize] = leaf;
            self.face_node[face as usize] = NONE;
            self.root_face_deformed = true;
            self.faces = 1;
            return true;
        };
        let Some((current, parent, key)) = self.place_of(leaf, near, root) else {
            return false;
        };
        let (child_box, child_deformed) = self.box_above(current, parent);
        let id = self.take_node();
        let index = Self::child_index_of_key(key, leaf);
        let node = &mut self.nodes[id as usize];
        node.key = key;
        node.parent = parent;
        node.children[index] = Child::Face(face).pack();
        node.children[1 - index] = current.pack();
        node.boxes = BoxPair::EMPTY;
        node.boxes.set(1 - index, child_box);
        self.list(id, 1 << index | u8::from(child_deformed) << (1 - index));
        self.face_key[face as usize] = leaf;
        self.face_node[face as usize] = id;
        self.set_parent(current, id);
        match parent {
            NONE => {
                self.root = Some(Child::Node(id));
                self.root_face_deformed = false;
            }
            above => {
                let above_index = Self::child_index_of_key(self.nodes[above as usize].key, leaf);
                self.nodes[above as usize].children[above_index] = Child::Node(id).pack();
                self.deformed[above as usize] &= !(1 << above_index);
            }
        }
        self.faces += 1;
        true
    }

    /// Place of a new leaf: the child that becomes its sibling, the node above that, and the key of
    /// the node to insert between them. `None` when the leaf is taken.
    fn place_of(&self, leaf: u32, near: Handle, root: Child) -> Option<(Child, NodeId, u32)> {
        let (mut current, mut parent) = match self.lowest_above(leaf, near) {
            NONE => (root, NONE),
            id => (Child::Node(id), self.nodes[id as usize].parent),
        };
        // At most one step a level of the tree: 32.
        loop {
            let current_key = self.key_of(current);
            if current_key == leaf {
                return None;
            }
            let common = lowest_common_ancestor(current_key, leaf);
            match current {
                Child::Node(id) if common == current_key => {
                    parent = id;
                    let node = &self.nodes[id as usize];
                    current = node.children()[Self::child_index_of_key(common, leaf)];
                }
                _ => return Some((current, parent, common)),
            }
        }
    }

    /// Box of a child as stored above it, and whether it is a deformed face.
    fn box_above(&self, child: Child, parent: NodeId) -> (Aabb, bool) {
        match parent {
            // `root_box` is that of the last refit; a removal may have changed the boxes below
            // since.
            NONE => match child {
                Child::Node(id) => (self.nodes[id as usize].boxes.union(), false),
                Child::Face(_) => (self.root_box, self.root_face_deformed),
            },
            id => {
                let index = self.child_index(id, child);
                (
                    self.nodes[id as usize].boxes.get(index),
                    self.deformed[id as usize] >> index & 1 == 1,
                )
            }
        }
    }

    /// The lowest node above both a face and a leaf; [`NONE`] when the face is not in the tree or
    /// alone.
    fn lowest_above(&self, leaf: u32, face: Handle) -> NodeId {
        let in_tree = self
            .face_key
            .get(face as usize)
            .is_some_and(|&key| key != 0);
        if !in_tree {
            return NONE;
        }
        let leaf_depth = depth(leaf);
        let mut node = self.face_node[face as usize];
        // At most one step a level of the tree.
        while node != NONE {
            let Node { key, parent, .. } = self.nodes[node as usize];
            let below = leaf_depth.checked_sub(depth(key));
            if below.is_some_and(|below| leaf >> below == key) {
                break;
            }
            node = parent;
        }
        node
    }

    /// Index of the child of node `key` towards `leaf`.
    fn child_index_of_key(key: u32, leaf: u32) -> usize {
        (leaf >> (depth(leaf) - depth(key) - 1) & 1) as usize
    }

    /// Removes a face (set R): its sibling replaces the node above both.
    pub fn remove(&mut self, face: Handle) {
        assert!(
            self.face_key[face as usize] != 0,
            "only a face in the tree is removed"
        );
        let node = self.face_node[face as usize];
        self.face_key[face as usize] = 0;
        self.faces -= 1;
        if node == NONE {
            self.root = None;
            self.root_box = Aabb::EMPTY;
            return;
        }
        let index = self.child_index(node, Child::Face(face));
        let Node {
            boxes,
            children,
            parent,
            ..
        } = self.nodes[node as usize];
        let sibling_box = boxes.get(1 - index);
        let sibling = Child::unpack(children[1 - index]);
        let sibling_deformed = self.deformed[node as usize] >> (1 - index) & 1 == 1;
        self.set_parent(sibling, parent);
        match parent {
            NONE => {
                self.root = Some(sibling);
                self.root_box = sibling_box;
                self.root_face_deformed = sibling_deformed;
            }
            above => {
                let above_index = self.child_index(above, Child::Node(node));
                self.nodes[above as usize].children[above_index] = sibling.pack();
                // The boxes above shrink, so it is listed although the sibling's box is unchanged.
                self.nodes[above as usize]
                    .boxes
                    .set(above_index, sibling_box);
                self.deformed[above as usize] &= !(1 << above_index);
                self.list(above, u8::from(sibling_deformed) << above_index);
            }
        }
        self.release_node(node);
    }

    fn take_node(&mut self) -> NodeId {
        if self.free == NONE {
            // There is room: fewer nodes than faces are in use.
            let id = self.nodes.len() as NodeId;
            self.nodes.push(Node::UNUSED);
            self.listed_before.push(NONE);
            self.deformed[id as usize] = 0;
            id
        } else {
            let id = self.free;
            self.free = self.nodes[id as usize].parent;
            id
        }
    }

    /// It stays in the list if it is there: it may be taken again before the refit, and must not be
    /// listed twice then.
    fn release_node(&mut self, id: NodeId) {
        self.deformed[id as usize] &= LISTED;
        self.nodes[id as usize].key = UNUSED_KEY;
        self.nodes[id as usize].parent = self.free;
        self.free = id;
    }

    /// Checks every invariant of a refitted tree: shape by keys, links, and boxes equal to a fresh
    /// refit, bit for bit. For tests.
    ///
    /// # Panics
    /// With the first fault.
    pub fn check(&self, face_box: impl Fn(Handle) -> Aabb) {
        assert_eq!(self.last_listed, NONE, "the tree is not refitted");
        let mut faces = 0;
        let mut stack = Vec::new();
        // Post-order by visiting twice: boxes of children are known when a node is left.
        let mut boxes: Vec<(Child, Aabb)> = Vec::new();
        if let Some(root) = self.root {
            stack.push((root, NONE, false));
        }
        while let Some((child, parent, leaving)) = stack.pop() {
            match child {
                Child::Face(face) => {
                    faces += 1;
                    assert_eq!(self.face_node[face as usize], parent, "link of face {face}");
                    boxes.push((child, face_box(face)));
                }
                Child::Node(id) if !leaving => {
                    let node = &self.nodes[id as usize];
                    assert_eq!(node.parent, parent, "link of node {id}");
                    assert_eq!(self.deformed[id as usize], 0, "node {id} is still deformed");
                    let [left, right] = node.children();
                    for (index, c) in [(0, left), (1, right)] {
                        let key = self.key_of(c);
                        let below = key >> (depth(key) - depth(node.key) - 1);
                        assert_eq!(below, 2 * node.key + index, "key under node {id}");
                    }
                    stack.push((child, parent, true));
                    stack.push((right, id, false));
                    stack.push((left, id, false));
                }
                Child::Node(id) => {
                    let right = boxes.pop().expect("the right child was visited");
                    let left = boxes.pop().expect("the left child was visited");
                    let node = &self.nodes[id as usize];
                    assert_eq!(node.children(), [left.0, right.0]);
                    let fresh = BoxPair::new([left.1, right.1]);
                    assert_eq!(node.boxes, fresh, "boxes of node {id}");
                    boxes.push((child, left.1.union(right.1)));
                }
            }
        }
        assert_eq!(faces, self.faces, "count of faces");
        if let Some((_, whole)) = boxes.pop() {
            assert_eq!(whole, self.root_box, "box of the root");
        }
    }
}

#[cfg(test)]
mod tests;
