//! A probe whose contact wants the same force in every tick.

use super::*;
use crate::force::passivity::CouplingSpring;
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
        let text = format!(
            "[[object]]\ngenerate = {{ shape = \"plate\", faces = 1000 }}\nsize_m = 0.2\n\
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
