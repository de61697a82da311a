//! Regions that the predictions name.

use super::predict::{ALL_TURNS, Predicted, TURNS};
use crate::cache::{Cache, RegionKey};
use crate::tuning::lod::MAX_WANTED;
use crate::tuning::prediction::MAX_UNKNOWN;
use protocol::REGIONS_PER_REQUEST;
use std::cmp::Ordering;

/// A predicted region that is not in the table.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Unknown {
    /// The region.
    pub key: RegionKey,
    /// Tick at which the contact may be in its cell.
    pub due: f64,
    /// Tick at which the contact has left its cell.
    pub leaves: f64,
    /// Whether it is to be performed, not only loaded.
    pub is_needed: bool,
    /// Tick when it was predicted.
    pub(crate) predicted: u64,
}

impl Unknown {
    /// Those to refine first, those due first, of these the coarser first.
    fn by_urgency(&self, other: &Self) -> Ordering {
        let [own, others] = [self, other].map(|of| of.key.tolerance_bits);
        other
            .is_needed
            .cmp(&self.is_needed)
            .then(self.due.total_cmp(&other.due))
            .then(others.cmp(&own))
            .then(self.key.cmp(&other.key))
    }
}

/// Predicted regions, the most urgent first. They are put in order as far as they are looked at:
/// most requests need few of them, and most ticks make none.
#[derive(Debug)]
pub(super) struct ByUrgency<'a> {
    all: &'a mut [Unknown],
    /// Of these, from the first on, given, and in order.
    given: usize,
    ordered: usize,
    /// Put in order at once the next time.
    part: usize,
}

impl<'a> ByUrgency<'a> {
    fn new(all: &'a mut [Unknown]) -> Self {
        Self {
            all,
            given: 0,
            ordered: 0,
            part: REGIONS_PER_REQUEST,
        }
    }

    /// Puts the next part in order. Parts double, so that all of them cost about as much as one
    /// sort.
    fn order_next(&mut self) {
        let rest = &mut self.all[self.ordered..];
        let part = self.part.min(rest.len());
        if part < rest.len() {
            rest.select_nth_unstable_by(part, Unknown::by_urgency);
        }
        rest[..part].sort_unstable_by(Unknown::by_urgency);
        self.ordered += part;
        self.part = self.part.saturating_mul(2);
    }
}

impl Iterator for ByUrgency<'_> {
    type Item = Unknown;

    fn next(&mut self) -> Option<Unknown> {
        if self.given == self.ordered {
            self.order_next();
        }
        let next = self.all[..self.ordered].get(self.given).copied();
        self.given += usize::from(next.is_some());
        next
    }
}

/// Regions that the predictions named: in a tick, and in those since the last questions.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Predictions {
    /// Indices of resident regions that become wanted in this tick.
    pub(super) arrivals: Vec<usize>,
    /// Regions that are not in the table.
    #[serde(with = "spm::reserved")]
    unknown: Vec<Unknown>,
    unknown_high_water: usize,
    /// The place of them that the next one takes where no other is free. The last ones were noted
    /// just now: after one that was free it begins at the first.
    next_place: usize,
    /// Ticks of a round of the finest ring, and of all rings.
    rounds: [u64; 2],
}

impl Predictions {
    /// None, with room for those of so many probes; `looks`: of each probe in a tick.
    #[must_use]
    pub fn new(probes: usize, looks: usize) -> Self {
        Self {
            arrivals: Vec::with_capacity(MAX_WANTED),
            unknown: Vec::with_capacity(MAX_UNKNOWN * probes),
            unknown_high_water: 0,
            next_place: 0,
            rounds: [TURNS as u64, ALL_TURNS].map(|turns| turns.div_ceil(looks as u64)),
        }
    }

    /// Ticks of a round of the finest ring.
    pub(super) fn round(&self) -> u64 {
        self.rounds[0]
    }

    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.arrivals.clear();
        self.unknown.clear();
    }

    /// Keeps the regions to be requested of the latest so many ticks, up to a round, and no others:
    /// where questions are rare, the next ones are to see more than the turns of one tick.
    pub(super) fn keep_latest(&mut self, tick: u64, ticks: u64) {
        let kept = ticks.min(self.rounds[1]);
        self.unknown.retain(|of| tick < of.predicted + kept);
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
        if needed > 0 && tick <= needed + self.round() && self.arrivals.len() < MAX_WANTED {
            self.arrivals.push(index);
        }
    }

    /// Marks a predicted region in the table, or keeps it to be requested.
    pub(super) fn note(&mut self, p: Predicted, tick: u64, cache: &mut Cache) {
        let Some(index) = cache.regions.index(p.key) else {
            // For each probe a look goes to one ball of each of two rings, or to three under a wide
            // one, and in a tick four go to those of a tool.
            // A region that comes twice is requested once; one that finds no room comes again.
            self.keep(Unknown {
                key: p.key,
                due: tick as f64 + p.ticks,
                leaves: tick as f64 + p.leaves,
                is_needed: p.refine,
                predicted: tick,
            });
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

    /// Keeps a region to be requested. Where there is no room it takes the place of another one,
    /// each in its turn: where a hand goes now counts more than where it was going.
    fn keep(&mut self, unknown: Unknown) {
        if self.unknown.len() < self.unknown.capacity() {
            self.unknown.push(unknown);
            self.next_place = 0;
            self.unknown_high_water = self.unknown_high_water.max(self.unknown.len());
            return;
        }
        if let Some(place) = self.unknown.get_mut(self.next_place) {
            *place = unknown;
        }
        self.next_place = (self.next_place + 1) % self.unknown.len().max(1);
    }

    /// Regions to request, the most urgent first; none where none `may_be` requested.
    pub(super) fn unknown(&mut self, may_be: bool) -> ByUrgency<'_> {
        let count = if may_be { self.unknown.len() } else { 0 };
        ByUrgency::new(&mut self.unknown[..count])
    }
}

/// The tick at which a region that is due in some ticks is due.
fn due(tick: u64, ticks: f64) -> u64 {
    // `as` saturates: a region that is never due is due at the end of time.
    tick.saturating_add(ticks as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_questions_are_rare_those_of_a_round_are_kept_and_what_is_needed_comes_first() {
        let mut cache = Cache::new(1 << 20);
        let mut after = |between: u64, looks: usize| {
            let mut predictions = Predictions::new(1, looks);
            for tick in 0..2 * ALL_TURNS {
                predictions.keep_latest(tick, between);
                let predicted = Predicted {
                    key: RegionKey::prefix(tick as u32),
                    ticks: 5.0,
                    leaves: 9.0,
                    refine: tick % 2 == 0,
                };
                predictions.note(predicted, tick, &mut cache);
            }
            predictions.unknown(true).collect::<Vec<_>>()
        };
        // A local link is asked in every tick.
        for between in [0, 1] {
            assert_eq!(after(between, 1).len(), 1);
        }
        assert_eq!(after(7, 1).len(), 7);
        // With more looks in a tick a round takes fewer ticks.
        for (looks, ticks) in [(4, 8), (10, 3), (100, 1)] {
            assert_eq!(after(1000, looks).len(), ticks, "{looks}");
        }
        let all = after(1000, 1);
        assert_eq!(all.len() as u64, ALL_TURNS);
        assert!(all.is_sorted_by(|a, b| (!a.is_needed, a.due) < (!b.is_needed, b.due)));
        assert!(all.iter().all(|of| of.leaves == of.due + 4.0));
    }

    #[test]
    fn regions_come_in_order_of_urgency_and_are_left_alone_where_none_is_asked_for() {
        let unknown = |k: u32| Unknown {
            key: RegionKey::prefix(k),
            due: f64::from(k.wrapping_mul(2_654_435_761) % 97),
            leaves: 0.0,
            is_needed: k.is_multiple_of(3),
            predicted: 0,
        };
        for count in [0, 1, 31, 32, 33, 96, 97, 1000] {
            let mut predictions = Predictions::new(2, 1);
            predictions.unknown.extend((0..count).map(unknown));
            let before = predictions.unknown.clone();
            assert_eq!(predictions.unknown(false).next(), None);
            assert_eq!(predictions.unknown, before);
            let mut some = predictions.unknown(true);
            some.next();
            assert!(some.ordered <= REGIONS_PER_REQUEST);
            let mut sorted = before;
            sorted.sort_by(Unknown::by_urgency);
            // A part of them does not disturb the next time.
            let first: Vec<_> = predictions.unknown(true).take(40).collect();
            assert_eq!(first, sorted[..first.len()]);
            assert_eq!(first.len(), sorted.len().min(40));
            let mut all = predictions.unknown(true);
            assert_eq!(all.by_ref().collect::<Vec<_>>(), sorted);
            assert_eq!(all.next(), None, "of {count}");
        }
    }

    /// A hand so fast that the list is full before the next question.
    #[test]
    fn where_there_is_no_room_the_latest_predictions_take_that_of_others() {
        let mut cache = Cache::new(1 << 20);
        let mut predictions = Predictions::new(1, 1);
        let a_tick = MAX_UNKNOWN as u32 / 4;
        for tick in 0..ALL_TURNS {
            predictions.keep_latest(tick, 1000);
            for k in 0..a_tick {
                let predicted = Predicted {
                    key: RegionKey::prefix(tick as u32 * a_tick + k),
                    ticks: 5.0,
                    leaves: 9.0,
                    refine: false,
                };
                predictions.note(predicted, tick, &mut cache);
            }
        }
        assert_eq!(predictions.high_water(), (MAX_UNKNOWN, MAX_UNKNOWN));
        let kept: Vec<_> = predictions.unknown(true).collect();
        let latest = kept.iter().filter(|of| of.predicted == ALL_TURNS - 1);
        assert_eq!(latest.count(), a_tick as usize);
        // None of them was put in the place of another one of its tick, nor is one twice.
        let before = kept.iter().filter(|of| of.predicted + 4 >= ALL_TURNS);
        assert_eq!(before.count(), 4 * a_tick as usize);
    }

    /// The list was full before, up to its last places, and is full again in the midst of a tick.
    #[test]
    fn what_a_tick_notes_first_is_not_the_first_to_go() {
        let mut cache = Cache::new(1 << 20);
        let mut predictions = Predictions::new(1, 1);
        let mut next = 0;
        let mut note = |predictions: &mut Predictions, tick: u64, count: usize| {
            predictions.keep_latest(tick, 1000);
            for _ in 0..count {
                let predicted = Predicted {
                    key: RegionKey::prefix(next),
                    ticks: 5.0,
                    leaves: 9.0,
                    refine: false,
                };
                next += 1;
                predictions.note(predicted, tick, &mut cache);
            }
        };
        note(&mut predictions, 0, 2 * MAX_UNKNOWN - 12);
        let first = 2 * ALL_TURNS;
        note(&mut predictions, first, MAX_UNKNOWN - 10);
        note(&mut predictions, first + 1, 40);
        let kept: Vec<_> = predictions.unknown(true).collect();
        assert_eq!(kept.len(), MAX_UNKNOWN, "those of the first tick are gone");
        let latest = kept.iter().filter(|of| of.predicted == first + 1);
        assert_eq!(latest.count(), 40);
    }
}
