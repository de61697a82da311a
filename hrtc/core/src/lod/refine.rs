//! Two-phase refinement (thesis Figure 5.17): splits in B \ A, collapses in A \ B, what the contact reaches
//! first, at most K operations a tick.

use crate::active::object::{ActiveObject, Budget};
use crate::cache::{Cache, Region, RegionState};
use crate::contact::rigid_proxy::MAX_BALLS;
use crate::lod::geomorph::{Collapsed, Transition};
use crate::lod::lod_controller::MemoryPressure;
use crate::lod::predict::{Predicted, TURNS};
use crate::perception::PerceptionLimit;
use spm::{DamagedRecord, OperationFaces, RegionId, Slot};

/// Regions that may be wanted at once.
pub const MAX_WANTED: usize = 512;
/// Regions that may be kept to be asked for in a tick, for each probe: the cells of six balls.
const MAX_UNKNOWN: usize = 750;
/// Ticks for which a region stays wanted after the prediction left it: no flicker at a cell's wall.
const LINGER: u64 = 40;
/// Splits, and collapses, a tick where nothing is urgent.
const PACE: u32 = 6;
/// Ticks after which a backlog of collapses is to be worked off.
const COLLAPSE_TICKS: u32 = 48;
/// Closure entries that change set for one work unit.
pub const CHANGES_PER_UNIT: u32 = 4;
/// Closure entries that are let go of a tick at the most: several cells, or a stretch of a whole model.
pub const LEAVING_A_TICK: u32 = 4096;
/// Closure entries gone through a tick, for each operation allowed.
pub const ENTRIES_PER_OPERATION: u32 = 24;
/// Regions that one search for a region to release looks at.
const WINDOW: usize = 64;
/// Regions released a tick at the most, where nothing waits for their room.
const RELEASES: u32 = 4;
/// Share of a tick's closure entries for what lies behind splits that wait: one in so many.
const BEYOND: u32 = 4;
/// Closure entries that cost as much as finding that a split has to wait.
const ENTRIES_PER_WAIT: u32 = 16;

/// The most work units that refinement may take a tick: closure entries gone through (four that change
/// set, or are let go of, count as one) and operations. A closure that is longer, as that of a whole model,
/// takes several ticks.
#[must_use]
pub fn budget(operations: usize) -> u32 {
    operations as u32 * (ENTRIES_PER_OPERATION + 1) + LEAVING_A_TICK / CHANGES_PER_UNIT
}

/// The set B.
#[derive(Debug, Clone)]
pub struct Refinement {
    /// Indices of wanted regions.
    wanted: Vec<usize>,
    /// Those of them that are still to be refined: what is due first comes first, see [`order_of`].
    queue: Vec<u64>,
    /// Indices of held regions to come into it in this tick.
    order: Vec<usize>,
    /// Predicted regions that are not in the table.
    unknown: Vec<Predicted>,
    pub(crate) faces: OperationFaces,
    /// Those around the other vertex of a pair in flight.
    pub(crate) faces_of_sibling: OperationFaces,
    /// What each touch feels, with its index.
    pub(crate) feelers: Vec<(usize, PerceptionLimit)>,
    /// Those of them that a split, collapse or flight may reach.
    pub(crate) reached: Vec<(usize, PerceptionLimit)>,
    /// The share of what each touch allows in this tick that is used up so far.
    pub(crate) used: Vec<f64>,
    /// What is done without for want of room.
    pub(crate) economy: MemoryPressure,
    /// A region that is let go of in several ticks.
    leaving: Option<usize>,
    wanted_high_water: usize,
    unknown_high_water: usize,
}

impl Refinement {
    /// Nothing wanted by so many probes.
    #[must_use]
    pub fn new(probes: usize) -> Self {
        Self {
            wanted: Vec::with_capacity(MAX_WANTED),
            queue: Vec::with_capacity(MAX_WANTED),
            order: Vec::with_capacity(MAX_WANTED),
            unknown: Vec::with_capacity(MAX_UNKNOWN * probes),
            faces: OperationFaces::new(),
            faces_of_sibling: OperationFaces::new(),
            feelers: Vec::with_capacity(probes * MAX_BALLS),
            reached: Vec::with_capacity(probes * MAX_BALLS),
            used: Vec::with_capacity(probes),
            economy: MemoryPressure::new(),
            leaving: None,
            wanted_high_water: 0,
            unknown_high_water: 0,
        }
    }

    /// Forgets everything but its high-water marks: another object comes.
    pub fn reset(&mut self) {
        self.wanted.clear();
        self.queue.clear();
        self.order.clear();
        self.unknown.clear();
        self.feelers.clear();
        self.economy = MemoryPressure::new();
        self.leaving = None;
    }

    /// Empties the predictions of the tick before.
    pub fn begin(&mut self) {
        self.unknown.clear();
    }

    /// A region that was asked for is held now: if it is needed it need not wait for the next prediction of it.
    pub fn arrived(&mut self, index: usize, tick: u64, cache: &Cache) {
        let needed = cache.regions.at(index).needed;
        // 0 is never: it was only loaded ahead.
        if needed > 0 && tick <= needed + TURNS as u64 && self.order.len() < MAX_WANTED {
            self.order.push(index);
        }
    }

    /// Marks a predicted region in the table, or keeps it to be asked for.
    pub fn note(&mut self, p: Predicted, tick: u64, cache: &mut Cache) {
        let Some(index) = cache.regions.index(p.key) else {
            // For each probe a tick looks at one ball of each of two rings, and at four of a tool. What comes twice is
            // asked for once.
            if self.unknown.len() < self.unknown.capacity() {
                self.unknown.push(p);
                self.unknown_high_water = self.unknown_high_water.max(self.unknown.len());
            }
            return;
        };
        cache.regions.touch(index, tick);
        let region = cache.regions.at_mut(index);
        region.due = due(tick, p.ticks);
        if p.refine {
            region.needed = tick;
            let to_come = region.state == RegionState::Held && !region.wanted;
            if to_come && self.order.len() < MAX_WANTED {
                self.order.push(index);
            }
        }
    }

    /// Regions to ask for: those to refine first, those due first, of these the coarser first.
    pub fn unknown(&mut self) -> &[Predicted] {
        self.unknown.sort_unstable_by(|a, b| {
            a.refine
                .cmp(&b.refine)
                .reverse()
                .then(a.ticks.total_cmp(&b.ticks))
                .then(a.key.tolerance_bits.cmp(&b.key.tolerance_bits).reverse())
                .then(a.key.cmp(&b.key))
        });
        &self.unknown
    }

    /// The cache was found full.
    pub fn starved(&mut self, tick: u64) {
        self.economy.starve(tick);
    }

    /// The most regions wanted, and kept to be asked for, at once.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.wanted_high_water, MAX_WANTED),
            (self.unknown_high_water, self.unknown.capacity()),
        ]
    }
}

/// The tick at which something is due.
pub fn due(tick: u64, ticks: f64) -> u64 {
    // `as` saturates: what is never due is due at the end of time.
    tick.saturating_add(ticks as u64)
}

/// Ticks for which a region stays wanted after the prediction left it: of the finest ring, what the probe takes
/// over a cell, so that the trail of a fast one is no longer.
fn linger(region: &Region, finest: f32, cell_ticks: f64) -> u64 {
    let is_finest = region.key.tolerance().is_some_and(|t| t <= finest);
    let least = TURNS as u64 + 4;
    if is_finest {
        (cell_ticks as u64).clamp(least, LINGER)
    } else {
        LINGER
    }
}

/// Whether a region's prediction is as new as it can be: the coarser rings are looked at less often.
fn is_current(region: &Region, finest: f32, tick: u64) -> bool {
    let turns = TURNS as u64 + 2;
    let is_finest = region.key.tolerance().is_none_or(|t| t <= finest);
    tick <= region.needed + if is_finest { turns } else { 3 * turns }
}

/// The place of a region among those to be refined, as a number that sorts: what the prediction has left comes
/// last, what is due first comes first, of these the coarser: it bounds the error sooner. The index at the end
/// makes it unique.
fn order_of(region: &Region, index: usize, finest: f32, tick: u64) -> u64 {
    let left = u64::from(!is_current(region, finest, tick));
    let ticks = region.due.saturating_sub(tick).min((1 << 30) - 1);
    let finer = u64::from(!region.key.tolerance_bits >> 16);
    left << 63 | ticks << 32 | finer << 16 | index as u64
}

impl ActiveObject {
    /// Splits, then collapses with what is left of the tick's operations.
    ///
    /// As many splits as it takes to have every region done when it is due, and at least a pace, so that ticks
    /// are even.
    pub(crate) fn refine(&mut self, tick: u64, budget: &mut Budget) {
        let spent = self.choose(tick, &mut budget.entries);
        self.fly(tick, budget);
        let allowed_entries = budget.entries;
        let allowed = self
            .splits_due(tick)
            .clamp(PACE, budget.operations.max(PACE));
        let mut beyond = budget.entries / BEYOND;
        // Collapses come first only when the records that wait need their room; see `make_room`.
        for k in 0..self.refinement.queue.len() {
            let region = (self.refinement.queue[k] & 0xFFFF) as usize;
            while budget.operations > 0 && budget.entries > 0 && self.tally.vsplits < allowed {
                let Some(slot) = self.cache.next_split(region, &mut budget.entries) else {
                    break;
                };
                let manner = self.manner_of_split(slot);
                if matches!(manner, Transition::Deferred | Transition::Rejected) {
                    self.cache.postpone_split(region);
                    budget.entries = budget.entries.saturating_sub(ENTRIES_PER_WAIT);
                    self.split_beyond(region, &mut beyond, budget);
                    break;
                }
                if self.split(slot, manner, budget).is_err() {
                    // The rest of the closure may depend on it: the region stays as it is.
                    self.refuse(region, tick);
                    break;
                }
            }
        }
        let cache = &self.cache;
        self.refinement.wanted.retain(|&region| {
            cache
                .regions
                .get(region)
                .is_some_and(|r| r.wanted || r.changing > 0)
        });
        self.tally.work_units += spent + allowed_entries - budget.entries + self.tally.vsplits;
        let backlog = self.cache.to_collapse() / COLLAPSE_TICKS;
        let quiet = if self.tally.vsplits > PACE { 0 } else { PACE };
        for _ in 0..backlog.max(quiet).min(budget.operations) {
            if self.collapse_oldest() == Collapsed::None {
                break;
            }
            budget.operations -= 1;
        }
        self.go_on_leaving(budget);
        for _ in 0..RELEASES {
            if !self.cache.is_nearly_full() || !self.release_one(None, tick, budget) {
                break;
            }
        }
    }

    /// Performs a split.
    fn split(
        &mut self,
        slot: Slot,
        manner: Transition,
        budget: &mut Budget,
    ) -> Result<(), DamagedRecord> {
        self.cache.split(slot, &mut self.refinement.faces)?;
        if manner == Transition::Geomorph {
            self.cache.take_off(&self.refinement.faces);
        }
        self.carry_proxies();
        if manner == Transition::Geomorph {
            self.land_at_once();
        }
        budget.operations -= 1;
        self.tally.vsplits += 1;
        Ok(())
    }

    /// Where the next split of a region has to wait, those behind it need not: they are felt no more than others.
    /// `entries` is how many may be gone through for that in this tick.
    fn split_beyond(&mut self, region: usize, entries: &mut u32, budget: &mut Budget) {
        let before = *entries;
        let mut place = None;
        while budget.operations > 0 {
            let Some(slot) = self.cache.split_beyond(region, &mut place, entries) else {
                break;
            };
            let manner = self.manner_of_split(slot);
            if matches!(manner, Transition::Deferred | Transition::Rejected) {
                *entries = entries.saturating_sub(ENTRIES_PER_WAIT);
            } else if self.split(slot, manner, budget).is_err() {
                // A damaged one is found when its turn comes.
                break;
            }
        }
        budget.entries = budget.entries.saturating_sub(before - *entries);
    }

    /// Takes the proxies along with the operation that was just performed.
    pub(crate) fn carry_proxies(&mut self) {
        for touch in &mut self.touches {
            let operation = &self.refinement.faces;
            touch.follower.carry(self.cache.mesh(), operation);
        }
    }

    /// Puts what is to be refined in order; the splits that this tick must do for every region to be done in
    /// time.
    fn splits_due(&mut self, tick: u64) -> u32 {
        let finest = self.finest_tolerance();
        let Refinement { wanted, queue, .. } = &mut self.refinement;
        queue.clear();
        for &index in wanted.iter() {
            let region = self.cache.regions.at(index);
            if region.wanted && region.changing == 0 && !region.refined {
                queue.push(order_of(region, index, finest, tick));
            }
        }
        queue.sort_unstable();
        let (mut sum, mut most) = (0u64, 0u64);
        for &order in queue.iter().take_while(|&&order| order >> 63 == 0) {
            let region = self.cache.regions.at((order & 0xFFFF) as usize);
            let ticks = order >> 32;
            sum += u64::from(region.to_split);
            // Done when three quarters of the time are over: estimates are estimates.
            most = most.max(4 * sum / (3 * ticks + 1));
        }
        u32::try_from(most).unwrap_or(u32::MAX)
    }

    /// Brings the wanted set up to date: near regions in, regions left long enough, or finer than there is room
    /// or time for, out. The work units spent.
    fn choose(&mut self, tick: u64, entries: &mut u32) -> u32 {
        let mut spent = 0;
        let mut k = 0;
        let finest = self.finest_tolerance();
        let cell_ticks = self.cell_ticks();
        while k < self.refinement.wanted.len() {
            let index = self.refinement.wanted[k];
            let region = self.cache.regions.at(index);
            let stays = region.needed + linger(region, finest, cell_ticks);
            let goes = tick > stays || self.is_too_fine(region);
            let wanted = region.wanted && !goes;
            spent += self.change(index, wanted, entries);
            let region = self.cache.regions.at(index);
            if region.wanted || region.changing > 0 {
                k += 1;
            } else {
                self.refinement.wanted.swap_remove(k);
            }
        }
        for k in 0..self.refinement.order.len() {
            let index = self.refinement.order[k];
            // What arrived may have been released again to make room.
            let to_come = self.cache.regions.get(index).is_some_and(|region| {
                region.state == RegionState::Held && !region.wanted && region.changing == 0
            });
            if !to_come {
                continue;
            }
            if *entries == 0 || self.refinement.wanted.len() == MAX_WANTED {
                break;
            }
            spent += self.change(index, true, entries);
            self.refinement.wanted.push(index);
        }
        self.refinement.order.clear();
        let wanted = self.refinement.wanted.len();
        self.refinement.wanted_high_water = self.refinement.wanted_high_water.max(wanted);
        spent
    }

    /// Takes a held region into the wanted set or out of it, as far as the entries allow. The work units spent.
    fn change(&mut self, index: usize, wanted: bool, entries: &mut u32) -> u32 {
        if *entries == 0 {
            return 0;
        }
        let most = *entries * CHANGES_PER_UNIT;
        let gone_through = self.cache.set_wanted(index, wanted, most);
        let cost = gone_through.div_ceil(CHANGES_PER_UNIT);
        *entries -= cost;
        cost
    }

    /// Lets go of a region, a stretch a tick; then the station is told. Only one at a time, see `may_leave`.
    pub(crate) fn leave(&mut self, index: usize, budget: &mut Budget) {
        self.refinement.leaving = Some(index);
        self.go_on_leaving(budget);
    }

    /// Whether another region may be let go of now: its closure is gone through entry by entry.
    pub(crate) fn may_leave(&self, budget: &Budget) -> bool {
        budget.leaving > 0 && self.subscriber.may_release() && !self.is_leaving()
    }

    /// Whether a region is still being let go of.
    pub(crate) fn is_leaving(&self) -> bool {
        self.refinement.leaving.is_some()
    }

    fn go_on_leaving(&mut self, budget: &mut Budget) {
        let Some(index) = self.refinement.leaving else {
            return;
        };
        if !self.subscriber.may_release() || budget.leaving == 0 {
            return;
        }
        let (gone, entries) = self.cache.let_go(index, budget.leaving);
        budget.leaving -= entries;
        if gone {
            self.cache.regions.at_mut(index).state = RegionState::ToRelease;
            self.subscriber.release(index);
            self.refinement.leaving = None;
        }
    }

    /// Whether a region is finer than what is asked for now: it only takes up room.
    fn is_too_fine(&self, region: &Region) -> bool {
        let special = [RegionId::WHOLE, RegionId::PREFIX].contains(&region.key.id);
        let finest = self.finest_tolerance();
        !special && region.key.tolerance().is_some_and(|t| t < finest)
    }

    /// Makes a slot free: a waiting collapse, or the region whose turn it is to go. Whether one is free now.
    ///
    /// Never takes what a wanted region or the contact's own cells need.
    pub(crate) fn make_room(&mut self, asking: usize, tick: u64, budget: &mut Budget) -> bool {
        loop {
            if self.cache.has_slot() {
                return true;
            }
            if budget.operations > 0 {
                let collapsed = self.collapse_oldest();
                budget.operations -= u32::from(collapsed != Collapsed::None);
                if collapsed == Collapsed::Done {
                    continue;
                }
            }
            let due = self.cache.regions.at(asking).due;
            if budget.operations == 0 || !self.release_one(Some(due), tick, budget) {
                return false;
            }
            budget.operations -= 1;
        }
    }

    /// Releases a held region: of the [`WINDOW`] used least recently the first that is not predicted any more, or
    /// is finer than there is room for; failing that, if a region that is due at `asking` needs the room, of those
    /// that are only loaded ahead the one that is due last. Looking at a window keeps the cost of a tick bounded,
    /// whatever the table holds.
    fn release_one(&mut self, asking: Option<u64>, tick: u64, budget: &mut Budget) -> bool {
        if !self.may_leave(budget) {
            return false;
        }
        let mut victim: Option<(usize, u64)> = None;
        let mut next = self.cache.regions.oldest();
        for _ in 0..WINDOW {
            let Some(index) = next else {
                break;
            };
            next = self.cache.regions.next_older(index);
            let region = self.cache.regions.at(index);
            if region.state == RegionState::Refused {
                // It holds nothing: out of the window's way.
                let touched = region.touched;
                self.cache.regions.touch(index, touched);
                continue;
            }
            let at_rest = !region.wanted && region.changing == 0;
            if region.state != RegionState::Held || !at_rest {
                continue;
            }
            if self.is_too_fine(region) || region.touched + LINGER < tick {
                victim = Some((index, region.due));
                break;
            }
            let ahead = region.needed + LINGER < tick && asking.is_some_and(|due| region.due > due);
            if ahead && victim.is_none_or(|(_, due)| region.due > due) {
                victim = Some((index, region.due));
            }
        }
        let Some((index, _)) = victim else {
            return false;
        };
        self.leave(index, budget);
        true
    }
}
