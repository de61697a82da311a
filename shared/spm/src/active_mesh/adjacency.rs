//! The adjacency tests of thesis 5.2.3, after Hoppe 1997: the oracle for legality by counters.
//!
//! They use the mesh alone, not dependencies. For tests; the tick uses the counters.

use super::{ActiveMesh, Handle, NONE, Slot};

impl ActiveMesh {
    /// Whether vs of a slot is active, and fn0..fn3 are active and adjacent as recorded.
    #[must_use]
    pub fn split_is_legal_by_adjacency(&self, slot: Slot) -> bool {
        let links = self.links[slot as usize];
        let [fn0, fn1, fn2, fn3] = links.fn_;
        self.are_adjacent(links.vs, fn0, fn1)
            && (links.leaf_r == NONE || self.are_adjacent(links.vs, fn3, fn2))
    }

    /// Whether vt and vu of a slot are active, and the neighbours of fl and fr are fn0..fn3.
    #[must_use]
    pub fn collapse_is_legal_by_adjacency(&self, slot: Slot) -> bool {
        let links = self.links[slot as usize];
        let (vt, fl) = (self.vt(slot), self.fl(slot));
        let (vu, fr) = (vt + 1, fl + 1);
        let [fn0, fn1, fn2, fn3] = links.fn_;
        let intact = |face: Handle, from: Handle, to: Handle, around: [Handle; 3]| {
            let corners = self.face(face).corners;
            let third = corners.iter().find(|&&c| c != from && c != to);
            third.is_some_and(|&third| {
                let edges = [(from, to), (to, third), (third, from)];
                let found = edges.map(|(from, to)| self.neighbour_across(face, from, to));
                found == around.map(Some)
            })
        };
        let has_right = links.leaf_r != NONE;
        self.is_active(fl)
            && intact(fl, vt, vu, [if has_right { fr } else { NONE }, fn1, fn0])
            && (!has_right || intact(fr, vu, vt, [fl, fn2, fn3]))
    }

    /// The face across the edge `from` -> `to` of an active face; `None` when it has no such edge.
    fn neighbour_across(&self, face: Handle, from: Handle, to: Handle) -> Option<Handle> {
        let face = self.face(face);
        (0..3)
            .find(|&k| face.corners[k] == from && face.corners[(k + 1) % 3] == to)
            .map(|k| face.neighbours[(k + 2) % 3])
    }

    /// Whether `vertex` has an edge with `leaving` on its left and `entering` on its right.
    fn are_adjacent(&self, vertex: Handle, leaving: Handle, entering: Handle) -> bool {
        let others = |face: Handle| {
            let face = self.face(face);
            let k = face.index_of(vertex)?;
            Some((face.corners[(k + 1) % 3], face.corners[(k + 2) % 3]))
        };
        let there = |face: Handle| face == NONE || self.is_active(face);
        let left = || {
            leaving == NONE
                || others(leaving).is_some_and(|(far, _)| {
                    self.neighbour_across(leaving, vertex, far) == Some(entering)
                })
        };
        let right = || {
            entering == NONE
                || others(entering).is_some_and(|(_, far)| {
                    self.neighbour_across(entering, far, vertex) == Some(leaving)
                })
        };
        there(leaving) && there(entering) && left() && right()
    }
}
