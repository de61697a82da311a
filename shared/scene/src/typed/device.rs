//! A probe's device, as typed.

use super::Number;
use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum DeviceTyped {
    Simulated(SimulatedTyped),
    /// Its name and its own settings.
    Custom(Spanned<toml::Table>),
}

tables! {
    #[derive(Default)]
    struct SimulatedTyped {
        mass_kg: Number,
        damping_ns_per_m: Number,
        encoder_m: Number,
        #[serde(default)]
        hand: HandTyped,
    }

    #[derive(Default)]
    struct HandTyped {
        stiffness_n_per_m: Number,
        damping_ns_per_m: Number,
    }
}
