//! `rt-tests accuracy`: what accuracy costs in time, memory and bytes.
//!
//! Both cores run in this process under a simulated clock ([`simulator`]). On each model the
//! device's poses are recorded once, in a closed loop on the mesh that was never simplified; then
//! the same poses go to a controller for each setting, from the base mesh to the full mesh. So what
//! differs between two settings is the front alone. The ticks are timed apart, from the recorded
//! inputs, in turns.
//!
//! | module | holds |
//! |---|---|
//! | `knobs` | the settings beside the tolerance |
//! | `measure`, `timing` | errors, forces, bytes; times |
//! | `queries` | closest points of the same contacts in 32 and 64 bits |
//! | `result`, `checks` | the JSON, and what must hold |
//! | `table`, `page` | the terminal and the CSV; the HTML page with its pictures |

mod checks;
mod knobs;
mod measure;
mod page;
mod queries;
mod result;
mod table;
mod timing;

pub use result::{Accuracy, Bytes, Check, FASTER, Knob, Point, StageQuantiles, StageTimes};

use crate::failure::Failure;
use crate::machine::Machine;
use crate::models::source::typed_or;
use crate::processes::stop::{is_set, stop_flag};
use crate::report::output::{make_folder, print_either, status_line, write_json, write_whole};
use crate::scenes::check_seconds;
use crate::trajectory::reference::Reference;
use crate::trajectory::scene_model::{SIZE_M, SceneModel};
use clap::Args;
use indicatif::ProgressBar;
use knobs::{Beside, Family, Variant};
use measure::Measured;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use scene::{AccuracyPlan, PolicyPlan, RefinementPlan};
use spm::VspRecord;
use spm::{BaseFace, BaseVertex, ModelHeader};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

/// What is measured when no model is named.
const DEFAULT_MODELS: [&str; 3] = ["sphere:20000", "relief:100000", "terrain:130000"];
/// Tolerances between the base mesh and the full mesh, m, on an object whose longest side is 0.15
/// m: three decades.
const TOLERANCES_M: [f64; 7] = [1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5];
/// Prefixes of the sequence of splits: one in so many of them.
const PREFIX_SHARES: [u32; 4] = [64, 16, 4, 1];

/// Arguments of `rt-tests accuracy`.
#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Mesh or SPM files, or shapes as SHAPE:FACES [default: sphere:20000 relief:100000
    /// terrain:130000]
    #[arg(value_name = "MODEL")]
    pub models: Vec<String>,
    /// Folder of the page, its first picture, the CSV and the JSON
    #[arg(long, value_name = "DIR", default_value = "reports/accuracy")]
    pub out: PathBuf,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
    /// Seed of the tour over each model
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Length of the tour over each model, seconds of simulated time
    #[arg(
        long,
        value_name = "N",
        default_value_t = 5.0,
        allow_negative_numbers = true
    )]
    pub seconds: f64,
    /// Speed of the hand, m/s; the other knobs are measured at four times it too
    #[arg(
        long,
        value_name = "V",
        default_value_t = 0.1,
        allow_negative_numbers = true
    )]
    pub speed: f64,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for bad input, 1 when a check fails, or a model after others were
/// measured.
pub fn accuracy(args: &AccuracyArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    if !(1e-4..=2.5).contains(&args.speed) {
        return Err(Failure::Input(format!(
            "--speed is {}; write metres a second from 0.0001 to 2.5",
            args.speed
        )));
    }
    // A bad model is refused before any is measured. Nothing is temporary yet, so that a request
    // to end still ends a long build at once.
    let mut models: Vec<SceneModel> = typed_or(&args.models, &DEFAULT_MODELS)
        .iter()
        .map(|typed| SceneModel::open(typed))
        .collect::<Result<_, _>>()?;
    let stop = stop_flag()?;
    make_folder(&args.out)?;
    let session = Session {
        args,
        line: status_line(),
        stop: &stop,
    };
    let mut found = Accuracy::new(args.seed, args.seconds, SIZE_M, args.speed);
    let ended = models.iter_mut().try_for_each(|model| {
        model.set_speed(args.speed);
        session.study(model, &mut found)
    });
    session.line.finish_and_clear();
    let found = found.ended(ended)?;
    let machine = Machine::read();
    let page = args.out.join("accuracy.html");
    write_whole(&page, page::page(&found, &machine).as_bytes())?;
    let curve = args.out.join("accuracy.svg");
    write_whole(&curve, page::curve(&found).as_bytes())?;
    write_whole(
        &args.out.join("accuracy.csv"),
        table::csv(&found).as_bytes(),
    )?;
    write_json(&args.out.join("accuracy.json"), &found)?;
    let words = format!(
        "{}\n{:<8} {}\n",
        table::words(&found),
        "page",
        page.display()
    );
    print_either(args.json, &words, &found)?;
    found.judge()
}

/// What the models share.
struct Session<'a> {
    args: &'a AccuracyArgs,
    line: ProgressBar,
    stop: &'a AtomicBool,
}

impl Session<'_> {
    /// Begins a step and says which.
    ///
    /// # Errors
    /// When the command is to end.
    fn begin(&self, model: &SceneModel, step: &str) -> Result<(), Failure> {
        check_stop(self.stop)?;
        let name = &model.mesh.name;
        self.line.set_message(format!("{name}: {step}"));
        Ok(())
    }

    /// Everything about one model.
    fn study(&self, model: &mut SceneModel, found: &mut Accuracy) -> Result<(), Failure> {
        self.begin(model, "recording the trajectory on the full mesh")?;
        let reference = Reference::record(model, self.args.seed, self.args.seconds)?;
        let mut measured = self.measure_all(model, &reference, settings(model))?;
        let count = measured.len();
        self.begin(model, &format!("timing {count} settings in turns"))?;
        timing::time(&mut measured)?;
        // With the models that its settings are built with.
        let folder = temporary()?;
        let families = knobs::families(model, folder.path(), self.stop)?;
        let same = families.iter().filter(|family| family.touch.is_none());
        let of_same: Vec<Variant> = same.flat_map(|family| family.variants.clone()).collect();
        measured.extend(self.others(model, &reference, families)?);
        let mut points: Vec<Point> = measured.into_iter().map(|setting| setting.point).collect();
        self.begin(model, "queries in 32 and 64 bits")?;
        points.extend(queries::precision(model, &reference)?);
        for point in &mut points {
            point.speed_m_per_s = self.args.speed;
        }
        let faster = self.faster(model, of_same)?.into_iter();
        points.extend(faster.map(|setting| setting.point));
        for point in &mut points {
            point.model_place = found.bytes.len();
        }
        let checks = checks::checks(model, &reference, &points);
        found.checks.extend(checks);
        found.bytes.push(bytes(model, &points));
        found.points.extend(points);
        Ok(())
    }

    /// The errors of some settings, several at once: no time is taken here.
    fn measure_all(
        &self,
        model: &SceneModel,
        reference: &Reference,
        variants: Vec<Variant>,
    ) -> Result<Vec<Measured>, Failure> {
        variants
            .into_par_iter()
            .map(|variant| {
                let knob = variant.point.knob.name();
                self.begin(model, &format!("errors by {knob}"))?;
                measure::measure(model, reference, variant)
            })
            .collect()
    }

    /// The knobs beside the tolerance that are measured on the common touch, under a faster hand.
    fn faster(
        &self,
        model: &mut SceneModel,
        variants: Vec<Variant>,
    ) -> Result<Vec<Measured>, Failure> {
        let AccuracyArgs { seed, seconds, .. } = *self.args;
        let speed = FASTER * self.args.speed;
        model.set_speed(speed);
        let found = self
            .begin(model, "recording the trajectory of a faster hand")
            .and_then(|()| Reference::record(model, seed, seconds))
            .and_then(|reference| {
                let mut measured = self.measure_all(model, &reference, variants)?;
                self.begin(model, "timing under a faster hand")?;
                timing::time(&mut measured)?;
                Ok(measured)
            });
        model.set_speed(self.args.speed);
        let mut found = found?;
        for setting in &mut found {
            setting.point.speed_m_per_s = speed;
        }
        Ok(found)
    }

    /// The knobs beside the tolerance, those of one reference timed in turns.
    fn others(
        &self,
        model: &mut SceneModel,
        reference: &Reference,
        families: Vec<Family>,
    ) -> Result<Vec<Measured>, Failure> {
        let mut all = Vec::new();
        for family in families {
            let mut measured = match family.touch {
                None => self.measure_all(model, reference, family.variants)?,
                Some(plan) => {
                    self.begin(model, "recording another touch on the full mesh")?;
                    let own = std::mem::replace(&mut model.plan, plan);
                    let found = Reference::record(model, self.args.seed, self.args.seconds)
                        .and_then(|touch| self.measure_all(model, &touch, family.variants));
                    model.plan = own;
                    found?
                }
            };
            self.begin(model, "timing")?;
            timing::time(&mut measured)?;
            all.extend(measured);
        }
        Ok(all)
    }
}

/// # Errors
/// When the command is to end: what was cut short is no measure.
fn check_stop(stop: &AtomicBool) -> Result<(), Failure> {
    if is_set(stop) {
        return Err(Failure::Run("ended on request".to_string()));
    }
    Ok(())
}

/// A folder for built models.
fn temporary() -> Result<TempDir, Failure> {
    tempfile::tempdir()
        .map_err(|error| Failure::Run(format!("there is no temporary folder ({error})")))
}

/// The settings of a model, coarse to fine: what is asked for, and the scene that asks for it.
fn settings(model: &SceneModel) -> Vec<Variant> {
    let setting = |knob: Knob, value: f64, accuracy: AccuracyPlan| {
        let mut plan = model.plan.clone();
        plan.accuracy = accuracy;
        if knob != Knob::Local {
            // Global refinement is compared at its best: with room for all that it asks for.
            plan.cache_bytes = model.cache_for_all();
        }
        let mut point = Point::new(&model.mesh.name, knob, value);
        point.setting = knobs::accuracy_setting(&plan.accuracy);
        Variant {
            point,
            plan,
            beside: Beside::default(),
        }
    };
    let within = |knob: Knob, refinement: RefinementPlan, tolerance_m: f64| {
        let accuracy = AccuracyPlan {
            tolerance_m,
            refinement,
            geomorph: true,
            policy: PolicyPlan::default(),
        };
        let mut variant = setting(knob, tolerance_m, accuracy);
        variant.point.full_mesh = tolerance_m == 0.0;
        variant
    };
    let base = model.diagonal_m();
    let local = std::iter::once(base)
        .chain(TOLERANCES_M)
        .chain([0.0])
        .map(|value| within(Knob::Local, RefinementPlan::Local, value));
    let everywhere = RefinementPlan::Global { lod: None };
    let global = TOLERANCES_M
        .into_iter()
        .chain([0.0])
        .map(|value| within(Knob::Global, everywhere, value));
    let vsps = model.mesh.file.model_header().vsps;
    let prefix = PREFIX_SHARES.into_iter().map(|share| {
        let lod = vsps / share;
        let accuracy = AccuracyPlan {
            tolerance_m: 0.0,
            refinement: RefinementPlan::Global { lod: Some(lod) },
            geomorph: true,
            policy: PolicyPlan::default(),
        };
        let mut variant = setting(Knob::Prefix, f64::from(lod), accuracy);
        variant.point.full_mesh = share == 1;
        variant
    });
    local.chain(global).chain(prefix).collect()
}

fn bytes(model: &SceneModel, points: &[Point]) -> Bytes {
    let header = model.mesh.file.model_header();
    let vertices = u64::from(header.base_vertices) + u64::from(header.vsps);
    let faces = u64::from(header.faces);
    let full = points
        .iter()
        .find(|point| point.knob == Knob::Local && point.full_mesh);
    let head = size_of::<ModelHeader>()
        + header.base_vertices as usize * size_of::<BaseVertex>()
        + header.base_faces as usize * size_of::<BaseFace>();
    let until_full = full.map_or(0, |point| point.bytes_until_full);
    Bytes {
        model: model.mesh.name.clone(),
        vertices,
        faces,
        first_touch_bytes: full.map_or(0, |point| point.bytes_until_ready),
        local_full_bytes: if until_full == 0 {
            -1
        } else {
            until_full as i64
        },
        trajectory_bytes: full.map_or(0, |point| point.bytes),
        records_bytes: (head + header.vsps as usize * size_of::<VspRecord>()) as u64,
        plain_bytes: 12 * vertices + 12 * faces,
    }
}
