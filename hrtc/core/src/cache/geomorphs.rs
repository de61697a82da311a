//! Vertices of geomorphs, with their tree and queues.

use super::Cache;
use spm::{OperationFaces, Slot};

/// Vertices that may geomorph at once.
pub const MAX_GEOMORPHS: usize = 96;

impl Cache {
    /// Whether nothing needs a performed slot any more.
    #[must_use]
    pub fn may_collapse(&self, slot: Slot) -> bool {
        self.references[slot as usize].wanted == 0 && self.mesh.collapse_is_legal(slot)
    }

    /// Puts the vertices of the split that was performed last back to where the surface was, and on
    /// their way; while there is room.
    pub fn start_geomorphs(&mut self, operation: &OperationFaces) {
        self.mesh.start_split_geomorph(operation);
    }

    /// Sends the vertices of a slot that nothing needs to where their parent is; while there is
    /// room. It waits for no collapse then.
    pub fn start_collapse(&mut self, slot: Slot) {
        self.mesh.start_collapse_geomorph(slot);
        self.references[slot as usize].leaving = true;
        self.requeue(slot);
    }

    /// Sends them back when it is needed again.
    pub fn cancel_collapse(&mut self, slot: Slot) {
        let leaving = &mut self.references[slot as usize].leaving;
        if std::mem::take(leaving) {
            self.mesh.reverse_geomorphs(slot);
            self.requeue(slot);
        }
    }

    /// Puts a collapse behind all others that wait.
    pub fn defer_collapse(&mut self, slot: Slot) {
        let references = &mut self.references[slot as usize];
        let leaving = std::mem::replace(&mut references.leaving, true);
        self.requeue(slot);
        self.references[slot as usize].leaving = leaving;
        self.requeue(slot);
    }

    /// Moves a vertex to the share `done` of its displacement; see
    /// [`spm::ActiveMesh::step_geomorph`].
    pub fn step_geomorph(&mut self, index: usize, done: f64, around: &OperationFaces) {
        self.mesh.step_geomorph(index, done, around);
        self.mark_deformed(around);
    }

    /// Ends the flights that have come home.
    pub fn finish_geomorphs(&mut self) {
        self.mesh.finish_geomorphs();
    }
}
