//! The loop, the accuracy and the safety of a scene.

use crate::limits::{NOT_NEGATIVE, POSITIVE, RAMP_S, Range};
use crate::plan::{AccuracyPlan, LoopPlan, RefinementPlan, SafetyPlan};
use crate::source::{SceneError, Source, key};
use crate::typed::{AccuracyTyped, LoopTyped, RefinementTyped, SafetyTyped};

pub(super) fn accuracy_plan(
    source: &Source,
    typed: &AccuracyTyped,
) -> Result<AccuracyPlan, SceneError> {
    let tolerance_m = source.number(key!(typed.tolerance_m), 0.0, NOT_NEGATIVE)?;
    let refinement = refinement_plan(source, typed)?;
    if let (RefinementPlan::Global { lod: Some(_) }, Some(tolerance)) =
        (refinement, &typed.tolerance_m)
        && tolerance_m != 0.0
    {
        return Err(source.value(
            tolerance,
            "lod and tolerance_m both say how fine the whole model is to be; leave one of them out",
        ));
    }
    Ok(AccuracyPlan {
        tolerance_m,
        refinement,
        geomorph: typed.geomorph.unwrap_or(true),
    })
}

fn refinement_plan(source: &Source, typed: &AccuracyTyped) -> Result<RefinementPlan, SceneError> {
    match (typed.refinement, &typed.lod) {
        (Some(RefinementTyped::Global), lod) => {
            let lod = source.optional(("lod", lod), 0..=i64::from(u32::MAX - 1))?;
            Ok(RefinementPlan::Global {
                lod: lod.map(|lod| lod as u32),
            })
        }
        (_, None) => Ok(RefinementPlan::Local),
        (_, Some(lod)) => Err(source.value(
            lod,
            "lod counts the splits of the whole model, so it goes with refinement = \"global\"; write that too, or leave lod out and set tolerance_m",
        )),
    }
}

pub(super) fn loop_plan(source: &Source, typed: &LoopTyped) -> Result<LoopPlan, SceneError> {
    let rate_hz = source.number(key!(typed.rate_hz), 1000.0, Range::Within(100.0, 10_000.0))?;
    let core = source.number(("core (-1: any)", &typed.core), 1, -1..=1023)?;
    let priority = source.number(key!(typed.priority), 80, 1..=99)?;
    // Spinning longer than half a period would starve the rest of the core.
    let max_spin_us = (5e5 / rate_hz) as i64;
    let spin = source.number(key!(typed.spin_us), 0, 0..=max_spin_us)?;
    let operations = source.number(key!(typed.operations), 96, 1..=100_000)?;
    Ok(LoopPlan {
        rate_hz,
        core: usize::try_from(core).ok(),
        priority: priority as i32,
        spin_us: spin as u64,
        require_realtime: typed.require_realtime.unwrap_or(false),
        operations: operations as usize,
    })
}

pub(super) fn safety_plan(source: &Source, typed: &SafetyTyped) -> Result<SafetyPlan, SceneError> {
    Ok(SafetyPlan {
        force_max_n: source.number(key!(typed.force_max_n), 8.0, POSITIVE)?,
        torque_max_nm: source.number(key!(typed.torque_max_nm), 0.3, Range::Within(1e-6, 1e3))?,
        slew_n_per_s: source.number(key!(typed.slew_n_per_s), 2000.0, POSITIVE)?,
        ramp_s: source.number(key!(typed.ramp_s), 0.2, RAMP_S)?,
        passivity: typed.passivity.unwrap_or(true),
    })
}
