//! A random walk over fronts, for tests.

use super::{ActiveMesh, OperationFaces, Slot};

/// A walk over fronts by random legal splits and collapses. For tests; it allocates.
///
/// Slots must be VSP numbers. `random` returns evenly distributed numbers.
#[derive(Debug, Clone)]
pub struct FrontWalk {
    /// The mesh.
    pub mesh: ActiveMesh,
    /// Faces of the last operation.
    pub out: OperationFaces,
    /// The performed VSPs, in any order.
    pub performed: Vec<Slot>,
    /// Every VSP whose split is legal, and others.
    ready: Vec<Slot>,
    /// The VSPs that depend on each.
    dependents: Vec<Vec<Slot>>,
}

impl FrontWalk {
    /// Starts from a mesh with every record loaded.
    #[must_use]
    pub fn new(mesh: ActiveMesh) -> Self {
        let slots = mesh.states.len() as u32;
        let mut dependents = vec![Vec::new(); slots as usize];
        for slot in 0..slots {
            for dependency in mesh.dependencies(slot) {
                dependents[dependency as usize].push(slot);
            }
        }
        Self {
            ready: (0..slots).filter(|&i| mesh.split_is_legal(i)).collect(),
            performed: (0..slots).filter(|&i| mesh.is_performed(i)).collect(),
            mesh,
            out: OperationFaces::new(),
            dependents,
        }
    }

    /// Number of VSPs.
    #[must_use]
    pub fn vsps(&self) -> u32 {
        self.dependents.len() as u32
    }

    /// Performs a random legal split that `wanted` accepts; `None` when there is none.
    ///
    /// # Panics
    /// When a record does not fit the mesh, or a fan is too large for one operation.
    pub fn split(
        &mut self,
        random: &mut impl FnMut() -> u32,
        wanted: impl Fn(Slot) -> bool,
    ) -> Option<Slot> {
        let mut tried = Vec::new();
        let found = loop {
            if self.ready.is_empty() {
                break None;
            }
            let at = random() as usize % self.ready.len();
            let i = self.ready.swap_remove(at);
            if self.mesh.split_is_legal(i) {
                if wanted(i) {
                    break Some(i);
                }
                tried.push(i);
            }
        };
        self.ready.append(&mut tried);
        self.perform(found?);
        found
    }

    /// Undoes a random legal split; `None` when it finds none in a hundred tries.
    pub fn collapse(&mut self, random: &mut impl FnMut() -> u32) -> Option<Slot> {
        for _ in 0..100.min(self.performed.len()) {
            let at = random() as usize % self.performed.len();
            let i = self.performed[at];
            if self.mesh.collapse_is_legal(i) {
                self.undo(i);
                return Some(i);
            }
        }
        None
    }

    /// Undoes a VSP whose collapse is legal.
    ///
    /// # Panics
    /// When it is not performed, not legal, or its fans are too large for one operation.
    pub fn undo(&mut self, slot: Slot) {
        let at = self.performed.iter().position(|&i| i == slot);
        self.performed.swap_remove(at.expect("it is performed"));
        let done = self.mesh.collapse(slot, &mut self.out);
        assert!(done.is_ok(), "{done:?}");
        self.ready.push(slot);
    }

    /// Performs a VSP after its missing dependencies, ascending, by splits alone; each must be
    /// legal by the adjacency test in its turn. Returns whether all were, and their number.
    ///
    /// **No split ever needs a collapse first.** Thesis Figure 5.7 B collapses a VSP k to make
    /// another one legal. That case does not occur. A split waits for its dependencies only, which
    /// are splits with smaller numbers, and no other performed split changes whether it is legal: a
    /// split j can change the neighbours of fn0..fn3 of i around the vertex that i splits only if i
    /// depends on j.
    ///
    /// # Panics
    /// When a record does not fit the mesh, or a fan is too large for one operation.
    pub fn force(&mut self, slot: Slot) -> (bool, u32) {
        let mut missing = vec![slot];
        let mut next = 0;
        while let Some(&i) = missing.get(next) {
            next += 1;
            for dependency in self.mesh.dependencies(i) {
                // At most a few dozen: a closure of one VSP.
                if !self.mesh.is_performed(dependency) && !missing.contains(&dependency) {
                    missing.push(dependency);
                }
            }
        }
        missing.sort_unstable();
        for (done, &i) in (0..).zip(&missing) {
            if !(self.mesh.split_is_legal(i) && self.mesh.split_is_legal_by_adjacency(i)) {
                return (false, done);
            }
            self.perform(i);
        }
        (true, missing.len() as u32)
    }

    fn perform(&mut self, slot: Slot) {
        let done = self.mesh.split(slot, &mut self.out);
        assert!(done.is_ok(), "{done:?}");
        self.performed.push(slot);
        let mesh = &self.mesh;
        let next = self.dependents[slot as usize].iter();
        self.ready.extend(next.filter(|&&d| mesh.split_is_legal(d)));
    }
}
