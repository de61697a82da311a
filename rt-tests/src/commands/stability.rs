//! `rt-tests stability`: the hard cases ([`crate::cases`]), each with its measure, limit and
//! verdict.

use crate::cases::{CASES, Fault, Size, Trial};
use crate::failure::Failure;
use crate::report::output::{print, print_json, status_line};
use crate::report::table::Table;
use crate::report::units::grouped;
use clap::Args;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;

/// Arguments of `rt-tests stability`.
#[derive(Debug, Args)]
pub struct StabilityArgs {
    /// Run these cases only, by name
    #[arg(value_name = "CASE")]
    pub cases: Vec<String>,
    /// Run the full set: up to a million passes a case, some ten minutes
    #[arg(long)]
    pub full: bool,
    /// Seed of everything that is random
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Put each case's fault in: now every case is to fail
    #[arg(long)]
    pub faults: bool,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Stability {
    /// Seed of everything that is random.
    pub seed: u64,
    /// The cases, in the order of the table.
    pub cases: Vec<Verdict>,
}

/// What a case came to.
#[derive(Debug, Serialize)]
pub struct Verdict {
    /// Its name.
    pub name: &'static str,
    /// What is measured.
    pub measure: &'static str,
    /// The worst that was seen.
    pub value: f64,
    /// The most that may be seen.
    pub limit: f64,
    /// Whether it kept to it.
    pub pass: bool,
    /// Measurements made.
    pub passes_run: u64,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a name that is no case, 1 when a case fails (with faults: when one
/// does not).
pub fn stability(args: &StabilityArgs) -> Result<(), Failure> {
    let found = run_cases(args)?;
    if args.json {
        print_json(&found)?;
    } else {
        print(&table(&found))?;
    }
    let wrong: Vec<&str> = found
        .cases
        .iter()
        .filter(|case| case.pass == args.faults)
        .map(|case| case.name)
        .collect();
    if wrong.is_empty() {
        return Ok(());
    }
    let names = wrong.join(", ");
    Err(Failure::Run(if args.faults {
        format!("passed with a fault put in: {names}")
    } else {
        format!("beyond their limit: {names} (seed {})", args.seed)
    }))
}

/// Runs what was asked for.
///
/// # Errors
/// One sentence for a name that is no case, or a mesh that cannot be served.
pub fn run_cases(args: &StabilityArgs) -> Result<Stability, Failure> {
    if let Some(unknown) = args
        .cases
        .iter()
        .find(|name| CASES.iter().all(|case| case.name != name.as_str()))
    {
        let names: Vec<&str> = CASES.iter().map(|case| case.name).collect();
        return Err(Failure::Input(format!(
            "\"{unknown}\" is no case; choose of {}",
            names.join(", ")
        )));
    }
    let size = Size { full: args.full };
    let bar = status_line();
    let mut cases = Vec::new();
    for case in &CASES {
        let chosen = args.cases.is_empty() || args.cases.iter().any(|name| name == case.name);
        if !chosen {
            continue;
        }
        bar.set_message(format!("{}: {}", case.name, case.measure));
        let mut random = Xoshiro256PlusPlus::seed_from_u64(args.seed);
        let fault = if args.faults { case.fault } else { Fault::None };
        let found = (case.run)(Trial {
            size: &size,
            random: &mut random,
            fault,
        })?;
        cases.push(Verdict {
            name: case.name,
            measure: case.measure,
            // JSON has no infinity.
            value: found.value.clamp(f64::MIN, f64::MAX),
            limit: case.limit,
            pass: found.passes > 0 && found.value <= case.limit,
            passes_run: found.passes,
        });
    }
    bar.finish_and_clear();
    Ok(Stability {
        seed: args.seed,
        cases,
    })
}

fn table(found: &Stability) -> String {
    let number = |x: f64| match x {
        f64::MAX => "none".to_string(),
        x if x == x.trunc() && x.abs() < 1e9 => format!("{x}"),
        x => format!("{x:.3e}"),
    };
    let heads = "case | measure, the worst | verdict | seen | limit | passes";
    let mut table = Table::new(3, heads);
    for case in &found.cases {
        table.row([
            case.name.to_string(),
            case.measure.to_string(),
            if case.pass { "pass" } else { "FAIL" }.to_string(),
            number(case.value),
            number(case.limit),
            grouped(case.passes_run),
        ]);
    }
    format!("hard cases, seed {}\n\n{table}", found.seed)
}
