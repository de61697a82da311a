//! Geomorphs (Hoppe 1996): the vertices of a perceptible split start at the position of their
//! parent and move to their own; before a perceptible collapse they move to their parent.
//!
//! The connectivity is that of the front; only positions differ. A vertex without a geomorph,
//! active or not, has the position of the file, bit for bit. So the final surface depends on the
//! front alone, however geomorphs start, reverse, finish or are cancelled by an operation.
//!
//! During a geomorph, R of the vertex is the larger R of both ends. The distance to a full-mesh
//! descendant is a convex function of the position, so on a straight segment it is largest at an
//! end. Certified errors of fronts {E > t} hold at both ends, and with the way from there in
//! between: no point of a face moves farther than the corner that moves farthest.

use super::super::certified::Certified;
use super::{ActiveMesh, Handle, OperationFaces, Performed, Slot, Vertex};
use glam::{DVec3, Vec3};

/// The geomorph of one vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Geomorph {
    vertex: Handle,
    /// Position and R of the file.
    home: Vertex,
    start: Vec3,
    done: f64,
    to_parent: bool,
}

impl Geomorph {
    /// The vertex, vt or vu of a performed slot.
    #[must_use]
    pub fn vertex(&self) -> Handle {
        self.vertex
    }

    /// Position of the file, and what is certified there.
    pub(super) fn home(&self) -> Vertex {
        self.home
    }

    /// Whether it moves to its parent, so that its slot may collapse; otherwise to its own
    /// position.
    #[must_use]
    pub fn is_to_parent(&self) -> bool {
        self.to_parent
    }

    /// Progress from start to target, 0 to 1.
    #[must_use]
    pub fn done(&self) -> f64 {
        self.done
    }
}

impl ActiveMesh {
    /// Bytes of one geomorph.
    pub const BYTES_PER_GEOMORPH: usize = size_of::<Geomorph>();

    /// Reserves room for `max` geomorphs; without it none can start.
    #[must_use]
    pub fn with_geomorphs(mut self, max: usize) -> Self {
        self.geomorphs = Vec::with_capacity(max);
        self
    }

    /// The geomorphs in progress.
    #[must_use]
    pub fn geomorphs(&self) -> &[Geomorph] {
        &self.geomorphs
    }

    /// Whether there is room for both vertices of another slot.
    #[must_use]
    pub fn can_start_geomorph(&self) -> bool {
        self.geomorphs.capacity() - self.geomorphs.len() >= 2
    }

    /// Starts geomorphs of both vertices of the last split, from the position of their parent to
    /// their own. The surface is then the same as before the split. There must be room.
    pub fn start_split_geomorph(&mut self, operation: &OperationFaces) {
        assert!(
            self.can_start_geomorph() && operation.made,
            "a split geomorph starts while there is room"
        );
        for (vertex, place) in operation.moved.into_iter().zip(operation.from) {
            let home = self.vertices[vertex as usize];
            self.geomorphs.push(Geomorph {
                vertex,
                home,
                start: place,
                done: 0.0,
                to_parent: false,
            });
            let at = Vertex {
                position: place,
                certified: Certified {
                    radius: operation.radius,
                    ..home.certified
                },
            };
            self.start_segment(self.geomorphs.len() - 1, at, home, false);
            self.note_motion(vertex, Performed::Moving);
        }
    }

    /// Starts geomorphs of both vertices of a performed slot to their parent; legal collapses only,
    /// and while there is room.
    pub fn start_collapse_geomorph(&mut self, slot: Slot) {
        assert!(self.collapse_is_legal(slot), "an illegal collapse");
        let parent = self.vertices[self.links[slot as usize].vs as usize];
        for vertex in self.children(slot) {
            let at = self.vertices[vertex as usize];
            let index = self.geomorph_of(vertex).unwrap_or_else(|| {
                assert!(
                    self.geomorphs.len() < self.geomorphs.capacity(),
                    "a collapse geomorph starts while there is room"
                );
                self.geomorphs.push(Geomorph {
                    vertex,
                    home: at,
                    start: at.position,
                    done: 0.0,
                    to_parent: true,
                });
                self.geomorphs.len() - 1
            });
            self.start_segment(index, at, parent, true);
            self.note_motion(vertex, Performed::Moving);
        }
    }

    /// Reverses the geomorphs of a slot that move to the parent.
    pub fn reverse_geomorphs(&mut self, slot: Slot) {
        for vertex in self.children(slot) {
            if let Some(index) = self
                .geomorph_of(vertex)
                .filter(|&k| self.geomorphs[k].to_parent)
            {
                let at = self.vertices[vertex as usize];
                let home = self.geomorphs[index].home;
                self.start_segment(index, at, home, false);
            }
        }
    }

    /// Restarts a geomorph from a vertex's current position and R (`at`) to its target (`end`).
    fn start_segment(&mut self, index: usize, at: Vertex, end: Vertex, to_parent: bool) {
        let geomorph = &mut self.geomorphs[index];
        geomorph.start = at.position;
        geomorph.done = 0.0;
        geomorph.to_parent = to_parent;
        // Positions in between are rounded to f32.
        let largest = at.position.abs().max(end.position.abs()).max_element();
        let radius = at.certified.radius.max(end.certified.radius) + f32::EPSILON * largest;
        let vertex = &mut self.vertices[geomorph.vertex as usize];
        vertex.position = at.position;
        vertex.certified.radius = radius.next_up();
    }

    /// Displacement of a geomorph from its start to its target, model units.
    #[must_use]
    pub fn geomorph_displacement(&self, geomorph: &Geomorph) -> DVec3 {
        self.geomorph_target(geomorph).as_dvec3() - geomorph.start.as_dvec3()
    }

    /// The vertex that a slot's VSP splits.
    #[must_use]
    pub fn parent(&self, slot: Slot) -> Handle {
        self.links[slot as usize].vs
    }

    /// Target of a geomorph, model units.
    #[must_use]
    pub fn geomorph_target(&self, geomorph: &Geomorph) -> Vec3 {
        let creator = self.creator_of_vertex(geomorph.vertex);
        match creator.filter(|_| geomorph.to_parent) {
            Some(slot) => self.position(self.links[slot as usize].vs),
            None => geomorph.home.position,
        }
    }

    /// Position of a vertex after its geomorph, model units; its position if it has none.
    #[must_use]
    pub fn final_position(&self, vertex: Handle) -> Vec3 {
        let geomorph = self.geomorph_of(vertex).map(|index| self.geomorphs[index]);
        geomorph.map_or_else(
            || self.position(vertex),
            |geomorph| self.geomorph_target(&geomorph),
        )
    }

    /// Collects the faces around the vertex of a geomorph; `None` when there are more than
    /// [`OperationFaces::MAX_FACES`].
    pub fn faces_around_geomorph(
        &self,
        geomorph: &Geomorph,
        out: &mut OperationFaces,
    ) -> Option<()> {
        self.star(geomorph.vertex, out)?;
        out.of_t = out.count;
        out.pair_count = 0;
        out.moved = [geomorph.vertex; 2];
        out.from = [self.position(geomorph.vertex); 2];
        Some(())
    }

    /// Advances a geomorph to the progress `done`, 1 being its target. `around` comes from
    /// [`ActiveMesh::faces_around_geomorph`].
    pub fn step_geomorph(&mut self, index: usize, done: f64, around: &OperationFaces) {
        let geomorph = self.geomorphs[index];
        debug_assert!(around.moved == [geomorph.vertex; 2] && done >= geomorph.done);
        let has_arrived = done >= 1.0;
        let position = if has_arrived {
            self.geomorph_target(&geomorph)
        } else {
            (geomorph.start.as_dvec3() + self.geomorph_displacement(&geomorph) * done).as_vec3()
        };
        self.geomorphs[index].done = done.min(1.0);
        let vertex = &mut self.vertices[geomorph.vertex as usize];
        vertex.position = position;
        if has_arrived && !geomorph.to_parent {
            *vertex = geomorph.home;
        }
    }

    /// Finishes the geomorphs that have reached their own positions. Those at their parent wait for
    /// the collapse.
    pub fn finish_geomorphs(&mut self) {
        let stays = |geomorph: &Geomorph| geomorph.to_parent || geomorph.done < 1.0;
        for k in 0..self.geomorphs.len() {
            let geomorph = self.geomorphs[k];
            if !stays(&geomorph) {
                self.note_motion(geomorph.vertex, Performed::AtRest);
            }
        }
        self.geomorphs.retain(stays);
        // The other vertex of such a slot may still be on its way.
        for k in 0..self.geomorphs.len() {
            self.note_motion(self.geomorphs[k].vertex, Performed::Moving);
        }
    }

    /// Index of the geomorph of the other vertex of the same split.
    #[must_use]
    pub fn sibling_geomorph(&self, geomorph: &Geomorph) -> Option<usize> {
        let slot = self.creator_of_vertex(geomorph.vertex)?;
        let [vt, vu] = self.children(slot);
        self.geomorph_of(if geomorph.vertex == vt { vu } else { vt })
    }

    /// Whether the geomorphs of both vertices of a performed slot have reached their parent.
    #[must_use]
    pub fn has_reached_parent(&self, slot: Slot) -> bool {
        self.children(slot).into_iter().all(|vertex| {
            let geomorph = self.geomorph_of(vertex).map(|index| &self.geomorphs[index]);
            geomorph.is_some_and(|geomorph| geomorph.to_parent && geomorph.done >= 1.0)
        })
    }

    /// Whether a corner of one of these faces has a geomorph.
    #[must_use]
    pub fn any_geomorphing(&self, faces: &[Handle]) -> bool {
        let has_geomorph = |vertex: &Handle| self.geomorph_of(*vertex).is_some();
        !self.geomorphs.is_empty()
            && faces
                .iter()
                .any(|&face| self.face(face).corners.iter().any(has_geomorph))
    }

    /// Cancels the geomorph of a vertex, if any, and restores the position and R of the file.
    pub(super) fn cancel_geomorph(&mut self, vertex: Handle) {
        if let Some(index) = self.geomorph_of(vertex) {
            let geomorph = self.geomorphs[index];
            let sibling = self.sibling_geomorph(&geomorph);
            self.geomorphs.swap_remove(index);
            self.vertices[vertex as usize] = geomorph.home;
            if sibling.is_none() {
                self.note_motion(vertex, Performed::AtRest);
            }
        }
    }

    /// Drops all geomorphs; the vertices stay where they are.
    pub(super) fn cancel_geomorphs(&mut self) {
        while let Some(geomorph) = self.geomorphs.pop() {
            self.note_motion(geomorph.vertex, Performed::AtRest);
        }
    }

    /// Notes whether a vertex of the performed slot of this one has a geomorph.
    fn note_motion(&mut self, vertex: Handle, performed: Performed) {
        if let Some(slot) = self.creator_of_vertex(vertex) {
            self.states[slot as usize].performed = performed;
        }
    }

    pub(super) fn geomorph_of(&self, vertex: Handle) -> Option<usize> {
        // Most vertices are known to be at rest without a search; those of the base mesh always
        // are.
        let slot = self.creator_of_vertex(vertex)?;
        let state = self.states.get(slot as usize)?;
        if state.performed != Performed::Moving {
            return None;
        }
        self.geomorphs
            .iter()
            .position(|geomorph| geomorph.vertex == vertex)
    }

    /// vt and vu of a slot.
    #[must_use]
    pub fn children(&self, slot: Slot) -> [Handle; 2] {
        let vt = self.vt(slot);
        [vt, vt + 1]
    }
}
