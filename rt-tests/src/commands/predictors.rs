//! `rt-tests predictors`: what each source of the prediction buys.
//!
//! Both cores run in this process under a simulated clock ([`simulator`]). For each model and speed
//! the device's poses are recorded once, in a closed loop on the mesh that was never simplified;
//! then a controller with each choice of sources is given the same poses. What it predicts is all
//! that differs, and how often the contact was coarser than asked for tells what that is worth. A
//! tick counts as coarser, too, when the probe was held elsewhere than on the full mesh or not at
//! all: on a coarse front it may have got caught.

use crate::failure::Failure;
use crate::models::source::typed_or;
use crate::report::output::print_either;
use crate::report::table::Table;
use crate::trajectory::reference::{Reference, come_to_rest};
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::virtual_scene::make_ready;
use clap::Args;
use hrtc_core::lod::predict::{Course, Sources};
use serde::Serialize;

/// What is measured when no model is named.
const DEFAULT_MODELS: [&str; 2] = ["relief:100000", "terrain:130000"];
/// Speeds of the tour when none is given, m/s.
const SPEEDS: [f64; 3] = [0.1, 0.2, 0.4];
/// Length of the tour, seconds of simulated time.
const SECONDS: f64 = 4.0;

/// What is predicted from, and its name in the table. Without any, only where the probe is.
const VARIANTS: [(&str, Sources); 7] = [
    ("none", of(false, None, false)),
    ("neighbours", of(true, None, false)),
    ("linear", of(false, Some(Course::Linear), false)),
    ("quadratic", of(false, Some(Course::Quadratic), false)),
    ("fading", of(false, Some(Course::Fading), false)),
    ("fading, landed", of(false, Some(Course::Fading), true)),
    ("all", Sources::ALL),
];

const fn of(neighbours: bool, course: Option<Course>, landing: bool) -> Sources {
    Sources {
        neighbours,
        course,
        landing,
    }
}

/// Arguments of `rt-tests predictors`.
#[derive(Debug, Args)]
pub struct PredictorsArgs {
    /// Mesh or SPM files, or shapes as SHAPE:FACES [default: relief:100000 terrain:130000]
    #[arg(value_name = "MODEL")]
    pub models: Vec<String>,
    /// Seed of the tour over each model
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Speed of the tour, metres a second [default: 0.1, 0.2 and 0.4]
    #[arg(long, value_name = "V", allow_negative_numbers = true)]
    pub speed: Option<f64>,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Predictors {
    /// Seed of the tours.
    pub seed: u64,
    /// Length of each tour, seconds.
    pub seconds: f64,
    /// One for each model, speed and choice of sources.
    pub runs: Vec<Run>,
}

/// One run.
#[derive(Debug, Serialize)]
pub struct Run {
    /// The model.
    pub model: String,
    /// Speed of the tour, m/s.
    pub speed_m_per_s: f64,
    /// What was predicted from: a name of the table.
    pub sources: &'static str,
    /// Ticks in contact on the full mesh: the same for every choice.
    pub contact_ticks: u64,
    /// Those of them at which the contact was coarser than asked for, or farther than the probe's
    /// radius from where it is on the full mesh.
    pub coarser_ticks: u64,
    /// Their share of the ticks in contact, from 0 to 1.
    pub coarser_share: f64,
    /// Records that were sent while the probe moved: the price.
    pub vsps_received: u64,
}

/// Runs the command.
///
/// # Errors
/// One sentence, status 2 for bad input.
pub fn predictors(args: &PredictorsArgs) -> Result<(), Failure> {
    let speeds = match args.speed {
        None => SPEEDS.to_vec(),
        Some(speed) if (1e-4..=10.0).contains(&speed) => vec![speed],
        Some(speed) => {
            return Err(Failure::Input(format!(
                "--speed is {speed}; write metres a second from 0.0001 to 10"
            )));
        }
    };
    let models: Vec<SceneModel> = typed_or(&args.models, &DEFAULT_MODELS)
        .iter()
        .map(|typed| SceneModel::open(typed))
        .collect::<Result<_, _>>()?;
    let mut found = Predictors {
        seed: args.seed,
        seconds: SECONDS,
        runs: Vec::new(),
    };
    for mut model in models {
        for &speed in &speeds {
            model.set_speed(speed);
            eprintln!("{} at {speed} m/s", model.mesh.name);
            let reference = Reference::record(&model, args.seed, SECONDS)?;
            for (name, sources) in VARIANTS {
                found
                    .runs
                    .push(run(&model, &reference, speed, name, sources)?);
            }
        }
    }
    print_either(args.json, &table(&found), &found)
}

/// The recorded poses with one choice of sources.
fn run(
    model: &SceneModel,
    reference: &Reference,
    speed: f64,
    name: &'static str,
    sources: Sources,
) -> Result<Run, Failure> {
    let mut simulation = model.simulation(&model.plan)?;
    simulation.controller_mut().set_sources(sources);
    let ready = make_ready(&mut simulation)?;
    come_to_rest(&mut simulation, reference.rest, ready)?;
    let before = simulation.outputs().record.vsps_received;
    let (mut contact_ticks, mut coarser_ticks) = (0, 0);
    let radius = model.plan.probes[0].shape.tip_m() / model.metres_per_unit;
    for (&sample, exact) in reference.samples.iter().zip(&reference.ticks) {
        let outputs = simulation.step(Some(sample));
        let Some(there) = exact.contact else {
            continue;
        };
        let contact = outputs.contact();
        let contact = contact.as_ref();
        let is_there = contact.is_some_and(|contact| contact.point.distance(there) <= radius);
        contact_ticks += 1;
        coarser_ticks += u64::from(!(is_there && outputs.record.contact_asked));
    }
    Ok(Run {
        model: model.mesh.name.clone(),
        speed_m_per_s: speed,
        sources: name,
        contact_ticks,
        coarser_ticks,
        coarser_share: coarser_ticks as f64 / contact_ticks.max(1) as f64,
        vsps_received: simulation.outputs().record.vsps_received - before,
    })
}

/// A row for each choice of sources, two columns for each model and speed.
fn table(found: &Predictors) -> String {
    let first = found.runs.iter().filter(|run| run.sources == VARIANTS[0].0);
    let heads = first.flat_map(|run| {
        let head = format!("{}\n{} m/s", run.model, run.speed_m_per_s);
        [format!("{head}\ncoarser"), "records".to_string()]
    });
    let heads: Vec<String> = ["predicted from".to_string()]
        .into_iter()
        .chain(heads)
        .collect();
    let mut table = Table::new(1, &heads.join(" | "));
    for (name, _) in VARIANTS {
        let runs = found.runs.iter().filter(|run| run.sources == name);
        let cells = runs.flat_map(|run| {
            let share = 100.0 * run.coarser_share;
            [format!("{share:.2} %"), run.vsps_received.to_string()]
        });
        table.row([name.to_string()].into_iter().chain(cells));
    }
    format!("share of the contact coarser than asked for, and records sent for it\n{table}")
}
