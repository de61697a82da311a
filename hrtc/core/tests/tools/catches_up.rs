//! A tool that has fallen behind its device, by a jump or by its budget, catches up where nothing
//! is between; the lag of an unfinished tick is no force.

use crate::common::fronts::{Front, box_mesh, plate_mesh};
use crate::common::guided_tool::{GuidedTool, MIN_TICK_BUDGET, TICK_BUDGET};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use hrtc_core::contact::coupling::Coupling;
use hrtc_core::contact::motion::Twist;
use hrtc_core::contact::query::{Deadline, Limit};
use hrtc_core::contact::rigid_proxy::ToolAdvance;
use hrtc_core::contact::tool::{ToolMesh, capsule_mesh};

const STIFFNESS: f64 = 800.0;
const RADIUS: f64 = 0.003;
const LENGTH: f64 = 0.02;
const PLATE: f64 = 0.04;
/// What a scene allows a tick, pairs of nodes.
const BUDGET: u32 = 1 << 14;

fn capsule() -> GuidedTool {
    GuidedTool::new(capsule_mesh(RADIUS, LENGTH, 24, 20))
}

/// Upright, with its tip at a place.
fn upright(tip: DVec3) -> Pose {
    Pose::at(tip + DVec3::Z * (0.5 * LENGTH))
}

fn lead(hand: &mut GuidedTool, front: &Front, pose: &Pose, budget: u32) -> (ToolAdvance, Wrench) {
    let answer = hand.proxy.advance(front.surface(), pose, budget);
    assert!(answer.spent <= budget, "{} of {budget}", answer.spent);
    let spring = Coupling {
        stiffness_n_per_m: STIFFNESS,
        damping_ns_per_m: 0.0,
    };
    (answer, hand.proxy.wrench(&spring, 1.0, &Twist::default()))
}

#[test]
fn a_jump_through_free_air_is_followed_without_a_force() {
    for pieces in [8, 100] {
        let plate = Front::of_mesh(&plate_mesh(PLATE, pieces));
        for (from, to, ticks) in [
            (DVec3::Z * 0.05, DVec3::Z * 0.002, 10),
            // All along the plate much is near.
            (
                DVec3::new(0.03, 0.0, 0.001),
                DVec3::new(-0.03, 0.01, 0.001),
                40,
            ),
        ] {
            let mut hand = capsule();
            for _ in 0..10 {
                lead(&mut hand, &plate, &upright(from), BUDGET);
            }
            let goal = upright(to);
            for tick in 0..ticks {
                let (_, measured) = lead(&mut hand, &plate, &goal, BUDGET);
                assert_eq!(measured, Wrench::ZERO, "{pieces} pieces, tick {tick}");
                assert!(!hand.meets(&plate));
            }
            assert_eq!(hand.proxy.pose(), goal, "{pieces} pieces");
        }
    }
}

/// The look-ahead is a small part of the tool, the motion of a tick up to all of it.
#[test]
fn a_fast_motion_through_free_air_is_made_in_each_tick() {
    let plate = Front::of_mesh(&plate_mesh(PLATE, 8));
    for motion in [0.001, 0.01, 0.1, 1.0].map(|of| of * LENGTH) {
        let mut hand = capsule();
        for k in 0..40 {
            let goal = upright(DVec3::Z * (0.05 + motion * f64::from(40 - k)));
            lead(&mut hand, &plate, &goal, BUDGET);
            assert_eq!(hand.proxy.pose(), goal, "{motion} m a tick, tick {k}");
        }
    }
}

#[test]
fn a_jump_along_the_surface_feels_its_depth_and_no_more() {
    let plate = Front::of_mesh(&plate_mesh(PLATE, 60));
    let depth = 0.001;
    let mut hand = capsule();
    for k in 0..100 {
        let height = 0.009 - 1e-4 * f64::from(k);
        lead(
            &mut hand,
            &plate,
            &upright(DVec3::new(-0.02, 0.0, height.max(-depth))),
            BUDGET,
        );
    }
    let goal = upright(DVec3::new(0.02, 0.01, -depth));
    let due = STIFFNESS * depth;
    for tick in 0..30 {
        let measured = lead(&mut hand, &plate, &goal, BUDGET).1.force;
        assert!(measured.length() < 1.5 * due, "tick {tick}: {measured}");
        assert!(!hand.meets(&plate));
    }
    let measured = lead(&mut hand, &plate, &goal, BUDGET).1.force;
    assert!(
        (measured - DVec3::Z * due).length() < 0.02 * due,
        "{measured}"
    );
}

/// A device that jumps by the tool's length in contact has its tool back in a few ticks: what is
/// known ahead grows while the tool is behind.
#[test]
fn a_jump_in_contact_is_made_good_in_few_ticks() {
    let mut bumpy = plate_mesh(PLATE, 160);
    for p in &mut bumpy.positions {
        p.z = 0.0003 * ((p.x * 900.0).sin() + (p.y * 800.0).sin());
    }
    let front = Front::of_mesh(&bumpy);
    let mut hand = capsule();
    let at = |along: f64, height: f64| upright(DVec3::new(along, 0.0, height));
    for k in 0..120 {
        let height = 0.002 - 2.5e-5 * f64::from(k);
        lead(&mut hand, &front, &at(-0.01, height), TICK_BUDGET);
    }
    let mut ticks = 0;
    loop {
        let (answer, _) = lead(&mut hand, &front, &at(0.01, -0.001), TICK_BUDGET);
        assert!(!hand.meets(&front));
        ticks += 1;
        if !answer.is_unsettled || ticks > 300 {
            break;
        }
    }
    println!("{ticks} ticks");
    assert!(ticks <= 40, "{ticks} ticks");
}

/// With any budget the tool stays outside, and ends where a larger budget takes it.
#[test]
fn a_small_budget_makes_it_slow_and_not_wrong() {
    let mut bumpy = plate_mesh(PLATE, 120);
    for p in &mut bumpy.positions {
        p.z = 0.0005 * ((p.x * 900.0).sin() + (p.y * 800.0).sin());
    }
    let front = Front::of_mesh(&bumpy);
    let mut held = Vec::new();
    // A quarter of the least that a scene gives, that, and more than enough.
    for budget in [3000, MIN_TICK_BUDGET, 1 << 18] {
        let mut hand = capsule();
        let (mut unfinished, mut early, mut wildest) = (0, 0, 0.0f64);
        for k in 0..400 {
            let tip = DVec3::new(
                1e-4 * f64::from(k.min(200)),
                0.0,
                0.002 - 2e-5 * f64::from(k.min(150)),
            );
            let pose = Pose {
                orientation: DQuat::from_rotation_y(0.002 * f64::from(k.min(200))),
                ..upright(tip)
            };
            let (answer, measured) = lead(&mut hand, &front, &pose, budget);
            unfinished += u32::from(!answer.ending.is_complete());
            early += u32::from(answer.ending.is_complete() && answer.is_unsettled);
            let (there, here) = (hand.proxy.pose().position, pose.position);
            let is_told = answer.is_unsettled || !answer.contacts().is_empty();
            assert!(
                is_told || there.distance(here) < 1e-9,
                "tick {k}: {answer:?}"
            );
            wildest = wildest.max(measured.force.length());
            assert!(!hand.meets(&front), "tick {k}");
        }
        held.push((hand.proxy.pose().position, wildest, [unfinished, early]));
    }
    let (rich, most, _) = held[2];
    for (k, &(poor, wildest, [unfinished, early])) in held.iter().enumerate() {
        assert!(poor.distance(rich) < 0.05e-3, "{k}: {poor} {rich} {held:?}");
        assert!(wildest < 1.5 * most, "{held:?}");
        assert!(
            k > 0 || (unfinished > 0 && early > 0),
            "the small budget matters, and ticks that end early are told: {held:?}"
        );
    }
}

/// With any budget the force changes by what the device moves and by what is not felt, also where
/// contacts are found that an estimate did not know.
#[test]
fn with_any_budget_no_tick_jolts() {
    let mut ridges = plate_mesh(PLATE, 120);
    for p in &mut ridges.positions {
        p.z = 0.002 * ((p.x * 500.0).sin() * (p.y * 450.0).sin()).max(0.0);
    }
    let front = Front::of_mesh(&ridges);
    for budget in [1500, 3000, MIN_TICK_BUDGET, 1 << 18] {
        let mut hand = capsule();
        let (mut early, mut late, mut last) = (0, 0, DVec3::ZERO);
        for k in 0..900 {
            // At 0.3 m/s, up to 3 mm below the tops.
            let along = 3e-4 * f64::from(k % 200) - 0.03;
            let side = 0.005 * f64::from(k / 200) - 0.01;
            let height = 0.003 - 2e-5 * f64::from(k.min(200));
            let before = hand.proxy.deflection();
            let goal = upright(DVec3::new(along, side, height));
            let (answer, measured) = lead(&mut hand, &front, &goal, budget);
            early += u32::from(answer.is_unsettled);
            late += answer.late_contacts;
            // From the end of a row to the next it jumps.
            if k % 200 > 0 {
                let own = 3e-4 + 2e-5;
                let felt = own + 0.07 * before + hand.proxy.contact_offset();
                let change = measured.force.distance(last) / STIFFNESS;
                assert!(change <= felt, "{budget}, tick {k}: {change} m of {felt} m");
            }
            assert!(!hand.meets(&front), "{budget}, tick {k}");
            last = measured.force;
        }
        assert!(
            budget > 3000 || (early > 0 && late > 0),
            "the budget matters: {early} early, {late} late"
        );
    }
}

/// Behind an edge the coupling follows the proxy over some ticks. That is no wrong estimate: only
/// after a tick that ended early a contact counts as late.
#[test]
fn a_contact_is_late_only_after_an_early_tick() {
    let half = 0.02;
    let block = Front::of_mesh(&box_mesh(DVec3::splat(half)));
    for budget in [400, 1000, 3000, MIN_TICK_BUDGET] {
        let mut hand = capsule();
        let mut was_early = false;
        for k in 0..600 {
            let along = half - 0.005 + 1e-4 * f64::from(k.max(300) - 300);
            let height = half + 0.001 - 1e-5 * f64::from(k.min(300));
            let goal = upright(DVec3::new(along, 0.001, height));
            let (answer, _) = lead(&mut hand, &block, &goal, budget);
            assert!(
                was_early || answer.late_contacts == 0,
                "{budget}, tick {k}: {answer:?}"
            );
            was_early = answer.is_unsettled;
        }
    }
}

/// A tip over a vertex with a large fan: all their pairs are near at once, and to look at them for
/// contacts takes more than a tick. The search goes on from tick to tick, so the tool comes along.
#[test]
fn a_tip_on_a_large_fan_comes_along_at_a_small_budget() {
    const SIDES: u32 = 140;
    const BUDGET: u32 = MIN_TICK_BUDGET / 2;
    const SLOPE: f64 = 0.05;
    let rim = |k: u32| {
        let angle = std::f64::consts::TAU * f64::from(k) / f64::from(SIDES);
        DVec3::new(PLATE * angle.cos(), PLATE * angle.sin(), -SLOPE * PLATE)
    };
    let mut positions: Vec<DVec3> = (0..SIDES).map(rim).collect();
    positions.extend([DVec3::ZERO, -PLATE * DVec3::Z]);
    let sides = (0..SIDES).flat_map(|k| {
        let next = (k + 1) % SIDES;
        [[k, next, SIDES], [next, k, SIDES + 1]]
    });
    let cone = Front::of_mesh(&ToolMesh {
        positions,
        triangles: sides.collect(),
    });
    let mut hand = GuidedTool::new(capsule_mesh(RADIUS, LENGTH, 10, 12));
    let aim = |tick: u32| {
        let t = f64::from(tick);
        let out = 1e-5 * (t - 400.0).max(0.0);
        upright(DVec3::new(out, 0.0, 0.002 - (1e-5 * t).min(0.003)))
    };
    let mut unfinished = 0;
    for tick in 0..1400 {
        let answer = lead(&mut hand, &cone, &aim(tick), BUDGET).0;
        unfinished += u32::from(!answer.ending.is_complete());
        assert!(!hand.meets(&cone), "tick {tick}");
    }
    let behind = aim(1399).position - hand.proxy.pose().position;
    println!("{unfinished} ticks unfinished, in the end {behind} behind");
    assert!(unfinished > 20, "{unfinished}");
    // It lies on the cone, but for what the device is pressed into it.
    assert!(behind.x.abs() < 5e-4 && behind.z > -0.002, "{behind}");
}

/// The time is over when it is asked for.
struct Over;

impl Deadline for Over {
    fn is_over(&mut self) -> bool {
        true
    }
}

/// Where every tick is late a tool is sure of little work, less than it takes to place the vertices
/// that are near: it comes along all the same, and down onto the plate.
#[test]
fn a_tool_comes_along_where_every_tick_is_late() {
    /// What is sure whatever the time, and the work between two questions.
    const SURE: [u32; 2] = [600, 160];
    let plate = Front::of_mesh(&plate_mesh(PLATE, 60));
    let lying = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    for (rounds, rings) in [(24, 20), (80, 60)] {
        let mut hand = GuidedTool::new(capsule_mesh(RADIUS, LENGTH, rounds, rings));
        let aim = |tick: u32| {
            let t = f64::from(tick);
            let along = 1e-5 * (t - 400.0).clamp(0.0, 500.0);
            let down = (1e-5 * t).min(0.0025);
            Pose {
                position: DVec3::new(along, 0.0, RADIUS + 0.002 - down),
                orientation: lying,
            }
        };
        let mut arrived = None;
        for tick in 0..4000 {
            let mut over = Over;
            let limit = Limit::new(BUDGET, SURE, &mut over);
            let answer = hand.proxy.advance(plate.surface(), &aim(tick), limit);
            assert!(answer.spent <= BUDGET);
            assert!(!hand.meets(&plate), "tick {tick}");
            let behind = aim(tick).position - hand.proxy.pose().position;
            if tick > 900 && behind.x.abs() < 1e-5 && behind.z.abs() < 6e-4 {
                arrived = arrived.or(Some(tick));
            }
        }
        println!("{rounds} by {rings}: along with the device from tick {arrived:?} on");
        assert!(arrived.is_some());
    }
}

/// A rod in a hole that fits closely: thousands of pairs are near all the time, so that their
/// collection, the search for contacts and the sweep of a step take several ticks together. The
/// step goes on from tick to tick, and the tool goes as deep as the device does.
#[test]
fn a_rod_in_a_close_hole_comes_along_at_a_small_budget() {
    const SIDES: u32 = 160;
    const RINGS: u32 = 60;
    const TICKS: u32 = 6000;
    const DEPTH: f64 = 0.8 * LENGTH;
    let play = 0.01 * RADIUS;
    // The wall of the hole, seen from inside.
    let corner = |ring: u32, side: u32| ring * SIDES + side % SIDES;
    let place = |k: u32| {
        let angle = std::f64::consts::TAU * f64::from(k % SIDES) / f64::from(SIDES);
        let depth = LENGTH * f64::from(k / SIDES) / f64::from(RINGS);
        let wide = (RADIUS + play) / (std::f64::consts::PI / f64::from(SIDES)).cos();
        DVec3::new(wide * angle.cos(), wide * angle.sin(), -depth)
    };
    let quads = (0..RINGS).flat_map(|ring| (0..SIDES).map(move |side| [ring, side]));
    let wall = quads.flat_map(|[ring, side]| {
        let [a, b] = [corner(ring, side), corner(ring, side + 1)];
        let [c, d] = [corner(ring + 1, side), corner(ring + 1, side + 1)];
        [[a, b, d], [a, d, c]]
    });
    let hole = Front::of_mesh(&ToolMesh {
        positions: (0..SIDES * (RINGS + 1)).map(place).collect(),
        triangles: wall.collect(),
    });
    let mut hand = capsule();
    let aim = |tick: u32| {
        let share = f64::from(tick) / f64::from(TICKS / 2);
        let depth = DEPTH * share.min(1.0) - 0.1 * LENGTH;
        let aside = 2.0 * play * share.min(1.0);
        upright(DVec3::new(aside, 0.0, -depth))
    };
    let mut unfinished = 0;
    for tick in 0..TICKS {
        let answer = lead(&mut hand, &hole, &aim(tick), MIN_TICK_BUDGET / 2).0;
        unfinished += u32::from(!answer.ending.is_complete());
        assert!(!hand.meets(&hole), "tick {tick}");
    }
    let behind = aim(TICKS).position - hand.proxy.pose().position;
    println!("{unfinished} ticks unfinished, in the end {behind} behind");
    assert!(unfinished > TICKS / 10, "{unfinished}");
    assert!(behind.z.abs() < 1e-5, "{behind}");
}

/// A face of the surface with more of the tool near it than a tick may look at: the collection goes
/// on within it, so that the tool arrives all the same.
#[test]
fn a_face_with_more_of_the_tool_near_than_a_tick_allows() {
    const TICKS: u32 = 4000;
    let plate = Front::of_mesh(&plate_mesh(PLATE, 1));
    for (pieces, budget) in [(24, 600), (24, 3000), (50, 3000), (50, 12_000)] {
        let mut hand = GuidedTool::new(plate_mesh(0.5 * LENGTH, pieces));
        let aim = |tick: u32| {
            let down = 1e-5 * f64::from(tick.min(250));
            Pose::at(DVec3::Z * (0.002 - down))
        };
        let mut unfinished = 0;
        for tick in 0..TICKS {
            let (answer, _) = lead(&mut hand, &plate, &aim(tick), budget);
            unfinished += u32::from(!answer.ending.is_complete());
            assert!(!hand.meets(&plate), "tick {tick}");
        }
        let height = hand.proxy.pose().position.z;
        println!("{pieces} pieces, {budget}: {unfinished} unfinished, ends at {height}");
        assert!(height < 1e-4, "{pieces} pieces, {budget}: ends at {height}");
    }
}
