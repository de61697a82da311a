//! Samples that are no motion: rejected and counted, held gently, and forgotten.

use crate::common::{World, scene_plan, scene_world, spm};
use geometry::Pose;
use glam::{DQuat, DVec3};
use haptic_device::{MotionLimits, Sample};
use simulator::Random;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::OnceLock;

/// Ticks until the base mesh is there and the force's ramp has opened.
const SETTLE: u64 = 600;
/// Height of the plate's surface under the probe's centre at rest on it, metres.
const ABOVE: f64 = 3e-3;
/// Depth of the press, metres.
const DEPTH: f64 = 1e-3;
/// Ticks of a press.
const PRESS: u64 = 100;

fn model() -> &'static [u8] {
    static MODEL: OnceLock<Vec<u8>> = OnceLock::new();
    MODEL.get_or_init(|| spm(generate(Shape::Sphere, 1500, 1), &BuildOptions::default()))
}

/// A ball of 0.1 m, and a probe above it.
struct Press {
    world: World,
    /// Height of the ball's surface, metres.
    top: f64,
    force_max_n: f64,
    step_max_n: f64,
    last: DVec3,
}

impl Press {
    fn new(limits: MotionLimits) -> Self {
        let plan = scene_plan(&[("ball.spm", 0.1, DVec3::ZERO)], 1, 8 << 20);
        let mut world = scene_world(&plan, &[("ball.spm", model())], 0.0);
        world.controller_mut().set_motion_limits(0, limits);
        let mut press = Self {
            world,
            top: 0.05 + 1e-3,
            force_max_n: plan.safety.force_max_n,
            step_max_n: plan.safety.slew_n_per_s / plan.loop_.rate_hz,
            last: DVec3::ZERO,
        };
        for _ in 0..SETTLE {
            press.at(ABOVE);
        }
        press
    }

    fn pose(&self, height: f64) -> Pose {
        Pose::at(DVec3::Z * (self.top + height))
    }

    fn give(&mut self, pose: Option<Pose>) -> DVec3 {
        self.world.step(pose.map(Sample::at));
        let force = self.world.force();
        assert!(
            force.is_finite() && force.length() <= self.force_max_n,
            "{force}"
        );
        let step = force.distance(self.last);
        assert!(
            step <= self.step_max_n * (1.0 + 1e-12),
            "a step of {step} N"
        );
        let joules = self.world.summary().last.energy_j;
        assert!(joules.is_finite(), "{joules} J");
        self.last = force;
        force
    }

    fn at(&mut self, height: f64) -> DVec3 {
        self.give(Some(self.pose(height)))
    }

    /// Goes down from above to the depth of the press.
    fn press(&mut self) {
        for k in 0..=PRESS {
            self.at(ABOVE - (ABOVE + DEPTH) * k as f64 / PRESS as f64);
        }
    }

    /// Goes up again.
    fn lift(&mut self) {
        for k in (0..=PRESS).rev() {
            self.at(ABOVE - (ABOVE + DEPTH) * k as f64 / PRESS as f64);
        }
    }

    /// Holds, with a tremor of 20 um; the force of each tick.
    fn hold(&mut self, ticks: u64) -> Vec<f64> {
        let tremor = |tick: u64| 20e-6 * (tick as f64 * 0.06).sin();
        let forces = (0..ticks).map(|tick| self.at(-DEPTH + tremor(tick)).length());
        forces.collect()
    }

    fn rejected(&self) -> u64 {
        self.world.controller().rejected_samples()
    }
}

/// The largest relative difference of the forces of two holds from a tick on.
fn difference(one: &[f64], other: &[f64], from: usize) -> f64 {
    assert!(other.iter().all(|&force| force > 0.5), "the wall is felt");
    let both = one.iter().zip(other).skip(from);
    both.fold(0.0, |most: f64, (a, b)| {
        let differs = (a - b).abs() / b;
        // A force that is no number is the largest difference.
        if differs <= most { most } else { differs }
    })
}

/// Press, spike, press, and hold, beside the same without the spike.
fn spiked(limits: MotionLimits, spike: Pose) -> (f64, u64) {
    let run = |is_spiked: bool| {
        let mut press = Press::new(limits);
        press.press();
        press.hold(50);
        if is_spiked {
            press.give(Some(spike));
        }
        let mut forces = press.hold(50);
        press.lift();
        press.press();
        let again = press.hold(500);
        forces.extend(&again[10..]);
        (forces, press.rejected())
    };
    let (forces, rejected) = run(true);
    let (expected, _) = run(false);
    (difference(&forces, &expected, 10), rejected)
}

#[test]
fn a_spike_between_two_presses_leaves_the_force_of_the_second() {
    for height in [0.01, 1.0, 1e6, 1e150, 1e300, f64::MAX] {
        let spike = Pose::at(DVec3::new(0.0, 0.3, 1.0).normalize() * height);
        let (differs, rejected) = spiked(MotionLimits::HAND, spike);
        println!("spike of {height} m: the force differs by {differs}");
        assert_eq!(rejected, 1, "{height} m");
        assert!(differs < 0.05, "{height} m: {differs}");
    }
    // The same without limits: the wall is muted by the energy that the spike took out.
    let (differs, _) = spiked(MotionLimits::UNLIMITED, Pose::at(DVec3::Z));
    println!("without limits: the force differs by {differs}");
    assert!(differs > 0.5, "the test shows nothing: {differs}");
}

#[test]
fn a_hundred_thousand_spikes_and_wild_quaternions_mute_nothing() {
    let seed = 21;
    println!("seed {seed}");
    let mut random = Random::new(seed);
    let mut press = Press::new(MotionLimits::HAND);
    press.press();
    let expected = press.hold(200);
    let (mut spikes, mut since) = (0u64, 0u64);
    let mut tick = 0;
    while spikes < 100_000 {
        if since < 11 || random.below(8) > 0 {
            let force = press.hold(1)[0];
            since += 1;
            tick += 1;
            let due = expected[0];
            assert!(
                since <= 10 || (force - due).abs() <= 0.05 * due,
                "{force} N instead of {due} N, {since} ticks after spike {spikes}"
            );
            continue;
        }
        // At most three in a row.
        for _ in 0..=random.below(3) {
            let held = press.pose(-DEPTH);
            let spike = match random.below(4) {
                0 => Pose {
                    orientation: wild(&mut random),
                    ..held
                },
                1 => Pose::at(DVec3::from_array(
                    [0; 3].map(|_| f64::from_bits(random.bits())),
                )),
                _ => Pose::at(held.position + far(&mut random)),
            };
            press.give(Some(spike));
            spikes += 1;
        }
        since = 0;
    }
    println!(
        "{spikes} spikes in {tick} ticks, {} rejected",
        press.rejected()
    );
    assert!(press.rejected() > spikes * 9 / 10);
}

/// A displacement of 20 mm to 1e9 m in any direction.
fn far(random: &mut Random) -> DVec3 {
    let part = |random: &mut Random| random.below(2_000_001) as f64 / 1e6 - 1.0;
    let direction = DVec3::new(part(random), part(random), part(random));
    let length = 0.02 * 10f64.powf(random.below(1070) as f64 / 100.0);
    direction.normalize_or(DVec3::X) * length
}

/// A quaternion of any length, turned by at least a quarter turn.
fn wild(random: &mut Random) -> DQuat {
    match random.below(5) {
        0 => DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        1 => DQuat::from_array([0; 4].map(|_| f64::from_bits(random.bits()))),
        2 => DQuat::from_xyzw(0.0, 0.0, f64::NAN, 1.0),
        _ => DQuat::from_axis_angle(far(random).normalize(), 1.6 + random.below(2) as f64),
    }
}

#[test]
fn only_implausible_samples_ramp_the_force_down_and_a_new_place_begins_softly() {
    let mut press = Press::new(MotionLimits::HAND);
    press.press();
    let before = press.hold(50).last().copied().unwrap_or_default();
    // The device is at once 2 mm deep in the other side of the ball, and stays.
    let place = Some(Pose::at(DVec3::NEG_Z * (press.top - 2e-3)));
    let mut forces = Vec::new();
    for _ in 0..700 {
        forces.push(press.give(place).length());
    }
    // Held at first, then ramped down, then up again, never by more than the ramp allows.
    assert!(
        forces[..20]
            .iter()
            .all(|force| (force - before).abs() < 1e-3 * before)
    );
    let silent = forces.iter().position(|&force| force == 0.0);
    println!(
        "without force after {silent:?} ticks, {} rejected",
        press.rejected()
    );
    assert!(silent.is_some_and(|tick| tick < 300));
    assert!(
        forces.last().is_some_and(|&force| force > 0.5),
        "{:?}",
        forces.last()
    );
    let steepest = forces
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(0.0, f64::max);
    assert!(steepest < 0.1 * before, "{steepest} N in a tick");
    // The energy account is that of a press at the new place: it has no debt from the jump.
    let joules = press.world.summary().last.energy_j;
    assert!(joules.abs() < 0.01, "{joules} J");
}
