//! A probe's device, as typed.

use super::{Number, Whole};
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum DeviceTyped {
    Simulated(Box<SimulatedTyped>),
    /// Its name and its own settings.
    Custom(Spanned<toml::Table>),
}

tables! {
    #[derive(Default)]
    struct SimulatedTyped {
        mass_kg: Number,
        damping_ns_per_m: Number,
        encoder_m: Number,
        inertia_kgm2: Number,
        damping_nms_per_rad: Number,
        encoder_rad: Number,
        /// Degrees of freedom: 3 or 6.
        senses: Whole,
        renders: Whole,
        #[serde(default)]
        hand: HandTyped,
    }

    #[derive(Default)]
    struct HandTyped {
        stiffness_n_per_m: Number,
        damping_ns_per_m: Number,
        stiffness_nm_per_rad: Number,
        damping_nms_per_rad: Number,
    }
}

impl SimulatedTyped {
    /// Whether a key of the rotation is given.
    pub(crate) fn has_rotation(&self) -> bool {
        let numbers = [
            &self.inertia_kgm2,
            &self.damping_nms_per_rad,
            &self.encoder_rad,
            &self.hand.stiffness_nm_per_rad,
            &self.hand.damping_nms_per_rad,
        ];
        numbers.iter().any(|number| number.is_some()) || self.renders.is_some()
    }
}
