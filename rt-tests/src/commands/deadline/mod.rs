//! `rt-tests deadline`: whether the controller keeps its deadline on slower machines, and what that
//! costs in accuracy.
//!
//! Real runs of both processes, in which every stage of a tick takes F times as long
//! (`rt-tests run --slow`). A scene passes when no period is missed by the tick's own work and no
//! tick spends more than it may, when every contact has a certified error, and when the 99.9th
//! percentile of the work is near that of a bare loop of fixed arithmetic with the same median,
//! slowed down alike, right after the run. What that loop misses, the machine misses, since an
//! interrupt in a stage is made F times as long, too. An error at the contact must have been
//! measured: of none nothing can be said.

pub mod scenes;
mod shapes;
mod words;

use crate::failure::{Failure, beside_measured};
use crate::processes::bare_loop::{BareWork, run_bare};
use crate::processes::pair::{PairArgs, other_core, run_pair};
use crate::processes::roles::LoopArgs;
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print_either, status_bar};
use crate::scenes::{check_seconds, prepare_models};
use clap::Args;
use hrtc::result::{Finished, RunResult, ShortSpread, Spread};
use scene::load;
use scene_files::DiskFiles;
use scenes::{Scene, SceneArgs};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// Largest 99.9th percentile of the work over that of the reference.
const MAX_P999_RATIO: f64 = 1.5;
/// Length of the reference over that of a run: five seeds of everything fit into 45 minutes.
const REFERENCE_SHARE: f64 = 3.0 / 8.0;

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
    /// One for each scene, F and seed.
    pub rows: Vec<Row>,
    /// Scenes that were left out, and why.
    pub left_out: Vec<String>,
    /// What ended the command early; empty where every row was measured.
    pub failed: Vec<String>,
    /// Whether every row was measured and passes.
    pub pass: bool,
}

impl Deadline {
    /// Of the rows that were measured, and how their measurement ended.
    ///
    /// # Errors
    /// The failure where nothing was measured: it is all that there is to say.
    fn of(
        rows: Vec<Row>,
        left_out: Vec<String>,
        ended: Result<(), Failure>,
    ) -> Result<Self, Failure> {
        let failed = beside_measured(ended, rows.is_empty())?;
        Ok(Self {
            pass: failed.is_empty() && rows.iter().all(Row::passes),
            rows,
            left_out,
            failed,
        })
    }

    /// Whether it passes.
    ///
    /// # Errors
    /// With all that was not kept.
    fn judge(&self) -> Result<(), Failure> {
        if self.pass {
            return Ok(());
        }
        let mut wrong = self.failed.clone();
        let reasons = words::reasons(&self.rows);
        if !reasons.is_empty() {
            wrong.push(format!(
                "of {} runs {}",
                self.rows.len(),
                reasons.join(", ")
            ));
        }
        Err(Failure::Run(wrong.join("; ")))
    }
}

/// A run, and the reference after it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: String,
    /// How many times as long every stage took.
    pub slow: f64,
    /// Seed of the tour.
    pub seed: u64,
    /// Ticks.
    pub ticks: u64,
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, ticks at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, ticks without a certified error.
    pub contact_unbounded_ticks: u64,
    /// Ticks in which a probe left a part of its motion.
    pub unfinished_ticks: u64,
    /// Periods missed by the tick's own work.
    pub missed_own_cpu: u64,
    /// Periods missed in all.
    pub missed: u64,
    /// Periods of which no record came: they are in no other figure.
    pub unaccounted_periods: i64,
    /// Ticks that spent more than they might.
    pub units_over_budget_ticks: u64,
    /// Processor time of a tick, microseconds.
    pub work_us: Spread,
    /// The same of a loop of fixed arithmetic with the same median, right after the run.
    pub reference_work_us: Spread,
    /// The 99.9th percentile of the work over that of the reference.
    pub reference_p999_ratio: f64,
    /// Periods that the reference missed by its own work.
    pub reference_missed_own_cpu: u64,
    /// Certified error at the contact, metres.
    pub certified_error_m: ShortSpread,
    /// Errors at the contact that were measured.
    pub measured_errors: u64,
    /// Measured error at the contact, metres; 0 where none was measured.
    pub measured_error_m: ShortSpread,
    /// Largest change of a force in a period, newtons.
    pub force_step_n_max: f64,
    /// Figures that were not finite.
    pub non_finite: Vec<String>,
    /// Real-time rights that the controller was denied: what follows, why, and what helps.
    pub missing_rights: Vec<String>,
}

impl Row {
    fn new(scene: &Scene, slow: f64, seed: u64, ours: &Finished, reference: &RunResult) -> Self {
        let run = &ours.result;
        let missing = ours.rights.iter().filter(|right| !right.obtained);
        Self {
            scene: scene.name.clone(),
            slow,
            seed,
            ticks: run.ticks,
            contact_ticks: run.contact_ticks,
            contact_full_ticks: run.contact_full_ticks,
            contact_unbounded_ticks: run.contact_unbounded_ticks,
            unfinished_ticks: run.unfinished_ticks,
            missed_own_cpu: run.missed_own_cpu,
            missed: run.missed,
            unaccounted_periods: run.unaccounted_periods,
            units_over_budget_ticks: run.governor.over_budget_ticks,
            work_us: run.work_us,
            reference_work_us: reference.work_us,
            reference_p999_ratio: run.work_us.p999 / reference.work_us.p999,
            reference_missed_own_cpu: reference.missed_own_cpu,
            certified_error_m: run.certified_error_m,
            measured_errors: run.measured_errors,
            measured_error_m: run.measured_error_m,
            force_step_n_max: run.force_step_n_max,
            non_finite: run.non_finite.clone(),
            missing_rights: missing.map(|right| right.detail.clone()).collect(),
        }
    }

    /// Whether the work's 99.9th percentile is near that of the reference. A ratio that is not
    /// finite is not.
    #[must_use]
    pub fn is_steady(&self) -> bool {
        self.reference_p999_ratio <= MAX_P999_RATIO
    }

    /// Whether the deadline was kept, with a touch whose error was certified all along and
    /// measured.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.missed_own_cpu == 0
            && self.unaccounted_periods == 0
            && self.units_over_budget_ticks == 0
            && self.contact_ticks > 0
            && self.contact_unbounded_ticks == 0
            && self.measured_errors > 0
            && self.is_steady()
            && self.non_finite.is_empty()
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 when a row does not pass, or could not be measured after
/// others were.
pub fn deadline(args: &DeadlineArgs) -> Result<(), Failure> {
    scenes::check_slow(&args.slow)?;
    check_seconds(args.seconds)?;
    let stop = stop_flag()?;
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let (scenes, left_out) = scenes::scenes(&args.scenes, folder.path())?;
    for scene in &scenes {
        check_stop(&stop)?;
        let plan = load(&scene.path, &scene.overrides(1).overrides(), &DiskFiles)?;
        prepare_models(&plan)?;
    }
    check_stop(&stop)?;
    let mut rows = Vec::new();
    let ended = measure_all(args, &scenes, &mut rows, &mut |scene, slow, seed| {
        row(scene, slow, seed, args.seconds, &stop)
    });
    let found = Deadline::of(rows, left_out, ended)?;
    print_either(args.json, &words::words(&found), &found)?;
    found.judge()
}

/// Measures the row of a scene, an F and a seed.
type MeasureRow<'a> = dyn FnMut(&Scene, f64, u64) -> Result<Row, Failure> + 'a;

/// Measures all rows, one behind the other.
///
/// # Errors
/// The first failure; the rows before it are there.
fn measure_all(
    args: &DeadlineArgs,
    scenes: &[Scene],
    rows: &mut Vec<Row>,
    measure: &mut MeasureRow<'_>,
) -> Result<(), Failure> {
    let bar = status_bar(scenes.len() as u64 * args.slow.len() as u64 * args.seeds);
    for scene in scenes {
        for &slow in &args.slow {
            for seed in 1..=args.seeds {
                bar.set_message(format!("{}, F = {slow}, seed {seed}", scene.name));
                rows.push(measure(scene, slow, seed)?);
                bar.inc(1);
            }
        }
    }
    bar.finish_and_clear();
    Ok(())
}

/// A run, and a loop of fixed arithmetic with its median, since the machine changes from minute to
/// minute.
fn row(
    scene: &Scene,
    slow: f64,
    seed: u64,
    seconds: f64,
    stop: &AtomicBool,
) -> Result<Row, Failure> {
    let overrides = scene.overrides(seed);
    let plan = load(&scene.path, &overrides.overrides(), &DiskFiles)?;
    let off = PathBuf::from("off");
    let pair = PairArgs {
        scene: &scene.path,
        plan: &plan,
        seconds,
        overrides: &overrides,
        loop_: LoopArgs {
            slow: (slow > 1.0).then_some(slow),
            ..LoopArgs::default()
        },
        record: Some(&off),
        device: None,
    };
    // What an end on request looks like in the processes is no failure of theirs.
    let outcome = run_pair(&pair, stop, &mut |_| ());
    check_stop(stop)?;
    let ours = outcome?.undisturbed()?;
    let work = BareWork {
        ns: (1e3 * ours.result.work_us.p50) as u64,
        slow,
    };
    let reference_s = seconds * REFERENCE_SHARE;
    let reference = run_bare(&plan.loop_, other_core(&plan), reference_s, work, stop);
    check_stop(stop)?;
    Ok(Row::new(scene, slow, seed, &ours, &reference?.result))
}

/// # Errors
/// When the command is to end.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("interrupted".to_string()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::words::tests::kept;
    use super::*;

    #[test]
    fn a_row_that_fails_leaves_those_before_it() {
        let args = DeadlineArgs {
            slow: vec![1.0],
            seeds: 3,
            seconds: 1.0,
            scenes: SceneArgs {
                only: Some("terrain-20cm".to_owned()),
                models: PathBuf::new(),
                terrain_faces: 1000,
            },
            json: false,
        };
        let folder = tempfile::tempdir().expect("a folder");
        let found = scenes::scenes(&args.scenes, folder.path());
        let (scenes, left_out) = found.expect("the scene is written");
        let failure = || Failure::Run("the controller ended".to_owned());
        let measured = |fails_at: u64| {
            let mut rows = Vec::new();
            let ended = measure_all(&args, &scenes, &mut rows, &mut |_, _, seed| match seed {
                seed if seed == fails_at => Err(failure()),
                seed => Ok(Row { seed, ..kept() }),
            });
            Deadline::of(rows, left_out.clone(), ended)
        };
        let found = measured(2).expect("the first row is there");
        let seeds: Vec<u64> = found.rows.iter().map(|row| row.seed).collect();
        assert_eq!((seeds, found.pass), (vec![1], false));
        let text = words::words(&found);
        assert!(text.contains("of 1 runs: 0 with own misses"), "{text}");
        assert!(text.contains("the controller ended"), "{text}");
        assert_eq!(found.judge(), Err(failure()));
        // All that there is to say, with its status.
        assert_eq!(measured(1).err(), Some(failure()));
        let whole = measured(9).expect("every row is there");
        assert_eq!((whole.rows.len(), whole.judge()), (3, Ok(())));
    }

    #[test]
    fn what_was_not_kept_is_named_and_nothing_else() {
        let judged = |rows: Vec<Row>| {
            let found = Deadline::of(rows, Vec::new(), Ok(())).expect("rows are there");
            found.judge().expect_err("it does not pass").to_string()
        };
        let unsteady = Row {
            reference_p999_ratio: 1.6,
            ..kept()
        };
        let said = judged(vec![kept(), unsteady]);
        assert_eq!(
            said,
            "of 2 runs 1 with a p99.9 over 1.5 times the reference's"
        );
        let untouched = Row {
            contact_ticks: 0,
            measured_errors: 0,
            unaccounted_periods: 2,
            ..kept()
        };
        let said = judged(vec![untouched]);
        for reason in [
            "lost records",
            "without a touch",
            "without a measured error",
        ] {
            assert!(said.contains(reason), "{said}");
        }
        assert!(
            !said.contains("own misses") && !said.contains("p99.9"),
            "{said}"
        );
    }
}
