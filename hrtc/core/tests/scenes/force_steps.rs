//! A hand that presses deep and slides over ridges: the force turns over several ticks and is never
//! muted, whether the front is whole, or coarse and refined under the hand, or comes when the hand
//! is in the object already.

use crate::common::{World, plan, spm, station};
use geometry::Pose;
use glam::DVec3;
use hrtc_core::governor::MeasuredTick;
use hrtc_core::perception::{STEP_N_PER_S, STEP_SHARE_PER_S};
use hrtc_core::{NoObserver, Stage, StageObserver, Timed};
use scene::{ScenePlan, TrajectoryPlan};
use simulator::{Client, ClientOptions, Drive, LinkModel, STATION, Simulation};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::f64::consts::TAU;

/// Longest side of the object, metres, and its faces.
const SIZE_M: f64 = 0.15;
const FACES: u32 = 20_000;
/// Approach and slide, seconds; time of a round of it, and its radius, metres: 28 mm/s.
const APPROACH_S: f64 = 1.5;
const SLIDE_S: f64 = 7.5;
const ROUND_S: f64 = 1.8;
const RADIUS_M: f64 = 0.008;
/// Depth of the hand's aim below the surface, metres.
const DEPTH_M: f64 = 0.008;
const PERIOD_S: f64 = 1e-3;
/// Bytes a tick of lines over which refinement takes a part of the slide (0.15 Mbit/s), and over
/// which the base mesh comes when the hand is there.
const THIN: f64 = 18.75;
const THINNEST: f64 = 12.0;
/// Time after which a contact has its force, however it began: five times that in which the unpaid
/// part of it falls to a third, seconds.
const HAS_RETURNED_S: f64 = 1.0;
/// Depth above which the force is compared with that of the spring, metres.
const PRESSED_M: f64 = 5e-4;

/// The model of a seed, and the height of its surface over the origin, metres.
fn relief(seed: u64) -> (Vec<u8>, f64) {
    let mesh = generate(Shape::Relief, FACES, seed);
    let side = |axis: usize| {
        let values = mesh.positions.iter().map(|at| at[axis]);
        let least = values.clone().fold(f64::INFINITY, f64::min);
        values.fold(f64::NEG_INFINITY, f64::max) - least
    };
    let scale = SIZE_M / (0..3).map(side).fold(0.0, f64::max);
    let distance = |at: &&[f64; 3]| at[0].hypot(at[1]);
    let upper = mesh.positions.iter().filter(|at| at[2] > 0.0);
    let nearest = upper.min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let top = scale * nearest.expect("it has an upper side")[2];
    (spm(mesh, &BuildOptions::default()), top)
}

/// A slide in rounds of a radius, metres.
fn slide(top: f64, radius_m: f64) -> ScenePlan {
    let at = |t: f64, x: f64, y: f64, z: f64| (t, Pose::at(DVec3::new(x, y, z)));
    let mut points = vec![
        at(0.0, 0.0, 0.0, top + 0.02),
        at(0.8, 0.0, 0.0, top + 0.005),
    ];
    let steps = 150;
    for k in 0..=steps {
        let t = SLIDE_S * f64::from(k) / f64::from(steps);
        let angle = TAU * t / ROUND_S;
        let (x, y) = (radius_m * (1.0 - angle.cos()), radius_m * angle.sin());
        points.push(at(APPROACH_S + t, x, y, top - DEPTH_M));
    }
    let mut plan = plan("");
    plan.probes[0].trajectory = TrajectoryPlan::Points(points);
    plan
}

/// What a slide came to.
#[derive(Default)]
struct Felt {
    /// The largest change of the force in a tick over what is not felt and what the device's own
    /// motion makes of it.
    worst: f64,
    /// Ticks with a pressed contact of some age, and those of them with less than half its force.
    pressed: u64,
    muted: u64,
    /// Share of the contact at full resolution.
    full: f64,
    /// How slow the governor believed the machine to be at most, ticks that spent more than they
    /// might, and changes of the finest tolerance.
    slowest: f64,
    over: u64,
    changes: u64,
}

/// `slow`: how many times as long as the costs say the work of a tick takes.
fn felt(
    model: &[u8],
    plan: &ScenePlan,
    bytes_per_tick: f64,
    slow: impl Fn(u64) -> f64,
    observer: &mut impl StageObserver,
) -> Felt {
    let link = LinkModel {
        delay_ticks: 50,
        bytes_per_tick,
        is_compact: true,
        ..LinkModel::default()
    };
    let options = ClientOptions {
        link,
        ..ClientOptions::default()
    };
    let client = Client::new(plan, options);
    let mut world: World = Simulation::new(station(plan, model, STATION), client);
    let surface = plan.objects[0].surface;
    let stiffness = surface.stiffness_n_per_m;
    let mut felt = Felt::default();
    let (mut last, mut moved_before, mut age) = (None, 0.0, 0);
    let mut last_tolerance = None;
    for tick in 0..((APPROACH_S + SLIDE_S) / PERIOD_S) as u64 {
        let record = world.advance(Drive::Hands, observer).record;
        let took = slow(tick) * f64::from(record.spent_ns);
        world
            .controller_mut()
            .note_work(MeasuredTick::of_work(took as u32));
        let tolerance = record.finest_tolerance_m;
        felt.slowest = felt.slowest.max(record.slowness);
        felt.over += u64::from(record.spent_ns > record.allowed_ns);
        felt.changes += u64::from(last_tolerance.replace(tolerance) != Some(tolerance));
        let force = world.force();
        assert!(force.is_finite(), "tick {tick}: {force}");
        let sample = world.client().samples()[0].expect("the hand gives one");
        let now = (sample.pose.position, force);
        age = if record.contact { age + 1 } else { 0 };
        if age as f64 * PERIOD_S > HAS_RETURNED_S && record.depth_m > PRESSED_M {
            felt.pressed += 1;
            felt.muted += u64::from(force.length() < 0.5 * stiffness * record.depth_m);
        }
        if let Some((place, before)) = last.replace(now) {
            let before: DVec3 = before;
            let moved = now.0.distance(place);
            // The spring's two ends, and the damper's change of velocity.
            let made = 2.0 * stiffness * moved
                + surface.damping_ns_per_m * (moved + moved_before) / PERIOD_S;
            let unfelt = STEP_N_PER_S.max(STEP_SHARE_PER_S * before.length()) * PERIOD_S;
            felt.worst = felt.worst.max(force.distance(before) / (unfelt + made));
            moved_before = moved;
        }
    }
    felt.full = world.summary().full_share();
    felt
}

#[test]
fn the_force_turns_gently_and_is_not_muted() {
    let mut pressed = 0;
    for seed in 1..=4 {
        let (model, top) = relief(seed);
        let plan = slide(top, RADIUS_M);
        for line in [f64::INFINITY, THIN, THINNEST] {
            let felt = felt(&model, &plan, line, |_| 1.0, &mut NoObserver);
            let Felt {
                worst,
                muted,
                pressed: of,
                full,
                ..
            } = felt;
            let name = format!("seed {seed}, {line} bytes a tick");
            println!(
                "{name}: {worst:.3} of what is allowed, {muted} of {of} muted, {full:.3} full"
            );
            assert!(worst <= 1.0, "{name}: {worst}");
            assert_eq!(muted, 0, "{name}: of {of}");
            pressed += of;
        }
    }
    assert!(pressed > 50_000, "{pressed}");
}

#[test]
fn a_budget_that_changes_is_not_felt() {
    // A machine as fast as the costs say, then many times slower, for half a second each.
    let slow = |tick: u64| [1.0, 8.0, 2.0, 24.0][(tick / 500 % 4) as usize];
    for (seed, radius_m) in [(1, 0.0), (2, 0.0), (1, RADIUS_M), (2, RADIUS_M)] {
        let (model, top) = relief(seed);
        let plan = slide(top, radius_m);
        let felt = felt(&model, &plan, f64::INFINITY, slow, &mut NoObserver);
        let name = format!("seed {seed}, rounds of {radius_m} m");
        println!(
            "{name}: {:.3} of what is allowed, slowness {:.1}, {} changes of the tolerance, {:.3} full",
            felt.worst, felt.slowest, felt.changes, felt.full
        );
        assert!(felt.worst <= 1.0, "{name}: {}", felt.worst);
        assert!(felt.slowest > 20.0 && felt.pressed > 6_000, "{name}");
        assert_eq!(
            felt.over, 0,
            "{name}: ticks that spent more than they might"
        );
    }
}

/// Ends the time of ticks at drawn questions: for half a second of none, of every other one, and of
/// every one at its first question.
struct Ends {
    draws: u64,
    tick: u64,
    left: [u64; Timed::ALL.len()],
    ended: u64,
}

impl Ends {
    fn new(seed: u64) -> Self {
        Self {
            draws: seed,
            tick: 0,
            left: [u64::MAX; Timed::ALL.len()],
            ended: 0,
        }
    }

    /// Of a linear congruential generator (Knuth, MMIX).
    fn draw(&mut self) -> u64 {
        let next = self.draws.wrapping_mul(6_364_136_223_846_793_005);
        self.draws = next.wrapping_add(1_442_695_040_888_963_407);
        self.draws >> 33
    }
}

impl StageObserver for Ends {
    fn ended(&mut self, stage: Stage) {
        if stage != Stage::Force {
            return;
        }
        self.ended += u64::from(self.left.contains(&0));
        self.tick += 1;
        for kind in Timed::ALL {
            self.left[kind as usize] = match self.tick / 500 % 3 {
                0 => u64::MAX,
                1 if self.draw().is_multiple_of(2) => u64::MAX,
                1 => self.draw() % 64,
                _ => 0,
            };
        }
    }

    fn is_over(&mut self, work: Timed) -> bool {
        let left = &mut self.left[work as usize];
        *left = left.saturating_sub(1);
        *left == 0
    }
}

#[test]
fn a_tick_that_runs_out_of_time_is_not_felt() {
    for (seed, radius_m) in [
        (1, 0.0),
        (2, RADIUS_M),
        (3, RADIUS_M),
        (4, RADIUS_M),
        (5, 0.0),
        (6, RADIUS_M),
    ] {
        let (model, top) = relief(seed);
        let (plan, mut ends) = (slide(top, radius_m), Ends::new(seed));
        let felt = felt(&model, &plan, f64::INFINITY, |_| 1.0, &mut ends);
        let name = format!("seed {seed}, rounds of {radius_m} m");
        println!(
            "{name}: {:.3} of what is allowed, {} ticks out of time, {:.3} full, {} of {} muted",
            felt.worst, ends.ended, felt.full, felt.muted, felt.pressed
        );
        assert!(felt.worst <= 1.0, "{name}: {}", felt.worst);
        assert!(ends.ended > 3_000 && felt.pressed > 6_000, "{name}");
        assert_eq!(felt.muted, 0, "{name}");
    }
}
