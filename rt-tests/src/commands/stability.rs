//! `rt-tests stability`: the hard cases ([`crate::cases`]), each with its measure, limit and
//! verdict; the faults in the product that they must find; and the same cases with another
//! library's proxy in the place of ours.
//!
//! | module | holds |
//! |---|---|
//! | `asked` | which cases another proxy can be asked |
//! | `kills` | each case with its fault in the product, beside the same case without it |
//! | `step_times` | what a step of ours and of theirs takes |
//! | `page`, `words` | all of it as a page, peers as tables |

mod asked;
mod kills;
mod page;
mod step_times;
mod words;

use crate::cases::case::Logged;
use crate::cases::contender::Contender;
use crate::cases::setup::{Departure, Setup};
use crate::cases::{Case, Found, ProbeOfCase, Size, all};
use crate::failure::{Chosen, Failure};
use crate::peers::ball::PeerProgram;
use crate::report::output::{
    make_folder, make_folder_at, print, print_json, status_bar, write_json, write_whole,
};
use crate::report::table::Table;
use crate::report::units::grouped;
use clap::Args;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use rayon::prelude::*;
use serde::Serialize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use step_times::{StepTimes, step_times};

/// Arguments of `rt-tests stability`.
#[derive(Debug, Args)]
pub struct StabilityArgs {
    /// Run these cases only, by name
    #[arg(value_name = "CASE")]
    pub cases: Vec<String>,
    /// Run the full set: up to a million passes a case, an hour and a half on two cores
    #[arg(long)]
    pub full: bool,
    /// Rate of the loop, 250 to 4000 ticks a second, at which the cases are tested; the stiffness
    /// of every surface and effect goes with it and damping stays, so that (K T/2 + B) / b does
    #[arg(long, value_name = "HZ", default_value_t = 1000.0, value_parser = rate)]
    pub rate: f64,
    /// Run every case with a cache of 2 MiB, and over a link that delays by 20 to 40 ms and loses
    /// 2 % of what it carries; but moving-object, whose object would be past before it is there
    #[arg(long)]
    pub small_lossy: bool,
    /// Seed of everything that is random
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Put each case's fault into the product: every case but the open ones is to fail with it, and
    /// to pass without. Needs a build with --features mutants
    #[arg(long, alias = "faults")]
    pub mutants: bool,
    /// Print each case's parameters beside the facts, and where it departs from the product
    #[arg(long)]
    pub parameters: bool,
    /// Ask another library's proxy the same, by this program, built from rt-tests/peers
    #[arg(long, value_name = "PROGRAM")]
    pub peers: Option<PathBuf>,
    /// With --peers: mesh or SPM files, or shapes as SHAPE:FACES, on which a step of both is timed
    /// [default: relief:100000]
    #[arg(long = "model", value_name = "MODEL", requires = "peers")]
    pub models: Vec<String>,
    /// Write what another proxy would be asked to a folder, a file a scene: CASE.N.ball, and with
    /// --peers the paths on which a step is timed: MODEL.ball
    #[arg(long, value_name = "DIR", conflicts_with = "mutants")]
    pub export: Option<PathBuf>,
    /// Folder for stability.json and the page
    #[arg(long, value_name = "DIR", default_value = "reports/stability")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// Departures of a run with `--small-lossy`.
const SMALL_LOSSY: [Departure; 2] = [Departure::SmallCache, Departure::LossyLink];

/// Cases that are not run so: their object comes at 1 m/s from the first tick on, and would be past
/// before a model is there whose parts are lost. Without a touch nothing is shown.
const NOT_SMALL_LOSSY: [&str; 2] = ["moving-object", "moving-object-free"];

/// A rate at which the cases are tested. A scene may have a lower or higher one; what the cases ask
/// in a tick is not asked there.
fn rate(typed: &str) -> Result<f64, String> {
    let hertz = typed.parse().ok();
    let hertz = hertz.filter(|hertz| (250.0..=4000.0).contains(hertz));
    hertz.ok_or_else(|| {
        "the cases are tested at 250 to 4000 ticks a second; write a number of these".to_string()
    })
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Stability {
    /// Seed of everything that is random.
    pub seed: u64,
    /// Whether the full set was run.
    pub full: bool,
    /// Rate of the loop, 1/s.
    pub rate_hz: f64,
    /// Whether every case had a cache of 2 MiB and a lossy link.
    pub small_lossy: bool,
    /// The cases, in the order of the table; none with `--mutants`.
    pub cases: Vec<Verdict>,
    /// What a step takes, with `--peers` only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub step_times: Vec<StepTimes>,
    /// The faults in the product, with `--mutants` only; those of open cases are not in JSON, where
    /// a script asks whether all are killed.
    #[serde(
        skip_serializing_if = "Vec::is_empty",
        serialize_with = "kills::closed"
    )]
    pub mutants: Vec<MutantFound>,
}

impl Stability {
    /// What was run, in a line.
    fn head(&self) -> String {
        let Self { seed, rate_hz, .. } = self;
        let departures = self.departures();
        format!("hard cases at {rate_hz} Hz{departures}, seed {seed}")
    }

    /// Where all of it departs from the product.
    fn departures(&self) -> String {
        if self.small_lossy {
            let [cache, link] = SMALL_LOSSY.map(Departure::setting);
            format!(" with {cache} and a link of {link}")
        } else {
            String::new()
        }
    }
}

/// What a case came to.
#[derive(Debug, Serialize)]
pub struct Verdict {
    /// Its name.
    pub name: &'static str,
    /// Its number in the facts; "" where it is ours.
    pub number: &'static str,
    /// What is measured.
    pub measure: &'static str,
    /// The worst that was seen.
    pub value: f64,
    /// The most that may be seen.
    pub limit: f64,
    /// Whether it kept to it.
    pub pass: bool,
    /// Whether what was measured did, whatever must happen beside it.
    #[serde(skip)]
    pub measure_keeps: bool,
    /// Why it is known not to.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub open: &'static str,
    /// What it is known to come to at the most then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known: Option<f64>,
    /// Measurements made.
    pub passes_run: u64,
    /// What it touches with.
    pub probe: ProbeOfCase,
    /// Where it departs from the product's defaults, and why; empty where it runs on them.
    pub defaults: Vec<String>,
    /// Parameters of the facts.
    pub facts: &'static str,
    /// Parameters of its full run.
    pub runs: &'static str,
    /// Other numbers, without a limit.
    pub logged: Vec<Logged>,
    /// Why it could not be run to its end.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub error: String,
    /// The fault in the product under which it must fail.
    pub mutant: String,
    /// Other proxies, with `--peers` only.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub peers: Vec<PeerVerdict>,
    /// What other proxies have no equal of; "" where they are asked.
    pub no_equal: &'static str,
}

/// What a case came to with another proxy, by the same measure and limit.
#[derive(Debug, Serialize)]
pub struct PeerVerdict {
    /// Its name.
    pub who: String,
    /// The worst that was seen.
    pub value: f64,
    /// Whether it kept to the limit.
    pub pass: bool,
    /// Ticks that it answered.
    pub steps: u64,
    /// Why the value is what it is, where no number tells it.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
    /// Whether the program is at fault, not its proxy: no number here means anything.
    pub broken: bool,
}

/// A fault in the product, and whether a case found it.
#[derive(Debug, Clone, Serialize)]
pub struct MutantFound {
    /// Its name.
    pub name: String,
    /// The case that is to find it.
    pub case: &'static str,
    /// Whether it did.
    pub killed: bool,
    /// Whether it did by what must happen alone: the measure kept to its limit.
    pub by_premise: bool,
    /// Whether that could be told: without the fault the case keeps to its limit.
    pub judged: bool,
    /// Why the case is known not to keep to its limit; it is not run then.
    #[serde(skip)]
    pub open: &'static str,
    /// Why it could not be told, or why what happened is no kill.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub note: String,
}

impl Verdict {
    /// Whether the command fails by it. That a case is known to be beyond its limit excuses what it
    /// is known to come to, and nothing of a run that broke off or measured nothing. What is no
    /// number, and what must happen and did not, is beyond everything.
    #[must_use]
    pub fn fails(&self) -> bool {
        let is_measured = self.error.is_empty() && self.passes_run > 0;
        let is_known = self.known.is_some_and(|known| self.value <= known);
        !(self.pass || is_measured && is_known)
    }

    /// Whether it keeps to a limit that it is known not to keep to.
    fn is_better_than_known(&self) -> bool {
        self.pass && !self.open.is_empty()
    }

    /// What one sees of it while others still run.
    fn sentence(&self) -> String {
        let [seen, limit] = [self.value, self.limit].map(number);
        format!("{}: {}, {seen} of {limit}", self.name, self.word())
    }

    /// The verdict in a word.
    fn word(&self) -> &'static str {
        match (self.pass, self.fails()) {
            (true, _) => "pass",
            (false, true) => "FAIL",
            (false, false) => "open",
        }
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a name that is no case, a peer that is none, or `--mutants` in a
/// build without them; 1 when a case fails, a mutant lives, could not be judged or breaks no
/// measure of any of its cases, or a peer breaks off.
pub fn stability(args: &StabilityArgs) -> Result<(), Failure> {
    make_folder(&args.out)?;
    let found = run_cases(args)?;
    write_json(&args.out.join("stability.json"), &found)?;
    let page = page::page(&found);
    write_whole(&args.out.join("stability.html"), page.as_bytes())?;
    if args.json {
        print_json(&found)?;
    } else if args.mutants {
        print(&kills::table(&found))?;
    } else {
        print(&table(&found))?;
        print(&words::peers(&found))?;
        if args.parameters {
            print(&parameters(&found))?;
        }
    }
    judge(&found)
}

/// Whether all is as it must be.
///
/// # Errors
/// One sentence that names what is not.
pub fn judge(found: &Stability) -> Result<(), Failure> {
    kills::judge(&found.mutants)?;
    let failed = found.cases.iter().filter(|case| case.fails());
    let failed: Vec<&str> = failed.map(|case| case.name).collect();
    if !failed.is_empty() {
        return Err(Failure::Run(format!(
            "beyond their limit: {} (seed {})",
            failed.join(", "),
            found.seed
        )));
    }
    let peers = found.cases.iter().flat_map(|case| &case.peers);
    match peers.clone().find(|peer| peer.broken) {
        Some(peer) => Err(Failure::Run(peer.note.clone())),
        None => Ok(()),
    }
}

/// Runs what was asked for.
///
/// # Errors
/// One sentence for a name that is no case, a peer that is none, or a mesh that cannot be served.
pub fn run_cases(args: &StabilityArgs) -> Result<Stability, Failure> {
    let names: Vec<&str> = all().map(|case| case.name).collect();
    if let Some(unknown) = args.cases.iter().find(|of| !names.contains(&of.as_str())) {
        return Err(Failure::Input(format!(
            "\"{unknown}\" is no case; choose of {}",
            names.join(", ")
        )));
    }
    let program = args.peers.as_deref().map(PeerProgram::open).transpose()?;
    let program = program.map(Arc::new);
    let export = args.export.as_deref();
    if let Some(folder) = export {
        make_folder_at(Chosen::EXPORT, folder)?;
    }
    // First: it takes seconds, and what is wrong with model or peer is told before the cases.
    let step_times = match &program {
        Some(program) if !args.mutants => step_times(program, &args.models, args.seed, export)?,
        _ => Vec::new(),
    };
    let is_left_out = |name: &str| args.small_lossy && NOT_SMALL_LOSSY.contains(&name);
    if let Some(name) = args.cases.iter().find(|name| is_left_out(name)) {
        return Err(Failure::Input(format!(
            "{name} is not run with --small-lossy: its object would be past before its model is there"
        )));
    }
    let is_chosen = |case: &&Case| {
        let is_named = args.cases.is_empty() || args.cases.iter().any(|n| n == case.name);
        is_named && !is_left_out(case.name)
    };
    let chosen: Vec<&Case> = all().filter(is_chosen).collect();
    // With mutants each runs without its own first.
    let runs = chosen.len() * if args.mutants { 2 } else { 1 };
    let bar = status_bar(runs as u64);
    let (mut cases, mut mutants) = (Vec::new(), Vec::new());
    if args.mutants {
        mutants = kills::run(&chosen, args, |name| {
            bar.set_message(name.to_string());
            bar.inc(1);
        })?;
    } else {
        let run = |case: &&Case| {
            bar.set_message(case.name);
            let verdict = run_with_peers(case, args, program.as_ref());
            bar.inc(1);
            if args.full {
                bar.suspend(|| eprintln!("{}", verdict.sentence()));
            }
            verdict
        };
        // One at a time: some take minutes, most none.
        cases = chosen.par_iter().with_max_len(1).map(run).collect();
    }
    bar.finish_and_clear();
    Ok(Stability {
        seed: args.seed,
        full: args.full,
        rate_hz: args.rate,
        small_lossy: args.small_lossy,
        cases,
        step_times,
        mutants,
    })
}

/// One case, and again with each variant of a peer.
fn run_with_peers(
    case: &Case,
    args: &StabilityArgs,
    program: Option<&Arc<PeerProgram>>,
) -> Verdict {
    let is_asked = asked::no_equal(case).is_empty();
    let export = args.export.clone().filter(|_| is_asked);
    let writer = export.map(|folder| Contender::file(folder, case.name));
    let mut verdict = run_case(case, args, writer);
    if let Some(failure) = writer.and_then(|writer| writer.log().broken) {
        verdict.pass = false;
        verdict.error = failure.to_string();
    }
    if let Some(program) = program.filter(|_| is_asked) {
        let variants = program.variants.iter().enumerate();
        let ask = |(variant, who): (usize, &String)| {
            let peer = Contender::peer(program, variant);
            peer_verdict(who, &run_case(case, args, Some(peer)), peer)
        };
        verdict.peers = variants.map(ask).collect();
    }
    verdict
}

/// What a case that was run with a peer came to.
fn peer_verdict(who: &str, verdict: &Verdict, peer: &Contender) -> PeerVerdict {
    let log = peer.log();
    let note = match (&log.broken, log.not_finite_at) {
        (Some(failure), _) => failure.to_string(),
        (None, Some(step)) => format!("at step {step} its answer is no number"),
        (None, None) if log.steps == 0 => "it was not asked".to_string(),
        (None, None) => verdict.error.clone(),
    };
    let is_whole = log.broken.is_none() && log.steps > 0;
    PeerVerdict {
        who: who.to_string(),
        value: if is_whole { verdict.value } else { f64::MAX },
        pass: verdict.pass && is_whole,
        steps: log.steps,
        note,
        broken: matches!(log.broken, Some(Failure::Input(_))),
    }
}

/// One case. What panics or ends by an error has failed.
fn run_case(case: &Case, args: &StabilityArgs, contender: Option<&'static Contender>) -> Verdict {
    let size = Size {
        full: args.full,
        rate_hz: args.rate,
    };
    let mut random = Xoshiro256PlusPlus::seed_from_u64(args.seed);
    let mut trial = case.trial(&size, &mut random);
    trial.defaults = Setup {
        contender,
        run_departs: if args.small_lossy { &SMALL_LOSSY } else { &[] },
        ..trial.defaults
    };
    let found = catch_unwind(AssertUnwindSafe(|| (case.run)(trial)));
    let found = found.unwrap_or_else(|_| Err(Failure::Run("it panicked".to_string())));
    let (found, error) = match found {
        Ok(found) => (found, String::new()),
        Err(error) => (Found::new(f64::INFINITY), error.to_string()),
    };
    let (value, passes_run) = (found.value, found.passes);
    // JSON has neither infinity nor what is no number.
    let finite = |x: f64| {
        if x.is_nan() {
            f64::MAX
        } else {
            x.clamp(f64::MIN, f64::MAX)
        }
    };
    let measure_keeps = found.measured() <= case.limit;
    let logged = found.logged.into_iter().map(|of| Logged {
        value: finite(of.value),
        ..of
    });
    let departs = case.departs.iter();
    Verdict {
        name: case.name,
        number: case.number,
        measure: case.measure,
        value: finite(value),
        limit: case.limit,
        pass: passes_run > 0 && value <= case.limit,
        measure_keeps,
        open: case.open,
        known: case.known(),
        passes_run,
        probe: case.probe,
        defaults: departs
            .map(|(of, why)| format!("{}: {why}", of.setting()))
            .collect(),
        facts: case.facts,
        runs: case.runs,
        logged: logged.collect(),
        error,
        mutant: format!("{:?}", case.mutant),
        peers: Vec::new(),
        no_equal: asked::no_equal(case),
    }
}

fn number(x: f64) -> String {
    match x {
        f64::MAX => "none".to_string(),
        x if x == x.trunc() && x.abs() < 1e9 => format!("{x}"),
        x => format!("{x:.3e}"),
    }
}

fn table(found: &Stability) -> String {
    let heads = "case | measure, the worst | verdict | seen | limit | passes";
    let mut table = Table::new(3, heads);
    for case in &found.cases {
        table.row([
            case.name.to_string(),
            case.measure.to_string(),
            case.word().to_string(),
            number(case.value),
            number(case.limit),
            grouped(case.passes_run),
        ]);
    }
    let open = found.cases.iter().filter(|case| !case.open.is_empty());
    let open: String = open
        .map(|case| {
            let known = number(case.known.unwrap_or(f64::MAX));
            let keeps = if case.is_better_than_known() {
                " keeps to its limit in this run"
            } else {
                ""
            };
            format!(
                "open: {}{keeps} (up to {known}): {}\n",
                case.name, case.open
            )
        })
        .collect();
    let logged: String = found
        .cases
        .iter()
        .flat_map(|case| case.logged.iter().map(|of| (case.name, of)))
        .map(|(case, of)| format!("{case}: {}: {}\n", of.name, number(of.value)))
        .collect();
    let errors = found.cases.iter().filter(|case| !case.error.is_empty());
    let errors: String = errors
        .map(|case| format!("{}: {}\n", case.name, case.error))
        .collect();
    let head = found.head();
    format!("{head}\n\n{table}\n{errors}\n{open}\n{logged}")
}

/// The parameters of each case beside those of the facts.
fn parameters(found: &Stability) -> String {
    let mut text = String::from("parameters: the facts', and the full run's\n");
    for case in &found.cases {
        let number = if case.number.is_empty() {
            "ours"
        } else {
            case.number
        };
        text += &format!(
            "\n{} ({number})\n  facts: {}\n  here:  {}\n",
            case.name, case.facts, case.runs
        );
        for departs in &case.defaults {
            text += &format!("  departs: {departs}\n");
        }
    }
    text
}

#[cfg(test)]
mod tests;
