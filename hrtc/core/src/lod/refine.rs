//! Two-phase refinement (thesis Figure 5.17): splits in B \ A, collapses in A \ B, what the contact
//! reaches first, at most K operations a tick.

use super::front::{Front, LookBehind};
use super::geomorph::{CollapseOutcome, Folds, Transition};
use crate::budget::Budget;
use crate::cache::{AfterUnload, NextBehind, Region};
use crate::probe::contacts::Contacts;
use crate::tuning::governor::OPERATION_FACES;
use crate::tuning::lod::{
    BEHIND_SHARE, CHANGES_PER_UNIT, ENTRIES_PER_OPERATION, ENTRIES_PER_WAIT, FACES_PER_WAIT,
    MAX_WANTED,
};
use crate::work::TickWork;
use spm::{OperationError, Slot};

/// The most work units that refinement may take a tick: operations, and closure entries gone
/// through, of which [`CHANGES_PER_UNIT`] count as one where they change set, are unloaded or
/// forgotten. A longer closure, as that of a whole model, takes several ticks.
#[must_use]
pub fn max_work(operations: usize, work: &TickWork) -> u32 {
    let upkeep = work.upkeep.div_ceil(CHANGES_PER_UNIT);
    operations as u32 * (ENTRIES_PER_OPERATION + 1) + upkeep
}

/// Ticks for which a region stays wanted after its last prediction: in the finest ring the time
/// that the probe takes over a cell, so that the trail of a fast probe is no longer; never less
/// than a `round` of the predictor. `most`: for other rings.
fn hysteresis(region: &Region, finest: f32, cell_ticks: f64, [round, most]: [u64; 2]) -> u64 {
    let is_finest = region.key.tolerance().is_some_and(|t| t <= finest);
    let least = round + 4;
    if is_finest {
        (cell_ticks as u64).min(most).max(least)
    } else {
        most.max(least)
    }
}

/// Whether a region's prediction is as new as it can be: the coarser rings are looked at less
/// often.
fn is_current(region: &Region, finest: f32, tick: u64, round: u64) -> bool {
    let turns = round + 2;
    let is_finest = region.key.tolerance().is_none_or(|t| t <= finest);
    tick <= region.needed + if is_finest { turns } else { 3 * turns }
}

/// Urgency of a region that is to be refined, as a number that sorts: regions that the prediction
/// has left come last, those due first come first, of these the coarser, since they bound the error
/// sooner. The index at the end makes it unique.
fn order_of(region: &Region, index: usize, finest: f32, [tick, round]: [u64; 2]) -> u64 {
    let left = u64::from(!is_current(region, finest, tick, round));
    let ticks = region.due.saturating_sub(tick).min((1 << 30) - 1);
    let finer = u64::from(!region.key.tolerance_bits >> 16);
    left << 63 | ticks << 32 | finer << 16 | index as u64
}

impl Front {
    /// Splits, then collapses with the remaining operations of the tick.
    ///
    /// As many splits as it takes to have every region done when it is due, and at least
    /// [`TickWork::min_operations`], so that ticks are even. Regions that were unloaded wait in the
    /// region table for the session to release them.
    pub fn refine(&mut self, tick: u64, budget: &mut Budget, contacts: &mut Contacts) {
        self.used.fill(0.0);
        // Regions that are unloaded leave the set in their own time.
        let cache = &self.cache;
        let is_kept = |region: &usize| cache.regions.get(*region).is_some_and(Region::is_resident);
        self.wanted.retain(is_kept);
        let allowed_entries = budget.entries;
        budget.go_through(|entries| self.update_wanted(tick, contacts, entries));
        self.step_geomorphs(tick, budget, contacts);
        self.split_wanted(tick, budget, contacts);
        let cache = &self.cache;
        self.wanted.retain(|&region| {
            let region = cache.regions.get(region);
            region.is_some_and(|r| r.is_resident() && (r.wanted || r.changing > 0))
        });
        let entries = allowed_entries - budget.entries;
        self.stats.entries += entries;
        self.stats.work_units += entries + self.stats.vsplits;
        let backlog = self.cache.to_collapse() / self.horizons.collapse;
        let is_busy = self.stats.vsplits > self.min_operations;
        let least = if is_busy { 0 } else { self.min_operations };
        for _ in 0..backlog.max(least).min(budget.operations) {
            let ends = !budget.has_operations();
            if ends || self.collapse_oldest(budget, contacts) == CollapseOutcome::None {
                break;
            }
        }
        self.cache.go_on_unloading(&mut budget.upkeep);
        self.keep_some_room(tick, budget);
    }

    /// Performs the splits of the wanted regions, the most urgent region first.
    fn split_wanted(&mut self, tick: u64, budget: &mut Budget, contacts: &mut Contacts) {
        let least = self.min_operations;
        let most = budget.operations.max(least);
        let due = self.splits_due(tick);
        let allowed = due.clamp(least, most);
        let mut entries_behind = budget.entries / BEHIND_SHARE;
        self.end_stale_look();
        // Collapses come first only when the records that wait need their room; see `make_room`.
        for k in 0..self.queue.len() {
            let region = (self.queue[k] & 0xFFFF) as usize;
            while budget.has_operations() && budget.entries > 0 && self.stats.vsplits < allowed {
                let next = budget.go_through(|entries| self.cache.next_split(region, entries));
                let Some(slot) = next else {
                    break;
                };
                let next = (region, slot);
                let mut tried = self.try_in_turn(next, tick, budget, contacts);
                let has_to_wait = tried.as_ref().is_ok_and(|of| !of.is_performed());
                if has_to_wait {
                    self.cache.defer_split(region);
                    let is_fold = tried == Ok(Transition::Rejected);
                    let entries = &mut entries_behind;
                    if self.split_behind(next, is_fold, entries, budget, contacts) {
                        // No order of splits goes without the fold.
                        tried = self.try_split(slot, Folds::Pass, budget, contacts);
                        let is_passed = tried.as_ref().is_ok_and(|of| of.is_performed());
                        self.stats.passed += u32::from(is_passed);
                    }
                }
                if tried.is_err() {
                    // The rest of the closure may depend on it: the region stays as it is.
                    self.refuse(region, AfterUnload::Reject, tick);
                    self.cache.go_on_unloading(&mut budget.upkeep);
                }
                if has_to_wait || tried.is_err() {
                    break;
                }
            }
        }
        if !budget.has_operations() || budget.entries == 0 {
            self.stats.left = due.saturating_sub(self.stats.vsplits);
        }
    }

    /// The look behind a split ends where the split is performed, or is not to be any more.
    fn end_stale_look(&mut self) {
        let cache = &self.cache;
        let goes_on = |of: &LookBehind| {
            let region = cache.regions.get(of.region);
            let is_its = region.is_some_and(|region| {
                let is_wanted = region.is_resident() && region.wanted && region.changing == 0;
                is_wanted && region.key == of.key
            });
            is_its && !cache.mesh().is_performed(of.slot)
        };
        self.behind = self.behind.filter(goes_on);
    }

    /// Tries the next split of a region. A split that would turn a face over and those behind it
    /// take turns while the look at these goes on, since a tick may have time for one of both only.
    fn try_in_turn(
        &mut self,
        (region, slot): (usize, Slot),
        tick: u64,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> Result<Transition, OperationError> {
        let is_looked_behind = self.behind.is_some_and(|of| of.is_of(region, slot));
        if is_looked_behind && !tick.is_multiple_of(2) {
            self.stats.rejected += 1;
            return Ok(Transition::Rejected);
        }
        let tried = self.try_split(slot, Folds::Wait, budget, contacts);
        if tried.as_ref().is_ok_and(|of| !of.is_performed()) {
            budget.go_through(|left| *left = left.saturating_sub(ENTRIES_PER_WAIT));
        }
        tried
    }

    /// Performs a split, unless it has to wait: how, or why not.
    fn try_split(
        &mut self,
        slot: Slot,
        folds: Folds,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> Result<Transition, OperationError> {
        self.faces.set_limit(budget.max_fan as usize);
        let transition = self.transition_of_split(slot, folds, contacts);
        if !transition.is_performed() {
            // To find that it has to wait is a part of what it would have cost.
            let looked_at = self.faces.deformed().len() as u32;
            self.charge(looked_at / FACES_PER_WAIT, budget);
            return Ok(transition);
        }
        match self.split(slot, transition, budget, contacts) {
            Ok(()) => Ok(transition),
            Err(OperationError::TooManyFaces(_)) => {
                self.charge(budget.max_fan / FACES_PER_WAIT, budget);
                self.stats.deferred += 1;
                Ok(Transition::Deferred)
            }
            Err(damaged) => Err(damaged),
        }
    }

    /// Performs a split.
    fn split(
        &mut self,
        slot: Slot,
        transition: Transition,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> Result<(), OperationError> {
        self.cache.split(slot, &mut self.faces)?;
        if transition == Transition::Geomorph {
            self.cache.start_geomorphs(&self.faces);
        }
        contacts.carry(self.cache.mesh(), &self.faces);
        self.charge_operation(budget);
        if transition == Transition::Geomorph {
            self.finish_small_geomorph(budget, contacts);
        }
        self.stats.vsplits += 1;
        Ok(())
    }

    /// A split or collapse has changed the faces in `self.faces`.
    pub(super) fn charge_operation(&mut self, budget: &mut Budget) {
        budget.charge_operation(&self.faces);
        self.stats.faces += OPERATION_FACES + self.faces.deformed().len() as u32;
    }

    /// Faces were looked at, or moved by a geomorph.
    pub(super) fn charge(&mut self, faces: u32, budget: &mut Budget) {
        budget.charge_faces(faces);
        self.stats.faces += faces;
    }

    /// Performs splits of a region behind one that has to wait: they are not perceived more than
    /// others. `entries`: closure entries that may be gone through for that in this tick. Whether
    /// the split would turn a face over (`is_fold`), all of those behind it were looked at, none is
    /// performed or will be once the faces around it are at rest, and there is an operation left.
    /// Where entries or time end before, the next tick goes on.
    fn split_behind(
        &mut self,
        (region, slot): (usize, Slot),
        is_fold: bool,
        entries: &mut u32,
        budget: &mut Budget,
        contacts: &mut Contacts,
    ) -> bool {
        let before = *entries;
        let known = self.behind.filter(|of| of.is_of(region, slot));
        let goes_on =
            |of: &LookBehind| is_fold && (of.max_fan == 0 || of.max_fan >= budget.max_fan);
        let mut look = known.filter(goes_on).unwrap_or(LookBehind {
            region,
            key: self.cache.regions.at(region).key,
            slot,
            place: None,
            is_over: false,
            max_fan: 0,
        });
        let mut none_comes = true;
        while !look.is_over && budget.has_operations() {
            let next = self
                .cache
                .next_split_behind(region, &mut look.place, entries);
            let NextBehind::Legal(slot) = next else {
                look.is_over = next == NextBehind::End;
                break;
            };
            let Ok(tried) = self.try_split(slot, Folds::Wait, budget, contacts) else {
                // A damaged record is found when its turn comes.
                break;
            };
            if !tried.is_performed() {
                *entries = entries.saturating_sub(ENTRIES_PER_WAIT);
            }
            if tried == Transition::Deferred {
                look.max_fan = look.max_fan.max(budget.max_fan);
            }
            // Where nothing moves, what is deferred does not come of itself.
            let is_moving = !self.cache.mesh().geomorphs().is_empty();
            none_comes &=
                tried == Transition::Rejected || (tried == Transition::Deferred && !is_moving);
        }
        let spent = before - *entries;
        budget.go_through(|left| *left = left.saturating_sub(spent));
        if before == 0 {
            // Those before it took them all.
            return false;
        }
        let none_came = is_fold && none_comes;
        let is_left = none_came && look.is_over && budget.has_operations();
        if none_came && !is_left {
            self.behind = Some(look);
        } else if known.is_some() {
            self.behind = None;
        }
        is_left
    }

    /// Sorts the regions to be refined by urgency. Returns the splits that this tick must do for
    /// every region to be done in time.
    fn splits_due(&mut self, tick: u64) -> u32 {
        let finest = self.finest_tolerance();
        let times = [tick, self.predictions.round()];
        let Self { wanted, queue, .. } = self;
        queue.clear();
        for &index in wanted.iter() {
            let region = self.cache.regions.at(index);
            if region.wanted && region.changing == 0 && !region.refined {
                queue.push(order_of(region, index, finest, times));
            }
        }
        queue.sort_unstable();
        let (mut sum, mut most) = (0u64, 0u64);
        for &order in queue.iter().take_while(|&&order| order >> 63 == 0) {
            let region = self.cache.regions.at((order & 0xFFFF) as usize);
            let ticks = order >> 32;
            sum += u64::from(region.to_split);
            // Done when three quarters of the time are over, since due times are estimates.
            most = most.max(4 * sum / (3 * ticks + 1));
        }
        u32::try_from(most).unwrap_or(u32::MAX)
    }

    /// Updates the wanted set: near regions in; out go regions that were left long enough ago, or
    /// are finer than room and time allow.
    fn update_wanted(&mut self, tick: u64, contacts: &Contacts, entries: &mut u32) {
        let mut k = 0;
        let finest = self.finest_tolerance();
        let cell_ticks = self.cell_ticks(contacts);
        while k < self.wanted.len() {
            let index = self.wanted[k];
            let region = self.cache.regions.at(index);
            let times = [self.predictions.round(), self.horizons.hysteresis];
            let stays = region.needed + hysteresis(region, finest, cell_ticks, times);
            let goes = tick > stays || self.is_too_fine(region);
            let wanted = region.wanted && !goes;
            self.change(index, wanted, entries);
            let region = self.cache.regions.at(index);
            if region.wanted || region.changing > 0 {
                k += 1;
            } else {
                self.wanted.swap_remove(k);
            }
        }
        for k in 0..self.predictions.arrivals.len() {
            let index = self.predictions.arrivals[k];
            // It may have been released since to make room.
            let to_come = self.cache.regions.get(index).is_some_and(|region| {
                region.is_resident() && !region.wanted && region.changing == 0
            });
            if !to_come {
                continue;
            }
            if *entries == 0 || self.wanted.len() == MAX_WANTED {
                break;
            }
            self.change(index, true, entries);
            self.wanted.push(index);
        }
        self.predictions.arrivals.clear();
        let wanted = self.wanted.len();
        self.wanted_high_water = self.wanted_high_water.max(wanted);
    }

    /// Takes a resident region into the wanted set or out of it, as far as the entries allow.
    fn change(&mut self, index: usize, wanted: bool, entries: &mut u32) {
        if *entries == 0 {
            return;
        }
        let changed = self
            .cache
            .set_wanted(index, wanted, *entries * CHANGES_PER_UNIT);
        *entries -= changed.div_ceil(CHANGES_PER_UNIT);
    }
}

#[cfg(test)]
mod tests;
