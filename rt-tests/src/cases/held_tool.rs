//! A tool in a simulated hand: the product's controller, its model at a station, and a rigid body
//! in six degrees of freedom, in virtual time. The loop is closed in translation and rotation.

use super::bench::model;
use super::setup::Setup;
use crate::failure::Failure;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use haptic_device::{Intent, MotionLimits};
use hrtc_core::record::CoreRecord;
use protocol::Request;
use scene::{NoFiles, Overrides, ProbeShape, ScenePlan, ToolMeshPlan, TrajectoryPlan, parse};
use simulated_device::DeviceState;
use simulator::{Client, STATION, Simulation};
use spm::SpmFile;
use spm_builder::SoupMesh;
use station_core::station::{ServedModel, ServedObject, Station};
use std::path::Path;

/// Ticks after which a model that does not arrive is given up.
const MAX_TICKS: u32 = 20_000;

/// A scene of one object, a mesh in millimetres, and of a tool whose device has the keys `device`
/// of a scene beside its defaults. All else is the product's default, but for the surface.
///
/// # Errors
/// One sentence when the scene is refused.
pub fn plan(tool: &ProbeShape, surface: [f64; 2], device: &str) -> Result<ScenePlan, Failure> {
    let [stiffness, damping] = surface;
    let text = format!(
        "[[object]]\nmodel = \"case.spm\"\nmetres_per_unit = 0.001\n\
         surface = {{ stiffness_n_per_m = {stiffness:?}, damping_ns_per_m = {damping:?} }}\n\
         [[probe]]\ndevice = {{ simulated = {{ {device} }} }}\n"
    );
    let none = Overrides::default();
    let mut plan = parse(&text, "a case", Path::new(""), &none, &NoFiles)?;
    plan.probes[0].shape = tool.clone();
    plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
    Ok(plan)
}

/// A station that serves the only object of a plan.
///
/// # Errors
/// One sentence when the mesh cannot be served.
pub fn station(plan: &ScenePlan, mesh: SoupMesh) -> Result<Station<Vec<u8>>, Failure> {
    let damaged = |error| Failure::Run(format!("a case's model: {error}"));
    let name = plan.objects[0].model.name();
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(&name),
    };
    let file = SpmFile::open(model(mesh, false)?).map_err(damaged)?;
    Ok(Station::new(
        STATION,
        vec![ServedModel { name, file }],
        vec![object],
    ))
}

/// A box around the device's position; `half`: half of its sides, metres.
#[must_use]
pub fn box_tool(half: DVec3) -> ProbeShape {
    let corner = |k: u32| {
        let side = |axis: u32| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
        half * DVec3::new(side(0), side(1), side(2))
    };
    // Corners of each side, counterclockwise from outside.
    let sides = [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6],
    ];
    ProbeShape::Mesh(ToolMeshPlan {
        file: "box".to_string(),
        positions: (0..8).map(corner).collect(),
        triangles: sides
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
            .collect(),
    })
}

/// Rotation vector from an orientation to another, by the shorter way, radians.
#[must_use]
pub fn rotation(from: DQuat, to: DQuat) -> DVec3 {
    let turn = to * from.conjugate();
    (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis()
}

/// See the module.
#[derive(Debug)]
pub struct HeldTool {
    simulation: Simulation<Vec<u8>>,
    period_s: f64,
    led_to: Pose,
}

impl HeldTool {
    /// At a pose in free space, with the model there, over the link of a setup.
    ///
    /// # Errors
    /// One sentence when the mesh cannot be served, or does not arrive.
    pub fn new(
        plan: &ScenePlan,
        setup: &Setup,
        mesh: SoupMesh,
        begin: Pose,
    ) -> Result<Self, Failure> {
        let station = station(plan, mesh)?;
        let mut client = Client::new(plan, setup.client_options());
        let controller = client.controller_mut();
        controller.set_motion_limits(0, MotionLimits::HAND);
        let mut held = Self {
            simulation: Simulation::new(station, client),
            period_s: 1.0 / plan.loop_.rate_hz,
            led_to: begin,
        };
        for _ in 0..MAX_TICKS {
            held.lead(begin);
            if held.record().ready {
                return Ok(held);
            }
        }
        Err(Failure::Run("a case's mesh does not arrive".to_string()))
    }

    /// A tick in which the hand goes on to a pose, evenly. The wrench that the device renders next.
    pub fn lead(&mut self, pose: Pose) -> Wrench {
        let before = std::mem::replace(&mut self.led_to, pose);
        let turned = rotation(before.orientation, pose.orientation);
        let intent = Intent {
            pose,
            velocity: (pose.position - before.position) / self.period_s,
            angular_velocity: turned / self.period_s,
        };
        self.simulation.client_mut().hand(0).lead_to(intent);
        self.simulation.step_led().wrenches[0]
    }

    /// True state of the device at the last sample.
    pub fn device(&mut self) -> DeviceState {
        self.simulation.client_mut().hand(0).state()
    }

    /// The core's record of the last tick.
    #[must_use]
    pub fn record(&self) -> CoreRecord {
        self.simulation.outputs().record
    }

    /// Seconds a tick.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }
}
