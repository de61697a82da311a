//! Runs of a scene in virtual time, and what is summed over them.

use crate::failure::Failure;
use crate::report::quantile::Quantiles;
use crate::scenes::prepare_models;
use geometry::Wrench;
use glam::DVec3;
use hrtc_core::governor::{CostGroup, MeasuredTick, WorkCosts};
use hrtc_core::record::{CoreRecord, max_or_nan};
use scene::ScenePlan;
use serde::{Serialize, Serializer};
use simulator::{Client, ClientOptions, STATION, Simulation};
use station_core::station::Station;
use ve_station::FileBytes;
use ve_station::database::Database;

/// Ticks from one look at the stop flag to the next.
const LOOK_TICKS: u64 = 256;

/// Mean and quantiles of an error at the contact, metres.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Errors {
    /// Mean.
    #[serde(serialize_with = "in_json")]
    pub mean: f64,
    /// Median, 99th of 100, and the largest.
    #[serde(serialize_with = "in_json")]
    pub p50: f64,
    /// See `p50`.
    #[serde(serialize_with = "in_json")]
    pub p99: f64,
    /// See `p50`.
    #[serde(serialize_with = "in_json")]
    pub max: f64,
}

/// JSON has neither infinity nor what is no number.
fn in_json<S: Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(if value.is_nan() {
        f64::MAX
    } else {
        value.clamp(f64::MIN, f64::MAX)
    })
}

impl Errors {
    fn of(mut errors: Vec<f64>) -> Self {
        let mean = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        let Quantiles { p50, p99, max, .. } = Quantiles::of(&mut errors);
        Self {
            mean,
            p50,
            p99,
            max,
        }
    }
}

/// What came of all runs of a row.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Trial {
    /// Ticks.
    pub ticks: u64,
    /// Ticks in contact, and of these at full resolution.
    pub contact_ticks: u64,
    /// See `contact_ticks`.
    pub contact_full_ticks: u64,
    /// Contact ticks without a certified bound.
    pub contact_unbounded_ticks: u64,
    /// Certified error at the contact, metres, of ticks that have one.
    pub certified_error_m: Errors,
    /// Errors that were measured at the contact; without one there is nothing to compare.
    pub measured_errors: u64,
    /// Measured error at the contact, metres.
    pub measured_error_m: Errors,
    /// Errors that are not above this are rounding, metres: the coordinates of a model are stored
    /// in single precision.
    pub rounding_m: f64,
    /// Mean of what a tick has spent by the costs, in shares of what it might.
    #[serde(serialize_with = "in_json")]
    pub spent_share: f64,
    /// Ticks that spent more than they might.
    pub over_budget_ticks: u64,
    /// Splits and collapses.
    pub operations: u64,
    /// How often the tolerance changed its direction in a second of contact.
    pub turns_per_s: f64,
    /// Largest change of a force in a period, newtons.
    #[serde(serialize_with = "in_json")]
    pub force_step_n_max: f64,
}

impl Trial {
    /// Why it cannot be compared with another one; empty where it can.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        if self.contact_ticks == 0 {
            faults.push("nothing was touched".to_string());
        } else if self.measured_errors == 0 {
            faults.push("no error at a contact was measured".to_string());
        }
        if self.over_budget_ticks > 0 {
            faults.push(format!(
                "{} of {} ticks spent more than they might: the time is not equal",
                self.over_budget_ticks, self.ticks
            ));
        }
        if !self.is_finite() {
            faults.push("a figure is not finite".to_string());
        }
        faults
    }

    fn is_finite(&self) -> bool {
        let errors = [&self.certified_error_m, &self.measured_error_m];
        let of_errors = errors.into_iter().flat_map(|of| [of.mean, of.max]);
        let others = [self.spent_share, self.force_step_n_max];
        of_errors.chain(others).all(f64::is_finite)
    }
}

/// What is summed over the runs of a row.
#[derive(Debug, Default)]
pub struct Sums {
    trial: Trial,
    certified: Vec<f64>,
    measured: Vec<f64>,
    spent: f64,
    turns: u64,
    contact_s: f64,
}

/// The tolerance in contact before, and whether its last change was upwards, if there was one.
type Course = Option<(f64, Option<bool>)>;

impl Sums {
    /// Adds a run; whether it was not stopped before its end.
    ///
    /// # Errors
    /// One sentence when the model cannot be served, or the controller cannot go on with it.
    pub fn run(
        &mut self,
        plan: &ScenePlan,
        slow: f64,
        seconds: f64,
        is_stopped: impl Fn() -> bool,
    ) -> Result<bool, Failure> {
        let served = prepare_models(plan)?;
        let sizes = sizes_m(plan, &served);
        self.trial.rounding_m = sizes.fold(0.0, f64::max) * f64::from(f32::EPSILON);
        let mut simulation = simulation(plan, served, slow, seconds);
        let mut course = None;
        let mut before = vec![Wrench::ZERO; plan.probes.len()];
        for tick in 0..(seconds * plan.loop_.rate_hz).round() as u64 {
            if tick.is_multiple_of(LOOK_TICKS) && is_stopped() {
                return Ok(false);
            }
            let outputs = simulation.step_led();
            self.add(&outputs.record, &mut course, 1.0 / plan.loop_.rate_hz);
            for (now, before) in outputs.wrenches.iter().zip(&mut before) {
                let step = now.force.distance(before.force);
                self.trial.force_step_n_max = max_or_nan(self.trial.force_step_n_max, step);
                *before = *now;
            }
            let spent_ns = outputs.record.spent_ns;
            simulation
                .controller_mut()
                .note_work(MeasuredTick::of_work(spent_ns));
        }
        match simulation.controller().fault() {
            None => Ok(true),
            Some(fault) => Err(Failure::Run(format!("{}: {fault}", plan.name))),
        }
    }

    fn add(&mut self, record: &CoreRecord, course: &mut Course, period_s: f64) {
        let trial = &mut self.trial;
        trial.ticks += 1;
        trial.operations += u64::from(record.vsplits + record.ecols);
        trial.over_budget_ticks += u64::from(record.spent_ns > record.allowed_ns);
        self.spent += f64::from(record.spent_ns) / f64::from(record.allowed_ns);
        // Negative: none arrived. What is no number is kept: it is no error of 0.
        if record.measured_error_m >= 0.0 || record.measured_error_m.is_nan() {
            trial.measured_errors += 1;
            self.measured.push(record.measured_error_m);
        }
        if !record.contact {
            return;
        }
        trial.contact_ticks += 1;
        trial.contact_full_ticks += u64::from(record.contact_full);
        trial.contact_unbounded_ticks += u64::from(!record.contact_bounded);
        self.contact_s += period_s;
        if record.contact_bounded {
            self.certified.push(record.certified_error_m);
        }
        self.turns += u64::from(turns(course, record.finest_tolerance_m));
    }

    /// What came of the runs.
    #[must_use]
    pub fn trial(self) -> Trial {
        Trial {
            certified_error_m: Errors::of(self.certified),
            measured_error_m: Errors::of(self.measured),
            spent_share: self.spent / self.trial.ticks.max(1) as f64,
            turns_per_s: if self.contact_s > 0.0 {
                self.turns as f64 / self.contact_s
            } else {
                0.0
            },
            ..self.trial
        }
    }
}

/// Whether a tolerance turns round; the first change is no turn.
fn turns(course: &mut Course, now: f64) -> bool {
    let Some((last, rose)) = *course else {
        *course = Some((now, None));
        return false;
    };
    if now == last {
        return false;
    }
    *course = Some((now, Some(now > last)));
    rose == Some(now < last)
}

/// Longest side of each object, metres.
fn sizes_m(plan: &ScenePlan, served: &Database) -> impl Iterator<Item = f64> {
    let objects = plan.objects.iter().zip(&served.objects);
    objects.map(|(object, of)| {
        let header = served.models[of.model].file.model_header();
        let sides = DVec3::from_array(header.upper) - DVec3::from_array(header.lower);
        let longest = sides.max_element();
        longest * object.scale.metres_per_unit(longest)
    })
}

/// Both cores on a scene, on a machine whose work takes so many times as long.
fn simulation(
    plan: &ScenePlan,
    served: Database,
    slow: f64,
    seconds: f64,
) -> Simulation<FileBytes> {
    let station = Station::new(STATION, served.models, served.objects);
    let options = ClientOptions {
        tour_s: seconds,
        ..ClientOptions::default()
    };
    let mut simulation = Simulation::new(station, Client::new(plan, options));
    let costs = WorkCosts::REFERENCE.scaled([slow; CostGroup::ALL.len()]);
    simulation.controller_mut().set_costs(costs);
    simulation
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::BUNDLED_SCENE;
    use scene::{ModelSource, NoFiles, Overrides, parse};
    use std::cell::Cell;
    use std::path::Path;

    #[test]
    fn a_run_that_is_stopped_on_its_way_ends_at_the_next_look() {
        let overrides = Overrides::default();
        let plan = parse(BUNDLED_SCENE, "s", Path::new(""), &overrides, &NoFiles);
        let mut plan = plan.expect("the scene is good");
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/sphere.spm");
        plan.objects[0].model = ModelSource::File(file.into());
        let looks = Cell::new(0);
        let is_stopped = || looks.replace(looks.get() + 1) == 1;
        let mut sums = Sums::default();
        assert_eq!(sums.run(&plan, 1.0, 1.0, is_stopped), Ok(false));
        assert_eq!(sums.trial().ticks, LOOK_TICKS);
    }

    #[test]
    fn a_tolerance_that_goes_up_and_down_turns_once_each_time() {
        let mut course = None;
        let tolerances = [0.0, 0.0, 1e-4, 2e-4, 2e-4, 1e-4, 0.0, 0.0, 1e-4];
        let turned = tolerances.map(|now| turns(&mut course, now));
        let places = turned.iter().enumerate().filter(|(_, of)| **of);
        assert_eq!(places.map(|(k, _)| k).collect::<Vec<_>>(), [5, 8]);
        // The first change is none, wherever it goes.
        let mut course = None;
        let turned = [2e-4, 1e-4, 0.0, 1e-4].map(|now| turns(&mut course, now));
        assert_eq!(turned, [false, false, false, true]);
    }

    #[test]
    fn errors_are_those_of_contacts() {
        let mut sums = Sums::default();
        let errors = [(true, 1e-3), (false, 9e-3), (true, 3e-3), (true, f64::NAN)];
        for (contact, certified_error_m) in errors {
            let record = CoreRecord {
                contact,
                certified_error_m,
                contact_bounded: certified_error_m.is_finite(),
                measured_error_m: -1.0,
                allowed_ns: 4,
                spent_ns: 1,
                ..CoreRecord::default()
            };
            sums.add(&record, &mut None, 1e-3);
        }
        let trial = sums.trial();
        assert_eq!((trial.ticks, trial.contact_ticks), (4, 3));
        assert_eq!(trial.contact_unbounded_ticks, 1);
        assert!((trial.certified_error_m.mean - 2e-3).abs() < 1e-12);
        assert_eq!(trial.certified_error_m.max, 3e-3);
        assert_eq!(trial.spent_share, 0.25);
    }

    fn measured(errors: &[f64]) -> Trial {
        let mut sums = Sums::default();
        for &measured_error_m in errors {
            let record = CoreRecord {
                contact: true,
                contact_bounded: true,
                measured_error_m,
                allowed_ns: 4,
                spent_ns: 1,
                ..CoreRecord::default()
            };
            sums.add(&record, &mut None, 1e-3);
        }
        sums.trial()
    }

    #[test]
    fn a_measured_error_that_is_no_number_stays_and_is_a_fault() {
        let sound = measured(&[1e-3, -1.0, 3e-3]);
        assert_eq!(sound.measured_errors, 2);
        assert!((sound.measured_error_m.mean - 2e-3).abs() < 1e-12);
        assert!(sound.faults().is_empty(), "{:?}", sound.faults());
        let odd = measured(&[1e-3, f64::NAN, 3e-3]);
        assert_eq!(odd.measured_errors, 3);
        assert!(odd.measured_error_m.mean.is_nan() && odd.measured_error_m.max.is_nan());
        assert_eq!(odd.faults().len(), 1, "{:?}", odd.faults());
        // JSON has no such number: neither null nor 0 stands for it.
        let json = serde_json::to_value(&odd).expect("it has a JSON");
        assert_eq!(json["measured_error_m"]["mean"], f64::MAX);
    }

    #[test]
    fn a_trial_without_a_touch_or_an_error_or_beyond_its_budget_cannot_be_compared() {
        let sound = measured(&[1e-3]);
        let faults: [fn(&mut Trial); 4] = [
            |trial| trial.contact_ticks = 0,
            |trial| trial.measured_errors = 0,
            |trial| trial.over_budget_ticks = 1,
            |trial| trial.force_step_n_max = f64::NAN,
        ];
        for (index, fault) in faults.into_iter().enumerate() {
            let mut trial = sound.clone();
            fault(&mut trial);
            assert_eq!(trial.faults().len(), 1, "fault {index}");
        }
    }
}
