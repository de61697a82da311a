//! The faces around a vertex: the fans that a split parts and a collapse joins.

use super::{ActiveMesh, Handle, NONE, OperationFaces, Slot};
use glam::DVec3;

impl ActiveMesh {
    /// The vertex beyond `vertex` on the edge that two faces share: `leaving` has the edge vertex -> x,
    /// `entering` has x -> vertex. `None` when the two do not lie so, or neither exists.
    pub(super) fn across(
        &self,
        vertex: Handle,
        leaving: Handle,
        entering: Handle,
    ) -> Option<Handle> {
        let far = |face: Handle, step: usize, other: Handle| {
            if face == NONE {
                return Some(None);
            }
            let f = &self.faces[face as usize];
            let k = f.index_of(vertex)?;
            // The neighbour across the edge lies opposite the third corner.
            let third = (k + 3 - step) % 3;
            (f.neighbours[third] == other).then_some(Some(f.corners[(k + step) % 3]))
        };
        match (far(leaving, 1, entering)?, far(entering, 2, leaving)?) {
            (Some(a), Some(b)) if a == b => Some(a),
            (Some(a), None) | (None, Some(a)) => Some(a),
            _ => None,
        }
    }

    /// Collects the two fans that a split of `vs` parts: counterclockwise fn0..fn2 to vt, fn3..fn1 to vu.
    pub(super) fn collect(
        &self,
        vs: Handle,
        fn_: [Handle; 4],
        out: &mut OperationFaces,
    ) -> Option<()> {
        let [fn0, fn1, fn2, fn3] = fn_;
        out.count = 0;
        self.fan(vs, fn0, fn2, out)?;
        out.of_t = out.count;
        self.fan(vs, fn3, fn1, out)?;
        // The fans must not share a face: a damaged record could name fn on the wrong side.
        let (t, u) = out.deformed().split_at(out.of_t);
        let disjoint = t.iter().all(|f| !u.contains(f));
        disjoint.then_some(())
    }

    /// Collects the faces around `vertex` counterclockwise from `first` to `last`; where a rim comes in
    /// between, the fan is in two pieces and the second is walked clockwise from `last`.
    pub(super) fn fan(
        &self,
        vertex: Handle,
        first: Handle,
        last: Handle,
        out: &mut OperationFaces,
    ) -> Option<()> {
        let mut face = first;
        while face != NONE {
            out.push(face)?;
            if face == last {
                return Some(());
            }
            let f = &self.faces[face as usize];
            face = f.neighbours[(f.index_of(vertex)? + 1) % 3];
            if face == first {
                // Once round without meeting `last`.
                return None;
            }
        }
        let mut face = last;
        while face != NONE {
            out.push(face)?;
            let f = &self.faces[face as usize];
            face = f.neighbours[(f.index_of(vertex)? + 2) % 3];
            if face == last {
                return None;
            }
        }
        Some(())
    }

    /// Sets the neighbour of `face` opposite the corner `step` after `vertex`.
    pub(super) fn set_neighbour(
        &mut self,
        face: Handle,
        vertex: Handle,
        step: usize,
        neighbour: Handle,
    ) {
        if face == NONE {
            return;
        }
        let f = &mut self.faces[face as usize];
        match f.index_of(vertex) {
            Some(k) => f.neighbours[(k + step) % 3] = neighbour,
            None => unreachable!("fn keeps the split vertex as a corner"),
        }
    }

    /// Collects the faces that the split of a loaded slot, or its collapse if it is performed, would deform.
    ///
    /// `None` when the record does not fit the mesh.
    pub fn patch(&self, slot: Slot, out: &mut OperationFaces) -> Option<()> {
        let links = self.links[slot as usize];
        if !self.is_performed(slot) {
            return self.collect(links.vs, links.fn_, out);
        }
        let [fn0, fn1, fn2, fn3] = links.fn_;
        let vt = self.vt(slot);
        out.count = 0;
        self.fan(vt, fn0, fn2, out)?;
        out.of_t = out.count;
        self.fan(vt + 1, fn3, fn1, out)
    }

    /// Whether a face is as `test` says that the split or collapse of a slot will deform or make: its corners afterwards, and
    /// the face itself where it is there already. `patch` is what [`ActiveMesh::patch`] collected.
    pub fn any_after(
        &self,
        slot: Slot,
        patch: &OperationFaces,
        mut test: impl FnMut(Option<Handle>, [Handle; 3]) -> bool,
    ) -> bool {
        let (from, to) = self.ends(slot);
        let mut deformed = Self::deformed_of(patch);
        let mut pair = self.thirds(slot).into_iter().flatten();
        let [vt, vu] = to;
        deformed.any(|(side, face)| {
            let corners = self.face(face).corners;
            let after = corners.map(|c| if c == from[side] { to[side] } else { c });
            test(Some(face), after)
        }) || (!self.is_performed(slot) && pair.any(|third| test(None, [vt, vu, third])))
    }

    /// Whether a tetrahedron is as `test` says that a face would sweep on its way if the vertices of the split or collapse of a
    /// slot went straight to their places: together these hold the surface before and after, and all that it passes over.
    pub fn any_swept(
        &self,
        slot: Slot,
        patch: &OperationFaces,
        mut test: impl FnMut([DVec3; 4]) -> bool,
    ) -> bool {
        let (_, to) = self.ends(slot);
        let place = |vertex: Handle| self.position(vertex).as_dvec3();
        let mut deformed = Self::deformed_of(patch);
        let mut pair = self.thirds(slot).into_iter().flatten();
        let parent = self.parent(slot);
        let [vt, vu] = self.children(slot);
        deformed.any(|(side, face)| {
            let [a, b, c] = self.corners(face);
            // Its corners, and the place that one of them goes to.
            test([a, b, c, place(to[side])])
        }) || pair.any(|third| test([parent, vt, vu, third].map(place)))
    }

    /// The vertices that the fans of a slot's patch have for corners, and those that they get.
    fn ends(&self, slot: Slot) -> ([Handle; 2], [Handle; 2]) {
        let (whole, parted) = ([self.parent(slot); 2], self.children(slot));
        if self.is_performed(slot) {
            (parted, whole)
        } else {
            (whole, parted)
        }
    }

    /// The faces of a patch, each with the side that it is on.
    fn deformed_of(patch: &OperationFaces) -> impl Iterator<Item = (usize, Handle)> {
        let (of_t, of_u) = patch.fans();
        let on = |side: usize| move |&face: &Handle| (side, face);
        of_t.iter().map(on(0)).chain(of_u.iter().map(on(1)))
    }

    /// vl and vr of a loaded slot: the third corners of the pair that its split makes, or that its collapse removes.
    #[must_use]
    pub fn thirds(&self, slot: Slot) -> [Option<Handle>; 2] {
        let links = self.links[slot as usize];
        if self.is_performed(slot) {
            let third = |face: Handle| self.face(face).corners[2];
            let fl = self.fl(slot);
            return [
                Some(third(fl)),
                (links.leaf_r != NONE).then(|| third(fl + 1)),
            ];
        }
        let [fn0, fn1, fn2, fn3] = links.fn_;
        [[fn0, fn1], [fn3, fn2]].map(|[leaving, entering]| {
            let is_there = leaving != NONE || entering != NONE;
            is_there.then(|| self.across(links.vs, leaving, entering))?
        })
    }

    /// Collects the faces around an active vertex that a split has made: fl keeps it as a corner until it is split
    /// itself. `None` when they are more than there is room for.
    pub(super) fn star(&self, vertex: Handle, out: &mut OperationFaces) -> Option<()> {
        let first = self.fl(self.maker_of_vertex(vertex)?);
        out.count = 0;
        let mut face = first;
        // Counterclockwise round, or to the rim; from there the rest clockwise.
        for step in [1, 2] {
            while face != NONE {
                out.push(face)?;
                face = self.beside_corner(face, vertex, step)?;
                if face == first {
                    return Some(());
                }
            }
            face = self.beside_corner(first, vertex, 2)?;
        }
        Some(())
    }

    /// Whether a face around a corner of an active face is as `test` says.
    pub fn any_around(
        &self,
        face: Handle,
        corner: Handle,
        mut test: impl FnMut(Handle) -> bool,
    ) -> bool {
        // Counterclockwise round, or to the rim; from there the rest clockwise.
        [1, 2].into_iter().any(|step| {
            let mut next = Some(face);
            while let Some(at) = next.filter(|&at| at != NONE) {
                if test(at) {
                    return true;
                }
                next = self
                    .beside_corner(at, corner, step)
                    .filter(|&at| at != face);
            }
            false
        })
    }

    /// The neighbour of a face opposite the corner `step` after `vertex`.
    fn beside_corner(&self, face: Handle, vertex: Handle, step: usize) -> Option<Handle> {
        let f = &self.faces[face as usize];
        Some(f.neighbours[(f.index_of(vertex)? + step) % 3])
    }
}
