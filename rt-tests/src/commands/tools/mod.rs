//! `rt-tests tools`: how far a tool's tick is from what unlimited work would give.
//!
//! Both cores run in this process under a simulated clock ([`simulator`]), with the hand's loop
//! closed. In every tick the product's proxy is copied before it moves; the copy moves to the same
//! pose of the device on the same front until it is settled; where 256 steps do not settle it, that
//! is counted. The difference of the two is what the budget of a tick costs: in force, in distance,
//! and in contacts that were found late.
//!
//! The tools are a capsule of 968 faces (in whole rings; where 960 are asked for, as in the bundled
//! scene, they make 924), on models at the size of that scene, and a rod of 0.8 mm on a comb with
//! slots of 1 mm.

mod comb;
mod measure;
mod row;

use crate::failure::Failure;
use crate::models::source::source;
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{print_either, status_bar};
use crate::report::table::Table;
use crate::report::units::grouped;
use crate::scenes::{check_seconds, prepare_models};
use clap::Args;
use hrtc_core::contact::tool::ToolMesh;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use row::{Row, legend};
use scene::{
    ModelScale, ModelSource, NoFiles, Overrides, ProbeShape, ScenePlan, TrajectoryPlan, parse,
};
use serde::Serialize;
use std::fmt::Write as _;
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::atomic::AtomicBool;

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
    faces: FACES,
};
/// Faces of a tool: the fewest of whole rings that are no fewer than 960.
const FACES: u32 = 968;
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
    #[arg(long, value_name = "N", default_value_t = FACES, value_parser = clap::value_parser!(u32).range(TOOL_FACES))]
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
    /// One for each model and seed that came to an end.
    pub rows: Vec<Row>,
    /// Why others did not, a sentence each; empty where every row was measured.
    pub failed: Vec<String>,
}

impl Tools {
    /// Of what each row came to.
    ///
    /// # Errors
    /// The first failure where nothing was measured: it is all that there is to say.
    fn of(measured: Vec<Result<Row, Failure>>) -> Result<Self, Failure> {
        let (mut rows, mut failures) = (Vec::new(), Vec::new());
        for of in measured {
            match of {
                Ok(row) => rows.push(row),
                // An end on request is said once, however many rows it cut short.
                Err(failure) if failures.contains(&failure) => {}
                Err(failure) => failures.push(failure),
            }
        }
        if rows.is_empty() && !failures.is_empty() {
            return Err(failures.swap_remove(0));
        }
        let failed = failures.iter().map(Failure::to_string).collect();
        Ok(Self { rows, failed })
    }

    /// Whether every row was measured and keeps the limits.
    ///
    /// # Errors
    /// With all that is not so.
    fn judge(&self) -> Result<(), Failure> {
        let mut wrong = self.failed.clone();
        let broken = self.rows.iter().filter(|row| !row.broken().is_empty());
        let broken: Vec<String> = broken
            .map(|row| {
                let (model, seed) = (&row.model, row.seed);
                format!("{model} seed {seed}: {}", row.broken().join(", "))
            })
            .collect();
        if !broken.is_empty() {
            wrong.push(format!("beyond a limit: {}", broken.join("; ")));
        }
        if wrong.is_empty() {
            return Ok(());
        }
        Err(Failure::Run(wrong.join("; ")))
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input, 1 when a limit is not kept, or a row could not be measured
/// beside others.
pub fn tools(args: &ToolsArgs) -> Result<(), Failure> {
    let found = run(args)?;
    print_either(args.json, &table(&found), &found)?;
    found.judge()
}

/// # Errors
/// When the command is to end.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

/// A tool on a model.
struct Pair {
    model: String,
    tool: String,
    plan: ScenePlan,
}

/// Measures what was asked for; what cannot be measured is said beside the rest.
///
/// # Errors
/// When a model cannot be read, a number is out of range, or nothing was measured.
pub fn run(args: &ToolsArgs) -> Result<Tools, Failure> {
    let seconds = args
        .seconds
        .unwrap_or(if args.quick { QUICK_SECONDS } else { SECONDS });
    check_seconds(seconds)?;
    let seeds = args.seeds.unwrap_or(if args.quick { 1 } else { SEEDS });
    // Nothing is temporary yet, so that a request to end still ends a long build at once. The comb
    // is a file in a temporary folder, and small.
    let models = models(args);
    let built = models.iter().map(|typed| match typed.as_str() {
        COMB => Ok(None),
        typed => prepared(typed, args.faces, Path::new("")).map(Some),
    });
    let built: Vec<Option<Pair>> = built.collect::<Result<_, _>>()?;
    // Before the first file in a temporary folder: an end on request removes it.
    let stop = stop_flag()?;
    let folder = tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))?;
    let mut pairs = Vec::new();
    for pair in built {
        check_stop(&stop)?;
        pairs.push(match pair {
            Some(pair) => pair,
            None => prepared(COMB, args.faces, folder.path())?,
        });
    }
    let runs: Vec<(&Pair, u64)> = pairs
        .iter()
        .flat_map(|pair| (1..=seeds).map(move |seed| (pair, seed)))
        .collect();
    let bar = status_bar(runs.len() as u64);
    let measured: Vec<Result<Row, Failure>> = runs
        .par_iter()
        .map(|&(pair, seed)| {
            let row = measure::measure(
                &with_seed(&pair.plan, seed),
                [&pair.model, &pair.tool],
                seed,
                seconds,
                &stop,
            )?;
            bar.set_message(format!("{} seed {seed}", pair.model));
            bar.inc(1);
            bar.suspend(|| eprintln!("{}", row.sentence()));
            Ok(row)
        })
        .collect();
    bar.finish_and_clear();
    Tools::of(measured)
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

/// The same with its model built.
fn prepared(typed: &str, faces: u32, folder: &Path) -> Result<Pair, Failure> {
    let pair = pair(typed, faces, folder)?;
    prepare_models(&pair.plan)?;
    Ok(pair)
}

fn with_seed(plan: &ScenePlan, to: u64) -> ScenePlan {
    let mut plan = plan.clone();
    if let TrajectoryPlan::Tour { seed, .. } = &mut plan.probes[0].trajectory {
        *seed = to;
    }
    plan
}

fn table(found: &Tools) -> String {
    let heads = "model | tool | seed | contact\nticks | behind\n% | late\n% | different\n% | reference\nunsettled % | force off\nmN p50 | p99 | max | not late\nmax | force\nN p99 | step\nN max | reference\nN max | beyond\nN max | units\np50 | p99 | broken";
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
            percent(row.reference_unsettled_share),
            millinewtons(off.p50),
            millinewtons(off.p99),
            millinewtons(off.max),
            millinewtons(row.difference_not_late_n_max),
            format!("{:.2}", row.force_n.p99),
            format!("{:.3}", row.force_step_n_max),
            format!("{:.3}", row.reference_step_n_max),
            match row.step_beyond_n_max {
                0.0 => "0".to_string(),
                beyond => format!("{beyond:.1e}"),
            },
            format!("{:.0}", row.units.p50),
            format!("{:.0}", row.units.p99),
            row.broken().join(", "),
        ]);
    }
    let legend = legend();
    let mut text =
        format!("a tool beside the same with unlimited work in every tick\n{legend}\n{table}");
    for sentence in &found.failed {
        let _ = writeln!(text, "{sentence}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_that_fails_takes_no_other_with_it() {
        let failure = |why: &str| Failure::Run(why.to_string());
        let row = |seed| Row {
            model: "relief".to_string(),
            seed,
            ..Row::default()
        };
        let ended = || Err(failure("ended on request"));
        let measured = vec![ended(), Ok(row(1)), Err(failure("nothing")), ended()];
        let found = Tools::of(measured).expect("a row is there");
        assert_eq!((found.rows.len(), found.rows[0].seed), (1, 1));
        assert_eq!(found.failed, ["ended on request", "nothing"]);
        let text = table(&found);
        assert!(
            text.contains("relief") && text.contains("nothing"),
            "{text}"
        );
        let said = found.judge().expect_err("rows are missing").to_string();
        assert!(said.starts_with("ended on request; nothing"), "{said}");
        // All that there is to say, with its status.
        let input = Failure::Input("no mesh".to_string());
        let none = Tools::of(vec![Err(input.clone()), ended()]);
        assert_eq!(none.err(), Some(input));
    }

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
        for (asked, has) in [(12, 12), (13, 12), (960, 924), (967, 924), (FACES, 968)] {
            let pair = pair("relief:1000", asked, folder.path()).expect("it is a shape");
            assert_eq!(pair.tool, format!("capsule-{has}"));
        }
    }
}
