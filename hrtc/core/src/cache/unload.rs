//! The steps in a region's life that load or unload its closure; see [`RegionState`] for all of
//! them. A closure may be that of a whole model: it is unloaded some entries a tick.

use super::lists::Cursor;
use super::{AfterUnload, Cache, LoadError, PENDING, RegionKey, RegionState};
use spm::RegionId;

impl Cache {
    /// The index of the region of this name (id and bits of its tolerance) if it is requested.
    #[must_use]
    pub fn requested(&self, (region, tolerance_bits): (u32, u32)) -> Option<usize> {
        let key = RegionKey {
            id: RegionId(region),
            tolerance_bits,
        };
        let index = self.regions.index(key)?;
        (self.regions.at(index).state() == RegionState::Requested).then_some(index)
    }

    /// The first part of the answer to a requested region arrives.
    ///
    /// # Errors
    /// `Gap` when a part of an answer is here already: it is not known what belongs to which.
    pub fn begin_answer(&mut self, region: usize) -> Result<(), LoadError> {
        let entry = self.regions.at_mut(region);
        if entry.closure.length() > 0 {
            return Err(LoadError::Gap);
        }
        entry.begin_answer();
        Ok(())
    }

    /// Ends the answer to a requested region.
    ///
    /// # Errors
    /// `Gap` when records of its closure did not come.
    pub fn end_answer(&mut self, region: usize) -> Result<(), LoadError> {
        let entry = self.regions.at_mut(region);
        if entry.pending != 0 {
            return Err(LoadError::Gap);
        }
        entry.end_answer();
        Ok(())
    }

    /// A region is to be unloaded, by [`Cache::go_on_unloading`], and then what is said. Returns
    /// whether its answer was outstanding.
    pub fn begin_unload(&mut self, region: usize, then: AfterUnload, tick: u64) -> bool {
        let was_requested = self.regions.at(region).state() == RegionState::Requested;
        self.regions.begin_unload(region, then, tick);
        was_requested
    }

    /// The epoch ends: answers under way are lost, and releases need not be told, since the station
    /// begins anew. [`Cache::go_on_unloading`] goes through the regions.
    pub fn end_epoch(&mut self) {
        self.regions.end_epoch();
    }

    /// Goes on with what takes several ticks: a model to forget; or regions of the last epoch, then
    /// the closures to unload, the oldest first. `entries`: slots, places of the table and entries
    /// of closures that may be gone through.
    pub fn go_on_unloading(&mut self, entries: &mut u32) {
        if self.is_clearing {
            return self.go_on_clearing(entries);
        }
        if !self.regions.settle_epoch(entries) {
            return;
        }
        while let Some(region) = self.regions.first_unloading() {
            let is_done = *entries > 0 && self.unload_some(region, entries);
            if !is_done || !self.regions.end_unload(region) {
                return;
            }
            *entries = entries.saturating_sub(1);
        }
    }

    /// Unloads a region as far as the entries go; whether all of it is unloaded.
    fn unload_some(&mut self, region: usize, entries: &mut u32) -> bool {
        while self.regions.at(region).state() == RegionState::Unwanting {
            let entry = self.regions.at_mut(region);
            if entry.changing == 0 && !entry.wanted {
                entry.give_up();
            } else if *entries == 0 {
                return false;
            } else {
                // A change that has begun is finished first: it may be one into the set.
                *entries -= self.set_wanted(region, false, *entries);
            }
        }
        let entry = *self.regions.at(region);
        let mut cursor = entry.cursor;
        let count = entry.changing.min(*entries);
        for _ in 0..count {
            if let Some(item) = self.lists.get(&entry.closure, cursor)
                && item & PENDING == 0
            {
                let held = &mut self.references[item as usize].held;
                *held -= 1;
                if *held == 0 {
                    self.requeue(item);
                }
            }
            cursor = self.lists.next(cursor);
        }
        *entries -= count;
        let entry = self.regions.at_mut(region);
        entry.changing -= count;
        entry.cursor = cursor;
        if entry.changing > 0 {
            return false;
        }
        let mut list = entry.closure;
        self.lists.free(&mut list);
        let entry = self.regions.at_mut(region);
        entry.closure = list;
        entry.cursor = Cursor::start(&list);
        true
    }
}
