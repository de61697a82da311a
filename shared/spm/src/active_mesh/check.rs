//! Every invariant of an active mesh, for tests.

use super::{ActiveMesh, Handle, NONE, Performed};

impl ActiveMesh {
    /// Handles of all active faces.
    pub fn for_each_active_face(&self, mut visit: impl FnMut(Handle)) {
        (0..self.base_faces).for_each(&mut visit);
        for slot in 0..self.states.len() as u32 {
            if self.is_performed(slot) {
                visit(self.fl(slot));
                if self.links[slot as usize].leaf_r != NONE {
                    visit(self.fl(slot) + 1);
                }
            }
        }
    }

    /// Checks every invariant; for tests, it allocates.
    ///
    /// # Panics
    /// With the first invariant that does not hold.
    pub fn check(&self) {
        let mut edges = Vec::new();
        let mut count = 0;
        self.for_each_active_face(|f| {
            count += 1;
            let face = self.faces[f as usize];
            for k in 0..3 {
                let v = face.corners[k];
                if let Some(slot) = self.creator_of_vertex(v) {
                    assert!(self.is_performed(slot), "face {f} has an inactive corner");
                }
                edges.push((v, face.corners[(k + 1) % 3]));
                let n = face.neighbours[k];
                if n != NONE {
                    assert!(self.is_active(n), "face {f} has an inactive neighbour {n}");
                    let other = &self.faces[n as usize];
                    let back = (0..3).find(|&j| {
                        other.neighbours[j] == f
                            && other.corners[(j + 1) % 3] == face.corners[(k + 2) % 3]
                    });
                    assert!(back.is_some(), "faces {f} and {n} disagree");
                }
            }
        });
        assert_eq!(count, self.active_faces, "the count of active faces");
        edges.sort_unstable();
        assert!(
            edges.windows(2).all(|w| w[0] != w[1]),
            "a directed edge occurs twice"
        );
        for slot in 0..self.states.len() as u32 {
            if self.is_performed(slot) {
                assert!(
                    self.dependencies(slot).all(|d| self.is_performed(d)),
                    "the front misses a dependency of VSP {}",
                    self.id(slot)
                );
            }
        }
        self.check_motion();
    }

    /// A slot moves exactly while one of its vertices has a geomorph; no base vertex has one.
    fn check_motion(&self) {
        let mut moves = vec![false; self.states.len()];
        for geomorph in self.geomorphs() {
            let Some(slot) = self.creator_of_vertex(geomorph.vertex()) else {
                panic!("base vertex {} has a geomorph", geomorph.vertex());
            };
            moves[slot as usize] = true;
        }
        for (slot, (state, moves)) in self.states.iter().zip(moves).enumerate() {
            assert_eq!(
                state.performed == Performed::Moving,
                moves,
                "the vertices of slot {slot}"
            );
        }
    }
}
