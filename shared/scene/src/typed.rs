//! The scene as typed: what serde reads, unknown keys refused, nothing checked yet but the types.

mod effects;

pub(super) use effects::*;

use super::validate::MovableTyped;
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SceneTyped {
    #[serde(rename = "loop", default)]
    pub(super) loop_: LoopTyped,
    #[serde(default)]
    pub(super) cache: CacheTyped,
    #[serde(default)]
    pub(super) accuracy: AccuracyTyped,
    #[serde(default)]
    pub(super) safety: SafetyTyped,
    #[serde(default)]
    pub(super) effects: Vec<Spanned<EffectTyped>>,
    #[serde(default)]
    pub(super) object: Vec<Spanned<ObjectTyped>>,
    #[serde(default)]
    pub(super) probe: Vec<Spanned<ProbeTyped>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct LoopTyped {
    pub(super) rate_hz: Option<Spanned<f64>>,
    pub(super) core: Option<Spanned<i64>>,
    pub(super) priority: Option<Spanned<i64>>,
    pub(super) spin_us: Option<Spanned<i64>>,
    pub(super) require_realtime: Option<bool>,
    pub(super) operations: Option<Spanned<i64>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct CacheTyped {
    pub(super) bytes: Option<Bytes>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct AccuracyTyped {
    pub(super) tolerance_m: Option<Spanned<f64>>,
    pub(super) refinement: Option<RefinementTyped>,
    pub(super) lod: Option<Spanned<i64>>,
    pub(super) geomorph: Option<bool>,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(super) enum RefinementTyped {
    Local,
    Global,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct SafetyTyped {
    pub(super) force_max_n: Option<Spanned<f64>>,
    pub(super) torque_max_nm: Option<Spanned<f64>>,
    pub(super) slew_n_per_s: Option<Spanned<f64>>,
    pub(super) ramp_s: Option<Spanned<f64>>,
    pub(super) passivity: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ObjectTyped {
    pub(super) name: Option<Spanned<String>>,
    pub(super) model: Option<Spanned<String>>,
    pub(super) generate: Option<GenerateTyped>,
    pub(super) size_m: Option<Spanned<f64>>,
    pub(super) metres_per_unit: Option<Spanned<f64>>,
    pub(super) pose: Option<Spanned<PoseTyped>>,
    pub(super) grid: Option<GridTyped>,
    #[serde(default)]
    pub(super) surface: SurfaceTyped,
    #[serde(default)]
    pub(super) effects: Vec<Spanned<EffectTyped>>,
    pub(super) movable: Option<Spanned<MovableTyped>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GenerateTyped {
    pub(super) shape: Spanned<String>,
    pub(super) faces: Spanned<i64>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct PoseTyped {
    pub(super) position_m: Option<[f64; 3]>,
    pub(super) orientation_wxyz: Option<[f64; 4]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GridTyped {
    pub(super) counts: Spanned<[i64; 3]>,
    pub(super) spacing_m: Spanned<f64>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct SurfaceTyped {
    pub(super) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(super) damping_ns_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ProbeTyped {
    pub(super) shape: Option<ShapeTyped>,
    pub(super) device: Option<DeviceTyped>,
    pub(super) trajectory: Option<TrajectoryTyped>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ShapeTyped {
    Sphere(SphereTyped),
    Capsule(RodTyped),
    Cylinder(RodTyped),
    Mesh(MeshTyped),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RodTyped {
    pub(super) radius_m: Spanned<f64>,
    pub(super) length_m: Spanned<f64>,
    pub(super) faces: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MeshTyped {
    pub(super) file: Spanned<String>,
    pub(super) size_m: Spanned<f64>,
    pub(super) faces: Option<Spanned<i64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SphereTyped {
    pub(super) radius_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum DeviceTyped {
    Simulated(SimulatedTyped),
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct SimulatedTyped {
    pub(super) mass_kg: Option<Spanned<f64>>,
    pub(super) damping_ns_per_m: Option<Spanned<f64>>,
    pub(super) encoder_m: Option<Spanned<f64>>,
    #[serde(default)]
    pub(super) hand: HandTyped,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct HandTyped {
    pub(super) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(super) damping_ns_per_m: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum TrajectoryTyped {
    Tour(TourTyped),
    Csv(Spanned<String>),
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct TourTyped {
    /// An object's number or name.
    pub(super) object: Option<Spanned<toml::Value>>,
    pub(super) seed: Option<Spanned<i64>>,
    pub(super) speed_m_per_s: Option<Spanned<f64>>,
    pub(super) depth_m: Option<Spanned<f64>>,
}

/// A size in bytes, typed as a number or with a unit.
#[derive(Clone, Copy)]
pub(super) struct Bytes(pub(super) usize);

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

/// Bytes as a scene and the command line write them: `16MiB`, `512KiB`, `2GB`, or a plain number of bytes.
///
/// # Errors
/// What is wrong, and the forms that are understood.
pub fn parse_bytes(text: &str) -> Result<usize, String> {
    let text = text.trim();
    let digits = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let factor: Option<u64> = match unit.trim() {
        "" | "B" => Some(1),
        "KiB" => Some(1 << 10),
        "MiB" => Some(1 << 20),
        "GiB" => Some(1 << 30),
        "kB" => Some(1_000),
        "MB" => Some(1_000_000),
        "GB" => Some(1_000_000_000),
        _ => None,
    };
    let bytes = factor
        .zip(number.parse::<u64>().ok())
        .and_then(|(factor, number)| number.checked_mul(factor))
        .filter(|bytes| (1..=1 << 40).contains(bytes))
        .and_then(|bytes| usize::try_from(bytes).ok());
    bytes.ok_or_else(|| {
        format!("\"{text}\" is no size; write a whole number of bytes up to 1024GiB such as \"16MiB\", \"512KiB\" or 16777216")
    })
}
