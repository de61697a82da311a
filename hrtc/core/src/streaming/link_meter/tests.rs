//! What is measured of links near and far, fast and thin, and of those that stall.

use super::*;

fn meter() -> LinkMeter {
    LinkMeter::new(&Horizons::new(1000.0))
}

/// Of a chunk that was sent at a tick, for which it had waited for its credit.
fn sent(tick: u64) -> Option<[Sent; 2]> {
    let sent = Sent {
        station: 1,
        // Any start of its clock, so that it wraps.
        clock_us: ((1000 * tick) as u32).wrapping_sub(20_000),
        waited_for_credit: true,
    };
    Some([sent; 2])
}

/// A meter after answers of `round_trip` ticks, and a chunk every `gap` ticks of an answer that
/// is on its way.
fn after(round_trip: u64, gap: u64) -> LinkMeter {
    let mut meter = meter();
    for k in 0..200 {
        meter.answered(round_trip, k);
        // Four are on the link at a time.
        meter.arrive(1, sent(1000 + k.saturating_sub(3) * gap), 1100 + k * gap);
        meter.leave(0);
    }
    meter
}

#[test]
fn a_local_link_is_as_if_nothing_was_measured() {
    let (new, mut local) = (meter(), meter());
    for tick in 0..10_000 {
        local.answered(4, tick);
    }
    for of in [&new, &local] {
        assert_eq!((of.window(), of.lead()), (CREDIT_CHUNKS, 0.0));
        assert_eq!((of.most_questions(), of.request_ticks()), (32, 0));
        assert!(!of.comes_late(31, 0.0) && of.questions_in_transit() > 32);
    }
    assert_eq!((new.timeout(0), local.timeout(0)), (200, 200));
    assert_eq!(local.timeout(2), 800);
    let mut far = meter();
    far.station_is_far();
    assert_eq!((far.timeout(0), far.timeout(1)), (1000, 2000));
    far.answered(4, 0);
    assert_eq!(far.timeout(0), 300, "what TCP repeats is not lost");
    assert!(new.round_trip_s() < 0.0 && new.bytes_per_s() < 0.0);
    assert!((local.round_trip_s() - 0.004).abs() < 1e-9);
}

#[test]
fn the_window_of_a_far_station_doubles_in_a_round_trip() {
    let mut meter = meter();
    assert_eq!(meter.window(), CREDIT_CHUNKS);
    meter.station_is_far();
    meter.answered(200, 0);
    let mut windows = Vec::new();
    for round_trip in 1..6 {
        let window = meter.window();
        meter.arrive(window as usize, sent(200 * round_trip), 200 * round_trip);
        meter.leave(0);
        windows.push(window);
    }
    assert_eq!(windows, [8, 16, 32, 64, 64]);
}

#[test]
fn a_timeout_is_longer_than_every_answer_of_late() {
    for round_trip in [100, 300, 1000] {
        let mut meter = meter();
        for tick in 0..1000 {
            let ticks = round_trip + 40 * (tick % 5);
            if tick > 100 {
                assert!(meter.timeout(0) > ticks);
            }
            meter.answered(ticks, tick);
        }
    }
}

#[test]
fn a_thin_line_carries_little_at_once() {
    let thin = after(30, 16);
    let chunk = size_of::<InboxChunk>() as f64;
    assert!((thin.bytes_per_s() / (chunk * 1000.0 / 16.0) - 1.0).abs() < 1e-3);
    assert!((MIN_WINDOW..8).contains(&thin.window()));
    assert!(thin.request_ticks() > 4);
    // Farther away, more is under way at the same rate.
    let far = after(300, 16);
    assert!(far.window() > 3 * thin.window() && far.lead() > thin.lead());
    assert!(far.most_questions() > thin.most_questions());
    // An answer takes the round trip and its own chunks, and those of the answers before it.
    assert!(thin.comes_late(1, 61.0) && !thin.comes_late(1, 63.0));
    assert!(far.comes_late(3, 363.0) && !far.comes_late(3, 365.0));
    // The distance alone is no reason.
    assert!(!far.comes_late(0, 0.0) && !after(300, 1).comes_late(20, 0.0));
}

#[test]
fn nothing_is_late_on_a_link_that_was_slow_only_at_first() {
    let mut link = after(200, 16);
    assert!(link.comes_late(10, 200.0));
    // What is asked for now comes without waiting, though the rate that was seen is still low.
    for k in 0..16 {
        let tick = 10_000 + 100 * k;
        link.arrive(1, sent(tick - 100), tick);
        link.leave(0);
    }
    assert!(link.transfer_ticks(10) > 30.0);
    assert!(!link.comes_late(10, 200.0));
}

#[test]
fn what_the_station_sends_at_its_own_pace_says_nothing_about_the_rate() {
    for jitter in [0, 3] {
        let mut meter = meter();
        meter.answered(100, 0);
        for k in 1..1000 {
            let is_late = k % 2 == 0;
            let delay = 100 + if is_late { jitter } else { 0 };
            meter.arrive(1, sent(7 * k), 7 * k + delay);
            meter.leave(0);
        }
        assert!(meter.bytes_per_s() < 0.0);
    }
}

#[test]
fn another_station_has_another_clock() {
    let mut meter = meter();
    for k in 1..1000 {
        let station = 1 + k / 100;
        let began_us = station as u32 * 0x1234_5678;
        let of = sent(7 * k).map(|of| {
            of.map(|of| Sent {
                station,
                clock_us: of.clock_us.wrapping_add(began_us),
                ..of
            })
        });
        meter.arrive(1, of, 7 * k + 100);
        meter.leave(0);
    }
    assert!(meter.bytes_per_s() < 0.0);
}

/// Round trips until as much may be under way again as before a time of stalls, where what is
/// allowed arrives in bursts of so many.
fn recovery(burst: u64) -> u64 {
    let mut meter = after(200, 1);
    let before = meter.window();
    let mut tick = 10_000;
    while meter.window() > 2 * MIN_WINDOW {
        assert!(tick < 1_000_000, "the link looks thin");
        // It stalls for longer and longer.
        meter.arrive(1, sent(tick - 250 - tick / 4), tick);
        meter.leave(0);
        tick += 200;
    }
    for round_trips in 0..1000 {
        if meter.window() >= before {
            return round_trips;
        }
        let allowed = tick;
        tick += 200;
        for burst in (0..meter.window().div_ceil(burst)).map(|_| burst) {
            meter.arrive(burst as usize, sent(allowed), tick);
            meter.leave(0);
            tick += 1;
        }
    }
    panic!("{} chunks for ever", meter.window());
}

#[test]
fn a_link_that_stalled_is_not_taken_for_a_thin_one() {
    for burst in [1, 2, 4] {
        let round_trips = recovery(burst);
        println!("in bursts of {burst}: {round_trips} round trips");
        assert!(round_trips < 60);
    }
}

/// The controller stalls for 300 periods, in which link and station go on.
#[test]
fn what_comes_in_a_stall_of_ours_says_nothing_of_the_link() {
    const STALL: u64 = 300;
    for (round_trip, gap) in [(200, 1), (30, 16), (30, 40)] {
        let mut meter = after(round_trip, gap);
        let measured = |of: &LinkMeter| (of.lead(), of.bytes_per_s(), of.round_trip_ticks());
        let before = measured(&meter);
        let last = 1100 + 199 * gap;
        // As many as wait by then; the first of them came right after the last tick.
        let came = STALL / gap;
        let ends = [200, 199 + came].map(|k| sent(1000 + (k - 3) * gap));
        let ends = ends.map(|of| {
            of.expect("it is one").map(|of| Sent {
                waited_for_credit: false,
                ..of
            })
        });
        meter.begin_tick(STALL);
        assert_eq!(meter.clock(last + 1), last + 1 + STALL);
        meter.arrive(came as usize, Some([ends[0][0], ends[1][0]]), last + 1);
        meter.leave(0);
        // Asked 10 ticks before the stall; when in it the answer came is not known.
        meter.answered(10 + STALL, last + 1);
        assert_eq!(measured(&meter), before, "{round_trip} {gap}");
        // From then on it counts again.
        meter.begin_tick(0);
        meter.answered(round_trip + 80, last + 2);
        assert!(meter.round_trip_ticks() > before.2, "{round_trip} {gap}");
    }
}

/// A controller that runs every other period only sees the link as it is.
#[test]
fn a_link_is_measured_where_every_other_period_is_skipped() {
    let (mut meter, mut arrived) = (meter(), 0_u64);
    for k in 0..400_u64 {
        meter.begin_tick(u64::from(k > 0));
        let now = meter.clock(1000 + k);
        assert_eq!(now, 1000 + 2 * k);
        meter.answered(200, 1000 + k);
        // A chunk every 16 periods, at last four of them on the link.
        if now.is_multiple_of(16) {
            let queued = 16 * arrived.min(3);
            meter.arrive(1, sent(now - 100 - queued), 1000 + k);
            arrived += 1;
        }
        meter.leave(0);
    }
    let due = size_of::<InboxChunk>() as f64 * 1000.0 / 16.0;
    assert!((meter.bytes_per_s() / due - 1.0).abs() < 1e-3);
    assert_eq!(meter.round_trip_ticks(), 200);
}

#[test]
fn the_shortest_round_trip_follows_a_link_that_changes() {
    let mut meter = meter();
    meter.answered(20, 0);
    for tick in (0..30_000).step_by(100) {
        meter.answered(120, tick);
    }
    assert!((meter.lead() - 90.0).abs() < 1e-9, "{}", meter.lead());
}
