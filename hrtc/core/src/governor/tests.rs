//! The law of the governor, on machines whose costs are right, wrong and changing.

use super::*;
use crate::tuning::streaming::MIN_UNITS;

/// Ticks that spend all they may on a machine whose costs are wrong by a factor.
fn run(governor: &mut Governor, factor: f64, ticks: usize) -> Vec<f64> {
    let mut times = Vec::with_capacity(ticks);
    for k in 0..ticks {
        governor.begin_tick([1, 0]);
        let faces = governor.time.faces(1.0);
        governor.time.set_refinement(faces, 0);
        governor.end_queries(k as u64, false, true);
        let spent = governor.time.spent.total();
        times.push(factor * spent);
        governor.note_work(factor * spent);
    }
    times
}

#[test]
fn a_slower_machine_gets_less_work_at_once_and_a_fast_one_more_within_a_second() {
    let mut governor = Governor::new(1e-3, 96);
    for factor in [1.0, 4.0, 1.5, 8.0, 0.8] {
        let times = run(&mut governor, factor, 3000);
        for (k, &ns) in times.iter().enumerate().skip(3) {
            assert!(ns <= 0.96e6, "factor {factor}: tick {k} took {ns} ns");
        }
        let last = times[2999];
        assert!(last >= 0.5 * TIME_SHARE * 1e6, "factor {factor}: {last}");
        let second = times[1000];
        assert!(second >= 0.9 * last, "factor {factor}: {second} {last}");
    }
}

#[test]
fn what_probes_need_grows_with_them_and_leaves_less_time_for_splits() {
    let need = |slow: f64, period_s: f64, probes: [usize; 2]| {
        let costs = WorkCosts::REFERENCE.scaled([slow; 4]);
        TickNeed::new(costs, period_s, 96, probes)
    };
    let ball = need(1.0, 1e-3, [1, 0]);
    assert_eq!(ball.operations, 96.0);
    assert!(ball.least_ns < ball.contact_ns && ball.contact_ns < 0.1 * ball.share_ns);
    let tool = need(4.0, 1e-3, [0, 1]);
    assert!(tool.contact_ns > 4.0 * ball.contact_ns && tool.operations < 96.0);
    let fast = need(4.0, 2.5e-4, [0, 1]);
    assert!(fast.contact_ns > fast.share_ns && fast.operations < tool.operations);
    // What every tick does would fit, but not what a tick is allowed on any machine beside it.
    let late = need(19.0, 2.5e-4, [1, 0]);
    let costs = WorkCosts::REFERENCE.scaled([19.0; 4]);
    let every_tick = costs.tick + costs.prediction + costs.contact;
    assert!(every_tick < late.share_ns && late.least_ns > 2.5e5);
    // One collapse has time in any tick, as much as one or two usual splits take.
    let least = need(16.0, 2.5e-4, [4, 0]).operations;
    assert!((1.0..2.0).contains(&least), "{least}");
}

/// 4096 objects and four probes, all bodies after a stall, and all pairs, on any machine.
#[test]
fn what_a_tick_does_in_any_case_is_charged_and_allowed() {
    for slow in [1.0, 8.0, 64.0] {
        let mut governor = Governor::new(1e-3, 96);
        let costs = WorkCosts::REFERENCE.scaled([slow; 4]);
        governor.set_costs(costs);
        let load = TickLoad::new([3, 1], 4096, 4, 128);
        assert_eq!(TickLoad::new([3, 1], 1, 4, 0), TickLoad::from([3, 1]));
        let fixed = |governor: &mut Governor, load: TickLoad| {
            governor.begin_tick(load);
            governor.spent().total()
        };
        let without = fixed(&mut governor, TickLoad::from([3, 1]));
        let with = fixed(&mut governor, load);
        let due = 4.0 * 4096.0 * costs.box_test + 128.0 * costs.body;
        assert!(((with - without) / due - 1.0).abs() < 1e-9, "{slow}");
        let operations = governor.operations();
        let more = TickLoad {
            pairs: [27, 9],
            body_steps: 600,
            entries: 40,
            ..load
        };
        governor.set_load(&more);
        let now = governor.spent().total();
        let pair = costs.prediction + costs.contact;
        let due = 32.0 * pair + 472.0 * costs.body + 40.0 * costs.entry;
        assert!(((now - with) / due - 1.0).abs() < 1e-9, "{slow}");
        assert!(now <= governor.time.allowed(), "{slow}");
        assert_eq!(governor.operations(), operations);
        // It takes the time of everything else.
        let needs = |load: TickLoad| TickNeed::new(costs, 1e-3, 96, load);
        let (few, many) = (needs(TickLoad::from([3, 1])), needs(load));
        assert!(many.least_ns > few.least_ns && many.operations <= few.operations);
        assert!(slow != 8.0 || many.operations < few.operations);
    }
}

/// Sixteen tools on a machine that is eight times slower.
#[test]
fn where_no_time_is_left_some_upkeep_goes_on_and_is_allowed() {
    let mut governor = Governor::new(1e-3, 96);
    let costs = WorkCosts::REFERENCE.scaled([8.0; 4]);
    governor.set_costs(costs);
    governor.share = MIN_TIME_SHARE;
    let load = TickLoad::from([0, 16]);
    governor.begin_tick(load);
    let need = governor.spent().total() + governor.least_ns(16.0);
    assert_eq!(governor.time.allowed(), need);
    governor.time.charge_inbox(MIN_UNITS, 1);
    assert_eq!(governor.time.for_refinement(), 0.0);
    let upkeep = governor.time.upkeep();
    assert_eq!(upkeep, MIN_UPKEEP);
    governor.time.set_refinement(0, upkeep / CHANGES_PER_UNIT);
    let left = f64::from(governor.time.for_queries());
    assert!(left + 1.0 >= 16.0 * costs.least_search(), "{left}");
}

/// A place that is too fine for some milliseconds, and one tick that was interrupted.
#[test]
fn less_is_asked_for_after_the_same_time_at_every_rate() {
    for (rate_hz, ticks) in [
        (250.0, 2),
        (500.0, 2),
        (1000.0, 3),
        (2000.0, 6),
        (4000.0, 12),
    ] {
        let mut governor = Governor::new(1.0 / rate_hz, 96);
        for tick in 1..=ticks {
            assert_eq!(governor.steps(), 0, "{rate_hz} Hz: {tick}");
            governor.begin_tick([1, 0]);
            governor.end_queries(tick, true, true);
        }
        assert_eq!(governor.steps(), 1, "{rate_hz} Hz");
    }
}

/// A longer period has as many looks as ticks of a millisecond in it.
#[test]
fn prediction_is_charged_by_its_looks() {
    let costs = WorkCosts::REFERENCE;
    let inbox = |period_s: f64| {
        let mut governor = Governor::new(period_s, 96);
        governor.set_load(&TickLoad::from([1, 1]));
        governor.spent().by_group[CostGroup::Inbox as usize]
    };
    for (period_s, looks) in [(2.5e-4, 1.0), (1e-3, 1.0), (4e-3, 4.0), (1e-2, 10.0)] {
        let due = 2.0 * looks * costs.prediction;
        assert_eq!(inbox(period_s), due, "{period_s}");
    }
}

#[test]
fn one_long_tick_changes_nothing_and_two_do() {
    let mut governor = Governor::new(1e-3, 96);
    run(&mut governor, 1.0, 10);
    governor.note_work(5e6);
    assert!((governor.slowness() - 1.0).abs() < 0.01);
    governor.note_work(5e6);
    assert!(governor.slowness() > 2.0);
}

#[test]
fn late_ticks_take_time_off_and_it_comes_back() {
    let mut governor = Governor::new(1e-3, 96);
    let mut run = |ticks: usize, every: usize| {
        for k in 0..ticks {
            governor.begin_tick([1, 0]);
            governor.time.set_refinement(governor.time.faces(1.0), 0);
            governor.end_queries(k as u64, false, true);
            let spent = governor.time.spent.total();
            let is_late = k % every == every - 1;
            governor.note_work(if is_late { 0.85e6 } else { spent });
        }
        governor.share
    };
    let share = run(999, 1000);
    assert!(share == TIME_SHARE, "{share}");
    // One late tick takes its part; one in twenty, all that may be taken.
    let once = run(1, 1);
    assert!(once == TIME_SHARE * (1.0 - LATE_CUT), "{once}");
    assert!(run(4000, 20) < 1.05 * MIN_TIME_SHARE);
    let back = run(8000, usize::MAX);
    assert!(back > 0.95 * TIME_SHARE, "{back}");
}

#[test]
fn steps_are_taken_where_they_change_something_and_go_back_when_the_machine_is_fast_again() {
    let mut governor = Governor::new(1e-3, 96);
    let mut tick = 0;
    let mut run = |factor: f64, most: u32, seconds: u64| {
        for _ in 0..seconds * 1000 {
            tick += 1;
            governor.begin_tick([1, 0]);
            // A contact that takes all there is on a slow machine, half of it on a fast one.
            let ns = governor.time.allowed().min(0.35e6);
            governor.time.charge_queries(ns as u32);
            let is_cut = governor.time.allowed() < 0.35e6;
            let can_ask_for_less = governor.steps() < most;
            governor.end_queries(tick, is_cut, can_ask_for_less);
            governor.note_work(factor * governor.time.spent.total());
        }
        governor.steps()
    };
    assert_eq!(run(1.0, 5, 1), 0);
    assert_eq!(run(8.0, 5, 14), 5, "no more than change something");
    assert_eq!(
        run(1.0, 5, 1),
        0,
        "a second later all of it is asked for again"
    );
}

#[test]
fn at_constant_load_the_operations_do_not_hunt() {
    let mut governor = Governor::new(1e-3, 96);
    governor.set_costs(WorkCosts::REFERENCE.scaled([6.0; 4]));
    let mut before = [0.0; 2];
    let mut turns = 0;
    for k in 0..5000 {
        governor.begin_tick([1, 0]);
        // Contacts whose work comes and goes.
        let units = if k % 50 < 10 { 900 } else { 100 };
        let ns = f64::from(units) * governor.costs.ball;
        governor.time.charge_queries(ns as u32);
        governor.end_queries(k as u64, false, true);
        governor.note_work(governor.time.spent.total());
        let now = governor.operations();
        if k > 1000 {
            let changed = (now - before[1]) * (before[1] - before[0]) < 0.0;
            let far = (now / before[1]).max(before[1] / now) > 1.25;
            turns += u32::from(changed && far);
        }
        before = [before[1], now];
    }
    assert_eq!(turns, 0);
}

/// A driver that takes a third of the period is no slow machine, and what it takes is not there
/// for the core.
#[test]
fn the_time_of_drivers_is_taken_off_and_says_nothing_of_the_machine() {
    let mut governor = Governor::new(1e-3, 96);
    let mut run = |device_ns: f64, factor: f64, ticks: usize| {
        let mut longest = 0.0f64;
        for k in 0..ticks {
            governor.begin_tick([1, 0]);
            // A long tick, and nine short ones.
            let share = if k % 10 == 0 { 1.0 } else { 0.0 };
            governor.time.set_refinement(governor.time.faces(share), 0);
            governor.end_queries(k as u64, false, true);
            let took = factor * governor.time.spent.total();
            longest = longest.max(took + device_ns);
            governor.note_devices(device_ns);
            governor.note_work(took);
        }
        (governor.slowness(), governor.time.allowed(), longest)
    };
    let (slowness, without, _) = run(0.0, 1.0, 100);
    assert!((slowness - 1.0).abs() < 1e-9);
    run(0.3e6, 1.0, 2);
    let (slowness, with, longest) = run(0.3e6, 1.0, 1000);
    assert!((slowness - 1.0).abs() < 1e-9, "{slowness}");
    let taken_off = (without - with) / 0.3e6;
    assert!((0.98..=1.0).contains(&taken_off), "{without} {with}");
    assert!(longest <= 1.01 * TIME_SHARE * 1e6, "{longest}");
    run(0.3e6, 2.0, 1000);
    let (slowness, _, longest) = run(0.3e6, 2.0, 1000);
    assert!((1.9..=2.0).contains(&slowness), "{slowness}");
    let share = longest / (TIME_SHARE * 1e6);
    assert!((0.9..=1.05).contains(&share), "{share}");
    // One long read changes nothing; a driver that is fast again gives its time back.
    run(0.0, 2.0, 3000);
    run(5e6, 2.0, 1);
    run(0.0, 2.0, 2);
    assert!(governor.device_ns() < 100.0, "{}", governor.device_ns());
}

#[test]
fn what_is_no_time_changes_nothing() {
    let mut governor = Governor::new(1e-3, 96);
    let costs = *governor.costs();
    governor.set_costs(WorkCosts {
        face: f64::NAN,
        ..costs
    });
    assert_eq!(*governor.costs(), costs);
    governor.begin_tick([1, 0]);
    governor.note_work(f64::NAN);
    assert!(governor.slowness() == 1.0);
}

/// A device of 100 Hz, whose driver is slow in every tenth tick; and reads that time out.
#[test]
fn a_driver_that_is_slow_now_and_then_has_its_time_and_one_that_hangs_no_more_than_there_is() {
    let mut governor = Governor::new(1e-3, 96);
    for k in 0..1000 {
        governor.note_devices(if k % 10 == 0 { 0.3e6 } else { 0.0 });
        let device_ns = governor.device_ns();
        assert!(
            k < 11 || (0.8..=1.0).contains(&(device_ns / 0.3e6)),
            "{k}: {device_ns}"
        );
    }
    governor.note_devices(2.5e8);
    governor.note_devices(2.5e8);
    governor.begin_tick([1, 0]);
    assert!(governor.device_ns() == governor.share_ns() && governor.time.allowed() > 0.0);
    for _ in 0..150 {
        governor.note_devices(0.0);
    }
    let left = governor.device_ns() / governor.share_ns();
    assert!(left < 0.5, "{left}");
}

/// What the constants were chosen for, at any rate.
#[test]
fn one_late_tick_a_second_leaves_the_share_at_its_middle_whatever_the_rate() {
    for rate_hz in [100u32, 1000, 4000] {
        let period_s = 1.0 / f64::from(rate_hz);
        let mut governor = Governor::new(period_s, 96);
        let mut sum = 0.0;
        for k in 0..60 * rate_hz {
            governor.begin_tick([1, 0]);
            governor.time.set_refinement(governor.time.faces(1.0), 0);
            governor.end_queries(u64::from(k), false, true);
            let is_late = k % rate_hz == rate_hz - 1;
            let spent = governor.time.spent.total();
            governor.note_work(if is_late { 0.85e9 * period_s } else { spent });
            if k >= 30 * rate_hz {
                sum += governor.time_share();
            }
        }
        let mean = sum / f64::from(30 * rate_hz);
        assert!((0.56..=0.62).contains(&mean), "{rate_hz} Hz: {mean}");
    }
}

/// The share after a tick that took 0.4 ms beside the drivers; `is_said`: as the costs say.
fn share_after(device_ns: f64, is_said: bool) -> f64 {
    let mut governor = Governor::new(1e-3, 96);
    run(&mut governor, 1.0, 10);
    governor.begin_tick([1, 0]);
    let mut work_ns = 0.4e6;
    if is_said {
        let left = work_ns - governor.spent().total();
        governor.time.charge_queries(left as u32);
        work_ns = governor.spent().total();
    }
    governor.note_devices(device_ns);
    governor.note_work(work_ns);
    governor.time_share()
}

#[test]
fn drivers_make_a_tick_late_and_what_the_costs_say_does_not() {
    assert_eq!(share_after(0.5e6, false), TIME_SHARE * (1.0 - LATE_CUT));
    assert_eq!(share_after(0.3e6, false), TIME_SHARE);
    assert_eq!(share_after(0.5e6, true), TIME_SHARE);
}

#[test]
fn of_late_ticks_in_a_row_the_first_counts() {
    for times in [[0.85e6, 0.86e6, 0.87e6], [0.85e6; 3]] {
        let mut governor = Governor::new(1e-3, 96);
        run(&mut governor, 1.0, 10);
        for ns in times {
            governor.begin_tick([1, 0]);
            governor.note_work(ns);
        }
        // A little of it is back.
        let share = governor.time_share() / (TIME_SHARE * (1.0 - LATE_CUT));
        assert!((1.0..1.001).contains(&share), "{times:?}: {share}");
    }
}

#[test]
fn what_a_pair_costs_beside_its_queries_is_kept_once() {
    let mut governor = Governor::new(1e-3, 96);
    governor.begin_tick([0, 1]);
    for ns in [120_000, 80_000] {
        governor.time.charge_queries(ns);
    }
    let taken = governor.spent().by_group[CostGroup::Query as usize];
    assert_eq!(taken, 200_000.0 + governor.costs.contact);
    governor.end_queries(0, false, true);
    governor.begin_tick([0, 1]);
    assert_eq!(governor.time.contacts, 200_000.0);
}
