//! `rt-tests fronts`: what makes fronts trustworthy, shown on any mesh.
//!
//! | module | shows |
//! |---|---|
//! | [`legality`] | random walks: counters against the adjacency test, every invariant, Theorem 4 |
//! | [`certified`] | sampled distances against the certified error, both directions |
//! | [`dial`] | asked tolerances against the true errors of touches |
//! | [`cost`] | nanoseconds of a split and a collapse with the AB-tree |
//! | [`local_front`], [`path`] | fronts as the two processes form them, along paths over the surface |
//! | [`cases`] | generated models on which this goes wrong first |

pub mod cases;
pub mod certified;
pub mod cost;
pub mod dial;
pub mod legality;
pub mod local_front;
pub mod path;

use crate::failure::Failure;
use crate::models::Model;
use crate::run::{print, print_json};
use crate::surface::Surface;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;
use ve_station::build::{BuildOptions, NoProgress};

/// The longest chain of dependencies that a model may have, up to a million faces.
const MOST_CHAIN: u32 = 40;
/// Beyond a million faces: so many times the doublings from base mesh to full mesh.
const CHAIN_A_DOUBLING: f64 = 4.0;
/// Limits of the cost, ns an operation: median and 99 of 100 batches.
const MOST_NS: Percentiles = Percentiles {
    p50: 1000.0,
    p99: 5000.0,
};
/// The most that the asked tolerance may be of the largest true error of a stretch, at the median.
const MOST_ASKED_OVER_TRUE: f64 = 3.5;
/// The most contacts that may exceed what was asked.
const MOST_EXCEEDED: f64 = 1e-3;
/// Fewer batches say nothing about the slowest in a hundred.
const FEWEST_BATCHES: usize = 100;

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
    pub dial: dial::Dial,
    /// A split with the tree, ns, over batches.
    pub split_ns: Percentiles,
    /// A collapse with the tree, ns, over batches.
    pub collapse_ns: Percentiles,
    /// Batches of splits.
    pub batches: usize,
    /// Batches of collapses.
    pub collapse_batches: usize,
    /// Splits in a batch, mean.
    pub batch_splits_mean: f64,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a bad file, 1 when a limit is broken.
pub fn fronts(args: &FrontsArgs) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        std::fs::create_dir_all(out).map_err(|error| Failure::write(out, &error))?;
    }
    let line = Line::new();
    let mut found = Fronts {
        seed: args.seed,
        models: Vec::new(),
        broken: Vec::new(),
    };
    let options = BuildOptions::default();
    let mut take = |model: Result<Model, Failure>| {
        let shown = judge_model(&model?, args.seed, &line)?;
        line.say(&row(&shown));
        found.broken.extend(broken(&shown));
        found.models.push(shown);
        Ok::<(), Failure>(())
    };
    line.say(HEAD);
    if args.models.is_empty() {
        for (name, make) in cases::CASES {
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
    let table = table(&found);
    if let Some(out) = &args.out {
        let json = serde_json::to_string_pretty(&found).unwrap_or_default();
        for (name, text) in [("fronts.json", &json), ("fronts.txt", &table)] {
            let path = out.join(name);
            std::fs::write(&path, text).map_err(|error| Failure::write(&path, &error))?;
        }
    }
    if args.json {
        print_json(&found)?;
    } else {
        print(&table)?;
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
    line.at(&model.name, "turning the dial");
    let dial = dial::dial(model, &full, &mut random)?;
    line.at(&model.name, "timing splits and collapses");
    let cost = cost::cost(model, &full, &mut random)?;
    Ok(ModelFronts {
        model: model.name.clone(),
        faces: header.faces,
        base_faces: header.base_faces,
        walk,
        chain: legality::chain(model),
        chain_limit: chain_limit(model),
        closure_mean: model.file.summary().closure_mean,
        closure_max: header.closure_max,
        certified_ratio: Ratio {
            p50: quantile(&certified.ratios, 0.5),
            p95: quantile(&certified.ratios, 0.95),
        },
        certified_samples: certified.samples,
        certified_violations: certified.violations,
        dial,
        split_ns: percentiles(&cost.split_ns),
        collapse_ns: percentiles(&cost.collapse_ns),
        batches: cost.split_ns.len(),
        collapse_batches: cost.collapse_ns.len(),
        batch_splits_mean: cost.splits as f64 / cost.split_ns.len().max(1) as f64,
    })
}

/// The longest chain that the issue of the model's size allows.
fn chain_limit(model: &Model) -> u32 {
    let header = model.file.model_header();
    let vertices = f64::from(header.base_vertices) + f64::from(header.vsps);
    let doublings = (vertices / f64::from(header.base_vertices)).log2();
    if header.faces > 1_000_000 {
        MOST_CHAIN.max((CHAIN_A_DOUBLING * doublings) as u32)
    } else {
        MOST_CHAIN
    }
}

/// A value of sorted numbers that this part of them does not exceed; 0 of none.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    let place = (sorted.len() as f64 * part) as usize;
    sorted
        .get(place.min(sorted.len().saturating_sub(1)))
        .copied()
        .unwrap_or(0.0)
}

fn percentiles(sorted: &[f64]) -> Percentiles {
    Percentiles {
        p50: quantile(sorted, 0.5),
        p99: quantile(sorted, 0.99),
    }
}

/// What is beyond its limit, in words.
fn broken(m: &ModelFronts) -> Vec<String> {
    let mut broken = Vec::new();
    let mut limit = |name: &str, value: f64, most: f64| {
        if value > most {
            broken.push(format!(
                "{}: {name} is {value:.6}, at most {most} is allowed",
                m.model
            ));
        }
    };
    limit("mismatches", m.walk.mismatches as f64, 0.0);
    limit(
        "splits that need a collapse",
        m.walk.needed_a_collapse.into(),
        0.0,
    );
    limit(
        "fronts that are not the image of the full mesh",
        m.walk.wrong_images.into(),
        0.0,
    );
    limit("chain", m.chain.into(), m.chain_limit.into());
    limit("certified_violations", m.certified_violations as f64, 0.0);
    if m.dial.cases.iter().any(|case| case.counts) {
        limit(
            "dial.asked_over_true_p50",
            m.dial.asked_over_true_p50,
            MOST_ASKED_OVER_TRUE,
        );
        limit("dial.exceeded_share", m.dial.exceeded_share, MOST_EXCEEDED);
    }
    for (name, ns, batches) in [
        ("split_ns", m.split_ns, m.batches),
        ("collapse_ns", m.collapse_ns, m.collapse_batches),
    ] {
        limit(&format!("{name}.p50"), ns.p50, MOST_NS.p50);
        if batches >= FEWEST_BATCHES {
            limit(&format!("{name}.p99"), ns.p99, MOST_NS.p99);
        }
    }
    broken
}

const HEAD: &str = "model                    faces   splits  collapses  differ  chain  closure mean/max  certified/sampled p50/p95  beyond  asked/true exceeded  split ns p50/p99  collapse ns p50/p99\n";

fn row(m: &ModelFronts) -> String {
    format!(
        "{:<20} {:>9} {:>8} {:>10} {:>7} {:>3}/{:<2} {:>9.0} {:>7} {:>14.1} {:>11.1} {:>7} {:>10.2} {:>7.3}% {:>8.0} {:>7.0} {:>11.0} {:>8.0}\n",
        m.model,
        m.faces,
        m.walk.splits,
        m.walk.collapses,
        m.walk.mismatches,
        m.chain,
        m.chain_limit,
        m.closure_mean,
        m.closure_max,
        m.certified_ratio.p50,
        m.certified_ratio.p95,
        m.certified_violations,
        m.dial.asked_over_true_p50,
        m.dial.exceeded_share * 100.0,
        m.split_ns.p50,
        m.split_ns.p99,
        m.collapse_ns.p50,
        m.collapse_ns.p99,
    )
}

fn table(found: &Fronts) -> String {
    let mut text = HEAD.to_string();
    for model in &found.models {
        text.push_str(&row(model));
    }
    for broken in &found.broken {
        let _ = writeln!(text, "beyond its limit: {broken}");
    }
    text
}

/// The line on standard error that says what is going on.
struct Line {
    bar: ProgressBar,
}

impl Line {
    fn new() -> Self {
        let bar = ProgressBar::new_spinner();
        if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {msg}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(std::time::Duration::from_millis(200));
        Self { bar }
    }

    fn at(&self, model: &str, what: &str) {
        self.bar.set_message(format!("{model}: {what}"));
    }

    /// Says a line that stays, also where standard error is no terminal.
    fn say(&self, text: &str) {
        self.bar.suspend(|| eprint!("{text}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slow(batches: usize, collapse_batches: usize) -> ModelFronts {
        let ns = Percentiles {
            p50: 2000.0,
            p99: 9000.0,
        };
        ModelFronts {
            model: "slow".to_string(),
            split_ns: ns,
            collapse_ns: ns,
            batches,
            collapse_batches,
            ..ModelFronts::default()
        }
    }

    fn names(m: &ModelFronts) -> Vec<String> {
        let word = |text: String| {
            let rest = text.split_once(": ")?.1;
            rest.split_whitespace().next().map(str::to_string)
        };
        broken(m).into_iter().filter_map(word).collect()
    }

    #[test]
    fn the_median_cost_is_judged_over_however_few_batches_and_the_slowest_over_a_hundred() {
        let medians = ["split_ns.p50", "collapse_ns.p50"];
        assert_eq!(names(&slow(1, 1)), medians);
        assert_eq!(names(&slow(99, 99)), medians);
        // Each by its own batches.
        let of_splits = ["split_ns.p50", "split_ns.p99", "collapse_ns.p50"];
        assert_eq!(names(&slow(100, 99)), of_splits);
        assert_eq!(names(&slow(100, 100)).len(), 4);
        assert_eq!(names(&ModelFronts::default()), [""; 0]);
    }
}
