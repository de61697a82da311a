//! Periods that were skipped: the controller could not run, but the hand moved on.

use crate::common::{World, plan, scene_plan, scene_world, spm, world};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use scene::{Effect, EffectPlan, InertiaPlan, TrajectoryPlan};
use simulator::Random;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Ticks until the base mesh is there and the force's ramp has opened.
const SETTLE: u64 = 600;

/// Forces of a press at constant speed (m/s) after each step of so many periods, and the ticks.
fn press(periods: u64, speed_m_per_s: f64) -> Vec<(u64, DVec3)> {
    let mut plan = scene_plan(&[("ball.spm", 0.1, DVec3::ZERO)], 1, 8 << 20);
    plan.objects[0].surface.damping_ns_per_m = 100.0;
    let model = spm(generate(Shape::Sphere, 1500, 1), &BuildOptions::default());
    let mut world = scene_world(&plan, &[("ball.spm", &model)], 0.0);
    let start = DVec3::Z * 0.0515;
    for _ in 0..SETTLE {
        world.step_at(start);
    }
    let first = world.tick();
    let mut forces = Vec::new();
    while world.tick() < first + 900 {
        world.skip(periods - 1);
        let tick = world.tick();
        let down = speed_m_per_s * 1e-3 * (tick - first + 1) as f64;
        world.step_at(start - DVec3::Z * down);
        forces.push((tick, world.force()));
    }
    forces
}

#[test]
fn damping_is_that_of_the_speed_whatever_was_skipped() {
    let speed = 2e-3;
    let smooth = press(1, speed);
    for periods in [2, 18, 60] {
        let mut compared = 0;
        for (tick, force) in press(periods, speed) {
            let expected = smooth.iter().find(|(of, _)| *of == tick);
            let Some((_, expected)) = expected.filter(|(_, force)| force.length() > 0.7) else {
                continue;
            };
            let differs = force.distance(*expected) / expected.length();
            // A force of 0.2 N is damping: nineteen times that would be 3.6 N more.
            assert!(
                differs < 0.05,
                "{periods} periods, tick {tick}: {force}, {expected}"
            );
            compared += 1;
        }
        println!("steps of {periods} periods: {compared} forces compared");
        assert!(compared > 3, "{periods}");
    }
}

#[test]
fn the_mass_of_an_inertia_moves_through_skipped_periods() {
    let forces = |periods: u64| {
        let mut plan = scene_plan(&[("ball.spm", 0.1, DVec3::ZERO)], 1, 8 << 20);
        plan.effects = vec![EffectPlan {
            effect: Effect::Inertia(InertiaPlan {
                mass_kg: 0.2,
                stiffness_n_per_m: 400.0,
                damping_ns_per_m: 4.0,
            }),
            from_s: 0.0,
            until_s: f64::INFINITY,
            fade_s: 0.1,
        }];
        let model = spm(generate(Shape::Sphere, 1500, 1), &BuildOptions::default());
        let mut world = scene_world(&plan, &[("ball.spm", &model)], 0.0);
        let start = DVec3::Z * 0.1;
        for _ in 0..SETTLE {
            world.step_at(start);
        }
        let first = world.tick();
        let mut forces = Vec::new();
        while world.tick() < first + 900 {
            // The period of every force is as long as any other.
            let stall = if world.tick() == first + 400 {
                periods - 1
            } else {
                0
            };
            world.skip(stall);
            let tick = world.tick();
            world.step_at(start + DVec3::X * (1e-4 * (tick - first + 1) as f64));
            forces.push((tick - first, world.force()));
        }
        forces
    };
    let smooth = forces(1);
    for periods in [2, 19] {
        let mut compared = 0;
        for (tick, force) in forces(periods) {
            let expected = smooth.iter().find(|(of, _)| *of == tick);
            let Some((_, expected)) = expected else {
                continue;
            };
            // At an even speed the mass pulls ever less.
            assert!(
                force.distance(*expected) < 0.02,
                "{periods} periods, tick {tick}: {force}, {expected}"
            );
            compared += u32::from(tick > 400 && expected.length() > 0.0);
        }
        assert!(compared > 100, "{periods} periods: {compared} compared");
    }
}

#[test]
fn a_long_stall_takes_waiting_chunks_first_and_ends_no_epoch() {
    let seed = 3;
    println!("seed {seed}");
    let mut random = Random::new(seed);
    let model = spm(generate(Shape::Relief, 30_000, 1), &BuildOptions::default());
    let mut world = world(&plan(""), &model, 20.0);
    for _ in 0..1500 {
        world.step_led();
    }
    let before = world.summary().last.resubscribed;
    let mut waited = 0;
    for _ in 0..20 {
        for _ in 0..20 + random.below(80) {
            world.step_led();
        }
        // In the middle of answers, if there are any.
        for _ in 0..200 {
            if world.client().inbox_len() > 0 {
                break;
            }
            world.step_led();
        }
        waited += u32::from(world.client().inbox_len() > 0);
        world.skip(300);
    }
    println!("{waited} stalls with chunks that waited");
    assert!(waited > 5, "{waited}");
    assert_eq!(world.summary().last.resubscribed, before);
}

#[test]
fn a_stall_at_rest_leaves_the_front_as_it_is() {
    let model = spm(generate(Shape::Relief, 30_000, 1), &BuildOptions::default());
    let mut plan = plan("");
    let inside = crate::common::places_on_tour(&plan, &model, [2.0])[0];
    plan.probes[0].trajectory = TrajectoryPlan::Points(Vec::new());
    let mut world: World = world(&plan, &model, 0.0);
    crate::common::rest(&mut world, inside, 6000);
    let faces = world.summary().last.active_faces;
    for periods in [50, 300, 5000] {
        world.skip(periods);
        for _ in 0..100 {
            let record = world.step(Some(Sample::at(Pose::at(inside.goal)))).record;
            let changes = (record.vsplits, record.ecols);
            assert_eq!(changes, (0, 0), "after {periods} skipped periods");
            assert_eq!(record.active_faces, faces);
        }
    }
}
