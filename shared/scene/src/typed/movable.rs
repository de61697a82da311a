//! How an object moves, as typed.

use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MovableTyped {
    Free(FreeTyped),
    Hinge(HingeTyped),
    Rail(RailTyped),
    Driven(DrivenTyped),
}

pub(crate) type Number = Option<Spanned<f64>>;
pub(crate) type Vector = Option<Spanned<[f64; 3]>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FreeTyped {
    pub(crate) mass_kg: Spanned<f64>,
    pub(crate) inertia_kgm2: Vector,
    pub(crate) damping_ns_per_m: Number,
    pub(crate) damping_nms_per_rad: Number,
    pub(crate) spring_n_per_m: Number,
    pub(crate) spring_nm_per_rad: Number,
    pub(crate) gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HingeTyped {
    pub(crate) axis: Spanned<[f64; 3]>,
    pub(crate) anchor_m: Vector,
    pub(crate) mass_kg: Spanned<f64>,
    pub(crate) inertia_kgm2: Vector,
    pub(crate) damping_nms_per_rad: Number,
    pub(crate) spring_nm_per_rad: Number,
    pub(crate) limits_deg: Option<Spanned<[f64; 2]>>,
    pub(crate) gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RailTyped {
    pub(crate) axis: Spanned<[f64; 3]>,
    pub(crate) mass_kg: Spanned<f64>,
    pub(crate) damping_ns_per_m: Number,
    pub(crate) spring_n_per_m: Number,
    pub(crate) limits_m: Option<Spanned<[f64; 2]>>,
    pub(crate) gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DrivenTyped {
    pub(crate) linear_m_per_s: Vector,
    pub(crate) angular_rad_per_s: Vector,
    pub(crate) anchor_m: Vector,
    pub(crate) period_s: Number,
}

impl MovableTyped {
    /// Mass of a body, and its inertia if that is given; `None` for a driven object.
    pub(crate) fn mass(&self) -> Option<(&Spanned<f64>, &Vector)> {
        match self {
            Self::Free(typed) => Some((&typed.mass_kg, &typed.inertia_kgm2)),
            Self::Hinge(typed) => Some((&typed.mass_kg, &typed.inertia_kgm2)),
            Self::Rail(typed) => Some((&typed.mass_kg, &None)),
            Self::Driven(_) => None,
        }
    }
}
