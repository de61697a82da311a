//! The rounds of a run: blocks of the controller, of the reference loop and of the bare loop.

use super::side::Blocks;
use super::verdict::Worst;
use crate::failure::Failure;
use crate::machine::steal_ticks;
use crate::processes::bare_loop::{BareWork, run_bare};
use crate::processes::load::Load;
use crate::processes::pair::{PairArgs, Shown, other_core, run_pair};
use crate::processes::process::Process;
use crate::processes::roles::LoopArgs;
use crate::processes::stop::is_set;
use crate::report::output::status_line;
use crate::report::quantile::median;
use hrtc::result::{Finished, Right, RunResult};
use hrtc::run::next_tick_core;
use indicatif::ProgressBar;
use scene::ScenePlan;
use scene_args::OverrideArgs;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;
use std::time::Duration;

/// Rounds at the least: fewer medians mean nothing.
const FEWEST_ROUNDS: usize = 5;
/// Rounds at the most.
const MAX_ROUNDS: usize = 20;
/// A round grows to this length before there are more of them, seconds.
const ROUND_S: f64 = 24.0;
/// Shares of a round: controller, reference loop, bare loop. Controller and reference are compared
/// by their maxima too, so they are equally long.
const SHARES: [f64; 3] = [0.4, 0.4, 0.2];
/// Shortest block of the controller, seconds: in less nothing is touched, since its hand waits for
/// the path that the station makes.
const SHORTEST_BLOCK_S: f64 = 0.5;
/// Shortest run, seconds.
const SHORTEST_S: f64 = SHORTEST_BLOCK_S * FEWEST_ROUNDS as f64 / SHARES[0];
/// Wake-ups that differ by less are equal, microseconds: between deadline and tick the loop reads
/// its clocks and the kernel's counters. A spun wake-up has no more delay than that.
const SAME_WAKE_US: f64 = 1.0;

/// Checks that a run is long enough for its blocks.
///
/// # Errors
/// One sentence with the shortest.
pub(super) fn check_blocks(seconds: f64) -> Result<(), Failure> {
    if seconds >= SHORTEST_S {
        return Ok(());
    }
    Err(Failure::Input(format!(
        "--seconds is {seconds}, too short for {FEWEST_ROUNDS} rounds with a touch in each; write at \
         least {SHORTEST_S}"
    )))
}

/// What is measured.
pub(super) struct Setup<'a> {
    pub scene: &'a Path,
    pub plan: &'a ScenePlan,
    pub overrides: &'a OverrideArgs,
    pub loop_: LoopArgs,
    pub load: Load,
    pub seconds: f64,
}

/// A block and the steal during it.
type Block = (Finished, u64);

/// What was measured.
pub(super) struct Measurement<'a> {
    setup: Setup<'a>,
    pub ours: Blocks,
    pub reference: Blocks,
    pub bare: Blocks,
    pub wake_p50: Vec<f64>,
    pub wake_p99: Vec<f64>,
    pub work_tail: Vec<f64>,
    /// Medians of the controller's work so far, microseconds.
    work_us: Vec<f64>,
    pub operations: Worst,
    pub queries: Worst,
    /// Ticks in contact, and the least share of them in a block.
    pub contact_ticks: u64,
    pub contact_share: f64,
    pub non_finite: BTreeSet<String>,
    pub rights: Vec<Right>,
    bar: ProgressBar,
}

impl<'a> Measurement<'a> {
    pub fn new(setup: Setup<'a>) -> Self {
        Self {
            setup,
            ours: Blocks::default(),
            reference: Blocks::default(),
            bare: Blocks::default(),
            wake_p50: Vec::new(),
            wake_p99: Vec::new(),
            work_tail: Vec::new(),
            work_us: Vec::new(),
            operations: Worst::default(),
            queries: Worst::default(),
            contact_ticks: 0,
            contact_share: 1.0,
            non_finite: BTreeSet::new(),
            rights: Vec::new(),
            bar: status_line(),
        }
    }

    /// Runs every round beside the load.
    ///
    /// # Errors
    /// When a process fails, or the run was ended before every round was measured.
    pub fn run(mut self, stop: &AtomicBool) -> Result<Self, Failure> {
        check_stop(stop)?;
        let (sender, events) = channel();
        let mut load = match self.setup.load {
            Load::None => None,
            kind => Some(Process::start(
                "load",
                &["role-load".into(), kind.name().into()],
                other_core(self.setup.plan),
                &sender,
            )?),
        };
        let rounds = ((self.setup.seconds / ROUND_S) as usize).clamp(FEWEST_ROUNDS, MAX_ROUNDS);
        for round in 0..rounds {
            self.bar
                .set_message(format!("round {} of {rounds}", round + 1));
            self.round(round, rounds, stop)?;
            check_stop(stop)?;
            // Without its load a round says something else.
            if let Some(load) = &mut load
                && let Some(status) = load.ended()
            {
                load.wait(Duration::from_secs(1));
                return Err(load.failure(Some(status)));
            }
        }
        if let Some(mut load) = load {
            load.terminate();
            load.wait(Duration::from_secs(5));
        }
        drop(events);
        self.bar.finish_and_clear();
        Ok(self)
    }

    /// Which block comes first alternates, so that a machine that slows down or warms up favours
    /// none. The reference loop runs right beside the controller, with the median of its work.
    fn round(&mut self, round: usize, rounds: usize, stop: &AtomicBool) -> Result<(), Failure> {
        let seconds = SHARES.map(|share| share * self.setup.seconds / rounds as f64);
        let (ours, reference, bare);
        if round.is_multiple_of(2) {
            ours = self.ours_block(seconds[0], stop)?;
            self.work_us.push(ours.0.result.work_us.p50);
            reference = self.loop_block(seconds[1], self.work_ns(), stop)?;
            bare = self.loop_block(seconds[2], 0, stop)?;
        } else {
            bare = self.loop_block(seconds[2], 0, stop)?;
            reference = self.loop_block(seconds[1], self.work_ns(), stop)?;
            ours = self.ours_block(seconds[0], stop)?;
            self.work_us.push(ours.0.result.work_us.p50);
        }
        self.add_round(&ours, &reference, &bare);
        Ok(())
    }

    /// Median work of the controller so far.
    fn work_ns(&self) -> u64 {
        (median(&self.work_us) * 1e3) as u64
    }

    fn add_round(&mut self, ours: &Block, reference: &Block, bare: &Block) {
        self.ours.add(&ours.0, ours.1);
        self.reference.add(&reference.0, reference.1);
        self.bare.add(&bare.0, bare.1);
        let of = |block: &'_ Block| block.0.result.clone();
        let (result, reference, bare) = (of(ours), of(reference), of(bare));
        let (wake, bare_wake) = (&result.wake_us, &bare.wake_us);
        self.wake_p50.push(wake_ratio(wake.p50, bare_wake.p50));
        self.wake_p99.push(wake_ratio(wake.p99, bare_wake.p99));
        let tail = result.work_us.p999 / reference.work_us.p999;
        self.work_tail.push(tail);
        self.add_controller(&result);
        self.rights.clone_from(&ours.0.rights);
    }

    fn add_controller(&mut self, result: &RunResult) {
        for (worst, max, budget) in [
            (
                &mut self.operations,
                result.operations_max,
                result.operations_budget,
            ),
            (
                &mut self.queries,
                result.query_work_max,
                result.query_work_budget,
            ),
        ] {
            worst.max = worst.max.max(max);
            worst.budget = budget;
        }
        self.contact_ticks += result.contact_ticks;
        let share = result.contact_ticks as f64 / result.ticks.max(1) as f64;
        self.contact_share = self.contact_share.min(share);
        self.non_finite.extend(result.non_finite.iter().cloned());
    }

    /// A block with the steal during it. What an end on request looks like in its processes is no
    /// failure of theirs.
    fn steal_over(
        &self,
        stop: &AtomicBool,
        block: impl FnOnce() -> Result<Finished, Failure>,
    ) -> Result<Block, Failure> {
        let core = next_tick_core(&self.setup.plan.loop_);
        let before = steal_ticks(core);
        let done = block();
        check_stop(stop)?;
        Ok((done?, steal_ticks(core).saturating_sub(before)))
    }

    fn ours_block(&self, seconds: f64, stop: &AtomicBool) -> Result<Block, Failure> {
        let pair = PairArgs {
            scene: self.setup.scene,
            plan: self.setup.plan,
            seconds,
            overrides: self.setup.overrides,
            loop_: self.setup.loop_,
            record: None,
            device: None,
        };
        let bar = &self.bar;
        let mut show = |shown: Shown| {
            if let Shown::Said(name, line) = shown
                && line.contains("warning")
            {
                bar.println(format!("{name}: {line}"));
            }
        };
        self.steal_over(stop, || run_pair(&pair, stop, &mut show)?.undisturbed())
    }

    /// A block of the loop with fixed arithmetic, or with an empty body for 0 ns.
    fn loop_block(&self, seconds: f64, work_ns: u64, stop: &AtomicBool) -> Result<Block, Failure> {
        let plan = &self.setup.plan.loop_;
        let core = other_core(self.setup.plan);
        let work = BareWork {
            ns: work_ns,
            slow: 1.0,
        };
        self.steal_over(stop, || run_bare(plan, core, seconds, work, stop))
    }
}

/// # Errors
/// When the command is to end.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run(
            "ended on request before every round was measured; there is no verdict".to_string(),
        ));
    }
    Ok(())
}

/// Ours over theirs; what is below [`SAME_WAKE_US`] is equal.
fn wake_ratio(ours: f64, theirs: f64) -> f64 {
    ours.max(SAME_WAKE_US) / theirs.max(SAME_WAKE_US)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_without_time_for_a_touch_in_each_block_is_refused_with_the_shortest() {
        assert_eq!(check_blocks(SHORTEST_S), Ok(()));
        let refused = check_blocks(SHORTEST_S - 0.01).expect_err("it is too short");
        assert_eq!(refused.status(), 2);
        assert!(refused.to_string().ends_with("at least 6.25"), "{refused}");
    }

    #[test]
    fn wake_ups_without_a_delay_are_equal_and_no_best_value_comes_from_nothing() {
        assert_eq!(wake_ratio(0.05, 0.0), 1.0);
        assert_eq!(wake_ratio(3.0, 0.0), 3.0);
        assert_eq!(wake_ratio(20.0, 10.0), 2.0);
    }
}
