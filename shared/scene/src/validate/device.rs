//! The device of a probe.

use crate::limits::MAX_COEFFICIENT;
use crate::plan::{Hand, SimulatedDevicePlan};
use crate::source::{Range, SceneError, Source};
use crate::typed::{DeviceTyped, SimulatedTyped};
use toml::Spanned;

pub(super) fn device_plan(
    source: &Source,
    typed: Option<&DeviceTyped>,
) -> Result<SimulatedDevicePlan, SceneError> {
    match typed {
        Some(DeviceTyped::Simulated(device)) => simulated(source, device),
        None => simulated(source, &SimulatedTyped::default()),
    }
}

fn simulated(source: &Source, typed: &SimulatedTyped) -> Result<SimulatedDevicePlan, SceneError> {
    let coefficient = |value: &Option<Spanned<f64>>, key, default| {
        let range = Range::NotNegative(MAX_COEFFICIENT);
        source.number(value.as_ref(), key, default, range)
    };
    Ok(SimulatedDevicePlan {
        mass_kg: source.number(
            typed.mass_kg.as_ref(),
            "mass_kg",
            0.1,
            Range::Within(1e-6, MAX_COEFFICIENT),
        )?,
        damping_ns_per_m: coefficient(&typed.damping_ns_per_m, "damping_ns_per_m", 1.0)?,
        encoder_m: coefficient(&typed.encoder_m, "encoder_m", 1e-5)?,
        hand: Hand {
            stiffness_n_per_m: coefficient(
                &typed.hand.stiffness_n_per_m,
                "hand's stiffness_n_per_m",
                200.0,
            )?,
            damping_ns_per_m: coefficient(
                &typed.hand.damping_ns_per_m,
                "hand's damping_ns_per_m",
                2.0,
            )?,
        },
    })
}
