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
//! | `peers` | Embree and FCL, by a program of their own, in the same turns |
//! | `row`, `limits` | nothing: what one contender took, and what ours may take |
//! | `picture` | all of it as pictures |
//! | `timing` | single queries, each timed once, without the time of other processes |
//!
//! Ours is measured twice: on the front as the controller forms it, refined around the tip and
//! coarse elsewhere, and on the full mesh as any library gets it. Every answer is checked against
//! an exact search in f64 over all faces; that to an update is the box of the whole, beside that of
//! parry in f64, and those of `levels` are timed only.

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

use crate::failure::{Chosen, Failure, beside_measured};
use crate::models::Model;
use crate::models::source::{open, source, typed_or, unused};
use crate::models::surface::Surface;
use crate::peers::parry::Mesh;
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{make_folder, print_either, write_json, write_whole};
use crate::report::table::Table;
use crate::report::units::{bytes, grouped};
use clap::Args;
use full_front::{FullFront, build_ns};
use levels::Level;
use limits::{Judged, broken, judged};
use marking::{Marking, UpdateShare};
use peers::Peers;
use questions::{FullMesh, Questions};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use row::{Row, Who};
use scene::ModelSource;
use serde::Serialize;
use spm_builder::is_mesh_file;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use tempfile::TempDir;

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
    /// Where ours is beside every limit, on the models and on the shapes of growing size.
    pub limits: Vec<Judged>,
    /// What is beyond its limit, in words; empty when all is well.
    pub broken: Vec<String>,
    /// Libraries beside which ours has limits, and which were not asked: these limits are not
    /// checked.
    pub not_asked: Vec<&'static str>,
    /// What ended the command early; empty where all was measured.
    pub failed: Vec<String>,
}

impl Compare {
    /// Nothing measured yet.
    fn new(seed: u64) -> Self {
        Self {
            seed,
            rows: Vec::new(),
            growth: Vec::new(),
            marking: Vec::new(),
            update_share: Vec::new(),
            levels: Vec::new(),
            growth_levels: Vec::new(),
            limits: Vec::new(),
            broken: Vec::new(),
            not_asked: Vec::new(),
            failed: Vec::new(),
        }
    }

    /// What was measured, and how the measurement ended.
    ///
    /// # Errors
    /// The failure where nothing was measured: it is all that there is to say.
    fn ended(mut self, ended: Result<(), Failure>) -> Result<Self, Failure> {
        self.failed = beside_measured(ended, self.rows.is_empty() && self.growth.is_empty())?;
        let broken = marking::broken(&self.marking, &self.update_share);
        self.broken.extend(broken);
        self.broken.extend(levels::broken(&self.growth_levels));
        self.not_asked = limits::not_asked(self.rows.iter().chain(&self.growth));
        Ok(self)
    }

    /// Whether all was measured and every limit is kept.
    ///
    /// # Errors
    /// With what ended the command, or the first that is not kept.
    fn judge(&self) -> Result<(), Failure> {
        match self.failed.first().or(self.broken.first()) {
            None => Ok(()),
            Some(first) => Err(Failure::Run(first.clone())),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a bad file, 1 when a limit is broken or an answer wrong, or when
/// something fails after other things were measured.
pub fn compare(args: &CompareArgs) -> Result<(), Failure> {
    let models = typed_or(&args.models, &[DEFAULT_MODEL]);
    // A name that is none is refused before anything is measured.
    for typed in &models {
        resolve(typed)?;
    }
    let stop = stop_flag()?;
    make_folder(&args.out)?;
    let mut found = Compare::new(args.seed);
    let ended = measure_all(args, &models, &stop, &mut found);
    let found = found.ended(ended)?;
    for (name, svg) in picture::pictures(&found) {
        write_whole(&args.out.join(name), svg.as_bytes())?;
    }
    write_json(&args.out.join("compare.json"), &found)?;
    print_either(args.json, &words(&found), &found)?;
    found.judge()
}

/// Whether there is what was typed.
///
/// # Errors
/// One sentence that names it.
fn resolve(typed: &str) -> Result<(), Failure> {
    match source(typed)? {
        (_, ModelSource::File(path)) => match std::fs::metadata(&path) {
            Ok(_) => Ok(()),
            Err(error) => Err(Failure::Input(format!("{}: {error}", path.display()))),
        },
        (_, ModelSource::Generate { .. }) => Ok(()),
    }
}

/// Measures the models that were typed, then the shapes of growing size.
///
/// # Errors
/// The first failure; what was measured before it is there.
fn measure_all(
    args: &CompareArgs,
    models: &[String],
    stop: &AtomicBool,
    found: &mut Compare,
) -> Result<(), Failure> {
    let mut names = BTreeSet::new();
    for typed in models {
        check_stop(stop)?;
        eprintln!("{typed}: building");
        let (model, whole) = prepared(typed)?;
        check_stop(stop)?;
        eprintln!("{typed}: measuring");
        let export = args.export.as_ref().map(|folder| match models.len() {
            1 => folder.clone(),
            _ => folder.join(unused(&model.name, &mut names)),
        });
        let others = Others {
            program: args.peers.as_deref(),
            export,
            stop,
        };
        let measured = Measured::new(&model, args.seed, EVERY, &others)?;
        found.broken.extend(broken(&measured.rows));
        found.limits.extend(judged(&measured.rows));
        found.rows.extend(measured.rows);
        found.rows.extend(whole);
        found.levels.extend(measured.levels);
        check_stop(stop)?;
        let (marking, update_share) = updates(&model, args.seed)?;
        found.marking.extend(marking);
        found.update_share.extend(update_share);
    }
    for faces in GROWTH.into_iter().filter(|&faces| faces <= args.growth) {
        check_stop(stop)?;
        eprintln!("relief of {} faces: building", grouped(faces.into()));
        let (model, whole) = prepared(&format!("relief:{faces}"))?;
        check_stop(stop)?;
        eprintln!("relief of {} faces: measuring", grouped(faces.into()));
        let others = Others {
            program: args.peers.as_deref(),
            export: None,
            stop,
        };
        let measured = Measured::new(&model, args.seed, EVERY_OF_GROWTH, &others)?;
        found.broken.extend(broken(&measured.rows));
        found.limits.extend(judged(&measured.rows));
        found.growth.extend(measured.rows);
        found.growth.extend(whole);
        found.growth_levels.extend(measured.levels);
    }
    Ok(())
}

/// A model, and what it took from the mesh until the controller can be served: reading or
/// generating, cleaning, ordering, simplification and the file in memory, on all cores that it may
/// run on. No row where there was an SPM file already.
///
/// # Errors
/// One sentence that names it.
fn prepared(typed: &str) -> Result<(Model, Option<Row>), Failure> {
    let start = Instant::now();
    let model = open(typed)?;
    let ns = start.elapsed().as_nanos() as f64;
    let is_built = match source(typed)? {
        (_, ModelSource::File(path)) => is_mesh_file(&path),
        (_, ModelSource::Generate { .. }) => true,
    };
    let row = is_built.then(|| Row::new("prepare", &model, Who::OursLocal, vec![ns], 0));
    Ok((model, row))
}

/// # Errors
/// When the command is to end: what was cut short is no measure.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

/// Who else is asked, and where the questions are kept; what ends all of it.
struct Others<'a> {
    program: Option<&'a Path>,
    export: Option<PathBuf>,
    stop: &'a AtomicBool,
}

/// The folder with the questions; a temporary one goes with it.
enum Kept {
    Chosen(PathBuf),
    Temporary(TempDir),
}

impl Kept {
    fn path(&self) -> &Path {
        match self {
            Self::Chosen(folder) => folder,
            Self::Temporary(folder) => folder.path(),
        }
    }
}

impl Others<'_> {
    /// Writes the questions if anybody wants them.
    fn keep(&self, mesh: &FullMesh, asked: &Questions) -> Result<Option<Kept>, Failure> {
        let (chosen, kept) = match (&self.export, self.program) {
            (Some(folder), _) => (Chosen::EXPORT, Kept::Chosen(folder.clone())),
            (None, Some(_)) => {
                let folder = tempfile::tempdir()
                    .map_err(|error| Failure::Run(format!("no temporary folder ({error})")))?;
                (Chosen::Temporary, Kept::Temporary(folder))
            }
            (None, None) => return Ok(None),
        };
        asked.write(mesh, chosen, kept.path())?;
        Ok(Some(kept))
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
        check_stop(others.stop)?;
        let mut front = FullFront::new(model)?;
        let mesh = FullMesh::new(model);
        let mut single = closest::single(model, &mesh)?;
        let mut double = closest::double(model, &mesh)?;
        let both: [&dyn Mesh; 2] = [&single, &double];
        check_stop(others.stop)?;
        let kept = others.keep(&mesh, &asked)?;
        let mut peers = match (others.program, &kept) {
            (Some(program), Some(kept)) => {
                Some(Peers::start(program, kept.path(), &asked, others.stop)?)
            }
            _ => None,
        };
        let mut rows = closest::rows(model, &asked, &front, both, peers.as_mut())?;
        let both: [&mut dyn Mesh; 2] = [&mut single, &mut double];
        check_stop(others.stop)?;
        rows.extend(tools::rows(model, &asked, &front, both, peers.as_mut())?);
        check_stop(others.stop)?;
        if let Some(peers) = peers {
            rows.extend(peers.rows(model, &asked)?);
        }
        check_stop(others.stop)?;
        let levels = levels::levels(model, &full, &front, levels::PROBE, &mut random)?;
        check_stop(others.stop)?;
        rows.extend(update::rows(
            model,
            &mut front,
            &mut single,
            &mut double,
            &mut random,
        ));
        let built = [
            (
                Who::OursFull,
                build_ns(model, &mesh, &front)?,
                front.bytes(),
            ),
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

/// What the rows of the table cannot say of themselves.
const NOTES: &str = "\
build: once, everyone on one thread, from the faces in the order of the file: ours orders them anew, stores \
the mesh, puts them into the tree and fits the boxes\n\
prepare: all that the product does once, on all cores that it may run on, from the mesh to the SPM file that it serves: also \
cleaning and simplification, of which no library has any\n\
closest_path*, tool*_pairs: everyone in the same turns of 50 points or 10 poses; before each, the core's \
caches are swept and as many questions before it are put again, untimed\n\
tool240_pairs, tool960_pairs: all pairs that meet, anew at each pose; a tick collects the pairs near \
its tool instead, and keeps them while it moves little\n";

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
    let mut text = format!("{table}{NOTES}{}", limits::words(&found.limits));
    text += &marking::words(&found.marking, &found.update_share);
    text += &levels::words(found.levels.iter().chain(&found.growth_levels));
    if let Some(skipped) = levels::skipped(&found.growth_levels) {
        let _ = writeln!(text, "{skipped}");
    }
    for broken in &found.broken {
        let _ = writeln!(text, "beyond its limit: {broken}");
    }
    if !found.not_asked.is_empty() {
        let libraries = found.not_asked.join(" and ");
        let _ = writeln!(
            text,
            "not checked: the limits beside {libraries}, which --peers asks"
        );
    }
    for failed in &found.failed {
        let _ = writeln!(text, "failed: {failed}");
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
            stop: &AtomicBool::new(false),
        };
        let measured = Measured::new(&model, 1, EVERY, &nobody);
        let mut rows = measured.unwrap_or_else(|error| panic!("{error}")).rows;
        assert_eq!(rows.len(), 3 * 4 + 2 * 6 + 3 + 3);
        assert_eq!(wrong(&rows), [""; 0]);
        assert_eq!(limits::not_asked(rows.iter()), ["Embree", "FCL"]);
        assert!(
            rows.iter()
                .all(|row| row.p50_ns <= row.p99_ns && row.p99_ns <= row.max_ns)
        );
        for row in &mut rows {
            row.p50_ns = 100.0;
            row.p99_ns = 100.0;
        }
        // The limits beside parry, at two quantiles each.
        assert_eq!(broken(&rows).len(), 2 * 8);
        let limits = judged(&rows);
        assert_eq!(limits.len(), 8);
        for of in &limits {
            assert!(
                of.share_p50 == 1.0 && of.share_p99 == 1.0 && !of.is_kept,
                "{of:?}"
            );
        }
        assert!(limits::words(&limits).contains("parry f64"));
        rows[0].answers_differ = 1;
        assert_eq!(broken(&rows).len(), 2 * 8 + 1);
        for row in rows.iter_mut().filter(|row| row.who == Who::ParryF32) {
            row.p50_ns = f64::NAN;
        }
        assert_eq!(broken(&rows).len(), 2 * 8 + 1, "what is no number");
    }

    /// What was measured of a model and a task, within its limits.
    fn measured() -> Compare {
        let row = Row {
            task: "build",
            model: "cow.obj".to_string(),
            faces: 1000,
            who: Who::OursFull,
            p50_ns: 1.0,
            p99_ns: 1.0,
            max_ns: 1.0,
            answers_differ: 0,
            bytes: 1,
        };
        Compare {
            rows: vec![row],
            ..Compare::new(1)
        }
    }

    #[test]
    fn a_late_failure_is_said_beside_what_was_measured() {
        let failure = || Failure::Input("b.obj: this is no mesh".to_string());
        // All that there is to say, with its status.
        let none = Compare::new(1).ended(Err(failure()));
        assert_eq!(none.err(), Some(failure()));
        let found = measured().ended(Err(failure())).expect("a row is there");
        let text = words(&found);
        assert!(text.contains("cow.obj"), "{text}");
        assert!(text.contains("ours orders them anew"), "{text}");
        assert!(text.contains("failed: b.obj: this is no mesh"), "{text}");
        assert_eq!(found.judge(), Err(Failure::Run(failure().to_string())));
        let whole = measured().ended(Ok(())).expect("nothing failed");
        assert_eq!(whole.judge(), Ok(()));
        assert!(!words(&whole).contains("failed") && !words(&whole).contains("not checked"));
    }

    #[test]
    fn a_limit_beside_who_was_not_asked_is_said_not_to_be_checked() {
        let mut found = measured();
        found.rows[0].task = closest::PATH;
        let found = found.ended(Ok(())).expect("nothing failed");
        assert_eq!(found.not_asked, ["parry f32", "Embree"]);
        let text = words(&found);
        assert!(
            text.contains("not checked: the limits beside parry f32 and Embree"),
            "{text}"
        );
    }

    #[test]
    fn a_command_that_is_to_end_measures_nothing() {
        let args = CompareArgs {
            models: vec!["relief:1000".to_string()],
            json: false,
            seed: 1,
            growth: 4000,
            export: None,
            peers: None,
            out: PathBuf::new(),
        };
        let mut found = Compare::new(1);
        let ended = measure_all(&args, &args.models, &AtomicBool::new(true), &mut found);
        assert_eq!(ended, Err(Failure::Run("ended on request".to_string())));
        assert!(found.rows.is_empty());
    }
}
