//! `rt-tests check`: what this machine is good for in haptics, in a minute on one screen: a verdict
//! and a remedy a line.
//!
//! | line | measured by |
//! |---|---|
//! | wake-ups | bare loops of 1, 2 and 4 kHz with the rights of the controller |
//! | rights, interrupts | what these loops were denied, and what the kernel counts on their core |
//! | work, force, speed | both processes on the scene, with the stamps of its device |
//!
//! The stiffest wall is that of theory at the period and delay that were measured (`rt-tests
//! zwidth` simulates it); the greatest speed is the controller's own estimate for the scene's
//! model.

mod line;

pub use line::{Line, Verdict};

use crate::commands::zwidth::{measure_until, plate};
use crate::failure::Failure;
use crate::machine::Machine;
use crate::processes::bare_loop::{BareWork, run_bare};
use crate::processes::pair::{Shown, other_core};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print_either, status_line};
use crate::report::table::Table;
use crate::scenes::{SceneFile, prepare_models};
use clap::Args;
use hrtc::result::Finished;
use hrtc::run::next_tick_core;
use scene::{ScenePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Rates of the bare loops, Hz, and the length of each, seconds.
const RATES_HZ: [f64; 3] = [1000.0, 2000.0, 4000.0];
const LOOP_S: f64 = 10.0;
/// Length of the touch, seconds.
const TOUCH_S: f64 = 15.0;

/// Arguments of `rt-tests check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// The scene whose loop, device and model are asked about [default: the bundled first-touch
    /// scene]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Check {
    /// The machine.
    pub machine: Machine,
    /// The worst verdict of all lines.
    pub verdict: Verdict,
    /// Highest rate up to which all wake-ups are good, Hz; 0 for none.
    pub rate_hz: f64,
    /// Stiffest wall, N/m.
    pub k_max_n_per_m: f64,
    /// Greatest speed at full resolution, m/s.
    pub greatest_speed_m_per_s: f64,
    /// The lines.
    pub lines: Vec<Line>,
}

/// Runs the command.
///
/// # Errors
/// One sentence when something cannot be measured; a bad machine is no error.
pub fn check(args: &CheckArgs) -> Result<(), Failure> {
    // Nothing is temporary yet, so that a request to end still ends a long build at once. Built
    // models are kept: below they are only opened.
    if let Some(scene) = &args.scene {
        prepare_models(&load(scene, &args.overrides.overrides(), &DiskFiles)?)?;
    }
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let plan = load(scene.path(), &args.overrides.overrides(), &DiskFiles)?;
    prepare_models(&plan)?;
    check_stop(&stop)?;
    let progress = status_line();
    let mut lines = Vec::new();
    for rate in RATES_HZ {
        progress.set_message(format!("a bare loop of {rate} Hz for {LOOP_S} s"));
        let finished = bare(&plan, rate, &stop)?;
        lines.push(Line::wake_up(rate, &finished.result));
    }
    let verdicts = lines.iter().map(|line| line.verdict);
    let rate_hz = good_up_to(RATES_HZ.into_iter().zip(verdicts));
    progress.set_message(format!("a touch of both processes for {TOUCH_S} s"));
    // What the processes say of rights and misses is in the lines.
    let mut show = |_: Shown<'_>| ();
    let (path, overrides) = (scene.path(), &args.overrides);
    let (measured, finished) = measure_until(path, &plan, overrides, TOUCH_S, &mut show, &stop)?;
    progress.finish_and_clear();
    let device = &plan.probes[0].device;
    let k_max_n_per_m = plate(&measured, device, device.damping_ns_per_m).theory();
    lines.push(Line::rights(&finished.rights));
    lines.push(Line::interrupts(next_tick_core(&plan.loop_)));
    lines.push(Line::work(plan.loop_.rate_hz, &finished.result));
    lines.push(Line::force(&plan, &measured, k_max_n_per_m));
    lines.push(Line::speed(&plan, &finished.result));
    let found = Check {
        machine: Machine::read(),
        verdict: lines
            .iter()
            .map(|line| line.verdict)
            .max()
            .unwrap_or_default(),
        rate_hz,
        k_max_n_per_m,
        greatest_speed_m_per_s: finished.result.greatest_speed_m_per_s,
        lines,
    };
    print_either(args.json, &words(&found), &found)
}

/// The highest of ascending rates up to which each is good, Hz; 0 for none.
fn good_up_to(rates: impl Iterator<Item = (f64, Verdict)>) -> f64 {
    let good = rates.take_while(|(_, verdict)| *verdict == Verdict::Good);
    good.last().map_or(0.0, |(rate_hz, _)| rate_hz)
}

/// A bare loop of this rate.
fn bare(plan: &ScenePlan, rate_hz: f64, stop: &AtomicBool) -> Result<Finished, Failure> {
    let mut loop_ = plan.loop_.at_rate(rate_hz);
    loop_.spin_us = 0;
    let empty = BareWork { ns: 0, slow: 1.0 };
    let finished = run_bare(&loop_, other_core(plan), LOOP_S, empty, stop);
    check_stop(stop)?;
    finished
}

/// # Errors
/// When the command is to end: what was cut short is no measure.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

fn words(found: &Check) -> String {
    let mut table = Table::new(3, "what | verdict | measured");
    for line in &found.lines {
        table.row([
            line.name.clone(),
            line.verdict.word().to_string(),
            line.says.clone(),
        ]);
    }
    let machine = &found.machine;
    let mut text = format!(
        "{}, kernel {} ({})\n\n{table}",
        machine.processor, machine.kernel, machine.preemption
    );
    let remedies = found.lines.chunk_by(|a, b| a.remedy == b.remedy);
    for lines in remedies.filter(|lines| !lines[0].remedy.is_empty()) {
        let names: Vec<&str> = lines.iter().map(|line| line.name.as_str()).collect();
        let _ = write!(text, "\n{}: {}", names.join(", "), lines[0].remedy);
    }
    let rate = match found.rate_hz {
        0.0 => "at no rate".to_string(),
        hz => format!("up to {} kHz", hz / 1e3),
    };
    let _ = writeln!(text, "\n\nThis machine is good for haptics {rate}.");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_above_one_that_is_not_good_is_not_good() {
        use Verdict::{Bad, Fair, Good};
        for (verdicts, rate_hz) in [
            ([Good, Good, Good], 4000.0),
            ([Good, Fair, Good], 1000.0),
            ([Bad, Good, Good], 0.0),
        ] {
            let rates = RATES_HZ.into_iter().zip(verdicts);
            assert_eq!(good_up_to(rates), rate_hz, "{verdicts:?}");
        }
    }
}
