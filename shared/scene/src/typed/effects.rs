//! An entry of a list of effects, as typed.

use serde::Deserialize;
use toml::Spanned;

/// One of the effects, and when it acts.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EffectTyped {
    pub(crate) friction: Option<FrictionTyped>,
    pub(crate) shading: Option<ShadingTyped>,
    pub(crate) texture: Option<TextureTyped>,
    pub(crate) magnet: Option<MagnetTyped>,
    pub(crate) vibration: Option<VibrationTyped>,
    pub(crate) viscosity: Option<ViscosityTyped>,
    pub(crate) spring: Option<SpringTyped>,
    pub(crate) gravity: Option<GravityTyped>,
    pub(crate) inertia: Option<InertiaTyped>,
    pub(crate) boundary: Option<BoundaryTyped>,
    pub(crate) from_s: Option<Spanned<f64>>,
    pub(crate) until_s: Option<Spanned<f64>>,
    pub(crate) fade_s: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FrictionTyped {
    #[serde(rename = "static")]
    pub(crate) static_: Spanned<f64>,
    pub(crate) dynamic: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ShadingTyped {
    pub(crate) radius_m: Spanned<f64>,
    pub(crate) max_turn_deg: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TextureTyped {
    pub(crate) amplitude_m: Spanned<f64>,
    pub(crate) grating: Option<GratingTyped>,
    pub(crate) noise: Option<NoiseTyped>,
    pub(crate) height_map: Option<HeightMapTyped>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GratingTyped {
    pub(crate) wavelength_m: Spanned<f64>,
    pub(crate) direction: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct NoiseTyped {
    pub(crate) wavelength_m: Spanned<f64>,
    pub(crate) seed: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HeightMapTyped {
    pub(crate) file: Spanned<String>,
    pub(crate) width_m: Spanned<f64>,
    #[serde(default)]
    pub(crate) axis: AxisTyped,
}

#[derive(Deserialize, Clone, Copy, Default)]
#[serde(rename_all = "lowercase")]
pub(crate) enum AxisTyped {
    X,
    Y,
    #[default]
    Z,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MagnetTyped {
    pub(crate) force_n: Spanned<f64>,
    pub(crate) reach_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VibrationTyped {
    pub(crate) frequency_hz: Spanned<f64>,
    pub(crate) amplitude_n: Spanned<f64>,
    pub(crate) direction: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ViscosityTyped {
    pub(crate) damping_ns_per_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SpringTyped {
    pub(crate) point_m: Option<Spanned<[f64; 3]>>,
    pub(crate) path_m: Option<Spanned<Vec<[f64; 3]>>>,
    pub(crate) stiffness_n_per_m: Spanned<f64>,
    pub(crate) damping_ns_per_m: Option<Spanned<f64>>,
    pub(crate) force_max_n: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GravityTyped {
    pub(crate) mass_kg: Spanned<f64>,
    pub(crate) direction: Option<Spanned<[f64; 3]>>,
    pub(crate) centre_m: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct InertiaTyped {
    pub(crate) mass_kg: Spanned<f64>,
    pub(crate) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(crate) damping_ns_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BoundaryTyped {
    pub(crate) ball: Option<BallTyped>,
    #[serde(rename = "box")]
    pub(crate) box_: Option<BoxTyped>,
    pub(crate) stiffness_n_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BallTyped {
    pub(crate) centre_m: Option<Spanned<[f64; 3]>>,
    pub(crate) radius_m: Spanned<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BoxTyped {
    pub(crate) lower_m: Spanned<[f64; 3]>,
    pub(crate) upper_m: Spanned<[f64; 3]>,
}
