//! An entry of a list of effects, as typed.

use super::{Number, Numbers, Vector, Whole};
use serde::Deserialize;
use toml::Spanned;

tables! {
    /// One of the effects, and when it acts.
    struct EffectTyped {
        friction: Option<FrictionTyped>,
        shading: Option<ShadingTyped>,
        texture: Option<TextureTyped>,
        magnet: Option<MagnetTyped>,
        vibration: Option<VibrationTyped>,
        viscosity: Option<ViscosityTyped>,
        spring: Option<SpringTyped>,
        gravity: Option<GravityTyped>,
        inertia: Option<InertiaTyped>,
        boundary: Option<BoundaryTyped>,
        from_s: Number,
        until_s: Number,
        fade_s: Number,
    }

    struct FrictionTyped {
        #[serde(rename = "static")]
        static_: Spanned<f64>,
        dynamic: Number,
    }

    struct ShadingTyped {
        radius_m: Spanned<f64>,
        max_turn_deg: Number,
    }

    struct TextureTyped {
        amplitude_m: Spanned<f64>,
        grating: Option<GratingTyped>,
        noise: Option<NoiseTyped>,
        height_map: Option<HeightMapTyped>,
    }

    struct GratingTyped {
        wavelength_m: Spanned<f64>,
        direction: Vector,
    }

    struct NoiseTyped {
        wavelength_m: Spanned<f64>,
        seed: Whole,
    }

    struct HeightMapTyped {
        file: Spanned<String>,
        width_m: Spanned<f64>,
        #[serde(default)]
        axis: AxisTyped,
    }

    struct MagnetTyped {
        force_n: Spanned<f64>,
        reach_m: Spanned<f64>,
    }

    struct VibrationTyped {
        frequency_hz: Spanned<f64>,
        amplitude_n: Spanned<f64>,
        direction: Vector,
    }

    struct ViscosityTyped {
        damping_ns_per_m: Spanned<f64>,
    }

    struct SpringTyped {
        point_m: Vector,
        path_m: Option<Spanned<Vec<Numbers<3>>>>,
        stiffness_n_per_m: Spanned<f64>,
        damping_ns_per_m: Number,
        force_max_n: Number,
    }

    struct GravityTyped {
        mass_kg: Spanned<f64>,
        direction: Vector,
        centre_m: Vector,
    }

    struct InertiaTyped {
        mass_kg: Spanned<f64>,
        stiffness_n_per_m: Number,
        damping_ns_per_m: Number,
    }

    struct BoundaryTyped {
        ball: Option<BallTyped>,
        #[serde(rename = "box")]
        box_: Option<BoxTyped>,
        stiffness_n_per_m: Number,
    }

    struct BallTyped {
        centre_m: Vector,
        radius_m: Spanned<f64>,
    }

    struct BoxTyped {
        lower_m: Spanned<Numbers<3>>,
        upper_m: Spanned<Numbers<3>>,
    }
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AxisTyped {
    X,
    Y,
    #[default]
    Z,
}
