//! A touch with given settings: in virtual time, and as both processes on this machine.

use crate::failure::Failure;
use crate::processes::pair::{PairArgs, Shown, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stop::is_set;
use crate::report::quantile::{Quantiles, median};
use crate::trajectory::stage_times::{STAGES, least_ns_with};
use crate::trajectory::virtual_scene::{make_ready_led, virtual_scene};
use hrtc::result::GovernorResult;
use hrtc::run::FIXED_BYTES;
use hrtc_core::governor::{CostGroup, WorkCosts};
use hrtc_core::record::max_or_nan;
use scene::{Overrides, ScenePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
use simulator::new_controller;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Runs of which a time is the median, since what disturbs one of them is no property of the
/// settings, and an error the largest, since each hand goes another path by microns.
pub const RUNS: usize = 3;
/// Of the ticks in contact, the share that is coarser than asked for in spite of room and time: by
/// so much a trial may exceed one with room for everything.
pub const MORE_COARSER: f64 = 0.01;

/// What settings cost.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Cost {
    /// Largest error that the station measured at a contact, metres.
    pub error_m: f64,
    /// Errors that it measured; without one `error_m` says nothing.
    pub measured_errors: u64,
    /// Processor time of a tick, p99, µs; in virtual time that of undisturbed ticks without the
    /// loop around them, where it was asked for.
    pub time_us: f64,
    /// Bytes received.
    pub bytes: f64,
    /// Bytes of the cache that were in use at most, and of fixed rings and stacks.
    pub memory_bytes: f64,
    /// Records that left the cache for want of room.
    pub evicted: u64,
    /// Share of the ticks in contact with a coarser front asked for than the tolerance, for want of
    /// time or room.
    pub coarser: f64,
    /// Largest certified error at a contact, metres.
    pub certified_m: f64,
}

impl Cost {
    /// Takes in errors at a contact, metres. One that is no number stays: it is no small error.
    fn add_errors(&mut self, measured_m: f64, certified_m: f64) {
        self.error_m = max_or_nan(self.error_m, measured_m);
        self.certified_m = max_or_nan(self.certified_m, certified_m);
    }

    /// # Errors
    /// When an error at a contact was not finite: no limit is kept by it.
    fn check_finite(&self) -> Result<(), Failure> {
        if self.error_m.is_finite() && self.certified_m.is_finite() {
            return Ok(());
        }
        Err(Failure::Run(format!(
            "an error at a contact is not finite: {} m measured, {} m certified",
            self.error_m, self.certified_m
        )))
    }
}

/// How a touch in virtual time is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// On the reference machine.
    Plain,
    /// There, and its ticks are timed.
    Timed,
    /// On a machine with these costs.
    On(WorkCosts),
}

/// A touch by both processes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// What it cost.
    pub cost: Cost,
    /// This machine, as the governor saw it.
    pub machine: WorkCosts,
}

impl Run {
    /// A machine that takes so many times as long.
    #[must_use]
    pub fn slower(&self, factor: f64) -> WorkCosts {
        self.machine.scaled([factor; CostGroup::ALL.len()])
    }
}

/// The costs that ticks really had; those of the reference machine where none were measured.
fn machine(governor: &GovernorResult) -> WorkCosts {
    let named = serde_json::to_value(&governor.unit_ns).ok();
    let measured: Option<WorkCosts> = named.and_then(|of| serde_json::from_value(of).ok());
    let slowness = governor.slowness.p50;
    measured
        .map(|costs| costs.scaled([slowness; CostGroup::ALL.len()]))
        .filter(WorkCosts::is_valid)
        .unwrap_or(WorkCosts::REFERENCE)
}

/// A scene, and how it is tried.
pub struct Bench<'a> {
    /// The scene file.
    pub scene: &'a Path,
    /// Over it.
    pub overrides: &'a OverrideArgs,
    /// Length of a run, seconds.
    pub seconds: f64,
    /// Ends a run early.
    pub stop: &'a AtomicBool,
}

/// What is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Expected error wanted at the contact, metres.
    pub tolerance_m: f64,
    /// Bytes of the cache.
    pub cache_bytes: usize,
}

impl Bench<'_> {
    /// The command line's values with these settings.
    fn with(&self, settings: Settings) -> OverrideArgs {
        OverrideArgs {
            tolerance: Some(settings.tolerance_m),
            cache: Some(settings.cache_bytes.to_string()),
            ..self.overrides.clone()
        }
    }

    /// The scene's plan.
    ///
    /// # Errors
    /// When the scene is refused.
    pub fn plan(&self, overrides: &Overrides) -> Result<ScenePlan, Failure> {
        Ok(load(self.scene, overrides, &DiskFiles)?)
    }

    /// # Errors
    /// When the search is to end: what was cut short tells nothing of the settings.
    fn check_stop(&self) -> Result<(), Failure> {
        if is_set(self.stop) {
            return Err(Failure::Run("ended on request".to_string()));
        }
        Ok(())
    }

    /// A touch in virtual time: the hands are those of the scene, the loop is closed.
    ///
    /// # Errors
    /// When the scene cannot be served, nothing is touched, or the search is to end.
    pub fn simulate(&self, settings: Settings, mode: Mode) -> Result<Cost, Failure> {
        self.check_stop()?;
        let plan = self.plan(&self.with(settings).overrides())?;
        let failed = |what: &str| Failure::Run(format!("{}: {what}", plan.name));
        let (mut simulation, options) = virtual_scene(&plan, self.seconds)?;
        match mode {
            Mode::Plain => {}
            Mode::Timed => simulation.client_mut().record(),
            Mode::On(costs) => simulation.controller_mut().set_costs(costs),
        }
        let start = make_ready_led(&mut simulation)? as usize;
        let mut cost = Cost::default();
        let (mut touching, mut coarser) = (0u64, 0u64);
        for _ in 0..(self.seconds * plan.loop_.rate_hz) as u64 {
            let record = simulation.step_led().record;
            cost.add_errors(record.measured_error_m, record.certified_error_m);
            // Negative: none came in this tick.
            cost.measured_errors += u64::from(record.measured_error_m >= 0.0);
            if record.contact {
                touching += 1;
                coarser += u64::from(!record.contact_asked);
            }
        }
        if touching == 0 {
            // Such as a cache that is too small for a base mesh.
            let fault = simulation
                .controller()
                .fault()
                .map(|fault| fault.to_string());
            return Err(failed(fault.as_deref().unwrap_or(NOTHING_TOUCHED)));
        }
        cost.check_finite()?;
        let high_water = simulation.controller().bytes_high_water();
        let record = simulation.outputs().record;
        cost.bytes = record.bytes_received as f64;
        cost.evicted = record.evicted;
        cost.memory_bytes = (high_water + FIXED_BYTES) as f64;
        cost.coarser = coarser as f64 / touching as f64;
        if let Some(recording) = simulation.client_mut().take_recording() {
            let fresh = |_| new_controller(&plan, &options);
            let least = least_ns_with(&[(&recording, &plan)], &fresh)?.swap_remove(0);
            let whole = |ns: &[u32; STAGES]| ns.iter().map(|&ns| f64::from(ns)).sum::<f64>();
            let mut us: Vec<f64> = least[start..].iter().map(|ns| whole(ns) * 1e-3).collect();
            cost.time_us = Quantiles::of(&mut us).p99;
        }
        Ok(cost)
    }

    /// Both processes on this machine, several times where the time counts: the largest
    /// errors, bytes and memory, and the median of the times.
    ///
    /// # Errors
    /// When a process fails, nothing is touched, or the search is to end.
    pub fn run(&self, settings: Settings, runs: usize) -> Result<Run, Failure> {
        let overrides = self.with(settings);
        let plan = self.plan(&overrides.overrides())?;
        let pair = PairArgs {
            scene: self.scene,
            plan: &plan,
            seconds: self.seconds,
            overrides: &overrides,
            loop_: LoopArgs::default(),
            record: None,
            device: None,
        };
        let mut times = Vec::new();
        let mut cost = Cost::default();
        let mut seen = WorkCosts::REFERENCE;
        for _ in 0..runs {
            let outcome = run_pair(&pair, self.stop, &mut |_: Shown<'_>| ());
            self.check_stop()?;
            let outcome = outcome?;
            outcome.check_finite()?;
            let result = &outcome.undisturbed()?.result;
            if result.contact_ticks == 0 {
                return Err(Failure::Run(format!("{}: {NOTHING_TOUCHED}", plan.name)));
            }
            times.push(result.work_us.p99);
            seen = machine(&result.governor);
            cost.bytes = cost.bytes.max(result.bytes_received as f64);
            // A contact without a bound keeps no limit.
            let certified_m = match result.contact_unbounded_ticks {
                0 => result.certified_error_m.max,
                _ => f64::NAN,
            };
            cost.add_errors(result.measured_error_m.max, certified_m);
            cost.measured_errors += result.measured_errors;
            let coarser = result.coarser_ticks as f64 / result.contact_ticks as f64;
            cost.coarser = cost.coarser.max(coarser);
            let memory = (result.cache.high_water_bytes as usize + FIXED_BYTES) as f64;
            cost.memory_bytes = cost.memory_bytes.max(memory);
            cost.evicted = cost.evicted.max(result.cache.evicted);
        }
        cost.check_finite()?;
        cost.time_us = median(&times);
        Ok(Run {
            cost,
            machine: seen,
        })
    }
}

const NOTHING_TOUCHED: &str = "nothing is touched, so nothing can be tuned; give a scene whose probe has a \
    trajectory, or more with --seconds";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_search_that_is_to_end_says_so() {
        let stop = AtomicBool::new(true);
        let bench = Bench {
            scene: Path::new("nowhere.toml"),
            overrides: &OverrideArgs::default(),
            seconds: 1.0,
            stop: &stop,
        };
        let settings = Settings {
            tolerance_m: 1e-4,
            cache_bytes: 1 << 20,
        };
        let ended = bench.simulate(settings, Mode::Plain);
        assert_eq!(ended, Err(Failure::Run("ended on request".to_string())));
    }

    #[test]
    fn an_error_that_is_no_number_stays_and_is_a_failure() {
        let of = |errors: &[[f64; 2]]| {
            let mut cost = Cost::default();
            for &[measured_m, certified_m] in errors {
                cost.add_errors(measured_m, certified_m);
            }
            cost
        };
        // Negative: none was measured in that tick.
        let sound = of(&[[-1.0, 2e-3], [1e-4, 1e-3], [-1.0, 0.0]]);
        assert_eq!((sound.error_m, sound.certified_m), (1e-4, 2e-3));
        assert_eq!(sound.check_finite(), Ok(()));
        let no_error = of(&[[1e-4, 1e-3], [f64::NAN, 1e-3], [1e-4, 1e-3]]);
        assert!(no_error.error_m.is_nan() && no_error.check_finite().is_err());
        let no_bound = of(&[[1e-4, f64::NAN], [1e-4, 1e-3]]);
        assert!(no_bound.certified_m.is_nan() && no_bound.check_finite().is_err());
    }
}
