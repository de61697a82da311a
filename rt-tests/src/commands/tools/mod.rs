//! `rt-tests tools`: how far a tool's tick is from what unlimited work would give.
//!
//! Both cores run in this process under a simulated clock ([`simulator`]), with the hand's loop
//! closed. In every tick the product's proxy is copied before it moves; the copy moves to the same
//! pose of the device on the same front until it is settled. The difference of the two is what the
//! budget of a tick costs: in force, in distance, and in contacts that were found late.
//!
//! The tools are a capsule of 924 faces (960 are asked for; whole rings make as many), on models at
//! the size of the bundled scene, and a rod of 0.8 mm on a comb with slots of 1 mm.

mod comb;
mod measure;
mod row;

use crate::failure::Failure;
use crate::models::source::source;
use crate::report::output::{print_either, status_bar};
use crate::report::table::Table;
use crate::report::units::grouped;
use crate::scenes::{check_seconds, prepare_models};
use clap::Args;
use hrtc_core::contact::tool::ToolMesh;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use row::Row;
use scene::{
    ModelScale, ModelSource, NoFiles, Overrides, ProbeShape, ScenePlan, TrajectoryPlan, parse,
};
use serde::Serialize;
use std::ops::RangeInclusive;
use std::path::Path;

/// The scene: a capsule strokes an object, its axis along the normal.
const SCENE: &str = include_str!("../../../../config/scenes/tool.toml");
/// Models when none is named, each with what takes its place where the file is missing.
const MODELS: [(&str, &str); 4] = [
    ("../shared/models/dragon.obj", "terrain:100000"),
    ("relief:100000", "relief:100000"),
    ("../shared/models/stanford-bunny.obj", "torus:70000"),
    (COMB, COMB),
];
/// What `--quick` measures.
const QUICK: [&str; 2] = ["relief:20000", COMB];
/// Faces that a scene lets a tool be asked for.
const TOOL_FACES: RangeInclusive<i64> = 12..=4096;
/// The name of the comb, and the radius, length and faces of the rod on it.
const COMB: &str = "comb";
const ROD: ProbeShape = ProbeShape::Capsule {
    radius_m: 4e-4,
    length_m: 0.02,
    faces: 960,
};
/// Seeds, and seconds of simulated time each: twenty minutes with four models.
const SEEDS: u64 = 5;
const SECONDS: f64 = 60.0;
/// Seconds with `--quick`.
const QUICK_SECONDS: f64 = 3.0;

/// Arguments of `rt-tests tools`.
#[derive(Debug, Args)]
pub struct ToolsArgs {
    /// Mesh or SPM files, shapes as SHAPE:FACES, or "comb" [default: dragon, relief, bunny, comb]
    #[arg(value_name = "MODEL")]
    pub models: Vec<String>,
    /// Seeds of the tour over each model, from 1 on [default: 5]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub seeds: Option<u64>,
    /// Simulated time for each seed, seconds [default: 60]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub seconds: Option<f64>,
    /// Faces of the tool at the most, 12 to 4096; its name has how many they are
    #[arg(long, value_name = "N", default_value_t = 960, value_parser = clap::value_parser!(u32).range(TOOL_FACES))]
    pub faces: u32,
    /// One seed and a few seconds on generated models
    #[arg(long)]
    pub quick: bool,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Tools {
    /// One for each model and seed.
    pub rows: Vec<Row>,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input, 1 when a limit is not kept.
pub fn tools(args: &ToolsArgs) -> Result<(), Failure> {
    let found = run(args)?;
    print_either(args.json, &table(&found), &found)?;
    let broken: Vec<String> = found
        .rows
        .iter()
        .filter(|row| !row.broken().is_empty())
        .map(|row| {
            format!(
                "{} seed {}: {}",
                row.model,
                row.seed,
                row.broken().join(", ")
            )
        })
        .collect();
    if broken.is_empty() {
        return Ok(());
    }
    Err(Failure::Run(format!(
        "beyond a limit: {}",
        broken.join("; ")
    )))
}

/// A tool on a model.
struct Pair {
    model: String,
    tool: String,
    plan: ScenePlan,
}

/// Measures what was asked for.
///
/// # Errors
/// When a model cannot be read or served, or a number is out of range.
pub fn run(args: &ToolsArgs) -> Result<Tools, Failure> {
    let seconds = args
        .seconds
        .unwrap_or(if args.quick { QUICK_SECONDS } else { SECONDS });
    check_seconds(seconds)?;
    let seeds = args.seeds.unwrap_or(if args.quick { 1 } else { SEEDS });
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let mut pairs = Vec::new();
    for typed in models(args) {
        let pair = pair(&typed, args.faces, folder.path())?;
        prepare_models(&pair.plan)?;
        pairs.push(pair);
    }
    let runs: Vec<(&Pair, u64)> = pairs
        .iter()
        .flat_map(|pair| (1..=seeds).map(move |seed| (pair, seed)))
        .collect();
    let bar = status_bar(runs.len() as u64);
    let rows: Result<Vec<Row>, Failure> = runs
        .par_iter()
        .map(|&(pair, seed)| {
            let row = measure::measure(
                &with_seed(&pair.plan, seed),
                [&pair.model, &pair.tool],
                seed,
                seconds,
            )?;
            bar.set_message(format!("{} seed {seed}", pair.model));
            bar.inc(1);
            bar.suspend(|| eprintln!("{}", row.sentence()));
            Ok(row)
        })
        .collect();
    bar.finish_and_clear();
    Ok(Tools { rows: rows? })
}

/// The models that were typed, or the default ones.
fn models(args: &ToolsArgs) -> Vec<String> {
    if !args.models.is_empty() {
        return args.models.clone();
    }
    if args.quick {
        return QUICK.map(String::from).to_vec();
    }
    let there = |file: &str| file.contains(':') || file == COMB || Path::new(file).exists();
    MODELS
        .map(|(file, instead)| if there(file) { file } else { instead })
        .map(String::from)
        .to_vec()
}

/// The plan of a scene of a tool.
fn scene(text: &str) -> Result<ScenePlan, Failure> {
    let overrides = Overrides::default();
    Ok(parse(
        text,
        "tool.toml",
        Path::new(""),
        &overrides,
        &NoFiles,
    )?)
}

/// The scene of a model; the comb is written into a folder. `faces`: of [`TOOL_FACES`], as a plan
/// is changed here that was checked before.
fn pair(typed: &str, faces: u32, folder: &Path) -> Result<Pair, Failure> {
    let mut plan = scene(SCENE)?;
    let (model, tool) = if typed == COMB {
        let path = folder.join("comb.spm");
        comb::write(&path)?;
        plan.objects[0].model = ModelSource::File(path);
        plan.objects[0].scale = ModelScale::Size(comb::SIZE_M);
        plan.probes[0].shape = ROD;
        (COMB.to_string(), "rod")
    } else {
        let (name, source) = source(typed)?;
        plan.objects[0].model = source;
        (name, "capsule")
    };
    if let ProbeShape::Capsule { faces: of_tool, .. } = &mut plan.probes[0].shape {
        *of_tool = faces;
    }
    let mesh = ToolMesh::of_shape(&plan.probes[0].shape);
    let faces = mesh.map_or(0, |mesh| mesh.triangles.len());
    Ok(Pair {
        model,
        tool: format!("{tool}-{faces}"),
        plan,
    })
}

fn with_seed(plan: &ScenePlan, to: u64) -> ScenePlan {
    let mut plan = plan.clone();
    if let TrajectoryPlan::Tour { seed, .. } = &mut plan.probes[0].trajectory {
        *seed = to;
    }
    plan
}

fn table(found: &Tools) -> String {
    let heads = "model | tool | seed | contact\nticks | behind\n% | late\n% | different\n% | force off\nmN p50 | p99 | max | not late\nmax | force\nN p99 | step\nN max | reference\nN max | beyond\nN max | units\np50 | p99 | broken";
    let mut table = Table::new(2, heads).compact();
    let millinewtons = |newtons: f64| format!("{:.1}", 1e3 * newtons);
    let percent = |share: f64| format!("{:.2}", 100.0 * share);
    for row in &found.rows {
        let off = row.force_difference_n;
        table.row([
            row.model.clone(),
            row.tool.clone(),
            row.seed.to_string(),
            grouped(row.contact_ticks),
            percent(row.behind_share),
            percent(row.late_share),
            percent(row.different_share),
            millinewtons(off.p50),
            millinewtons(off.p99),
            millinewtons(off.max),
            millinewtons(row.difference_not_late_n_max),
            format!("{:.2}", row.force_n.p99),
            format!("{:.3}", row.force_step_n_max),
            format!("{:.3}", row.reference_step_n_max),
            format!("{:.3}", row.step_beyond_n_max),
            format!("{:.0}", row.units.p50),
            format!("{:.0}", row.units.p99),
            row.broken().join(", "),
        ]);
    }
    format!("a tool beside the same with unlimited work in every tick\n{table}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faces_that_are_let_in_are_those_of_a_scene() {
        assert!(SCENE.contains("faces = 960 }"));
        for (faces, fits) in [(11, false), (12, true), (4096, true), (4097, false)] {
            let text = SCENE.replace("faces = 960 }", &format!("faces = {faces} }}"));
            let planned = scene(&text);
            assert_eq!(planned.is_ok(), fits, "{faces}: {:?}", planned.err());
            assert_eq!(TOOL_FACES.contains(&faces), fits, "{faces}");
        }
    }

    #[test]
    fn a_tool_is_named_by_the_faces_that_it_has() {
        let folder = tempfile::tempdir().expect("there is a temporary folder");
        for (asked, has) in [(12, 12), (13, 12), (960, 924)] {
            let pair = pair("relief:1000", asked, folder.path()).expect("it is a shape");
            assert_eq!(pair.tool, format!("capsule-{has}"));
        }
    }
}
