//! What a tool's ticks come to, and the limits that they keep.

use crate::report::quantile::Quantiles;
use glam::DVec3;
use hrtc_core::record::max_or_nan;
use serde::Serialize;

/// Difference of force from the reference: newtons, or if that is more a share of the reference's
/// force. A hand notices neither (its smallest is 0.05 N, and 7 % of a force).
const DIFFERENCE_N: f64 = 0.05;
const DIFFERENCE_SHARE: f64 = 0.05;
/// Share of the ticks in contact that may differ by more.
const MAX_DIFFERENT: f64 = 0.01;
/// Largest difference in a tick in which no contact was found late, newtons.
const MAX_DIFFERENCE_N: f64 = 0.3;
/// Largest share of the ticks in contact in which one was.
const MAX_LATE: f64 = 1e-3;
/// Rounding of forces, in parts of them: that of some hundred operations.
const ROUNDING: f64 = 256.0 * f64::EPSILON;
/// Distance at which a tool counts as behind its reference, metres, and the largest share of ticks.
const BEHIND_M: f64 = 5e-5;
const MAX_BEHIND: f64 = 0.01;

/// A tick of the product beside that of the reference.
#[derive(Debug, Clone, Copy)]
pub struct TickDifference {
    /// Force of the coupling, newtons.
    pub force: DVec3,
    /// That of the reference.
    pub expected: DVec3,
    /// Distance of the tool from the reference, metres.
    pub behind_m: f64,
    /// Whether a contact was found late.
    pub is_late: bool,
    /// Whether the tool touched.
    pub is_contact: bool,
    /// Whether nothing of the reference's motion remained.
    pub is_settled: bool,
    /// Units of work of all queries.
    pub units: u32,
    /// Motion of the device, metres.
    pub travelled_m: f64,
}

/// A row of the result.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// The model.
    pub model: String,
    /// The tool.
    pub tool: String,
    /// Seed of the tour.
    pub seed: u64,
    /// Ticks.
    pub ticks: u64,
    /// Ticks in contact: every share is of these.
    pub contact_ticks: u64,
    /// Share more than 0.05 mm from the reference.
    pub behind_share: f64,
    /// Share in which a contact was found late.
    pub late_share: f64,
    /// Share whose force differs by more than 0.05 N and 5 %.
    pub different_share: f64,
    /// Share in which the reference itself was not settled after its last step: what a budget costs
    /// is not known there.
    pub reference_unsettled_share: f64,
    /// Difference of the force from the reference, newtons.
    pub force_difference_n: Quantiles,
    /// Its maximum over ticks in which no contact was found late.
    pub difference_not_late_n_max: f64,
    /// Force of the reference, newtons.
    pub force_n: Quantiles,
    /// Largest change of the force from one tick to the next, newtons.
    pub force_step_n_max: f64,
    /// From the force of the tick before to that of the reference.
    pub reference_step_n_max: f64,
    /// Largest change less the stiffness times the motion of the device.
    pub step_beyond_motion_n_max: f64,
    /// Largest change less that and less the reference's from the same force in the same tick,
    /// beyond rounding; 0 where none is.
    pub step_beyond_n_max: f64,
    /// Units of work in a tick in contact.
    pub units: Quantiles,
}

/// What the columns of a table say, and their limits.
#[must_use]
pub fn legend() -> String {
    let percent = |share: f64| 100.0 * share;
    format!(
        "shares are of the ticks in contact\n\
         behind: over {} mm from it, at most {} %; late: a contact was found late, at most {} %\n\
         different: force off by over {DIFFERENCE_N} N and {} %, at most {} %; not late: at most {MAX_DIFFERENCE_N} N\n\
         reference unsettled: it moves on after its last step, so that what unlimited work gives is not known\n\
         beyond: a step of the force less the reference's and less stiffness times the device's motion, at most 0\n",
        1e3 * BEHIND_M,
        percent(MAX_BEHIND),
        percent(MAX_LATE),
        percent(DIFFERENCE_SHARE),
        percent(MAX_DIFFERENT),
    )
}

impl Row {
    /// What one sees of it while others are still measured.
    #[must_use]
    pub fn sentence(&self) -> String {
        let off = self.force_difference_n;
        format!(
            "{} seed {}: behind in {:.2} % of ticks, late in {:.2} %, force off by {:.3} N at p99 and {:.3} N at most",
            self.model,
            self.seed,
            100.0 * self.behind_share,
            100.0 * self.late_share,
            off.p99,
            off.max,
        )
    }

    /// The limits that are not kept.
    #[must_use]
    pub fn broken(&self) -> Vec<&'static str> {
        let checks = [
            (self.different_share <= MAX_DIFFERENT, "force at p99"),
            (
                self.difference_not_late_n_max <= MAX_DIFFERENCE_N,
                "force in one tick",
            ),
            (self.late_share <= MAX_LATE, "late contacts"),
            (self.behind_share <= MAX_BEHIND, "behind"),
            (self.step_beyond_n_max <= 0.0, "force step"),
        ];
        let broken = checks.into_iter().filter(|(is_kept, _)| !is_kept);
        broken.map(|(_, name)| name).collect()
    }
}

/// The ticks of a tool so far.
#[derive(Debug)]
pub struct TickSums {
    row: Row,
    stiffness_n_per_m: f64,
    last: Option<DVec3>,
    differences: Vec<f64>,
    forces: Vec<f64>,
    units: Vec<f64>,
    behind: u64,
    late: u64,
    different: u64,
    unsettled: u64,
}

impl TickSums {
    /// No tick yet. `names`: of the model and of the tool.
    #[must_use]
    pub fn new([model, tool]: [&str; 2], seed: u64, stiffness_n_per_m: f64) -> Self {
        Self {
            row: Row {
                model: model.to_string(),
                tool: tool.to_string(),
                seed,
                ..Row::default()
            },
            stiffness_n_per_m,
            last: None,
            differences: Vec::new(),
            forces: Vec::new(),
            units: Vec::new(),
            behind: 0,
            late: 0,
            different: 0,
            unsettled: 0,
        }
    }

    /// Ticks in contact so far.
    #[must_use]
    pub fn contact_ticks(&self) -> u64 {
        self.row.contact_ticks
    }

    /// A tick without a proxy.
    pub fn skip(&mut self) {
        self.row.ticks += 1;
        self.last = None;
    }

    /// A tick.
    pub fn add(&mut self, tick: &TickDifference) {
        let row = &mut self.row;
        row.ticks += 1;
        let difference = tick.force.distance(tick.expected);
        let unnoticed = DIFFERENCE_N.max(DIFFERENCE_SHARE * tick.expected.length());
        if let Some(last) = self.last.replace(tick.force) {
            let step = tick.force.distance(last);
            let of_motion = self.stiffness_n_per_m * tick.travelled_m;
            let of_reference = tick.expected.distance(last);
            row.force_step_n_max = max_or_nan(row.force_step_n_max, step);
            row.reference_step_n_max = max_or_nan(row.reference_step_n_max, of_reference);
            row.step_beyond_motion_n_max =
                max_or_nan(row.step_beyond_motion_n_max, step - of_motion);
            let rounding = ROUNDING * (last.length() + step + of_reference);
            let beyond = step - of_motion - of_reference - rounding;
            row.step_beyond_n_max = max_or_nan(row.step_beyond_n_max, beyond);
        }
        if !tick.is_contact && difference == 0.0 {
            return;
        }
        row.contact_ticks += 1;
        let is_near = tick.behind_m <= BEHIND_M;
        self.behind += u64::from(!is_near);
        self.late += u64::from(tick.is_late);
        self.unsettled += u64::from(!tick.is_settled);
        if !tick.is_late {
            row.difference_not_late_n_max = max_or_nan(row.difference_not_late_n_max, difference);
        }
        let is_same = difference <= unnoticed;
        self.different += u64::from(!is_same);
        self.differences.push(difference);
        self.forces.push(tick.expected.length());
        self.units.push(f64::from(tick.units));
    }

    /// The row of all ticks.
    #[must_use]
    pub fn row(mut self) -> Row {
        let mut row = self.row;
        let share = |count: u64| count as f64 / row.contact_ticks.max(1) as f64;
        row.behind_share = share(self.behind);
        row.late_share = share(self.late);
        row.different_share = share(self.different);
        row.reference_unsettled_share = share(self.unsettled);
        row.force_difference_n = Quantiles::of(&mut self.differences);
        row.force_n = Quantiles::of(&mut self.forces);
        row.units = Quantiles::of(&mut self.units);
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK: TickDifference = TickDifference {
        force: DVec3::Z,
        expected: DVec3::Z,
        behind_m: 0.0,
        is_late: false,
        is_contact: true,
        is_settled: true,
        units: 10,
        travelled_m: 1e-4,
    };

    fn broken(odd: &TickDifference, count: usize) -> Vec<&'static str> {
        let mut sums = TickSums::new(["model", "tool"], 1, 800.0);
        (0..1000).for_each(|_| sums.add(&TICK));
        (0..count).for_each(|_| sums.add(odd));
        sums.row().broken()
    }

    #[test]
    fn every_limit_is_told_by_its_name() {
        assert!(broken(&TICK, 100).is_empty());
        let late = TickDifference {
            is_late: true,
            ..TICK
        };
        assert!(broken(&late, 1).is_empty());
        assert_eq!(broken(&late, 2), ["late contacts"]);
        let behind = TickDifference {
            behind_m: 6e-5,
            ..TICK
        };
        assert!(broken(&behind, 10).is_empty());
        assert_eq!(broken(&behind, 12), ["behind"]);
        let off = |newtons: f64| TickDifference {
            expected: DVec3::Z * (1.0 + newtons),
            ..TICK
        };
        assert!(broken(&off(0.04), 500).is_empty());
        assert_eq!(broken(&off(0.06), 12), ["force at p99"]);
        assert_eq!(broken(&off(0.4), 1), ["force in one tick"]);
        let jump = TickDifference {
            force: DVec3::Z * 2.0,
            expected: DVec3::Z * 1.8,
            ..TICK
        };
        assert_eq!(broken(&jump, 1), ["force step"]);
    }

    #[test]
    fn a_step_is_judged_beside_that_of_the_reference_in_the_same_tick() {
        let mut sums = TickSums::new(["model", "tool"], 1, 800.0);
        (0..1000).for_each(|_| sums.add(&TICK));
        // Both go by as much in one tick, and back.
        let both = TickDifference {
            force: DVec3::Z * 2.0,
            expected: DVec3::Z * 2.0,
            ..TICK
        };
        sums.add(&both);
        sums.add(&TICK);
        // In another one the reference stands still.
        let alone = TickDifference {
            force: DVec3::Z * 1.25,
            ..TICK
        };
        sums.add(&alone);
        let row = sums.row();
        assert!(row.reference_step_n_max >= 1.0 && row.force_step_n_max <= 1.0);
        assert!((row.step_beyond_n_max - 0.17).abs() < 1e-9, "{row:?}");
        assert_eq!(row.broken(), ["force step"]);
    }

    #[test]
    fn a_reference_that_is_not_settled_is_counted() {
        let mut sums = TickSums::new(["model", "tool"], 1, 800.0);
        for k in 0..1000 {
            sums.add(&TickDifference {
                is_settled: k % 100 > 0,
                ..TICK
            });
        }
        assert_eq!(sums.row().reference_unsettled_share, 0.01);
    }

    #[test]
    fn a_step_of_rounding_is_none_and_any_other_is_one() {
        let step = |newtons: f64| TickDifference {
            force: DVec3::Z * (1.0 + newtons),
            travelled_m: 0.0,
            ..TICK
        };
        assert!(broken(&step(1e-14), 10).is_empty());
        // What a hand may not notice is beyond the reference's, too.
        assert_eq!(broken(&step(1e-3), 1), ["force step"]);
    }

    #[test]
    fn what_is_no_number_keeps_no_limit() {
        let force = TickDifference {
            force: DVec3::NAN,
            behind_m: f64::NAN,
            ..TICK
        };
        let told = ["force in one tick", "force step"];
        assert_eq!(broken(&force, 1), told);
        let told = ["force at p99", told[0], "behind", told[1]];
        assert_eq!(broken(&force, 12), told);
    }
}
