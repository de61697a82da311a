//! `rt-tests compare`: what a query and an update cost, beside parry's on the same meshes in the
//! same run.
//!
//! | module | measures |
//! |---|---|
//! | `closest` | the closest point along a path over the surface |
//! | `tools` | all pairs of faces of the surface and of a tool that touches |
//! | `update` | an update of the tree where a patch of faces was deformed |
//! | `marking` | nodes that an update marks, beside the bound of Theorem 2, and its time beside a query's |
//! | `levels` | a probe against the coarse, the locally refined and the full mesh |
//! | `full_front` | ours over a prefix of the sequence, mostly the full mesh: no local refinement has a part in it |
//! | `picture` | all of it as pictures |
//! | `timing` | single queries, in turn, without the time of other processes |
//!
//! Ours is measured twice: on the front as the controller forms it, refined around the tip and
//! coarse elsewhere, and on the full mesh. Every answer is checked against an exact search in f64
//! over all faces.

mod closest;
mod full_front;
mod levels;
mod marking;
mod picture;
mod timing;
mod tools;
mod update;

use crate::failure::Failure;
use crate::models::Model;
use crate::models::source::{open, typed_or};
use crate::models::surface::Surface;
use crate::peers::parry::Mesh;
use crate::report::output::{make_folder, print_either, write_json, write_whole};
use crate::report::quantile::{quantile, sort};
use crate::report::table::Table;
use crate::report::units::{bytes, grouped};
use clap::Args;
use full_front::FullFront;
use levels::Level;
use marking::{Marking, UpdateShare};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde::Serialize;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Instant;

/// What is measured when no model is named.
const DEFAULT_MODEL: &str = "relief:100000";
/// Points of the path from one pose of a tool to the next; fewer poses where all sizes are gone
/// through.
const EVERY: usize = 5;
const EVERY_OF_GROWTH: usize = 20;
/// Faces of the shapes over which the cost is seen to grow.
const GROWTH: [u32; 5] = [4_000, 16_000, 64_000, 250_000, 1_000_000];
/// The most that ours, on the front of the controller, may take of parry's time in single
/// precision.
const MAX_CLOSEST: f64 = 0.5;
/// The most that all pairs of a tool, on the front of the controller, may take of those of parry's
/// leaves with GJK, which are told the pose as parry's own code tells it; see
/// [`crate::peers::parry::ToolPose`].
const MAX_TOOL: f64 = 0.2;
/// The most that an update of ours may take of parry's.
const MAX_UPDATE: f64 = 0.4;

/// Arguments of `rt-tests compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Mesh or SPM files, or shapes as SHAPE:FACES [default: relief:100000]
    #[arg(value_name = "MODEL")]
    pub models: Vec<String>,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Seed of the paths and patches
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Show the growth of the cost on shapes of at most so many faces; 0 for none
    #[arg(long, value_name = "FACES", default_value_t = 1_000_000)]
    pub growth: u32,
    /// Folder for compare.json and the pictures
    #[arg(long, value_name = "DIR", default_value = "reports/compare")]
    pub out: PathBuf,
}

/// Who answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Who {
    /// Ours, on the front as the controller forms it.
    OursLocal,
    /// Ours, on the full mesh.
    OursFull,
    /// Parry in single precision, on the full mesh.
    ParryF32,
    /// Parry in double precision, on the full mesh.
    ParryF64,
    /// The same with the tool made anew at every pose.
    ParryF64Moved,
}

impl Who {
    const ALL: [Self; 5] = [
        Self::OursLocal,
        Self::OursFull,
        Self::ParryF32,
        Self::ParryF64,
        Self::ParryF64Moved,
    ];

    fn words(self) -> &'static str {
        match self {
            Self::OursLocal => "ours, local front",
            Self::OursFull => "ours, full mesh",
            Self::ParryF32 => "parry f32",
            Self::ParryF64 => "parry f64",
            Self::ParryF64Moved => "parry f64, moved",
        }
    }
}

/// What one contender took for one task on one model.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// The task.
    pub task: &'static str,
    /// The model.
    pub model: String,
    /// Faces of the full mesh.
    pub faces: u32,
    /// Who.
    pub who: Who,
    /// Median of the single queries, nanoseconds.
    pub p50_ns: f64,
    /// 99th of 100, nanoseconds.
    pub p99_ns: f64,
    /// The longest single one, nanoseconds.
    pub max_ns: f64,
    /// Answers that differ from the exact ones by more than rounding.
    pub answers_differ: u64,
    /// Bytes of mesh and tree together, for the task `build`; else 0.
    pub bytes: u64,
    /// Whether its times are held to limits: those of the shapes of growing size are not, only
    /// their answers.
    pub is_judged: bool,
}

impl Row {
    fn new(
        task: &'static str,
        model: &Model,
        who: Who,
        mut ns: Vec<f64>,
        answers_differ: u64,
    ) -> Self {
        sort(&mut ns);
        Self {
            task,
            model: model.name.clone(),
            faces: model.file.model_header().faces,
            who,
            p50_ns: quantile(&ns, 0.5),
            p99_ns: quantile(&ns, 0.99),
            max_ns: quantile(&ns, 1.0),
            answers_differ,
            bytes: 0,
            is_judged: true,
        }
    }
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Compare {
    /// Seed of the paths and patches.
    pub seed: u64,
    /// One a task, model and contender.
    pub rows: Vec<Row>,
    /// The same on shapes of growing size.
    pub growth: Vec<Row>,
    /// Nodes that updates mark.
    pub marking: Vec<Marking>,
    /// Updates of local fronts beside queries.
    pub update_share: Vec<UpdateShare>,
    /// A probe against fronts of all levels.
    pub levels: Vec<Level>,
    /// The same on the shapes of growing size.
    pub growth_levels: Vec<Level>,
    /// What is beyond its limit, in words; empty when all is well.
    pub broken: Vec<String>,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a bad file, 1 when a limit is broken or an answer wrong.
pub fn compare(args: &CompareArgs) -> Result<(), Failure> {
    make_folder(&args.out)?;
    let mut found = Compare {
        seed: args.seed,
        rows: Vec::new(),
        growth: Vec::new(),
        marking: Vec::new(),
        update_share: Vec::new(),
        levels: Vec::new(),
        growth_levels: Vec::new(),
        broken: Vec::new(),
    };
    for typed in typed_or(&args.models, &[DEFAULT_MODEL]) {
        eprintln!("{typed}: building");
        let model = open(&typed)?;
        eprintln!("{typed}: measuring");
        let measured = Measured::new(&model, args.seed, EVERY)?;
        found.broken.extend(broken(&measured.rows));
        found.rows.extend(measured.rows);
        let (marking, update_share) = updates(&model, args.seed)?;
        found.marking.extend(marking);
        found.update_share.extend(update_share);
        found.levels.extend(measured.levels);
    }
    for faces in GROWTH.into_iter().filter(|&faces| faces <= args.growth) {
        eprintln!("relief of {} faces: building", grouped(faces.into()));
        let model = open(&format!("relief:{faces}"))?;
        eprintln!("relief of {} faces: measuring", grouped(faces.into()));
        let measured = Measured::new(&model, args.seed, EVERY_OF_GROWTH)?;
        found
            .growth
            .extend(measured.rows.into_iter().map(|row| Row {
                is_judged: false,
                ..row
            }));
        found.growth_levels.extend(measured.levels);
    }
    found.broken.extend(wrong(&found.growth));
    found
        .broken
        .extend(marking::broken(&found.marking, &found.update_share));
    found.broken.extend(levels::broken(&found.growth_levels));
    for (name, svg) in picture::pictures(&found) {
        write_whole(&args.out.join(name), svg.as_bytes())?;
    }
    write_json(&args.out.join("compare.json"), &found)?;
    print_either(args.json, &words(&found), &found)?;
    match found.broken.first() {
        None => Ok(()),
        Some(first) => Err(Failure::Run(first.clone())),
    }
}

/// What is measured on a model of any size.
struct Measured {
    rows: Vec<Row>,
    levels: Vec<Level>,
}

impl Measured {
    /// Every task on a model; a tool touches at every so many points of the path.
    fn new(model: &Model, seed: u64, every: usize) -> Result<Self, Failure> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let full = Surface::new(model.full_triangles());
        let mut front = FullFront::new(model)?;
        let start = Instant::now();
        let mut single = closest::single(model)?;
        let single_ns = start.elapsed().as_nanos() as f64;
        let start = Instant::now();
        let mut double = closest::double(model)?;
        let double_ns = start.elapsed().as_nanos() as f64;
        let both: [&dyn Mesh; 2] = [&single, &double];
        let mut rows = closest::rows(model, &full, &front, both, &mut random)?;
        let both: [&mut dyn Mesh; 2] = [&mut single, &mut double];
        rows.extend(tools::rows(model, &full, &front, both, every, &mut random)?);
        let levels = levels::levels(model, &full, &front, &mut random)?;
        rows.extend(update::rows(
            model,
            &mut front,
            &mut single,
            &mut double,
            &mut random,
        ));
        let built = [
            (Who::OursFull, front.build_ns, front.bytes()),
            (Who::ParryF32, single_ns, single.bytes()),
            (Who::ParryF64, double_ns, double.bytes()),
        ];
        rows.extend(built.map(|(who, ns, bytes)| Row {
            bytes: bytes as u64,
            ..Row::new("build", model, who, vec![ns], 0)
        }));
        Ok(Self { rows, levels })
    }
}

/// What updates mark and take.
fn updates(model: &Model, seed: u64) -> Result<(Vec<Marking>, Vec<UpdateShare>), Failure> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let marking = marking::markings(model, &FullFront::new(model)?, &mut random);
    let full = Surface::new(model.full_triangles());
    Ok((marking, marking::shares(model, &full, &mut random)?))
}

/// Wrong answers of ours, in words; those of others are in the table.
fn wrong(rows: &[Row]) -> Vec<String> {
    let ours = [Who::OursLocal, Who::OursFull];
    let wrong = rows
        .iter()
        .filter(|row| row.answers_differ > 0 && ours.contains(&row.who));
    wrong
        .map(|row| {
            format!(
                "{}, {}: {} of {} answers differ",
                row.model,
                row.task,
                row.who.words(),
                row.answers_differ
            )
        })
        .collect()
}

/// Wrong answers, and what is beyond its limit, in words.
fn broken(rows: &[Row]) -> Vec<String> {
    let mut broken = wrong(rows);
    let mut limit =
        |task: &str, what: &str, [ours, theirs]: [Who; 2], most: f64, of: fn(&Row) -> f64| {
            let row = |who: Who| rows.iter().find(|row| row.task == task && row.who == who);
            if let (Some(ours), Some(theirs)) = (row(ours), row(theirs))
                && of(ours) > most * of(theirs)
            {
                broken.push(format!(
                    "{}, {task}: the {what} of ours is {:.2} of parry's, at most {most} is allowed",
                    ours.model,
                    of(ours) / of(theirs)
                ));
            }
        };
    let (p50, p99) = (|row: &Row| row.p50_ns, |row: &Row| row.p99_ns);
    let near = [Who::OursLocal, Who::ParryF32];
    limit("closest_path", "median", near, MAX_CLOSEST, p50);
    limit("closest_path", "99th of 100", near, MAX_CLOSEST, p99);
    for (task, _, _) in tools::TOOLS {
        let touching = [Who::OursLocal, Who::ParryF64];
        limit(task, "median", touching, MAX_TOOL, p50);
        limit(task, "99th of 100", touching, MAX_TOOL, p99);
    }
    let same = [Who::OursFull, Who::ParryF32];
    limit("update64", "median", same, MAX_UPDATE, p50);
    broken
}

/// The tables of the terminal.
fn words(found: &Compare) -> String {
    let heads = "task | model | who | faces | p50 ns | p99 ns | max ns | differ | memory | judged";
    let mut table = Table::new(3, heads);
    for row in found.rows.iter().chain(&found.growth) {
        let has_bytes = row.bytes > 0;
        table.row([
            row.task.to_string(),
            row.model.clone(),
            row.who.words().to_string(),
            row.faces.to_string(),
            grouped(row.p50_ns.round() as u64),
            grouped(row.p99_ns.round() as u64),
            grouped(row.max_ns.round() as u64),
            row.answers_differ.to_string(),
            if has_bytes {
                bytes(row.bytes)
            } else {
                String::new()
            },
            if row.is_judged { "" } else { "not" }.to_string(),
        ]);
    }
    let mut text = table.to_string();
    text += &marking::words(&found.marking, &found.update_share);
    text += &levels::words(found.levels.iter().chain(&found.growth_levels));
    for broken in &found.broken {
        let _ = writeln!(text, "beyond its limit: {broken}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_answer_on_a_small_shape_is_right_and_limits_are_seen() {
        let model = open("relief:3000").unwrap_or_else(|error| panic!("{error}"));
        let measured = Measured::new(&model, 1, EVERY).unwrap_or_else(|error| panic!("{error}"));
        let mut rows = measured.rows;
        assert_eq!(rows.len(), 4 + 2 * 5 + 3 + 3);
        assert_eq!(wrong(&rows), [""; 0]);
        assert!(
            rows.iter()
                .all(|row| row.p50_ns <= row.p99_ns && row.p99_ns <= row.max_ns)
        );
        for row in &mut rows {
            row.p50_ns = 100.0;
            row.p99_ns = 100.0;
        }
        assert_eq!(broken(&rows).len(), 7);
        rows[0].answers_differ = 1;
        assert_eq!(broken(&rows).len(), 8);
    }
}
