//! The device of a probe.

use crate::limits::MAX_COEFFICIENT;
use crate::plan::{CustomDevicePlan, HandImpedance, SimulatedDevicePlan};
use crate::source::{Range, SceneError, Source};
use crate::typed::{DeviceTyped, SimulatedTyped};
use toml::Spanned;

/// The mechanics of a device, and the custom device if it is one. The defaults stand for the
/// mechanics of a custom device.
pub(super) fn device_plan(
    source: &Source,
    typed: Option<&DeviceTyped>,
) -> Result<(SimulatedDevicePlan, Option<CustomDevicePlan>), SceneError> {
    let default = || simulated(source, &SimulatedTyped::default());
    match typed {
        Some(DeviceTyped::Simulated(device)) => Ok((simulated(source, device)?, None)),
        Some(DeviceTyped::Custom(table)) => Ok((default()?, Some(custom(source, table)?))),
        None => Ok((default()?, None)),
    }
}

fn custom(source: &Source, table: &Spanned<toml::Table>) -> Result<CustomDevicePlan, SceneError> {
    let mut settings = table.get_ref().clone();
    let Some(toml::Value::String(name)) = settings.remove("name") else {
        return Err(source.value(
            table,
            "a custom device has no name; write custom = { name = \"...\" } with the name that the program registers",
        ));
    };
    Ok(CustomDevicePlan {
        name,
        line: source.line(table.span().start),
        settings,
    })
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
        hand: HandImpedance {
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
