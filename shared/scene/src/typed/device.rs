//! A probe's device, as typed.

use serde::Deserialize;
use toml::Spanned;

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum DeviceTyped {
    Simulated(SimulatedTyped),
    /// Its name and its own settings.
    Custom(Spanned<toml::Table>),
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct SimulatedTyped {
    pub(crate) mass_kg: Option<Spanned<f64>>,
    pub(crate) damping_ns_per_m: Option<Spanned<f64>>,
    pub(crate) encoder_m: Option<Spanned<f64>>,
    #[serde(default)]
    pub(crate) hand: HandTyped,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(crate) struct HandTyped {
    pub(crate) stiffness_n_per_m: Option<Spanned<f64>>,
    pub(crate) damping_ns_per_m: Option<Spanned<f64>>,
}
