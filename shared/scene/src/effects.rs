//! The effects that a scene lists: what each one is, checked, in SI units. What is not listed does not exist.
//!
//! The function of the tick that belongs to each stands in the controller (`hrtc::effects`, a file each).

use super::height_map::HeightMap;
use glam::DVec3;
use std::sync::Arc;

/// An effect, and when it acts.
#[derive(Debug, Clone, PartialEq)]
pub struct EffectPlan {
    /// What it does.
    pub effect: Effect,
    /// Seconds after the start when it begins to fade in; 0 for at once, without fading.
    pub from_s: f64,
    /// Seconds after the start when it begins to fade out; infinity for never.
    pub until_s: f64,
    /// Seconds that it takes to fade in or out, positive.
    pub fade_s: f64,
}

/// What an effect does.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Of a surface: dry friction.
    Friction(FrictionPlan),
    /// Of a surface: the force turns smoothly over edges.
    Shading(ShadingPlan),
    /// Of a surface: fine relief that the mesh does not have.
    Texture(TexturePlan),
    /// Of a surface: it pulls what comes near.
    Magnet(MagnetPlan),
    /// Of a surface while it is touched, or of the whole scene.
    Vibration(VibrationPlan),
    /// Of the scene: drag.
    Viscosity {
        /// N s/m, positive.
        damping_ns_per_m: f64,
    },
    /// Of the scene: a spring to a point or a path.
    Spring(SpringPlan),
    /// Of the scene: the weight of the tool.
    Gravity(GravityPlan),
    /// Of the scene: a mass that the device has to carry along.
    Inertia(InertiaPlan),
    /// Of the scene: the end of the workspace.
    Boundary(BoundaryPlan),
}

impl Effect {
    /// Names as a scene writes them, in the order of [`Effect::index`].
    pub const NAMES: [&str; 10] = [
        "friction",
        "shading",
        "texture",
        "magnet",
        "vibration",
        "viscosity",
        "spring",
        "gravity",
        "inertia",
        "boundary",
    ];

    /// Place in [`Effect::NAMES`].
    #[must_use]
    pub fn index(&self) -> usize {
        match self {
            Self::Friction(_) => 0,
            Self::Shading(_) => 1,
            Self::Texture(_) => 2,
            Self::Magnet(_) => 3,
            Self::Vibration(_) => 4,
            Self::Viscosity { .. } => 5,
            Self::Spring(_) => 6,
            Self::Gravity(_) => 7,
            Self::Inertia(_) => 8,
            Self::Boundary(_) => 9,
        }
    }

    /// Its name, as a scene writes it.
    #[must_use]
    pub fn name(&self) -> &'static str {
        Self::NAMES[self.index()]
    }

    /// Whether it belongs to a surface: listed for the scene, it is every object's.
    #[must_use]
    pub fn is_of_surface(&self) -> bool {
        matches!(
            self,
            Self::Friction(_) | Self::Shading(_) | Self::Texture(_) | Self::Magnet(_)
        )
    }
}

/// Coefficients of dry friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionPlan {
    /// Largest force along the surface over the force of the surface while it sticks; 0 to 3, not below `dynamic`.
    pub static_: f64,
    /// The same while it slides, not negative.
    pub dynamic: f64,
}

/// Over how much of the surface the direction of the force is averaged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadingPlan {
    /// Radius of the average, metres.
    pub radius_m: f64,
    /// Edges sharper than this stay sharp, radians.
    pub max_turn: f64,
}

/// A texture: its height over the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct TexturePlan {
    /// Largest height, and depth, metres.
    pub amplitude_m: f64,
    /// Where it is how high.
    pub pattern: Pattern,
}

/// The pattern of a texture, in the object's own axes, metres.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// Waves along a direction.
    Grating {
        /// From crest to crest, metres.
        wavelength_m: f64,
        /// Unit vector.
        direction: DVec3,
    },
    /// Smooth noise.
    Noise {
        /// Size of its bumps, from one to the next, metres.
        wavelength_m: f64,
        /// Which noise.
        seed: u64,
    },
    /// A picture laid over the object along an axis, repeated.
    HeightMap {
        /// Its heights.
        map: Arc<HeightMap>,
        /// Width of the picture, metres.
        width_m: f64,
        /// The axis that it is looked at along: 0 x, 1 y, 2 z.
        axis: usize,
    },
}

/// A surface that pulls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MagnetPlan {
    /// Largest force, newtons.
    pub force_n: f64,
    /// Farthest distance of the surface from which it pulls, metres.
    pub reach_m: f64,
}

/// A vibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VibrationPlan {
    /// Hz, at most a quarter of the loop's rate.
    pub frequency_hz: f64,
    /// Newtons.
    pub amplitude_n: f64,
    /// Unit vector in the world.
    pub direction: DVec3,
}

/// A spring that holds the probe.
#[derive(Debug, Clone, PartialEq)]
pub struct SpringPlan {
    /// What it is held to, world, metres: a point, or a path of straight pieces.
    pub path_m: Vec<DVec3>,
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
    /// Largest force, newtons.
    pub force_max_n: f64,
}

/// The weight of a tool.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GravityPlan {
    /// kg.
    pub mass_kg: f64,
    /// Unit vector in the world.
    pub direction: DVec3,
    /// Centre of mass in the probe's axes, from the device's position, metres.
    pub centre_m: DVec3,
}

/// A mass that is carried along on a spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaPlan {
    /// kg.
    pub mass_kg: f64,
    /// Of what holds it to the device, N/m.
    pub stiffness_n_per_m: f64,
    /// Of what holds it to the device, N s/m.
    pub damping_ns_per_m: f64,
}

/// The end of the workspace: outside of it a spring pushes back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundaryPlan {
    /// Its shape.
    pub shape: Workspace,
    /// N/m.
    pub stiffness_n_per_m: f64,
}

/// What a probe's position is to stay in, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Workspace {
    /// A ball.
    Ball {
        /// Its middle.
        centre: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A box along the axes.
    Box {
        /// Its lower corner.
        lower: DVec3,
        /// Its upper corner.
        upper: DVec3,
    },
}
