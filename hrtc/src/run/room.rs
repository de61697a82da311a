//! Whether the plan of a run fits this machine, said before the first tick; and the core of the
//! tick.

use super::RunError;
use crate::calibration;
use crate::message::note;
use crate::setup::ControllerSetup;
use crate::tuning::TICK_STACK_BYTES;
use hrtc_core::governor::{TickLoad, TickNeed, WorkCosts};
use protocol::tour::hover_height;
use realtime::core_claim::CoreClaim;
use realtime::interrupts::{CoreLoad, InterruptedCore, QuietCores};
use realtime::loop_cores::own_cores;
use realtime::rights::{obtain_processor, usable_cores};
use scene::{
    ActiveSurface, LoopPlan, ModelScale, MovablePlan, ProbePlan, ProbeShape, ScenePlan,
    TrajectoryPlan,
};

/// The core on which a controller would tick that this process started now: that of the scene, or
/// where it names none the one of this process that devices interrupt least and no other controller
/// has; `None` leaves it to the kernel.
#[must_use]
pub fn next_tick_core(plan: &LoopPlan) -> Option<usize> {
    if !plan.picks_core {
        return plan.core;
    }
    let cores = quiet_cores(&usable_cores());
    choose(&cores).map(|(of, _)| of.core)
}

/// These cores, the quietest first; none where there is no choice.
fn quiet_cores(cores: &[usize]) -> Vec<CoreLoad> {
    // The tick would keep everything else from the only one.
    if cores.len() < 2 {
        return Vec::new();
    }
    QuietCores::look(cores).iter().collect()
}

/// The first that no other controller has, with its claim, or else the first.
fn choose(cores: &[CoreLoad]) -> Option<(CoreLoad, Option<CoreClaim>)> {
    let mut free = cores
        .iter()
        .filter_map(|of| Some((*of, Some(CoreClaim::take(of.core)?))));
    free.next().or_else(|| Some((*cores.first()?, None)))
}

/// Names the core of the tick in the plan, and claims it as long as the claim lives. Where the
/// scene names none a core is preferred that no other controller has; it is one of those that the
/// user has put this process on (`taskset`), but another process that started it has put it where
/// everything but the tick goes. Says which it is, when another controller has it, and when devices
/// interrupt it.
pub(super) fn claim_core(plan: &mut LoopPlan, is_supervised: bool) -> Option<CoreClaim> {
    let mut claim = None;
    if plan.picks_core {
        let cores = if is_supervised {
            usable_cores()
        } else {
            own_cores()
        };
        if let [only] = cores[..] {
            return claim_only(only);
        }
        let cores = quiet_cores(&cores);
        if let Some((chosen, claimed)) = choose(&cores) {
            let others = cores.iter().filter(|of| of.core != chosen.core);
            note!("{}", words(&chosen, others, claimed.is_some()));
            plan.core = Some(chosen.core);
            claim = claimed;
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

/// Claims the one core that there is for everything, which the plan need not name. Says when
/// another controller has it.
fn claim_only(core: usize) -> Option<CoreClaim> {
    let claim = CoreClaim::take(core);
    if claim.is_none() {
        note!(
            "another controller ticks on core {core} too, the only one for this one, so both will miss periods; give one of them another core (taskset) or another machine"
        );
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
        let _rights = obtain_processor(core, priority);
        calibration::measure(slow)
    };
    let thread = std::thread::Builder::new()
        .name("hrtc-costs".to_owned())
        .stack_size(TICK_STACK_BYTES);
    let measured = thread.spawn(measure).ok();
    let measured = measured.and_then(|thread| thread.join().ok().flatten());
    if measured.is_none() {
        note!(
            "the costs of this machine could not be measured, so the tick counts with those of the reference machine; where this one is slower it is late until it has learned that"
        );
    }
    measured.map_or(WorkCosts::REFERENCE, |of| of.costs)
}

/// Says what of the plan a run of so many seconds does not hold, on a machine of the setup's costs.
///
/// # Errors
/// When a tick cannot end in its time even without contact.
pub(super) fn check(
    plan: &ScenePlan,
    setup: &ControllerSetup,
    seconds: Option<f64>,
) -> Result<(), RunError> {
    if let Some(surface) = ActiveSurface::of(plan) {
        note!("{surface}");
    }
    let led_s = seconds.map_or(setup.tour_seconds, |of| of.min(setup.tour_seconds));
    if let Some(tour) = short_tour(plan, led_s) {
        note!("{tour}");
    }
    let costs = setup.costs;
    let is_ball = |probe: &&ProbePlan| matches!(probe.shape, ProbeShape::Sphere { .. });
    let balls = plan.probes.iter().filter(is_ball).count();
    let tools = plan.probes.len() - balls;
    let (rate_hz, operations) = (plan.loop_.rate_hz, plan.loop_.operations);
    let movable = || plan.objects.iter().filter_map(|of| of.movable.as_ref());
    let is_driven = |of: &&MovablePlan| matches!(of, MovablePlan::Driven(_));
    let (objects, probes) = (plan.objects.len(), plan.probes.len());
    let load = |bodies| TickLoad::new([balls, tools], objects, probes, bodies);
    let need_of = |load| TickNeed::new(costs, 1.0 / rate_hz, operations, load);
    // Others rest until they are pushed.
    let moving = load(movable().filter(is_driven).count());
    let need = need_of(moving);
    if need.least_ns > need.share_ns {
        return Err(RunError::TooSlow(short_of_time(&need, &plan.loop_)));
    }
    if need.operations < 0.99 * operations as f64 {
        note!("{}", short_of_time(&need, &plan.loop_));
    }
    if let Some(crowd) = crowd(costs, &plan.loop_, moving, plan.active_objects()) {
        note!("{crowd}");
    }
    let bodies = movable().count();
    let all = need_of(load(bodies));
    if all.least_ns > all.share_ns {
        note!(
            "where all {bodies} movable objects move at once a tick is late here: fewer of them or a lower [loop] rate_hz leave it time"
        );
    }
    Ok(())
}

/// Said of a tour that has not come down to its object after so many seconds; of an object in
/// metres a unit only the station knows how high it begins.
fn short_tour(plan: &ScenePlan, seconds: f64) -> Option<String> {
    let mut probes = plan.probes.iter().enumerate();
    probes.find_map(|(index, probe)| {
        let TrajectoryPlan::Tour {
            object,
            speed_m_per_s,
            ..
        } = probe.trajectory
        else {
            return None;
        };
        let ModelScale::Size(size_m) = plan.objects[object].scale else {
            return None;
        };
        let length_m = speed_m_per_s * seconds;
        let height_m = hover_height(size_m, speed_m_per_s, probe.shape.tip_m());
        // Another device may be somewhere else.
        let ends_above = probe.custom_device.is_none() && length_m <= height_m;
        ends_above.then(|| {
            format!(
                "the tour of probe {index} goes {:.3} mm in {seconds} s and begins {:.3} mm above its object, so it touches nothing: make it faster (speed_m_per_s, --speed) or longer (--seconds)",
                1e3 * length_m,
                1e3 * height_m
            )
        })
    })
}

/// Said where a tick has no time for every probe near so many objects at once.
fn crowd(costs: WorkCosts, plan: &LoopPlan, load: TickLoad, objects: usize) -> Option<String> {
    let probes = load.pairs;
    let load = TickLoad {
        pairs: probes.map(|probes| probes * objects),
        ..load
    };
    let need = TickNeed::new(costs, 1.0 / plan.rate_hz, plan.operations, load);
    let us = |ns: f64| (1e-3 * ns).ceil();
    (need.least_ns > need.share_ns).then(|| {
        format!(
            "where {} probe(s) are near {objects} objects at once a tick takes {} of the {} us that it may work here, and is late: objects farther apart, fewer probes or a lower [loop] rate_hz leave it time",
            probes[0] + probes[1],
            us(need.least_ns),
            us(need.share_ns)
        )
    })
}

/// What a tick has no time for, and what to do.
fn short_of_time(need: &TickNeed, plan: &LoopPlan) -> String {
    let us = |ns: f64| (1e-3 * ns).ceil();
    let (rate_hz, operations) = (plan.rate_hz, plan.operations);
    if need.least_ns > need.share_ns {
        return format!(
            "at {rate_hz} Hz a tick may work for {} us here, and these probes and objects take {} us even without contact; use fewer of them, a lower [loop] rate_hz or a faster machine",
            us(need.share_ns),
            us(need.least_ns)
        );
    }
    format!(
        "at {rate_hz} Hz the contacts of these probes take {} of the {} us that a tick may work here, so there is time for {:.0} of {operations} splits a tick: full resolution up to {:.0} % of the usual speed, coarser beyond; a lower [loop] rate_hz gives more",
        us(need.contact_ns),
        us(need.share_ns),
        need.operations.floor(),
        100.0 * need.operations / operations as f64
    )
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
        assert_eq!(next_tick_core(&plan(Some(7), false)), Some(7));
        assert_eq!(next_tick_core(&plan(None, false)), None);
        let usable = usable_cores();
        match next_tick_core(&plan(None, true)) {
            Some(core) => assert!(usable.len() >= 2 && usable.contains(&core)),
            None => assert!(usable.len() < 2),
        }
    }

    #[test]
    fn a_core_that_another_controller_has_is_chosen_only_where_all_are_taken() {
        // Beyond any core, and others for every process.
        let first = 2_000_000 + 10 * std::process::id() as usize;
        let cores = [first, first + 1].map(|core| CoreLoad {
            core,
            per_minute: 0,
        });
        let chosen = || choose(&cores).map(|(of, claim)| (of.core - first, claim));
        let (core, claim) = chosen().expect("there are two");
        assert!(core == 0 && claim.is_some());
        // The other one is not claimed beside it.
        let (core, other) = chosen().expect("there are two");
        assert!(core == 1 && other.is_some());
        let (core, none) = chosen().expect("there are two");
        assert!(core == 0 && none.is_none());
        drop(other);
        let (core, again) = chosen().expect("there are two");
        assert!(core == 1 && again.is_some());
        assert!(choose(&[]).is_none());
    }

    #[test]
    fn the_only_core_is_claimed_once_too() {
        // Beyond any core, and another for every process.
        let core = 100_000_000 + std::process::id() as usize;
        let claim = claim_only(core);
        assert!(claim.is_some() && claim_only(core).is_none());
        drop(claim);
        assert!(claim_only(core).is_some());
    }

    #[test]
    fn a_tick_without_time_is_refused_and_one_that_is_short_is_told_with_the_remedy() {
        let plan = LoopPlan {
            rate_hz: 4000.0,
            ..plan(None, false)
        };
        let need = |slow| {
            let costs = WorkCosts::REFERENCE.scaled([slow; 4]);
            TickNeed::new(costs, 1.0 / plan.rate_hz, plan.operations, [0, 1])
        };
        let short = short_of_time(&need(2.0), &plan);
        assert!(
            short.contains("of 96 splits") && short.contains("rate_hz"),
            "{short}"
        );
        // What every tick does would just fit, but not with what it is allowed on any machine.
        let none = short_of_time(&need(19.0), &plan);
        assert!(none.contains("even without contact"), "{none}");
    }

    #[test]
    fn a_tour_that_ends_above_its_object_is_told() {
        let told = |size: &str, probe: &str, seconds| {
            let text = format!("[[object]]\nmodel = \"m.spm\"\n{size}\n[[probe]]\n{probe}\n");
            let none = scene::Overrides::default();
            let folder = std::path::Path::new("");
            let plan = scene::parse(&text, "s", folder, &none, &scene::NoFiles);
            short_tour(&plan.expect("a scene"), seconds)
        };
        let slow = "trajectory = { tour = { speed_m_per_s = 1e-4 } }";
        // Four radii of the ball of 1 mm; the share of 15 cm that a tour is high at the most.
        for (probe, seconds, millimetres) in [(slow, 39.0, "4.000 mm"), ("", 0.17, "18.000 mm")] {
            let said = told("size_m = 0.15", probe, seconds).expect("it touches nothing");
            assert!(said.contains(millimetres), "{said}");
        }
        assert_eq!(told("size_m = 0.15", slow, 41.0), None);
        assert_eq!(told("size_m = 0.15", "", 0.19), None);
        assert_eq!(told("metres_per_unit = 1", slow, 1.0), None);
    }

    #[test]
    fn no_tour_is_faster_than_the_station_lets_it_be() {
        let station = protocol::tour::FASTEST_SIDES_PER_S;
        assert_eq!(scene::MAX_TOUR_SIDES_PER_S, station);
    }

    #[test]
    fn too_many_objects_near_all_probes_are_told() {
        let costs = |slow| WorkCosts::REFERENCE.scaled([slow; 4]);
        let of = |slow, objects| crowd(costs(slow), &plan(None, false), [3, 1].into(), objects);
        assert_eq!(of(1.0, 9), None);
        assert_eq!(of(8.0, 1), None);
        let late = of(8.0, 9).expect("a millisecond does not suffice");
        assert!(late.contains("4 probe(s) are near 9 objects"), "{late}");
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
