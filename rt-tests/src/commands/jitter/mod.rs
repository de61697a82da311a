//! `rt-tests jitter`: the controller and the bare loop in alternating blocks of one run, so that
//! what the machine does to both is not laid to the controller's charge, nor hidden.
//!
//! A round is a block of the controller (with its station on the other core), a block of the bare
//! loop and a shorter block of the bare loop with arithmetic of the controller's median work.
//! Wake-ups are compared with the empty loop's, the tail of the work with the arithmetic's.

mod histogram;
mod verdict;

use self::verdict::{Numbers, Verdict, judge};
use crate::failure::Failure;
use crate::machine::{Machine, right_words, steal_ticks};
use crate::processes::load::Load;
use crate::processes::pair::{PairArgs, Shown, other_core, run_pair};
use crate::processes::process::{Event, Process};
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{make_folder, print_either, status_line, write_json, write_whole};
use crate::report::quantile::median;
use crate::report::table::Table;
use crate::scenes::{SceneFile, check_seconds, prepare_models};
use clap::Args;
use hdrhistogram::Histogram;
use hrtc::result::{Buckets, Finished, Misses, Right, SupervisedLine};
use indicatif::ProgressBar;
use scene::{ScenePlan, load};
use scene_args::OverrideArgs;
use scene_files::DiskFiles;
use serde::Serialize;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Rounds at the least: fewer medians mean nothing.
const FEWEST_ROUNDS: usize = 5;
/// Rounds at the most.
const MAX_ROUNDS: usize = 20;
/// A round grows to this length before there are more of them, seconds.
const ROUND_S: f64 = 24.0;
/// Shares of a round: controller, bare loop, arithmetic.
const SHARES: [f64; 3] = [0.4, 0.4, 0.2];

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

/// Percentiles and maximum, microseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Tail {
    /// Median.
    pub p50: f64,
    /// 99 % are not above it.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// 99.99 %.
    pub p9999: f64,
    /// Largest.
    pub max: f64,
}

/// All blocks of one kind.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Side {
    /// Ticks run.
    pub ticks: u64,
    /// Periods skipped.
    pub missed: u64,
    /// Of these, by own processor time.
    pub missed_own_cpu: u64,
    /// All by reason.
    pub misses: Misses,
    /// Wake-up after the deadline.
    pub wake_us: Tail,
    /// Thread CPU of the work.
    pub work_cpu_us: Tail,
    /// Wall time of the work.
    pub work_wall_us: Tail,
    /// Since the start of the tick before.
    pub period_us: Tail,
    /// Page faults within ticks.
    pub page_faults: u64,
    /// Allocations and frees within ticks.
    pub allocations: u64,
    /// Processor time that the hypervisor took during the blocks, kernel ticks of 10 ms.
    pub steal_ticks: u64,
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
    /// The bare loop.
    pub bare: Side,
    /// Rounds.
    pub pairs: u64,
    /// Median over the rounds, wake-up.
    pub wake_ratio: Ratio,
    /// Median over the rounds: p99.9 of our work over that of arithmetic with the same median.
    pub work_tail_ratio: f64,
    /// Work units of the worst tick.
    pub operations_max: u64,
    /// Work units that a tick may spend.
    pub operations_budget: u64,
    /// `pass`, `fail` or `inconclusive`.
    pub verdict: Verdict,
    /// Why, a sentence each.
    pub reasons: Vec<String>,
    /// Load on the other core.
    pub load: &'static str,
    /// The machine.
    pub machine: Machine,
}

/// Blocks of one kind while they are added up.
#[derive(Default)]
struct Blocks {
    side: Side,
    wake: Buckets,
    work_cpu: Buckets,
    work_wall: Buckets,
    period: Buckets,
}

impl Blocks {
    fn add(&mut self, block: &Finished, steal: u64) {
        let r = &block.result;
        let side = &mut self.side;
        side.ticks += r.ticks;
        side.missed += r.missed;
        side.missed_own_cpu += r.missed_own_cpu;
        side.misses.add(&r.misses);
        side.page_faults += r.page_faults;
        side.allocations += r.allocations;
        side.steal_ticks += steal;
        for (tail, max) in [
            (&mut side.wake_us, r.wake_us.max),
            (&mut side.work_cpu_us, r.work_us.max),
            (&mut side.work_wall_us, r.work_wall_us.max),
            (&mut side.period_us, r.period_us.max),
        ] {
            tail.max = tail.max.max(max);
        }
        let h = &block.histograms;
        self.wake.extend(&h.wake_ns);
        self.work_cpu.extend(&h.work_cpu_ns);
        self.work_wall.extend(&h.work_wall_ns);
        self.period.extend(&h.period_ns);
    }

    fn finish(&self) -> Side {
        let mut side = self.side.clone();
        for (tail, buckets) in [
            (&mut side.wake_us, &self.wake),
            (&mut side.work_cpu_us, &self.work_cpu),
            (&mut side.work_wall_us, &self.work_wall),
            (&mut side.period_us, &self.period),
        ] {
            *tail = tail_of(buckets, tail.max);
        }
        side
    }
}

/// Percentiles of merged histograms (nanoseconds), in microseconds; the maximum is known exactly.
fn tail_of(buckets: &Buckets, max: f64) -> Tail {
    let Ok(mut histogram) = Histogram::<u64>::new_with_bounds(1, 1 << 32, 3) else {
        return Tail::default();
    };
    for &(value, count) in buckets {
        histogram.saturating_record_n(value, count);
    }
    if histogram.is_empty() {
        return Tail::default();
    }
    let quantile = |q: f64| (histogram.value_at_quantile(q) as f64 / 1e3).min(max);
    Tail {
        p50: quantile(0.5),
        p99: quantile(0.99),
        p999: quantile(0.999),
        p9999: quantile(0.9999),
        max,
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence, with its status; status 1 also for a verdict other than `pass`, after the result.
pub fn jitter(args: &JitterArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let plan = load(scene.path(), &args.overrides.overrides(), &DiskFiles)?;
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| PathBuf::from("reports").join(format!("jitter-{}", args.load.name())));
    make_folder(&out)?;
    prepare_models(&plan)?;
    let stop = stop_flag()?;
    let measured = Measurement::new(args, scene.path(), &plan).run(&stop)?;
    let result = measured.result(args);
    let svg = histogram::picture(&[
        ("wake-up, controller", &measured.ours.wake),
        ("wake-up, bare loop", &measured.bare.wake),
        ("work, controller", &measured.ours.work_cpu),
    ]);
    let picture = out.join("histogram.svg");
    write_whole(&picture, svg.as_bytes())?;
    write_json(&out.join("result.json"), &result)?;
    let words = words(&result, &measured.rights, &picture);
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

struct Measurement<'a> {
    args: &'a JitterArgs,
    scene: &'a Path,
    plan: &'a ScenePlan,
    ours: Blocks,
    bare: Blocks,
    wake_p50: Vec<f64>,
    wake_p99: Vec<f64>,
    work_tail: Vec<f64>,
    operations_max: u64,
    operations_budget: u64,
    rights: Vec<Right>,
    bar: ProgressBar,
}

impl<'a> Measurement<'a> {
    fn new(args: &'a JitterArgs, scene: &'a Path, plan: &'a ScenePlan) -> Self {
        Self {
            args,
            scene,
            plan,
            ours: Blocks::default(),
            bare: Blocks::default(),
            wake_p50: Vec::new(),
            wake_p99: Vec::new(),
            work_tail: Vec::new(),
            operations_max: 0,
            operations_budget: 0,
            rights: Vec::new(),
            bar: status_line(),
        }
    }

    fn run(mut self, stop: &AtomicBool) -> Result<Self, Failure> {
        let rounds = ((self.args.seconds / ROUND_S) as usize).clamp(FEWEST_ROUNDS, MAX_ROUNDS);
        let seconds = SHARES.map(|share| share * self.args.seconds / rounds as f64);
        let (sender, _events) = channel();
        let _load = match self.args.load {
            Load::None => None,
            kind => Some(Process::start(
                "load",
                &["role-load".into(), kind.name().into()],
                other_core(self.plan),
                &sender,
            )?),
        };
        for round in 0..rounds {
            self.bar
                .set_message(format!("round {} of {rounds}", round + 1));
            // Which comes first alternates, so that a machine that slows down or warms up favours
            // neither.
            let (ours, bare) = if round % 2 == 0 {
                let ours = self.ours_block(seconds[0], stop)?;
                (ours, self.bare_block(seconds[1], 0, stop)?)
            } else {
                let bare = self.bare_block(seconds[1], 0, stop)?;
                (self.ours_block(seconds[0], stop)?, bare)
            };
            let work_ns = (ours.0.result.work_us.p50 * 1e3) as u64;
            let arithmetic = self.bare_block(seconds[2], work_ns, stop)?;
            if is_set(stop) {
                return Err(Failure::Run(
                    "ended on request before every round was measured; there is no verdict"
                        .to_string(),
                ));
            }
            self.add_round(&ours, &bare, &arithmetic.0);
        }
        self.bar.finish_and_clear();
        Ok(self)
    }

    fn add_round(&mut self, ours: &(Finished, u64), bare: &(Finished, u64), work: &Finished) {
        self.ours.add(&ours.0, ours.1);
        self.bare.add(&bare.0, bare.1);
        let (ours, bare) = (&ours.0, &bare.0);
        let (wake, bare_wake) = (&ours.result.wake_us, &bare.result.wake_us);
        self.wake_p50.push(ratio(wake.p50, bare_wake.p50));
        self.wake_p99.push(ratio(wake.p99, bare_wake.p99));
        let tail = ours.result.work_us.p999;
        self.work_tail.push(ratio(tail, work.result.work_us.p999));
        self.operations_max = self.operations_max.max(ours.result.operations_max);
        self.operations_budget = ours.result.operations_budget;
        self.rights.clone_from(&ours.rights);
    }

    fn steal_over<T>(
        &self,
        block: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<(T, u64), Failure> {
        let core = self.plan.loop_.core;
        let before = steal_ticks(core);
        let done = block()?;
        Ok((done, steal_ticks(core).saturating_sub(before)))
    }

    fn ours_block(&self, seconds: f64, stop: &AtomicBool) -> Result<(Finished, u64), Failure> {
        let pair = PairArgs {
            scene: self.scene,
            plan: self.plan,
            seconds,
            overrides: &self.args.overrides,
            record: None,
        };
        let bar = &self.bar;
        let mut show = |shown: Shown| {
            if let Shown::Said(name, line) = shown
                && line.contains("warning")
            {
                bar.println(format!("{name}: {line}"));
            }
        };
        self.steal_over(|| Ok(run_pair(&pair, stop, &mut show)?.finished))
    }

    fn bare_block(
        &self,
        seconds: f64,
        work_ns: u64,
        stop: &AtomicBool,
    ) -> Result<(Finished, u64), Failure> {
        let plan = &self.plan.loop_;
        let mut typed: Vec<OsString> = vec!["role-bare".into()];
        typed.push(format!("--rate-hz={}", plan.rate_hz).into());
        typed.push(format!("--priority={}", plan.priority).into());
        typed.push(format!("--spin-us={}", plan.spin_us).into());
        typed.push(format!("--seconds={seconds}").into());
        typed.push(format!("--work-ns={work_ns}").into());
        if let Some(core) = plan.core {
            typed.push(format!("--core={core}").into());
        }
        self.steal_over(|| {
            let (sender, events) = channel();
            let mut process = Process::start("bare loop", &typed, other_core(self.plan), &sender)?;
            // With the last sender gone, the events end when the process does.
            drop(sender);
            let deadline = Instant::now() + Duration::from_secs_f64(seconds + 30.0);
            let mut finished = None;
            while Instant::now() < deadline {
                match events.recv_timeout(Duration::from_millis(100)) {
                    Ok(Event::Line(_, line)) => {
                        if let Ok(SupervisedLine::Finished(result)) = serde_json::from_str(&line) {
                            finished = Some(*result);
                        }
                    }
                    Ok(Event::Said(..)) => {}
                    Err(RecvTimeoutError::Timeout) if is_set(stop) => process.terminate(),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
            }
            let status = process.wait(Duration::from_secs(1));
            finished.ok_or_else(|| process.failure(status))
        })
    }

    fn result(&self, args: &JitterArgs) -> JitterResult {
        let (ours, bare) = (self.ours.finish(), self.bare.finish());
        let wake_ratio = Ratio {
            p50: median(&self.wake_p50),
            p99: median(&self.wake_p99),
        };
        let (verdict, reasons) = judge(&Numbers {
            own_cpu_misses: ours.missed_own_cpu,
            page_faults: ours.page_faults,
            allocations: ours.allocations,
            operations_max: self.operations_max,
            operations_budget: self.operations_budget,
            ours_missed: share(ours.missed, ours.ticks),
            bare_missed: share(bare.missed, bare.ticks),
            bare_wake_p99_us: bare.wake_us.p99,
            wake_ratio_p50: wake_ratio.p50,
            wake_ratio_p99: wake_ratio.p99,
        });
        JitterResult {
            pairs: self.wake_p50.len() as u64,
            work_tail_ratio: median(&self.work_tail),
            operations_max: self.operations_max,
            operations_budget: self.operations_budget,
            load: args.load.name(),
            machine: Machine::read(),
            ours,
            bare,
            wake_ratio,
            verdict,
            reasons,
        }
    }
}

fn ratio(ours: f64, theirs: f64) -> f64 {
    if theirs > 0.0 { ours / theirs } else { 0.0 }
}

fn share(missed: u64, ticks: u64) -> f64 {
    ratio(missed as f64, (missed + ticks) as f64)
}

fn words(result: &JitterResult, rights: &[Right], picture: &Path) -> String {
    let machine = &result.machine;
    let mut text = format!(
        "machine     {}; kernel {} ({}); load {}\n",
        machine.processor, machine.kernel, machine.preemption, result.load
    );
    for right in rights {
        let _ = writeln!(text, "right       {}", right_words(right));
    }
    let loops = [("controller", &result.ours), ("bare loop", &result.bare)];
    let heads = "loop | µs | p50 | p99 | p99.9 | p99.99 | max";
    let mut table = Table::new(2, heads);
    for (name, side) in loops {
        for (what, tail) in [
            ("wake-up", &side.wake_us),
            ("work, thread CPU", &side.work_cpu_us),
            ("work, wall", &side.work_wall_us),
            ("period", &side.period_us),
        ] {
            let numbers = [tail.p50, tail.p99, tail.p999, tail.p9999, tail.max];
            let numbers = numbers.map(|us| format!("{us:.1}"));
            table.row([name, what].map(String::from).into_iter().chain(numbers));
        }
    }
    let _ = writeln!(text, "\n{table}");
    for (name, side) in loops {
        let m = &side.misses;
        let _ = writeln!(
            text,
            "{name:<11} {} ticks, {} missed: {} own work, {} own wait, {} run queue, {} late timer, {} stopped, {} stolen, {} unexplained; {} page faults, {} allocations, {} ticks of steal",
            side.ticks,
            side.missed,
            m.own_cpu,
            m.own_wait,
            m.run_queue,
            m.late_timer,
            m.stopped,
            m.stolen,
            m.unexplained,
            side.page_faults,
            side.allocations,
            side.steal_ticks
        );
    }
    let _ = write!(
        text,
        "\nover {} pairs of blocks, medians: wake-up p50 {:.2} and p99 {:.2} of the bare loop's; p99.9 of the work {:.2} of equally long arithmetic's\nworst tick  {} work units of a budget of {}\npicture     {}\nverdict     {}: {}\n",
        result.pairs,
        result.wake_ratio.p50,
        result.wake_ratio.p99,
        result.work_tail_ratio,
        result.operations_max,
        result.operations_budget,
        picture.display(),
        result.verdict.name(),
        result.reasons.join("; ")
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_blocks_have_the_percentiles_of_all_their_ticks() {
        let first: Buckets = vec![(1_000, 98), (50_000, 2)];
        let second: Buckets = vec![(2_000, 99), (900_000, 1)];
        let all: Buckets = first.into_iter().chain(second).collect();
        let tail = tail_of(&all, 890.0);
        assert!((tail.p50 - 2.0).abs() < 0.01, "{tail:?}");
        assert!((tail.p99 - 50.0).abs() < 0.1, "{tail:?}");
        assert_eq!((tail.p9999, tail.max), (890.0, 890.0));
        assert_eq!(tail_of(&Vec::new(), 0.0), Tail::default());
    }
}
