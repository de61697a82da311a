//! What a case runs with: the product's defaults, but for what the case says.

use super::contender::Contender;
use crate::failure::Failure;
use crate::scenes::BUNDLED_SCENE;
use geometry::Pose;
use glam::{DQuat, DVec3};
use haptic_device::MotionLimits;
use scene::{
    Effect, EffectPlan, ModelScale, MovablePlan, NoFiles, Overrides, ProbeShape, ScenePlan,
    TrajectoryPlan, parse,
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
    /// Whether every sample is taken for a motion, and no change of force is limited.
    pub any_motion: bool,
    /// Where it departs from the product.
    pub departs: &'static [(Departure, &'static str)],
    /// Where the whole run does, beside the case.
    pub run_departs: &'static [Departure],
    /// Whose force and proxy take the place of the product's, or who writes down what is asked.
    pub contender: Option<&'static Contender>,
}

impl Default for Setup {
    fn default() -> Self {
        Self::PRODUCT
    }
}

impl Setup {
    /// The product at another rate, 1/s. Stiffness goes with the rate and damping stays, so that
    /// what the hold of a period puts out and what the device takes, `(K T / 2 + B) / b`, stay in
    /// proportion.
    #[must_use]
    pub fn at_rate(rate_hz: f64) -> Self {
        Self {
            rate_hz,
            stiffness_n_per_m: Self::PRODUCT.stiffness_n_per_m * rate_hz / Self::PRODUCT.rate_hz,
            ..Self::PRODUCT
        }
    }

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
        any_motion: false,
        departs: &[],
        run_departs: &[],
        contender: None,
    };

    /// Rates of a case that runs at several: all of them at the product's rate, else that of the
    /// run.
    pub(super) fn rates(&self) -> &[f64] {
        if self.rate_hz == Self::PRODUCT.rate_hz {
            &[500.0, 1000.0, 2000.0, 4000.0]
        } else {
            std::slice::from_ref(&self.rate_hz)
        }
    }

    /// The rate over the product's: stiffness goes with it.
    #[must_use]
    pub fn stiffer(&self) -> f64 {
        self.rate_hz / Self::PRODUCT.rate_hz
    }

    /// Time of so many ticks, milliseconds.
    #[must_use]
    pub fn ms(&self, ticks: u64) -> f64 {
        ticks as f64 * (1e3 / self.rate_hz)
    }

    /// The ticks nearest to a time in milliseconds, at least one.
    #[must_use]
    pub fn ticks(&self, ms: u64) -> u64 {
        ((ms as f64 * self.rate_hz / 1e3).round() as u64).max(1)
    }

    /// Share of a displacement between two ticks at 1 kHz that is no larger an acceleration.
    pub(super) fn jump(&self) -> f64 {
        (self.ms(1) * self.ms(1)).min(1.0)
    }

    /// Without limits of motion and slew above 1 kHz: for cases whose device goes so far in a tick
    /// of any length, which is no motion of a hand there.
    #[must_use]
    pub(super) fn with_motions_of_a_tick(self) -> Self {
        Self {
            any_motion: self.rate_hz > Self::PRODUCT.rate_hz,
            ..self
        }
    }

    /// Largest change of a force in a tick that is not felt, newtons: 0.05 N or 7 % of it in a
    /// millisecond.
    pub(super) fn unfelt_n(&self, force_n: f64) -> f64 {
        self.ms(1) * 0.05f64.max(0.07 * force_n)
    }

    /// Gives the effects of the scene and of its object the stiffness that goes with the rate.
    /// Their damping is that of 1 kHz, and less below, where the loop holds less of it.
    fn scale_effects(&self, plan: &mut ScenePlan) {
        let scale = |of: &EffectPlan| EffectPlan {
            effect: self.scaled(&of.effect),
            ..of.clone()
        };
        plan.effects = plan.effects.iter().map(scale).collect();
        for object in &mut plan.objects {
            object.effects = object.effects.iter().map(scale).collect();
        }
    }

    fn scaled(&self, effect: &Effect) -> Effect {
        let (stiffer, damped) = (self.stiffer(), self.stiffer().min(1.0));
        let mut effect = effect.clone();
        match &mut effect {
            Effect::Spring(of) => {
                of.stiffness_n_per_m *= stiffer;
                of.damping_ns_per_m *= damped;
            }
            Effect::Inertia(of) => {
                of.stiffness_n_per_m *= stiffer;
                of.damping_ns_per_m *= damped;
            }
            Effect::Boundary(of) => of.stiffness_n_per_m *= stiffer,
            Effect::Magnet(of) => of.force_n *= stiffer,
            Effect::Viscosity { damping_ns_per_m } => *damping_ns_per_m *= damped,
            Effect::Friction(_)
            | Effect::Shading(_)
            | Effect::Texture(_)
            | Effect::Vibration(_)
            | Effect::Gravity(_) => {}
        }
        effect
    }

    /// Whether it departs from the product in a setting.
    #[must_use]
    pub fn departs_in(&self, setting: Departure) -> bool {
        self.departs.iter().any(|&(of, _)| of == setting) || self.run_departs.contains(&setting)
    }

    /// Bytes of the mesh cache, where the product has so many.
    pub(super) fn cache_bytes(&self, of_product: usize) -> usize {
        if self.departs_in(Departure::SmallCache) {
            2 << 20
        } else {
            of_product
        }
    }

    /// A tool in place of the ball: a capsule ten radii long.
    #[must_use]
    pub fn with_tool(self) -> Self {
        let length_m = Some(10.0 * self.radius_m);
        Self { length_m, ..self }
    }

    /// Limits of the device's motion.
    pub(super) fn motion_limits(&self) -> MotionLimits {
        if self.any_motion || self.departs_in(Departure::Motion) {
            MotionLimits::UNLIMITED
        } else {
            MotionLimits::HAND
        }
    }

    /// The controller's side of the link.
    pub(super) fn client_options(&self) -> ClientOptions {
        let mut options = ClientOptions::default();
        options.link = options.link.at_rate(self.rate_hz);
        if self.departs_in(Departure::Limits) {
            options.device_max_n = UNLIMITED_N;
        }
        if self.departs_in(Departure::LossyLink) {
            options.link = LOSSY.at_rate(self.rate_hz);
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
        plan.loop_ = plan.loop_.at_rate(self.rate_hz);
        self.scale_effects(&mut plan);
        plan.cache_bytes = self.cache_bytes(plan.cache_bytes);
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
        if self.any_motion {
            plan.safety.slew_n_per_s = UNLIMITED_N * self.rate_hz;
        }
        plan.accuracy.geomorph = !self.departs_in(Departure::Geomorph);
        plan.safety.passivity = !self.departs_in(Departure::Account);
        let probe = plan.probes[0].clone();
        plan.probes.resize(self.probes, probe);
        Ok(plan)
    }
}
