//! Regions that the predictions of a tick name.

use super::predict::{Predicted, TURNS};
use crate::cache::Cache;
use crate::tuning::lod::MAX_WANTED;
use crate::tuning::prediction::MAX_UNKNOWN;

/// Regions that the predictions of a tick named.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Predictions {
    /// Indices of resident regions that become wanted in this tick.
    pub(super) arrivals: Vec<usize>,
    /// Regions that are not in the table.
    #[serde(with = "spm::reserved")]
    pub(super) unknown: Vec<Predicted>,
    unknown_high_water: usize,
}

impl Predictions {
    /// None, with room for those of so many probes.
    #[must_use]
    pub fn new(probes: usize) -> Self {
        Self {
            arrivals: Vec::with_capacity(MAX_WANTED),
            unknown: Vec::with_capacity(MAX_UNKNOWN * probes),
            unknown_high_water: 0,
        }
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.arrivals.clear();
        self.unknown.clear();
    }

    /// Regions kept to be requested at once, at the most, and how many there may be.
    #[must_use]
    pub fn high_water(&self) -> (usize, usize) {
        (self.unknown_high_water, self.unknown.capacity())
    }

    /// The answer to a region is complete: if the region is needed it need not wait for its next
    /// prediction.
    pub fn region_arrived(&mut self, index: usize, tick: u64, cache: &Cache) {
        let needed = cache.regions.at(index).needed;
        // 0 is never: it was only loaded ahead.
        if needed > 0 && tick <= needed + TURNS as u64 && self.arrivals.len() < MAX_WANTED {
            self.arrivals.push(index);
        }
    }

    /// Marks a predicted region in the table, or keeps it to be requested.
    pub(super) fn note(&mut self, p: Predicted, tick: u64, cache: &mut Cache) {
        let Some(index) = cache.regions.index(p.key) else {
            // For each probe a tick looks at one ball of each of two rings, and at four of a tool.
            // A region that comes twice is requested once.
            if self.unknown.len() < self.unknown.capacity() {
                self.unknown.push(p);
                self.unknown_high_water = self.unknown_high_water.max(self.unknown.len());
            }
            return;
        };
        cache.regions.mark_used(index, tick);
        let region = cache.regions.at_mut(index);
        region.due = due(tick, p.ticks);
        if p.refine {
            region.needed = tick;
            let is_new = region.is_resident() && !region.wanted;
            if is_new && self.arrivals.len() < MAX_WANTED {
                self.arrivals.push(index);
            }
        }
    }

    /// Regions to request: those to refine first, those due first, of these the coarser first.
    pub(super) fn unknown(&mut self) -> &[Predicted] {
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
}

/// The tick at which a region that is due in some ticks is due.
pub(super) fn due(tick: u64, ticks: f64) -> u64 {
    // `as` saturates: a region that is never due is due at the end of time.
    tick.saturating_add(ticks as u64)
}
