//! The rate of the loop changes no time that is felt or waited for, and no force.

use crate::common::{World, plan, scene_plan, scene_station, scene_world, spm};
use geometry::closest_point_on_segment;
use glam::DVec3;
use hrtc_core::lod::predict::TURNS;
use scene::TrajectoryPlan;
use simulator::{Client, ClientOptions, STATION, Simulation};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Radius of the balls, metres.
const BALL: f64 = 0.05;
const RADIUS: f64 = 0.001;
/// Time of the press, and of the silence after it, seconds.
const PRESSED_S: f64 = 2.0;
const SILENT_S: f64 = 1.0;
/// Speed of the lift, m/s.
const LIFT_M_PER_S: f64 = 0.05;

/// What a run shows, seconds and newtons.
#[derive(Debug)]
struct Shown {
    /// The force at the end of the press.
    pressed_n: f64,
    /// Start and end of the fall of the force of a device that is silent.
    falls_s: f64,
    fallen_s: f64,
    /// Until the front behind a probe that leaves is first made coarser.
    coarser_s: f64,
    /// Until a probe that is gone has no proxy at the object.
    forgotten_s: f64,
}

/// Steps until something is so; the time since `from`, seconds.
fn time_until(
    world: &mut World,
    rate_hz: f64,
    mut place: impl FnMut(f64) -> Option<DVec3>,
    is_so: impl Fn(&World) -> bool,
) -> f64 {
    let from = world.tick();
    loop {
        let seconds = (world.tick() - from) as f64 / rate_hz;
        assert!(seconds < 5.0, "it is so at last");
        world.step_places(&[place(seconds)]);
        if is_so(world) {
            return seconds;
        }
    }
}

fn run(rate_hz: f64, model: &[u8]) -> Shown {
    let balls = [
        ("a.spm", 2.0 * BALL, DVec3::ZERO),
        ("b.spm", 2.0 * BALL, DVec3::X),
    ];
    let mut plan = scene_plan(&balls, 1, 16 << 20);
    plan.loop_.rate_hz = rate_hz;
    let mut world = scene_world(&plan, &[("a.spm", model), ("b.spm", model)], 0.0);
    let at = |gap: f64| Some(DVec3::Z * (BALL + RADIUS + gap));
    for _ in 0..(PRESSED_S * rate_hz) as u64 {
        let t = world.tick() as f64 / rate_hz;
        let down = ((t - 1.0) / 0.3).clamp(0.0, 1.0);
        world.step_places(&[at(0.02 - 0.021 * down)]);
    }
    let pressed_n = world.force().length();
    let falls_s = time_until(
        &mut world,
        rate_hz,
        |_| None,
        |world| world.force().length() < 0.99 * pressed_n,
    );
    let more_s = time_until(
        &mut world,
        rate_hz,
        |_| None,
        |world| world.force() == DVec3::ZERO,
    );
    for _ in 0..(SILENT_S * rate_hz) as u64 {
        world.step_places(&[at(-0.001)]);
    }
    let coarser_s = time_until(
        &mut world,
        rate_hz,
        |t| at(-0.001 + LIFT_M_PER_S * t),
        |world| world.outputs().record.ecols > 0,
    );
    let gone = Some(DVec3::new(0.5, 0.5, 0.5));
    let forgotten_s = time_until(
        &mut world,
        rate_hz,
        |_| gone,
        |world| world.controller().proxy_of(0, 0).is_none(),
    );
    Shown {
        pressed_n,
        falls_s,
        fallen_s: falls_s + more_s,
        coarser_s,
        forgotten_s,
    }
}

#[test]
fn times_and_forces_are_those_of_any_rate() {
    let model = spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default());
    let expected = run(1000.0, &model);
    println!("1000 Hz: {expected:?}");
    assert!(expected.pressed_n > 0.5 && expected.forgotten_s > 0.09);
    for rate_hz in [100.0, 500.0, 4000.0, 10_000.0] {
        let shown = run(rate_hz, &model);
        println!("{rate_hz} Hz: {shown:?}");
        let slower_s = 1.0 / f64::min(rate_hz, 1000.0);
        let two = 2.0 * slower_s + 1e-9;
        // A region is predicted once a round.
        let round = (TURNS + 2) as f64 * slower_s;
        for (name, a, b, within) in [
            ("falls", shown.falls_s, expected.falls_s, two),
            ("fallen", shown.fallen_s, expected.fallen_s, two),
            ("coarser", shown.coarser_s, expected.coarser_s, round),
            ("forgotten", shown.forgotten_s, expected.forgotten_s, two),
        ] {
            assert!(
                (a - b).abs() <= within,
                "{rate_hz} Hz: {name}: {a} s, {b} s"
            );
        }
        let differs = (shown.pressed_n / expected.pressed_n - 1.0).abs();
        assert!(differs < 0.01, "{rate_hz} Hz: {} N", shown.pressed_n);
    }
}

/// Length of the tours that are compared, seconds.
const TOUR_S: f64 = 6.0;
/// How much earlier or later a path may be at a place, seconds: the hold delays the force by half a
/// period, and the hand gives way as much later.
const SHIFT_S: f64 = 0.02;

/// Force of a touch that is compared, newtons: one that grazes is at one rate and not at another
/// (the limit of a change in a tick of 4 kHz is 12 mN).
const FELT_N: f64 = 0.01;

/// Seconds from the first contact on that are not compared: in the soft start of 0.2 s nothing
/// holds the hand, and where it presses deeper than the ball is large its contact may come to
/// either side of a ridge.
const START_S: f64 = 0.4;

/// A contact of a tour.
struct Touch {
    /// Since the first one.
    seconds: f64,
    /// World, metres.
    place: DVec3,
    is_felt: bool,
}

/// The contacts of a tour, and the share of them at full resolution.
fn path(rate_hz: f64, seed: u64, model: &[u8]) -> (Vec<Touch>, f64) {
    let mut plan = plan("");
    plan.loop_ = plan.loop_.at_rate(rate_hz);
    if let TrajectoryPlan::Tour { seed: of_tour, .. } = &mut plan.probes[0].trajectory {
        *of_tour = seed;
    }
    let mut options = ClientOptions {
        tour_s: TOUR_S,
        ..ClientOptions::default()
    };
    options.link = options.link.at_rate(rate_hz);
    let station = scene_station(&plan, &[("model.spm", model)], STATION);
    let mut world: World = Simulation::new(station, Client::new(&plan, options));
    let (mut contacts, mut full, mut first) = (Vec::new(), 0, None);
    for tick in 0..((TOUR_S + 1.0) * rate_hz) as u64 {
        let outputs = world.step_led();
        let (contact, is_full) = (outputs.contact(), outputs.record.contact_full);
        if let (Some(contact), Some(frame)) = (contact, world.controller().frame()) {
            let first = *first.get_or_insert(tick);
            let seconds = (tick - first) as f64 / rate_hz;
            contacts.push(Touch {
                seconds,
                place: frame.to_world(contact.point),
                is_felt: world.force().length() > FELT_N,
            });
            full += u32::from(is_full);
        }
    }
    let share = f64::from(full) / contacts.len() as f64;
    (contacts, share)
}

/// Distances of the contacts from another path, each within a short time, metres, ascending. The
/// path leads straight from one contact to the next: a tick of it is as long as the limit.
fn apart<'a>(contacts: impl Iterator<Item = &'a Touch>, other: &[Touch]) -> Vec<f64> {
    let distance = |of: &Touch| {
        let near = other
            .windows(2)
            .filter(|w| (w[0].seconds - of.seconds).abs() <= SHIFT_S);
        let distances = near.map(|w| {
            let [from, to] = [w[0].place, w[1].place];
            of.place
                .distance(from.lerp(to, closest_point_on_segment(from, to, of.place)))
        });
        distances.fold(f64::INFINITY, f64::min)
    };
    let mut all: Vec<f64> = contacts.map(distance).collect();
    all.sort_by(f64::total_cmp);
    all
}

#[test]
fn a_tour_has_the_same_contact_path_at_every_rate() {
    let model = spm(generate(Shape::Relief, 50_000, 1), &BuildOptions::default());
    for seed in 1..=3 {
        let (expected, _) = path(1000.0, seed, &model);
        for rate_hz in [250.0, 500.0, 2000.0, 4000.0] {
            let (contacts, full) = path(rate_hz, seed, &model);
            let name = format!("seed {seed}, {rate_hz} Hz");
            let compared = contacts
                .iter()
                .filter(|of| of.seconds > START_S && of.is_felt);
            let all = apart(compared, &expected);
            let at = |share: f64| all[(share * (all.len() - 1) as f64) as usize];
            let seconds = contacts.len() as f64 / rate_hz;
            println!(
                "{name}: {seconds:.3} s of {:.3} s in contact, {:.2} % full; apart {:.1} um, 99 % {:.1}, most {:.1}",
                expected.len() as f64 * 1e-3,
                100.0 * full,
                1e6 * at(0.5),
                1e6 * at(0.99),
                1e6 * at(1.0),
            );
            let shown = seconds / (expected.len() as f64 * 1e-3);
            assert!((shown - 1.0).abs() < 1e-2 && full > 0.999, "{name}");
            // A tenth of the ball, and where it passes an edge a little earlier or later half.
            assert!(at(0.99) < 0.1 * RADIUS && at(1.0) < 0.5 * RADIUS, "{name}");
        }
    }
}
