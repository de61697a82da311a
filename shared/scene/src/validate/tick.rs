//! The loop, the accuracy and the safety of a scene.

use crate::limits::{Limit, NOT_NEGATIVE, POSITIVE, RAMP_S, RATE_HZ, Range};
use crate::plan::{AccuracyPlan, LoopPlan, Overrides, PolicyPlan, RefinementPlan, SafetyPlan};
use crate::source::{SceneError, Source, key};
use crate::typed::{AccuracyTyped, LoopTyped, PolicyTyped, RefinementTyped, SafetyTyped};

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
        policy: policy_plan(source, typed, refinement)?,
    })
}

fn policy_plan(
    source: &Source,
    typed: &AccuracyTyped,
    refinement: RefinementPlan,
) -> Result<PolicyPlan, SceneError> {
    let Some(policy) = &typed.policy else {
        return Ok(PolicyPlan::default());
    };
    if refinement != RefinementPlan::Local {
        return Err(source.value(
            policy,
            "policy says how fine the mesh around a contact may be, so it goes with refinement = \"local\"; leave one of them out",
        ));
    }
    Ok(match policy.get_ref() {
        PolicyTyped::Predictive => PolicyPlan::Predictive,
        PolicyTyped::Reactive => PolicyPlan::Reactive,
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
    let rate_hz = source.number(key!(typed.rate_hz), 1000.0, RATE_HZ)?;
    let core = source.optional(("core (-1: any)", &typed.core), -1..=1023)?;
    let priority = source.number(key!(typed.priority), 80, 1..=99)?;
    let spin = source.number(key!(typed.spin_us), 0, 0..=max_spin_us(rate_hz))?;
    let operations = source.number(key!(typed.operations), 96, 1..=100_000)?;
    let a_millisecond = LoopPlan {
        rate_hz: 1e3,
        core: core.and_then(|core| usize::try_from(core).ok()),
        picks_core: core.is_none(),
        priority: priority as i32,
        spin_us: spin as u64,
        require_realtime: typed.require_realtime.unwrap_or(false),
        operations: operations as usize,
    };
    Ok(a_millisecond.at_rate(rate_hz))
}

/// Longest busy waiting before a deadline, microseconds: more than half a period would starve the
/// rest of the core.
fn max_spin_us(rate_hz: f64) -> i64 {
    (5e5 / rate_hz) as i64
}

/// Lays the command line's values over the loop.
pub(super) fn override_loop(plan: &mut LoopPlan, overrides: &Overrides) -> Result<(), String> {
    if let Some(rate_hz) = overrides.rate_hz {
        *plan = plan.at_rate(RATE_HZ.check("--rate (ticks a second)", rate_hz)?);
    }
    plan.spin_us = overrides.spin_us.unwrap_or(plan.spin_us);
    let most = max_spin_us(plan.rate_hz);
    if i64::try_from(plan.spin_us).is_ok_and(|spin| spin <= most) {
        return Ok(());
    }
    Err(format!(
        "at {} ticks a second at most {most} µs, half a period, may be spun before a deadline, not {}; lower spin_us",
        plan.rate_hz, plan.spin_us
    ))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_and_a_spin_of_the_command_line_keep_to_the_scenes_limits() {
        let with = |rate_hz: Option<f64>, spin_us: Option<u64>| {
            let mut plan = LoopPlan {
                rate_hz: 1000.0,
                core: None,
                picks_core: true,
                priority: 80,
                spin_us: 200,
                require_realtime: false,
                operations: 96,
            };
            let overrides = Overrides {
                rate_hz,
                spin_us,
                ..Overrides::default()
            };
            let operations = if rate_hz == Some(5000.0) { 48 } else { 96 };
            override_loop(&mut plan, &overrides).map(|()| {
                assert_eq!(plan.operations, operations);
                (plan.rate_hz, plan.spin_us)
            })
        };
        assert_eq!(with(None, None), Ok((1000.0, 200)));
        assert_eq!(with(Some(5000.0), Some(100)), Ok((5000.0, 100)));
        for rate in [99.0, 10_001.0, f64::NAN] {
            assert!(with(Some(rate), Some(0)).unwrap_err().contains("--rate"));
        }
        for (rate, spin) in [(Some(5000.0), Some(101)), (Some(5000.0), None)] {
            let refused = with(rate, spin).unwrap_err();
            assert!(refused.contains("at most 100 µs"), "{refused}");
        }
    }

    #[test]
    fn the_policy_of_detail_is_predictive_unless_the_scene_says_reactive() {
        let read = |accuracy: &str| {
            let text = format!(
                "[accuracy]\n{accuracy}\n[[object]]\nmodel = \"m.spm\"\nsize_m = 0.1\n[[probe]]\n"
            );
            let folder = std::path::Path::new("");
            crate::parse(
                &text,
                "test.toml",
                folder,
                &Overrides::default(),
                &crate::NoFiles,
            )
        };
        let policy = |accuracy: &str| read(accuracy).unwrap().accuracy.policy;
        assert_eq!(policy(""), PolicyPlan::Predictive);
        assert_eq!(policy("policy = \"predictive\""), PolicyPlan::Predictive);
        assert_eq!(policy("policy = \"reactive\""), PolicyPlan::Reactive);
        for (accuracy, expected) in [
            ("policy = \"both\"", "expected `predictive` or `reactive`"),
            (
                "policy = \"reactive\"\nrefinement = \"global\"",
                "refinement = \"local\"",
            ),
        ] {
            let message = read(accuracy).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
            assert!(message.starts_with("test.toml, line 2:"), "{message}");
        }
    }
}
