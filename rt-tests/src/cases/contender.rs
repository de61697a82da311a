//! Whom a case asks in place of the product's own proxy, or who writes down what is asked.
//!
//! The product runs on beside: fronts, poses of objects and all that a case looks at besides force
//! and proxy are its.

use super::setup::Setup;
use crate::failure::{Chosen, Failure};
use crate::models::Model;
use crate::peers::ball::{Answer, BallPeer, BallScene, PeerProgram, Step};
use geometry::Pose;
use glam::DVec3;
use hrtc_core::ModelFrame;
use scene::{Effect, ScenePlan};
use spm::SpmFile;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One contender of one run of one case.
#[derive(Debug)]
pub struct Contender {
    who: Who,
    log: Mutex<ContenderLog>,
}

#[derive(Debug)]
enum Who {
    /// A variant of another library.
    Peer(Arc<PeerProgram>, usize),
    /// Ours; questions go to files of this folder and name.
    File(PathBuf, &'static str),
}

/// What a contender did.
#[derive(Debug, Clone, Default)]
pub struct ContenderLog {
    /// Benches that it had.
    pub benches: u32,
    /// Ticks that it answered, or that were written.
    pub steps: u64,
    /// The first answer without numbers to a question that had them.
    pub not_finite_at: Option<u64>,
    /// Why it could not go on.
    pub broken: Option<Failure>,
}

impl Contender {
    /// A variant of a peer. It stays for the rest of the program, as a [`Setup`] is copied freely.
    #[must_use]
    pub fn peer(program: &Arc<PeerProgram>, variant: usize) -> &'static Self {
        Self::leak(Who::Peer(Arc::clone(program), variant))
    }

    /// Ours, whose questions are written to `CASE.N.ball` in a folder, a file a bench.
    #[must_use]
    pub fn file(folder: PathBuf, case: &'static str) -> &'static Self {
        Self::leak(Who::File(folder, case))
    }

    fn leak(who: Who) -> &'static Self {
        let log = Mutex::default();
        Box::leak(Box::new(Self { who, log }))
    }

    /// What it did so far.
    #[must_use]
    pub fn log(&self) -> ContenderLog {
        self.locked().clone()
    }

    fn locked(&self) -> MutexGuard<'_, ContenderLog> {
        self.log.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// For a bench of this model and scene.
    pub(super) fn start(
        &'static self,
        model: &[u8],
        plan: &ScenePlan,
        setup: &Setup,
    ) -> Result<Asking, Failure> {
        let started = scene_of(model, plan, setup).and_then(|scene| self.start_on(&scene));
        started.inspect_err(|failure| self.locked().broken = Some(failure.clone()))
    }

    fn start_on(&'static self, scene: &BallScene) -> Result<Asking, Failure> {
        let bench = self.locked().benches;
        self.locked().benches += 1;
        let source = match &self.who {
            Who::Peer(program, variant) => Source::Peer(program.start(*variant, scene)?),
            Who::File(folder, case) => {
                let path = folder.join(format!("{case}.{bench}.ball"));
                let create = || -> std::io::Result<BufWriter<File>> {
                    let mut file = BufWriter::new(File::create(&path)?);
                    file.write_all(&scene.message(0))?;
                    Ok(file)
                };
                Source::File(create().map_err(|error| unwritten(&path, &error))?, path)
            }
        };
        Ok(Asking {
            contender: self,
            source: Some(source),
            last: [DVec3::ZERO; 2],
        })
    }
}

/// A contender on a bench.
#[derive(Debug)]
pub(super) struct Asking {
    contender: &'static Contender,
    /// None once it is broken.
    source: Option<Source>,
    /// Its last force and proxy.
    last: [DVec3; 2],
}

#[derive(Debug)]
enum Source {
    Peer(BallPeer),
    File(BufWriter<File>, PathBuf),
}

impl Asking {
    /// Whether its answers take the place of the product's.
    pub(super) fn is_peer(&self) -> bool {
        matches!(self.contender.who, Who::Peer(..))
    }

    /// A tick with the device there; without a sample the last answer stays. Force and proxy of a
    /// peer.
    pub(super) fn step(&mut self, object: Pose, device: Option<DVec3>) -> [DVec3; 2] {
        let Some(device) = device else {
            return self.last;
        };
        let asked = Step { object, device };
        let answered = match &mut self.source {
            Some(Source::Peer(peer)) => peer.step(&[asked]).map(|answers| answers.first().copied()),
            Some(Source::File(file, path)) => {
                let written = file.write_all(&Step::message(&[asked]));
                written
                    .map(|()| None)
                    .map_err(|error| unwritten(path, &error))
            }
            None => return [DVec3::NAN; 2],
        };
        let mut log = self.contender.locked();
        match answered {
            Ok(answer) => {
                log.steps += 1;
                if let Some(answer) = answer {
                    let is_odd = !answer.is_finite() && asked.device.is_finite();
                    if is_odd && log.not_finite_at.is_none() {
                        log.not_finite_at = Some(log.steps);
                    }
                    let Answer { force, proxy, .. } = answer;
                    self.last = [force, proxy];
                }
            }
            Err(failure) => {
                log.broken.get_or_insert(failure);
                self.source = None;
                self.last = [DVec3::NAN; 2];
            }
        }
        self.last
    }
}

/// A file of what is asked that cannot be written.
fn unwritten(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::write_at(Chosen::EXPORT, path, error)
}

/// The full mesh of a model and what a ball meets on it.
fn scene_of(model: &[u8], plan: &ScenePlan, setup: &Setup) -> Result<BallScene, Failure> {
    let damaged = |error: spm::FileError| Failure::Run(format!("a case's model: {error}"));
    let file = SpmFile::open(model.to_vec()).map_err(damaged)?;
    let model = Model::of_file(String::new(), file).map_err(damaged)?;
    let frame = ModelFrame::new(
        Pose::IDENTITY,
        plan.objects[0].scale,
        &model.file.model_header(),
    );
    let (positions, faces) = model.full_mesh();
    let mut scene = BallScene {
        positions: positions.iter().map(|&p| frame.to_world(p)).collect(),
        faces,
        radius_m: setup.radius_m,
        stiffness_n_per_m: setup.stiffness_n_per_m,
        damping_ns_per_m: setup.damping_ns_per_m,
        friction: [0.0; 2],
        shaded_turn: 0.0,
    };
    for listed in plan.objects[0].effects.iter().chain(&plan.effects) {
        match &listed.effect {
            Effect::Friction(friction) => scene.friction = [friction.static_, friction.dynamic],
            Effect::Shading(shading) => scene.shaded_turn = shading.max_turn,
            other => {
                let name = other.name();
                return Err(Failure::Run(format!(
                    "no peer is asked for the effect {name}"
                )));
            }
        }
    }
    if setup.probes != 1 || setup.length_m.is_some() {
        return Err(Failure::Run("a peer is asked for one ball".to_string()));
    }
    Ok(scene)
}
