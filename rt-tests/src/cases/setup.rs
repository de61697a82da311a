//! What a case runs with: the product's defaults, but for what the case says.

use super::contender::Contender;
use crate::failure::Failure;
use crate::scenes::BUNDLED_SCENE;
use geometry::Pose;
use glam::{DQuat, DVec3};
use haptic_device::MotionLimits;
use scene::{
    ModelScale, MovablePlan, NoFiles, Overrides, ProbeShape, ScenePlan, TrajectoryPlan, parse,
};
use simulator::{ClientOptions, LinkModel};
use std::path::Path;

/// No limit on a force, newtons: what the rendering itself wants is looked at.
const UNLIMITED_N: f64 = 1e12;
/// Faces of a tool.
const TOOL_FACES: u32 = 240;
/// A link that loses one message of fifty, lets one of fifty overtake, and delays by 20 to 40 ms.
const LOSSY: LinkModel = LinkModel {
    delay_ticks: 20,
    jitter_ticks: 20,
    loss: 0.02,
    duplicates: 0.02,
    reordering: 0.02,
    damage: 0.0,
    bytes_per_tick: f64::INFINITY,
    batch_bytes: 0,
    is_compact: false,
};

/// A setting in which a case departs from the product.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Departure {
    /// The energy account does not limit the force.
    Account,
    /// Splits and collapses under the probe happen at once.
    Geomorph,
    /// Neither force nor slew is limited.
    Limits,
    /// Every sample is taken for a motion.
    Motion,
    /// A cache of 2 MiB.
    SmallCache,
    /// A link that delays, loses and reorders.
    LossyLink,
    /// One split or collapse in a tick.
    OneOperation,
}

impl Departure {
    /// As a scene or a device would say it.
    #[must_use]
    pub fn setting(self) -> &'static str {
        match self {
            Self::Account => "passivity = false",
            Self::Geomorph => "geomorph = false",
            Self::Limits => "no limit of force and slew",
            Self::Motion => "no limit of motion",
            Self::SmallCache => "cache = 2MiB",
            Self::LossyLink => "20 to 40 ms, 2 % lost",
            Self::OneOperation => "operations = 1",
        }
    }
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
    /// Damping of its surface, N s/m.
    pub damping_ns_per_m: f64,
    /// Rate of the loop, 1/s.
    pub rate_hz: f64,
    /// Step of the device's encoder, metres; 0 for none.
    pub encoder_m: f64,
    /// Pose of the object.
    pub pose: Pose,
    /// Effects of the scene and of its object, as a scene lists them.
    pub effects: &'static str,
    /// Probes.
    pub probes: usize,
    /// How the object moves, if it does.
    pub movable: Option<MovablePlan>,
    /// Length of the probe, metres: with one it is a tool, a capsule of that radius along z.
    pub length_m: Option<f64>,
    /// Where it departs from the product.
    pub departs: &'static [(Departure, &'static str)],
    /// Whose force and proxy take the place of the product's, or who writes down what is asked.
    pub contender: Option<&'static Contender>,
}

impl Default for Setup {
    fn default() -> Self {
        Self::PRODUCT
    }
}

impl Setup {
    /// The product, with what the cases name: 1 kHz, 1 kN/m without damping, a ball of 1 mm on an
    /// object of 0.2 m.
    pub const PRODUCT: Self = Self {
        radius_m: 1e-3,
        size_m: 0.2,
        stiffness_n_per_m: 1000.0,
        damping_ns_per_m: 0.0,
        rate_hz: 1000.0,
        encoder_m: 0.0,
        pose: Pose {
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
        },
        effects: "",
        probes: 1,
        movable: None,
        length_m: None,
        departs: &[],
        contender: None,
    };

    /// Whether it departs from the product in a setting.
    #[must_use]
    pub fn departs_in(&self, setting: Departure) -> bool {
        self.departs.iter().any(|&(of, _)| of == setting)
    }

    /// A tool in place of the ball: a capsule ten radii long.
    #[must_use]
    pub fn with_tool(self) -> Self {
        let length_m = Some(10.0 * self.radius_m);
        Self { length_m, ..self }
    }

    /// Limits of the device's motion.
    pub(super) fn motion_limits(&self) -> MotionLimits {
        if self.departs_in(Departure::Motion) {
            MotionLimits::UNLIMITED
        } else {
            MotionLimits::HAND
        }
    }

    /// The controller's side of the link.
    pub(super) fn client_options(&self) -> ClientOptions {
        let mut options = ClientOptions::default();
        if self.departs_in(Departure::Limits) {
            options.device_max_n = UNLIMITED_N;
        }
        if self.departs_in(Departure::LossyLink) {
            options.link = LOSSY;
            options.station_is_far = true;
        }
        options
    }

    /// The scene.
    pub(super) fn plan(&self, tool: Option<ProbeShape>) -> Result<ScenePlan, Failure> {
        let scene = format!("effects = [{}]\n{BUNDLED_SCENE}", self.effects);
        let mut plan = parse(
            &scene,
            "stability",
            Path::new(""),
            &Overrides::default(),
            &NoFiles,
        )?;
        plan.loop_.rate_hz = self.rate_hz;
        if self.departs_in(Departure::SmallCache) {
            plan.cache_bytes = 2 << 20;
        }
        if self.departs_in(Departure::OneOperation) {
            plan.loop_.operations = 1;
        }
        let object = &mut plan.objects[0];
        object.scale = ModelScale::Size(self.size_m);
        object.pose = self.pose;
        object.movable = self.movable;
        object.surface.stiffness_n_per_m = self.stiffness_n_per_m;
        object.surface.damping_ns_per_m = self.damping_ns_per_m;
        let radius_m = self.radius_m;
        let of_setup = match self.length_m {
            None => ProbeShape::Sphere { radius_m },
            Some(length_m) => ProbeShape::Capsule {
                radius_m,
                length_m,
                faces: TOOL_FACES,
            },
        };
        let probe = &mut plan.probes[0];
        probe.shape = tool.unwrap_or(of_setup);
        probe.device.encoder_m = self.encoder_m;
        probe.trajectory = TrajectoryPlan::Points(Vec::new());
        if self.departs_in(Departure::Limits) {
            plan.safety.force_max_n = UNLIMITED_N;
            plan.safety.torque_max_nm = UNLIMITED_N;
            plan.safety.slew_n_per_s = UNLIMITED_N * self.rate_hz;
        }
        plan.accuracy.geomorph = !self.departs_in(Departure::Geomorph);
        plan.safety.passivity = !self.departs_in(Departure::Account);
        let probe = plan.probes[0].clone();
        plan.probes.resize(self.probes, probe);
        Ok(plan)
    }
}
