//! A controller that touches one mesh, in virtual time, and the work that is done on the device.

use super::contender::Asking;
use super::setup::Setup;
use crate::failure::Failure;
use geometry::Pose;
use glam::{DQuat, DVec3};
use haptic_device::Sample;
use hrtc_core::bodies::Body;
use hrtc_core::contact::query::Surface;
use hrtc_core::record::CoreRecord;
use hrtc_core::{Controller, ControllerOptions, NoObserver, WrenchLimits};
use protocol::Request;
use scene::{ProbeShape, ScenePlan};
use simulator::{Client, InputRecording, Playback, STATION, Simulation};
use spm::{ActiveMesh, SpmFile, SpmParts, write_spm};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use station_core::station::{ServedModel, ServedObject, Station};

/// Quiet seconds after which a front at rest is complete: the soft start is over then, too.
const QUIET_S: f64 = 0.21;
/// Seconds after which one that does not come to rest is given up.
const MAX_S: f64 = 20.0;
/// Acceleration of a probe that goes to where the next pass begins, m/s²: below what a hand may do
/// to a device.
const TRAVEL_M_PER_S2: f64 = 1500.0;

/// Speed at which a probe is laid on a surface, m/s; below 1 kHz no farther a tick than there,
/// since what the hold takes on that way is not paid for.
const PRESS_M_PER_S: f64 = 0.05;

/// What a tick gave. A sample that was rejected though nobody expects it leaves no numbers.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// Force on the device, newtons.
    pub force: DVec3,
    /// Torque on it, N m.
    pub torque: DVec3,
    /// Where the proxy is, world, metres.
    pub proxy: DVec3,
    /// The core's own record.
    pub record: CoreRecord,
}

/// Share of stiffness times depth with which a probe in contact is pushed at the least, where all
/// of it is paid for: a tool that turns away from what it touches has less than a ball.
const PUSHED_SHARE: f64 = 0.1;

impl Response {
    /// Whether it pushes, by about what is due: where nothing does, no change of force is seen.
    #[must_use]
    pub fn pushes(&self, setup: &Setup) -> bool {
        let due = setup.stiffness_n_per_m * self.record.depth_m;
        due > 0.0 && self.force.length() >= PUSHED_SHARE * due
    }
}

/// The bytes of the SPM file of a mesh; `whole`: the base mesh is the full mesh.
///
/// # Errors
/// One sentence when nothing can be built from it.
pub fn model(mesh: SoupMesh, whole: bool) -> Result<Vec<u8>, Failure> {
    spm(&parts(mesh, whole)?)
}

/// The parts of that file.
///
/// # Errors
/// One sentence when nothing can be built from it.
pub fn parts(mesh: SoupMesh, whole: bool) -> Result<SpmParts, Failure> {
    let options = BuildOptions {
        base_faces: whole.then_some(u32::MAX),
        ..BuildOptions::default()
    };
    build_model(mesh, &options, &NoProgress).map_err(failed)
}

/// Its bytes.
///
/// # Errors
/// One sentence when they are no model.
pub fn spm(parts: &SpmParts) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    write_spm(parts, &mut bytes).map_err(failed)?;
    Ok(bytes)
}

fn failed(error: impl std::fmt::Display) -> Failure {
    Failure::Run(format!("a case's mesh: {error}"))
}

/// See the module.
#[derive(Debug)]
pub struct Bench {
    simulation: Simulation<Vec<u8>>,
    setup: Setup,
    plan: ScenePlan,
    bytes: Vec<u8>,
    /// Stations so far.
    stations: u64,
    /// How the probe is held.
    orientation: DQuat,
    /// Where the device was in the last tick, and the wrench since.
    at: Option<Pose>,
    /// Its displacement in the last tick, metres.
    motion: DVec3,
    wrench: [DVec3; 2],
    /// Work of the wrenches on the device, joules.
    work_j: f64,
    rejected: u64,
    expects_rejection: bool,
    contender: Option<Asking>,
}

impl Bench {
    /// With the model there.
    ///
    /// # Errors
    /// One sentence when the model cannot be served.
    pub fn new(model: &[u8], setup: Setup) -> Result<Self, Failure> {
        Self::of(model, setup, None)
    }

    /// The same with a tool.
    ///
    /// # Errors
    /// One sentence when the model cannot be served.
    pub fn with_tool(model: &[u8], setup: Setup, tool: ProbeShape) -> Result<Self, Failure> {
        Self::of(model, setup, Some(tool))
    }

    fn of(model: &[u8], setup: Setup, tool: Option<ProbeShape>) -> Result<Self, Failure> {
        let plan = setup.plan(tool)?;
        let station = station(&plan, model, STATION)?;
        let contender = setup.contender.map(|of| of.start(model, &plan, &setup));
        let mut client = Client::new(&plan, setup.client_options());
        for probe in 0..setup.probes {
            let limits = setup.motion_limits();
            client.controller_mut().set_motion_limits(probe, limits);
        }
        Ok(Self {
            simulation: Simulation::new(station, client),
            setup,
            plan,
            bytes: model.to_vec(),
            stations: 1,
            orientation: DQuat::IDENTITY,
            at: None,
            motion: DVec3::ZERO,
            wrench: [DVec3::ZERO; 2],
            work_j: 0.0,
            rejected: 0,
            expects_rejection: false,
            contender: contender.transpose()?,
        })
    }

    /// What it is made of.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The scene.
    #[must_use]
    pub fn plan(&self) -> &ScenePlan {
        &self.plan
    }

    /// Seconds a tick.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.setup.rate_hz
    }

    /// Largest change of the force in a tick, newtons.
    #[must_use]
    pub fn slew_n(&self) -> f64 {
        self.plan.safety.slew_n_per_s * self.period_s()
    }

    /// Energy that the wrenches have put into the device so far, joules: force times motion and
    /// torque times rotation, period by period. The product's own account has no part in it.
    #[must_use]
    pub fn work_j(&self) -> f64 {
        self.work_j
    }

    /// Rests at a place until the front around it is complete.
    ///
    /// # Errors
    /// One sentence when it does not come to rest.
    pub fn settle(&mut self, place: DVec3) -> Result<Response, Failure> {
        let (mut faces, mut quiet) = (0, 0.0);
        let most = (MAX_S * self.setup.rate_hz) as u32;
        self.travel(place);
        for _ in 0..most {
            let response = self.touch(place);
            let record = &response.record;
            let same = record.ready && record.active_faces == faces && record.geomorphing == 0;
            quiet = if same { quiet + self.period_s() } else { 0.0 };
            faces = response.record.active_faces;
            if quiet > QUIET_S {
                return Ok(response);
            }
        }
        Err(Failure::Run(
            "a case's mesh does not come to rest under the probe".to_string(),
        ))
    }

    /// Brakes, and goes to a place as fast as a hand could, from rest to rest. The answer to the
    /// last tick: the second one at the place.
    pub fn travel(&mut self, place: DVec3) -> Response {
        let most = TRAVEL_M_PER_S2 * self.period_s() * self.period_s();
        let mut from = self.at.map_or(place, |at| at.position);
        while self.motion.length() > most {
            from += self.motion * (1.0 - most / self.motion.length());
            self.touch(from);
        }
        self.touch(from);
        // Of a cubic in time the acceleration is at most 6 ways over the squared time.
        let seconds = (6.0 * from.distance(place) / TRAVEL_M_PER_S2).sqrt();
        let ticks = (seconds / self.period_s()).ceil();
        for tick in 1..=ticks as u32 {
            let share = f64::from(tick) / ticks;
            let way = share * share * (3.0 - 2.0 * share);
            self.touch(from.lerp(place, way));
        }
        // The next motion begins from rest.
        self.touch(place)
    }

    /// Goes to a place within a surface, from outside of it, where `out` leads: the last way slowly
    /// and evenly, as a hand that lays the probe there.
    pub fn press(&mut self, place: DVec3, out: DVec3) {
        let above = place + out * (2.2 * self.setup.radius_m);
        self.travel(above);
        let step = PRESS_M_PER_S * self.period_s() * self.setup.stiffer().min(1.0);
        let ticks = (above.distance(place) / step).ceil();
        for tick in 1..=ticks as u32 {
            self.touch(above.lerp(place, f64::from(tick) / ticks));
        }
    }

    /// Holds the probe so from now on.
    pub fn turn(&mut self, orientation: DQuat) {
        self.orientation = orientation;
    }

    /// A tick with the device there, world, metres.
    pub fn touch(&mut self, place: DVec3) -> Response {
        self.sample(Some(Pose {
            position: place,
            orientation: self.orientation,
        }))
    }

    /// A tick with any sample.
    pub fn sample(&mut self, pose: Option<Pose>) -> Response {
        self.sample_each(&[pose])
    }

    /// A tick with a sample of each probe; the answer to the first one.
    pub fn sample_each(&mut self, poses: &[Option<Pose>]) -> Response {
        let samples: Vec<Option<Sample>> = poses.iter().map(|pose| pose.map(Sample::at)).collect();
        self.add_work(poses.first().copied().flatten());
        let outputs = self.simulation.step_each(&samples);
        let (wrench, record) = (outputs.wrenches[0], outputs.record);
        self.wrench = [wrench.force, wrench.torque];
        self.rejected += u64::from(record.rejected_sample);
        let is_odd = record.rejected_sample && !self.expects_rejection;
        let known = if is_odd { f64::NAN } else { 1.0 };
        let response = Response {
            force: wrench.force * known,
            torque: wrench.torque * known,
            proxy: self.simulation.controller().proxy().unwrap_or(DVec3::ZERO) * known,
            record,
        };
        self.contended(response, poses.first().copied().flatten())
    }

    /// The response with a peer's force and proxy, where one is asked.
    fn contended(&mut self, response: Response, pose: Option<Pose>) -> Response {
        let object = self.pose();
        let Some(asking) = &mut self.contender else {
            return response;
        };
        let [force, proxy] = asking.step(object, pose.map(|pose| pose.position));
        if !asking.is_peer() {
            return response;
        }
        self.wrench = [force, DVec3::ZERO];
        Response {
            force,
            torque: DVec3::ZERO,
            proxy,
            record: response.record,
        }
    }

    /// The work of the last wrench over the motion to here.
    fn add_work(&mut self, pose: Option<Pose>) {
        let Some(pose) = pose.filter(Pose::is_finite) else {
            return;
        };
        if let Some(at) = self.at.replace(pose) {
            self.motion = pose.position - at.position;
            let turn = pose.orientation * at.orientation.inverse();
            let turned = if turn.w < 0.0 { -turn } else { turn }.to_scaled_axis();
            let [force, torque] = self.wrench;
            self.work_j += force.dot(self.motion) + torque.dot(turned);
        }
    }

    /// Samples may be rejected from now on; how many were.
    pub fn expect_rejections(&mut self) -> u64 {
        self.expects_rejection = true;
        self.rejected
    }

    /// Samples rejected so far.
    #[must_use]
    pub fn rejected(&self) -> u64 {
        self.rejected
    }

    /// Misses so many periods: the device goes on under the force that it has.
    pub fn miss(&mut self, periods: u64) {
        self.simulation.skip(periods);
    }

    /// The controller.
    #[must_use]
    pub fn controller(&self) -> &Controller {
        self.simulation.controller()
    }

    /// What holds the probe after the last tick, model units.
    #[must_use]
    pub fn contact(&self) -> Option<DVec3> {
        let contact = self.simulation.outputs().contact();
        contact.map(|contact| contact.point)
    }

    /// A place of the world in model units, once the model is there.
    #[must_use]
    pub fn to_model(&self, world: DVec3) -> Option<DVec3> {
        Some(self.controller().frame()?.to_model(world))
    }

    /// The pose of a tool's proxy, model frame and units.
    #[must_use]
    pub fn tool_proxy(&self) -> Option<Pose> {
        let object = self.controller().active_objects().first()?;
        Some(object.tool(0)?.pose())
    }

    /// What moves.
    #[must_use]
    pub fn body(&self) -> Option<&Body> {
        self.controller().movables().body(0)
    }

    /// The object's pose in the last tick.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.body().map_or(self.setup.pose, Body::pose)
    }

    /// Whether nothing moves any more.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        self.simulation.outputs().record.moving == 0
    }

    /// Asks for another expected error at the contact, metres.
    pub fn ask(&mut self, tolerance_m: f64) {
        self.simulation.controller_mut().set_tolerance(tolerance_m);
    }

    /// The mesh that the probe touches, model units.
    #[must_use]
    pub fn mesh(&self) -> &ActiveMesh {
        self.controller().cache().mesh()
    }

    /// The same with its tree.
    #[must_use]
    pub fn surface(&self) -> Surface<'_> {
        let cache = self.controller().cache();
        Surface {
            mesh: cache.mesh(),
            tree: cache.tree(),
        }
    }

    /// Silences the station, or lets it speak again.
    pub fn mute(&mut self, mute: bool) {
        self.simulation.mute_station(mute);
    }

    /// The station is killed.
    pub fn kill_station(&mut self) {
        self.simulation.stop_station();
    }

    /// Another station takes the place of the one that was killed.
    ///
    /// # Errors
    /// One sentence when the model cannot be served.
    pub fn restart_station(&mut self) -> Result<(), Failure> {
        let incarnation = STATION + self.stations;
        self.stations += 1;
        let station = station(&self.plan, &self.bytes, incarnation)?;
        self.simulation.start_station(station);
        Ok(())
    }

    /// How often effects were called so far.
    #[must_use]
    pub fn effect_calls(&self) -> u64 {
        let usage = self.controller().effects();
        usage.iter().map(|kind| kind.calls).sum()
    }

    /// Hash over every tick's outputs so far.
    #[must_use]
    pub fn hash(&self) -> u64 {
        self.controller().replay_hash()
    }

    /// Records the inputs of every tick from now on, before the first.
    pub fn record(&mut self) {
        self.simulation.client_mut().record();
    }

    /// The recording.
    pub fn take_recording(&mut self) -> InputRecording {
        let recording = self.simulation.client_mut().take_recording();
        recording.unwrap_or_default()
    }

    /// Plays a recording through a controller that has seen nothing yet: for each tick whether it
    /// gave the recorded bits.
    #[must_use]
    pub fn replay(&self, recording: &InputRecording) -> Vec<bool> {
        let options = self.setup.client_options();
        let of_devices = ControllerOptions {
            limits: &[WrenchLimits::of_force(options.device_max_n)],
            tour_seconds: options.tour_s,
        };
        let mut controller = Controller::new(&self.plan, options.identity, of_devices);
        for probe in 0..self.setup.probes {
            controller.set_motion_limits(probe, self.setup.motion_limits());
        }
        if options.station_is_far {
            controller.station_is_far();
        }
        let mut playback = Playback::new(recording, controller);
        let mut same = Vec::with_capacity(recording.len());
        while let Some(is_same) = playback.step(&mut NoObserver) {
            same.push(is_same);
        }
        same
    }
}

/// A station that serves a model to a scene of one object.
fn station(plan: &ScenePlan, bytes: &[u8], incarnation: u64) -> Result<Station<Vec<u8>>, Failure> {
    let damaged = |error| Failure::Run(format!("a case's model: {error}"));
    let name = plan.objects[0].model.name();
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(&name),
    };
    let file = SpmFile::open(bytes.to_vec()).map_err(damaged)?;
    let served = ServedModel { name, file };
    Ok(Station::new(incarnation, vec![served], vec![object]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_contact_without_a_force_does_not_push() {
        let setup = Setup::default();
        let of = |force_n: f64, depth_m: f64| Response {
            force: DVec3::Z * force_n,
            torque: DVec3::ZERO,
            proxy: DVec3::ZERO,
            record: CoreRecord {
                depth_m,
                ..CoreRecord::default()
            },
        };
        assert!(of(1.0, 1e-3).pushes(&setup) && of(0.3, 1e-3).pushes(&setup));
        for (force_n, depth_m) in [
            (0.0, 1e-3),
            (0.05, 1e-3),
            (0.0, 0.0),
            (f64::NAN, 1e-3),
            (1.0, f64::NAN),
        ] {
            assert!(!of(force_n, depth_m).pushes(&setup), "{force_n} {depth_m}");
        }
    }
}
