use super::*;
use crate::tick_record::{STAGES, TickRecord};
use glam::DVec3;
use hrtc_core::record::{CoreRecord, ProbeRecord};
use realtime::pacer::{Miss, MissClass};

fn record(tick: u64) -> TickRecord {
    TickRecord {
        tick,
        planned_ns: 5_000_000 + 1_000_000 * tick,
        start_ns: 5_010_000 + 1_000_000 * tick,
        skipped: 0,
        misses: [Miss::default(); 2],
        wake_ns: 10_000,
        period_ns: 1_000_000,
        work_cpu_ns: 20_000,
        work_wall_ns: 25_000,
        stage_ns: [1_000, 2_000, 3_000, 4_000, 5_000, 6_000],
        page_faults: 0,
        allocations: 0,
        chunks_arrived: 0,
        station: 1,
        core: CoreRecord {
            measured_error_m: -1.0,
            ..CoreRecord::default()
        },
        ..TickRecord::default()
    }
}

fn accumulator() -> Accumulator {
    Accumulator::new(1_000_000, 2)
}

/// Values without order, 1000 of them to a decade.
fn scrambled(index: u64) -> u64 {
    index.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40
}

#[test]
fn percentiles_equal_the_sorted_values_within_the_histograms_resolution() {
    let mut run = accumulator();
    let mut exact: Vec<u64> = Vec::new();
    for tick in 0..10_000 {
        let ns = 1 + scrambled(tick + 1);
        exact.push(ns);
        run.push(&TickRecord {
            wake_ns: ns as u32,
            work_cpu_ns: ns as u32,
            ..record(tick)
        });
    }
    exact.sort_unstable();
    let finished = run.finish(RunMeta::default());
    let spread = finished.result.wake_us;
    for (q, measured) in [
        (0.5, spread.p50),
        (0.99, spread.p99),
        (0.999, spread.p999),
        (1.0, spread.max),
    ] {
        let rank = ((q * 10_000.0_f64).ceil() as usize).max(1) - 1;
        let wanted = exact[rank] as f64 / 1e3;
        assert!(
            (measured - wanted).abs() <= 1e-3 * wanted + 1e-3,
            "p{q}: {measured} µs, sorted {wanted} µs"
        );
    }
    assert_eq!(
        spread.max,
        exact[9_999] as f64 / 1e3,
        "the maximum is exact"
    );
    let counted: u64 = finished.histograms.wake_ns.iter().map(|b| b.1).sum();
    assert_eq!(counted, 10_000);
    assert!(finished.histograms.wake_ns.is_sorted());
}

#[test]
fn missed_periods_are_counted_once_and_by_their_reason() {
    let mut run = accumulator();
    let miss = |class, periods| Miss { class, periods };
    // What the work used up, then what the sleep lost: neither stands in for the other.
    let misses = [
        [Miss::default(), Miss::default()],
        [miss(MissClass::OwnCpu, 2), miss(MissClass::RunQueue, 3)],
        [miss(MissClass::OwnWait, 13), miss(MissClass::LateTimer, 5)],
        [miss(MissClass::Stolen, 7), miss(MissClass::Stopped, 17)],
        [miss(MissClass::Unexplained, 11), Miss::default()],
    ];
    let mut tick = 0;
    for misses in misses {
        let skipped = misses[0].periods + misses[1].periods;
        tick += u64::from(skipped);
        run.push(&TickRecord {
            misses,
            skipped,
            planned_ns: record(tick - u64::from(misses[1].periods)).planned_ns,
            ..record(tick)
        });
        tick += 1;
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!((result.drift_ns_max, result.unaccounted_periods), (0, 0));
    assert_eq!((result.ticks, result.missed), (5, 58));
    assert_eq!(result.misses.total(), result.missed);
    let Misses {
        own_cpu,
        own_wait,
        run_queue,
        late_timer,
        stopped,
        stolen,
        unexplained,
    } = result.misses;
    assert_eq!((own_cpu, own_wait, result.missed_own_cpu), (2, 13, 15));
    assert_eq!((run_queue, late_timer, stopped), (3, 5, 17));
    assert_eq!((stolen, unexplained), (7, 11));
    assert!((result.seconds - 0.063).abs() < 1e-12, "{}", result.seconds);
}

#[test]
fn a_force_that_expired_comes_back_from_zero() {
    let mut run = accumulator();
    // A stall of 300 periods: zero is written in the tick after it, and the ramp follows.
    for (tick, skipped, newtons) in [(0, 0, 0.5), (1, 0, 1.5), (302, 300, 0.0), (303, 0, 0.01)] {
        let mut record = record(tick);
        record.skipped = skipped;
        record.force_cut = skipped > 0;
        record.rises_again = tick >= 302;
        record.wrenches[1].force.y = newtons;
        run.push(&record);
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!(
        (result.force_step_n_max, result.force_cut_n_max),
        (1.0, 1.5)
    );
}

#[test]
fn a_force_step_over_skipped_periods_is_one_of_several() {
    let mut run = accumulator();
    for (tick, skipped, newtons) in [(0, 0, 0.0), (1, 0, 0.2), (4, 2, 0.9), (5, 0, 1.0)] {
        let mut record = record(tick);
        record.skipped = skipped;
        record.wrenches[1].force.y = newtons;
        run.push(&record);
    }
    let result = run.finish(RunMeta::default()).result;
    assert!((result.force_step_n_max - 0.7).abs() < 1e-12);
    assert!((result.force_step_per_period_n_max - 0.7 / 3.0).abs() < 1e-12);
}

#[test]
fn there_is_no_force_step_over_records_that_are_missing() {
    let mut run = accumulator();
    // Tick 2 is lost, and ticks 5 and 6 beside a skipped period.
    let ticks = [(0, 0), (1, 0), (3, 0), (4, 0), (8, 1)];
    for ((tick, skipped), newtons) in ticks.into_iter().zip([0.1, 0.2, 0.9, 1.2, 5.0]) {
        let mut record = record(tick);
        record.skipped = skipped;
        record.wrenches[1].force.y = newtons;
        run.push(&record);
    }
    let result = run.finish(RunMeta::default()).result;
    assert!((result.force_step_n_max - 0.3).abs() < 1e-12, "{result:?}");
    assert_eq!(result.force_step_per_period_n_max, result.force_step_n_max);
}

#[test]
fn a_tick_off_its_phase_and_a_lost_record_are_seen() {
    // Planned late by so much, or begun in the period before or after.
    let mut late = record(7);
    late.planned_ns += 3;
    let mut early = record(7);
    early.start_ns = early.planned_ns - 4;
    let mut next = record(7);
    next.start_ns = next.planned_ns + 1_000_005;
    for (odd, drift) in [(late, 3), (early, 4), (next, 6)] {
        let mut run = accumulator();
        for tick in 0..10 {
            run.push(&if tick == 7 { odd } else { record(tick) });
        }
        let result = run.finish(RunMeta::default()).result;
        assert_eq!(
            (result.drift_ns_max, result.unaccounted_periods),
            (drift, 0)
        );
    }
    let mut run = accumulator();
    for tick in (0..10).filter(|&tick| tick != 4) {
        run.push(&record(tick));
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!((result.drift_ns_max, result.unaccounted_periods), (0, 1));
}

#[test]
fn waits_beside_the_timer_and_the_work_of_queries_are_added_up() {
    let mut run = accumulator();
    for (tick, (extra_switches, query_work)) in (0..).zip([(0, 3), (2, 900), (1, 20)]) {
        let mut record = TickRecord {
            extra_switches,
            spun_ns: 40_000,
            ..record(tick)
        };
        record.core.query_work = query_work;
        run.push(&record);
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!((result.extra_switches, result.query_work_max), (3, 900));
    assert_eq!(result.spun_us_mean, 40.0);
}

#[test]
fn the_live_status_says_what_is_not_finite() {
    let mut run = accumulator();
    let mut record = record(0);
    record.wrenches[1].force = DVec3::new(0.0, f64::NAN, 0.0);
    record.wrenches[0].force = DVec3::X;
    record.core.certified_error_m = f64::INFINITY;
    record.core.measured_error_m = f64::NAN;
    run.push(&record);
    let status = run.status();
    assert!(status.force_n.is_nan() && status.measured_error_m.is_nan());
    assert_eq!(status.certified_error_m, f64::INFINITY);
    let text = serde_json::to_string(&SupervisedLine::Status { status }).unwrap();
    assert!(text.contains("\"force_n\":\"NaN\""), "{text}");
    let SupervisedLine::Status { status: again } = serde_json::from_str(&text).unwrap() else {
        panic!("{text}");
    };
    assert!(again.force_n.is_nan());
    assert_eq!(again.certified_error_m, f64::INFINITY);
}

#[test]
fn the_contact_is_accounted_from_its_first_tick() {
    let mut run = accumulator();
    for tick in 0..10_u64 {
        let contact = tick >= 4;
        // Not even the coarsest ring: neither a bound nor an expected error.
        let is_bounded = tick != 6;
        let certified_error_m = if is_bounded {
            1e-4 * tick as f64
        } else {
            f64::NAN
        };
        let mut record = record(tick);
        record.core = CoreRecord {
            contact,
            contact_full: tick >= 6,
            contact_bounded: is_bounded,
            contact_tolerance_m: if tick >= 5 { -1.0 } else { 1e-5 },
            certified_error_m,
            measured_error_m: if tick == 7 { 2e-5 } else { -1.0 },
            bytes_received: 100 * tick,
            active_faces: 50 + tick as u32,
            ready: tick >= 2,
            energy_j: -0.5,
            vsplits: 3,
            // The last tick is of the soft end.
            stopping: tick == 9,
            force_withheld: if tick == 9 { 1.0 } else { 0.25 },
            replay_hash: u64::MAX,
            cache_bytes: 1000 - tick,
            ..record.core
        };
        record.core.probes[1] = ProbeRecord {
            contact,
            contact_full: tick >= 6,
            contact_bounded: is_bounded,
            certified_error_m,
            ..ProbeRecord::default()
        };
        record.wrenches[1].force = DVec3::new(0.0, 0.0, if contact { 2.0 } else { 0.0 });
        record.station = u64::from(tick >= 1);
        run.push(&record);
    }
    assert!(run.status().contact && run.status().station);
    let meta = RunMeta {
        start_to_first_tick_ms: 40.0,
        cache_bytes: 4096,
        ..RunMeta::default()
    };
    let result = run.finish(meta).result;
    assert_eq!(result.contact_ticks, 6);
    assert_eq!(result.contact_full_ticks, 4);
    assert_eq!(result.contact_unbounded_ticks, 1);
    assert_eq!(result.non_finite, [""; 0]);
    assert_eq!(result.bytes_to_first_touch, 400);
    assert_eq!(result.measured_errors, 1);
    assert!((result.measured_error_m.max - 2e-5).abs() < 1e-12);
    assert!((result.certified_error_m.max - 9e-4).abs() < 1e-12);
    assert!((result.expected_error_m.max - 9e-4).abs() < 1e-12);
    assert!((result.force_withheld.max - 0.25).abs() < 1e-5);
    assert_eq!(result.force_step_n_max, 2.0);
    assert!((result.force_n.p50 - 2.0).abs() < 2e-3);
    assert_eq!(result.energy_j, -0.5);
    let [idle, touching] = &result.probes[..] else {
        panic!("there are two probes");
    };
    assert_eq!((idle.contact_ticks, idle.force_n.max), (0, 0.0));
    assert_eq!(
        (touching.contact_ticks, touching.contact_full_ticks),
        (6, 4)
    );
    assert_eq!(touching.force_n, result.force_n);
    assert_eq!(touching.certified_error_m_max, 1e-4 * 9.0);
    assert_eq!(result.vsplits, 30);
    assert_eq!(result.cache.high_water_bytes, 1000);
    assert_eq!(result.cache.bytes, 4096);
    assert_eq!(result.first_heard_ms, 41.0);
    assert_eq!(result.first_force_ready_ms, 42.0);
    assert_eq!((result.first_touch_ms, result.first_full_ms), (44.0, 2.0));
    assert_eq!(result.refined_faces.max, 59.0);
    assert!(result.replay_hash < 1 << 53);
}

#[test]
fn a_contact_without_a_bound_has_none_in_the_series() {
    let mut run = accumulator();
    for tick in 0..3 {
        let mut record = record(tick);
        record.core.contact = tick > 0;
        record.core.contact_bounded = tick == 2;
        record.core.certified_error_m = 3e-6 * tick as f64;
        run.push(&record);
    }
    let series = run.finish(RunMeta::default()).series;
    let bounds: Vec<f64> = series.iter().map(|of| of.certified_error_m).collect();
    assert_eq!(bounds, [-1.0, -1.0, 6e-6]);
}

#[test]
fn a_series_of_any_length_stays_bounded_and_loses_no_tick() {
    for length in [1_u64, 1999, 2000, 2001, 123_457] {
        let mut run = accumulator();
        for tick in 0..length {
            let mut record = record(tick);
            record.core.contact = tick % 3 == 0;
            record.work_cpu_ns = if tick == length / 2 { 777_000 } else { 1_000 };
            run.push(&record);
        }
        let series = run.finish(RunMeta::default()).series;
        assert!(series.len() <= SERIES_BUCKETS, "{length}: {}", series.len());
        assert!(series.len() as u64 >= length.min(SERIES_BUCKETS as u64 / 2));
        assert_eq!(series.iter().map(|b| b.ticks).sum::<u64>(), length);
        assert_eq!(
            series.iter().map(|b| b.contact_ticks).sum::<u64>(),
            length.div_ceil(3)
        );
        let worst = series.iter().max_by(|a, b| a.work_us.total_cmp(&b.work_us));
        let worst = worst.unwrap();
        assert_eq!(worst.work_us, 777.0);
        let expected = (length / 2) as f64 * 1e-3;
        let width = 2.0 * length as f64 * 1e-3 / 1000.0;
        assert!((worst.seconds - expected).abs() <= width, "{length}");
        assert!(series.is_sorted_by(|a, b| a.seconds < b.seconds));
    }
}

#[test]
fn the_json_has_the_contracts_names_and_names_what_was_not_finite() {
    let mut run = accumulator();
    for tick in [0, 1, 1 << 40] {
        let mut record = record(tick);
        record.wrenches[0].force = DVec3::new(f64::NAN, f64::INFINITY, 0.0);
        record.wrenches[1].torque = DVec3::new(0.0, f64::NAN, 0.0);
        record.core.probes[0] = ProbeRecord {
            contact: true,
            // A contact without a bound may have no number.
            contact_bounded: true,
            certified_error_m: f64::NAN,
            depth_m: f64::NAN,
            energy_j: f64::NAN,
            ..ProbeRecord::default()
        };
        record.core = CoreRecord {
            contact: true,
            contact_bounded: true,
            certified_error_m: f64::NAN,
            measured_error_m: f64::INFINITY,
            depth_m: f64::NAN,
            energy_j: f64::NAN,
            ..record.core
        };
        run.push(&record);
    }
    let line = SupervisedLine::Finished(Box::new(run.finish(RunMeta::default())));
    let text = serde_json::to_string(&line).unwrap();
    assert!(!text.contains("null") && !text.contains("NaN"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let result = json["result"].as_object().unwrap();
    for name in [
        "certified_error_m",
        "measured_error_m",
        "force_n",
        "force_step_n_max",
        "force_step_per_period_n_max",
        "torque_nm_max",
        "depth_m_max",
        "energy_j",
        "energy_j_max",
    ] {
        assert!(!result.contains_key(name), "{name} is no figure");
        let named = result["non_finite"].as_array().unwrap();
        assert!(named.iter().any(|of| of == name), "{name}: {named:?}");
    }
    for name in ["energy_j", "certified_error_m_max"] {
        assert!(result["probes"][0].get(name).is_none(), "{name}");
    }
    for name in ["force_n", "certified_error_m", "measured_error_m"] {
        assert!(json["series"][0].get(name).is_none(), "{name}");
    }
    let again: SupervisedLine = serde_json::from_str(&text).unwrap();
    assert_eq!(serde_json::to_string(&again).unwrap(), text);

    let mut run = accumulator();
    run.push(&record(0));
    let line = SupervisedLine::Finished(Box::new(run.finish(RunMeta::default())));
    let text = serde_json::to_string(&line).unwrap();
    assert!(!text.contains("null") && !text.contains("NaN"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let result = json["result"].as_object().unwrap();
    for name in [
        "faces",
        "seconds",
        "seed",
        "ticks",
        "missed",
        "missed_own_cpu",
        "contact_ticks",
        "contact_full_ticks",
        "contact_unbounded_ticks",
        "tolerance_m",
        "coarser_ticks",
        "force_step_n_max",
        "clamped_ticks",
        "rejected_samples",
        "objects",
        "active_objects_max",
        "moving_ticks",
        "inactive_object_ticks",
        "unfinished_ticks",
        "early_ticks",
        "slow",
        "energy_j",
        "vsps_received",
        "vsplits",
        "ecols",
        "geomorph_ticks",
        "geomorphs_max",
        "deferred",
        "rejected_folds",
        "regions_subscribed",
        "resubscribed",
        "resent",
        "round_trip_ms",
        "link_mbit_per_s",
        "bytes_received",
        "bytes_to_first_touch",
        "bytes_full_mesh",
        "hrtc_rss_bytes",
        "first_heard_ms",
        "first_force_ready_ms",
        "first_touch_ms",
        "first_full_ms",
        "replay_hash",
    ] {
        assert!(result[name].is_number(), "{name}");
    }
    let four = ["p50", "p99", "p999", "max"];
    for name in [
        "period_us",
        "wake_us",
        "work_us",
        "work_wall_us",
        "idle_us",
        "record_us",
    ] {
        assert!(four.iter().all(|q| result[name][*q].is_number()), "{name}");
    }
    for stage in STAGES {
        let stage = &result["stage_us"][stage];
        assert!(four.iter().all(|q| stage[*q].is_number()));
    }
    for name in ["certified_error_m", "measured_error_m", "force_n"] {
        assert!(
            ["p50", "p99", "max"]
                .iter()
                .all(|q| result[name][*q].is_number()),
            "{name}"
        );
    }
    for name in [
        "bytes",
        "least_limit_bytes",
        "over_limit_ticks",
        "high_water_bytes",
        "vsps",
        "evicted",
    ] {
        assert!(result["cache"][name].is_number(), "{name}");
    }
    assert!(result["refined_faces"]["p50"].is_number());
    assert_eq!(serde_json::from_str::<SupervisedLine>(&text).unwrap(), line);
    let status = SupervisedLine::Status {
        status: Status::default(),
    };
    let text = serde_json::to_string(&status).unwrap();
    assert!(text.starts_with("{\"status\":{"), "{text}");
    assert_eq!(
        serde_json::from_str::<SupervisedLine>(&text).unwrap(),
        status
    );
}

#[test]
fn a_station_is_heard_when_it_comes_or_begins_anew_and_synchronised_when_it_owes_nothing() {
    let mut run = accumulator();
    let stations = [0, 7, 7, 7, 0, 7, 9, 9, 9, 9];
    let synchronised = [1, 0, 0, 1, 1, 1, 0, 0, 0, 1];
    for (tick, (station, synchronised)) in (0..).zip(stations.into_iter().zip(synchronised)) {
        let mut record = record(tick);
        record.station = station;
        record.core.synchronised = synchronised == 1;
        record.core.resubscribed = u64::from(tick >= 8);
        run.push(&record);
    }
    let finished = run.finish(RunMeta {
        start_to_first_tick_ms: 100.0,
        ..RunMeta::default()
    });
    let heard = finished.stations.iter();
    let times: Vec<_> = heard.map(|s| (s.heard_ms, s.synchronised_ms)).collect();
    assert_eq!(
        times,
        [
            (101.0, 103.0),
            (105.0, 105.0),
            (106.0, -1.0),
            (108.0, 109.0)
        ]
    );
}

#[test]
fn what_never_came_has_no_time() {
    let mut run = accumulator();
    for tick in 0..5 {
        let mut record = record(tick);
        record.station = 0;
        record.core = CoreRecord {
            contact: tick == 4,
            contact_full: false,
            ready: false,
            round_trip_s: -1.0,
            link_bytes_per_s: -1.0,
            ..record.core
        };
        run.push(&record);
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!((result.round_trip_ms, result.link_mbit_per_s), (-1.0, -1.0));
    assert_eq!(
        (result.first_heard_ms, result.first_force_ready_ms),
        (0.0, 0.0)
    );
    assert_eq!((result.first_touch_ms, result.first_full_ms), (4.0, -1.0));
}

#[test]
fn page_faults_of_a_tick_that_missed_are_told_apart() {
    let mut run = accumulator();
    let missed = |class| [Miss { class, periods: 2 }, Miss::default()];
    let faults = [1, 10, 100, 1000, 0];
    // What a tick used up of its period is told with the next one.
    let classes = [
        MissClass::None,
        MissClass::OwnCpu,
        MissClass::RunQueue,
        MissClass::OwnWait,
        MissClass::None,
    ];
    for ((tick, page_faults), class) in (0..).zip(faults).zip(classes) {
        run.push(&TickRecord {
            page_faults,
            misses: missed(class),
            ..record(tick)
        });
    }
    let result = run.finish(RunMeta::default()).result;
    assert_eq!((result.page_faults, result.page_faults_missed), (1111, 101));
}
