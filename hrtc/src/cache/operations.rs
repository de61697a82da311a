//! Splits and collapses of mesh and tree together.

use super::Cache;
use shared::spm::{DamagedRecord, NONE, OperationFaces, Slot};

impl Cache {
    /// The next split of a wanted region, skipping what is performed; marks the region refined at the end.
    ///
    /// `budget` counts the entries gone through and is the most that may be; `None` when it is used up too.
    pub fn next_split(&mut self, region: usize, budget: &mut u32) -> Option<Slot> {
        let entry = *self.regions.at(region);
        debug_assert!(entry.wanted);
        if entry.changing > 0 {
            return None;
        }
        let mut cursor = entry.cursor;
        let mut found = None;
        let mut at_end = false;
        while *budget > 0 {
            match self.lists.get(&entry.closure, cursor) {
                Some(slot) if self.mesh.is_performed(slot) => {
                    *budget -= 1;
                    cursor = self.lists.next(cursor);
                }
                Some(slot) => {
                    found = Some(slot);
                    break;
                }
                None => {
                    at_end = true;
                    break;
                }
            }
        }
        let entry = self.regions.at_mut(region);
        entry.cursor = cursor;
        entry.refined = at_end;
        entry.to_split = match found {
            Some(_) => entry.to_split.saturating_sub(1),
            None if at_end => 0,
            None => entry.to_split,
        };
        found
    }

    /// Performs a split and updates the tree's structure and marks.
    ///
    /// # Errors
    /// When the record does not fit the mesh; nothing has changed then.
    pub fn split(&mut self, slot: Slot, out: &mut OperationFaces) -> Result<(), DamagedRecord> {
        let damaged = DamagedRecord(self.mesh.id(slot));
        if !self.mesh.split_is_legal(slot) {
            return Err(damaged);
        }
        let fl = self.mesh.fl(slot);
        let (leaf_l, leaf_r) = self.mesh.leaves(slot);
        let (beside_l, beside_r) = self.mesh.beside(slot);
        if !self.tree.insert_near(fl, leaf_l, beside_l) {
            return Err(damaged);
        }
        if leaf_r != NONE && !self.tree.insert_near(fl + 1, leaf_r, beside_r) {
            self.tree.remove(fl);
            return Err(damaged);
        }
        if let Err(error) = self.mesh.split(slot, out) {
            self.tree.remove(fl);
            if leaf_r != NONE {
                self.tree.remove(fl + 1);
            }
            return Err(error);
        }
        for &face in out.deformed() {
            self.tree.deform(face);
        }
        self.requeue_with_dependencies(slot);
        self.faces_high_water = self.faces_high_water.max(self.mesh.active_faces());
        Ok(())
    }

    /// Performs the oldest collapse that is waiting; false when none is.
    pub fn collapse_oldest(&mut self, out: &mut OperationFaces) -> bool {
        let slot = self.collapses.first;
        if slot == NONE {
            return false;
        }
        self.mesh.collapse(slot, out);
        for &face in out.made_or_removed() {
            self.tree.remove(face);
        }
        for &face in out.deformed() {
            self.tree.deform(face);
        }
        self.requeue_with_dependencies(slot);
        true
    }

    /// Refits the tree over what the operations deformed; the number of boxes.
    pub fn refit(&mut self) -> u32 {
        let mesh = &self.mesh;
        self.tree.refit(|face| mesh.face_box(face))
    }
}
