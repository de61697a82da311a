//! Objects that move in scenes: touched, pushed, driven and asleep, and at one and the same place
//! for every view of them.

use crate::common::{World, check, faulty, scene_plan, scene_station, scene_world, settle, spm};
use geometry::Pose;
use glam::{DQuat, DVec3};
use realtime::counting_allocator::count;
use scene::{
    DrivenPlan, FreePlan, HingePlan, MassPlan, MovablePlan, ProbeShape, RailPlan, ScenePlan,
    SpringDamperPlan,
};
use simulator::{LinkModel, Random};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::LazyLock;

static SPHERE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default()));

/// Radius of the balls, metres.
const BALL: f64 = 0.05;
const PERIOD_S: f64 = 1e-3;
const AS_USUAL: SpringDamperPlan = SpringDamperPlan {
    spring: 0.0,
    damping: None,
};
const LOOSE: SpringDamperPlan = SpringDamperPlan {
    spring: 0.0,
    damping: Some(0.0),
};
const MASS: MassPlan = MassPlan {
    mass_kg: 0.2,
    inertia_kgm2: None,
    gravity_m_per_s2: DVec3::ZERO,
};

fn free() -> MovablePlan {
    MovablePlan::Free(FreePlan {
        mass: MASS,
        linear: AS_USUAL,
        angular: AS_USUAL,
    })
}

fn driven(linear: DVec3, angular: DVec3) -> MovablePlan {
    MovablePlan::Driven(DrivenPlan {
        linear_m_per_s: linear,
        angular_rad_per_s: angular,
        anchor_m: DVec3::ZERO,
        period_s: None,
    })
}

/// Balls at some places.
fn balls(places: &[DVec3], probes: usize) -> ScenePlan {
    let objects: Vec<_> = places
        .iter()
        .map(|&at| ("sphere", 2.0 * BALL, at))
        .collect();
    let mut plan = scene_plan(&objects, probes, 16 << 20);
    plan.safety.ramp_s = 0.0;
    plan
}

fn scene(plan: &ScenePlan) -> World {
    scene_world(plan, &[("sphere", &SPHERE)], 0.0)
}

fn pose(world: &World, object: u32) -> Pose {
    let body = world.controller().movables().body(object);
    body.expect("it moves").pose()
}

/// Presses down on the first ball, a little aside, and leaves; the forces and the ball's poses of
/// every tick.
fn press(plan: &ScenePlan, ticks: u32) -> (Vec<[u64; 3]>, Vec<Pose>, u64) {
    let mut world = scene(plan);
    settle(&mut world, &[Some(DVec3::new(0.01, 0.0, 0.06))]);
    let (mut forces, mut poses) = (Vec::new(), Vec::new());
    for tick in 0..ticks {
        let depth = 4e-3 * (f64::from(tick) * 4e-3).sin().max(0.0);
        world.step_places(&[Some(DVec3::new(0.01, 0.0, 0.052 - depth))]);
        forces.push(
            world.outputs().wrenches[0]
                .force
                .to_array()
                .map(f64::to_bits),
        );
        if let Some(body) = world.controller().movables().body(0) {
            poses.push(body.pose());
        }
    }
    assert_eq!(world.client().allocations(), 0);
    (forces, poses, world.controller().replay_hash())
}

#[test]
fn a_scene_pays_for_what_moves_only_when_it_does() {
    assert!(count(|| vec![0u8; 100]) > 0, "the allocator counts");
    let far = [DVec3::ZERO, DVec3::X * 0.5, DVec3::X * 0.7];
    let standing = balls(&far, 1);
    let mut asleep = standing.clone();
    for object in 1..3 {
        asleep.objects[object].movable = Some(free());
    }
    let (forces, _, hash) = press(&standing, 1500);
    assert!(forces.iter().any(|force| f64::from_bits(force[2]) > 0.1));
    assert_eq!((forces, hash), {
        let (forces, _, hash) = press(&asleep, 1500);
        (forces, hash)
    });
}

#[test]
fn a_ball_that_is_pushed_rolls_on_comes_to_rest_and_sleeps() {
    let mut plan = balls(&[DVec3::ZERO, DVec3::X * 0.5], 1);
    plan.objects[0].movable = Some(free());
    let (forces, poses, hash) = press(&plan, 600);
    assert_eq!(hash, press(&plan, 600).2, "every run repeats");
    let pushed = poses.last().expect("it was stepped").position;
    println!("pushed to {pushed}");
    assert!(pushed.z < -1e-3 && pushed.x.abs() < 0.5 * pushed.z.abs());
    // It gives way: nothing like the 3.2 N that a ball that stands would give.
    let largest = forces
        .iter()
        .map(|f| f64::from_bits(f[2]))
        .fold(0.0, f64::max);
    assert!((0.05..3.0).contains(&largest), "{largest} N");

    // Left alone, with another object to look at, it goes on, loses its speed and sleeps; then not
    // a bit changes.
    let mut world = scene(&plan);
    settle(&mut world, &[Some(DVec3::new(0.01, 0.0, 0.06))]);
    assert_eq!(world.outputs().record.moving, 0, "untouched it sleeps");
    for tick in 0..200 {
        let z = 0.052 - 2e-5 * f64::from(tick);
        world.step_places(&[Some(DVec3::new(0.01, 0.0, z))]);
    }
    assert_eq!(world.outputs().record.moving, 1);
    let away = Some(DVec3::new(0.5, 0.0, 0.07));
    let mut ticks = 0;
    while world.outputs().record.moving > 0 {
        world.step_places(&[away]);
        ticks += 1;
        assert!(ticks < 20_000, "it comes to rest");
    }
    let rest = pose(&world, 0);
    println!("at rest after {ticks} ticks at {}", rest.position);
    for _ in 0..500 {
        world.step_places(&[away]);
        assert_eq!(pose(&world, 0), rest);
        assert!(world.controller().movables().moved().next().is_none());
    }
    // It is touched where it is now, and nowhere else.
    let above = rest.position + DVec3::Z * (BALL + 2e-3);
    settle(&mut world, &[Some(above)]);
    assert!(!world.outputs().record.contact);
    world.step_places(&[Some(above - DVec3::Z * 2e-3)]);
    assert!(world.outputs().record.contact);
    assert_eq!(
        world.outputs().contacts[0].map(|touched| touched.object),
        Some(0)
    );
}

#[test]
fn a_driven_ball_from_afar_is_active_when_it_arrives_and_carries_the_probe() {
    for (rate, speed) in [(1.0, 0.3), (1.0, 1.0), (-1.0, 1.0)] {
        // Eleven balls that stand far from the probe: active objects are few.
        let mut places = vec![DVec3::X * (-rate * 1.0)];
        places.extend((0..11).map(|k| DVec3::new(f64::from(k) * 0.2, 2.0, 0.0)));
        let mut plan = balls(&places, 1);
        plan.safety.force_max_n = 100.0;
        plan.safety.slew_n_per_s = 1e6;
        plan.objects[0].movable = Some(driven(DVec3::X * (rate * speed), DVec3::ZERO));
        let mut world = scene(&plan);
        let place = Some(DVec3::ZERO);
        let (mut touched, mut free_after) = (0, 0);
        // It is in reach from 0.949 m on, and passes through the place of the probe for 0.1 m.
        let (arrives, leaves) = (0.949 / speed / PERIOD_S, 0.97 / speed / PERIOD_S);
        while (world.tick() as f64) < leaves {
            let record = world.step_places(&[place]).record;
            assert_eq!(record.unserved, 0, "tick {}", world.tick());
            let depth = speed * (world.tick() as f64 - 1.0 - arrives) * PERIOD_S;
            let force = world.outputs().wrenches[0].force;
            if depth > 2e-4 {
                touched += 1;
                // The probe is pushed ahead, as deep as it lies within (the mesh is not quite a
                // ball).
                let due = (800.0 * depth).min(10.0);
                let ahead = force.x * rate;
                assert!(
                    ahead > 0.9 * due - 0.2,
                    "tick {}: {force} of {due}",
                    world.tick()
                );
            } else if depth < -1e-3 {
                free_after += 1;
                assert_eq!(force, DVec3::ZERO, "tick {}", world.tick());
            }
        }
        assert!(touched > 10 && free_after > 100);
    }
}

#[test]
fn a_proxy_that_rests_on_what_turns_stays_on_its_side() {
    // A ball that turns under the probe about an axis far from its middle, and carries its surface
    // past at 0.5 m/s.
    let mut plan = balls(&[DVec3::ZERO], 1);
    plan.objects[0].movable = Some(driven(DVec3::ZERO, DVec3::Z * 10.0));
    let mut world = scene(&plan);
    let settled = |world: &mut World| {
        for _ in 0..1500 {
            world.step_places(&[Some(DVec3::X * 0.07)]);
        }
    };
    settled(&mut world);
    let mut forces = Vec::new();
    for _ in 0..2000 {
        world.step_places(&[Some(DVec3::X * 0.049)]);
        forces.push(world.outputs().wrenches[0].force);
    }
    // Two millimetres deep, all around: the force keeps its direction and its size, the account
    // takes nothing off.
    for force in &forces[100..] {
        assert!(
            (force.x - 1.6).abs() < 0.1 && force.truncate().y.abs() < 0.1,
            "{force}"
        );
    }
    let energy = world.outputs().record.energy_j;
    assert!(energy < 1e-4, "{energy} J");
}

#[test]
fn what_is_on_a_hinge_opens_as_far_as_its_stop_and_every_view_of_it_agrees() {
    let mut plan = balls(&[DVec3::ZERO, DVec3::X * 0.5], 1);
    plan.objects[0].movable = Some(MovablePlan::Hinge(HingePlan {
        mass: MASS,
        axis: DVec3::Y,
        anchor_m: DVec3::new(-0.2, 0.0, 0.0),
        angular: AS_USUAL,
        limits_rad: Some([0.0, 0.3]),
    }));
    let mut world = scene(&plan);
    settle(&mut world, &[Some(DVec3::new(0.0, 0.0, 0.06))]);
    let mut at = DVec3::new(0.0, 0.0, 0.055);
    for _ in 0..2400 {
        at.z -= 3e-5;
        world.step_places(&[Some(at)]);
        let body = world.controller().movables().body(0).expect("it moves");
        let frame = world.controller().frame_of(0).expect("it is known");
        assert_eq!(frame.pose, body.pose());
        let active = world
            .controller()
            .active_object(0)
            .and_then(|object| object.frame());
        assert!(active.is_none_or(|seen| seen == frame));
    }
    let turned = pose(&world, 0).orientation.angle_between(DQuat::IDENTITY);
    println!("turned by {turned}");
    assert!((turned - 0.3).abs() < 1e-9, "at its stop");
    // There it is as stiff as a wall.
    assert!(world.outputs().wrenches[0].force.length() > 5.0);
}

#[test]
fn the_same_scene_at_another_scale_moves_alike() {
    let run = |s: f64| {
        let mut plan = balls(&[DVec3::ZERO], 1);
        plan.objects[0].scale = scene::ModelScale::Size(2.0 * BALL * s);
        // Soft and light, so that the device can hold against the largest.
        plan.objects[0].surface.stiffness_n_per_m *= 1e-4;
        plan.objects[0].surface.damping_ns_per_m *= 1e-4;
        plan.objects[0].movable = Some(MovablePlan::Free(FreePlan {
            mass: MassPlan {
                mass_kg: 1e-4 * MASS.mass_kg,
                ..MASS
            },
            linear: AS_USUAL,
            angular: AS_USUAL,
        }));
        plan.probes[0].shape = ProbeShape::Sphere { radius_m: 1e-3 * s };
        plan.probes[0].device.encoder_m *= s;
        plan.safety.force_max_n *= s;
        plan.safety.torque_max_nm *= s;
        plan.safety.slew_n_per_s *= s;
        let mut world = scene(&plan);
        settle(&mut world, &[Some(DVec3::Z * 0.06 * s)]);
        let mut path = Vec::new();
        for tick in 0..1500 {
            let depth = 4e-3 * (f64::from(tick) * 4e-3).sin().max(0.0);
            world.step_places(&[Some(DVec3::new(0.01, 0.002, 0.052 - depth) * s)]);
            let pose = pose(&world, 0);
            path.push((
                pose.position / s,
                pose.orientation,
                world.outputs().wrenches[0].force / s,
            ));
        }
        path
    };
    let plain = run(1.0);
    let farthest = plain.iter().map(|(p, ..)| p.length()).fold(0.0, f64::max);
    assert!(farthest > 1e-3);
    for exponent in [-4, -1, 1, 4] {
        let other = run(10f64.powi(exponent));
        for ((p, q, f), (r, t, g)) in plain.iter().zip(&other) {
            assert!(p.distance(*r) <= 1e-9 * farthest, "{exponent}: {p} {r}");
            assert!(
                q.dot(*t).abs() > 1.0 - 1e-12 && f.distance(*g) <= 1e-9 * 3e-4,
                "{exponent}: {f} {g}"
            );
        }
    }
}

#[test]
fn a_missed_period_is_made_good_as_the_device_goes_on_under_its_force() {
    // On a rail without friction, pushed by a probe that is held: as long and as hard, however the
    // ticks fall.
    let run = |missed: u64| {
        let mut plan = balls(&[DVec3::ZERO], 1);
        plan.safety.passivity = false;
        plan.objects[0].surface.damping_ns_per_m = 0.0;
        plan.objects[0].movable = Some(MovablePlan::Rail(RailPlan {
            mass: MASS,
            axis: DVec3::Z,
            linear: SpringDamperPlan {
                spring: 0.0,
                damping: Some(0.0),
            },
            limits_m: None,
        }));
        let mut world = scene(&plan);
        settle(&mut world, &[Some(DVec3::Z * 0.06)]);
        world.step_places(&[Some(DVec3::Z * 0.0505)]);
        let force = world.outputs().wrenches[0].force.z;
        // Away, too late for the body: the force has acted all the while.
        world.skip(missed);
        world.step_places(&[Some(DVec3::Z * 0.07)]);
        let before = pose(&world, 0).position.z;
        world.step_places(&[Some(DVec3::Z * 0.07)]);
        let speed = (pose(&world, 0).position.z - before) / PERIOD_S;
        speed * MASS.mass_kg / (-force * PERIOD_S)
    };
    for missed in [0, 1, 5] {
        let periods = run(missed);
        assert!(
            (periods - (1.0 + missed as f64)).abs() < 1e-9,
            "{missed}: {periods}"
        );
    }
}

#[test]
fn a_tour_leads_over_the_object_where_it_is() {
    let mut plan = balls(&[DVec3::new(0.1, 0.2, 0.3)], 1);
    plan.objects[0].movable = Some(driven(DVec3::X, DVec3::ZERO));
    plan.probes[0].trajectory = scene::TrajectoryPlan::Tour {
        object: 0,
        seed: 1,
        speed_m_per_s: 0.1,
        depth_m: 0.002,
    };
    let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 2.0);
    while world.controller().tour().is_none() {
        world.step_poses(&[None]);
        assert!(world.tick() < 10_000);
    }
    let frame = world.controller().frame().expect("the model is there");
    let due = DVec3::new(0.1 + (world.tick() - 1) as f64 * PERIOD_S, 0.2, 0.3);
    assert!(frame.pose.position.distance(due) < 1e-12);
    // The hand goes along.
    let carried = world.controller().carried(0, due);
    assert!(carried.linear.distance(DVec3::X * PERIOD_S) < 1e-12);
    assert_eq!(world.controller().carried(1, due).linear, DVec3::ZERO);
}

#[test]
fn a_tool_pushes_a_body_and_both_feel_the_same() {
    // A prescribed capsule against a ball, beside its middle: the ball gains the opposite of the
    // wrench on the device, about any point, until it turns.
    let mut plan = balls(&[DVec3::ZERO], 1);
    plan.probes[0].shape = ProbeShape::Capsule {
        radius_m: 0.003,
        length_m: 0.02,
        faces: 240,
    };
    plan.objects[0].movable = Some(MovablePlan::Free(FreePlan {
        mass: MASS,
        linear: LOOSE,
        angular: LOOSE,
    }));
    let mut world = scene(&plan);
    let tilted = DQuat::from_rotation_y(0.4);
    let sample = |z: f64| {
        [Some(Pose {
            position: DVec3::new(0.012, 0.004, z),
            orientation: tilted,
        })]
    };
    for _ in 0..1500 {
        world.step_poses(&sample(0.07));
    }
    let (mut given, mut largest) = (DVec3::ZERO, 0.0f64);
    for tick in 0..300 {
        let z = 0.054 - 2e-5 * f64::from(tick);
        let force = world.outputs().wrenches[0].force;
        world.step_poses(&sample(z));
        given -= force * PERIOD_S;
        let body = world.controller().movables().body(0).expect("it moves");
        let gained = body.velocity() * MASS.mass_kg;
        assert!(
            gained.distance(given) <= 1e-9 * given.length().max(1e-6),
            "tick {tick}: {gained} {given}"
        );
        largest = largest.max(given.length());
    }
    assert!(largest > 1e-3, "{largest} N s");
    assert_eq!(world.client().allocations(), 0);
}

#[test]
fn whatever_probes_link_and_bodies_do_the_tick_keeps_its_limits() {
    let mut moved = 0.0f64;
    for seed in 0..10 {
        let mut random = Random::new(seed);
        let count = 1 + random.below(9) as usize;
        let any =
            |random: &mut Random| DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
        let places: Vec<DVec3> = (0..count).map(|_| any(&mut random) * 0.6).collect();
        let probes = 1 + random.below(3) as usize;
        let mut plan = balls(&places, probes);
        for object in &mut plan.objects {
            let mass = MassPlan {
                mass_kg: 0.02 + random.unit(),
                inertia_kgm2: None,
                gravity_m_per_s2: any(&mut random)
                    * 0.5
                    * f64::from(u8::from(random.below(2) == 0)),
            };
            let rest = SpringDamperPlan {
                spring: 20.0 * random.unit(),
                damping: None,
            };
            let axis = any(&mut random).normalize();
            object.movable = match random.below(5) {
                0 => Some(MovablePlan::Free(FreePlan {
                    mass,
                    linear: rest,
                    angular: rest,
                })),
                1 => Some(MovablePlan::Hinge(HingePlan {
                    mass,
                    axis,
                    anchor_m: any(&mut random) * 0.2,
                    angular: SpringDamperPlan {
                        spring: 0.05 * rest.spring,
                        damping: None,
                    },
                    limits_rad: Some([-0.5, 1.0]),
                })),
                2 => Some(MovablePlan::Rail(RailPlan {
                    mass,
                    axis,
                    linear: rest,
                    limits_m: Some([-0.05, 0.1]),
                })),
                3 => Some(MovablePlan::Driven(DrivenPlan {
                    linear_m_per_s: any(&mut random),
                    angular_rad_per_s: any(&mut random) * 10.0,
                    anchor_m: any(&mut random) * 0.1,
                    period_s: Some(0.2 + random.unit()),
                })),
                _ => None,
            };
        }
        let run = || {
            let mut random = Random::new(1000 + seed);
            let mut world = scene(&plan);
            let mut at = vec![DVec3::ZERO; probes];
            for tick in 0..2500u64 {
                if random.below(300) == 0 {
                    let model = if random.below(2) == 0 {
                        faulty(0.05, 0.05, 0.1)
                    } else {
                        LinkModel::default()
                    };
                    let seed = random.bits();
                    world.client_mut().link().disturb(model, seed);
                }
                if random.below(1000) == 0 {
                    let models: [(&str, &[u8]); 1] = [("sphere", &SPHERE)];
                    world.start_station(scene_station(&plan, &models, 101 + tick));
                }
                if random.below(100) == 0 {
                    world.skip(random.below(8));
                }
                let mut samples = Vec::new();
                for at in &mut at {
                    let body = random.below(count as u64) as usize;
                    let goal = world
                        .controller()
                        .frame_of(body)
                        .map_or(places[body], |f| f.pose.position);
                    *at += (goal - *at).clamp_length_max(1e-3 * random.unit());
                    samples.push(match random.below(40) {
                        0 => None,
                        1 => Some(DVec3::NAN),
                        2 => Some(DVec3::splat(1e300)),
                        _ => Some(*at),
                    });
                }
                let record = world.step_places(&samples).record;
                assert!(world.outputs().wrenches.iter().all(|w| w.is_finite()));
                assert!(record.work_units <= world.controller().work_budget());
                for (_, body) in world.controller().movables().iter() {
                    assert!(
                        body.pose().is_finite() && body.max_displacement() < 0.05,
                        "seed {seed}"
                    );
                }
                if tick % 500 == 0 {
                    check(&world);
                }
            }
            assert_eq!(world.client().allocations(), 0, "seed {seed}");
            let farthest = world
                .controller()
                .movables()
                .iter()
                .map(|(_, body)| body.farthest());
            (
                world.controller().replay_hash(),
                farthest.fold(0.0, f64::max),
            )
        };
        let (hash, farthest) = run();
        assert_eq!(run().0, hash, "seed {seed}: every run repeats");
        moved = moved.max(farthest);
    }
    assert!(moved > 0.01, "{moved}");
}
