//! Whether the plan of a run fits this machine, said before the first tick; and the core of the
//! tick.

use crate::calibration;
use crate::message::note;
use crate::tuning::CALIBRATION_STACK_BYTES;
use hrtc_core::governor::WorkCosts;
use realtime::core_claim::CoreClaim;
use realtime::interrupts::{CoreLoad, InterruptedCore, QuietCores};
use realtime::rights::{obtain, usable_cores};
use scene::{ActiveSurface, LoopPlan, ScenePlan};

/// The core of the tick: that of the scene, or where it names none the one of this process that
/// devices interrupt least; `None` leaves it to the kernel.
#[must_use]
pub fn tick_core(plan: &LoopPlan) -> Option<usize> {
    if plan.picks_core {
        quiet_cores().first().map(|of| of.core)
    } else {
        plan.core
    }
}

/// The cores of this process, the quietest first; none where there is no choice.
fn quiet_cores() -> Vec<CoreLoad> {
    let cores = usable_cores();
    // The tick would keep everything else from the only one.
    if cores.len() < 2 {
        return Vec::new();
    }
    QuietCores::look(&cores).iter().collect()
}

/// Names the core of the tick in the plan, and claims it as long as the claim lives. Where the
/// scene names none a core is preferred that no other controller has. Says which it is, when
/// another controller has it, and when devices interrupt it.
pub(super) fn claim_core(plan: &mut LoopPlan) -> Option<CoreClaim> {
    let mut claim = None;
    if plan.picks_core {
        let cores = quiet_cores();
        let free = cores.iter().find(|of| {
            claim = CoreClaim::take(of.core);
            claim.is_some()
        });
        let chosen = free.or(cores.first());
        plan.core = chosen.map(|of| of.core);
        if let Some(chosen) = chosen {
            let others = cores.iter().filter(|of| of.core != chosen.core);
            note!("{}", words(chosen, others, free.is_some()));
        }
    }
    let core = plan.core?;
    let claim = claim.or_else(|| CoreClaim::take(core));
    if claim.is_none() {
        note!(
            "another controller ticks on core {core} too, so both will miss periods; give one of them a core of its own ([loop] core)"
        );
    }
    if let Some(interrupted) = InterruptedCore::look(core) {
        note!("{interrupted}");
    }
    claim
}

/// How a core was chosen.
fn words<'a>(
    chosen: &CoreLoad,
    others: impl Iterator<Item = &'a CoreLoad>,
    is_free: bool,
) -> String {
    let others: Vec<String> = others
        .map(|of| format!("core {}: {}", of.core, of.per_minute))
        .collect();
    let free = if is_free { "free core" } else { "core" };
    format!(
        "ticks on core {}, the {free} that devices interrupt least ({} times a minute; {}); [loop] core names another",
        chosen.core,
        chosen.per_minute,
        others.join(", ")
    )
}

/// What the counted work costs here: measured on the tick's core and with its rights. Where that
/// does not come about the costs of the reference machine count, which is said.
pub(super) fn measure_costs(plan: &LoopPlan, slow: f64) -> WorkCosts {
    let (core, priority) = (plan.core, plan.priority);
    let measure = move || {
        // What is missing is told by the tick's own thread.
        let _rights = obtain(core, priority);
        calibration::measure(slow)
    };
    let thread = std::thread::Builder::new()
        .name("hrtc-costs".to_owned())
        .stack_size(CALIBRATION_STACK_BYTES);
    let measured = thread.spawn(measure).ok();
    let measured = measured.and_then(|thread| thread.join().ok().flatten());
    if measured.is_none() {
        note!("the costs of this machine could not be measured, so the tick counts with others");
    }
    measured.map_or(WorkCosts::REFERENCE, |of| of.costs)
}

/// Says what of the plan this loop does not hold.
pub(super) fn check(plan: &ScenePlan) {
    if let Some(surface) = ActiveSurface::of(plan) {
        note!("{surface}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(core: Option<usize>, picks_core: bool) -> LoopPlan {
        LoopPlan {
            rate_hz: 1000.0,
            core,
            picks_core,
            priority: 80,
            spin_us: 0,
            require_realtime: false,
            operations: 96,
        }
    }

    #[test]
    fn the_scene_s_core_wins_and_without_one_a_core_of_the_process_is_chosen() {
        assert_eq!(tick_core(&plan(Some(7), false)), Some(7));
        assert_eq!(tick_core(&plan(None, false)), None);
        let usable = usable_cores();
        match tick_core(&plan(None, true)) {
            Some(core) => assert!(usable.len() >= 2 && usable.contains(&core)),
            None => assert!(usable.len() < 2),
        }
    }

    #[test]
    fn the_sentence_names_the_core_its_interrupts_and_the_override() {
        let load = |core, per_minute| CoreLoad { core, per_minute };
        let others = [load(1, 5500)];
        let sentence = words(&load(0, 211), others.iter(), true);
        assert!(sentence.contains("core 0, the free core"), "{sentence}");
        assert!(sentence.contains("(211 times a minute; core 1: 5500)"));
        assert!(sentence.ends_with("[loop] core names another"));
    }
}
