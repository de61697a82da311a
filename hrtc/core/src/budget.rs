//! Remaining work of a tick, in units; all active objects draw on it in turn.

use crate::contact::query::{Deadline, Work};
use crate::costs::{QueryWork, WorkCosts};
use crate::observer::{StageObserver, Timed};
use crate::tuning::governor::{ENTRIES_PER_FACE, LARGE_FACES, MIN_SEARCH_UNITS, OPERATION_FACES};
use crate::work::TickWork;
use scene::MAX_PROBES;
use spm::OperationFaces;

/// Remaining work of a tick.
pub struct Budget<'a> {
    /// Knows when the time for it is over.
    pub observer: &'a mut dyn StageObserver,
    /// Work units for received data; 0 ends the taking of data in this tick.
    pub ingest: u32,
    /// Of these, the ones that were left when it ended before they were spent.
    pub unspent_ingest: u32,
    /// Splits and collapses.
    pub operations: u32,
    /// Faces that they may change; each operation counts as [`OPERATION_FACES`] more.
    pub faces: u32,
    /// Faces that one operation may change; one that would change more is not begun.
    pub max_fan: u32,
    /// Closure entries to go through for refinement; they are charged to the faces, too.
    pub entries: u32,
    /// Of a face that is charged, entries that may still be gone through.
    pub prepaid: u32,
    /// Entries of closures, region tables and caches to go through for what is not needed any more
    /// or is here already.
    pub upkeep: u32,
    /// Of these at the most for a place that has changed hands.
    pub forgotten: u32,
}

impl Budget<'_> {
    /// Whether another split or collapse may begin.
    pub fn has_operations(&mut self) -> bool {
        let has_faces = self.faces >= OPERATION_FACES + self.max_fan;
        self.operations > 0 && has_faces && !self.is_over()
    }

    /// Whether the time for received data and refinement is over.
    pub fn is_over(&mut self) -> bool {
        self.observer.is_over(Timed::Refinement)
    }

    /// No more received data is taken in this tick. What is left for it is not spent: it would say
    /// that the machine had done it.
    pub fn end_ingest(&mut self) {
        self.unspent_ingest += std::mem::take(&mut self.ingest);
    }

    /// There is time for so many faces from now on.
    pub fn set_faces(&mut self, faces: u32) {
        self.faces = faces;
        // Of many an operation may have a quarter, of few all.
        let alone = faces.saturating_sub(OPERATION_FACES);
        self.max_fan = alone.min(LARGE_FACES.max(faces / 4));
    }

    /// Closure entries may be gone through: what is taken off them is charged.
    pub fn go_through<T>(&mut self, look: impl FnOnce(&mut u32) -> T) -> T {
        let before = self.entries;
        let found = look(&mut self.entries);
        self.charge_entries(before - self.entries);
        found
    }

    /// Closure entries were gone through.
    pub fn charge_entries(&mut self, entries: u32) {
        let unpaid = entries.saturating_sub(self.prepaid);
        let faces = unpaid.div_ceil(ENTRIES_PER_FACE);
        self.prepaid = faces * ENTRIES_PER_FACE + self.prepaid - entries;
        self.charge_faces(faces);
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
/// for by their costs. A part is for the steps of the proxies, a part for the searches beside them.
/// Every probe is sure of an equal share of each, and each of its pairs of an equal share of that;
/// what one pair leaves the next may use.
pub struct QueryBudget<'a> {
    /// Knows when the time for them is over.
    pub observer: &'a mut dyn StageObserver,
    costs: WorkCosts,
    proxies: Part,
    searches: Part,
    /// Both together, nanoseconds by the costs.
    time: Part,
    /// What was spent so far, by [`QueryWork::unit`].
    units: [u32; QueryWork::UNITS],
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
    /// The work of a tick that has so many nanoseconds for it. `pairs`: the probe of each pair that
    /// is to have a part.
    #[must_use]
    pub fn new(
        work: &TickWork,
        (costs, ns): (&WorkCosts, u32),
        pairs: impl Iterator<Item = usize>,
        observer: &'a mut dyn StageObserver,
    ) -> Self {
        let mut budget = Self {
            observer,
            costs: *costs,
            proxies: Part::new(work.proxies),
            searches: Part::new(work.searches),
            time: Part::new(ns),
            units: [0; QueryWork::UNITS],
            pairs: [0; MAX_PROBES],
            probes: 0,
        };
        for probe in pairs {
            budget.probes += u32::from(budget.pairs[probe] == 0);
            budget.pairs[probe] += 1;
        }
        for part in [&mut budget.proxies, &mut budget.searches, &mut budget.time] {
            let shares = budget.pairs.iter().filter(|&&pairs| pairs > 0);
            let sure = |&pairs: &u32| part.most / budget.probes / pairs * pairs;
            part.reserved = shares.map(sure).sum();
        }
        budget
    }

    /// The turn of a pair of a probe: its share is not reserved any more.
    pub fn begin_pair(&mut self, probe: usize) {
        for part in [&mut self.proxies, &mut self.searches, &mut self.time] {
            part.reserved -= part.most / self.probes / self.pairs[probe];
        }
    }

    /// What work of a kind may spend now. After the steps of a proxy comes a search for the nearest
    /// face. Where the time is over, a search may spend the least that finds it.
    pub fn left(&mut self, kind: QueryWork) -> u32 {
        let of_time = |ns: u32| (f64::from(ns) / self.costs.of_query(kind)) as u32;
        match kind {
            QueryWork::Ball | QueryWork::Tool => {
                let search = f64::from(MIN_SEARCH_UNITS) * self.costs.search;
                let ns = self.time.left().saturating_sub(search.ceil() as u32);
                self.proxies.left().min(of_time(ns))
            }
            QueryWork::Search | QueryWork::Effects | QueryWork::ToolSearch => {
                let left = self.searches.left().min(of_time(self.time.left()));
                if self.is_over() {
                    left.min(MIN_SEARCH_UNITS)
                } else {
                    left
                }
            }
        }
    }

    /// What looking ahead may spend now.
    pub fn for_look_ahead(&mut self) -> u32 {
        if self.is_over() {
            0
        } else {
            self.left(QueryWork::Search)
        }
    }

    /// Work of a kind has spent this.
    pub fn charge(&mut self, kind: QueryWork, work: Work) {
        let units = work.nodes + work.faces;
        self.units[kind.unit()] += units;
        match kind {
            QueryWork::Ball | QueryWork::Tool => self.proxies.spent += units,
            QueryWork::Search | QueryWork::Effects | QueryWork::ToolSearch => {
                self.searches.spent += units;
            }
        }
        let ns = f64::from(units) * self.costs.of_query(kind);
        self.time.spent = self.time.spent.saturating_add(ns.ceil() as u32);
    }

    /// What was spent so far, units.
    #[must_use]
    pub fn spent(&self) -> u32 {
        self.proxies.spent + self.searches.spent
    }

    /// The same, by [`QueryWork::unit`].
    #[must_use]
    pub fn units(&self) -> [u32; QueryWork::UNITS] {
        self.units
    }

    /// The same, nanoseconds by the costs.
    #[must_use]
    pub fn spent_ns(&self) -> u32 {
        self.time.spent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observer::{NoObserver, Stage};
    use crate::tuning::tick::PROXY_WORK;

    #[test]
    fn every_probe_is_sure_of_its_share_and_what_one_leaves_the_next_may_use() {
        // One probe near three objects, two near one each.
        let pairs = [0, 0, 1, 0, 2];
        let (work, costs) = (TickWork::new(1e3), WorkCosts::REFERENCE);
        let mut never = NoObserver;
        let time = (&costs, u32::MAX);
        let mut budget = QueryBudget::new(&work, time, pairs.into_iter(), &mut never);
        let mut left = Vec::new();
        for (turn, probe) in pairs.into_iter().enumerate() {
            budget.begin_pair(probe);
            left.push(budget.left(QueryWork::Ball));
            // The second leaves everything, the others take all.
            let nodes = if turn == 1 { 0 } else { left[turn] };
            budget.charge(QueryWork::Ball, Work { nodes, faces: 0 });
        }
        let third = PROXY_WORK / 3;
        assert!(left[0] >= third / 3 && left[0] <= third / 3 + 3);
        assert!(left[2] >= third + third / 3, "{left:?}");
        assert!(left[4] >= third);
        assert!(budget.spent() <= PROXY_WORK);
    }

    #[test]
    fn a_tick_that_has_time_for_less_has_less_by_the_costs() {
        let (work, costs) = (TickWork::new(1e3), WorkCosts::REFERENCE);
        let mut never = NoObserver;
        let time = (&costs, 36_000);
        let mut budget = QueryBudget::new(&work, time, [0].into_iter(), &mut never);
        budget.begin_pair(0);
        let of_tool = budget.left(QueryWork::Tool);
        let search_ns = f64::from(MIN_SEARCH_UNITS) * costs.search;
        assert_eq!(of_tool, ((36_000.0 - search_ns) / costs.tool) as u32);
        let of_search = budget.left(QueryWork::ToolSearch);
        assert_eq!(of_search, (36_000.0 / costs.tool) as u32);
        budget.charge(
            QueryWork::Tool,
            Work {
                nodes: of_tool,
                faces: 0,
            },
        );
        let of_search = budget.left(QueryWork::Search);
        assert!(of_search >= MIN_SEARCH_UNITS);
        let searched = Work {
            nodes: of_search,
            faces: 0,
        };
        budget.charge(QueryWork::Search, searched);
        assert!(budget.spent_ns() <= 36_000 && budget.left(QueryWork::Search) <= 1);
        assert_eq!(budget.units(), [of_search, 0, of_tool]);
    }

    /// Over at once.
    struct Over;

    impl StageObserver for Over {
        fn ended(&mut self, _: Stage) {}

        fn is_over(&mut self, _: Timed) -> bool {
            true
        }
    }

    #[test]
    fn what_is_left_for_received_data_when_it_ends_is_not_spent() {
        let mut observer = Over;
        let mut budget = Budget {
            observer: &mut observer,
            ingest: 72,
            unspent_ingest: 0,
            operations: 1,
            faces: 0,
            max_fan: 0,
            entries: 0,
            prepaid: 0,
            upkeep: 0,
            forgotten: 0,
        };
        budget.end_ingest();
        assert_eq!((budget.ingest, budget.unspent_ingest), (0, 72));
        // Once more, as by another session.
        budget.end_ingest();
        assert_eq!((budget.ingest, budget.unspent_ingest), (0, 72));
    }

    #[test]
    fn where_the_time_is_over_a_search_has_the_least_and_nothing_looks_ahead() {
        let (work, costs) = (TickWork::new(1e3), WorkCosts::REFERENCE);
        let mut over = Over;
        let time = (&costs, u32::MAX);
        let mut budget = QueryBudget::new(&work, time, [0].into_iter(), &mut over);
        budget.begin_pair(0);
        assert_eq!(budget.left(QueryWork::Search), MIN_SEARCH_UNITS);
        assert_eq!(budget.for_look_ahead(), 0);
        // A step begins in any case; its limit is told, too.
        assert!(budget.left(QueryWork::Ball) > 0 && budget.is_over());
    }
}
