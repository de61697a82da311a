//! The reference of a measurement: device poses in a closed loop on the full mesh, and the forces.

use super::scene_model::SceneModel;
use super::virtual_scene::{MAX_START_TICKS, make_ready};
use crate::failure::Failure;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::record::max_or_nan;
use simulator::{Hand, Simulation};

/// Quiet ticks after which a front that is at rest is taken to be complete.
const QUIET_TICKS: u64 = 300;

/// What the reference gave in a tick.
#[derive(Debug, Clone, Copy)]
pub struct ReferenceTick {
    /// Force on the device, N.
    pub force: DVec3,
    /// Contact point, model units.
    pub contact: Option<DVec3>,
}

/// The trajectory: device poses recorded in a closed loop on the full mesh, and its answers.
#[derive(Debug)]
pub struct Reference {
    /// The pose before the first, at rest.
    pub rest: Sample,
    /// Poses.
    pub samples: Vec<Sample>,
    /// Force and contact, one for each pose.
    pub ticks: Vec<ReferenceTick>,
}

impl Reference {
    /// Runs the tour in a closed loop on the mesh that was never simplified.
    ///
    /// # Errors
    /// One sentence when there is no touch to measure, or the model cannot be served.
    pub fn record(model: &SceneModel, seed: u64, seconds: f64) -> Result<Self, Failure> {
        let mut simulation = model.reference()?;
        let period = 1.0 / model.plan.loop_.rate_hz;
        let tour = model.tour(seed, seconds)?;
        let mut hand = Hand::new(model.plan.probes[0].device, period).along_tour(tour);
        let ready = make_ready(&mut simulation)?;
        let no_tour = || Failure::Run(format!("the tour of {} has no point", model.mesh.name));
        let frame = simulation.controller().frame().ok_or_else(no_tour)?;
        let rest = hand.start(&frame).ok_or_else(no_tour)?;
        come_to_rest(&mut simulation, rest, ready)?;
        let ticks = (seconds / period).round() as u64;
        let (mut samples, mut answers) = (Vec::new(), Vec::new());
        for tick in 0..ticks {
            let sample = hand.sample(tick, &frame).ok_or_else(no_tour)?;
            let outputs = simulation.step(Some(sample));
            samples.push(sample);
            answers.push(ReferenceTick {
                force: outputs.wrenches[0].force,
                contact: outputs.contact().map(|contact| contact.point),
            });
            hand.feel(outputs.wrenches[0]);
        }
        if !answers.iter().any(|tick| tick.contact.is_some()) {
            return Err(Failure::Input(format!(
                "the tour of {} touches nothing in {seconds} s: give more with --seconds",
                model.mesh.name
            )));
        }
        Ok(Self {
            rest,
            samples,
            ticks: answers,
        })
    }

    /// The greatest force, N.
    #[must_use]
    pub fn force_max(&self) -> f64 {
        let forces = self.ticks.iter().map(|tick| tick.force.length());
        forces.fold(0.0, max_or_nan)
    }
}

/// Ticks with the device at rest until nothing comes and nothing changes any more; the tick of the
/// last change.
///
/// # Errors
/// When it does not come to rest.
pub fn come_to_rest<D: AsRef<[u8]>>(
    simulation: &mut Simulation<D>,
    rest: Sample,
    ready: u64,
) -> Result<u64, Failure> {
    let (mut last_change, mut last_bytes) = (ready, 0);
    while simulation.tick() < last_change + QUIET_TICKS {
        let record = simulation.step(Some(rest)).record;
        if record.vsplits + record.ecols > 0 || record.bytes_received != last_bytes {
            last_bytes = record.bytes_received;
            last_change = simulation.tick();
        }
        if simulation.tick() > MAX_START_TICKS {
            return Err(Failure::Run("the front does not come to rest".to_string()));
        }
    }
    Ok(last_change)
}
