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
//! | `full_front` | nothing: ours over the full mesh, and over prefixes of the sequence |
//! | `questions` | nothing: what everyone is asked, in memory and as files |
//! | `peers` | Embree and FCL, by a program of their own |
//! | `row`, `limits` | nothing: what one contender took, and what ours may take |
//! | `picture` | all of it as pictures |
//! | `timing` | single queries, each put once, without the time of other processes |
//!
//! Ours is measured twice: on the front as the controller forms it, refined around the tip and
//! coarse elsewhere, and on the full mesh as any library gets it. Every answer is checked against
//! an exact search in f64 over all faces.

pub(super) mod closest;
pub(super) mod full_front;
pub(super) mod levels;
mod limits;
pub(super) mod marking;
mod peers;
mod picture;
mod questions;
mod row;
pub(super) mod timing;
pub(super) mod tools;
pub(super) mod update;

use crate::failure::{Chosen, Failure};
use crate::models::Model;
use crate::models::source::{open, typed_or, unused};
use crate::models::surface::Surface;
use crate::peers::parry::Mesh;
use crate::report::output::{make_folder, print_either, write_json, write_whole};
use crate::report::table::Table;
use crate::report::units::{bytes, grouped};
use clap::Args;
use full_front::FullFront;
use levels::Level;
use limits::broken;
use marking::{Marking, UpdateShare};
use questions::{FullMesh, Questions};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use row::{Row, Who};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What is measured when no model is named.
const DEFAULT_MODEL: &str = "relief:100000";
/// Points of the path from one pose of a tool to the next; fewer poses where all sizes are gone
/// through.
const EVERY: usize = 5;
const EVERY_OF_GROWTH: usize = 20;
/// Faces of the shapes over which the cost is seen to grow.
const GROWTH: [u32; 5] = [4_000, 16_000, 64_000, 250_000, 1_000_000];

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
    /// Write the questions to a folder, so that other libraries can be asked the same; of several
    /// models, each to a folder of its name in it, with a number behind a name that came before
    #[arg(long, value_name = "DIR")]
    pub export: Option<PathBuf>,
    /// Ask further libraries by this program, built from rt-tests/peers
    #[arg(long, value_name = "PROGRAM")]
    pub peers: Option<PathBuf>,
    /// Folder for compare.json and the pictures
    #[arg(long, value_name = "DIR", default_value = "reports/compare")]
    pub out: PathBuf,
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
    let models = typed_or(&args.models, &[DEFAULT_MODEL]);
    let mut names = BTreeSet::new();
    for typed in &models {
        eprintln!("{typed}: building");
        let model = open(typed)?;
        eprintln!("{typed}: measuring");
        let export = args.export.as_ref().map(|folder| match models.len() {
            1 => folder.clone(),
            _ => folder.join(unused(&model.name, &mut names)),
        });
        let others = Others {
            program: args.peers.as_deref(),
            export,
        };
        let measured = Measured::new(&model, args.seed, EVERY, &others)?;
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
        let others = Others {
            program: args.peers.as_deref(),
            export: None,
        };
        let measured = Measured::new(&model, args.seed, EVERY_OF_GROWTH, &others)?;
        found.broken.extend(broken(&measured.rows));
        found.growth.extend(measured.rows);
        found.growth_levels.extend(measured.levels);
    }
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

/// Who else is asked, and where the questions are kept.
struct Others<'a> {
    program: Option<&'a Path>,
    export: Option<PathBuf>,
}

impl Others<'_> {
    /// Writes the questions if anybody wants them, and asks.
    fn rows(&self, model: &Model, mesh: &FullMesh, asked: &Questions) -> Result<Vec<Row>, Failure> {
        if self.program.is_none() && self.export.is_none() {
            return Ok(Vec::new());
        }
        let kept_nowhere = tempfile::tempdir()
            .map_err(|error| Failure::Run(format!("no temporary folder ({error})")))?;
        let (chosen, folder) = match &self.export {
            Some(folder) => (Chosen::EXPORT, folder.as_path()),
            None => (Chosen::Temporary, kept_nowhere.path()),
        };
        asked.write(mesh, chosen, folder)?;
        match self.program {
            Some(program) => peers::rows(program, folder, model, asked),
            None => Ok(Vec::new()),
        }
    }
}

/// What is measured on a model of any size.
struct Measured {
    rows: Vec<Row>,
    levels: Vec<Level>,
}

impl Measured {
    /// Every task on a model; a tool touches at every so many points of the path.
    fn new(model: &Model, seed: u64, every: usize, others: &Others<'_>) -> Result<Self, Failure> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let full = Surface::new(model.full_triangles());
        let asked = Questions::new(model, &full, every, &mut random)?;
        let mut front = FullFront::new(model)?;
        let mesh = FullMesh::new(model);
        let mut single = closest::single(model, &mesh)?;
        let mut double = closest::double(model, &mesh)?;
        let both: [&dyn Mesh; 2] = [&single, &double];
        let mut rows = closest::rows(model, &asked, &front, both)?;
        let both: [&mut dyn Mesh; 2] = [&mut single, &mut double];
        rows.extend(tools::rows(model, &asked, &front, both)?);
        rows.extend(others.rows(model, &mesh, &asked)?);
        let levels = levels::levels(model, &full, &front, levels::PROBE, &mut random)?;
        rows.extend(update::rows(
            model,
            &mut front,
            &mut single,
            &mut double,
            &mut random,
        ));
        let built = [
            (Who::OursFull, front.build_ns, front.bytes()),
            (Who::ParryF32, single.build_ns, single.bytes()),
            (Who::ParryF64, double.build_ns, double.bytes()),
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
    // Handles are those of the file here.
    let front = FullFront::prefix(model, model.records.len())?;
    let marking = marking::markings(model, &front, &mut random);
    let full = Surface::new(model.full_triangles());
    Ok((marking, marking::shares(model, &full, &mut random)?))
}

/// The tables of the terminal.
fn words(found: &Compare) -> String {
    let heads = "task | model | who | faces | p50 ns | p99 ns | max ns | differ | memory";
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
    use limits::wrong;

    #[test]
    fn every_answer_on_a_small_shape_is_right_and_limits_are_seen() {
        let model = open("relief:3000").unwrap_or_else(|error| panic!("{error}"));
        let nobody = Others {
            program: None,
            export: None,
        };
        let measured = Measured::new(&model, 1, EVERY, &nobody);
        let mut rows = measured.unwrap_or_else(|error| panic!("{error}")).rows;
        assert_eq!(rows.len(), 3 * 4 + 2 * 6 + 3 + 3);
        assert_eq!(wrong(&rows), [""; 0]);
        assert!(
            rows.iter()
                .all(|row| row.p50_ns <= row.p99_ns && row.p99_ns <= row.max_ns)
        );
        for row in &mut rows {
            row.p50_ns = 100.0;
            row.p99_ns = 100.0;
        }
        // The limits beside parry, at two quantiles each.
        assert_eq!(broken(&rows).len(), 2 * 6);
        rows[0].answers_differ = 1;
        assert_eq!(broken(&rows).len(), 2 * 6 + 1);
        for row in rows.iter_mut().filter(|row| row.who == Who::ParryF32) {
            row.p50_ns = f64::NAN;
        }
        assert_eq!(broken(&rows).len(), 2 * 6 + 1, "what is no number");
    }
}
