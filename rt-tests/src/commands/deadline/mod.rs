//! `rt-tests deadline`: whether the controller keeps its deadline on slower machines, and what that
//! costs in accuracy.
//!
//! Real runs of both processes, in which every stage of a tick takes F times as long
//! (`rt-tests run --slow`). A scene passes when no period is missed by the tick's own work and no
//! tick spends more than it may. Beside each stands a bare loop of fixed arithmetic with the same
//! median, slowed down alike: what it misses, the machine misses, since an interrupt in a stage is
//! made F times as long, too.

pub mod scenes;
mod shapes;
mod words;

use crate::failure::Failure;
use crate::processes::bare_loop::{BareWork, run_bare};
use crate::processes::pair::{PairArgs, other_core, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print_either, status_bar};
use crate::scenes::prepare_models;
use clap::Args;
use hrtc::result::{RunResult, Spread};
use scene::load;
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use scenes::{Scene, SceneArgs};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Arguments of `rt-tests deadline`.
#[derive(Debug, Args)]
pub struct DeadlineArgs {
    /// How many times as long every stage of a tick takes
    #[arg(
        long,
        value_name = "F",
        value_delimiter = ',',
        default_value = "1,2,4,8"
    )]
    pub slow: Vec<f64>,
    /// Seeds of the tours, from 1 on
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: u64,
    /// Length of each run, seconds
    #[arg(long, value_name = "S", default_value_t = 8.0)]
    pub seconds: f64,
    /// Which scenes.
    #[command(flatten)]
    pub scenes: SceneArgs,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Deadline {
    /// One for each scene and F.
    pub rows: Vec<Row>,
    /// Scenes that were left out, and why.
    pub left_out: Vec<String>,
    /// Whether every row passes.
    pub pass: bool,
}

/// All seeds of a scene at one F.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: String,
    /// How many times as long every stage took.
    pub slow: f64,
    /// Runs.
    pub runs: u64,
    /// Ticks.
    pub ticks: u64,
    /// Periods missed by the tick's own work.
    pub missed_own: u64,
    /// Periods missed in all.
    pub missed: u64,
    /// Ticks that spent more than they might.
    pub over_budget_ticks: u64,
    /// Ticks in contact, and of these at full resolution.
    pub contact_ticks: u64,
    /// See `contact_ticks`.
    pub contact_full_ticks: u64,
    /// Ticks in which a probe left a part of its motion.
    pub unfinished_ticks: u64,
    /// Certified error at the contact, metres: the largest of the seeds' p50, p99 and maximum.
    pub certified_error_m: [f64; 3],
    /// Measured error at the contact, metres, the same.
    pub measured_error_m: [f64; 3],
    /// Processor time of a tick, microseconds, the largest of the seeds.
    pub work_us: Spread,
    /// The same of a loop of fixed arithmetic with the same median.
    pub reference_work_us: Spread,
    /// Periods that this loop missed by its own work.
    pub reference_missed_own: u64,
    /// Largest change of a force in a period, newtons.
    pub force_step_n_max: f64,
    /// Figures that were not finite.
    pub non_finite: Vec<String>,
}

impl Row {
    fn add(&mut self, result: &RunResult) {
        self.runs += 1;
        self.ticks += result.ticks;
        self.missed_own += result.missed_own_cpu;
        self.missed += result.missed;
        self.over_budget_ticks += result.governor.over_budget_ticks;
        self.contact_ticks += result.contact_ticks;
        self.contact_full_ticks += result.contact_full_ticks;
        self.unfinished_ticks += result.unfinished_ticks;
        let (certified, measured) = (result.certified_error_m, result.measured_error_m);
        let certified = [certified.p50, certified.p99, certified.max];
        let measured = [measured.p50, measured.p99, measured.max];
        let raise = |most: &mut [f64; 3], found: [f64; 3]| {
            most.iter_mut()
                .zip(found)
                .for_each(|(most, found)| *most = most.max(found));
        };
        raise(&mut self.certified_error_m, certified);
        raise(&mut self.measured_error_m, measured);
        let (most, work) = (&mut self.work_us, &result.work_us);
        most.p50 = most.p50.max(work.p50);
        most.p99 = most.p99.max(work.p99);
        most.p999 = most.p999.max(work.p999);
        most.max = most.max.max(work.max);
        self.force_step_n_max = self.force_step_n_max.max(result.force_step_n_max);
        for name in &result.non_finite {
            if !self.non_finite.contains(name) {
                self.non_finite.push(name.clone());
            }
        }
    }

    /// Runs a loop of fixed arithmetic with the median of the runs so far.
    fn measure_reference(
        &mut self,
        scene: &Scene,
        seconds: f64,
        stop: &AtomicBool,
    ) -> Result<(), Failure> {
        let plan = load(&scene.path, &scene.overrides(1).overrides(), &DiskFiles)?;
        let work = BareWork {
            ns: (1e3 * self.work_us.p50) as u64,
            slow: self.slow,
        };
        let finished = run_bare(&plan.loop_, other_core(&plan), seconds, work, stop)?;
        self.reference_work_us = finished.result.work_us;
        self.reference_missed_own = finished.result.missed_own_cpu;
        Ok(())
    }

    /// The 99.9th percentile of the work beside that of the reference.
    #[must_use]
    pub fn tail_ratio(&self) -> f64 {
        self.work_us.p999 / self.reference_work_us.p999
    }

    /// Whether the deadline was kept, with a touch.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.missed_own == 0
            && self.over_budget_ticks == 0
            && self.contact_ticks > 0
            && self.non_finite.is_empty()
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 when a row does not pass.
pub fn deadline(args: &DeadlineArgs) -> Result<(), Failure> {
    scenes::check_slow(&args.slow)?;
    let stop = stop_flag()?;
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let (scenes, left_out) = scenes::scenes(&args.scenes, folder.path())?;
    for scene in &scenes {
        let plan = load(&scene.path, &scene.overrides(1).overrides(), &DiskFiles)?;
        prepare_models(&plan)?;
    }
    let mut rows = Vec::new();
    let runs = scenes.len() as u64 * args.slow.len() as u64 * (args.seeds + 1);
    let bar = status_bar(runs);
    for scene in &scenes {
        for &slow in &args.slow {
            let mut row = Row {
                scene: scene.name.clone(),
                slow,
                ..Row::default()
            };
            for seed in 1..=args.seeds {
                bar.set_message(format!("{}, F = {slow}, seed {seed}", scene.name));
                if is_set(&stop) {
                    return Err(Failure::Run("interrupted".to_string()));
                }
                let overrides = scene.overrides(seed);
                row.add(&run(&scene.path, &overrides, slow, args.seconds, &stop)?);
                bar.inc(1);
            }
            bar.set_message(format!("{}, F = {slow}, reference", scene.name));
            row.measure_reference(scene, args.seconds, &stop)?;
            bar.inc(1);
            rows.push(row);
        }
    }
    bar.finish_and_clear();
    let pass = rows.iter().all(Row::passes);
    let found = Deadline {
        rows,
        left_out,
        pass,
    };
    print_either(args.json, &words::words(&found), &found)?;
    if pass {
        Ok(())
    } else {
        Err(Failure::Run(
            "a deadline or a budget was not kept".to_string(),
        ))
    }
}

fn run(
    scene: &std::path::Path,
    overrides: &OverrideArgs,
    slow: f64,
    seconds: f64,
    stop: &AtomicBool,
) -> Result<RunResult, Failure> {
    let plan = load(scene, &overrides.overrides(), &DiskFiles)?;
    let off = PathBuf::from("off");
    let pair = PairArgs {
        scene,
        plan: &plan,
        seconds,
        overrides,
        loop_: LoopArgs {
            slow: (slow > 1.0).then_some(slow),
            ..LoopArgs::default()
        },
        record: Some(&off),
        device: None,
    };
    Ok(run_pair(&pair, stop, &mut |_| ())?.finished.result)
}
