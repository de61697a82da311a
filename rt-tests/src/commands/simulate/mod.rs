//! `rt-tests simulate`: both pure cores on a simulated clock with every fault that a link, a
//! process or a device may have, and checks after every tick.
//!
//! A seed draws a scene of small generated models, hands, and which kinds of faults are on and how
//! heavy ([`kind`], [`scenario`]). The faults last 3.2 to 4 s of virtual time; then everything is
//! sound, the hands go up, come down once more and hold.
//!
//! | checked | when | module |
//! |---|---|---|
//! | force and torque finite, within the plan's limits and its slew; zero after a fault | every tick | [`checks`] |
//! | a contact puts out no more energy than it took in, up to what is stated there | every tick | [`checks`] |
//! | work and query budget, operations, limit of the cache, inbox, no allocation | every tick | [`checks`] |
//! | on a processor whose speed changes: a tick within its time, which is back within a second, without hunting | every tick | [`processor`] |
//! | numbers of requests and chunks: epochs, order, silence after a loss | every tick | [`conversation`] |
//! | every invariant of the caches, front legal split by split, boxes of the tree exact, certified errors true, proxies outside | every 100th tick and at the end | [`deep`] |
//! | resynchronised, full resolution, force that of the spring between device and proxy, and as of a fresh controller with the same samples | at the end | [`run::quiet`] |
//! | touched for half of the time, with the last press; for a tenth of that with faults, where no kind takes the touch away | at the end | [`run`] |
//!
//! What is not claimed: the bits that a link flips are those that no checksum finds, so a position
//! may become another one; until the controller is started again, only the checks of every tick and
//! the invariants hold then.
//!
//! A seed that fails is made smaller ([`mod@shrink`]): cut behind the failing tick, without the
//! kinds that it does not need, lighter; the smallest is printed with its trace and the command
//! that runs it again. [`coverage`] counts what was reached in contact; over many seeds whole runs
//! must reach everything.

pub mod checks;
pub mod conversation;
pub mod coverage;
pub mod deep;
pub mod hands;
pub mod kind;
pub mod library;
pub mod mutants;
pub mod processor;
pub mod run;
pub mod scenario;
pub mod scenes;
pub mod shrink;
pub mod side;
pub mod standing_tool;
pub mod trace;

use crate::failure::Failure;
use crate::report::output::{print_either, status_bar, status_line};
use crate::report::table::Table;
use crate::report::units::grouped;
use clap::Args;
use coverage::Coverage;
use kind::Kind;
use library::Library;
use rayon::prelude::*;
use scenario::Reduction;
use serde::Serialize;
use shrink::{Failed, run_seed, shrink};
use simulator::MESSAGES;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::ops::Range;
use trace::Violation;

/// Failing seeds that are made smaller; of the others only the check is told.
const SHRUNK: usize = 3;

/// Seeds that are to reach everything together.
const MANY_SEEDS: u64 = 200;

/// Arguments of `rt-tests simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// Run these seeds, the last not included
    #[arg(long, value_name = "A..B", value_parser = seeds, default_value = "0..200")]
    pub seeds: Range<u64>,
    /// Leave out every other kind of fault and of scene
    #[arg(long, value_name = "KIND,...", value_delimiter = ',', num_args = 0..)]
    pub only: Option<Vec<Kind>>,
    /// Make every fault rarer and shorter by this factor, 0 to 1
    #[arg(
        long,
        value_name = "W",
        default_value_t = 1.0,
        value_parser = weight,
        allow_negative_numbers = true
    )]
    pub weight: f64,
    /// End each run after so many ticks, without the checks of a whole run
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub ticks: Option<u64>,
    /// Put each named fault into the product in turn, until a seed of 200 finds it (a build with
    /// --features mutants); status 1 when one is not found, or a seed fails without one
    #[arg(long, conflicts_with_all = ["seeds", "only", "weight", "ticks"])]
    pub mutants: bool,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// A share of the faults' weight; NaN is none.
fn weight(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let weight = number.filter(|number: &f64| (0.0..=1.0).contains(number));
    weight.ok_or_else(|| "write a number from 0 to 1".to_owned())
}

fn seeds(text: &str) -> Result<Range<u64>, String> {
    let (from, to) = text.split_once("..").ok_or("write A..B, such as 0..1000")?;
    let number = |text: &str| text.parse::<u64>().map_err(|error| error.to_string());
    let range = number(from)?..number(to)?;
    if range.is_empty() {
        return Err("A is to be less than B".to_string());
    }
    Ok(range)
}

/// What is printed as JSON, with `first_failing_seed` beside it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Simulated {
    /// Seeds that ran.
    pub seeds: u64,
    /// Ticks of all controllers.
    pub ticks: u64,
    /// Virtual time of the shortest run, ticks.
    pub ticks_min: u64,
    /// Share of the ticks in contact, over all seeds.
    pub contact_share: f64,
    /// The least of a seed: at least about half, since the press at the end is held so long.
    pub contact_share_min: f64,
    /// Seeds of which it was judged that they touch while faults are on: those without a kind that
    /// takes the touch away.
    pub judged_in_faults: u64,
    /// The least share in contact of these while faults were on; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_in_faults_min: Option<f64>,
    /// Largest work of the queries of a tick, nodes and faces.
    pub query_work_max: u32,
    /// How often each kind happened in contact.
    pub in_contact: BTreeMap<Kind, u64>,
    /// Messages lost, by kind.
    pub lost: BTreeMap<&'static str, u64>,
    /// Messages that arrived twice, by kind.
    pub doubled: BTreeMap<&'static str, u64>,
    /// Messages that overtook others, by kind.
    pub overtook: BTreeMap<&'static str, u64>,
    /// How often controllers came to each state.
    pub states: BTreeMap<&'static str, u64>,
    /// What no seed reached; a failure where many seeds ran whole.
    pub not_reached: Vec<String>,
    /// The seeds that failed.
    pub violations: Vec<SeedFailed>,
}

impl Simulated {
    /// Adds a seed that was judged: its share in contact while faults were on.
    fn judge_in_faults(&mut self, share: f64) {
        self.judged_in_faults += 1;
        let least = self.contact_in_faults_min.map_or(share, |of| of.min(share));
        self.contact_in_faults_min = Some(least);
    }
}

/// A seed that failed.
#[derive(Debug, Clone, Serialize)]
pub struct SeedFailed {
    /// The seed.
    pub seed: u64,
    /// What did not hold.
    pub violation: Violation,
    /// The kinds that were on.
    pub kinds: Vec<Kind>,
    /// What runs it again.
    pub command: String,
    /// To be read.
    #[serde(skip)]
    pub text: String,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 1 when a seed fails.
pub fn simulate(args: &SimulateArgs) -> Result<(), Failure> {
    if args.mutants {
        return find_mutants(args.json);
    }
    let found = run_seeds(args, &Library::build()?);
    let printed = Printed::of(&found, &found.violations);
    let is_whole = reduction(args) == Reduction::default();
    print_either(args.json, &words(&found, is_whole), &printed)?;
    if found.violations.is_empty() {
        return is_covered(args, &found);
    }
    let seeds: Vec<String> = found
        .violations
        .iter()
        .map(|failed| failed.seed.to_string())
        .collect();
    Err(Failure::Run(format!("failed: seeds {}", seeds.join(", "))))
}

/// Many whole runs reach everything: what never happens tests nothing.
///
/// # Errors
/// One sentence that names what was not reached.
pub fn is_covered(args: &SimulateArgs, found: &Simulated) -> Result<(), Failure> {
    let is_whole = reduction(args) == Reduction::default();
    if !is_whole || found.seeds < MANY_SEEDS || found.not_reached.is_empty() {
        return Ok(());
    }
    let (seeds, missing) = (found.seeds, found.not_reached.join(", "));
    Err(Failure::Run(format!(
        "never reached in {seeds} seeds: {missing}"
    )))
}

/// The object that is printed: what was found, and the first seed that failed.
#[derive(Debug, Serialize)]
struct Printed<'a, T: Serialize> {
    #[serde(flatten)]
    found: &'a T,
    /// -1 where none failed.
    first_failing_seed: i64,
}

impl<'a, T: Serialize> Printed<'a, T> {
    fn of(found: &'a T, violations: &[SeedFailed]) -> Self {
        let first = violations.iter().map(|failed| failed.seed).min();
        let first = first.map_or(-1, |seed| i64::try_from(seed).unwrap_or(i64::MAX));
        Self {
            found,
            first_failing_seed: first,
        }
    }
}

/// What is printed as JSON with `--mutants`, with `first_failing_seed` beside it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct MutantsFound {
    /// Seeds that ran with a mutant, over all of them.
    pub seeds: u64,
    /// Seeds that failed without a mutant, of those that failed with one.
    pub violations: Vec<SeedFailed>,
    /// The mutants.
    pub mutants: Vec<MutantFound>,
}

/// What found a mutant.
#[derive(Debug, Clone, Serialize)]
pub struct MutantFound {
    /// Its name.
    pub name: String,
    /// Whether a seed found it.
    pub killed: bool,
    /// Seeds that were needed, from 0 on; -1 where none of 200 found it.
    pub seeds_needed: i64,
    /// The check that did not hold; "" where none found it.
    pub check: String,
}

fn find_mutants(json: bool) -> Result<(), Failure> {
    let bar = status_line();
    let found = mutants::run(&Library::build()?, |name| bar.set_message(name.to_string()))?;
    bar.finish_and_clear();
    let printed = Printed::of(&found, &found.violations);
    print_either(json, &mutants_words(&found), &printed)?;
    judge_mutants(&found)
}

/// The seeds that failed by themselves, and the table.
fn mutants_words(found: &MutantsFound) -> String {
    let mut text = String::new();
    for failed in &found.violations {
        let _ = writeln!(text, "without a mutant: {}", failed.text);
    }
    let mut table = Table::new(2, "mutant | found by | seeds");
    for of in &found.mutants {
        let seeds = if of.killed {
            of.seeds_needed.to_string()
        } else {
            "not found".to_string()
        };
        table.row([of.name.clone(), of.check.clone(), seeds]);
    }
    text + &table.to_string()
}

/// Whether every mutant was found, and no seed failed without one.
fn judge_mutants(found: &MutantsFound) -> Result<(), Failure> {
    let missed = found.mutants.iter().filter(|of| !of.killed);
    let missed: Vec<&str> = missed.map(|of| of.name.as_str()).collect();
    let own = found.violations.iter().map(|of| of.seed.to_string());
    let own: Vec<String> = own.collect();
    let mut failed = Vec::new();
    if !missed.is_empty() {
        failed.push(format!("not found: mutants {}", missed.join(", ")));
    }
    if !own.is_empty() {
        failed.push(format!("failed without a mutant: seeds {}", own.join(", ")));
    }
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(failed.join("; ")))
}

/// What is left of each seed, as the command line says.
#[must_use]
pub fn reduction(args: &SimulateArgs) -> Reduction {
    Reduction {
        only: args
            .only
            .as_ref()
            .map(|kinds| kinds.iter().copied().collect()),
        weight: args.weight.clamp(0.0, 1.0),
        ticks: args.ticks,
    }
}

/// Runs the seeds on all cores.
#[must_use]
pub fn run_seeds(args: &SimulateArgs, library: &Library) -> Simulated {
    let reduction = reduction(args);
    let bar = status_bar(args.seeds.end - args.seeds.start);
    let seeds: Vec<u64> = args.seeds.clone().collect();
    let runs = seeds.into_par_iter().map(|seed| {
        let run = run_seed(seed, &reduction, library);
        bar.inc(1);
        run
    });
    let runs: Vec<_> = runs.collect();
    bar.finish_and_clear();
    let mut found = Simulated {
        ticks_min: u64::MAX,
        contact_share_min: f64::MAX,
        ..Simulated::default()
    };
    let (mut coverage, mut contact, mut failed) = (Coverage::default(), 0, Vec::new());
    for run in runs {
        found.seeds += 1;
        match run {
            Ok(run) => {
                found.ticks += run.ticks;
                contact += run.contact;
                found.ticks_min = found.ticks_min.min(run.length);
                let share = run.contact as f64 / run.ticks.max(1) as f64;
                found.contact_share_min = found.contact_share_min.min(share);
                if let Some(share) = run.contact_in_faults {
                    found.judge_in_faults(share);
                }
                found.query_work_max = found.query_work_max.max(run.query_work_max);
                coverage.add(&run.coverage);
            }
            Err(run) => failed.push(run),
        }
    }
    if found.ticks == 0 {
        (found.ticks_min, found.contact_share_min) = (0, 0.0);
    }
    found.contact_share = contact as f64 / found.ticks.max(1) as f64;
    found.not_reached = coverage.missing();
    let by_message = |counts| MESSAGES.into_iter().zip(counts).collect();
    found.lost = by_message(coverage.link.lost);
    found.doubled = by_message(coverage.link.doubled);
    found.overtook = by_message(coverage.link.overtook);
    found.states = coverage.states;
    found.in_contact = coverage.in_contact;
    let shrunk = failed.into_par_iter().enumerate().map(|(k, failed)| {
        let least = if k < SHRUNK {
            shrink(failed, library)
        } else {
            failed
        };
        shown(&least)
    });
    found.violations = shrunk.collect();
    found
}

fn shown(failed: &Failed) -> SeedFailed {
    SeedFailed {
        seed: failed.seed,
        violation: failed.violation.clone(),
        kinds: failed.kinds.iter().copied().collect(),
        command: failed.command(),
        text: failed.text(),
    }
}

/// `is_whole`: whether nothing of the runs was left out, so that they are to reach everything.
fn words(found: &Simulated, is_whole: bool) -> String {
    let mut text = String::new();
    for failed in &found.violations {
        let _ = writeln!(text, "{}", failed.text);
    }
    let in_faults = found.contact_in_faults_min.map_or_else(
        || "no seed judged while faults were on".to_string(),
        |least| {
            let (judged, percent) = (found.judged_in_faults, 100.0 * least);
            format!("of {judged} judged seeds at least {percent:.1} % while faults were on")
        },
    );
    let _ = writeln!(
        text,
        "{} seeds, {} failed; {} ticks of controllers, the shortest run {} ticks; in contact {:.1} % of the time, {in_faults}",
        found.seeds,
        found.violations.len(),
        grouped(found.ticks),
        found.ticks_min,
        100.0 * found.contact_share,
    );
    if is_whole && !found.not_reached.is_empty() {
        let _ = writeln!(text, "not reached: {}", found.not_reached.join(", "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    fn failed(seed: u64) -> SeedFailed {
        SeedFailed {
            seed,
            violation: Violation {
                check: "slew limit".to_string(),
                tick: 3,
                client: 0,
                found: "9 N".to_string(),
            },
            kinds: vec![Kind::Loss],
            command: String::new(),
            text: String::new(),
        }
    }

    fn json<T: Serialize>(found: &T, violations: &[SeedFailed]) -> Value {
        serde_json::to_value(Printed::of(found, violations)).expect("it has a JSON")
    }

    fn has_null(value: &Value) -> bool {
        match value {
            Value::Null => true,
            Value::Array(of) => of.iter().any(has_null),
            Value::Object(of) => of.values().any(has_null),
            _ => false,
        }
    }

    #[test]
    fn a_weight_is_from_0_to_1() {
        for good in ["0", "0.25", "1"] {
            assert!(weight(good).is_ok(), "{good}");
        }
        for bad in ["nan", "5", "-1", "inf", "heavy"] {
            assert!(weight(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_object_names_the_first_seed_that_failed() {
        let mut found = Simulated {
            seeds: 10,
            ..Simulated::default()
        };
        let sound = json(&found, &found.violations);
        assert_eq!(sound["first_failing_seed"], -1);
        assert!(sound["seeds"] == 10 && !has_null(&sound), "{sound}");
        found.violations = vec![failed(7), failed(3)];
        let bad = json(&found, &found.violations);
        assert_eq!(bad["first_failing_seed"], 3);
        assert_eq!(bad["violations"][0]["violation"]["check"], "slew limit");
        assert!(!has_null(&bad), "{bad}");
    }

    #[test]
    fn what_whole_runs_did_not_reach_is_said() {
        let found = Simulated {
            not_reached: vec!["cut in contact".to_string()],
            ..Simulated::default()
        };
        assert!(words(&found, true).contains("not reached: cut in contact"));
        assert!(!words(&found, false).contains("not reached"));
    }

    #[test]
    fn a_touch_during_the_faults_is_said_of_the_seeds_that_were_judged_alone() {
        let mut found = Simulated::default();
        let text = words(&found, true);
        assert!(
            text.contains("no seed judged") && !text.contains("100.0 %"),
            "{text}"
        );
        let none = json(&found, &[]);
        assert_eq!(none["judged_in_faults"], 0);
        assert_eq!(none.get("contact_in_faults_min"), None);
        for share in [0.5, 0.25, 0.75] {
            found.judge_in_faults(share);
        }
        let text = words(&found, true);
        assert!(text.contains("of 3 judged seeds at least 25.0 %"), "{text}");
        assert_eq!(json(&found, &[])["contact_in_faults_min"], 0.25);
    }

    fn mutants(violations: Vec<SeedFailed>, seeds_needed: i64) -> MutantsFound {
        MutantsFound {
            seeds: 200,
            violations,
            mutants: vec![MutantFound {
                name: "Slew".to_string(),
                killed: seeds_needed >= 0,
                seeds_needed,
                check: String::new(),
            }],
        }
    }

    #[test]
    fn mutants_are_one_object_without_null() {
        let found = mutants(Vec::new(), -1);
        let json = json(&found, &found.violations);
        assert!(json.is_object() && !has_null(&json), "{json}");
        assert!(json["seeds"] == 200 && json["first_failing_seed"] == -1);
        let of = &json["mutants"][0];
        assert!(of["name"] == "Slew" && of["killed"] == false && of["seeds_needed"] == -1);
        assert_eq!(of["check"], "");
        assert!(mutants_words(&found).contains("not found"));
    }

    #[test]
    fn a_mutant_that_lives_and_a_seed_that_fails_by_itself_are_failures() {
        assert_eq!(judge_mutants(&mutants(Vec::new(), 5)), Ok(()));
        let lives = judge_mutants(&mutants(Vec::new(), -1));
        assert!(lives.expect_err("it lives").to_string().contains("Slew"));
        let own = judge_mutants(&mutants(vec![failed(7)], 5));
        assert!(own.expect_err("it fails").to_string().contains("seeds 7"));
    }
}
