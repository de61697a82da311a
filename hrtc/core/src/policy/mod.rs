//! How fine each object may be for want of time: two policies behind one interface.
//!
//! Both have the same time, that of the governor, and the same order of work: the object nearest to
//! a contact first, by importance, in it the region that is due first, of these the coarser. Cells
//! of a coarser ring are larger and lower the error at more places for the same splits: so a unit
//! is to go where it lowers the expected error of the next contacts most.
//!
//! They differ in the finest ring that is asked for, and so in what is received and split at all:
//!
//! - *Predictive* (Funkhouser 1993): the finest one whose splits, known before they are
//!   made from speed and density, fit the ticks ([`crate::lod::lod_controller`]). A less important
//!   object may count on a smaller part of a tick.
//! - *Reactive* (thesis 4.1.2): what it takes is measured; with time left every object gets finer,
//!   with too little every one coarser ([`reactive`]).

pub mod reactive;

use reactive::{Load, Reactive};
use scene::PolicyPlan;
use serde::{Deserialize, Serialize};

/// How fine an object may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Detail {
    /// As fine as the splits and collapses of its motion fit into those of a tick that it may count
    /// on.
    Fitting,
    /// As fine as so large a share of the splits of all that is asked for, 0 to 1.
    Splits(f64),
}

impl Detail {
    /// Of an object that was not seen yet.
    #[must_use]
    pub fn at_start(policy: PolicyPlan) -> Self {
        match policy {
            PolicyPlan::Predictive => Self::Fitting,
            PolicyPlan::Reactive => Self::Splits(0.0),
        }
    }
}

/// What a policy goes by at an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Its share of the importance of the most important object.
    pub importance: f64,
    /// Its distance from the nearest probe, in shares of the one at which it comes into reach.
    pub distance: f64,
    /// The path of that probe in a second, in diagonals of the object.
    pub speed: f64,
}

/// A policy with its state.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Policy {
    /// By known costs.
    Predictive,
    /// By measured time.
    Reactive(Reactive),
}

impl Policy {
    /// As the scene says, for ticks of a period, seconds.
    #[must_use]
    pub fn new(plan: PolicyPlan, period_s: f64) -> Self {
        match plan {
            PolicyPlan::Predictive => Self::Predictive,
            PolicyPlan::Reactive => Self::Reactive(Reactive::new(period_s)),
        }
    }

    /// How fine an object may be that might be so fine before. `seen`: `None` away from every
    /// probe.
    #[must_use]
    pub fn detail(&self, before: Detail, seen: impl FnOnce() -> Option<Seen>) -> Detail {
        match (self, before) {
            (Self::Reactive(policy), Detail::Splits(share)) if policy.steps_now() => {
                Detail::Splits(policy.stepped(share, seen()))
            }
            _ => before,
        }
    }

    /// Steps by which less than that is asked for, of those that the governor wants.
    #[must_use]
    pub fn steps(&self, wanted: u32) -> u32 {
        match self {
            Self::Predictive => wanted,
            // The contacts are in the time that it goes by.
            Self::Reactive(_) => 0,
        }
    }

    /// A tick is over. `can_rise`: whether an object near a probe may be finer still.
    pub fn end_tick(&mut self, load: Load, can_rise: impl FnOnce() -> bool) {
        if let Self::Reactive(policy) = self {
            policy.end_tick(load, can_rise);
        }
    }
}
