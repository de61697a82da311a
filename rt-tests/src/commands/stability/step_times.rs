//! What a step of a proxy takes: ours and a peer's, with the same ball over the same path on the
//! same mesh, one after the other.
//!
//! The path is a tour that was recorded in a closed loop on the mesh that was never simplified.
//! Every contender is given its poses, each once; the ticks in which that mesh was touched count.

use crate::clocks::{Clocks, Reading};
use crate::failure::{Chosen, Failure};
use crate::models::source::{typed_or, unused};
use crate::peers::ball::{BallScene, PeerProgram, Step};
use crate::report::output::write_whole_at;
use crate::report::quantile::Quantiles;
use crate::report::units::{grouped, percent};
use crate::trajectory::reference::{Reference, come_to_rest};
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::virtual_scene::make_ready;
use geometry::Pose;
use hrtc_core::{ModelFrame, NoObserver, Stage, StageObserver};
use scene::{AccuracyPlan, PolicyPlan, RefinementPlan, ScenePlan};
use serde::Serialize;
use simulator::{InputRecording, Playback};
use std::collections::BTreeSet;
use std::path::Path as Folder;

/// What is measured when no model is named.
const DEFAULT_MODEL: &str = "relief:100000";
/// Length of the path: ten thousand ticks.
const SECONDS: f64 = 10.0;

/// What a step took one contender on one model.
#[derive(Debug, Serialize)]
pub struct StepTimes {
    /// The model.
    pub model: String,
    /// Faces of its full mesh.
    pub faces: u64,
    /// Whose: `ours_local` and `ours_full` are the search for the contact, the proxy and the force
    /// with everything that limits it; `ours_local_tick` is a whole tick with refinement and
    /// boxes; or a variant of a peer.
    pub who: String,
    /// Steps: ticks in contact.
    pub steps: u64,
    /// Median, nanoseconds.
    pub p50_ns: f64,
    /// 99 of 100 take no more.
    pub p99_ns: f64,
    /// The most.
    pub max_ns: f64,
    /// Steps whose force differs from that of the full mesh in a closed loop by more than a tenth
    /// of it; no error of either, a sign of how alike what was timed is.
    pub force_differs: u64,
}

/// Times a step on each model that was typed; with a folder the path is written there, too, as a
/// peer is asked, to `MODEL.ball`, with a number behind a name that came before.
///
/// # Errors
/// One sentence for a bad model, a peer that breaks off, or a file that cannot be written.
pub fn step_times(
    program: &PeerProgram,
    models: &[String],
    seed: u64,
    export: Option<&Folder>,
) -> Result<Vec<StepTimes>, Failure> {
    let mut found = Vec::new();
    let mut names = BTreeSet::new();
    for typed in typed_or(models, &[DEFAULT_MODEL]) {
        eprintln!("{typed}: a path, and a step of each");
        let model = SceneModel::open(&typed)?;
        let path = Path::record(&model, seed)?;
        for (who, refinement) in [
            ("ours_local", RefinementPlan::Local),
            ("ours_full", RefinementPlan::Global { lod: None }),
        ] {
            let plan = plan(&model, refinement);
            let played = path.played(&model, &plan)?;
            found.push(path.row(who, &played.query(&plan)?, &played.forces));
            if refinement == RefinementPlan::Local {
                found.push(path.row("ours_local_tick", &played.whole(&plan), &played.forces));
            }
        }
        let (scene, steps) = (scene(&model), path.steps(&model));
        if let Some(folder) = export {
            let questions = [scene.message(0), Step::message(&steps)].concat();
            let name = unused(&path.model, &mut names);
            let file = folder.join(format!("{name}.ball"));
            write_whole_at(Chosen::EXPORT, &file, &questions)?;
        }
        for (variant, who) in program.variants.iter().enumerate() {
            let answers = program.start(variant, &scene)?.step(&steps)?;
            let ns: Vec<f64> = answers.iter().map(|answer| answer.ns).collect();
            let forces: Vec<f64> = answers.iter().map(|of| of.force.length()).collect();
            found.push(path.row(who, &ns, &forces));
        }
    }
    Ok(found)
}

/// The scene of a model with a kind of refinement, all of it to full resolution.
fn plan(model: &SceneModel, refinement: RefinementPlan) -> ScenePlan {
    let mut plan = model.plan.clone();
    plan.cache_bytes = model.cache_for_all();
    plan.accuracy = AccuracyPlan {
        tolerance_m: 0.0,
        refinement,
        geomorph: true,
        policy: PolicyPlan::default(),
    };
    plan
}

/// What a peer is given of a model.
fn scene(model: &SceneModel) -> BallScene {
    let object = &model.plan.objects[0];
    let header = model.mesh.file.model_header();
    let frame = ModelFrame::new(Pose::IDENTITY, object.scale, &header);
    let (positions, faces) = model.mesh.full_mesh();
    BallScene {
        positions: positions.iter().map(|&p| frame.to_world(p)).collect(),
        faces,
        radius_m: model.plan.probes[0].shape.tip_m(),
        stiffness_n_per_m: object.surface.stiffness_n_per_m,
        damping_ns_per_m: object.surface.damping_ns_per_m,
        friction: [0.0; 2],
        shaded_turn: 0.0,
    }
}

/// A path over a model.
struct Path {
    model: String,
    faces: u64,
    reference: Reference,
}

impl Path {
    fn record(model: &SceneModel, seed: u64) -> Result<Self, Failure> {
        Ok(Self {
            model: model.mesh.name.clone(),
            faces: u64::from(model.mesh.file.model_header().faces),
            reference: Reference::record(model, seed, SECONDS)?,
        })
    }

    /// The same to a peer.
    fn steps(&self, model: &SceneModel) -> Vec<Step> {
        let object = model.plan.objects[0].pose;
        let samples = self.reference.samples.iter();
        samples
            .map(|sample| Step {
                object,
                device: sample.pose.position,
            })
            .collect()
    }

    /// The controller over the path, with its station in virtual time; its inputs are kept.
    fn played(&self, model: &SceneModel, plan: &ScenePlan) -> Result<Played, Failure> {
        let mut simulation = model.simulation(plan)?;
        simulation.client_mut().record();
        let ready = make_ready(&mut simulation)?;
        come_to_rest(&mut simulation, self.reference.rest, ready)?;
        let start = simulation.tick() as usize;
        let samples = self.reference.samples.iter();
        let force = |&sample| simulation.step(Some(sample)).wrenches[0].force.length();
        let forces = samples.map(force).collect();
        let recording = simulation.client_mut().take_recording();
        Ok(Played {
            recording: recording.unwrap_or_default(),
            start,
            forces,
        })
    }

    /// The row of a contender, from what each tick took, nanoseconds, and its force, newtons.
    fn row(&self, who: &str, ns: &[f64], forces: &[f64]) -> StepTimes {
        let ticks = || self.reference.ticks.iter().enumerate();
        let touched = ticks().filter(|(_, tick)| tick.contact.is_some());
        let mut taken: Vec<f64> = touched.map(|(k, _)| ns[k]).collect();
        // A comparison with what is no number is false.
        let alike = |k: usize, force: f64| (forces[k] - force).abs() <= 0.1 * force;
        let alike = ticks()
            .filter(|(k, tick)| tick.contact.is_some() && alike(*k, tick.force.length()))
            .count();
        let quantiles = Quantiles::of(&mut taken);
        StepTimes {
            model: self.model.clone(),
            faces: self.faces,
            who: who.to_string(),
            steps: taken.len() as u64,
            p50_ns: quantiles.p50,
            p99_ns: quantiles.p99,
            max_ns: quantiles.max,
            force_differs: (taken.len() - alike) as u64,
        }
    }
}

/// A path as the controller had it.
struct Played {
    recording: InputRecording,
    /// Ticks before the path.
    start: usize,
    /// Force of each tick, newtons.
    forces: Vec<f64>,
}

impl Played {
    /// Nanoseconds of search, proxy and force of each tick.
    fn query(&self, plan: &ScenePlan) -> Result<Vec<f64>, Failure> {
        let mut playback = Playback::new(&self.recording, SceneModel::controller(plan));
        let mut clock = QueryClock::default();
        let mut ns = Vec::with_capacity(self.recording.len());
        while let Some(is_same) = playback.step(&mut clock) {
            if !is_same {
                let what = "a replay gives other bits than it gave before: please report this";
                return Err(Failure::Run(what.to_string()));
            }
            ns.push(clock.ns);
        }
        Ok(ns.split_off(self.start))
    }

    /// Nanoseconds of each tick as a whole.
    fn whole(&self, plan: &ScenePlan) -> Vec<f64> {
        let mut playback = Playback::new(&self.recording, SceneModel::controller(plan));
        let clocks = Clocks::new();
        let mut ns = Vec::with_capacity(self.recording.len());
        while let (taken, Some(_)) = clocks.time(|| playback.step(&mut NoObserver)) {
            ns.push(taken);
        }
        ns.split_off(self.start)
    }
}

/// Time from the end of the boxes to the end of the tick.
#[derive(Debug, Default)]
struct QueryClock {
    clocks: Clocks,
    start: Reading,
    ns: f64,
}

impl StageObserver for QueryClock {
    fn ended(&mut self, stage: Stage) {
        match stage {
            Stage::Refit => self.start = Clocks::start(),
            Stage::Force => self.ns = self.clocks.since(self.start),
            _ => {}
        }
    }
}

/// A table of the terminal's heads and rows.
pub(super) const HEADS: &str =
    "model | faces | whose step | steps | p50 ns | p99 ns | max ns | force\ndiffers";

impl StepTimes {
    /// Its row.
    pub(super) fn cells(&self) -> [String; 8] {
        let whole = |ns: f64| grouped(ns.round() as u64);
        [
            self.model.clone(),
            grouped(self.faces),
            self.words(),
            grouped(self.steps),
            whole(self.p50_ns),
            whole(self.p99_ns),
            whole(self.max_ns),
            percent(self.force_differs, self.steps),
        ]
    }

    /// Whose step it is.
    pub(super) fn words(&self) -> String {
        match self.who.as_str() {
            "ours_local" => "ours, local front".to_string(),
            "ours_full" => "ours, full mesh".to_string(),
            "ours_local_tick" => "ours, local front, whole tick".to_string(),
            peer => peer.to_string(),
        }
    }
}
