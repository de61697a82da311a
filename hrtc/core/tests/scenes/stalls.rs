//! Stalls in contact with damping, friction and viscosity: the loop through the device is closed,
//! and a wrench that is older than it is valid acts no more.

use crate::common::{World, scene_plan, scene_world, spm};
use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{COMMAND_VALIDITY_S, Intent};
use scene::{Effect, EffectPlan, FrictionPlan, ProbeShape, ScenePlan};
use simulator::refined_front;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::{Arc, LazyLock};

/// Periods of the stalls.
const STALLS: [u64; 3] = [1, 18, 300];
/// Radius of the object, metres, of the probe, and how deep the hand wants it.
const BALL: f64 = 0.05;
const RADIUS: f64 = 0.001;
const DEPTH: f64 = 0.004;
/// Time until the hand is in contact and at rest, seconds.
const SETTLED_S: f64 = 2.0;

static MODEL: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default()));

fn effect(effect: Effect) -> EffectPlan {
    EffectPlan {
        effect,
        from_s: 0.0,
        until_s: f64::INFINITY,
        fade_s: 0.1,
    }
}

/// A damped ball with friction in a viscous scene, and a device without an encoder: what it does is
/// known exactly.
fn plan(rate_hz: f64, is_tool: bool) -> ScenePlan {
    let mut plan = scene_plan(&[("ball.spm", 2.0 * BALL, DVec3::ZERO)], 1, 8 << 20);
    plan.loop_ = plan.loop_.at_rate(rate_hz);
    // At every rate as near to what the device makes passive.
    plan.objects[0].surface.stiffness_n_per_m = 0.8 * rate_hz;
    plan.objects[0].surface.damping_ns_per_m = 0.5;
    let friction = FrictionPlan {
        static_: 0.4,
        dynamic: 0.3,
    };
    plan.objects[0].effects = Arc::new([effect(Effect::Friction(friction))]);
    let damping_ns_per_m = 2.0;
    plan.effects = vec![effect(Effect::Viscosity { damping_ns_per_m })];
    let probe = &mut plan.probes[0];
    probe.device.encoder_m = 0.0;
    probe.shape = if is_tool {
        ProbeShape::Capsule {
            radius_m: RADIUS,
            length_m: 0.02,
            faces: 240,
        }
    } else {
        ProbeShape::Sphere { radius_m: RADIUS }
    };
    plan
}

/// A hand that presses and slides around the ball at a speed, m/s.
struct Hand {
    world: World,
    rate_hz: f64,
    speed: f64,
    slid_from: u64,
}

impl Hand {
    fn new(rate_hz: f64, is_tool: bool, speed: f64) -> Self {
        let plan = plan(rate_hz, is_tool);
        let mut world = scene_world(&plan, &[("ball.spm", &MODEL)], 0.0);
        world.client_mut().expire_commands();
        let slid_from = (SETTLED_S * rate_hz) as u64;
        let mut hand = Self {
            world,
            rate_hz,
            speed,
            slid_from,
        };
        while hand.world.tick() < slid_from {
            hand.step();
        }
        hand
    }

    /// Where the hand wants the device at a tick.
    fn wanted(&self, tick: u64) -> DVec3 {
        let t = tick as f64 / self.rate_hz;
        let down = ((t - 1.0) / 0.5).clamp(0.0, 1.0);
        let slid = tick.saturating_sub(self.slid_from) as f64 / self.rate_hz;
        let turn = self.speed * slid / BALL;
        let out = DVec3::new(turn.sin(), 0.0, turn.cos());
        out * (BALL + RADIUS + 0.01 - (0.01 + DEPTH) * down)
    }

    fn step(&mut self) -> Wrench {
        let tick = self.world.tick();
        let [from, to] = [tick.saturating_sub(1), tick].map(|tick| self.wanted(tick));
        let intent = Intent {
            velocity: (to - from) * self.rate_hz,
            ..Intent::still(Pose::at(to))
        };
        self.world.client_mut().hand(0).lead_to(intent);
        self.world.step_led().wrenches[0]
    }

    /// Work of the wrenches on the device so far: what the account says, and what it is; joules.
    fn work_j(&mut self) -> [f64; 2] {
        let account = self.world.outputs().record.probes[0].energy_j;
        [account, self.world.client_mut().hand(0).state().work_j]
    }

    fn front(&self) -> Vec<u32> {
        refined_front(self.world.controller().cache())
    }
}

/// A stall, and a second after it: every force is within its limits, the account is true, and the
/// force comes back to that of a twin without the stall.
fn stall(hand: &mut Hand, twin: &mut Hand, periods: u64) {
    let [rate_hz, validity_s] = [hand.rate_hz, COMMAND_VALIDITY_S];
    let what = format!("{periods} periods at {rate_hz} Hz");
    let before = hand.step().force;
    let booked_before = hand.work_j();
    hand.world.skip(periods);
    let is_long = (periods + 1) as f64 / rate_hz >= validity_s;
    let mut last = if is_long { DVec3::ZERO } else { before };
    // The default limit of a change, and what a ramp of 0.2 s makes of the largest force.
    let slew_n = 2000.0 / rate_hz;
    let (mut largest, mut rises) = (0.0f64, 0.0f64);
    let mut first_n = 0.0;
    for tick in 0..rate_hz as u64 {
        let force = hand.step().force;
        let step = force.distance(last);
        assert!(step <= slew_n * (1.0 + 1e-9), "{what}, {tick}: {step} N");
        assert!(force.length() <= 8.0 * (1.0 + 1e-9), "{what}: {force}");
        largest = largest.max(force.length());
        if tick == 0 {
            first_n = step;
        }
        if tick < (0.1 * rate_hz) as u64 {
            let unfelt_n = f64::max(50.0, 70.0 * last.length()) / rate_hz;
            rises = rises.max((force.length() - last.length()) / unfelt_n);
        }
        last = force;
    }
    let booked = hand.work_j();
    let [account, is] = [0, 1].map(|k| booked[k] - booked_before[k]);
    println!(
        "{what}: {:.3} N before, first step {first_n:.4} N, largest rise {rises:.4} of what is not felt, then \
         {:.3} N, at most {largest:.3} N; booked {account:.3e} J of {is:.3e} J",
        before.length(),
        last.length(),
    );
    let mut beside = DVec3::ZERO;
    while twin.world.tick() < hand.world.tick() {
        beside = twin.step().force;
    }
    let apart = last.distance(beside) / beside.length();
    assert!(apart < 0.1, "{what}: {last}, {beside}");
    if is_long {
        // As after a soft start: from zero, by less than is felt.
        assert!(first_n == 0.0, "{what}: {first_n} N");
        assert!(rises <= 1.0, "{what}: rises by {rises} of that");
    }
    // What it cannot know is how the hand moved while a wrench was still valid.
    let unknown = if is_long { 0.1 } else { 1e-9 };
    let differs = (account - is).abs() / is.abs();
    assert!(differs < unknown, "{what}: {account} J, {is} J");
}

fn stalls_are_felt_as_they_are(is_tool: bool) {
    for rate_hz in [1000.0, 250.0, 4000.0] {
        let mut hand = Hand::new(rate_hz, is_tool, 0.02);
        let mut twin = Hand::new(rate_hz, is_tool, 0.02);
        for periods in STALLS {
            stall(&mut hand, &mut twin, periods);
        }
    }
}

#[test]
fn a_ball_that_slides_feels_a_stall_as_it_is() {
    stalls_are_felt_as_they_are(false);
}

#[test]
fn a_tool_that_slides_feels_a_stall_as_it_is() {
    stalls_are_felt_as_they_are(true);
}

#[test]
fn no_region_is_lost_in_a_stall_that_is_still_wanted() {
    for is_tool in [false, true] {
        let mut hand = Hand::new(1000.0, is_tool, 0.0);
        for _ in 0..3000 {
            hand.step();
        }
        let front = hand.front();
        let subscribed = hand.world.summary().last.resubscribed;
        for periods in STALLS {
            hand.world.skip(periods);
            for tick in 0..400 {
                hand.step();
                let record = &hand.world.outputs().record;
                assert!(
                    record.contact && record.contact_full,
                    "{tick} after {periods}"
                );
            }
            assert_eq!(hand.front(), front, "{periods} periods");
            assert_eq!(hand.world.summary().last.resubscribed, subscribed);
        }
    }
}
