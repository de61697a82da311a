//! The effects that a scene lists, checked, in SI units. An effect that is not listed does not
//! exist.
//!
//! The controller computes them (`hrtc_core::force::effects`, a file each).

use super::height_map::HeightMap;
use glam::DVec3;
use std::sync::Arc;

/// An effect and the time during which it acts.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EffectPlan {
    /// The effect.
    pub effect: Effect,
    /// Start of its fade-in, seconds after the start; 0 for immediate, without fading.
    pub from_s: f64,
    /// Start of its fade-out, seconds after the start; infinity for never.
    pub until_s: f64,
    /// Duration of a fade, seconds, positive.
    pub fade_s: f64,
}

/// An effect with its parameters.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Effect {
    /// Dry friction of a surface.
    Friction(FrictionPlan),
    /// Smooth force direction over the edges of a surface.
    Shading(ShadingPlan),
    /// Fine relief of a surface, beyond its mesh.
    Texture(TexturePlan),
    /// Attraction of a surface.
    Magnet(MagnetPlan),
    /// Vibration of a surface during contact, or of the whole scene.
    Vibration(VibrationPlan),
    /// Drag, in the whole scene.
    Viscosity {
        /// N s/m, positive.
        damping_ns_per_m: f64,
    },
    /// A spring to a point or a path.
    Spring(SpringPlan),
    /// The weight of the tool.
    Gravity(GravityPlan),
    /// A mass that the device carries.
    Inertia(InertiaPlan),
    /// The boundary of the workspace.
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

    /// Index into [`Effect::NAMES`].
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

    /// Whether it belongs to a surface. Listed for the scene, it applies to every object.
    #[must_use]
    pub fn is_of_surface(&self) -> bool {
        matches!(
            self,
            Self::Friction(_) | Self::Shading(_) | Self::Texture(_) | Self::Magnet(_)
        )
    }
}

/// Coefficients of dry friction.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FrictionPlan {
    /// Largest tangential force over the normal force while sticking; 0 to 3, not below `dynamic`.
    pub static_: f64,
    /// The same while sliding, not negative.
    pub dynamic: f64,
}

/// Averaging of the force direction over the surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ShadingPlan {
    /// Radius of the average, metres.
    pub radius_m: f64,
    /// Edges sharper than this stay sharp, radians.
    pub max_turn: f64,
}

/// A texture: its height over the surface.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct TexturePlan {
    /// Largest height, and depth, metres.
    pub amplitude_m: f64,
    /// Its relative height.
    pub pattern: Pattern,
}

/// The pattern of a texture, in the object's own axes, metres.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
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
        /// Distance between its bumps, metres.
        wavelength_m: f64,
        /// Seed of the noise.
        seed: u64,
    },
    /// A picture laid over the object along an axis, repeated.
    HeightMap {
        /// Its heights.
        map: Arc<HeightMap>,
        /// Width of the picture, metres.
        width_m: f64,
        /// Axis of the projection: 0 x, 1 y, 2 z.
        axis: usize,
    },
}

/// An attracting surface.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MagnetPlan {
    /// Largest force, newtons.
    pub force_n: f64,
    /// Largest distance of the attraction, metres.
    pub reach_m: f64,
}

/// A vibration.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct VibrationPlan {
    /// Hz, at most a quarter of the loop's rate.
    pub frequency_hz: f64,
    /// Newtons.
    pub amplitude_n: f64,
    /// Unit vector in the world.
    pub direction: DVec3,
}

/// A spring that holds the probe.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SpringPlan {
    /// Its anchor in the world, metres: a point, or a path of straight segments.
    pub path_m: Vec<DVec3>,
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
    /// Largest force, newtons.
    pub force_max_n: f64,
}

/// The weight of a tool.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct GravityPlan {
    /// kg.
    pub mass_kg: f64,
    /// Unit vector in the world.
    pub direction: DVec3,
    /// Centre of mass in the probe's axes, from the device's position, metres.
    pub centre_m: DVec3,
}

/// A mass coupled to the device by a spring and damper.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct InertiaPlan {
    /// kg.
    pub mass_kg: f64,
    /// Stiffness of the coupling, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping of the coupling, N s/m.
    pub damping_ns_per_m: f64,
}

/// The boundary of the workspace: outside, a spring pushes back.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BoundaryPlan {
    /// Its shape.
    pub shape: Workspace,
    /// N/m.
    pub stiffness_n_per_m: f64,
}

/// Volume for a probe's position, world, metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
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
