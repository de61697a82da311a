//! `rt-tests fronts`: what makes fronts trustworthy, shown on any mesh.
//!
//! | module | shows |
//! |---|---|
//! | [`legality`] | random walks: counters against the adjacency test, every invariant, Theorem 4 |
//! | [`certified`] | sampled distances against the certified error, both directions |
//! | [`calibration`] | asked tolerances against the true errors of touches |
//! | [`coarsest`] | the coarsest fronts that keep a tolerance, to tell the LOD controller's part from the mesh's |
//! | [`cost`] | nanoseconds of a split and a collapse with the AB-tree |
//! | [`limits`], [`table`] | what is judged, and what a person sees |

pub mod calibration;
pub mod certified;
pub mod coarsest;
pub mod cost;
pub mod legality;
pub mod limits;
pub mod table;

use crate::failure::Failure;
use crate::models::Model;
use crate::models::hard_meshes::HARD_MESHES;
use crate::models::surface::Surface;
use crate::report::output::{make_folder, print, print_json, status_line, write_json, write_whole};
use crate::report::quantile::quantile;
use clap::Args;
use indicatif::ProgressBar;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use spm_builder::{BuildOptions, NoProgress};
use std::path::PathBuf;

/// Arguments of `rt-tests fronts`.
#[derive(Debug, Args)]
pub struct FrontsArgs {
    /// Mesh files or SPM files [default: the bundled scene's shape and generated worst cases]
    pub models: Vec<PathBuf>,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Seed of the walks and samples
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder that fronts.json and the table (fronts.txt) are written to as well
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Fronts {
    /// Seed of the walks and samples.
    pub seed: u64,
    /// One a model.
    pub models: Vec<ModelFronts>,
    /// What is beyond its limit, in words; empty when all is well.
    pub broken: Vec<String>,
}

/// A median and a value that one in a hundred exceeds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th of 100.
    pub p99: f64,
}

/// A median and a value that one in twenty exceeds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Ratio {
    /// Median.
    pub p50: f64,
    /// 95th of 100.
    pub p95: f64,
}

/// One model.
#[derive(Debug, Default, Serialize)]
pub struct ModelFronts {
    /// The model.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// Faces of the base mesh.
    pub base_faces: u32,
    /// The walk: `splits`, `collapses`, `comparisons`, `mismatches` and more.
    #[serde(flatten)]
    pub walk: legality::Legality,
    /// VSPs in the longest chain of dependencies.
    pub chain: u32,
    /// The longest that it may be.
    pub chain_limit: u32,
    /// Mean closure of a region, VSPs.
    pub closure_mean: f64,
    /// Largest closure of a region, VSPs.
    pub closure_max: u32,
    /// Certified error of a face over the largest distance sampled on it.
    pub certified_ratio: Ratio,
    /// Distances sampled.
    pub certified_samples: u64,
    /// Distances beyond their bound.
    pub certified_violations: u64,
    /// What is asked for beside what the touch gets.
    pub dial: calibration::Calibration,
    /// Single operations, each with its share of its batch's update of the tree.
    #[serde(flatten)]
    pub single: Costs,
    /// The mean operation of each batch.
    pub batch: Costs,
    /// Splits in a batch, mean.
    pub batch_splits_mean: f64,
    /// What reading the clock takes, ns; it is taken off. An operation that takes less is too short
    /// to be timed alone, and only batches are judged.
    pub clock_ns: u64,
}

/// What splits and collapses cost with the tree, nanoseconds.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Costs {
    /// Of splits.
    pub split_ns: Percentiles,
    /// Of collapses.
    pub collapse_ns: Percentiles,
    /// Splits, or batches of them, that were timed.
    pub timed_splits: usize,
    /// Collapses, or batches of them.
    pub timed_collapses: usize,
}

impl Costs {
    fn of([splits, collapses]: [&[f64]; 2]) -> Self {
        Self {
            split_ns: percentiles(splits),
            collapse_ns: percentiles(collapses),
            timed_splits: splits.len(),
            timed_collapses: collapses.len(),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a bad file, 1 when a limit is broken.
pub fn fronts(args: &FrontsArgs) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        make_folder(out)?;
    }
    let line = Line::new(args.json);
    let mut found = Fronts {
        seed: args.seed,
        models: Vec::new(),
        broken: Vec::new(),
    };
    let options = BuildOptions::default();
    let mut take = |model: Result<Model, Failure>| {
        let shown = judge_model(&model?, args.seed, &line)?;
        if found.models.is_empty() {
            line.say(&table::head())?;
        }
        line.say(&table::row(&shown))?;
        found.broken.extend(limits::broken(&shown));
        found.models.push(shown);
        Ok::<(), Failure>(())
    };
    if args.models.is_empty() {
        for (name, make) in HARD_MESHES {
            line.at(name, "building");
            let model = Model::build(name.to_string(), make(), &options, &NoProgress);
            take(model.map_err(|error| Failure::Run(error.to_string())))?;
        }
    }
    for path in &args.models {
        line.at(&path.display().to_string(), "building");
        take(Model::open(path, &options, &NoProgress))?;
    }
    line.bar.finish_and_clear();
    line.say(&table::foot(&found.models))?;
    if let Some(out) = &args.out {
        write_json(&out.join("fronts.json"), &found)?;
        write_whole(&out.join("fronts.txt"), table::table(&found).as_bytes())?;
    }
    if args.json {
        print_json(&found)?;
    }
    match found.broken.len() {
        0 => Ok(()),
        1 => Err(Failure::Run(found.broken.swap_remove(0))),
        more => Err(Failure::Run(format!(
            "{}; and {} more limits are broken",
            found.broken[0],
            more - 1
        ))),
    }
}

/// Everything about one model.
fn judge_model(model: &Model, seed: u64, line: &Line) -> Result<ModelFronts, Failure> {
    let header = model.file.model_header();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    line.at(&model.name, "walking over fronts");
    let walk = legality::walk(model, &mut random);
    let full = Surface::new(model.full_triangles());
    line.at(&model.name, "sampling certified errors");
    let certified = certified::certified(model, &full, &mut random)?;
    line.at(&model.name, "comparing asked and true errors");
    let calibration = calibration::calibration(model, &full, &mut random)?;
    line.at(&model.name, "timing splits and collapses");
    let cost = cost::cost(model, &full, &mut random)?;
    Ok(ModelFronts {
        model: model.name.clone(),
        faces: header.faces,
        base_faces: header.base_faces,
        walk,
        chain: legality::chain(model),
        chain_limit: limits::chain(model),
        closure_mean: model.file.summary().closure_mean,
        closure_max: header.closure_max,
        certified_ratio: Ratio {
            p50: quantile(&certified.ratios, 0.5),
            p95: quantile(&certified.ratios, 0.95),
        },
        certified_samples: certified.samples,
        certified_violations: certified.violations,
        dial: calibration,
        single: Costs::of([&cost.splits.single_ns, &cost.collapses.single_ns]),
        batch: Costs::of([&cost.splits.batch_ns, &cost.collapses.batch_ns]),
        batch_splits_mean: cost.splits.single_ns.len() as f64
            / cost.splits.batch_ns.len().max(1) as f64,
        clock_ns: cost.clock_ns,
    })
}

fn percentiles(sorted: &[f64]) -> Percentiles {
    Percentiles {
        p50: quantile(sorted, 0.5),
        p99: quantile(sorted, 0.99),
    }
}

/// The line on standard error that says what is going on, and the table above it.
struct Line {
    bar: ProgressBar,
    /// Whether standard output is for JSON: the table goes to standard error then.
    json: bool,
}

impl Line {
    fn new(json: bool) -> Self {
        Self {
            bar: status_line(),
            json,
        }
    }

    fn at(&self, model: &str, what: &str) {
        self.bar.set_message(format!("{model}: {what}"));
    }

    /// Says lines that stay, each as soon as it is known.
    fn say(&self, text: &str) -> Result<(), Failure> {
        self.bar.suspend(|| {
            if self.json {
                eprint!("{text}");
                return Ok(());
            }
            print(text)
        })
    }
}
