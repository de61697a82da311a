//! The list of deformed nodes, and the refit over it.
//!
//! ACTIVE-MARK and ACTIVE-WALK ask at each node whether it was reached before, and nothing goes on
//! until its cache line is there. Here an operation lists the lowest node that it changed, and a
//! refit goes from the deepest nodes up and lists those above: the same nodes, each once, but what
//! is read for one does not wait for what is read for another.

use super::{AbTree, Child, Node, NodeId, UNUSED_KEY};
use crate::key::depth;
use crate::{Handle, NONE};
use geometry::{Aabb, BoxPair};
use std::hint::select_unpredictable;

/// The node is in the list: a bit of [`AbTree::deformed`].
pub(super) const LISTED: u8 = 1 << 2;

/// Depths of nodes: keys have 32 bits.
const DEPTHS: usize = u32::BITS as usize;

/// For each depth the listed node that was met last; the others follow by `listed_before`.
type Levels = [NodeId; DEPTHS];

impl AbTree {
    /// Lists the node above a deformed face (set D).
    #[inline]
    pub fn deform(&mut self, face: Handle) {
        debug_assert!(self.face_key[face as usize] != 0);
        match self.face_node[face as usize] {
            NONE => self.root_face_deformed = true,
            node => {
                let index = self.child_index(node, Child::Face(face));
                self.list(node, 1 << index);
            }
        }
    }

    /// Puts a node into the list if it is not there, with its deformed faces.
    #[inline]
    pub(super) fn list(&mut self, node: NodeId, faces: u8) {
        let flags = &mut self.deformed[node as usize];
        let was = *flags;
        *flags = was | faces | LISTED;
        // Faces that share a node are hardly foreseen.
        let is_listed = was & LISTED != 0;
        let before = &mut self.listed_before[node as usize];
        *before = select_unpredictable(is_listed, *before, self.last_listed);
        self.last_listed = select_unpredictable(is_listed, self.last_listed, node);
    }

    /// ACTIVE-REFIT: the boxes of all deformed faces, then those of the nodes above, the deepest
    /// first.
    ///
    /// Returns the number of boxes refitted: for each node that ACTIVE-MARK marks, faces among
    /// them, its own in the node above. The root has none there.
    pub fn refit(&mut self, face_box: impl Fn(Handle) -> Aabb) -> u32 {
        let mut levels: Levels = [NONE; DEPTHS];
        let mut refitted = 0;
        let mut node = std::mem::replace(&mut self.last_listed, NONE);
        while node != NONE {
            let before = self.listed_before[node as usize];
            refitted += self.take_faces(node, &mut levels, &face_box);
            node = before;
        }
        for level in (0..DEPTHS).rev() {
            let mut node = levels[level];
            while node != NONE {
                let before = self.listed_before[node as usize];
                refitted += self.take_node_box(node, &mut levels);
                node = before;
            }
        }
        match self.root {
            Some(Child::Node(root)) => self.root_box = self.nodes[root as usize].boxes.union(),
            Some(Child::Face(face)) => {
                self.root_box = face_box(face);
                self.root_face_deformed = false;
                refitted = 1;
            }
            None => {}
        }
        refitted
    }

    /// Refits the boxes of the deformed faces of a listed node, and puts it to those of its depth;
    /// their number.
    #[inline]
    fn take_faces(
        &mut self,
        id: NodeId,
        levels: &mut Levels,
        face_box: &impl Fn(Handle) -> Aabb,
    ) -> u32 {
        let flags = &mut self.deformed[id as usize];
        let node = &mut self.nodes[id as usize];
        let faces = *flags & !LISTED;
        if node.key == UNUSED_KEY {
            *flags = 0;
            return 0;
        }
        *flags = LISTED;
        for index in 0..2 {
            if faces >> index & 1 == 0 {
                continue;
            }
            if let Child::Face(face) = Child::unpack(node.children[index]) {
                node.boxes.take(index, &BoxPair::new([face_box(face); 2]));
            }
        }
        let last = &mut levels[depth(node.key) as usize];
        self.listed_before[id as usize] = std::mem::replace(last, id);
        faces.count_ones()
    }

    /// Refits the box of a node in that above it, and lists that one; 0 for the root.
    #[inline]
    fn take_node_box(&mut self, id: NodeId, levels: &mut Levels) -> u32 {
        self.deformed[id as usize] = 0;
        let Node { boxes, parent, .. } = self.nodes[id as usize];
        if parent == NONE {
            return 0;
        }
        let above = &mut self.nodes[parent as usize];
        let index = usize::from(above.children[1] == id);
        above.boxes.take(index, &boxes.joined());
        if self.deformed[parent as usize] == 0 {
            self.deformed[parent as usize] = LISTED;
            let last = &mut levels[depth(above.key) as usize];
            self.listed_before[parent as usize] = std::mem::replace(last, parent);
        }
        1
    }
}
