//! Room in the cache: what is collapsed and unloaded where slots are short.

use super::front::Front;
use super::geomorph::CollapseOutcome;
use super::memory_pressure::MemoryPressure;
use crate::budget::Budget;
use crate::cache::{AfterUnload, Region};
use crate::probe::contacts::Contacts;
use crate::tuning::lod::{ENTRIES_PER_EVICTION, RELEASE_WINDOW, RELEASES_PER_TICK};
use spm::RegionId;

impl Front {
    /// Unloads a region, some of its closure in each tick; then the station is to be told.
    pub fn unload(&mut self, index: usize, tick: u64, budget: &mut Budget) {
        self.cache.begin_unload(index, AfterUnload::Release, tick);
        self.cache.go_on_unloading(&mut budget.upkeep);
    }

    /// Whether a region is still being unloaded.
    #[must_use]
    pub fn is_unloading(&self) -> bool {
        self.cache.regions.first_unloading().is_some()
    }

    /// Releases regions while the cache is nearly full, so that a fast probe need not wait for
    /// room.
    pub(super) fn keep_some_room(&mut self, tick: u64, budget: &mut Budget) {
        self.obey_limit(tick, budget);
        // What is only loaded ahead goes before the contact comes coarser.
        let asking = self.cache.is_over_limit().then_some(0);
        for _ in 0..RELEASES_PER_TICK {
            if !self.cache.is_nearly_full() || !self.release_one(asking, tick, budget) {
                break;
            }
        }
    }

    /// So many bytes of the cache may be in use from now on. With more than before, what was done
    /// without for want of room is asked for again at once.
    pub fn set_cache_limit(&mut self, bytes: usize) {
        if bytes > self.cache.limit() {
            self.pressure = MemoryPressure::new(self.horizons.pressure);
        }
        self.excess = None;
        self.cache.set_limit(bytes);
    }

    /// Evicts what nothing holds while the cache is over a limit that was lowered. Where no more
    /// goes for the time that an unused region is kept, though the station could be told, less is
    /// asked for.
    fn obey_limit(&mut self, tick: u64, budget: &mut Budget) {
        let evicted = self
            .cache
            .evict_excess(budget.upkeep / ENTRIES_PER_EVICTION);
        budget.upkeep -= evicted * ENTRIES_PER_EVICTION;
        if !self.cache.is_over_limit() {
            self.excess = None;
            return;
        }
        let bytes = self.cache.in_use();
        if self.is_unloading() || !self.cache.regions.may_release() {
            // More goes as soon as the station can be told.
            self.excess = Some((bytes, tick));
            return;
        }
        match self.excess {
            Some((least, since)) if bytes >= least => {
                if tick > since + self.horizons.hysteresis {
                    self.pressure.exceed(tick);
                }
            }
            _ => self.excess = Some((bytes, tick)),
        }
    }

    /// Whether a region is finer than what is asked for now.
    pub(super) fn is_too_fine(&self, region: &Region) -> bool {
        let is_block = [RegionId::WHOLE, RegionId::PREFIX].contains(&region.key.id);
        let finest = self.finest_tolerance();
        !is_block && region.key.tolerance().is_some_and(|t| t < finest)
    }

    /// Makes a slot free for the region `asking`: by a waiting collapse, or by unloading a region.
    /// Returns whether one is free now.
    ///
    /// Keeps what a wanted region or the cells of a contact need; a probe that perceives a collapse
    /// defers it.
    pub fn make_room(
        &mut self,
        asking: usize,
        tick: u64,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> bool {
        loop {
            if self.cache.has_slot() {
                return true;
            }
            if budget.has_operations()
                && self.collapse_oldest(budget, contacts) == CollapseOutcome::Done
            {
                continue;
            }
            let due = self.cache.regions.at(asking).due;
            if budget.operations == 0 || !self.release_one(Some(due), tick, budget) {
                return false;
            }
            budget.operations -= 1;
        }
    }

    /// Releases a resident region: of the [`RELEASE_WINDOW`] used least recently the first that is
    /// not predicted any more, or is finer than there is room for; failing that, if a region that
    /// is due at `asking` needs the room, of those that are only loaded ahead the one that is due
    /// last. The window bounds the cost of a tick.
    fn release_one(&mut self, asking: Option<u64>, tick: u64, budget: &mut Budget) -> bool {
        // One after the other: each makes room for the next to be judged by.
        if budget.upkeep == 0 || !self.cache.regions.may_release() || self.is_unloading() {
            return false;
        }
        let hysteresis = self.horizons.hysteresis;
        let mut victim: Option<(usize, u64)> = None;
        let mut next = self.cache.regions.oldest();
        for _ in 0..RELEASE_WINDOW {
            let Some(index) = next else {
                break;
            };
            next = self.cache.regions.next_older(index);
            let region = self.cache.regions.at(index);
            if !region.is_resident() {
                // It has nothing to release: it moves out of the window, so that those of a far
                // station, which are many, do not fill that while their answers are awaited.
                let used_at = region.used_at;
                self.cache.regions.mark_used(index, used_at);
                continue;
            }
            if region.wanted || region.changing > 0 {
                continue;
            }
            if self.is_too_fine(region) || region.used_at + hysteresis < tick {
                victim = Some((index, region.due));
                break;
            }
            let ahead =
                region.needed + hysteresis < tick && asking.is_some_and(|due| region.due > due);
            if ahead && victim.is_none_or(|(_, due)| region.due > due) {
                victim = Some((index, region.due));
            }
        }
        let Some((index, _)) = victim else {
            return false;
        };
        self.unload(index, tick, budget);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cache::RegionKey;
    use crate::observer::NoObserver;
    use scene::{NoFiles, Overrides, parse};

    /// A far station is asked for many regions, which the hand does not go to any more.
    #[test]
    fn regions_whose_answers_are_awaited_do_not_keep_others_from_being_released() {
        let text = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n";
        let plan = parse(text, "test", "".as_ref(), &Overrides::default(), &NoFiles)
            .expect("the scene is good");
        let mut front = Front::new(&plan, 4 << 20);
        let awaited = RELEASE_WINDOW as u32 + 36;
        for k in 0..awaited + 10 {
            let region = front.cache.regions.request(RegionKey::prefix(k));
            let region = region.expect("there is room");
            if k >= awaited {
                front.cache.begin_answer(region).expect("it is requested");
                front
                    .cache
                    .end_answer(region)
                    .expect("its closure is empty");
            }
        }
        let mut observer = NoObserver;
        let mut budget = Budget {
            observer: &mut observer,
            ingest: 0,
            unspent_ingest: 0,
            operations: 1,
            faces: 0,
            max_fan: 0,
            entries: 0,
            prepaid: 0,
            upkeep: 1000,
            forgotten: 0,
        };
        let tick = 1 + front.horizons.hysteresis;
        let released = [(); 2].map(|()| front.release_one(None, tick, &mut budget));
        assert_eq!(released, [false, true]);
        let mut told = Vec::new();
        front.cache.regions.drain_releases(|key| told.push(key));
        assert_eq!(
            told,
            [RegionKey::prefix(awaited)],
            "the oldest that is here"
        );
        // All that is awaited is still known.
        let is_known = |k| front.cache.regions.index(RegionKey::prefix(k)).is_some();
        assert!((0..awaited).all(is_known));
    }
}
