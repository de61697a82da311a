//! What the units of counted work cost on a machine.

use crate::tuning::governor::{LARGE_FACES, MIN_SEARCH_UNITS, OPERATION_FACES};
use crate::tuning::lod::{CHANGES_PER_UNIT, MIN_UPKEEP};
use crate::tuning::streaming::MIN_UNITS;
use serde::{Deserialize, Serialize};

/// Costs of the units of counted work on a machine, nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WorkCosts {
    /// What every tick does once: sampling, limits, records.
    pub tick: f64,
    /// The box of an object against the ball around a probe.
    pub box_test: f64,
    /// A step of a body that is awake, and its place in the broad phase.
    pub body: f64,
    /// Prediction for a pair of a probe and an object.
    pub prediction: f64,
    /// A unit of received data.
    pub received: f64,
    /// A question to the station.
    pub request: f64,
    /// A face that a split, a collapse or a step of a vertex changes.
    pub face: f64,
    /// A closure entry that is gone through.
    pub entry: f64,
    /// Contact, effects and force of a pair beside its queries.
    pub contact: f64,
    /// A node or face that a search for the nearest face visits.
    pub search: f64,
    /// A node or face that the steps of a ball, or its effects, visit.
    pub ball: f64,
    /// A unit of a tool's work (`tuning::probe::PAIRS_A_UNIT` pairs of nodes).
    pub tool: f64,
}

/// Kinds of work that the queries of a tick do, each with a cost of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QueryWork {
    /// [`WorkCosts::search`].
    Search,
    /// The faces around a contact for its effects: [`WorkCosts::ball`].
    Effects,
    /// [`WorkCosts::ball`].
    Ball,
    /// [`WorkCosts::tool`].
    Tool,
    /// The nearest faces of a tool and an object: [`WorkCosts::tool`].
    ToolSearch,
}

impl QueryWork {
    /// Units with a cost of their own: of searches, of a ball and of a tool.
    pub const UNITS: usize = 3;

    /// Its place among them.
    #[must_use]
    pub const fn unit(self) -> usize {
        match self {
            Self::Search => 0,
            Self::Effects | Self::Ball => 1,
            Self::Tool | Self::ToolSearch => 2,
        }
    }
}

/// Stages whose costs are measured together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CostGroup {
    /// [`WorkCosts::tick`], `box_test` and `body`.
    Tick,
    /// [`WorkCosts::prediction`], `received` and `request`.
    Inbox,
    /// [`WorkCosts::face`] and `entry`.
    Refine,
    /// [`WorkCosts::contact`], `search`, `ball` and `tool`.
    Query,
}

impl CostGroup {
    /// All, in the order of [`crate::governor::Spent::by_group`].
    pub const ALL: [Self; 4] = [Self::Tick, Self::Inbox, Self::Refine, Self::Query];
}

impl WorkCosts {
    /// Of the reference machine (AMD EPYC, 2 cores), from runs on the dragon and on a terrain of
    /// ten million faces in 16 MiB; those of the queries stand to each other as a fit of the times
    /// of ticks by their counts says (dragon and bunny, ball and tool). Three balls among a
    /// thousand boxes take 4 µs ([`crate::active::broad_phase`]), 128 bodies 50 µs
    /// ([`scene::MAX_MOVABLES`]). What a run without a measurement counts with, so that a
    /// simulation has the same budgets everywhere.
    pub const REFERENCE: Self = Self {
        tick: 5_000.0,
        box_test: 1.5,
        body: 400.0,
        prediction: 2_000.0,
        received: 50.0,
        request: 4_000.0,
        face: 160.0,
        entry: 8.0,
        contact: 2_000.0,
        search: 20.0,
        ball: 60.0,
        tool: 300.0,
    };

    /// A unit of the queries.
    #[must_use]
    pub fn of_query(&self, work: QueryWork) -> f64 {
        match work {
            QueryWork::Search => self.search,
            QueryWork::Effects | QueryWork::Ball => self.ball,
            QueryWork::Tool | QueryWork::ToolSearch => self.tool,
        }
    }

    /// A split or collapse that changes `LARGE_FACES`, nanoseconds.
    #[must_use]
    pub fn large_operation(&self) -> f64 {
        f64::from(OPERATION_FACES + LARGE_FACES) * self.face
    }

    /// The least received data that a tick takes in, and a question to the station, nanoseconds.
    #[must_use]
    pub fn least_inbox(&self) -> f64 {
        f64::from(MIN_UNITS) * self.received + self.request
    }

    /// The least upkeep of a tick, nanoseconds.
    #[must_use]
    pub fn least_upkeep(&self) -> f64 {
        f64::from(MIN_UPKEEP / CHANGES_PER_UNIT) * self.entry
    }

    /// The least search of a pair for its nearest face, nanoseconds.
    #[must_use]
    pub fn least_search(&self) -> f64 {
        f64::from(MIN_SEARCH_UNITS) * self.search
    }

    /// The costs on a machine where the stages of each group take so many times as long.
    #[must_use]
    pub fn scaled(self, by_group: [f64; CostGroup::ALL.len()]) -> Self {
        let [tick, inbox, refine, query] = by_group;
        Self {
            tick: self.tick * tick,
            box_test: self.box_test * tick,
            body: self.body * tick,
            prediction: self.prediction * inbox,
            received: self.received * inbox,
            request: self.request * inbox,
            face: self.face * refine,
            entry: self.entry * refine,
            contact: self.contact * query,
            search: self.search * query,
            ball: self.ball * query,
            tool: self.tool * query,
        }
    }

    /// Whether every cost is a time.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.named()
            .iter()
            .all(|&(_, ns)| ns > 0.0 && ns.is_finite())
    }

    /// The costs by name.
    #[must_use]
    pub fn named(&self) -> [(&'static str, f64); 12] {
        [
            ("tick", self.tick),
            ("box_test", self.box_test),
            ("body", self.body),
            ("prediction", self.prediction),
            ("received", self.received),
            ("request", self.request),
            ("face", self.face),
            ("entry", self.entry),
            ("contact", self.contact),
            ("search", self.search),
            ("ball", self.ball),
            ("tool", self.tool),
        ]
    }
}

impl Default for WorkCosts {
    fn default() -> Self {
        Self::REFERENCE
    }
}
