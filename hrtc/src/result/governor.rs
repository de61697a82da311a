//! What the governor gave to the ticks of a run.

use super::MedianMax;
use super::fixed::Fixed;
use crate::time_answers::TimeAnswers;
use hrtc_core::Timed;
use hrtc_core::governor::WorkCosts;
use hrtc_core::record::CoreRecord;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Median and least of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MedianMin {
    /// Median.
    pub p50: f64,
    /// Least.
    pub min: f64,
}

/// The governor of a run.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct GovernorResult {
    /// Cost of each unit of counted work on this machine, ns, measured before the first tick.
    pub unit_ns: BTreeMap<String, f64>,
    /// Splits and collapses a tick that there was time for.
    pub budget_units: MedianMin,
    /// What a tick might spend by the costs, microseconds.
    pub allowed_us: MedianMin,
    /// Ticks that spent more than that.
    pub over_budget_ticks: u64,
    /// Ticks in which the time for refinement, and for the contacts, was over before they were done
    /// ([`hrtc_core::Timed`]).
    pub out_of_time_ticks: [u64; Timed::ALL.len()],
    /// How many times as long the ticks took as the costs said.
    pub slowness: MedianMax,
    /// Share of its period that a tick might spend: late ticks lower it.
    pub time_share: MedianMin,
    /// Finest expected error that was asked for in contact, metres.
    pub tolerance_m: MedianMax,
    /// How often that tolerance changed its direction in a second of contact.
    pub reversals_per_s: f64,
}

/// The governor's figures so far.
pub(super) struct GovernorStats {
    operations: Fixed,
    allowed_us: Fixed,
    slowness: Fixed,
    time_share: Fixed,
    least_time_share: f64,
    tolerance_um: Fixed,
    least_operations: f64,
    least_allowed_us: f64,
    over_budget_ticks: u64,
    out_of_time_ticks: [u64; Timed::ALL.len()],
    contact_ticks: u64,
    reversals: u64,
    /// The last tolerance in contact, and whether its last change was upwards.
    last: Option<(f64, Option<bool>)>,
}

impl GovernorStats {
    pub(super) fn new() -> Self {
        Self {
            operations: Fixed::new(10.0, 17),
            allowed_us: Fixed::new(10.0, 17),
            slowness: Fixed::new(100.0, 14),
            time_share: Fixed::new(1000.0, 10),
            least_time_share: f64::INFINITY,
            tolerance_um: Fixed::new(10.0, 24),
            least_operations: f64::INFINITY,
            least_allowed_us: f64::INFINITY,
            over_budget_ticks: 0,
            out_of_time_ticks: [0; Timed::ALL.len()],
            contact_ticks: 0,
            reversals: 0,
            last: None,
        }
    }

    pub(super) fn push(&mut self, core: &CoreRecord, time: TimeAnswers) {
        let allowed_us = 1e-3 * f64::from(core.allowed_ns);
        self.operations.push(core.operations);
        self.allowed_us.push(allowed_us);
        self.slowness.push(core.slowness);
        self.time_share.push(core.time_share);
        self.least_time_share = self.least_time_share.min(core.time_share);
        self.least_operations = self.least_operations.min(core.operations);
        self.least_allowed_us = self.least_allowed_us.min(allowed_us);
        self.over_budget_ticks += u64::from(core.spent_ns > core.allowed_ns);
        for kind in Timed::ALL {
            self.out_of_time_ticks[kind as usize] += u64::from(time.was_over(kind));
        }
        if !core.contact {
            return;
        }
        self.contact_ticks += 1;
        let now = core.finest_tolerance_m;
        self.tolerance_um.push(1e6 * now);
        self.last = match self.last {
            Some((last, rose)) if now != last => {
                // The first change is no reversal of one before.
                self.reversals += u64::from(rose == Some(now < last));
                Some((now, Some(now > last)))
            }
            None => Some((now, None)),
            same => same,
        };
    }

    /// The result of a run with these costs, in ticks of a period, ns.
    pub(super) fn result(&self, costs: &WorkCosts, period_ns: u64) -> GovernorResult {
        let least = |value: f64| if value.is_finite() { value } else { 0.0 };
        let contact_s = 1e-9 * (self.contact_ticks * period_ns) as f64;
        let named = costs.named().into_iter();
        GovernorResult {
            unit_ns: named.map(|(name, ns)| (name.to_owned(), ns)).collect(),
            budget_units: MedianMin {
                p50: self.operations.spread().p50,
                min: least(self.least_operations),
            },
            allowed_us: MedianMin {
                p50: self.allowed_us.spread().p50,
                min: least(self.least_allowed_us),
            },
            over_budget_ticks: self.over_budget_ticks,
            out_of_time_ticks: self.out_of_time_ticks,
            slowness: most(&self.slowness, 1.0),
            time_share: MedianMin {
                p50: self.time_share.spread().p50,
                min: least(self.least_time_share),
            },
            tolerance_m: most(&self.tolerance_um, 1e-6),
            reversals_per_s: if contact_s > 0.0 {
                self.reversals as f64 / contact_s
            } else {
                0.0
            },
        }
    }
}

fn most(of: &Fixed, unit: f64) -> MedianMax {
    let spread = of.spread();
    MedianMax {
        p50: unit * spread.p50,
        max: unit * spread.max,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tolerance_that_goes_up_and_down_is_reversed_once_a_turn() {
        let mut stats = GovernorStats::new();
        for (tick, tolerance_m) in [0.0, 0.0, 1e-4, 1e-4, 0.0, 1e-4, 2e-4]
            .into_iter()
            .enumerate()
        {
            let core = CoreRecord {
                contact: true,
                finest_tolerance_m: tolerance_m,
                allowed_ns: 600_000,
                spent_ns: if tick == 2 { 700_000 } else { 100_000 },
                operations: 96.0 - tick as f64,
                slowness: 1.0,
                time_share: 0.7 - 0.01 * tick as f64,
                ..CoreRecord::default()
            };
            let time = if tick == 3 {
                TimeAnswers([TimeAnswers::ALWAYS, 5])
            } else {
                TimeAnswers::default()
            };
            stats.push(&core, time);
        }
        let result = stats.result(&WorkCosts::REFERENCE, 1_000_000);
        // A touch that begins coarse and is refined goes one way.
        let mut once = GovernorStats::new();
        for finest_tolerance_m in [2e-4, 1e-4, 0.0] {
            let core = CoreRecord {
                contact: true,
                finest_tolerance_m,
                ..CoreRecord::default()
            };
            once.push(&core, TimeAnswers::default());
        }
        assert_eq!(once.reversals, 0);
        // Down after the first rise, and up again.
        assert!((result.reversals_per_s - 2.0 / 7e-3).abs() < 1e-6);
        assert_eq!(result.over_budget_ticks, 1);
        assert_eq!(result.out_of_time_ticks, [0, 1]);
        assert_eq!(result.budget_units.min, 90.0);
        assert!((result.time_share.min - 0.64).abs() < 1e-9);
        assert!((result.tolerance_m.max - 2e-4).abs() < 1e-9);
    }
}
