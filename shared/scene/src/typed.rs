//! The scene as typed: read by serde, unknown keys refused, only the types checked.

mod device;
mod effects;
mod movable;

pub(crate) use device::*;
pub(crate) use effects::*;
pub(crate) use movable::*;

use crate::bytes::parse_bytes;
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SceneTyped {
    #[serde(rename = "loop", default)]
    pub(crate) loop_: LoopTyped,
    #[serde(default)]
    pub(crate) cache: CacheTyped,
    #[serde(default)]
    pub(crate) accuracy: AccuracyTyped,
    #[serde(default)]
    pub(crate) safety: SafetyTyped,
    #[serde(default)]
    pub(crate) effects: Vec<Spanned<EffectTyped>>,
    #[serde(default)]
    pub(crate) object: Vec<Spanned<ObjectTyped>>,
    #[serde(default)]
    pub(crate) probe: Vec<Spanned<ProbeTyped>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct LoopTyped {
    pub(crate) rate_hz: Option<Spanned<f64>>,
    pub(crate) core: Option<Spanned<i64>>,
    pub(crate) priority: Option<Spanned<i64>>,
    pub(crate) spin_us: Option<Spanned<i64>>,
    pub(crate) require_realtime: Option<bool>,
    pub(crate) operations: Option<Spanned<i64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct CacheTyped {
    pub(crate) bytes: Option<Bytes>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct AccuracyTyped {
    pub(crate) tolerance_m: Option<Spanned<f64>>,
    pub(crate) refinement: Option<RefinementTyped>,
    pub(crate) lod: Option<Spanned<i64>>,
    pub(crate) geomorph: Option<bool>,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(crate) enum RefinementTyped {
    Local,
    Global,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct SafetyTyped {
    pub(crate) force_max_n: Option<Spanned<f64>>,
    pub(crate) torque_max_nm: Option<Spanned<f64>>,
    pub(crate) slew_n_per_s: Option<Spanned<f64>>,
    pub(crate) ramp_s: Option<Spanned<f64>>,
    pub(crate) passivity: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ObjectTyped {
    pub(crate) name: Option<Spanned<String>>,
    pub(crate) model: Option<Spanned<String>>,
    pub(crate) generate: Option<GenerateTyped>,
    pub(crate) size_m: Option<Spanned<f64>>,
    pub(crate) metres_per_unit: Option<Spanned<f64>>,
    pub(crate) pose: Option<Spanned<PoseTyped>>,
    pub(crate) grid: Option<GridTyped>,
    #[serde(default)]
    pub(crate) surface: SurfaceTyped,
    #[serde(default)]
    pub(crate) effects: Vec<Spanned<EffectTyped>>,
    pub(crate) movable: Option<Spanned<MovableTyped>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GenerateTyped {
    pub(crate) shape: Spanned<String>,
    pub(crate) faces: Spanned<i64>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct PoseTyped {
    pub(crate) position_m: Option<[f64; 3]>,
    pub(crate) orientation_wxyz: Option<[f64; 4]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct GridTyped {
    pub(crate) counts: Spanned<[i64; 3]>,
    pub(crate) spacing_m: Spanned<f64>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct SurfaceTyped {
    pub(crate) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(crate) damping_ns_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ProbeTyped {
    pub(crate) shape: Option<ShapeTyped>,
    pub(crate) device: Option<DeviceTyped>,
    pub(crate) trajectory: Option<TrajectoryTyped>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ShapeTyped {
    Sphere(SphereTyped),
    Capsule(RodTyped),
    Cylinder(RodTyped),
    Mesh(MeshTyped),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RodTyped {
    pub(crate) radius_m: Spanned<f64>,
    pub(crate) length_m: Spanned<f64>,
    pub(crate) faces: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MeshTyped {
    pub(crate) file: Spanned<String>,
    pub(crate) size_m: Spanned<f64>,
    pub(crate) faces: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SphereTyped {
    pub(crate) radius_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum TrajectoryTyped {
    Tour(TourTyped),
    Csv(Spanned<String>),
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct TourTyped {
    /// An object's number or name.
    pub(crate) object: Option<Spanned<toml::Value>>,
    pub(crate) seed: Option<Spanned<i64>>,
    pub(crate) speed_m_per_s: Option<Spanned<f64>>,
    pub(crate) depth_m: Option<Spanned<f64>>,
}

/// A size in bytes, typed as a number or with a unit.
#[derive(Clone, Copy)]
pub(crate) struct Bytes(pub(crate) usize);

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = Bytes;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a size such as \"16MiB\" or a whole number of bytes")
            }
            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Bytes, E> {
                parse_bytes(text).map(Bytes).map_err(E::custom)
            }
            fn visit_i64<E: serde::de::Error>(self, number: i64) -> Result<Bytes, E> {
                self.visit_str(&number.to_string())
            }
        }
        deserializer.deserialize_any(Visitor)
    }
}
