//! Two-phase refinement (thesis Figure 5.17): splits in B \ A, collapses in A \ B, what the contact needs
//! first, at most K operations a tick.

use super::Controller;
use crate::cache::{Cache, RegionState};
use crate::predict::Predicted;
use crate::proxy::Proxy;
use crate::tick_record::CoreRecord;
use shared::spm::OperationFaces;

/// Regions that may be wanted at once.
const MOST_WANTED: usize = 256;
/// Regions that may be kept to be asked for in a tick.
const MOST_UNKNOWN: usize = 64;
/// Ticks for which a region stays wanted after the prediction left it: no flicker at a cell's wall.
const LINGER: u64 = 40;
/// Splits, and collapses, a tick where nothing is urgent.
const PACE: u32 = 6;
/// Ticks of motion within which a region is urgent.
const CLOSE_TICKS: f64 = 6.0;
/// Closure entries gone through a tick, for each operation allowed.
const ENTRIES_PER_OPERATION: u32 = 24;
/// Places of the region table that one search for a region to release looks at.
const WINDOW: usize = 64;
/// Ticks without prefetch, and without any question, after the cache was found full.
const FULL_PREFETCH: u64 = 1000;
const FULL_ASK: u64 = 20;

/// The most work units that refinement may take a tick: closure entries gone through (four that change
/// set count as one) and operations. The last region that comes in, and the last that goes out, may
/// overdraw by a closure.
#[must_use]
pub fn budget(operations: usize, closure_max: u32) -> u32 {
    let k = operations as u32;
    k * (ENTRIES_PER_OPERATION + 1) + 2 * change_cost(closure_max)
}

/// Work units of taking a closure of this length into the wanted set, or out of it.
fn change_cost(entries: u32) -> u32 {
    entries / 4 + 1
}

/// The set B.
#[derive(Debug, Clone)]
pub struct Refinement {
    /// Indices of wanted regions.
    wanted: Vec<usize>,
    /// Indices of held regions to come into it in this tick.
    order: Vec<usize>,
    /// Predicted regions that are not in the table.
    unknown: Vec<Predicted>,
    faces: OperationFaces,
    full_at: Option<u64>,
    /// Where in the region table the search for a region to release goes on.
    hand: usize,
}

impl Refinement {
    /// Nothing wanted.
    #[must_use]
    pub fn new() -> Self {
        Self {
            wanted: Vec::with_capacity(MOST_WANTED),
            order: Vec::with_capacity(MOST_WANTED),
            unknown: Vec::with_capacity(MOST_UNKNOWN),
            faces: OperationFaces::new(),
            full_at: None,
            hand: 0,
        }
    }

    /// Empties the sets of the tick before.
    pub fn begin(&mut self) {
        self.order.clear();
        self.unknown.clear();
    }

    /// Marks a predicted region in the table, or keeps it to be asked for.
    pub fn note(&mut self, p: Predicted, tick: u64, cache: &mut Cache) {
        let Some(index) = cache.regions.index(p.id) else {
            if self.unknown.len() < self.unknown.capacity()
                && self.unknown.iter().all(|known| known.id != p.id)
            {
                self.unknown.push(p);
            }
            return;
        };
        let region = cache.regions.at_mut(index);
        region.touched = tick;
        region.distance = p.distance;
        if p.refine {
            region.needed = tick;
            let to_come = region.state == RegionState::Held && !region.wanted;
            if to_come && self.order.len() < MOST_WANTED {
                self.order.push(index);
            }
        }
    }

    /// Regions to ask for: those to refine first, nearest first.
    pub fn unknown(&mut self) -> &[Predicted] {
        self.unknown.sort_unstable_by(|a, b| {
            a.refine
                .cmp(&b.refine)
                .reverse()
                .then(a.distance.total_cmp(&b.distance))
                .then(a.id.cmp(&b.id))
        });
        &self.unknown
    }

    /// The cache was found full.
    pub fn starved(&mut self, tick: u64) {
        self.full_at = Some(tick);
    }

    /// Whether regions may be loaded ahead of need.
    #[must_use]
    pub fn may_prefetch(&self, tick: u64) -> bool {
        self.full_at.is_none_or(|full| tick > full + FULL_PREFETCH)
    }

    /// Whether regions may be asked for at all.
    #[must_use]
    pub fn may_ask(&self, tick: u64) -> bool {
        self.full_at.is_none_or(|full| tick > full + FULL_ASK)
    }
}

impl Controller {
    /// Splits, then collapses with what is left of the tick's operations.
    ///
    /// What lies close to the probe may take all of them; the rest keeps a pace, so that ticks are even.
    pub(super) fn refine(&mut self, tick: u64, left: &mut u32, record: &mut CoreRecord) {
        let close = self.close_distance();
        let mut entries = self.operations as u32 * ENTRIES_PER_OPERATION;
        let spent = self.choose(tick, &mut entries);
        let allowed = entries;
        // Collapses come first only when the records that wait need their room; see `make_room`.
        for k in 0..self.refinement.wanted.len() {
            let region = self.refinement.wanted[k];
            while *left > 0 && entries > 0 {
                let entry = self.cache.regions.at(region);
                let paced = entry.distance > close && record.vsplits >= PACE;
                if entry.refined || paced {
                    break;
                }
                let Some(slot) = self.cache.next_split(region, &mut entries) else {
                    break;
                };
                match self.cache.split(slot, &mut self.refinement.faces) {
                    Ok(()) => {
                        *left -= 1;
                        record.vsplits += 1;
                    }
                    Err(_) => {
                        // The rest of the closure may depend on it: the region stays as it is.
                        self.refuse(region);
                        break;
                    }
                }
            }
        }
        let cache = &self.cache;
        self.refinement
            .wanted
            .retain(|&region| cache.regions.get(region).is_some_and(|r| r.wanted));
        record.work_units += spent + allowed - entries + record.vsplits;
        let collapses = if record.vsplits > PACE { 0 } else { PACE };
        while *left > 0
            && record.ecols < collapses
            && self.cache.collapse_oldest(&mut self.refinement.faces)
        {
            *left -= 1;
            record.ecols += 1;
        }
        record.work_units += record.ecols;
        if self.cache.is_nearly_full() {
            self.release_one(None, tick);
        }
    }

    /// Distance from the probe within which refinement is urgent, model units.
    fn close_distance(&self) -> f64 {
        let (velocity, _) = self.predictor.motion();
        let radius = self.proxy.as_ref().map_or(0.0, Proxy::radius);
        1.2 * radius + CLOSE_TICKS * velocity.length()
    }

    /// Brings the wanted set up to date: near regions in, regions left long enough out. The work units spent.
    fn choose(&mut self, tick: u64, entries: &mut u32) -> u32 {
        let mut spent = 0;
        let mut k = 0;
        while k < self.refinement.wanted.len() {
            let index = self.refinement.wanted[k];
            let region = self.cache.regions.at(index);
            if *entries > 0 && tick > region.needed + LINGER {
                let cost = change_cost(self.cache.set_wanted(index, false));
                *entries = entries.saturating_sub(cost);
                spent += cost;
                self.refinement.wanted.swap_remove(k);
            } else {
                k += 1;
            }
        }
        for k in 0..self.refinement.order.len() {
            let index = self.refinement.order[k];
            let region = self.cache.regions.at(index);
            if region.wanted || region.state != RegionState::Held {
                continue;
            }
            if *entries == 0 || self.refinement.wanted.len() == MOST_WANTED {
                break;
            }
            let cost = change_cost(self.cache.set_wanted(index, true));
            *entries = entries.saturating_sub(cost);
            spent += cost;
            self.refinement.wanted.push(index);
        }
        // Nearest first; the order of equal distances follows the table, so it repeats.
        let regions = &self.cache.regions;
        self.refinement.wanted.sort_unstable_by(|&a, &b| {
            let key = |k: usize| regions.at(k).distance;
            key(a).total_cmp(&key(b)).then(a.cmp(&b))
        });
        spent
    }

    /// Makes a slot free: a waiting collapse, or the region whose turn it is to go. Whether one is free now.
    ///
    /// Never takes what a wanted region or the contact's own cells need.
    pub(super) fn make_room(
        &mut self,
        asking: usize,
        tick: u64,
        left: &mut u32,
        record: &mut CoreRecord,
    ) -> bool {
        loop {
            if self.cache.has_slot() {
                return true;
            }
            if *left > 0 && self.cache.collapse_oldest(&mut self.refinement.faces) {
                *left -= 1;
                record.ecols += 1;
                continue;
            }
            let distance = self.cache.regions.at(asking).distance;
            if *left == 0 || !self.release_one(Some(distance), tick) {
                return false;
            }
            *left -= 1;
        }
    }

    /// Releases a held region: of the next [`WINDOW`] in the table the one that was not predicted for longest;
    /// failing that, if a region at `asking` distance needs the room, one farther away that is only loaded
    /// ahead. Looking at a window keeps the cost of a tick bounded, whatever the table holds.
    fn release_one(&mut self, asking: Option<f64>, tick: u64) -> bool {
        if !self.subscriber.may_release() {
            return false;
        }
        let capacity = self.cache.regions.capacity();
        let mut victim: Option<(usize, bool, u64, f64)> = None;
        for _ in 0..WINDOW.min(capacity) {
            let index = self.refinement.hand;
            self.refinement.hand = (index + 1) % capacity;
            let Some(region) = self.cache.regions.get(index) else {
                continue;
            };
            let needed = region.needed + LINGER >= tick;
            if region.state != RegionState::Held || region.wanted || needed {
                continue;
            }
            let predicted = region.touched + LINGER >= tick;
            if predicted && asking.is_none_or(|distance| region.distance <= distance) {
                continue;
            }
            let better = victim.is_none_or(|(_, was_predicted, touched, distance)| {
                match (predicted, was_predicted) {
                    (false, true) => true,
                    (true, false) => false,
                    (false, false) => region.touched < touched,
                    (true, true) => region.distance > distance,
                }
            });
            if better {
                victim = Some((index, predicted, region.touched, region.distance));
            }
        }
        let Some((index, ..)) = victim else {
            return false;
        };
        self.cache.let_go(index);
        self.cache.regions.at_mut(index).state = RegionState::ToRelease;
        self.subscriber.release(index);
        true
    }
}
