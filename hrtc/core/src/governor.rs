//! The governor: how much work a tick may do, so that it ends in its share of the period on any
//! machine (thesis 4.1.2 and 5.6.1: T, the time for a frame, and T', the time measured before).
//!
//! Every unit of counted work has a cost on this machine ([`WorkCosts`]). A tick may spend a
//! share of its period, `TIME_SHARE` at most, in units by these costs ([`TickTime`]):
//!
//! 1. what every tick does ([`TickLoad`], limits of force) is taken off first,
//! 2. then what the contacts took of late, at most `CONTACT_SHARE` of the rest,
//! 3. received data, splits and collapses share what is left, the most urgent region first: at
//!    least one collapse has time, else a surface that is too fine for the machine could never be
//!    coarser,
//! 4. the contacts have everything that these leave; where a probe may touch next comes last.
//!
//! So a tick that is short of time gives up, in this order: looking ahead, data that is loaded
//! ahead, refinement away from the contact, the tolerance at the contact ([`crate::policy`]: fewer
//! operations a tick raise the finest ring), and steps of the proxies, which come along over
//! several ticks. What every tick does is allowed on any machine: the samples, the forces and their
//! limits; and beside it a question, a little received data, some upkeep and a search for each
//! pair. A machine that has no time for as much is refused before the first tick ([`TickNeed`]).
//! Refinement leaves some queries to each pair. A unit that is larger than all of its share, such
//! as the split of a vertex with a very large fan, is not begun.
//!
//! Single ticks take longer than their work should, by an interrupt or a cold cache. So the core
//! asks its shell, between splits, steps of geomorphs and pieces of a query, whether the time of
//! the tick is over ([`crate::Timed`]), and ends as at the end of a budget. The answers are inputs,
//! and recorded.
//!
//! Where the surface under a probe has so many faces that touching it takes more than a tick has,
//! again and again, the finest ring is raised too: by the steps of memory pressure (`Steps`), since
//! it is the same want of another good. None is taken that would change nothing, and where a tick
//! has a quarter more time than any that was cut, they go back as soon as one after the other has
//! taken effect: the machine is faster again, which needs no trial.
//!
//! # The law
//!
//! The measured processor time m of a tick is an input of the next one, p is what it should have
//! taken by the costs. The slowness s says how much slower the machine is than the costs say, and
//! divides the time that a tick has. With b, a quarter of that time, as the weight of what is
//! believed already, so that short ticks say little,
//!
//! `q = (m + s b) / (p + b)`, `s = max(the middle of the last three q, s exp(-period / fades))`.
//!
//! Of three, since one tick alone may have been interrupted. It cannot hunt: where the costs are
//! wrong by a factor r, q lies between s and r, whatever p is. So s rises towards r and never
//! beyond; above r it falls by the fading or faster. Where r itself varies between r1 and r2 from
//! tick to tick, s comes into that range and stays there, and the time of a tick by the costs
//! between the share of the period over r2 and over r1.
//!
//! The time of the devices' drivers is in neither: no cost tells it, and it does not grow with
//! what a tick has to do. What they took of late comes off the time that a tick has.
//!
//! What no costs tell remains: an interrupt, a cold cache. On a slow machine they take more of a
//! period. A tick that is *late* after one that was not, and longer than the law above expects,
//! takes a part off the share of the period that ticks may spend; that comes back over
//! `SHARE_RETURN_S`. More of them in a row are a slower machine, which that law sees. So the share
//! falls where such ticks are frequent, until they are not or to `MIN_TIME_SHARE`. One late tick
//! moves it by that part, a tick in time by `period / SHARE_RETURN_S` of what is missing.
//!
//! The operations that a tick can afford go down at once, and come back by a third of the way in
//! `OPERATIONS_RETURN_S`; a ring that was given up comes back only when there are a quarter more
//! than it needs, while neighbouring rings differ by four times.

pub use crate::costs::{CostGroup, QueryWork, WorkCosts};
use crate::horizons::Horizons;
use crate::lod::memory_pressure::Steps;
pub use crate::tuning::governor::MIN_BALL_UNITS;
use crate::tuning::governor::{
    CONTACT_FADES_S, CONTACT_SHARE, CUT_FADES, CUT_S, DRIVERS_FADE_S, LATE, LATE_CUT, MIN_CUT,
    MIN_TIME_SHARE, MIN_TOOL_UNITS, MORE_TIME, OPERATION_FACES, OPERATIONS_RETURN_S,
    RECEIVED_SHARE, SHARE_RETURN_S, SHORT_SHARE, SLOWNESS_FADES_S, SLOWNESS_RANGE, TIME_SHARE,
    TYPICAL_FACES, UNITS_PER_OPERATION, UPKEEP_SHARE, USUAL_BALL_UNITS, USUAL_TOOL_UNITS,
};
use crate::tuning::lod::{CHANGES_PER_UNIT, MIN_UPKEEP};
use geometry::portable::exp;
use serde::{Deserialize, Serialize};

/// What a tick has spent by the costs, nanoseconds, in the order of [`CostGroup::ALL`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spent {
    /// For each group of costs.
    pub by_group: [f64; CostGroup::ALL.len()],
}

impl Spent {
    /// The sum, nanoseconds.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.by_group.iter().sum()
    }

    fn charge(&mut self, group: CostGroup, ns: f64) {
        self.by_group[group as usize] += ns;
    }
}

/// The time of one tick, by the costs. The one place where work is charged.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct TickTime {
    costs: WorkCosts,
    /// What the tick may spend, nanoseconds.
    allowed: f64,
    /// What is kept for the contacts.
    contacts: f64,
    /// What the queries have taken, without what every pair costs beside them.
    queries: f64,
    /// What it has spent.
    pub spent: Spent,
}

impl TickTime {
    /// What the tick may spend, nanoseconds.
    #[must_use]
    pub fn allowed(&self) -> f64 {
        self.allowed
    }

    /// What received data, splits and collapses may still take, nanoseconds.
    #[must_use]
    pub fn for_refinement(&self) -> f64 {
        (self.allowed - self.contacts - self.spent.total()).max(0.0)
    }

    /// Faces that operations may change in a share of this time.
    #[must_use]
    pub fn faces(&self, share: f64) -> u32 {
        (share * self.for_refinement() / self.costs.face) as u32
    }

    /// What a split takes on most meshes, with its record, nanoseconds.
    #[must_use]
    pub fn operation_ns(&self) -> f64 {
        (OPERATION_FACES + TYPICAL_FACES) as f64 * self.costs.face
            + UNITS_PER_OPERATION * self.costs.received
    }

    /// Questions to the station that a quarter of what is left beside so many units of received
    /// data suffices for.
    #[must_use]
    pub fn requests(&self, units: u32) -> usize {
        let received = f64::from(units) * self.costs.received;
        let left = (self.for_refinement() - received).max(0.0);
        (0.25 * left / self.costs.request) as usize
    }

    /// Closure entries that a share of this time suffices for.
    #[must_use]
    pub fn entries(&self, share: f64) -> u32 {
        (share * self.for_refinement() / self.costs.entry) as u32
    }

    /// Entries for upkeep that the share for it suffices for, and no fewer than on any machine.
    #[must_use]
    pub fn upkeep(&self) -> u32 {
        let entries = CHANGES_PER_UNIT.saturating_mul(self.entries(UPKEEP_SHARE));
        entries.max(MIN_UPKEEP)
    }

    /// Units of received data that the share for it suffices for, beside a question to the
    /// station: they are there to be split.
    #[must_use]
    pub fn received_units(&self) -> u32 {
        let left = self.for_refinement() - self.costs.request;
        (RECEIVED_SHARE * left.max(0.0) / self.costs.received) as u32
    }

    /// Costs of the units.
    #[must_use]
    pub fn costs(&self) -> &WorkCosts {
        &self.costs
    }

    /// What the queries may take now, nanoseconds.
    #[must_use]
    pub fn for_queries(&self) -> u32 {
        (self.allowed - self.spent.total()).max(0.0) as u32
    }

    /// Received data and questions.
    pub fn charge_inbox(&mut self, units: u32, requests: usize) {
        let ns = f64::from(units) * self.costs.received + requests as f64 * self.costs.request;
        self.spent.charge(CostGroup::Inbox, ns);
    }

    /// All operations of the tick so far by the faces they changed, and closure entries.
    pub fn set_refinement(&mut self, faces: u32, entries: u32) {
        let ns = f64::from(faces) * self.costs.face + f64::from(entries) * self.costs.entry;
        self.spent.by_group[CostGroup::Refine as usize] = ns;
    }

    /// Queries, nanoseconds.
    pub fn charge_queries(&mut self, ns: u32) {
        self.queries += f64::from(ns);
        self.spent.charge(CostGroup::Query, f64::from(ns));
    }
}

/// What a tick does in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TickLoad {
    /// Pairs of a ball, and of a tool, and an object near it.
    pub pairs: [usize; 2],
    /// Boxes that the broad phase compares.
    pub box_tests: usize,
    /// Steps of bodies.
    pub body_steps: usize,
    /// Closure entries that it has gone through already.
    pub entries: u32,
}

impl TickLoad {
    /// For these pairs (of a ball, of a tool), numbers of objects and probes, and steps of bodies.
    #[must_use]
    pub fn new(pairs: [usize; 2], objects: usize, probes: usize, body_steps: usize) -> Self {
        Self {
            pairs,
            // A single object always counts as near.
            box_tests: if objects > 1 { objects * probes } else { 0 },
            body_steps,
            entries: 0,
        }
    }
}

/// Pairs alone: a single object that does not move.
impl From<[usize; 2]> for TickLoad {
    fn from(pairs: [usize; 2]) -> Self {
        Self {
            pairs,
            ..Self::default()
        }
    }
}

/// What probes ask of a tick on a machine, before it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickNeed {
    /// What a tick may spend, nanoseconds.
    pub share_ns: f64,
    /// What it takes on any machine, nanoseconds: what every tick does, the least received data
    /// with a question to the station, the least upkeep, and a search for each probe.
    pub least_ns: f64,
    /// The same with each probe in a usual contact, nanoseconds.
    pub contact_ns: f64,
    /// Splits and collapses a tick that there is time for beside that, at least 1.
    pub operations: f64,
}

impl TickNeed {
    /// Of balls and tools, boxes and bodies, in ticks of a period (seconds) with so many operations
    /// at the most.
    #[must_use]
    pub fn new(
        costs: WorkCosts,
        period_s: f64,
        max_operations: usize,
        load: impl Into<TickLoad>,
    ) -> Self {
        let load = load.into();
        let mut governor = Governor::new(period_s, max_operations);
        governor.set_costs(costs);
        governor.begin_tick(load);
        let [balls, tools] = load.pairs;
        let least_ns = governor.time.spent.total() + governor.least_ns((balls + tools) as f64);
        let units = [
            balls as f64 * USUAL_BALL_UNITS * governor.costs.ball,
            tools as f64 * USUAL_TOOL_UNITS * governor.costs.tool,
        ];
        governor.contact_ns = units.iter().sum();
        governor.begin_tick(load);
        Self {
            share_ns: governor.share_ns(),
            least_ns,
            contact_ns: least_ns + governor.contact_ns,
            operations: governor.operations(),
        }
    }
}

/// What a tick took, as the shell measured it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MeasuredTick {
    /// Processor time without that of the devices' drivers, nanoseconds.
    pub work_ns: u32,
    /// Time that the drivers took to read and write, whether they worked or waited, nanoseconds; 0
    /// where that is no more than what every tick does anyway.
    pub device_ns: u32,
}

impl MeasuredTick {
    /// A tick beside whose work the drivers took no time that counts.
    #[must_use]
    pub fn of_work(work_ns: u32) -> Self {
        Self {
            work_ns,
            device_ns: 0,
        }
    }
}

/// State of the governor.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Governor {
    costs: WorkCosts,
    period_s: f64,
    /// Looks of a prediction in a tick.
    looks: f64,
    /// Share of the period that a tick may spend.
    share: f64,
    slowness: f64,
    /// The newest three.
    ratios: [f64; 3],
    /// Whether the last tick was late.
    was_late: bool,
    /// The most that the devices' drivers took in a tick of late, the second most, and what they
    /// took in the last one, nanoseconds.
    device_times: [f64; 2],
    last_device_ns: f64,
    /// What the queries of the contacts took of late, nanoseconds by the costs.
    contact_ns: f64,
    /// Ticks of late in which a contact had less time than it needs.
    cut: f64,
    /// The most time that such a tick had since the first step, nanoseconds.
    cut_ns: f64,
    steps: Steps,
    /// Operations a tick that the scene allows.
    max_operations: f64,
    /// Operations a tick that there is time for.
    operations: f64,
    /// The time of the present tick, and after it of the last one.
    pub(crate) time: TickTime,
}

impl Governor {
    /// For ticks of a period, seconds, with so many operations at the most.
    #[must_use]
    pub fn new(period_s: f64, max_operations: usize) -> Self {
        let horizons = Horizons::new(1.0 / period_s);
        Self {
            costs: WorkCosts::REFERENCE,
            period_s,
            looks: horizons.prediction.looks as f64,
            share: TIME_SHARE,
            slowness: 1.0,
            ratios: [1.0; 3],
            was_late: false,
            device_times: [0.0; 2],
            last_device_ns: 0.0,
            contact_ns: 0.0,
            cut: 0.0,
            cut_ns: 0.0,
            steps: Steps::new(horizons.pressure),
            max_operations: max_operations as f64,
            operations: max_operations as f64,
            time: TickTime::default(),
        }
    }

    /// Counts with these costs from the next tick on; such that are no times are left alone.
    pub fn set_costs(&mut self, costs: WorkCosts) {
        if costs.is_valid() {
            self.costs = costs;
        }
    }

    /// The costs.
    #[must_use]
    pub fn costs(&self) -> &WorkCosts {
        &self.costs
    }

    /// What the last tick has spent by the costs.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.time.spent
    }

    /// How many times as long a tick takes as the costs say.
    #[must_use]
    pub fn slowness(&self) -> f64 {
        self.slowness
    }

    /// Share of its period that a tick may spend.
    #[must_use]
    pub fn time_share(&self) -> f64 {
        self.share
    }

    /// Operations a tick that there is time for, at least 1.
    #[must_use]
    pub fn operations(&self) -> f64 {
        self.operations
    }

    /// The devices' drivers took so much of the last tick, nanoseconds: before
    /// [`Self::note_work`].
    pub fn note_devices(&mut self, ns: f64) {
        self.last_device_ns = ns;
        // More than a period is no more to be planned for.
        let ns = ns.min(self.period_ns());
        let left = exp(-self.period_s / DRIVERS_FADE_S);
        let [most, second] = self.device_times.map(|of| left * of);
        self.device_times = if ns > most {
            [ns, most]
        } else {
            [most, second.max(ns)]
        };
    }

    /// Time of a tick that is the drivers', nanoseconds: the second most of late, since one tick
    /// alone may have been interrupted, and a slow device may answer to a few ticks only.
    fn device_ns(&self) -> f64 {
        self.device_times[1].min(self.share_ns())
    }

    /// The last tick took so much processor time beside them, nanoseconds.
    pub fn note_work(&mut self, ns: f64) {
        let believed = SHORT_SHARE * self.share_ns() / self.slowness;
        let known = ns + self.slowness * believed;
        let ratio = known / (self.time.spent.total() + believed);
        if !ratio.is_finite() {
            return;
        }
        self.ratios.rotate_left(1);
        self.ratios[2] = ratio;
        let [a, b, c] = self.ratios;
        let middle = a.max(b).min(a.min(b).max(c));
        let faded = self.slowness * exp(-self.period_s / SLOWNESS_FADES_S);
        let [least, most] = SLOWNESS_RANGE;
        self.slowness = faded.max(middle).clamp(least, most);
        let is_late = ns + self.last_device_ns > LATE * self.period_ns();
        let was_late = std::mem::replace(&mut self.was_late, is_late);
        let back = self.period_s / SHARE_RETURN_S * (TIME_SHARE - self.share);
        // Two in a row are a slower machine.
        let share = if is_late && !was_late && ratio > middle {
            (1.0 - LATE_CUT) * self.share
        } else {
            self.share + back
        };
        self.share = share.clamp(MIN_TIME_SHARE, TIME_SHARE);
    }

    fn period_ns(&self) -> f64 {
        self.period_s * 1e9
    }

    /// What a tick may spend on a machine that is as fast as the costs say, nanoseconds.
    fn share_ns(&self) -> f64 {
        self.share * self.period_ns()
    }

    /// The time of a tick that does this in any case.
    pub fn begin_tick(&mut self, load: impl Into<TickLoad>) {
        self.time = self.time_with(&load.into());
        let affordable =
            (self.time.for_refinement() / self.time.operation_ns()).clamp(1.0, self.max_operations);
        let back = 1.0 - exp(-self.period_s / OPERATIONS_RETURN_S);
        let more = self.operations + back * (affordable - self.operations);
        self.operations = more.min(affordable);
    }

    /// The same once its objects have moved and its pairs have begun, before anything else of it is
    /// charged. How many operations there is time for stays: a stall alone says nothing of that.
    pub fn set_load(&mut self, load: &TickLoad) {
        self.time = self.time_with(load);
    }

    /// What a tick with so many pairs is allowed beside what every tick does, on any machine,
    /// nanoseconds.
    fn least_ns(&self, pairs: f64) -> f64 {
        let costs = &self.costs;
        costs.least_inbox() + costs.least_upkeep() + pairs * costs.least_search()
    }

    fn time_with(&self, load: &TickLoad) -> TickTime {
        let costs = self.costs;
        let mut time = TickTime {
            costs,
            ..TickTime::default()
        };
        let [balls, tools] = load.pairs.map(|pairs| pairs as f64);
        let pairs = balls + tools;
        let boxes = load.box_tests as f64 * costs.box_test;
        let bodies = load.body_steps as f64 * costs.body;
        let tick = costs.tick + boxes + bodies;
        time.spent.charge(CostGroup::Tick, tick);
        time.set_refinement(0, load.entries);
        let predictions = pairs * self.looks * costs.prediction;
        time.spent.charge(CostGroup::Inbox, predictions);
        time.spent.charge(CostGroup::Query, pairs * costs.contact);
        let queries = balls * MIN_BALL_UNITS * costs.ball + tools * MIN_TOOL_UNITS * costs.tool;
        let kept = queries + costs.least_inbox();
        let fixed = time.spent.total();
        let share = (self.share_ns() - self.device_ns()) / self.slowness;
        let search = pairs * costs.least_search();
        time.allowed = share.max(fixed + self.least_ns(pairs));
        let rest = time.allowed - fixed;
        let contacts = self.contact_ns.min(CONTACT_SHARE * rest).max(kept);
        let step = balls * costs.ball + tools * costs.tool;
        let but_a_collapse = rest - costs.large_operation() / (1.0 - UPKEEP_SHARE);
        time.contacts = contacts.min(but_a_collapse.max(search + step)).min(rest);
        time
    }

    /// Steps by which less is asked for, as those of memory pressure.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps.count()
    }

    /// The queries of the tick are done; `is_cut`: a contact had less time than it needs;
    /// `can_ask_for_less`: another step would change what is asked for.
    pub fn end_queries(&mut self, tick: u64, is_cut: bool, can_ask_for_less: bool) {
        let allowed = self.time.allowed;
        let most = (CUT_S / self.period_s).max(MIN_CUT);
        if is_cut {
            self.cut = (self.cut + 1.0).min(most);
            self.cut_ns = self.cut_ns.max(allowed);
        } else {
            self.cut = (self.cut - CUT_FADES).max(0.0);
        }
        // The want counts also where no step is left.
        if is_cut && self.cut >= most && self.steps.want(tick) && can_ask_for_less {
            self.cut = 0.0;
            self.steps.step(tick);
        }
        self.steps.recover(tick, allowed > MORE_TIME * self.cut_ns);
        if self.steps.count() == 0 && self.cut == 0.0 {
            self.cut_ns = 0.0;
        }
        // What a pair costs beside its queries is taken off every tick anyway.
        let taken = self.time.queries;
        let faded = self.contact_ns * exp(-self.period_s / CONTACT_FADES_S);
        self.contact_ns = taken.max(faded);
    }
}

#[cfg(test)]
mod tests;
