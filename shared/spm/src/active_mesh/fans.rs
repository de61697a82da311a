//! The faces around a vertex: the fans that a split separates and a collapse joins.

use super::operation_faces::FanError;
use super::{ActiveMesh, Handle, NONE, OperationError, OperationFaces, Slot};
use glam::DVec3;

impl ActiveMesh {
    /// The vertex x at the other end of the edge that two faces share: `leaving` has the edge
    /// vertex -> x, `entering` has x -> vertex. `None` when they share no such edge, or neither
    /// exists.
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
            // The neighbour across the edge is opposite the third corner.
            let third = (k + 3 - step) % 3;
            (f.neighbours[third] == other).then_some(Some(f.corners[(k + step) % 3]))
        };
        match (far(leaving, 1, entering)?, far(entering, 2, leaving)?) {
            (Some(a), Some(b)) if a == b => Some(a),
            (Some(a), None) | (None, Some(a)) => Some(a),
            _ => None,
        }
    }

    /// Collects the two fans of a split of `vs`, counterclockwise: fn0..fn2 go to vt, fn3..fn1 to
    /// vu.
    fn collect(
        &self,
        vs: Handle,
        [fn0, fn1, fn2, fn3]: [Handle; 4],
        out: &mut OperationFaces,
    ) -> Result<(), FanError> {
        out.count = 0;
        self.fan(vs, fn0, fn2, out)?;
        out.of_t = out.count;
        self.fan(vs, fn3, fn1, out)?;
        // A damaged record could name a face in both fans. Each is one or two runs around the
        // vertex, and where two runs meet, one holds an end of the other.
        let (t, u) = out.fans();
        let disjoint = ![fn0, fn2].iter().any(|end| u.contains(end))
            && ![fn1, fn3].iter().any(|end| t.contains(end));
        if disjoint {
            Ok(())
        } else {
            Err(FanError::Broken)
        }
    }

    /// Collects the faces around `vertex` counterclockwise from `first` to `last`. Where a boundary
    /// interrupts the fan, its second piece is walked clockwise from `last`.
    fn fan(
        &self,
        vertex: Handle,
        first: Handle,
        last: Handle,
        out: &mut OperationFaces,
    ) -> Result<(), FanError> {
        let next = |face: Handle, step: usize| {
            self.neighbour_at_corner(face, vertex, step)
                .ok_or(FanError::Broken)
        };
        let mut face = first;
        while face != NONE {
            out.push(face)?;
            if face == last {
                return Ok(());
            }
            face = next(face, 1)?;
            if face == first {
                // A full turn without `last`.
                return Err(FanError::Broken);
            }
        }
        let mut face = last;
        while face != NONE {
            out.push(face)?;
            face = next(face, 2)?;
            if face == last {
                return Err(FanError::Broken);
            }
        }
        Ok(())
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

    /// Collects the faces that the split of a loaded slot would deform, or its collapse if it is
    /// performed.
    ///
    /// # Errors
    /// When the record does not fit the mesh, or the faces are too many for one operation.
    pub fn patch(&self, slot: Slot, out: &mut OperationFaces) -> Result<(), OperationError> {
        let links = self.links[slot as usize];
        let collected = if self.is_performed(slot) {
            self.collect_performed(slot, links.fn_, out)
        } else {
            self.collect(links.vs, links.fn_, out)
        };
        collected.map_err(|error| match error {
            FanError::Broken => OperationError::Damaged(links.i),
            FanError::TooLarge => OperationError::TooManyFaces(links.i),
        })
    }

    /// Collects the two fans that the collapse of a performed slot joins.
    fn collect_performed(
        &self,
        slot: Slot,
        [fn0, fn1, fn2, fn3]: [Handle; 4],
        out: &mut OperationFaces,
    ) -> Result<(), FanError> {
        let vt = self.vt(slot);
        out.count = 0;
        self.fan(vt, fn0, fn2, out)?;
        out.of_t = out.count;
        self.fan(vt + 1, fn3, fn1, out)
    }

    /// Whether `test` accepts a face that the split or collapse of a slot will deform or create. It
    /// gets the face, if it exists already, and its corners afterwards. `patch` comes from
    /// [`ActiveMesh::patch`].
    pub fn any_after(
        &self,
        slot: Slot,
        patch: &OperationFaces,
        mut test: impl FnMut(Option<Handle>, [Handle; 3]) -> bool,
    ) -> bool {
        let (from, to) = self.ends(slot);
        let mut deformed = Self::deformed_of(patch);
        let mut pair = self.third_corners(slot).into_iter().flatten();
        let [vt, vu] = to;
        deformed.any(|(fan, face)| {
            let corners = self.face(face).corners;
            let after = corners.map(|c| if c == from[fan] { to[fan] } else { c });
            test(Some(face), after)
        }) || (!self.is_performed(slot) && pair.any(|third| test(None, [vt, vu, third])))
    }

    /// Whether `test` accepts a tetrahedron that a face sweeps when the vertices of the split or
    /// collapse of a slot move straight to their targets. Together the tetrahedra hold the surface
    /// before, after and in between.
    pub fn any_swept(
        &self,
        slot: Slot,
        patch: &OperationFaces,
        mut test: impl FnMut([DVec3; 4]) -> bool,
    ) -> bool {
        let (_, to) = self.ends(slot);
        let place = |vertex: Handle| self.position(vertex).as_dvec3();
        let mut deformed = Self::deformed_of(patch);
        let mut pair = self.third_corners(slot).into_iter().flatten();
        let parent = self.parent(slot);
        let [vt, vu] = self.children(slot);
        deformed.any(|(fan, face)| {
            let [a, b, c] = self.corners(face);
            // Its corners, and the target of one of them.
            test([a, b, c, place(to[fan])])
        }) || pair.any(|third| test([parent, vt, vu, third].map(place)))
    }

    /// The corners of the two fans of a slot before and after its operation.
    fn ends(&self, slot: Slot) -> ([Handle; 2], [Handle; 2]) {
        let (joined, separated) = ([self.parent(slot); 2], self.children(slot));
        if self.is_performed(slot) {
            (separated, joined)
        } else {
            (joined, separated)
        }
    }

    /// The faces of a patch, each with its fan: 0 for that of vt, 1 for that of vu.
    fn deformed_of(patch: &OperationFaces) -> impl Iterator<Item = (usize, Handle)> {
        let (of_t, of_u) = patch.fans();
        let in_fan = |fan: usize| move |&face: &Handle| (fan, face);
        of_t.iter().map(in_fan(0)).chain(of_u.iter().map(in_fan(1)))
    }

    /// vl and vr of a loaded slot: the third corners of the faces that its split creates or its
    /// collapse removes.
    #[must_use]
    pub fn third_corners(&self, slot: Slot) -> [Option<Handle>; 2] {
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

    /// Collects the faces around an active vertex that a split has created: fl keeps it as a corner
    /// until it is split itself. `None` when there are more than [`OperationFaces::MAX_FACES`].
    pub(super) fn star(&self, vertex: Handle, out: &mut OperationFaces) -> Option<()> {
        let first = self.fl(self.creator_of_vertex(vertex)?);
        out.count = 0;
        let mut face = first;
        // Counterclockwise, a full turn or to the boundary; then the rest clockwise.
        for step in [1, 2] {
            while face != NONE {
                out.push(face).ok()?;
                face = self.neighbour_at_corner(face, vertex, step)?;
                if face == first {
                    return Some(());
                }
            }
            face = self.neighbour_at_corner(first, vertex, 2)?;
        }
        Some(())
    }

    /// Whether `test` accepts a face around a corner of an active face; each is shown once.
    pub fn any_around(
        &self,
        face: Handle,
        corner: Handle,
        mut test: impl FnMut(Handle) -> bool,
    ) -> bool {
        // Counterclockwise, a full turn or to the boundary; then the rest clockwise.
        let mut at = face;
        loop {
            if test(at) {
                return true;
            }
            match self.neighbour_at_corner(at, corner, 1) {
                Some(next) if next == face => return false,
                Some(next) if next != NONE => at = next,
                _ => break,
            }
        }
        let mut next = self.neighbour_at_corner(face, corner, 2);
        while let Some(at) = next.filter(|&at| at != NONE && at != face) {
            if test(at) {
                return true;
            }
            next = self.neighbour_at_corner(at, corner, 2);
        }
        false
    }

    /// The neighbour of a face opposite the corner `step` after `vertex`.
    fn neighbour_at_corner(&self, face: Handle, vertex: Handle, step: usize) -> Option<Handle> {
        let f = &self.faces[face as usize];
        Some(f.neighbours[(f.index_of(vertex)? + step) % 3])
    }
}
