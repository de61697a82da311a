//! Scenes of several objects and probes in one controller: each contact is as with one object
//! alone, whatever the number of active objects, and objects out of reach do not disturb it.

use crate::common::{
    World, check, faulty, front_of, scene_plan, scene_station, scene_world, settle, spm,
};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Stage, StageObserver, ToolBefore};
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot};
use scene::{ProbeShape, TrajectoryPlan};
use simulator::{Drive, LinkModel, Random};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::LazyLock;

/// Radius of the balls that are touched, and of the probes, metres.
const BALL: f64 = 0.05;
const PROBE: f64 = 0.001;
/// How deep the hand presses, metres.
const PRESS: f64 = 0.001;
/// Centres of neighbours in a row, metres.
const SPACING: f64 = 0.13;

static SPHERE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default()));
static RELIEF: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Relief, 20_000, 1), &BuildOptions::default()));

fn centre(object: usize) -> DVec3 {
    DVec3::X * (SPACING * object as f64)
}

/// A row of balls.
fn row(objects: usize, probes: usize, cache_bytes: usize) -> World {
    let balls: Vec<_> = (0..objects)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, probes, cache_bytes);
    scene_world(&plan, &[("sphere", &SPHERE)], 0.0)
}

/// Above a ball, this far from its surface; pressed in where negative.
fn above(object: usize, gap: f64) -> DVec3 {
    centre(object) + DVec3::Z * (BALL + PROBE + gap)
}

/// Leads the first probe from where it is to a place, at most `step` metres a tick.
fn lead(world: &mut World, at: &mut DVec3, to: DVec3, step: f64) {
    while *at != to {
        let way = to - *at;
        let share = (step / way.length()).min(1.0);
        *at = if share < 1.0 { *at + way * share } else { to };
        world.step_places(&[Some(*at)]);
    }
}

#[test]
fn a_probe_over_a_row_touches_each_of_twenty_objects_at_its_surface() {
    let mut world = row(20, 1, 6 << 20);
    assert_eq!(world.controller().active_objects().len(), 3);
    let mut at = above(0, 0.02);
    settle(&mut world, &[Some(at)]);
    for object in 0..20 {
        lead(&mut world, &mut at, above(object, 0.02), 5e-4);
        lead(&mut world, &mut at, above(object, -PRESS), 1e-4);
        let (mut full, mut ticks) = (0, 0);
        for k in 0..300 {
            // A small circle on top: the contact moves on.
            let turn = k as f64 * 0.02;
            let around = DVec3::new(turn.sin(), 1.0 - turn.cos(), 0.0) * 0.002;
            let out = (above(object, 0.0) + around - centre(object)).normalize();
            at = centre(object) + out * (BALL + PROBE - PRESS);
            let record = world.step_places(&[Some(at)]).record;
            ticks += 1;
            full += u32::from(record.contact_full);
            assert!(record.contact, "object {object}, tick {k}");
            assert_eq!(record.unserved, 0);
            let touched = world.outputs().contacts[0].expect("it touches");
            assert_eq!(touched.object as usize, object);
            let proxy = world.controller().proxy_of(0, object).expect("it is awake");
            let outside = proxy.distance(centre(object)) - BALL - PROBE;
            // Chords of the mesh lie under the ball by a few micrometres, those of a coarser one by
            // more.
            assert!(outside.abs() < 3e-4, "object {object}: {outside}");
        }
        assert!(
            full * 100 >= ticks * 99,
            "object {object}: {full} of {ticks}"
        );
        lead(&mut world, &mut at, above(object, 0.02), 1e-3);
    }
    check(&world);
}

#[test]
fn a_fast_probe_falls_through_nothing_that_was_asleep() {
    let mut world = row(12, 1, 4 << 20);
    let mut at = above(0, 0.02);
    settle(&mut world, &[Some(at)]);
    for (round, speed) in [0.0005, 0.002, 0.005, 0.02].into_iter().enumerate() {
        for object in [5, 11, 2, 8, 0] {
            // Far away, so that all are asleep or about to be; then straight into the middle.
            lead(&mut world, &mut at, above(object, 0.5), 0.01);
            for _ in 0..200 {
                world.step_places(&[Some(at)]);
            }
            lead(&mut world, &mut at, centre(object), speed);
            for _ in 0..60 {
                world.step_places(&[Some(at)]);
            }
            let proxy = world.controller().proxy_of(0, object).expect("it is awake");
            let outside = proxy.distance(centre(object)) - BALL - PROBE;
            assert!(
                outside > -1e-3,
                "round {round}, object {object} at {speed} m a tick: {outside}"
            );
            assert!(world.outputs().record.contact);
        }
    }
}

#[test]
fn two_probes_touch_one_object_and_one_probe_two() {
    let gap = 0.5 * PROBE;
    let apart = DVec3::X * (2.0 * BALL + gap);
    let balls = [
        ("sphere", 2.0 * BALL, DVec3::ZERO),
        ("sphere", 2.0 * BALL, apart),
    ];
    let plan = scene_plan(&balls, 3, 8 << 20);
    let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
    // In the groove between both, so deep that each is pressed by half a millimetre.
    let reach = BALL + PROBE - 0.5 * PRESS;
    let height = (reach * reach - 0.25 * apart.length_squared()).sqrt();
    let groove = 0.5 * apart + DVec3::Z * height;
    let side = |way: DVec3| way * (BALL + PROBE - PRESS);
    let pressed = [Some(groove), Some(side(-DVec3::X)), Some(side(DVec3::Y))];
    let free = [
        Some(groove + DVec3::Z * 0.03),
        Some(side(-DVec3::X) * 1.3),
        Some(side(DVec3::Y) * 1.3),
    ];
    settle(&mut world, &free);
    for k in 0..=200 {
        let share = f64::from(k) / 200.0;
        let places: Vec<_> = free
            .iter()
            .zip(&pressed)
            .map(|(from, to)| from.zip(*to).map(|(from, to)| from.lerp(to, share)))
            .collect();
        world.step_places(&places);
    }
    let record = settle(&mut world, &pressed);
    assert!(record.contact_full && record.probes[..3].iter().all(|p| p.contact_full));
    let [both, left, front] = [0, 1, 2].map(|k| world.outputs().wrenches[k].force);
    for (force, way) in [(left, -DVec3::X), (front, DVec3::Y)] {
        assert!((force.length() - 800.0 * PRESS).abs() < 0.05, "{force}");
        assert!(force.normalize().dot(way) > 0.99, "{force}");
    }
    // Each of the two pushes with its own depth; sideways they hold each other.
    let upwards = 2.0 * 800.0 * 0.5 * PRESS * height / reach;
    assert!((both.z - upwards).abs() < 0.2 * upwards, "{both} {upwards}");
    assert!(
        both.x.abs() < 0.2 * both.z && both.y.abs() < 0.2 * both.z,
        "{both}"
    );
    for object in [0, 1] {
        let proxy = world.controller().proxy_of(0, object).expect("it is near");
        assert!(proxy.distance(groove) > 1e-5, "object {object} holds it");
    }
    // Two probes act on an object as one does, twice: one alone leaves the same front.
    let mut alone = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
    settle(&mut alone, &free);
    for k in 0..=200 {
        let share = f64::from(k) / 200.0;
        let from = free[1].zip(pressed[1]);
        alone.step_places(&[None, from.map(|(from, to)| from.lerp(to, share)), None]);
    }
    settle(&mut alone, &[None, pressed[1], None]);
    let force = alone.outputs().wrenches[1].force;
    assert!(force.distance(left) < 1e-3, "{force} {left}");
}

/// The probes whose tools are advanced in a tick, in their order.
#[derive(Default)]
struct Order(Vec<usize>);

impl StageObserver for Order {
    fn ended(&mut self, _: Stage) {}

    fn tool_before(&mut self, probe: usize, _: &ToolBefore<'_>) {
        self.0.push(probe);
    }
}

#[test]
fn tools_on_one_object_take_turns_in_being_the_last() {
    for probes in [2, 3, 4] {
        let balls = [("sphere", 2.0 * BALL, DVec3::ZERO)];
        let mut plan = scene_plan(&balls, probes, 8 << 20);
        for probe in &mut plan.probes {
            probe.shape = ProbeShape::Capsule {
                radius_m: PROBE,
                length_m: 0.02,
                faces: 240,
            };
        }
        let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
        // Beside each other on top, upright.
        let places = |gap: f64| -> Vec<_> {
            let outward = |k: usize| DVec3::new(0.2 * k as f64 - 0.3, 0.0, 1.0).normalize();
            (0..probes)
                .map(|k| Some(outward(k) * (BALL + PROBE + gap)))
                .collect()
        };
        for k in 0..1500 {
            let down = (f64::from(k) / 1000.0).min(1.0);
            world.step_places(&places(0.02 - (0.02 + PRESS) * down));
        }
        let pressed: Vec<_> = places(-PRESS)
            .into_iter()
            .map(|place| place.map(Pose::at).map(Sample::at))
            .collect();
        let mut last = vec![0; probes];
        for _ in 0..4 * probes {
            let mut order = Order::default();
            let record = world.advance(Drive::Samples(&pressed), &mut order).record;
            assert!(record.probes[..probes].iter().all(|of| of.contact));
            assert_eq!(order.0.len(), probes, "each once");
            last[order.0[probes - 1]] += 1;
        }
        assert_eq!(last, vec![4; probes], "of {probes} probes");
    }
}

#[test]
fn active_objects_reassigned_a_thousand_times_hold_a_fresh_load() {
    let objects: Vec<_> = (0..8)
        .map(|object| {
            let model = ["sphere", "relief"][object % 2];
            (model, 2.0 * BALL, centre(object))
        })
        .collect();
    let plan = scene_plan(&objects, 1, 4 << 20);
    let models = [("sphere", SPHERE.as_slice()), ("relief", RELIEF.as_slice())];
    let mut world = scene_world(&plan, &models, 0.0);
    settle(&mut world, &[Some(above(0, 0.02))]);
    let (mut random, mut woken) = (Random::new(1), 0);
    let mut awake = vec![false; objects.len()];
    while woken < 1000 {
        let object = random.below(8) as usize;
        let place = above(object, 0.02 * random.unit() - PRESS);
        for _ in 0..20 + random.below(30) {
            world.step_places(&[Some(place)]);
            for (object, before) in awake.iter_mut().enumerate() {
                let now = world.controller().active_object(object).is_some();
                woken += u32::from(now && !*before);
                *before = now;
            }
        }
        if woken % 100 < 2 {
            check(&world);
        }
    }
    assert_eq!(world.client().allocations(), 0);
    assert!(world.controller().fault().is_none());
    assert_eq!(world.controller().refused().0, 0);
    // Each object in turn: its front is that of a scene in which nothing else ever happened.
    // The relief is lower than the ball there.
    for (object, pressed) in [(3, -0.005), (6, -PRESS)] {
        let mut fresh = scene_world(&plan, &models, 0.0);
        for world in [&mut world, &mut fresh] {
            settle(world, &[Some(above(object, 0.03))]);
            let record = settle(world, &[Some(above(object, pressed))]);
            assert!(record.contact_full, "object {object}");
        }
        assert!(!front_of(&fresh, object).is_empty());
        assert_eq!(front_of(&world, object), front_of(&fresh, object));
        check(&world);
    }
}

#[test]
fn a_bad_link_and_a_new_station_leave_every_session_as_it_was() {
    let run = |bad: bool| {
        let mut world = row(5, 2, 8 << 20);
        let at = |world: &World| {
            let turn = world.tick() as f64 * 0.002;
            let around = DVec3::new(turn.sin(), turn.cos(), 0.0) * 0.01;
            [1, 3].map(|object| {
                let out = (above(object, 0.0) + around - centre(object)).normalize();
                Some(centre(object) + out * (BALL + PROBE - PRESS))
            })
        };
        settle(&mut world, &[1, 3].map(|object| Some(above(object, 0.02))));
        for k in 0..4000 {
            if bad && k == 500 {
                world
                    .client_mut()
                    .link()
                    .disturb(faulty(0.03, 0.05, 0.1), 4);
            }
            if bad && k == 2000 {
                let balls: Vec<_> = (0..5)
                    .map(|object| ("sphere", 2.0 * BALL, centre(object)))
                    .collect();
                let plan = scene_plan(&balls, 2, 8 << 20);
                world.start_station(scene_station(&plan, &[("sphere", &SPHERE)], 101));
            }
            let places = at(&world);
            let record = world.step_places(&places).record;
            assert!(k < 50 || record.probes[..2].iter().all(|probe| probe.contact));
        }
        world.client_mut().link().set_model(LinkModel::default());
        settle(
            &mut world,
            &[1, 3].map(|object| Some(above(object, -PRESS))),
        );
        check(&world);
        assert!(world.controller().fault().is_none());
        world
    };
    let (quiet, bad) = (run(false), run(true));
    assert_eq!(quiet.outputs().record.resubscribed, 0);
    assert!(bad.outputs().record.resubscribed > 2, "it was bad");
    for object in [1, 3] {
        assert_eq!(front_of(&quiet, object), front_of(&bad, object));
    }
    for probe in [0, 1] {
        let forces = [&quiet, &bad].map(|world| world.outputs().wrenches[probe].force);
        assert!(forces[0].distance(forces[1]) < 0.02, "{forces:?}");
    }
}

#[test]
fn one_probes_bad_samples_do_not_disturb_another() {
    let run = |bad: bool| {
        let mut world = row(3, 2, 8 << 20);
        settle(&mut world, &[0, 2].map(|object| Some(above(object, 0.02))));
        let mut forces = Vec::new();
        for k in 0..1500u32 {
            let depth = PRESS * (f64::from(k) * 0.01).sin();
            let other = match (bad, k % 3) {
                (true, 0) => Some(DVec3::NAN),
                (true, 1) => None,
                (true, _) => Some(DVec3::splat(f64::INFINITY)),
                (false, _) => Some(above(2, 0.02)),
            };
            let record = world.step_places(&[Some(above(0, depth)), other]).record;
            assert!(
                world
                    .outputs()
                    .wrenches
                    .iter()
                    .all(|wrench| wrench.is_finite())
            );
            assert_eq!(record.probes[1].rejected_sample, bad && k % 3 != 1);
            assert!(!record.probes[0].rejected_sample);
            forces.push(
                world.outputs().wrenches[0]
                    .force
                    .to_array()
                    .map(f64::to_bits),
            );
        }
        assert!(forces.iter().any(|force| force[2] != 0));
        forces
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn chunks_and_samples_of_what_there_is_not_are_ignored() {
    let run = |noise: bool| {
        let mut world = row(4, 1, 4 << 20);
        let mut random = Random::new(7);
        // To the end of a touch: junk takes time on the line, so what is under way may differ.
        for k in 0..2950u32 {
            if noise && world.client().inbox_len() < 32 {
                let header = ChunkHeader {
                    client: 7,
                    station: 100,
                    object: [4, 77, u32::MAX][random.below(3) as usize],
                    epoch: random.below(3) as u32,
                    sequence: random.below(3),
                    kind: ChunkKind::Answers as u32,
                    count: 4096,
                    ..ChunkHeader::default()
                };
                let slots = [ChunkSlot {
                    words: [random.bits() as u32; 16],
                }; CHUNK_SLOTS];
                world.client_mut().inject(InboxChunk { header, slots });
            }
            let depth = PRESS * (f64::from(k) * 0.01).sin();
            let object = k as usize / 600 % 4;
            let mut places = vec![Some(above(object, depth))];
            if noise {
                // More samples than probes.
                places.push(Some(above(1, 0.0)));
                places.push(None);
            }
            world.step_places(&places);
        }
        check(&world);
        (
            world.outputs().wrenches[0].force.to_array(),
            world.outputs().record.contact,
            world.outputs().record.contact_full,
        )
    };
    let (force, contact, is_full) = run(false);
    assert!(contact && is_full, "it ends in a touch");
    assert_eq!(run(true), (force, contact, is_full));
}

#[test]
fn any_number_of_objects_and_probes_ticks_without_a_station() {
    for (objects, probes) in [(1, 4), (2, 1), (9, 4), (10, 4), (300, 4)] {
        let balls: Vec<_> = (0..objects)
            .map(|object| ("sphere", 2.0 * BALL, centre(object)))
            .collect();
        let plan = scene_plan(&balls, probes, 4 << 20);
        let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
        world.stop_station();
        for tick in 0..100 {
            world.client_mut().stop(tick > 50);
            let outputs = world.step_places(&vec![Some(DVec3::ZERO); probes]);
            assert!(!outputs.record.contact);
        }
        assert_eq!(world.client().allocations(), 0);
        assert!(world.controller().is_at_rest());
    }
}

#[test]
fn a_base_mesh_without_room_is_sent_again_at_each_activation() {
    let options = BuildOptions {
        base_faces: Some(3000),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Sphere, 20_000, 1), &options);
    let balls: Vec<_> = (0..6)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, 1, 8 << 20);
    let mut world = scene_world(&plan, &[("sphere", &model)], 0.0);
    let mut at = above(0, 0.02);
    let known = settle(&mut world, &[Some(at)]).bytes_received;
    for object in [1, 2, 3, 4, 5, 0] {
        lead(&mut world, &mut at, above(object, 0.02), 5e-4);
        lead(&mut world, &mut at, above(object, -PRESS), 1e-4);
        let record = settle(&mut world, &[Some(at)]);
        assert!(
            record.contact_full && record.unserved == 0,
            "object {object}"
        );
        lead(&mut world, &mut at, above(object, 0.02), 1e-3);
    }
    let base = 1500 * size_of::<ChunkSlot>() as u64;
    assert!(world.outputs().record.bytes_received > known + 4 * base);
    check(&world);
}

#[test]
fn each_probe_gets_the_tour_of_its_own_object_and_seed() {
    let balls: Vec<_> = (0..9)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let mut plan = scene_plan(&balls, 4, 16 << 20);
    let tours = [(7, 1), (2, 1), (7, 2), (7, 1)];
    for (probe, (object, seed)) in plan.probes.iter_mut().zip(tours) {
        probe.trajectory = TrajectoryPlan::Tour {
            object,
            seed,
            speed_m_per_s: 0.1,
            depth_m: PRESS,
        };
    }
    let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 2.0);
    while (0..4).any(|probe| world.controller().tour_of(probe).is_none()) {
        if world.tick() == 20 {
            // What is lost comes again.
            world.client_mut().link().disturb(faulty(0.1, 0.1, 0.1), 1);
        }
        world.step_places(&[None; 4]);
        assert!(world.tick() < 20_000, "the tours arrive");
    }
    let path = |probe: usize| world.controller().tour_of(probe).expect("it is here").1;
    for (probe, (object, _)) in tours.into_iter().enumerate() {
        assert_eq!(
            world.controller().tour_of(probe).map(|tour| tour.0),
            Some(object)
        );
        assert_eq!(path(probe).len(), path(0).len());
    }
    // The same model, seed and units make the same tour, whatever the object.
    assert_eq!(path(0), path(1));
    assert_eq!(path(0), path(3));
    assert_ne!(path(0), path(2));
}

#[test]
fn whatever_probes_and_link_do_every_scene_keeps_its_limits() {
    let models = [("sphere", SPHERE.as_slice()), ("relief", RELIEF.as_slice())];
    let (mut contacts, mut evicted, mut unseated) = (0, 0, 0);
    for seed in 0..12 {
        let mut random = Random::new(seed);
        let objects: Vec<_> = (0..1 + random.below(12))
            .map(|_| {
                let [x, y, z] = [(); 3].map(|()| 0.4 * random.unit());
                let (model, size) = (random.below(2) as usize, 0.02 + 0.2 * random.unit());
                (models[model].0, size, DVec3::new(x, y, z))
            })
            .collect();
        let probes = 1 + random.below(4) as usize;
        let bytes = [3 << 20, 5 << 20, 16 << 20][random.below(3) as usize];
        let plan = scene_plan(&objects, probes, bytes);
        let mut world = scene_world(&plan, &models, 0.0);
        let mut at = vec![DVec3::ZERO; probes];
        let mut goals = at.clone();
        for tick in 0..3000 {
            if random.below(400) == 0 {
                let model = if random.below(2) == 0 {
                    faulty(0.05, 0.05, 0.1)
                } else {
                    LinkModel::default()
                };
                let seed = random.bits();
                world.client_mut().link().disturb(model, seed);
            }
            if random.below(1500) == 0 {
                world.start_station(scene_station(&plan, &models, 101 + tick));
            }
            let mut places = Vec::new();
            for (at, goal) in at.iter_mut().zip(&mut goals) {
                if random.below(100) == 0 {
                    let (_, size, centre) = objects[random.below(objects.len() as u64) as usize];
                    let way = DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
                    *goal =
                        centre + way.normalize_or(DVec3::X) * size * (0.3 + 0.4 * random.unit());
                }
                if random.below(500) == 0 {
                    // A device that is somewhere else at once.
                    *at = *goal;
                }
                *at += (*goal - *at).clamp_length_max(0.003 * random.unit());
                places.push(match random.below(50) {
                    0 => None,
                    1 => Some(DVec3::new(f64::NAN, 0.0, 0.0)),
                    2 => Some(DVec3::splat(1e300)),
                    _ => Some(*at),
                });
            }
            let record = world.step_places(&places).record;
            contacts += u32::from(record.contact);
            unseated += u32::from(record.unserved > 0);
            assert!(world.outputs().wrenches.iter().all(|w| w.is_finite()));
            assert!(
                record.cache_bytes as usize <= bytes,
                "seed {seed}, tick {tick}"
            );
            assert!(record.work_units <= world.controller().work_budget());
            if tick % 500 == 0 {
                check(&world);
            }
        }
        evicted += world.outputs().record.evicted;
        check(&world);
        assert_eq!(world.controller().fault(), None, "seed {seed}");
        assert_eq!(world.controller().refused().0, 0, "seed {seed}");
        assert_eq!(world.client().allocations(), 0);
        assert!(world.controller().bytes_high_water() <= bytes);
    }
    println!("{contacts} ticks in contact, {evicted} evicted, {unseated} ticks unseated");
    assert!(contacts > 5000 && evicted > 1000);
}
