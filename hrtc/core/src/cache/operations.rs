//! Splits and collapses of mesh and tree together.

use super::{Cache, Cursor, PENDING};
use mutants::{Mutant, is};
use spm::{NONE, OperationError, OperationFaces, Slot};

/// What comes behind a split that has to wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextBehind {
    /// A split that is legal.
    Legal(Slot),
    /// Nothing any more: the closure ends.
    End,
    /// More entries lie before it than may be gone through now.
    Unfinished,
}

impl Cache {
    /// The next split of a wanted region, skipping what is performed; marks the region refined at
    /// the end.
    ///
    /// `budget` counts the entries gone through and is the most that may be; `None` when it is used
    /// up too.
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

    /// The next split of a wanted region behind one that has to wait, which is legal all the same.
    /// `place` says how far it was looked for; `budget` counts the entries gone through and is the
    /// most that may be.
    pub fn next_split_behind(
        &self,
        region: usize,
        place: &mut Option<Cursor>,
        budget: &mut u32,
    ) -> NextBehind {
        let entry = self.regions.at(region);
        let mut cursor = place.unwrap_or(entry.cursor);
        loop {
            cursor = self.lists.next(cursor);
            let Some(slot) = self.lists.get(&entry.closure, cursor) else {
                return NextBehind::End;
            };
            if *budget == 0 {
                return NextBehind::Unfinished;
            }
            *budget -= 1;
            *place = Some(cursor);
            if slot & PENDING == 0 && self.mesh.split_is_legal(slot) {
                return NextBehind::Legal(slot);
            }
        }
    }

    /// Puts a split that [`Cache::next_split`] gave back: it is still to do.
    pub fn defer_split(&mut self, region: usize) {
        self.regions.at_mut(region).to_split += 1;
    }

    /// Performs a split and updates the tree's structure and marks.
    ///
    /// # Errors
    /// When the record does not fit the mesh, or its fan is too large for now; nothing has changed
    /// then.
    pub fn split(&mut self, slot: Slot, out: &mut OperationFaces) -> Result<(), OperationError> {
        let damaged = OperationError::Damaged(self.mesh.id(slot));
        if !self.mesh.split_is_legal(slot) {
            return Err(damaged);
        }
        let fl = self.mesh.fl(slot);
        let (leaf_l, leaf_r) = self.mesh.leaves(slot);
        let (near_l, near_r) = self.mesh.neighbours_of_new_faces(slot);
        if !self.tree.insert_near(fl, leaf_l, near_l) {
            return Err(damaged);
        }
        if leaf_r != NONE && !self.tree.insert_near(fl + 1, leaf_r, near_r) {
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
        self.mark_deformed(out);
        // What it needs does not collapse: the other vertex of its parent turns round.
        for dependency in self.mesh.dependencies(slot) {
            self.cancel_collapse(dependency);
        }
        self.requeue_with_dependencies(slot);
        self.faces_high_water = self.faces_high_water.max(self.mesh.active_faces());
        Ok(())
    }

    /// The slot whose collapse has waited longest.
    #[must_use]
    pub fn oldest_collapse(&self) -> Option<Slot> {
        (self.collapses.first != NONE).then_some(self.collapses.first)
    }

    /// Performs the collapse of a slot that nothing needs any more.
    ///
    /// # Errors
    /// When its fans are too large for now; nothing has changed then.
    pub fn collapse(&mut self, slot: Slot, out: &mut OperationFaces) -> Result<(), OperationError> {
        self.mesh.collapse(slot, out)?;
        self.references[slot as usize].leaving = false;
        for &face in out
            .made_or_removed()
            .iter()
            .filter(|_| !is(Mutant::TreeFace))
        {
            self.tree.remove(face);
        }
        self.mark_deformed(out);
        self.requeue_with_dependencies(slot);
        Ok(())
    }

    /// Performs the oldest collapse that is waiting and whose fans are small enough; false when
    /// none is.
    pub fn collapse_oldest(&mut self, out: &mut OperationFaces) -> bool {
        for _ in 0..self.to_collapse() {
            let Some(slot) = self.oldest_collapse() else {
                break;
            };
            if self.collapse(slot, out).is_ok() {
                return true;
            }
            self.defer_collapse(slot);
        }
        false
    }

    pub(super) fn mark_deformed(&mut self, out: &OperationFaces) {
        for &face in out.deformed().iter().filter(|_| !is(Mutant::Box)) {
            self.tree.deform(face);
        }
    }

    /// Refits the tree over what the operations deformed; the number of boxes.
    pub fn refit(&mut self) -> u32 {
        let mesh = &self.mesh;
        self.tree.refit(|face| mesh.face_box(face))
    }
}
