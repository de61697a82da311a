//! Remaining work of a tick, in units; all active objects draw on it in turn.

use crate::contact::query::{Deadline, Work};
use crate::tick::{Stage, StageObserver, Timed};
use crate::tuning::governor::{ENTRIES_PER_FACE, MIN_SEARCH_UNITS, OPERATION_FACES};
use crate::work::TickWork;
use scene::MAX_PROBES;
use spm::OperationFaces;

/// Remaining work of a tick.
pub struct Budget<'a> {
    /// Knows when the time for it is over.
    pub observer: &'a mut dyn StageObserver,
    /// Work units for received data.
    pub ingest: u32,
    /// Splits and collapses.
    pub operations: u32,
    /// Faces that they may change; each operation counts as [`OPERATION_FACES`] more. The last one
    /// begun may go beyond it by `max_fan`.
    pub faces: u32,
    /// Faces that one operation may change; one that would change more is not begun.
    pub max_fan: u32,
    /// Closure entries to go through for refinement.
    pub entries: u32,
    /// Entries of closures, region tables and caches to go through for what is not needed any more
    /// or is here already.
    pub upkeep: u32,
    /// Of these at the most for a place that has changed hands.
    pub forgotten: u32,
}

impl Budget<'_> {
    /// Whether another split or collapse may begin.
    pub fn has_operations(&mut self) -> bool {
        self.operations > 0 && self.faces > 0 && !self.is_over()
    }

    /// Whether the time for received data and refinement is over.
    pub fn is_over(&mut self) -> bool {
        self.observer.is_over(Timed::Refinement)
    }

    /// A stage has ended.
    pub fn ended(&mut self, stage: Stage) {
        self.observer.ended(stage);
    }

    /// There is time for so many faces.
    pub fn limit_faces(&mut self, faces: u32) {
        // The last operation begun goes beyond what is left.
        self.max_fan = self.max_fan.min(faces / 4);
        self.faces = self.faces.min(faces - faces / 4);
    }

    /// Closure entries were gone through.
    pub fn charge_entries(&mut self, entries: u32) {
        self.charge_faces(entries.div_ceil(ENTRIES_PER_FACE));
    }

    /// A split or collapse that has changed these faces.
    pub fn charge_operation(&mut self, changed: &OperationFaces) {
        self.operations = self.operations.saturating_sub(1);
        self.charge_faces(OPERATION_FACES + changed.deformed().len() as u32);
    }

    /// Faces were looked at or changed.
    pub fn charge_faces(&mut self, faces: u32) {
        self.faces = self.faces.saturating_sub(faces);
    }
}

/// Work of the queries of a tick: nodes visited and faces tested, never more than the tick has time
/// for. A part is for the steps of the proxies, a part for the searches beside them. Every probe is
/// sure of an equal share of each, and each of its pairs of an equal share of that; what one pair
/// leaves the next may use.
pub struct QueryBudget<'a> {
    /// Knows when the time for them is over.
    pub observer: &'a mut dyn StageObserver,
    proxies: Part,
    searches: Part,
    /// Both together.
    all: Part,
    /// Pairs of each probe, and probes that have any.
    pairs: [u32; MAX_PROBES],
    probes: u32,
}

/// A part of the work.
#[derive(Debug, Clone, Copy)]
struct Part {
    most: u32,
    spent: u32,
    /// What the pairs to come are sure of.
    reserved: u32,
}

impl Part {
    fn new(most: u32) -> Self {
        Self {
            most,
            spent: 0,
            reserved: 0,
        }
    }

    fn left(&self) -> u32 {
        self.most.saturating_sub(self.spent + self.reserved)
    }
}

impl Deadline for QueryBudget<'_> {
    fn is_over(&mut self) -> bool {
        self.observer.is_over(Timed::Contact)
    }
}

impl<'a> QueryBudget<'a> {
    /// The work of a tick, of which there is time for so many `units`. `pairs`: the probe of each
    /// pair that is to have a part.
    #[must_use]
    pub fn new(
        work: &TickWork,
        units: u32,
        pairs: impl Iterator<Item = usize>,
        observer: &'a mut dyn StageObserver,
    ) -> Self {
        let mut budget = Self {
            observer,
            proxies: Part::new(work.proxies.min(units)),
            searches: Part::new(work.searches.min(units)),
            all: Part::new(work.queries().min(units)),
            pairs: [0; MAX_PROBES],
            probes: 0,
        };
        for probe in pairs {
            budget.probes += u32::from(budget.pairs[probe] == 0);
            budget.pairs[probe] += 1;
        }
        for part in [&mut budget.proxies, &mut budget.searches, &mut budget.all] {
            let shares = budget.pairs.iter().filter(|&&pairs| pairs > 0);
            let sure = |&pairs: &u32| part.most / budget.probes / pairs * pairs;
            part.reserved = shares.map(sure).sum();
        }
        budget
    }

    /// The turn of a pair of a probe: its share is not reserved any more.
    pub fn begin_pair(&mut self, probe: usize) {
        for part in [&mut self.proxies, &mut self.searches, &mut self.all] {
            part.reserved -= part.most / self.probes / self.pairs[probe];
        }
    }

    /// What the step of a proxy may spend now: a search for the nearest face comes after it.
    #[must_use]
    pub fn for_proxy(&self) -> u32 {
        let rest = self.all.left().saturating_sub(MIN_SEARCH_UNITS);
        self.proxies.left().min(rest)
    }

    /// What searches may spend now: where the time is over, the least that finds a nearest face.
    pub fn for_searches(&mut self) -> u32 {
        let left = self.searches.left().min(self.all.left());
        if self.is_over() {
            left.min(MIN_SEARCH_UNITS)
        } else {
            left
        }
    }

    /// What looking ahead may spend now.
    pub fn for_look_ahead(&mut self) -> u32 {
        if self.is_over() {
            0
        } else {
            self.for_searches()
        }
    }

    /// A proxy has spent this.
    pub fn charge_proxy(&mut self, work: Work) {
        self.proxies.spent += work.nodes + work.faces;
        self.all.spent += work.nodes + work.faces;
    }

    /// A search has spent this.
    pub fn charge_search(&mut self, work: Work) {
        self.searches.spent += work.nodes + work.faces;
        self.all.spent += work.nodes + work.faces;
    }

    /// What was spent so far.
    #[must_use]
    pub fn spent(&self) -> u32 {
        self.all.spent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tick::NoObserver;
    use crate::tuning::tick::PROXY_WORK;

    #[test]
    fn every_probe_is_sure_of_its_share_and_what_one_leaves_the_next_may_use() {
        // One probe near three objects, two near one each.
        let pairs = [0, 0, 1, 0, 2];
        let work = TickWork::new(1e3);
        let mut never = NoObserver;
        let mut budget = QueryBudget::new(&work, u32::MAX, pairs.into_iter(), &mut never);
        let mut left = Vec::new();
        for (turn, probe) in pairs.into_iter().enumerate() {
            budget.begin_pair(probe);
            left.push(budget.for_proxy());
            // The second leaves everything, the others take all.
            let nodes = if turn == 1 { 0 } else { budget.for_proxy() };
            budget.charge_proxy(Work { nodes, faces: 0 });
        }
        let third = PROXY_WORK / 3;
        assert!(left[0] >= third / 3 && left[0] <= third / 3 + 3);
        assert!(left[2] >= third + third / 3, "{left:?}");
        assert!(left[4] >= third);
        assert!(budget.spent() <= PROXY_WORK);
        // A tick that has time for less has less.
        let mut never = NoObserver;
        let mut busy = QueryBudget::new(&work, 1000, [0].into_iter(), &mut never);
        busy.begin_pair(0);
        assert_eq!(busy.for_proxy(), 1000 - MIN_SEARCH_UNITS);
        busy.charge_proxy(Work {
            nodes: 990,
            faces: 0,
        });
        assert_eq!(busy.for_searches(), 10);
    }
}
