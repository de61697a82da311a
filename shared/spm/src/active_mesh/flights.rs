//! Vertices on their way: a split that is felt starts where the surface was and travels to its place (a geomorph,
//! Hoppe 1996), a collapse travels the other way first.
//!
//! The mesh of a flight is that of the front; only positions differ. A vertex that is not in flight is where the file
//! puts it, bit for bit, one that is not active too: so however flights begin, turn, land or are broken off by an
//! operation, the front and nothing else decides where the surface is in the end.
//!
//! While a vertex is in flight its R is the larger one of both ends of its way: the distance from a leaf is a convex
//! function of the place, so that on a straight way no place is farther than the farther end.

use super::{ActiveMesh, Handle, OperationFaces, Slot, Vertex};
use glam::{DVec3, Vec3};

/// A vertex on its way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geomorph {
    vertex: Handle,
    /// What the file says of it.
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

    /// Whether it goes to where its parent is, so that its slot may collapse; else to its own place.
    #[must_use]
    pub fn is_to_parent(&self) -> bool {
        self.to_parent
    }

    /// How much of the way is done, 0 to 1.
    #[must_use]
    pub fn done(&self) -> f64 {
        self.done
    }
}

impl ActiveMesh {
    /// Bytes that one flight takes here.
    pub const BYTES_PER_FLIGHT: usize = size_of::<Geomorph>();

    /// Gives room for so many vertices in flight; without it there are none.
    #[must_use]
    pub fn with_flights(mut self, most: usize) -> Self {
        self.flights = Vec::with_capacity(most);
        self
    }

    /// The vertices in flight.
    #[must_use]
    pub fn flights(&self) -> &[Geomorph] {
        &self.flights
    }

    /// Whether there is room for both vertices of another slot.
    #[must_use]
    pub fn may_take_off(&self) -> bool {
        self.flights.capacity() - self.flights.len() >= 2
    }

    /// Puts the vertices of the split that was performed last back to where the surface was, and on their way to
    /// their places. The surface is then what it was before the split. There must be room.
    pub fn take_off(&mut self, operation: &OperationFaces) {
        assert!(
            self.may_take_off() && operation.made,
            "a split takes off while there is room"
        );
        for (vertex, place) in operation.moved.into_iter().zip(operation.from) {
            let home = self.vertices[vertex as usize];
            self.flights.push(Geomorph {
                vertex,
                home,
                start: place,
                done: 0.0,
                to_parent: false,
            });
            let at = Vertex {
                position: place,
                radius: operation.radius,
            };
            self.turn(self.flights.len() - 1, at, home, false);
        }
    }

    /// Sends both vertices of a performed slot to where their parent is; legal collapses only, and while there is
    /// room.
    pub fn send_to_parent(&mut self, slot: Slot) {
        assert!(self.collapse_is_legal(slot), "an illegal collapse");
        let parent = self.vertices[self.links[slot as usize].vs as usize];
        for vertex in self.children(slot) {
            let at = self.vertices[vertex as usize];
            let index = self.flight_of(vertex).unwrap_or_else(|| {
                assert!(
                    self.flights.len() < self.flights.capacity(),
                    "a collapse takes off while there is room"
                );
                self.flights.push(Geomorph {
                    vertex,
                    home: at,
                    start: at.position,
                    done: 0.0,
                    to_parent: true,
                });
                self.flights.len() - 1
            });
            self.turn(index, at, parent, true);
        }
    }

    /// Sends the vertices of a slot that are on their way to their parent back to their own places.
    pub fn send_home(&mut self, slot: Slot) {
        for vertex in self.children(slot) {
            if let Some(index) = self
                .flight_of(vertex)
                .filter(|&k| self.flights[k].to_parent)
            {
                let at = self.vertices[vertex as usize];
                let home = self.flights[index].home;
                self.turn(index, at, home, false);
            }
        }
    }

    /// Begins the way of a flight from where it is now to an end.
    fn turn(&mut self, index: usize, at: Vertex, end: Vertex, to_parent: bool) {
        let flight = &mut self.flights[index];
        flight.start = at.position;
        flight.done = 0.0;
        flight.to_parent = to_parent;
        // Places on the way are rounded to f32.
        let largest = at.position.abs().max(end.position.abs()).max_element();
        let radius = at.radius.max(end.radius) + f32::EPSILON * largest;
        self.vertices[flight.vertex as usize].position = at.position;
        self.vertices[flight.vertex as usize].radius = radius.next_up();
    }

    /// The whole way of a flight from where it began or turned, model units.
    #[must_use]
    pub fn way(&self, flight: &Geomorph) -> DVec3 {
        self.end_of(flight).as_dvec3() - flight.start.as_dvec3()
    }

    /// The vertex that a slot's VSP splits.
    #[must_use]
    pub fn parent(&self, slot: Slot) -> Handle {
        self.links[slot as usize].vs
    }

    /// Where a flight ends, model units.
    #[must_use]
    pub fn end_of(&self, flight: &Geomorph) -> Vec3 {
        let maker = self.maker_of_vertex(flight.vertex);
        match maker.filter(|_| flight.to_parent) {
            Some(slot) => self.position(self.links[slot as usize].vs),
            None => flight.home.position,
        }
    }

    /// Where a vertex comes to rest as things are: its place, unless it is in flight.
    #[must_use]
    pub fn destination(&self, vertex: Handle) -> Vec3 {
        let flight = self.flight_of(vertex).map(|index| self.flights[index]);
        flight.map_or_else(|| self.position(vertex), |flight| self.end_of(&flight))
    }

    /// Collects the faces around the vertex of a flight; `None` when they are more than there is room for.
    pub fn around(&self, flight: &Geomorph, out: &mut OperationFaces) -> Option<()> {
        self.star(flight.vertex, out)?;
        out.of_t = out.count;
        out.pair_count = 0;
        out.moved = [flight.vertex; 2];
        out.from = [self.position(flight.vertex); 2];
        Some(())
    }

    /// Moves a vertex in flight to where it is when `done` of its way is done, 1 being its end; `around` is what
    /// [`ActiveMesh::around`] collected for it.
    pub fn fly(&mut self, index: usize, done: f64, around: &OperationFaces) {
        let flight = self.flights[index];
        debug_assert!(around.moved == [flight.vertex; 2] && done >= flight.done);
        let has_arrived = done >= 1.0;
        let place = if has_arrived {
            self.end_of(&flight)
        } else {
            (flight.start.as_dvec3() + self.way(&flight) * done).as_vec3()
        };
        self.flights[index].done = done.min(1.0);
        let vertex = &mut self.vertices[flight.vertex as usize];
        vertex.position = place;
        if has_arrived && !flight.to_parent {
            *vertex = flight.home;
        }
    }

    /// Ends the flights that have come to their own places. Those at their parent's wait for the collapse.
    pub fn land(&mut self) {
        self.flights
            .retain(|flight| flight.to_parent || flight.done < 1.0);
    }

    /// The other vertex of the same split, if it is in flight too: its index.
    #[must_use]
    pub fn sibling(&self, flight: &Geomorph) -> Option<usize> {
        let slot = self.maker_of_vertex(flight.vertex)?;
        let [vt, vu] = self.children(slot);
        self.flight_of(if flight.vertex == vt { vu } else { vt })
    }

    /// Whether both vertices of a performed slot have come to where their parent is.
    #[must_use]
    pub fn has_come_to_parent(&self, slot: Slot) -> bool {
        self.children(slot).into_iter().all(|vertex| {
            let flight = self.flight_of(vertex).map(|index| &self.flights[index]);
            flight.is_some_and(|flight| flight.to_parent && flight.done >= 1.0)
        })
    }

    /// Whether a corner of one of these faces is in flight.
    #[must_use]
    pub fn any_in_flight(&self, faces: &[Handle]) -> bool {
        let flies = |vertex: &Handle| self.flight_of(*vertex).is_some();
        !self.flights.is_empty()
            && faces
                .iter()
                .any(|&face| self.face(face).corners.iter().any(flies))
    }

    /// Ends the flight of a vertex if it is in flight: what the file says of it holds again.
    pub(super) fn ground(&mut self, vertex: Handle) {
        if let Some(index) = self.flight_of(vertex) {
            let flight = self.flights.swap_remove(index);
            self.vertices[vertex as usize] = flight.home;
        }
    }

    fn flight_of(&self, vertex: Handle) -> Option<usize> {
        self.flights
            .iter()
            .position(|flight| flight.vertex == vertex)
    }

    /// vt and vu of a slot.
    #[must_use]
    pub fn children(&self, slot: Slot) -> [Handle; 2] {
        let vt = self.vt(slot);
        [vt, vt + 1]
    }
}
