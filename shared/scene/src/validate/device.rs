//! The device of a probe.

use crate::limits::{MAX_COEFFICIENT, NOT_NEGATIVE, Range};
use crate::plan::{CustomDevicePlan, HandImpedance, SimulatedDevicePlan};
use crate::source::{SceneError, Source, key};
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
    let hand = &typed.hand;
    let hand_stiffness = ("hand's stiffness_n_per_m", &hand.stiffness_n_per_m);
    let hand_damping = ("hand's damping_ns_per_m", &hand.damping_ns_per_m);
    let mass_kg = Range::Within(1e-6, MAX_COEFFICIENT);
    Ok(SimulatedDevicePlan {
        mass_kg: source.number(key!(typed.mass_kg), 0.1, mass_kg)?,
        damping_ns_per_m: source.number(key!(typed.damping_ns_per_m), 1.0, NOT_NEGATIVE)?,
        encoder_m: source.number(key!(typed.encoder_m), 1e-5, NOT_NEGATIVE)?,
        hand: HandImpedance {
            stiffness_n_per_m: source.number(hand_stiffness, 200.0, NOT_NEGATIVE)?,
            damping_ns_per_m: source.number(hand_damping, 2.0, NOT_NEGATIVE)?,
        },
    })
}
