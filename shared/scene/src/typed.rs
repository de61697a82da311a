//! The scene as typed: read by serde, unknown keys refused, only the types checked.

/// Tables of a scene. Unknown keys are refused.
macro_rules! tables {
    ($($(#[$attribute:meta])* struct $name:ident {
        $($(#[$of_field:meta])* $field:ident: $type:ty,)*
    })*) => {$(
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        $(#[$attribute])*
        pub(crate) struct $name {
            $($(#[$of_field])* pub(crate) $field: $type,)*
        }
    )*};
}

mod device;
mod effects;
mod movable;

pub(crate) use device::*;
pub(crate) use effects::*;
pub(crate) use movable::*;

use crate::bytes::parse_bytes;
use serde::Deserialize;
use std::marker::PhantomData;
use toml::Spanned;

pub(crate) type Number = Option<Spanned<f64>>;
pub(crate) type Whole = Option<Spanned<i64>>;
pub(crate) type Vector = Option<Spanned<Numbers<3>>>;

tables! {
    struct SceneTyped {
        #[serde(rename = "loop", default)]
        loop_: LoopTyped,
        #[serde(default)]
        cache: CacheTyped,
        #[serde(default)]
        accuracy: AccuracyTyped,
        #[serde(default)]
        safety: SafetyTyped,
        #[serde(default)]
        record: RecordTyped,
        #[serde(default)]
        effects: Vec<Spanned<EffectTyped>>,
        #[serde(default)]
        object: Vec<Spanned<ObjectTyped>>,
        #[serde(default)]
        probe: Vec<Spanned<ProbeTyped>>,
    }

    #[derive(Default)]
    struct LoopTyped {
        rate_hz: Number,
        core: Whole,
        priority: Whole,
        spin_us: Whole,
        require_realtime: Option<bool>,
        operations: Whole,
    }

    #[derive(Default)]
    struct RecordTyped {
        /// A size, or "off".
        keep: Option<Spanned<String>>,
        path: Option<Spanned<String>>,
    }

    #[derive(Default)]
    struct CacheTyped {
        bytes: Option<Bytes>,
        #[serde(default)]
        change: Vec<CacheChangeTyped>,
    }

    struct CacheChangeTyped {
        at_s: Spanned<f64>,
        bytes: Spanned<Bytes>,
    }

    #[derive(Default)]
    struct AccuracyTyped {
        tolerance_m: Number,
        refinement: Option<RefinementTyped>,
        lod: Whole,
        geomorph: Option<bool>,
        policy: Option<Spanned<PolicyTyped>>,
    }

    #[derive(Default)]
    struct SafetyTyped {
        force_max_n: Number,
        torque_max_nm: Number,
        slew_n_per_s: Number,
        ramp_s: Number,
        passivity: Option<bool>,
    }

    struct ObjectTyped {
        name: Option<Spanned<String>>,
        model: Option<Spanned<String>>,
        generate: Option<GenerateTyped>,
        size_m: Number,
        metres_per_unit: Number,
        pose: Option<Spanned<PoseTyped>>,
        grid: Option<GridTyped>,
        #[serde(default)]
        surface: SurfaceTyped,
        #[serde(default)]
        effects: Vec<Spanned<EffectTyped>>,
        movable: Option<Spanned<MovableTyped>>,
        importance: Number,
    }

    struct GenerateTyped {
        shape: Spanned<String>,
        faces: Spanned<i64>,
    }

    #[derive(Default)]
    struct PoseTyped {
        position_m: Option<Numbers<3>>,
        orientation_wxyz: Option<Numbers<4>>,
    }

    struct GridTyped {
        counts: Spanned<Numbers<3, i64>>,
        spacing_m: Spanned<f64>,
    }

    #[derive(Default)]
    struct SurfaceTyped {
        stiffness_n_per_m: Number,
        damping_ns_per_m: Number,
    }

    struct ProbeTyped {
        shape: Option<ShapeTyped>,
        device: Option<DeviceTyped>,
        trajectory: Option<TrajectoryTyped>,
    }

    /// A file with a device of its own.
    struct DeviceFileTyped {
        device: DeviceTyped,
    }

    struct RodTyped {
        radius_m: Spanned<f64>,
        length_m: Spanned<f64>,
        faces: Whole,
    }

    struct MeshTyped {
        file: Spanned<String>,
        size_m: Spanned<f64>,
        faces: Whole,
    }

    struct SphereTyped {
        radius_m: Number,
    }

    #[derive(Default)]
    struct TourTyped {
        /// An object's number or name.
        object: Option<Spanned<toml::Value>>,
        seed: Whole,
        speed_m_per_s: Number,
        depth_m: Number,
    }
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(crate) enum RefinementTyped {
    Local,
    Global,
}

#[derive(Deserialize, Clone, Copy, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PolicyTyped {
    Predictive,
    Reactive,
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
#[serde(rename_all = "snake_case")]
pub(crate) enum TrajectoryTyped {
    Tour(TourTyped),
    Csv(Spanned<String>),
}

/// So many numbers in brackets and no more: serde's own arrays leave what is too much unread.
#[derive(Clone, Copy)]
pub(crate) struct Numbers<const N: usize, T = f64>(pub(crate) [T; N]);

impl<'de, const N: usize, T: Deserialize<'de>> Deserialize<'de> for Numbers<N, T> {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor<const N: usize, T>(PhantomData<T>);
        impl<'de, const N: usize, T: Deserialize<'de>> serde::de::Visitor<'de> for Visitor<N, T> {
            type Value = Numbers<N, T>;
            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                write!(f, "an array of length {N}")
            }
            fn visit_seq<A: serde::de::SeqAccess<'de>>(
                self,
                mut typed: A,
            ) -> Result<Self::Value, A::Error> {
                let mut numbers: Vec<T> = Vec::with_capacity(N);
                while let Some(number) = typed.next_element()? {
                    numbers.push(number);
                }
                let count = numbers.len();
                let numbers: Option<[T; N]> = numbers.try_into().ok();
                let refused = || serde::de::Error::invalid_length(count, &self);
                numbers.map(Numbers).ok_or_else(refused)
            }
        }
        deserializer.deserialize_seq(Visitor::<N, T>(PhantomData))
    }
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
