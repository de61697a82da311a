//! A probe whose contact wants the same force in every tick.

use super::*;
use crate::force::passivity::CouplingSpring;
use crate::record::max_or_nan;
use glam::{DQuat, DVec3};
use scene::{NoFiles, Overrides, parse};
use std::path::Path;

/// Ticks of the ramp: 0.2 s at 1 kHz.
const RAMP: u64 = 200;
/// Wanted force, newtons; below the limit of 8 N.
const WANTED: f64 = 2.0;

struct Held {
    probe: Probe,
    tick: u64,
}

impl Held {
    fn new() -> Self {
        Self::with(false)
    }

    fn with(passivity: bool) -> Self {
        Self::of(passivity, "")
    }

    /// With lines before the first table of the scene.
    fn of(passivity: bool, lines: &str) -> Self {
        let text = format!(
            "{lines}\n[[object]]\ngenerate = {{ shape = \"plate\", faces = 1000 }}\nsize_m = 0.2\n\
             [safety]\nramp_s = 0.2\npassivity = {passivity}\n[[probe]]\n"
        );
        let path = Path::new("");
        let plan = parse(&text, "held", path, &Overrides::default(), &NoFiles).unwrap();
        Self {
            probe: Probe::new(&plan, &plan.probes[0], 10.0, 1.0),
            tick: 0,
        }
    }

    /// Force after one tick, newtons.
    fn step(&mut self, in_hand: Option<bool>) -> f64 {
        self.tick += 1;
        let sample = Sample {
            in_hand,
            ..Sample::at(Pose::IDENTITY)
        };
        self.probe.sample(Some(sample), 1);
        let mut wanted = Rendered::default();
        wanted.passive.force = DVec3::Z * WANTED;
        let clock = Clock {
            tick: self.tick,
            period_s: 1e-3,
        };
        self.probe
            .limit(clock, wanted, CarriedWork::default(), true);
        self.probe.wrench.force.length()
    }

    /// Largest change of the force in so many ticks, and the last force, newtons.
    fn steps(&mut self, ticks: u64, in_hand: Option<bool>) -> (f64, f64) {
        let mut last = self.probe.wrench.force.length();
        let mut largest: f64 = 0.0;
        for _ in 0..ticks {
            let force = self.step(in_hand);
            largest = largest.max((force - last).abs());
            last = force;
        }
        (largest, last)
    }
}

/// The change of a tick on the ramp.
fn is_gentle(change: f64) -> bool {
    change <= WANTED / RAMP as f64 * (1.0 + 1e-9)
}

#[test]
fn a_device_that_nobody_holds_gets_no_force_until_it_is_held_again() {
    let mut held = Held::new();
    held.steps(2 * RAMP, Some(true));
    assert!(held.step(Some(true)) > 0.99 * WANTED);
    let (change, force) = held.steps(RAMP + 1, Some(false));
    assert!(is_gentle(change), "{change}");
    assert_eq!(force, 0.0, "ramped down");
    // A sample that cannot tell does not switch it on.
    assert_eq!(held.steps(RAMP, None), (0.0, 0.0));
    let (change, force) = held.steps(RAMP + 1, Some(true));
    assert!(is_gentle(change), "{change}");
    assert!(force > 0.99 * WANTED);
}

#[test]
fn a_device_that_cannot_tell_counts_as_held() {
    let mut held = Held::new();
    let (_, force) = held.steps(RAMP + 1, None);
    assert!(force > 0.99 * WANTED);
}

#[test]
fn a_force_that_was_cut_rises_from_zero_along_the_ramp() {
    let mut held = Held::new();
    held.steps(2 * RAMP, None);
    held.probe.force_was_cut();
    let first = held.step(None);
    assert!(is_gentle(first), "{first}");
    let (change, force) = held.steps(RAMP, None);
    assert!(is_gentle(change) && force > 0.99 * WANTED);
}

/// The device turns with a torque at one place, which would put energy out.
#[test]
fn torque_that_the_device_does_not_render_does_no_work() {
    let turned = |renders_torque: bool| {
        let Held { mut probe, .. } = Held::with(true);
        probe.renders_torque = renders_torque;
        let wanted = Rendered {
            passive: Wrench {
                force: DVec3::Z * WANTED,
                torque: DVec3::Z * 0.1,
            },
            spring: CouplingSpring {
                stiffness_n_per_m: 1000.0,
                stored_j: 0.5 * WANTED * WANTED / 1000.0,
                raised_j: 0.0,
            },
            ..Rendered::default()
        };
        for tick in 0..2 * RAMP {
            let orientation = DQuat::from_rotation_z(1e-3 * tick as f64);
            let pose = Pose {
                position: DVec3::ZERO,
                orientation,
            };
            probe.sample(Some(Sample::at(pose)), 1);
            let clock = Clock {
                tick,
                period_s: 1e-3,
            };
            probe.limit(clock, wanted, CarriedWork::default(), true);
        }
        (probe.energy.joules(), probe.wrench)
    };
    let (joules, wrench) = turned(false);
    assert_eq!(joules, 0.0);
    assert_eq!(wrench.torque, DVec3::ZERO);
    assert!((wrench.force.length() - WANTED).abs() < 1e-9, "{wrench:?}");
    // Where it is rendered, the account sees it and limits it.
    let (joules, wrench) = turned(true);
    assert!(
        joules > 0.0 && wrench.force.length() < 0.9 * WANTED,
        "{joules} J, {wrench:?}"
    );
}

impl Held {
    /// A tick with a sample there, or without one.
    fn go_to(&mut self, place: Option<DVec3>, elapsed: u64) {
        self.tick += elapsed;
        let sample = place.map(|position| {
            Sample::at(Pose {
                position,
                ..Pose::IDENTITY
            })
        });
        self.probe.sample(sample, elapsed);
        let clock = Clock {
            tick: self.tick,
            period_s: 1e-3,
        };
        let nothing = Rendered::default();
        self.probe
            .limit(clock, nothing, CarriedWork::default(), true);
    }
}

/// A driver at half the rate of the loop, over a surface that moves along.
#[test]
fn motion_goes_on_where_a_sample_is_missing_and_none_of_it_counts_twice() {
    let mut held = Held::new();
    let (step, carried) = (DVec3::X * 2e-4, DVec3::new(5e-5, 0.0, 1e-5));
    let at = |place: DVec3| Pose {
        position: place,
        ..Pose::IDENTITY
    };
    let mut moved = DVec3::ZERO;
    for tick in 1..=400u64 {
        let now = tick as f64;
        held.tick += 1;
        let sample = (tick % 2 == 0).then(|| Sample::at(at(step * now)));
        held.probe.sample(sample, 1);
        let [before, object] = [now - 1.0, now].map(|ticks| at(carried * ticks));
        let [motion, a_period] = held.probe.motion_along(Some(&before), &object);
        if tick > 10 {
            let off = a_period.linear.distance(step - carried);
            assert!(off < 1e-9, "tick {tick}: {a_period:?}");
            assert!((held.probe.speed / step.length() - 1.0).abs() < 1e-9);
            moved += motion.linear;
        }
        held.probe.last = held.probe.pose;
    }
    let whole = (step - carried) * 390.0;
    assert!(moved.distance(whole) < 1e-9, "{moved} of {whole}");
    // Longer than the force lasts nothing is believed.
    (0..30).for_each(|_| held.go_to(None, 1));
    let [_, a_period] = held.probe.motion_along(None, &Pose::IDENTITY);
    assert_eq!(
        (a_period, held.probe.velocity),
        (Twist::default(), DVec3::ZERO)
    );
}

#[test]
fn the_velocity_for_effects_is_even_where_every_other_sample_is_missing() {
    let mut held = Held::of(
        false,
        "effects = [{ viscosity = { damping_ns_per_m = 2.0 } }]",
    );
    let (mut least, mut most) = (f64::INFINITY, 0.0f64);
    for tick in 1..=800u64 {
        let place = (tick % 2 == 0).then(|| DVec3::X * (2e-4 * tick as f64));
        held.go_to(place, 1);
        if tick > 2 * RAMP {
            let force = held.probe.wrench.force.length();
            (least, most) = (-max_or_nan(-least, -force), max_or_nan(most, force));
        }
    }
    assert!(
        (least - 0.4).abs() < 1e-6 && (most - 0.4).abs() < 1e-6,
        "{least} to {most} N"
    );
}

/// Its spring would pull with 20 N.
#[test]
fn a_mass_is_not_left_behind_at_the_place_where_the_device_was() {
    let mass = "effects = [{ inertia = { mass_kg = 0.2, stiffness_n_per_m = 200.0, damping_ns_per_m = 0.5 } }]";
    let mut held = Held::of(false, mass);
    held.probe.set_motion_limits(MotionLimits {
        speed_m_per_s: 2.0,
        acceleration_m_per_s2: 100.0,
        angular_speed_rad_per_s: 50.0,
    });
    (0..2 * RAMP).for_each(|_| held.go_to(Some(DVec3::ZERO), 1));
    let elsewhere = DVec3::X * 0.5;
    let mut most = 0.0f64;
    for _ in 0..20 * RAMP {
        held.go_to(Some(elsewhere), 1);
        most = max_or_nan(most, held.probe.wrench.force.length());
    }
    let pose = held.probe.pose.map(|pose| pose.position);
    assert_eq!(pose, Some(elsewhere), "believed");
    assert!(most < 1e-9, "{most} N");
}

/// A wrench expires 30 ms after it was written; the hand comes to rest in a stall of 31.
#[test]
fn the_velocity_after_a_stall_is_no_more_than_that_of_the_hand() {
    for stall in [29, 30, 31, 40, 300] {
        let mut held = Held::of(
            false,
            "effects = [{ viscosity = { damping_ns_per_m = 2.0 } }]",
        );
        let mut place = 0.0;
        for _ in 0..2 * RAMP {
            place += 2e-4;
            held.go_to(Some(DVec3::X * place), 1);
        }
        place += 1e-4 * stall as f64;
        held.probe.force_was_cut();
        held.go_to(Some(DVec3::X * place), stall);
        let speed = held.probe.velocity.x;
        assert!((speed - 0.1).abs() < 1e-9, "{stall}: {speed} m/s");
        // It rests: nothing comes later.
        held.go_to(Some(DVec3::X * place), 1);
        let speed = held.probe.velocity.length();
        assert!(speed < 1e-9, "{stall}: {speed} m/s");
    }
}

#[test]
fn a_wrench_that_is_no_number_does_no_work_beside_an_active_effect() {
    let mut held = Held::of(true, "effects = [{ gravity = { mass_kg = 0.05 } }]");
    for tick in 0..4 * RAMP {
        held.tick += 1;
        let position = DVec3::Z * (-1e-5 * tick as f64);
        held.probe.sample(
            Some(Sample::at(Pose {
                position,
                ..Pose::IDENTITY
            })),
            1,
        );
        let mut wanted = Rendered::default();
        wanted.passive.force = if tick % 3 == 0 {
            DVec3::NAN
        } else {
            DVec3::Z * WANTED
        };
        wanted.spring.raised_j = 1e-6;
        let clock = Clock {
            tick: held.tick,
            period_s: 1e-3,
        };
        held.probe
            .limit(clock, wanted, CarriedWork::default(), true);
        assert!(held.probe.wrench.is_finite());
        assert!(held.probe.energy.joules().is_finite());
    }
}

/// So that a controller without them asks its station for the same, and ticks as one with them.
#[test]
fn a_tour_that_keeps_no_points_counts_them_as_before() {
    let mut kept = Held::new().probe.tour.unwrap();
    let mut counted = kept.clone();
    counted.drop_points();
    let point = |t: f64| TourPoint {
        t,
        position: [0.0; 3],
        orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
    };
    let points = [0.0, 0.005, f64::NAN, 0.01].map(point);
    // The second time two of them are known already; the third time some before them are missing.
    for (first, follows) in [(0, true), (2, true), (7, false)] {
        let took = [&mut kept, &mut counted].map(|tour| tour.take(first, &points));
        assert_eq!(took, [follows; 2]);
        assert_eq!(kept.taken(), counted.taken());
    }
    assert_eq!((kept.points.len(), kept.taken()), (3, 6));
    assert_eq!(counted.points.capacity(), 0);
}

/// Force and torque have maxima of their own: where one of them is cut, the other has passed.
#[test]
fn a_torque_that_is_cut_says_nothing_of_the_force() {
    let mut held = Held::new();
    held.probe.renders_torque = true;
    let all = Passed {
        force: 1.0,
        torque: 1.0,
    };
    let mut wanted = Rendered::default();
    wanted.passive.force = DVec3::Z * WANTED;
    wanted.passive.torque = DVec3::X * 0.6;
    wanted.active.force = DVec3::X * 0.1;
    let mut passed = [all; 2];
    for tick in 1..=2 * RAMP {
        held.probe.sample(Some(Sample::at(Pose::IDENTITY)), 1);
        let clock = Clock {
            tick,
            period_s: 1e-3,
        };
        passed = held
            .probe
            .limit(clock, wanted, CarriedWork::default(), true);
    }
    let [passive, active] = passed;
    assert_eq!(passive, active, "without an energy account");
    // The default limit of 0.3 N m.
    assert!((passive.force - 1.0).abs() < 1e-12 && (passive.torque - 0.5).abs() < 1e-12);
    let half = passive.scale(&wanted.passive);
    assert!(half.force.distance(wanted.passive.force) < 1e-12);
    assert!(half.torque.distance(0.5 * wanted.passive.torque) < 1e-12);
    // A couple has no force, and no wrench is passed whole.
    let couple = wanted.passive.torque;
    let of = |force, torque, share: f64| {
        let whole = Wrench { force, torque };
        Passed::of(&whole, &(whole * share))
    };
    assert!((of(DVec3::ZERO, couple, 0.25).force - 0.25).abs() < 1e-12);
    assert_eq!(of(DVec3::ZERO, DVec3::ZERO, 0.0), all);
    assert_eq!(of(DVec3::NAN, couple, 0.5).force, 0.0);
    let none = Wrench {
        force: DVec3::NAN,
        torque: couple,
    };
    assert_eq!(Passed::of(&none, &Wrench::ZERO).scale(&none), Wrench::ZERO);
}

/// A force ends at once, and the slew limit takes some periods for it: what it does in these is
/// booked for the contact if it was the contact's, whatever else acts, and only then.
#[test]
fn the_rest_of_a_force_is_booked_as_the_force_was() {
    let booked_j = |effects: &str, is_active: bool| {
        let Held { mut probe, .. } = Held::of(true, effects);
        let ends = 2 * RAMP;
        for tick in 0..=ends + 1 {
            let mut wanted = Rendered::default();
            let force = DVec3::Z * if tick < ends { 6.0 } else { 0.0 };
            if is_active {
                wanted.active.force = force;
            } else {
                wanted.passive.force = force;
            }
            let moved = if tick > ends { 1e-4 } else { 0.0 };
            probe.sample(Some(Sample::at(Pose::at(DVec3::Z * moved))), 1);
            let clock = Clock {
                tick,
                period_s: 1e-3,
            };
            probe.limit(clock, wanted, CarriedWork::default(), true);
        }
        assert!(probe.wrench.force.z > 1.0, "{:?}", probe.wrench);
        -probe.energy.balance(0.0)
    };
    let weight = "effects = [{ gravity = { mass_kg = 1e-6 } }]";
    let [alone, beside] = ["", weight].map(|effects| booked_j(effects, false));
    assert!(alone > 1e-4, "{alone} J");
    assert!((beside / alone - 1.0).abs() < 0.01, "{beside} of {alone} J");
    let of_active = booked_j("", true);
    assert!(of_active.abs() < 1e-12, "{of_active} J");
}

/// A driver at half the rate of the loop presses on: the work of each period is booked in it.
#[test]
fn the_work_of_a_period_without_a_sample_is_booked_in_it() {
    let Held { mut probe, .. } = Held::with(true);
    let mut wanted = Rendered::default();
    wanted.passive.force = DVec3::Z * WANTED;
    let step_m = 2e-4;
    for tick in 1..=4 * RAMP {
        let place = DVec3::Z * (-step_m * tick as f64);
        let sample = (tick % 2 == 0).then(|| Sample::at(Pose::at(place)));
        let (force, before) = (probe.wrench.force.z, probe.energy.joules());
        probe.sample(sample, 1);
        let clock = Clock {
            tick,
            period_s: 1e-3,
        };
        probe.limit(clock, wanted, CarriedWork::default(), true);
        if tick > 2 * RAMP {
            let share = (probe.energy.joules() - before) / (-force * step_m);
            assert!((share - 1.0).abs() < 1e-6, "tick {tick}: {share} of it");
        }
    }
}

/// A driver that exchanges the newest values with a thread of its own gives a sample again where it
/// has no newer one: its time tells, so that the device is not at rest there. Without a time it is.
#[test]
fn a_sample_that_is_given_again_is_none() {
    let step = DVec3::X * 2e-4;
    for (has_time, again) in [(true, 1.0), (false, 0.0)] {
        let mut held = Held::new();
        for tick in 1..=400u64 {
            let measured = tick - tick % 2;
            let sample = Sample {
                time_ns: if has_time { 1_000_000 * measured } else { 0 },
                ..Sample::at(Pose::at(step * measured as f64))
            };
            held.probe.sample(Some(sample), 1);
            let [_, a_period] = held.probe.motion_along(None, &Pose::IDENTITY);
            if tick > 10 && tick % 2 == 1 {
                assert_eq!(held.probe.goes_on(), has_time, "tick {tick}");
                let off = a_period.linear.distance(step * again);
                assert!(off < 1e-9, "{has_time}, tick {tick}: {a_period:?}");
            }
            held.probe.last = held.probe.pose;
        }
        assert_eq!(held.probe.rejected_samples, 0, "none is wrong");
    }
    // A driver whose own thread hangs falls silent: its force ramps down.
    let mut held = Held::new();
    let hangs = Sample {
        time_ns: 1,
        ..Sample::at(Pose::IDENTITY)
    };
    for tick in 0..4 * RAMP {
        held.probe.sample(Some(hangs), 1);
        let mut wanted = Rendered::default();
        wanted.passive.force = DVec3::Z * WANTED;
        let clock = Clock {
            tick,
            period_s: 1e-3,
        };
        held.probe
            .limit(clock, wanted, CarriedWork::default(), true);
    }
    assert!(held.probe.is_at_rest(), "{:?}", held.probe.wrench);
}

/// The last sample of a driver whose own thread hangs is wild: given again and again it is still
/// one sample, and no new place.
#[test]
fn a_wild_sample_that_is_given_again_is_rejected_once() {
    let mut held = Held::new();
    held.probe.set_motion_limits(MotionLimits::HAND);
    for tick in 1..=5 * RAMP {
        let is_wild = tick > RAMP;
        let place = DVec3::X * if is_wild { 5.0 } else { 0.0 };
        let sample = Sample {
            time_ns: 1_000_000 * tick.min(RAMP + 1),
            ..Sample::at(Pose::at(place))
        };
        held.probe.sample(Some(sample), 1);
        assert_eq!(held.probe.pose, Some(Pose::IDENTITY), "tick {tick}");
        let clock = Clock {
            tick,
            period_s: 1e-3,
        };
        let nothing = Rendered::default();
        held.probe
            .limit(clock, nothing, CarriedWork::default(), true);
    }
    assert_eq!(held.probe.rejected_samples, 1);
}

/// An encoder shows a slow motion as jumps, at 4 kHz of 40 mm/s: no damper is to see them.
#[test]
fn the_motion_for_damping_is_without_the_steps_of_the_encoder() {
    let mut held = Held::new();
    let (encoder_m, a_period) = (1e-5, 2e-6);
    for tick in 1..=400u64 {
        let steps = (a_period * tick as f64 / encoder_m).round();
        held.go_to(Some(DVec3::X * (steps * encoder_m)), 1);
        let [_, seen] = held.probe.motion_along(None, &Pose::IDENTITY);
        let share = seen.linear.x / a_period;
        assert!(
            tick < 100 || (share - 1.0).abs() < 0.5,
            "tick {tick}: {share} of the motion"
        );
    }
}
