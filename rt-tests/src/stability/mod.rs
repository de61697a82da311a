//! `rt-tests stability`: hard cases, each with its measure, its limit and a verdict.
//!
//! The pure cores run in virtual time, with the simulated device where the loop is closed; every run repeats. Each
//! case has a fault that is put in on purpose (`--faults`): a case that does not fail with it shows nothing.
//!
//! | file | cases |
//! |---|---|
//! | `walls` | energy, onset and creep of the force, the encoder |
//! | `sheets` | nothing is passed: thin, sharp, broken, or coarse |
//! | `corners` | ridges, valleys, tips and corners |
//! | `effects` | friction, texture, fields: energy, drift, switching |
//! | `fronts` | a front that moves, files in any unit |
//! | `motion` | objects that are driven onto a probe, or pushed by one |
//! | `refinement` | splits and collapses under the probe |
//! | `disturbances` | jumps, noise, a station that goes away, another scale |

pub(crate) mod bench;
mod corners;
mod disturbances;
mod effects;
mod fronts;
mod motion;
mod refinement;
mod shapes;
mod sheets;
pub(crate) mod walls;

pub use bench::Fault;

use crate::failure::Failure;
use crate::report::grouped;
use crate::run::{print, print_json};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use std::fmt::Write;

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

/// How much is run.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    full: bool,
}

impl Size {
    /// A number for the quick set, and one for the full set.
    #[must_use]
    pub fn of(&self, quick: u64, full: u64) -> u64 {
        if self.full { full } else { quick }
    }
}

/// What a case came to.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    value: f64,
    passes: u64,
}

impl Found {
    /// Nothing seen; the value starts here.
    #[must_use]
    pub fn new(value: f64) -> Self {
        Self { value, passes: 0 }
    }

    /// Of what was seen the largest counts; what is no number counts as infinite.
    pub fn most(&mut self, value: f64) {
        let value = if value.is_nan() { f64::INFINITY } else { value };
        self.value = self.value.max(value);
        self.passes += 1;
    }

    /// Without a touch nothing was shown.
    pub fn count_touch(&mut self, touched: bool) {
        if !touched {
            self.most(f64::INFINITY);
        }
    }

    /// What went wrong is counted.
    pub fn count(&mut self, wrong: bool) {
        self.value += f64::from(u8::from(wrong));
        self.passes += 1;
    }
}

type Run = fn(&Size, &mut Xoshiro256PlusPlus, Fault) -> Result<Found, Failure>;

/// A hard case.
struct Case {
    name: &'static str,
    measure: &'static str,
    limit: f64,
    /// The fault under which it must fail.
    fault: Fault,
    run: Run,
}

/// How far the proxy's own convergence (1e-7 radii) shows in a force: ten times that, a tenth of a radius deep.
const CONVERGENCE: f64 = 1e-6;

/// The cases.
const CASES: [Case; 43] = [
    case(
        "head-on-wall",
        "energy put out over K T/2 times the integral of v²",
        1.1,
        Fault::LateTick,
        walls::head_on,
    ),
    case(
        "net-passivity",
        "energy put out less what the device damps, J",
        0.0,
        Fault::LateTick,
        walls::net_passivity,
    ),
    case(
        "passivity",
        "the same at 0.1 to 10 kN/m, with the energy account, J",
        0.0,
        Fault::NoPassivity,
        walls::passivity,
    ),
    case(
        "missed-ticks",
        "energy put out 20 ticks after a missed period, J",
        0.0,
        Fault::Sign,
        walls::missed_ticks,
    ),
    case(
        "thin-sheet",
        "passes through sheets of 0, 0.1 and 1 mm",
        0.0,
        Fault::LostConstraint,
        sheets::thin_sheet,
    ),
    case(
        "edges-and-vertices",
        "passes through a body at edges and vertices",
        0.0,
        Fault::LostConstraint,
        sheets::edges_and_vertices,
    ),
    case(
        "ridge",
        "change of force in a tick over 2 F sin(turn/2)",
        1.0 + CONVERGENCE,
        Fault::LostConstraint,
        corners::ridge,
    ),
    case(
        "shaded-ridge",
        "change of force in a tick over the force, shaded",
        0.07,
        Fault::LostConstraint,
        corners::shaded_ridge,
    ),
    case(
        "valley",
        "outside one of two planes, of the size",
        1e-9,
        Fault::LostConstraint,
        corners::valley,
    ),
    case(
        "tip",
        "from the exact projection on 3 to 64 planes, of the size",
        1e-9,
        Fault::LostConstraint,
        corners::tip,
    ),
    case(
        "corner-at-rest",
        "stray of the proxy in a noisy corner, radii",
        1e-5,
        Fault::LostConstraint,
        corners::rest_in_corner,
    ),
    case(
        "scale",
        "difference at 1e-4 to 1e4 times the size, relative",
        1e-9,
        Fault::AbsoluteEpsilon,
        disturbances::scale,
    ),
    case(
        "units",
        "difference in files of units of 1e-6 to 1e6, relative",
        1e-9,
        Fault::AbsoluteEpsilon,
        fronts::units,
    ),
    case(
        "slow-onset",
        "first force over K v T",
        1.05,
        Fault::LateTick,
        walls::onset,
    ),
    case(
        "creep",
        "force along a smooth plate, of K times the size",
        1e-9,
        Fault::Sign,
        walls::creep,
    ),
    case(
        "rest",
        "stray of the force from K times the depth, relative",
        1e-9,
        Fault::Sign,
        disturbances::rest,
    ),
    case(
        "damaged-mesh",
        "passes through a damaged mesh, or no numbers",
        0.0,
        Fault::LostConstraint,
        sheets::damaged_mesh,
    ),
    case(
        "refit",
        "nearest faces that are not, after each split or collapse",
        0.0,
        Fault::LostConstraint,
        fronts::refit,
    ),
    case(
        "prediction-miss",
        "true error over its bound on a coarse front",
        1.0,
        Fault::LostConstraint,
        sheets::prediction_miss,
    ),
    case(
        "refine-under-contact",
        "change of force in a tick over max(0.05 N, 7 %)",
        1.0,
        Fault::NoGeomorph,
        refinement::under_contact,
    ),
    case(
        "refine-under-tool",
        "the same under a tool",
        1.0,
        Fault::NoGeomorph,
        refinement::under_tool,
    ),
    case(
        "refine-cycle-energy",
        "energy of coarse-fine-coarse over K p s + K s²/2",
        1e-12,
        Fault::NoPassivity,
        refinement::cycle_energy,
    ),
    case(
        "fold-over",
        "ticks with a face turned over at the contact",
        0.0,
        Fault::NoGeomorph,
        refinement::fold_over,
    ),
    case(
        "silent-station",
        "change of the force while the station is away, N",
        0.0,
        Fault::LostConstraint,
        disturbances::silent_station,
    ),
    case(
        "jumps",
        "change of force in a tick over the slew limit",
        1.0 + 1e-9,
        Fault::OpenGate,
        disturbances::jumps,
    ),
    case(
        "samples-of-noise",
        "outputs that are no numbers, or beyond the limit",
        0.0,
        Fault::OpenGate,
        disturbances::noise,
    ),
    case(
        "repeat",
        "ticks at which the same inputs gave other bits",
        0.0,
        Fault::LateTick,
        disturbances::repeat,
    ),
    case(
        "encoder",
        "amplitude of the force over K D",
        1.0 + 1e-9,
        Fault::Sign,
        walls::encoder,
    ),
    case(
        "friction-loop",
        "energy that friction puts out on a loop, of its work",
        1e-12,
        Fault::Sign,
        effects::friction_loop,
    ),
    case(
        "friction-stick",
        "stray of the force after ten minutes' sticking, relative",
        1e-9,
        Fault::Sign,
        effects::friction_stick,
    ),
    case(
        "friction-apart",
        "ticks at which two probes feel each other's friction",
        0.0,
        Fault::LateTick,
        effects::friction_apart,
    ),
    case(
        "texture-loop",
        "energy that texture and shading put out, of their work",
        1e-12,
        Fault::NoPassivity,
        effects::texture_loop,
    ),
    case(
        "texture-alias",
        "what is felt of waves too fine for the loop, of K A",
        1e-9,
        Fault::Sign,
        effects::texture_alias,
    ),
    case(
        "magnet-loop",
        "energy a magnet puts out over K T/2 times that of v²",
        1.1,
        Fault::LateTick,
        effects::magnet_loop,
    ),
    case(
        "fields",
        "swing at the end over the first, springs and drags",
        0.1,
        Fault::LateTick,
        effects::fields,
    ),
    case(
        "boundary",
        "energy put out less what the device damps, J",
        0.0,
        Fault::NoPassivity,
        effects::boundary,
    ),
    case(
        "effects-toggled",
        "change of force in a tick over the slew limit",
        1.0 + 1e-9,
        Fault::OpenGate,
        effects::toggled,
    ),
    case(
        "effects-unlisted",
        "ticks at which an effect that is off changes a bit",
        0.0,
        Fault::LateTick,
        effects::unlisted,
    ),
    case(
        "moving-object",
        "passes or gaps of two ticks, driven at 1 m/s or 10 rad/s",
        0.0,
        Fault::LostConstraint,
        motion::moving_object,
    ),
    case(
        "pushed-energy",
        "energy of device and body over that in the beginning",
        1.0 + 1e-9,
        Fault::NoPassivity,
        motion::pushed_energy,
    ),
    case(
        "pushed-momentum",
        "stray of their momentum, relative",
        1e-9,
        Fault::LateTick,
        motion::pushed_momentum,
    ),
    case(
        "pushed-reference",
        "from 64 times the rate, relative, over the swing in a tick",
        1.0,
        Fault::Sign,
        motion::pushed_reference,
    ),
    case(
        "pushed-rest",
        "pushed bodies that do not sleep, or change in sleep",
        0.0,
        Fault::Restless,
        motion::pushed_rest,
    ),
];

const fn case(
    name: &'static str,
    measure: &'static str,
    limit: f64,
    fault: Fault,
    run: Run,
) -> Case {
    Case {
        name,
        measure,
        limit,
        fault,
        run,
    }
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
/// One sentence: status 2 for a name that is no case, 1 when a case fails (with faults: when one does not).
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
    let bar = ProgressBar::new_spinner();
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {msg}") {
        bar.set_style(style);
    }
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    let mut cases = Vec::new();
    for case in &CASES {
        let chosen = args.cases.is_empty() || args.cases.iter().any(|name| name == case.name);
        if !chosen {
            continue;
        }
        bar.set_message(format!("{}: {}", case.name, case.measure));
        let mut random = Xoshiro256PlusPlus::seed_from_u64(args.seed);
        let fault = if args.faults { case.fault } else { Fault::None };
        let found = (case.run)(&size, &mut random, fault)?;
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
    let mut text = format!("hard cases, seed {}\n\n", found.seed);
    let number = |x: f64| match x {
        f64::MAX => "none".to_string(),
        x if x == x.trunc() && x.abs() < 1e9 => format!("{x}"),
        x => format!("{x:.3e}"),
    };
    let _ = writeln!(
        text,
        "{:20} {:58} {:>10} {:>10} {:>11}",
        "case", "measure, the worst", "seen", "limit", "passes"
    );
    for case in &found.cases {
        let _ = writeln!(
            text,
            "{:20} {:58} {:>10} {:>10} {:>11}  {}",
            case.name,
            case.measure,
            number(case.value),
            number(case.limit),
            grouped(case.passes_run),
            if case.pass { "pass" } else { "FAIL" }
        );
    }
    text
}
