//! How an object moves, as typed.

use super::{Number, Numbers, Vector};
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

tables! {
    struct FreeTyped {
        mass_kg: Spanned<f64>,
        inertia_kgm2: Vector,
        damping_ns_per_m: Number,
        damping_nms_per_rad: Number,
        spring_n_per_m: Number,
        spring_nm_per_rad: Number,
        gravity_m_per_s2: Vector,
    }

    struct HingeTyped {
        axis: Spanned<Numbers<3>>,
        anchor_m: Vector,
        mass_kg: Spanned<f64>,
        inertia_kgm2: Vector,
        damping_nms_per_rad: Number,
        spring_nm_per_rad: Number,
        limits_deg: Option<Spanned<Numbers<2>>>,
        gravity_m_per_s2: Vector,
    }

    struct RailTyped {
        axis: Spanned<Numbers<3>>,
        mass_kg: Spanned<f64>,
        damping_ns_per_m: Number,
        spring_n_per_m: Number,
        limits_m: Option<Spanned<Numbers<2>>>,
        gravity_m_per_s2: Vector,
    }

    struct DrivenTyped {
        linear_m_per_s: Vector,
        angular_rad_per_s: Vector,
        anchor_m: Vector,
        period_s: Number,
    }
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
