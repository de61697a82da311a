//! An entry of a list of effects, as typed.

use serde::Deserialize;
use toml::Spanned;

/// One of the effects, and when it acts.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct EffectTyped {
    pub(in crate::scene) friction: Option<FrictionTyped>,
    pub(in crate::scene) shading: Option<ShadingTyped>,
    pub(in crate::scene) texture: Option<TextureTyped>,
    pub(in crate::scene) magnet: Option<MagnetTyped>,
    pub(in crate::scene) vibration: Option<VibrationTyped>,
    pub(in crate::scene) viscosity: Option<ViscosityTyped>,
    pub(in crate::scene) spring: Option<SpringTyped>,
    pub(in crate::scene) gravity: Option<GravityTyped>,
    pub(in crate::scene) inertia: Option<InertiaTyped>,
    pub(in crate::scene) boundary: Option<BoundaryTyped>,
    pub(in crate::scene) from_s: Option<Spanned<f64>>,
    pub(in crate::scene) until_s: Option<Spanned<f64>>,
    pub(in crate::scene) fade_s: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct FrictionTyped {
    #[serde(rename = "static")]
    pub(in crate::scene) static_: Spanned<f64>,
    pub(in crate::scene) dynamic: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct ShadingTyped {
    pub(in crate::scene) radius_m: Spanned<f64>,
    pub(in crate::scene) max_turn_deg: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct TextureTyped {
    pub(in crate::scene) amplitude_m: Spanned<f64>,
    pub(in crate::scene) grating: Option<GratingTyped>,
    pub(in crate::scene) noise: Option<NoiseTyped>,
    pub(in crate::scene) height_map: Option<HeightMapTyped>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct GratingTyped {
    pub(in crate::scene) wavelength_m: Spanned<f64>,
    pub(in crate::scene) direction: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct NoiseTyped {
    pub(in crate::scene) wavelength_m: Spanned<f64>,
    pub(in crate::scene) seed: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct HeightMapTyped {
    pub(in crate::scene) file: Spanned<String>,
    pub(in crate::scene) width_m: Spanned<f64>,
    #[serde(default)]
    pub(in crate::scene) axis: AxisTyped,
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(rename_all = "lowercase")]
pub(in crate::scene) enum AxisTyped {
    X,
    Y,
    #[default]
    Z,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct MagnetTyped {
    pub(in crate::scene) force_n: Spanned<f64>,
    pub(in crate::scene) reach_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct VibrationTyped {
    pub(in crate::scene) frequency_hz: Spanned<f64>,
    pub(in crate::scene) amplitude_n: Spanned<f64>,
    pub(in crate::scene) direction: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct ViscosityTyped {
    pub(in crate::scene) damping_ns_per_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct SpringTyped {
    pub(in crate::scene) point_m: Option<Spanned<[f64; 3]>>,
    pub(in crate::scene) path_m: Option<Spanned<Vec<[f64; 3]>>>,
    pub(in crate::scene) stiffness_n_per_m: Spanned<f64>,
    pub(in crate::scene) damping_ns_per_m: Option<Spanned<f64>>,
    pub(in crate::scene) force_max_n: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct GravityTyped {
    pub(in crate::scene) mass_kg: Spanned<f64>,
    pub(in crate::scene) direction: Option<Spanned<[f64; 3]>>,
    pub(in crate::scene) centre_m: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct InertiaTyped {
    pub(in crate::scene) mass_kg: Spanned<f64>,
    pub(in crate::scene) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(in crate::scene) damping_ns_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct BoundaryTyped {
    pub(in crate::scene) ball: Option<BallTyped>,
    #[serde(rename = "box")]
    pub(in crate::scene) box_: Option<BoxTyped>,
    pub(in crate::scene) stiffness_n_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct BallTyped {
    pub(in crate::scene) centre_m: Option<Spanned<[f64; 3]>>,
    pub(in crate::scene) radius_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::scene) struct BoxTyped {
    pub(in crate::scene) lower_m: Spanned<[f64; 3]>,
    pub(in crate::scene) upper_m: Spanned<[f64; 3]>,
}
