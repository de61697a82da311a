//! What is asked of each link, and whether it was met.

use super::result::Row;
use crate::links::points::{Guest, Point};
use crate::report::units::{digits, length, percent};
use serde::Serialize;
use std::fmt;

/// How much less full resolution than the local run's counts as the same: 0.1 points of 100.
const AS_LOCAL: f64 = 0.001;
/// Largest change of the force a period, of the local run's.
const STEP_OF_LOCAL: f64 = 1.5;
/// Time from the first heartbeat to a touch that is ready, and from there to full resolution, ms.
const READY_MS: f64 = 500.0;
const FULL_MS: f64 = 1000.0;

/// What is asked of the share of full resolution.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Full {
    /// That of the local run.
    AsLocal,
    /// So much, 0 to 1.
    Share(f64),
    /// Nothing: it is stated.
    Stated,
}

/// A link, and what is asked of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    point: Point,
    full: Full,
    also: Also,
}

/// What is asked beside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Also {
    Nothing,
    /// The hand rests in the second half: the error falls there, in the same epoch.
    Rests,
    /// The touch is ready soon after the station was heard, and full soon after that.
    Soon,
}

const fn full(rtt_ms: f64, mbit: f64, full: Full) -> Asked {
    Asked {
        point: Point::new(rtt_ms, mbit),
        full,
        also: Also::Nothing,
    }
}

const fn losing(asked: Asked) -> Asked {
    let point = asked.point.losing(0.01);
    Asked { point, ..asked }
}

/// The links, in the order of their distance.
pub const ASKED: [Asked; 9] = [
    losing(full(1.0, 100.0, Full::AsLocal)),
    losing(full(20.0, 100.0, Full::AsLocal)),
    full(100.0, 100.0, Full::Share(0.99)),
    losing(full(100.0, 100.0, Full::Stated)),
    full(200.0, 100.0, Full::Share(0.97)),
    losing(full(200.0, 100.0, Full::Stated)),
    full(20.0, 10.0, Full::AsLocal),
    full(20.0, 2.0, Full::Share(0.99)),
    Asked {
        also: Also::Rests,
        ..full(100.0, 0.25, Full::Stated)
    },
];

/// What is asked of a large terrain.
pub const TERRAIN: Asked = Asked {
    also: Also::Soon,
    ..full(20.0, 10.0, Full::Stated)
};

/// What is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Share of the contact at full resolution, 0 to 1.
    FullShare,
    /// Largest change of the force a period, newtons.
    ForceStepN,
    /// Share of the compared ticks with the local run's force, 0 to 1.
    SameForceShare,
    /// Periods missed by own work or own waiting.
    MissedOwnCpu,
    /// Ticks in contact without a certified error.
    ContactUnboundedTicks,
    /// Times that the exchange with the station began anew.
    Resubscribed,
    /// Certified error at the end of the hand's rest, metres; its limit is that at the start, and
    /// it is below, unless both are 0.
    RestErrorM,
    /// Time from the first heartbeat heard to the first tick that could render a contact,
    /// milliseconds.
    ReadyMs,
    /// Time from there to the first contact at full resolution, milliseconds, without the hand's
    /// way to the contact on one machine.
    FullMs,
}

/// A limit, and what was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Criterion {
    /// Of what.
    pub quantity: Quantity,
    /// The limit; none where the local run gives none.
    pub limit: Option<f64>,
    /// What was seen; none without a contact.
    pub seen: Option<f64>,
    /// Whether it was met.
    pub met: bool,
}

impl Criterion {
    fn new(quantity: Quantity, limit: Option<f64>, seen: Option<f64>) -> Self {
        let is_within = |(limit, seen): (f64, f64)| match quantity {
            Quantity::FullShare | Quantity::SameForceShare => seen >= limit,
            Quantity::RestErrorM => seen < limit || seen == 0.0,
            _ => seen <= limit,
        };
        Self {
            quantity,
            limit,
            seen,
            met: limit.zip(seen).is_some_and(is_within),
        }
    }
}

impl fmt::Display for Criterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        type Unit = fn(f64) -> String;
        // Never rounded up.
        let share: Unit = |share| percent((share * 1e9) as u64, 1_000_000_000);
        let newtons: Unit = |n| format!("{} N", digits(n));
        let ms: Unit = |time| format!("{} ms", digits(time));
        let (what, bound, unit): (&str, &str, Unit) = match self.quantity {
            Quantity::FullShare => ("full resolution", "at least", share),
            Quantity::ForceStepN => ("force step", "at most", newtons),
            Quantity::SameForceShare => ("forces within 1 % of the local run's", "at least", share),
            Quantity::MissedOwnCpu => ("own misses", "at most", digits),
            Quantity::ContactUnboundedTicks => {
                ("ticks without a certified error", "at most", digits)
            }
            Quantity::Resubscribed => ("begun anew", "at most", digits),
            Quantity::RestErrorM if self.limit == Some(0.0) => {
                ("error after the rest", "at most", length)
            }
            Quantity::RestErrorM => ("error after the rest", "below", length),
            Quantity::ReadyMs => ("ready after the first heartbeat", "at most", ms),
            Quantity::FullMs => (
                "full resolution after that and the hand's way",
                "at most",
                ms,
            ),
        };
        let or_none = |number: Option<f64>| number.map_or("none".to_string(), unit);
        let (limit, seen) = (or_none(self.limit), or_none(self.seen));
        let met = if self.met { "met" } else { "NOT MET" };
        write!(f, "{what}: asked {bound} {limit}, seen {seen}: {met}")
    }
}

impl Asked {
    /// The controller of the link.
    #[must_use]
    pub const fn guest(&self) -> Guest {
        Guest {
            rests: matches!(self.also, Also::Rests),
            ..Guest::at(self.point)
        }
    }

    /// What is asked of a touch over the link, beside the local one.
    #[must_use]
    pub fn judge(&self, local: &Row, row: &Row) -> Vec<Criterion> {
        let as_local = |share: f64| share - AS_LOCAL;
        let full = match self.full {
            Full::AsLocal => Some(local.full_share.map(as_local)),
            Full::Share(share) => Some(Some(share)),
            Full::Stated => None,
        };
        let mut all = Vec::new();
        all.extend(full.map(|limit| Criterion::new(Quantity::FullShare, limit, row.full_share)));
        all.extend(common(Some(local), row));
        // A hand that rests follows a shorter path, which is another.
        if self.also != Also::Rests {
            let same = row.forces.and_then(|forces| forces.same_share);
            all.push(Criterion::new(Quantity::SameForceShare, Some(1.0), same));
        }
        match self.also {
            Also::Nothing => {}
            Also::Rests => {
                let from_m = row.rest.and_then(|rest| rest.from_m);
                let to_m = row.rest.and_then(|rest| rest.to_m);
                all.push(Criterion::new(Quantity::RestErrorM, from_m, to_m));
                all.push(none(row, Quantity::Resubscribed, row.resubscribed));
            }
            Also::Soon => {
                let since = |start: Option<f64>, end: Option<f64>| Some(end? - start?);
                let ready = since(row.heard_ms, row.first_force_ready_ms);
                let touch = |of: &Row| since(of.first_force_ready_ms, of.first_touch_ms);
                let beyond = since(touch(local), touch(row));
                let full = beyond.zip(row.local_full_ms).map(|(to, on)| to + on);
                all.push(Criterion::new(Quantity::ReadyMs, Some(READY_MS), ready));
                all.push(Criterion::new(Quantity::FullMs, Some(FULL_MS), full));
            }
        }
        all
    }
}

/// What is asked of a controller beside others, by its touch alone over the same link; where there
/// was none, what that limits is not met.
#[must_use]
pub fn judge_as_alone(alone: Option<&Row>, row: &Row) -> Vec<Criterion> {
    let limit = alone.and_then(|alone| alone.full_share);
    let limit = limit.map(|share| share - AS_LOCAL);
    let full = Criterion::new(Quantity::FullShare, limit, row.full_share);
    [full].into_iter().chain(common(alone, row)).collect()
}

/// What is asked of every touch, beside another.
fn common(other: Option<&Row>, row: &Row) -> [Criterion; 3] {
    let other = other.filter(|other| other.contact_ticks > 0);
    let step = other.map(|other| STEP_OF_LOCAL * other.force_step_per_period_n_max);
    let seen = (row.contact_ticks > 0).then_some(row.force_step_per_period_n_max);
    let mut misses = none(row, Quantity::MissedOwnCpu, row.missed_own_cpu);
    // Periods without a record may have been missed too.
    misses.met &= row.unaccounted_periods == 0;
    [
        Criterion::new(Quantity::ForceStepN, step, seen),
        misses,
        none(
            row,
            Quantity::ContactUnboundedTicks,
            row.contact_unbounded_ticks,
        ),
    ]
}

/// There must be none.
fn none(row: &Row, quantity: Quantity, count: u64) -> Criterion {
    let seen = (row.contact_ticks > 0).then_some(count as f64);
    Criterion::new(quantity, Some(0.0), seen)
}

#[cfg(test)]
mod tests {
    use super::super::recorded::{Forces, Rest};
    use super::*;
    use hrtc::result::{Finished, RunResult};

    fn row(full_ticks: u64, force_step_per_period_n_max: f64) -> Row {
        let mut row = Row::of(Finished {
            result: RunResult {
                contact_ticks: 10_000,
                contact_full_ticks: full_ticks,
                force_step_per_period_n_max,
                ..RunResult::default()
            },
            ..Finished::default()
        });
        row.forces = Some(Forces {
            same_share: Some(1.0),
            ..Forces::default()
        });
        row
    }

    fn not_met(asked: &Asked, row: &Row) -> Vec<Quantity> {
        let mut local = self::row(9995, 0.2);
        local.first_force_ready_ms = Some(50.0);
        local.first_touch_ms = Some(2050.0);
        let limits = asked.judge(&local, row);
        let not_met = limits.into_iter().filter(|limit| !limit.met);
        not_met.map(|limit| limit.quantity).collect()
    }

    #[test]
    fn a_share_is_that_of_the_local_run_or_one_of_its_own() {
        let as_local = full(20.0, 10.0, Full::AsLocal);
        assert_eq!(not_met(&as_local, &row(9985, 0.3)), []);
        assert_eq!(not_met(&as_local, &row(9984, 0.3)), [Quantity::FullShare]);
        let share = full(200.0, 100.0, Full::Share(0.97));
        assert_eq!(not_met(&share, &row(9700, 0.3)), []);
        assert_eq!(not_met(&share, &row(9699, 0.3)), [Quantity::FullShare]);
        let stated = losing(full(200.0, 100.0, Full::Stated));
        assert_eq!(not_met(&stated, &row(1, 0.3)), []);
    }

    #[test]
    fn steps_misses_and_forces_are_limited_on_every_link() {
        for asked in &ASKED[..8] {
            let mut row = row(10_000, 0.301);
            row.missed_own_cpu = 1;
            row.contact_unbounded_ticks = 1;
            row.forces = Some(Forces::default());
            let expected = [
                Quantity::ForceStepN,
                Quantity::MissedOwnCpu,
                Quantity::ContactUnboundedTicks,
                Quantity::SameForceShare,
            ];
            assert_eq!(not_met(asked, &row), expected);
        }
    }

    #[test]
    fn periods_without_a_record_are_not_taken_for_ones_that_were_not_missed() {
        let mut row = row(10_000, 0.3);
        row.unaccounted_periods = 1;
        assert_eq!(not_met(&ASKED[0], &row), [Quantity::MissedOwnCpu]);
    }

    #[test]
    fn the_error_falls_where_the_hand_rests_in_one_epoch() {
        let slow = &ASKED[8];
        let rest = |from_m, to_m| {
            let periods = 4000;
            Rest {
                periods,
                from_m,
                to_m,
            }
        };
        let mut row = row(10_000, 0.3);
        let failed = [Quantity::RestErrorM];
        for (of, expected) in [
            (None, &failed[..]),
            (Some(rest(Some(1e-3), Some(1e-4))), &[]),
            (Some(rest(Some(0.0), Some(0.0))), &[]),
            (Some(rest(Some(1e-3), Some(1e-3))), &failed),
            (Some(rest(Some(1e-3), None)), &failed),
            (Some(rest(None, Some(0.0))), &failed),
        ] {
            row.rest = of;
            assert_eq!(not_met(slow, &row), expected, "{of:?}");
        }
        row.rest = Some(rest(Some(1e-3), Some(1e-4)));
        row.resubscribed = 1;
        assert_eq!(not_met(slow, &row), [Quantity::Resubscribed]);
    }

    #[test]
    fn a_large_terrain_is_ready_and_full_soon() {
        let mut row = row(10_000, 0.3);
        row.heard_ms = Some(100.0);
        row.first_force_ready_ms = Some(600.0);
        row.first_touch_ms = Some(2900.0);
        row.local_full_ms = Some(700.0);
        assert_eq!(not_met(&TERRAIN, &row), []);
        row.first_force_ready_ms = Some(600.5);
        row.local_full_ms = Some(701.0);
        let soon = [Quantity::ReadyMs, Quantity::FullMs];
        assert_eq!(not_met(&TERRAIN, &row), soon);
        row.local_full_ms = None;
        assert_eq!(not_met(&TERRAIN, &row), soon);
    }

    #[test]
    fn beside_others_a_controller_touches_as_alone() {
        let alone = row(9000, 0.2);
        let not_met = |row: &Row| {
            let limits = judge_as_alone(Some(&alone), row).into_iter();
            let not_met = limits.filter(|limit| !limit.met);
            not_met.map(|limit| limit.quantity).collect::<Vec<_>>()
        };
        assert_eq!(not_met(&row(8990, 0.3)), []);
        let both = [Quantity::FullShare, Quantity::ForceStepN];
        assert_eq!(not_met(&row(8989, 0.31)), both);
    }

    #[test]
    fn a_touch_that_never_was_meets_nothing() {
        let mut none = row(0, 0.0);
        (none.contact_ticks, none.full_share, none.forces) = (0, None, None);
        for asked in &ASKED {
            assert!(
                asked
                    .judge(&row(9995, 0.2), &none)
                    .iter()
                    .all(|limit| !limit.met)
            );
        }
    }

    #[test]
    fn a_limit_is_told_with_what_was_seen() {
        let limits = ASKED[2].judge(&row(9995, 0.2), &row(9899, 0.25));
        let told: Vec<String> = limits.iter().map(ToString::to_string).collect();
        let expected = "full resolution: asked at least 99.00 %, seen 98.99 %: NOT MET";
        assert_eq!(told[0], expected);
        assert_eq!(told[1], "force step: asked at most 0.3 N, seen 0.25 N: met");
    }
}
