//! A controller that touches one mesh, in virtual time, and the faults that are put in on purpose.

use crate::failure::Failure;
use crate::scenes::BUNDLED_SCENE;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use haptic_device::{Device, Intent, Sample, TickTime, WrenchCommand};
use hrtc_core::bodies::Body;
use hrtc_core::record::CoreRecord;
use protocol::Request;
use scene::{
    HandImpedance, ModelScale, MovablePlan, NoFiles, Overrides, ProbeShape, ScenePlan,
    SimulatedDevicePlan, TrajectoryPlan, parse,
};
use simulated_device::SimulatedDevice;
use simulator::{Client, ClientOptions, STATION, Simulation};
use spm::{ActiveMesh, SpmFile, SpmParts, write_spm};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use station_core::station::{ServedModel, ServedObject, Station};
use std::path::Path;

/// Quiet ticks after which a front at rest is complete.
const QUIET_TICKS: u32 = 200;
/// Ticks after which one that does not come to rest is given up.
const MAX_TICKS: u32 = 20_000;
/// No limit on a force, newtons: what the rendering itself wants is looked at.
const UNLIMITED_N: f64 = 1e12;

/// Faces of a tool.
const TOOL_FACES: u32 = 240;

/// A fault put in on purpose: a case that passes all the same shows nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// None.
    None,
    /// Every force comes a tick late.
    LateTick,
    /// The force points the other way.
    Sign,
    /// A contact less deep than a tenth of a millimetre is taken for none.
    AbsoluteEpsilon,
    /// A constraint is lost: of a mesh its faces around the place of contact, of a set of planes
    /// one.
    LostConstraint,
    /// Force and slew are not limited.
    NoForceLimit,
    /// The energy account does not limit the force.
    NoPassivity,
    /// Nothing brings a body to rest.
    Restless,
    /// Splits and collapses under the probe happen at once.
    NoGeomorph,
}

/// What a bench is made of.
#[derive(Debug, Clone, Copy)]
pub struct Setup {
    /// Radius of the probe, metres.
    pub radius_m: f64,
    /// Longest side of the object, metres.
    pub size_m: f64,
    /// Stiffness of its surface, N/m.
    pub stiffness_n_per_m: f64,
    /// Rate of the loop, 1/s.
    pub rate_hz: f64,
    /// Step of the device's encoder, metres; 0 for none.
    pub encoder_m: f64,
    /// Pose of the object.
    pub pose: Pose,
    /// Limits of the force in newtons and its change in newtons a second; `None` for neither.
    pub force_limits: Option<[f64; 2]>,
    /// Whether the energy account limits the force: for devices that move by it, not for places
    /// that are given.
    pub passivity: bool,
    /// Effects of the scene and of its object, as a scene lists them.
    pub effects: &'static str,
    /// Probes.
    pub probes: usize,
    /// How the object moves, if it does.
    pub movable: Option<MovablePlan>,
    /// Length of the probe, metres: with one it is a tool, a capsule of that radius along z.
    pub length_m: Option<f64>,
    /// Whether splits and collapses under the probe are geomorphed.
    pub geomorph: bool,
    /// The fault.
    pub fault: Fault,
}

impl Setup {
    /// The device and loop that the cases name, with a fault.
    #[must_use]
    pub fn with(fault: Fault) -> Self {
        Self {
            fault,
            ..Self::default()
        }
    }
}

impl Default for Setup {
    /// The device and loop that the cases name: 1 kHz, 1 kN/m, a ball of 1 mm on an object of 0.2
    /// m.
    fn default() -> Self {
        Self {
            radius_m: 1e-3,
            size_m: 0.2,
            stiffness_n_per_m: 1000.0,
            rate_hz: 1000.0,
            encoder_m: 0.0,
            pose: Pose::at(DVec3::ZERO),
            force_limits: None,
            passivity: false,
            effects: "",
            probes: 1,
            movable: None,
            length_m: None,
            geomorph: false,
            fault: Fault::None,
        }
    }
}

/// What a tick gave.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// Force on the device, newtons.
    pub force: DVec3,
    /// Where the proxy is, world, metres.
    pub proxy: DVec3,
    /// The core's own record.
    pub record: CoreRecord,
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
    /// The force of the tick before.
    before: DVec3,
    /// How the probe is held.
    orientation: DQuat,
}

impl Bench {
    /// With the model there.
    ///
    /// # Errors
    /// One sentence when the model cannot be served.
    pub fn new(model: &[u8], setup: Setup) -> Result<Self, Failure> {
        let plan = plan(&setup)?;
        let damaged = |error| Failure::Run(format!("a case's model: {error}"));
        let name = plan.objects[0].model.name();
        let object = ServedObject {
            model: 0,
            name: Request::name_hash(&name),
        };
        let file = SpmFile::open(model.to_vec()).map_err(damaged)?;
        let served = ServedModel { name, file };
        let station = Station::new(STATION, vec![served], vec![object]);
        let options = ClientOptions {
            device_max_n: UNLIMITED_N,
            ..ClientOptions::default()
        };
        let simulation = Simulation::new(station, Client::new(&plan, options));
        Ok(Self {
            simulation,
            setup,
            before: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
        })
    }

    /// What it is made of.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// Seconds a tick.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        1.0 / self.setup.rate_hz
    }

    /// Rests at a place until the front around it is complete.
    ///
    /// # Errors
    /// One sentence when it does not come to rest.
    pub fn settle(&mut self, place: DVec3) -> Result<Response, Failure> {
        let (mut faces, mut quiet) = (0, 0);
        for _ in 0..MAX_TICKS {
            let response = self.touch(place);
            let record = &response.record;
            let same = record.ready && record.active_faces == faces && record.geomorphing == 0;
            quiet = if same { quiet + 1 } else { 0 };
            faces = response.record.active_faces;
            if quiet > QUIET_TICKS {
                return Ok(response);
            }
        }
        Err(Failure::Run(
            "a case's mesh does not come to rest under the probe".to_string(),
        ))
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
        let outputs = self.simulation.step_each(&samples);
        let (force, record) = (outputs.wrenches[0].force, outputs.record);
        let now = std::mem::replace(&mut self.before, force);
        let dead = self.setup.stiffness_n_per_m * 1e-4;
        let force = match self.setup.fault {
            Fault::LateTick => now,
            Fault::Sign => -force,
            Fault::AbsoluteEpsilon if force.length() < dead => DVec3::ZERO,
            _ => force,
        };
        Response {
            force,
            proxy: self.simulation.controller().proxy().unwrap_or(DVec3::ZERO),
            record,
        }
    }

    /// Misses so many periods: the device goes on under the force that it has.
    pub fn miss(&mut self, periods: u64) {
        self.simulation.skip(periods);
    }

    /// What holds the probe after the last tick, model units.
    #[must_use]
    pub fn contact(&self) -> Option<DVec3> {
        self.simulation
            .outputs()
            .contact()
            .map(|contact| contact.point)
    }

    /// A place of the world in model units, once the model is there.
    #[must_use]
    pub fn to_model(&self, world: DVec3) -> Option<DVec3> {
        let frame = self.simulation.controller().frame()?;
        Some(frame.to_model(world))
    }

    /// What moves.
    #[must_use]
    pub fn body(&self) -> Option<&Body> {
        self.simulation.controller().movables().body(0)
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
        self.simulation.controller().cache().mesh()
    }

    /// Silences the station, or lets it speak again.
    pub fn mute(&mut self, mute: bool) {
        self.simulation.mute_station(mute);
    }

    /// How often effects were called so far.
    #[must_use]
    pub fn effect_calls(&self) -> u64 {
        let usage = self.simulation.controller().effects();
        usage.iter().map(|kind| kind.calls).sum()
    }

    /// Hash over every tick's outputs so far.
    #[must_use]
    pub fn hash(&self) -> u64 {
        self.simulation.controller().replay_hash()
    }
}

fn plan(setup: &Setup) -> Result<ScenePlan, Failure> {
    let scene = format!("effects = [{}]\n{}", setup.effects, BUNDLED_SCENE);
    let mut plan = parse(
        &scene,
        "stability",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )?;
    plan.loop_.rate_hz = setup.rate_hz;
    let object = &mut plan.objects[0];
    object.scale = ModelScale::Size(setup.size_m);
    object.pose = setup.pose;
    object.movable = setup.movable;
    object.surface.stiffness_n_per_m = setup.stiffness_n_per_m;
    object.surface.damping_ns_per_m = 0.0;
    let radius_m = setup.radius_m;
    plan.probes[0].shape = match setup.length_m {
        None => ProbeShape::Sphere { radius_m },
        Some(length_m) => ProbeShape::Capsule {
            radius_m,
            length_m,
            faces: TOOL_FACES,
        },
    };
    plan.probes[0].device.encoder_m = setup.encoder_m;
    plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
    let open = setup.force_limits.is_none() || setup.fault == Fault::NoForceLimit;
    let [force, slew] = setup
        .force_limits
        .filter(|_| !open)
        .unwrap_or([UNLIMITED_N, UNLIMITED_N * setup.rate_hz]);
    plan.safety.force_max_n = force;
    plan.safety.slew_n_per_s = slew;
    plan.safety.ramp_s = 0.0;
    plan.accuracy.geomorph = setup.geomorph && setup.fault != Fault::NoGeomorph;
    plan.safety.passivity = setup.passivity && setup.fault != Fault::NoPassivity;
    let probe = plan.probes[0].clone();
    plan.probes.resize(setup.probes, probe);
    Ok(plan)
}

/// The device that the cases name: 0.1 kg with 1 N s/m, in nobody's hand.
#[derive(Debug)]
pub struct FreeMass {
    device: SimulatedDevice,
}

/// Mass of the device, kg.
pub const MASS_KG: f64 = 0.1;
/// Its damping, N s/m.
pub const DAMPING_NS_PER_M: f64 = 1.0;

impl FreeMass {
    /// At a place with a velocity, in periods of `period_s`; `encoder_m` is the step of its encoder
    /// or 0.
    #[must_use]
    pub fn new(place: DVec3, velocity: DVec3, period_s: f64, encoder_m: f64) -> Self {
        Self::held(place, velocity, period_s, encoder_m, [0.0, 0.0])
    }

    /// Another device, of this mass, kg, and damping, N s/m.
    #[must_use]
    pub fn of(
        [mass_kg, damping_ns_per_m]: [f64; 2],
        place: DVec3,
        velocity: DVec3,
        period_s: f64,
    ) -> Self {
        let plan = SimulatedDevicePlan {
            mass_kg,
            damping_ns_per_m,
            encoder_m: 0.0,
            hand: HandImpedance {
                stiffness_n_per_m: 0.0,
                damping_ns_per_m: 0.0,
            },
            ..SimulatedDevicePlan::default()
        };
        Self::planned(plan, place, velocity, period_s)
    }

    /// Held to `place` by a hand of this stiffness (N/m) and damping (N s/m).
    #[must_use]
    pub fn held(
        place: DVec3,
        velocity: DVec3,
        period_s: f64,
        encoder_m: f64,
        [stiffness_n_per_m, damping_ns_per_m]: [f64; 2],
    ) -> Self {
        let plan = SimulatedDevicePlan {
            mass_kg: MASS_KG,
            damping_ns_per_m: DAMPING_NS_PER_M,
            encoder_m,
            hand: HandImpedance {
                stiffness_n_per_m,
                damping_ns_per_m,
            },
            ..SimulatedDevicePlan::default()
        };
        Self::planned(plan, place, velocity, period_s)
    }

    fn planned(plan: SimulatedDevicePlan, place: DVec3, velocity: DVec3, period_s: f64) -> Self {
        let mut device = SimulatedDevice::new(plan, period_s);
        device.intend(Intent {
            velocity,
            ..Intent::still(Pose::at(place))
        });
        Self { device }
    }

    /// Moves the place that the hand holds it to.
    pub fn intend(&mut self, place: DVec3, velocity: DVec3) {
        self.device.intend(Intent {
            velocity,
            ..Intent::still(Pose::at(place))
        });
    }

    /// Its velocity, m/s.
    #[must_use]
    pub fn velocity(&self) -> DVec3 {
        self.device.state().velocity
    }

    /// A period under the force; what the encoder reads then.
    pub fn advance(&mut self, force: DVec3) -> DVec3 {
        self.device.write(WrenchCommand::unlimited(Wrench {
            force,
            torque: DVec3::ZERO,
        }));
        let sample = self.device.read(TickTime::default());
        sample.map_or(DVec3::ZERO, |sample| sample.pose.position)
    }
}
