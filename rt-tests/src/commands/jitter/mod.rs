//! `rt-tests jitter`: the controller, a loop of equal fixed arithmetic and an empty loop in
//! alternating blocks of one run, so that what the machine does to all is not laid to the
//! controller's charge, nor hidden.
//!
//! A round is a block of the controller (with its station on the other core), right beside it an
//! equally long block of the reference loop, whose arithmetic takes the controller's median work,
//! and a shorter block of the bare loop with an empty body. All have the same pacer, priority and
//! core. Wake-ups are compared with the empty loop's, work and misses with the reference loop's.
//!
//! | module | holds |
//! |---|---|
//! | `measurement` | the rounds and their blocks |
//! | `side` | all blocks of one loop, added up |
//! | `verdict` | what is judged |
//! | `words`, `histogram` | the terminal; the picture |

mod histogram;
mod measurement;
mod side;
mod verdict;
mod words;

pub use side::{Side, Tail};

use self::measurement::{Measurement, Setup, check_blocks};
use self::verdict::{Numbers, Verdict, judge};
use crate::failure::Failure;
use crate::machine::Machine;
use crate::processes::load::Load;
use crate::processes::roles::LoopArgs;
use crate::processes::stop::stop_flag;
use crate::report::output::{make_folder, print_either, write_json, write_whole};
use crate::report::quantile::median;
use crate::scenes::{SceneFile, check_seconds, prepare_models};
use clap::Args;
use scene::{ScenePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
use std::path::PathBuf;

/// Part of a wait that `--spin` spins, microseconds, at most half a period: of 50 and 100 µs the
/// one after which also the wake-up p99 under load was below 10 µs on the machine of the
/// measurements.
const SPIN_US: f64 = 100.0;

/// Arguments of `rt-tests jitter`.
#[derive(Debug, Args)]
pub struct JitterArgs {
    /// Length of all blocks together, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 60.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Load on the other core
    #[arg(long, value_enum, default_value = "none")]
    pub load: Load,
    /// Ticks a second of every loop, 100 to 10000 [default: the scene's]
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    pub rate: Option<f64>,
    /// Spin the last 100 µs of every wait, at most half a period, instead of sleeping them
    #[arg(long)]
    pub spin: bool,
    /// Scene file of the controller's blocks [default: the bundled first-touch scene]
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Folder of the histogram [default: reports/jitter-LOAD]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Ratios of ours over the bare loop's.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Ratio {
    /// Of the medians.
    pub p50: f64,
    /// Of the 99 %.
    pub p99: f64,
}

/// The object of `--json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JitterResult {
    /// The controller.
    pub ours: Side,
    /// The loop of fixed arithmetic that takes the controller's median work.
    pub reference: Side,
    /// The bare loop.
    pub bare: Side,
    /// Rounds.
    pub pairs: u64,
    /// Median over the rounds, wake-up.
    pub wake_ratio: Ratio,
    /// Median over the rounds: p99.9 of our work over the reference loop's; left out where it is
    /// not finite.
    #[serde(skip_serializing_if = "is_not_finite")]
    pub work_tail_ratio: f64,
    /// Work units of the worst tick.
    pub operations_max: u64,
    /// Work units that a tick may spend.
    pub operations_budget: u64,
    /// Nodes and faces of the queries of the worst tick.
    pub query_work_max: u64,
    /// Nodes and faces that the queries of a tick may take.
    pub query_work_budget: u64,
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Share of the ticks in contact in the block with the least.
    pub contact_share: f64,
    /// Names of the figures of which a value was not finite.
    pub non_finite: Vec<String>,
    /// Ticks a second.
    pub rate_hz: f64,
    /// Part of a wait that was spun, microseconds.
    pub spin_us: u64,
    /// `pass`, `fail` or `inconclusive`.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// Load on the other core.
    pub load: &'static str,
    /// The machine.
    pub machine: Machine,
}

impl JitterResult {
    /// The loops with their names.
    fn loops(&self) -> [(&'static str, &Side); 3] {
        [
            ("controller", &self.ours),
            ("reference", &self.reference),
            ("bare loop", &self.bare),
        ]
    }
}

fn is_not_finite(value: &f64) -> bool {
    !value.is_finite()
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 also for a verdict other than `pass`, after the result.
pub fn jitter(args: &JitterArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    check_blocks(args.seconds)?;
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let mut loop_ = LoopArgs {
        rate: args.rate,
        spin_us: None,
        ..LoopArgs::default()
    };
    let mut plan = load(scene.path(), &loop_.with(&args.overrides), &DiskFiles)?;
    if args.spin {
        plan.loop_.spin_us = SPIN_US.min(5e5 / plan.loop_.rate_hz) as u64;
        loop_.spin_us = Some(plan.loop_.spin_us);
    }
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("reports").join(format!("jitter-{}", args.load.name())));
    make_folder(&out)?;
    prepare_models(&plan)?;
    let setup = Setup {
        scene: scene.path(),
        plan: &plan,
        overrides: &args.overrides,
        loop_,
        load: args.load,
        seconds: args.seconds,
    };
    let measured = Measurement::new(setup).run(&stop)?;
    let result = result(&measured, &plan, args.load);
    let svg = histogram::picture(&[
        ("wake-up, controller", &measured.ours.wake),
        ("wake-up, reference", &measured.reference.wake),
        ("work, controller", &measured.ours.work_cpu),
        ("work, reference", &measured.reference.work_cpu),
    ]);
    let picture = out.join("histogram.svg");
    write_whole(&picture, svg.as_bytes())?;
    write_json(&out.join("result.json"), &result)?;
    let words = words::words(&result, &measured.rights, &picture);
    print_either(args.json, &words, &result)?;
    match result.verdict {
        Verdict::Pass => Ok(()),
        Verdict::Fail | Verdict::Inconclusive => Err(Failure::Run(format!(
            "the verdict is {}: {}",
            result.verdict.name(),
            result.reasons.join("; ")
        ))),
    }
}

fn result(measured: &Measurement<'_>, plan: &ScenePlan, load: Load) -> JitterResult {
    let [ours, reference, bare] =
        [&measured.ours, &measured.reference, &measured.bare].map(side::Blocks::finish);
    let wake_ratio = Ratio {
        p50: median(&measured.wake_p50),
        p99: median(&measured.wake_p99),
    };
    let work_tail_ratio = median(&measured.work_tail);
    let mut non_finite: Vec<String> = measured.non_finite.iter().cloned().collect();
    if !work_tail_ratio.is_finite() {
        non_finite.push("work_tail_ratio".to_string());
    }
    let (verdict, reasons) = judge(&Numbers {
        ours: &ours,
        bare: &bare,
        reference: &reference,
        operations: measured.operations,
        queries: measured.queries,
        contact_share: measured.contact_share,
        non_finite: &non_finite,
        wake_ratio: [wake_ratio.p50, wake_ratio.p99],
    });
    JitterResult {
        pairs: measured.wake_p50.len() as u64,
        work_tail_ratio,
        operations_max: measured.operations.max,
        operations_budget: measured.operations.budget,
        query_work_max: measured.queries.max,
        query_work_budget: measured.queries.budget,
        contact_ticks: measured.contact_ticks,
        contact_share: measured.contact_share,
        rate_hz: plan.loop_.rate_hz,
        spin_us: plan.loop_.spin_us,
        load: load.name(),
        machine: Machine::read(),
        ours,
        reference,
        bare,
        wake_ratio,
        non_finite,
        verdict,
        reasons,
    }
}
