//! `rt-tests tune`: the settings of a scene that keep a limit of error, time, bytes or memory on
//! this machine, and what the next step would cost.
//!
//! One dial is turned: the tolerance at the contact (with `--memory` the cache is as large as
//! allowed). Errors, bytes and pressure on the cache are measured in virtual time, where both cores
//! run with the scene's own hand. Each limit has an edge on the
//! dial, found by bisection: an error is kept below its edge, a cost above. The result is then run
//! by both processes; where that run breaks a limit, or stays far from a time, the dial is turned
//! on, and the best of these runs is the result.
//!
//! | module | holds |
//! |---|---|
//! | `asked` | the limits as typed, and whether a run kept them |
//! | `trial` | a touch with given settings |
//! | `search` | the bisection, and the runs that correct it |
//! | `words` | the fragment, and the result in words |

mod asked;
mod search;
mod trial;
mod words;

pub use asked::{Asked, LimitArgs};
pub use trial::Cost;

use crate::failure::Failure;
use crate::processes::stop::stop_flag;
use crate::report::output::{print_either, status_line};
use crate::report::units::{bytes, length};
use crate::scenes::{SceneFile, check_seconds, prepare_models};
use clap::Args;
use hrtc::run::FIXED_BYTES;
use indicatif::ProgressBar;
use scene::{ObjectPlan, RefinementPlan, ScenePlan};
use scene_args::OverrideArgs;
use search::{ERROR, Tried, Verdict, corrected, edge, finer, rounded};
use serde::Serialize;
use std::path::PathBuf;
use trial::{Bench, MORE_COARSER, Mode, RUNS, Run, Settings};

/// The dial reaches from so many diagonals of the smallest object, below which every scan is at
/// full resolution, to one of the largest, at which everything is at its base mesh.
const DIAL: (f64, f64) = (1e-6, 1.0);
/// An error in virtual time is to be below what was asked for by this factor, and a time of the
/// search: the hand of a real run goes another path by microns, and its ticks differ. It is below
/// the 1.5 at which settings are called wasteful.
const MARGIN: f64 = 1.15;
/// Times that the dial is turned on where the run breaks a limit, or stays far from a time.
const MAX_CORRECTIONS: usize = 3;
/// The next step up is finer by this factor.
const NEXT: f64 = 2.0;
/// Other machines that the settings are predicted for take so many times as long.
const SLOWER: [f64; 3] = [2.0, 4.0, 8.0];

/// Arguments of `rt-tests tune`.
#[derive(Debug, Args)]
pub struct TuneArgs {
    /// The scene [default: the bundled first-touch scene]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// What is to be kept.
    #[command(flatten)]
    pub limits: LimitArgs,
    /// Length of each touch, seconds
    #[arg(
        long,
        value_name = "S",
        default_value_t = 10.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Over the scene.
    #[command(flatten)]
    pub overrides: OverrideArgs,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Tuned {
    /// The scene.
    pub scene: String,
    /// The limits.
    pub asked: Asked,
    /// The settings as a fragment of a scene.
    pub settings: String,
    /// The tolerance in it, metres.
    pub tolerance_m: f64,
    /// The cache in it, bytes.
    pub cache_bytes: u64,
    /// What the search found for the settings.
    pub predicted: Asked,
    /// What both processes then measured.
    pub measured: Asked,
    /// Whether they kept every limit.
    pub met: bool,
    /// Which limit binds, in words.
    pub binds: String,
    /// All that the settings cost in that run.
    pub cost: Cost,
    /// The next finer tolerance, metres, and what it costs; left out at the full mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<(f64, Cost)>,
    /// Machines that take so many times as long, and what the settings cost there by the table of
    /// the governor, in virtual time.
    pub slower: Vec<(f64, Cost)>,
    /// Touches that were tried, in virtual time and by both processes.
    pub trials: [usize; 2],
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input, 1 when the limits cannot be kept.
pub fn tune(args: &TuneArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let asked = args.limits.parsed()?;
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let scene = SceneFile::named_or_bundled(args.scene.as_deref())?;
    let bench = Bench {
        scene: scene.path(),
        overrides: &args.overrides,
        seconds: args.seconds,
        stop: &stop,
    };
    let mut search = Search::new(&bench, asked)?;
    let tuned = search.tuned()?;
    search.line.finish_and_clear();
    print_either(args.json, &words::words(&tuned), &tuned)?;
    if tuned.met {
        return Ok(());
    }
    Err(Failure::Run(
        "the run did not keep what was asked for; give more with --seconds, or ask for less"
            .to_string(),
    ))
}

/// A search on the dial of a scene.
struct Search<'a> {
    bench: &'a Bench<'a>,
    asked: Asked,
    plan: ScenePlan,
    /// The dial's ends, metres.
    dial: (f64, f64),
    cache_bytes: usize,
    line: ProgressBar,
    trials: [usize; 2],
    /// A tick of a run over one in virtual time: the loop around it, caches that were cold.
    loop_over_tick: f64,
    /// Ticks in virtual time by tolerance.
    times: Vec<(f64, f64)>,
}

impl<'a> Search<'a> {
    fn new(bench: &'a Bench<'a>, asked: Asked) -> Result<Self, Failure> {
        let plan = bench.plan(&bench.overrides.overrides())?;
        if let RefinementPlan::Global { lod: Some(_) } = plan.accuracy.refinement {
            return Err(Failure::Input(format!(
                "{}: lod fixes how fine the model is, so there is nothing to tune; leave it out",
                plan.name
            )));
        }
        let dial = dial(&diagonals_m(&plan)?);
        let cache_bytes = match asked.memory_bytes {
            None => plan.cache_bytes,
            Some(memory) => (memory as usize).checked_sub(FIXED_BYTES).ok_or_else(|| {
                Failure::Input(format!(
                    "--memory: rings and stacks alone take {}, give more",
                    bytes(FIXED_BYTES as u64)
                ))
            })?,
        };
        Ok(Self {
            bench,
            asked,
            plan,
            dial,
            cache_bytes,
            line: status_line(),
            trials: [0; 2],
            loop_over_tick: 1.0,
            times: Vec::new(),
        })
    }

    fn settings(&self, tolerance_m: f64) -> Settings {
        Settings {
            tolerance_m,
            cache_bytes: self.cache_bytes,
        }
    }

    fn simulate(&mut self, tolerance_m: f64) -> Result<Cost, Failure> {
        self.trials[0] += 1;
        let at = length(tolerance_m);
        self.line
            .set_message(format!("tolerance {at}, in virtual time"));
        self.bench.simulate(self.settings(tolerance_m), Mode::Plain)
    }

    /// What the settings cost on slower machines than that of a run.
    fn slower(&mut self, tolerance_m: f64, run: &Run) -> Result<Vec<(f64, Cost)>, Failure> {
        let mut found = Vec::with_capacity(SLOWER.len());
        for factor in SLOWER {
            self.trials[0] += 1;
            self.line
                .set_message(format!("a machine that takes {factor} times as long"));
            let mode = Mode::On(run.slower(factor));
            found.push((
                factor,
                self.bench.simulate(self.settings(tolerance_m), mode)?,
            ));
        }
        Ok(found)
    }

    /// A tick in virtual time, µs.
    fn tick_us(&mut self, tolerance_m: f64) -> Result<f64, Failure> {
        if let Some(&(_, us)) = self.times.iter().find(|(at, _)| *at == tolerance_m) {
            return Ok(us);
        }
        self.trials[0] += 1;
        let at = length(tolerance_m);
        self.line
            .set_message(format!("tolerance {at}, timed in virtual time"));
        let us = self
            .bench
            .simulate(self.settings(tolerance_m), Mode::Timed)?
            .time_us;
        self.times.push((tolerance_m, us));
        Ok(us)
    }

    fn run(&mut self, tolerance_m: f64, runs: usize) -> Result<Run, Failure> {
        self.trials[1] += runs;
        let at = length(tolerance_m);
        self.line
            .set_message(format!("tolerance {at}, both processes, {runs} times"));
        self.bench.run(self.settings(tolerance_m), runs)
    }

    /// Runs that an error or a time needs; bytes and memory are the same in each.
    fn runs(&self) -> usize {
        if self.asked.time_us.is_some() || self.asked.error_m.is_some() {
            RUNS
        } else {
            1
        }
    }

    /// The coarsest tolerance that keeps the error; an error that the base mesh keeps has no edge.
    fn of_error(&mut self, error_m: f64) -> Result<f64, Failure> {
        let kept = |cost: &Cost| cost.measured_errors > 0 && cost.error_m * MARGIN <= error_m;
        let full = self.simulate(0.0)?;
        if full.measured_errors == 0 {
            return Err(Failure::Run(
                "no error was measured at a contact, so none can be kept; give more with --seconds"
                    .to_string(),
            ));
        }
        if !kept(&full) && full.error_m <= error_m {
            // There is nothing finer: the run decides.
            return Ok(0.0);
        }
        if !kept(&full) {
            return Err(Failure::Run(format!(
                "even where the full mesh is asked for, a contact was {} away from it ({:.0} % of the ticks in contact had \
                 a coarser front for want of time or room): go slower, or allow more operations or a larger cache",
                length(full.error_m),
                100.0 * full.coarser
            )));
        }
        if kept(&self.simulate(self.dial.1)?) {
            return Ok(self.dial.1);
        }
        let dial = self.dial;
        let (low, _) = edge(dial, &mut |tolerance| Ok(kept(&self.simulate(tolerance)?)))?;
        Ok(if low > dial.0 { low } else { 0.0 })
    }

    /// The finest tolerance that keeps a cost; none where not even the base mesh does.
    fn of_cost(&mut self, limit: &Limit) -> Result<Option<f64>, Failure> {
        if limit.is_kept(self, 0.0, MARGIN)? {
            return Ok(Some(0.0));
        }
        let dial = self.dial;
        if !limit.is_kept(self, dial.1, MARGIN)? {
            // There is nothing coarser: the run decides.
            let is_kept = limit.is_kept(self, dial.1, 1.0)?;
            return Ok(is_kept.then_some(dial.1));
        }
        let (_, high) = edge(dial, &mut |tolerance| {
            Ok(!limit.is_kept(self, tolerance, MARGIN)?)
        })?;
        Ok(Some(high))
    }

    /// The tolerance to begin with, and which limit binds, by name.
    fn tolerance(&mut self) -> Result<(f64, Option<&'static str>), Failure> {
        let mut finest = (0.0, None);
        let limits: Vec<Limit> = Limit::of(&self.asked).collect();
        for limit in limits {
            let name = limit.name();
            let tolerance = self.of_cost(&limit)?.ok_or_else(|| {
                Failure::Run(format!("not even the base mesh keeps {name}; ask for less"))
            })?;
            if tolerance > finest.0 {
                finest = (tolerance, Some(name));
            }
        }
        let Some(error_m) = self.asked.error_m else {
            return Ok(finest);
        };
        let coarsest = self.of_error(error_m)?;
        if coarsest < finest.0 {
            return Err(Failure::Run(format!(
                "the limits contradict each other: {} needs a tolerance of {} or coarser, {ERROR} one of {} or finer",
                finest.1.unwrap_or_default(),
                length(finest.0),
                length(coarsest)
            )));
        }
        Ok((coarsest, Some(ERROR)))
    }

    /// Which limit binds, in words; `name` is that of the last one that a run broke, or the search.
    fn binds(&self, tolerance: f64, met: bool, name: Option<&'static str>) -> String {
        let is_error = self.asked.error_m.is_some();
        let binds = if met && !is_error && tolerance == 0.0 {
            "nothing: the full mesh keeps every limit"
        } else if met && is_error && tolerance >= self.dial.1 {
            "nothing: the base mesh keeps the error"
        } else {
            name.unwrap_or("nothing")
        };
        binds.to_string()
    }

    /// Both processes at a tolerance, with the time of a tick that was expected, µs, and, while
    /// corrections are left, where the next run may do.
    fn tried(&mut self, tolerance: f64, left: usize) -> Result<Tried<(Run, f64)>, Failure> {
        let expected_us = match self.asked.time_us {
            Some(_) => self.tick_us(tolerance)? * self.loop_over_tick,
            None => 0.0,
        };
        let run = self.run(tolerance, self.runs())?;
        let verdict = self.asked.verdict(tolerance, &run.cost);
        let guess = match left {
            0 => None,
            _ => self.guess(tolerance, &run.cost, verdict)?,
        };
        Ok(Tried {
            run: (run, expected_us),
            verdict,
            guess,
        })
    }

    /// The finest tolerance that keeps the time or the bytes by what a run measured, where it broke
    /// them or was far from the time. None beside an error: its margin is but a step or two wide.
    fn guess(
        &mut self,
        tolerance: f64,
        cost: &Cost,
        verdict: Verdict,
    ) -> Result<Option<f64>, Failure> {
        let is_turned = matches!(verdict, Verdict::Far | Verdict::TooFine(_));
        if self.asked.error_m.is_some() || !is_turned {
            return Ok(None);
        }
        let mut limits = Vec::new();
        if let Some(us) = self.asked.time_us
            && (cost.time_us > us || verdict == Verdict::Far)
        {
            self.loop_over_tick = cost.time_us / self.tick_us(tolerance)?;
            limits.push(Limit::Time(us));
        }
        if let Some(bytes) = self.asked.bytes
            && cost.bytes > bytes
        {
            let in_virtual_time = self.simulate(tolerance)?.bytes;
            limits.push(Limit::Bytes(bytes * in_virtual_time / cost.bytes));
        }
        let mut guess: Option<f64> = None;
        for limit in limits {
            let finest = self.of_cost(&limit)?.unwrap_or(self.dial.1);
            guess = Some(guess.map_or(finest, |guess| guess.max(finest)));
        }
        Ok(guess)
    }

    fn tuned(&mut self) -> Result<Tuned, Failure> {
        if self.asked.time_us.is_some() {
            self.loop_over_tick = self.run(0.0, 1)?.cost.time_us / self.tick_us(0.0)?;
        }
        let (start, mut binds) = self.tolerance()?;
        let dial = self.dial;
        let (tolerance, (run, expected_us)) =
            corrected(dial, start, MAX_CORRECTIONS, &mut |tolerance, left| {
                let tried = self.tried(tolerance, left)?;
                binds = tried.verdict.broken().or(binds);
                Ok(tried)
            })?;
        let cost = run.cost;
        let met = self.asked.verdict(tolerance, &cost).is_kept();
        let mut predicted = self.simulate(tolerance)?;
        predicted.time_us = expected_us;
        let next = if tolerance > 0.0 {
            let finer = finer(dial, tolerance, NEXT);
            Some((finer, self.run(finer, 1)?.cost))
        } else {
            None
        };
        let slower = self.slower(tolerance, &run)?;
        Ok(Tuned {
            scene: self.plan.name.clone(),
            asked: self.asked,
            settings: words::fragment(&self.plan, self.settings(tolerance)),
            tolerance_m: tolerance,
            cache_bytes: self.cache_bytes as u64,
            predicted: self.of_asked(&predicted),
            measured: self.of_asked(&cost),
            met,
            binds: self.binds(tolerance, met, binds),
            cost,
            next,
            slower,
            trials: self.trials,
        })
    }

    /// Of a cost the parts that were asked for.
    fn of_asked(&self, cost: &Cost) -> Asked {
        let error_m = self.asked.error_m.filter(|_| cost.measured_errors > 0);
        Asked {
            error_m: error_m.map(|_| cost.error_m),
            time_us: self.asked.time_us.map(|_| cost.time_us),
            bytes: self.asked.bytes.map(|_| cost.bytes),
            memory_bytes: self.asked.memory_bytes.map(|_| cost.memory_bytes),
        }
    }
}

/// A limit that a coarser tolerance keeps.
enum Limit {
    /// Of the time of a tick, µs.
    Time(f64),
    /// Of the bytes received.
    Bytes(f64),
    /// Of the cache: the share of ticks coarser than asked for where there is room for all.
    Memory,
}

impl Limit {
    fn of(asked: &Asked) -> impl Iterator<Item = Self> {
        let memory = asked.memory_bytes.map(|_| Self::Memory);
        let bytes = asked.bytes.map(Self::Bytes);
        memory
            .into_iter()
            .chain(bytes)
            .chain(asked.time_us.map(Self::Time))
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Time(_) => "the time",
            Self::Bytes(_) => "the bytes",
            Self::Memory => "the memory",
        }
    }

    /// Whether a tolerance keeps it, with a margin.
    fn is_kept(
        &self,
        search: &mut Search<'_>,
        tolerance: f64,
        margin: f64,
    ) -> Result<bool, Failure> {
        Ok(match self {
            Self::Time(us) => search.tick_us(tolerance)? * search.loop_over_tick * margin <= *us,
            Self::Bytes(bytes) => search.simulate(tolerance)?.bytes * margin <= *bytes,
            Self::Memory => {
                let cost = search.simulate(tolerance)?;
                let room = std::mem::replace(&mut search.cache_bytes, AMPLE_BYTES);
                let ample = search.simulate(tolerance);
                search.cache_bytes = room;
                cost.coarser <= ample?.coarser + MORE_COARSER
            }
        })
    }
}

/// A cache with room for any model that a scene touches in seconds.
const AMPLE_BYTES: usize = 256 << 20;

/// Diagonals of the objects, metres.
fn diagonals_m(plan: &ScenePlan) -> Result<Vec<f64>, Failure> {
    let opened = prepare_models(plan)?;
    let diagonal_m = |object: &ObjectPlan| -> Result<f64, Failure> {
        let name = object.model.name();
        let model = opened.models.iter().find(|model| model.name == name);
        let model = model.ok_or_else(|| Failure::Run(format!("{name} is not there")))?;
        let header = model.file.model_header();
        let longest = ve_station::inspect::longest_side(&header);
        Ok(header.diagonal * object.scale.metres_per_unit(longest))
    };
    plan.objects.iter().map(diagonal_m).collect()
}

/// The dial's ends for objects of these diagonals, metres: the tolerance is that of all of them.
fn dial(diagonals_m: &[f64]) -> (f64, f64) {
    let smallest = diagonals_m.iter().copied().fold(f64::INFINITY, f64::min);
    let largest = diagonals_m.iter().copied().fold(0.0, f64::max);
    (rounded(DIAL.0 * smallest), rounded(DIAL.1 * largest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dial_reaches_over_all_objects_of_a_scene() {
        for diagonals_m in [[0.02, 2.0], [2.0, 0.02]] {
            assert_eq!(dial(&diagonals_m), (2e-8, 2.0), "{diagonals_m:?}");
        }
        assert_eq!(dial(&[0.3]), (3e-7, 0.3));
    }
}
