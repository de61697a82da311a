//! `rt-tests policies`: the policies that decide how fine the objects may be, at equal time.
//!
//! The scenes of `rt-tests deadline`, in virtual time with the costs of the reference machine, F
//! times as large. What a tick takes is what it has spent by these costs, so that every run gives
//! the same figures on any machine. Only the scene's `policy` differs between two rows of a pair.

mod trial;
mod verdict;
mod words;

use super::deadline::scenes::{Scene, SceneArgs, check_slow, scenes};
use crate::failure::{Failure, beside_measured};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print_either, status_bar};
use crate::scenes::{check_seconds, prepare_models};
use clap::Args;
use scene::{PolicyPlan, ScenePlan, load};
use scene_files::DiskFiles;
use serde::Serialize;
use std::sync::atomic::AtomicBool;
use trial::{Sums, Trial};
use verdict::{Verdict, verdict};

/// The policies, in the order of the rows.
const POLICIES: [PolicyPlan; 2] = [PolicyPlan::Predictive, PolicyPlan::Reactive];

/// Arguments of `rt-tests policies`.
#[derive(Debug, Args)]
pub struct PoliciesArgs {
    /// How many times as long every unit of work takes
    #[arg(
        long,
        value_name = "F",
        value_delimiter = ',',
        default_value = "1,2,4,8"
    )]
    pub slow: Vec<f64>,
    /// Seeds of the tours, from 1 on
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: u64,
    /// Length of each run, seconds of virtual time
    #[arg(long, value_name = "S", default_value_t = 6.0)]
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
pub struct Policies {
    /// One for each scene, F and policy.
    pub rows: Vec<Row>,
    /// Scenes that were left out, and why.
    pub left_out: Vec<String>,
    /// Rows that cannot be compared, and why; with one of them the command fails.
    pub faults: Vec<String>,
    /// What ended the command early; empty where every row was measured.
    pub failed: Vec<String>,
    /// The policy of a scene that names none.
    pub default: PolicyPlan,
    /// Which one is the better.
    pub verdict: Verdict,
}

impl Policies {
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
            verdict: verdict(&rows),
            faults: words::faults(&rows),
            rows,
            left_out,
            failed,
            default: PolicyPlan::default(),
        })
    }
}

/// All seeds of a scene at one F under one policy.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The scene.
    pub scene: String,
    /// How many times as long every unit of work took.
    pub slow: f64,
    /// The policy.
    pub policy: PolicyPlan,
    /// What came of it.
    #[serde(flatten)]
    pub trial: Trial,
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 when the default is not the better one, or a row cannot
/// be compared: it touched nothing, measured nothing, or took more time than it might; and when a
/// run fails after others were measured.
pub fn policies(args: &PoliciesArgs) -> Result<(), Failure> {
    check_slow(&args.slow)?;
    check_seconds(args.seconds)?;
    let stop = stop_flag()?;
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let (scenes, left_out) = scenes(&args.scenes, folder.path())?;
    for scene in &scenes {
        check_stop(&stop)?;
        prepare_models(&plan_of(scene, 1)?)?;
    }
    let mut rows = Vec::new();
    let ended = run_all(args, &scenes, &stop, &mut rows);
    let found = Policies::of(rows, left_out, ended)?;
    print_either(args.json, &words::words(&found), &found)?;
    judge(&found)
}

/// Whether all rows were measured and could be compared, and the default is the better policy.
fn judge(found: &Policies) -> Result<(), Failure> {
    if !found.failed.is_empty() {
        return Err(Failure::Run(found.failed.join("; ")));
    }
    if !found.faults.is_empty() {
        return Err(Failure::Run(format!(
            "no comparison at equal time: {}",
            found.faults.join("; ")
        )));
    }
    if found.verdict.better == Some(found.default) {
        Ok(())
    } else {
        Err(Failure::Run(
            "the default policy is not the better one".to_string(),
        ))
    }
}

/// Runs every scene at every F under both policies.
///
/// # Errors
/// The first failure; the rows before it are there.
fn run_all(
    args: &PoliciesArgs,
    scenes: &[Scene],
    stop: &AtomicBool,
    rows: &mut Vec<Row>,
) -> Result<(), Failure> {
    let runs = (scenes.len() * args.slow.len() * POLICIES.len()) as u64 * args.seeds;
    let bar = status_bar(runs);
    for scene in scenes {
        for &slow in &args.slow {
            let mut sums = [Sums::default(), Sums::default()];
            for seed in 1..=args.seeds {
                bar.set_message(format!("{}, F = {slow}, seed {seed}", scene.name));
                for (policy, sums) in POLICIES.into_iter().zip(&mut sums) {
                    check_stop(stop)?;
                    let mut plan = plan_of(scene, seed)?;
                    plan.accuracy.policy = policy;
                    let is_whole = sums.run(&plan, slow, args.seconds, || is_set(stop))?;
                    if !is_whole {
                        return Err(interrupted());
                    }
                    bar.inc(1);
                }
            }
            rows.extend(POLICIES.into_iter().zip(sums).map(|(policy, sums)| Row {
                scene: scene.name.clone(),
                slow,
                policy,
                trial: sums.trial(),
            }));
        }
    }
    bar.finish_and_clear();
    Ok(())
}

fn interrupted() -> Failure {
    Failure::Run("interrupted".to_string())
}

/// # Errors
/// When the command is to end.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(interrupted());
    }
    Ok(())
}

fn plan_of(scene: &Scene, seed: u64) -> Result<ScenePlan, Failure> {
    let overrides = scene.overrides(seed).overrides();
    Ok(load(&scene.path, &overrides, &DiskFiles)?)
}

#[cfg(test)]
mod tests {
    use super::trial::Errors;
    use super::*;

    /// The default policy with the smaller error.
    fn rows() -> Vec<Row> {
        let row = |(policy, mean): (PolicyPlan, f64)| Row {
            scene: "a".to_owned(),
            slow: 2.0,
            policy,
            trial: Trial {
                ticks: 2,
                contact_ticks: 1,
                measured_errors: 1,
                measured_error_m: Errors {
                    mean,
                    ..Errors::default()
                },
                ..Trial::default()
            },
        };
        POLICIES.into_iter().zip([1e-5, 1e-4]).map(row).collect()
    }

    fn found(rows: Vec<Row>) -> Policies {
        Policies::of(rows, Vec::new(), Ok(())).expect("nothing failed")
    }

    #[test]
    fn a_late_failure_is_said_beside_what_was_measured() {
        let failure = || Failure::Input("dragon.obj is no mesh".to_string());
        // All that there is to say, with its status.
        let none = Policies::of(Vec::new(), Vec::new(), Err(failure()));
        assert_eq!(none.err(), Some(failure()));
        let found = Policies::of(rows(), Vec::new(), Err(failure())).expect("rows are there");
        assert_eq!(found.rows.len(), POLICIES.len());
        assert!(words::words(&found).contains("dragon.obj is no mesh"));
        let said = judge(&found).expect_err("not all was measured");
        assert_eq!(
            (said.status(), said.to_string()),
            (1, failure().to_string())
        );
    }

    #[test]
    fn a_command_that_is_to_end_runs_nothing() {
        let args = PoliciesArgs {
            slow: vec![1.0],
            seeds: 1,
            seconds: 1.0,
            scenes: SceneArgs {
                only: Some("terrain-20cm".to_owned()),
                models: std::path::PathBuf::new(),
                terrain_faces: 1000,
            },
            json: false,
        };
        let folder = tempfile::tempdir().expect("a folder");
        let (scenes, _) = scenes(&args.scenes, folder.path()).expect("the scene is written");
        let mut rows = Vec::new();
        let ended = run_all(&args, &scenes, &AtomicBool::new(true), &mut rows);
        assert_eq!((ended, rows.len()), (Err(interrupted()), 0));
    }

    #[test]
    fn a_row_that_cannot_be_compared_fails_the_command_and_is_named() {
        let sound = found(rows());
        assert_eq!(judge(&sound), Ok(()));
        let faults: [fn(&mut Trial); 2] = [
            |trial| trial.contact_ticks = 0,
            |trial| trial.over_budget_ticks = 1,
        ];
        for fault in faults {
            let mut rows = [rows(), rows()].concat();
            fault(&mut rows[3].trial);
            let odd = found(rows);
            // The other pair alone would be enough.
            assert_eq!(odd.verdict.better, Some(odd.default));
            let said = judge(&odd).expect_err("a row cannot be compared");
            assert_eq!(said.status(), 1);
            assert!(said.to_string().contains("a, F = 2, reactive"), "{said}");
            assert!(words::words(&odd).contains(&odd.faults[0]));
        }
    }
}
