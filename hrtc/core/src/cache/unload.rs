//! The steps in a region's life that load or unload its closure; see [`RegionState`] for all of
//! them.

use super::lists::Cursor;
use super::{Cache, LoadError, PENDING, RegionKey, RegionState};
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

    /// The first part of the answer to a requested region arrives. A station that was asked again
    /// begins again: what came before is unloaded.
    pub fn begin_answer(&mut self, region: usize) {
        self.unload(region, u32::MAX);
        self.regions.at_mut(region).begin_answer();
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

    /// The answer to a requested region builds on evicted records: it is to be requested with every
    /// record.
    pub fn ask_again(&mut self, region: usize) {
        self.unload(region, u32::MAX);
        self.regions.ask_again(region);
    }

    /// A region cannot be used; after a while it may be requested again. Returns whether its answer
    /// was outstanding.
    pub fn refuse(&mut self, region: usize, tick: u64) -> bool {
        self.unload(region, u32::MAX);
        self.regions.refuse(region, tick)
    }

    /// Unloads a region and forgets it without a word to the station, which goes on counting it as
    /// subscribed: should it be requested again, the answer lacks records, and is requested once
    /// more.
    pub fn remove_region(&mut self, region: usize) {
        self.unload(region, u32::MAX);
        self.regions.remove(region);
    }

    /// The epoch ends: answers under way are lost, and releases need not be told, since the station
    /// begins anew.
    pub fn end_epoch(&mut self) {
        self.regions.forget_messages();
        for place in 0..self.regions.capacity() {
            match self.regions.get(place).map(|region| region.state()) {
                Some(RegionState::Requested | RegionState::ToRequestAgain) => {
                    self.remove_region(place)
                }
                Some(RegionState::ToRelease) => self.regions.remove(place),
                _ => {}
            }
        }
    }

    /// Unloads a region's closure, at most `max_entries` entries of it; the rest when it is called
    /// again. The region stays in the table; its next state is for the caller to choose.
    ///
    /// Returns whether all of it is unloaded, and the number of entries gone through.
    pub fn unload(&mut self, region: usize, max_entries: u32) -> (bool, u32) {
        if self.regions.at(region).state() != RegionState::Unloading {
            // A change that has begun is finished; only a damaged region is unloaded while it is
            // wanted.
            let wanted = self.regions.at(region).wanted;
            self.set_wanted(region, wanted, u32::MAX);
            self.set_wanted(region, false, u32::MAX);
            self.regions.at_mut(region).begin_unload();
        }
        let entry = *self.regions.at(region);
        let mut cursor = entry.cursor;
        let count = max_entries.min(entry.changing);
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
        let entry = self.regions.at_mut(region);
        entry.changing -= count;
        entry.cursor = cursor;
        if entry.changing > 0 {
            entry.go_on_unloading();
            return (false, count);
        }
        let mut list = entry.closure;
        self.lists.free(&mut list);
        let entry = self.regions.at_mut(region);
        entry.closure = list;
        entry.cursor = Cursor::start(&list);
        (true, count)
    }
}
