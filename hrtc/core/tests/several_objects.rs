//! Scenes of several objects and probes in one controller: each touch is as that of one object alone, whatever the
//! number of seats, and what is out of reach does not disturb it.

mod common;

use common::several::{Scene, scene_plan, scene_station};
use common::{Faults, Random, spm};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{NoObserver, TickInputs};
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot};
use realtime::counting_allocator::{CountingAllocator, count};
use scene::TrajectoryPlan;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::LazyLock;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

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
fn row(objects: usize, probes: usize, cache_bytes: usize) -> Scene {
    let balls: Vec<_> = (0..objects)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, probes, cache_bytes);
    Scene::new(&plan, &[("sphere", &SPHERE)])
}

/// Above a ball, this far from its surface; pressed in where negative.
fn above(object: usize, gap: f64) -> DVec3 {
    centre(object) + DVec3::Z * (BALL + PROBE + gap)
}

/// Leads the first probe from where it is to a place, at most `step` metres a tick.
fn lead(scene: &mut Scene, at: &mut DVec3, to: DVec3, step: f64) {
    while *at != to {
        let way = to - *at;
        let share = (step / way.length()).min(1.0);
        *at = if share < 1.0 { *at + way * share } else { to };
        scene.step(&[Some(*at)]);
    }
}

#[test]
fn a_probe_over_a_row_touches_each_of_twenty_objects_at_its_surface() {
    let mut scene = row(20, 1, 6 << 20);
    assert_eq!(scene.controller.active_objects().len(), 3);
    let mut at = above(0, 0.02);
    scene.settle(&[Some(at)]);
    for object in 0..20 {
        lead(&mut scene, &mut at, above(object, 0.02), 5e-4);
        lead(&mut scene, &mut at, above(object, -PRESS), 1e-4);
        let (mut full, mut ticks) = (0, 0);
        for k in 0..300 {
            // A small circle on top: the contact moves on.
            let turn = k as f64 * 0.02;
            let around = DVec3::new(turn.sin(), 1.0 - turn.cos(), 0.0) * 0.002;
            let out = (above(object, 0.0) + around - centre(object)).normalize();
            at = centre(object) + out * (BALL + PROBE - PRESS);
            let record = scene.step(&[Some(at)]);
            ticks += 1;
            full += u32::from(record.contact_full);
            assert!(record.contact, "object {object}, tick {k}");
            assert_eq!(record.unserved, 0);
            let touched = scene.outputs.contacts[0].expect("it touches");
            assert_eq!(touched.object as usize, object);
            let proxy = scene.controller.proxy_of(0, object).expect("it is awake");
            let outside = proxy.distance(centre(object)) - BALL - PROBE;
            // Chords of the mesh lie under the ball by a few micrometres, those of a coarser one by more.
            assert!(outside.abs() < 3e-4, "object {object}: {outside}");
        }
        assert!(
            full * 100 >= ticks * 99,
            "object {object}: {full} of {ticks}"
        );
        lead(&mut scene, &mut at, above(object, 0.02), 1e-3);
    }
    scene.check();
}

#[test]
fn a_fast_probe_falls_through_nothing_that_was_asleep() {
    let mut scene = row(12, 1, 4 << 20);
    let mut at = above(0, 0.02);
    scene.settle(&[Some(at)]);
    for (round, speed) in [0.0005, 0.002, 0.005, 0.02].into_iter().enumerate() {
        for object in [5, 11, 2, 8, 0] {
            // Far away, so that all are asleep or about to be; then straight into the middle.
            lead(&mut scene, &mut at, above(object, 0.5), 0.01);
            for _ in 0..200 {
                scene.step(&[Some(at)]);
            }
            lead(&mut scene, &mut at, centre(object), speed);
            for _ in 0..60 {
                scene.step(&[Some(at)]);
            }
            let proxy = scene.controller.proxy_of(0, object).expect("it is awake");
            let outside = proxy.distance(centre(object)) - BALL - PROBE;
            assert!(
                outside > -1e-3,
                "round {round}, object {object} at {speed} m a tick: {outside}"
            );
            assert!(scene.outputs.record.contact);
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
    let mut scene = Scene::new(&plan, &[("sphere", &SPHERE)]);
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
    scene.settle(&free);
    for k in 0..=200 {
        let share = f64::from(k) / 200.0;
        let places: Vec<_> = free
            .iter()
            .zip(&pressed)
            .map(|(from, to)| from.zip(*to).map(|(from, to)| from.lerp(to, share)))
            .collect();
        scene.step(&places);
    }
    let record = scene.settle(&pressed);
    assert!(record.contact_full && record.probes[..3].iter().all(|p| p.contact_full));
    let [both, left, front] = [0, 1, 2].map(|k| scene.outputs.wrenches[k].force);
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
        let proxy = scene.controller.proxy_of(0, object).expect("it is near");
        assert!(proxy.distance(groove) > 1e-5, "object {object} holds it");
    }
    // What two probes do to an object is what one does, twice: with one alone the others' front is the same.
    let mut alone = Scene::new(&plan, &[("sphere", &SPHERE)]);
    alone.settle(&free);
    for k in 0..=200 {
        let share = f64::from(k) / 200.0;
        let from = free[1].zip(pressed[1]);
        alone.step(&[None, from.map(|(from, to)| from.lerp(to, share)), None]);
    }
    alone.settle(&[None, pressed[1], None]);
    let force = alone.outputs.wrenches[1].force;
    assert!(force.distance(left) < 1e-3, "{force} {left}");
}

#[test]
fn seats_recycled_a_thousand_times_hold_what_a_fresh_load_holds() {
    let objects: Vec<_> = (0..8)
        .map(|object| {
            let model = ["sphere", "relief"][object % 2];
            (model, 2.0 * BALL, centre(object))
        })
        .collect();
    let plan = scene_plan(&objects, 1, 4 << 20);
    let models = [("sphere", SPHERE.as_slice()), ("relief", RELIEF.as_slice())];
    let mut scene = Scene::new(&plan, &models);
    scene.settle(&[Some(above(0, 0.02))]);
    let (mut random, mut woken) = (Random(1), 0);
    let mut awake = vec![false; objects.len()];
    while woken < 1000 {
        let object = random.below(8) as usize;
        let place = above(object, 0.02 * random.unit() - PRESS);
        for _ in 0..20 + random.below(30) {
            scene.step(&[Some(place)]);
            for (object, before) in awake.iter_mut().enumerate() {
                let now = scene.controller.active_object(object).is_some();
                woken += u32::from(now && !*before);
                *before = now;
            }
        }
        if woken % 100 < 2 {
            scene.check();
        }
    }
    assert_eq!(scene.allocations, 0);
    assert!(scene.controller.fault().is_none());
    assert_eq!(scene.controller.refused().0, 0);
    // Each object in turn: its front is that of a scene in which nothing else ever happened.
    // The relief is lower than the ball there.
    for (object, pressed) in [(3, -0.005), (6, -PRESS)] {
        let mut fresh = Scene::new(&plan, &models);
        for scene in [&mut scene, &mut fresh] {
            scene.settle(&[Some(above(object, 0.03))]);
            let record = scene.settle(&[Some(above(object, pressed))]);
            assert!(record.contact_full, "object {object}");
        }
        assert!(!fresh.refined_front(object).is_empty());
        assert_eq!(scene.refined_front(object), fresh.refined_front(object));
        scene.check();
    }
}

#[test]
fn a_bad_link_and_a_new_station_leave_every_session_as_it_was() {
    let run = |bad: bool| {
        let mut scene = row(5, 2, 8 << 20);
        let at = |scene: &Scene| {
            let turn = scene.tick as f64 * 0.002;
            let around = DVec3::new(turn.sin(), turn.cos(), 0.0) * 0.01;
            [1, 3].map(|object| {
                let out = (above(object, 0.0) + around - centre(object)).normalize();
                Some(centre(object) + out * (BALL + PROBE - PRESS))
            })
        };
        scene.settle(&[1, 3].map(|object| Some(above(object, 0.02))));
        for k in 0..4000 {
            if bad && k == 500 {
                scene.faults = Some(Faults {
                    random: Random(4),
                    loss: 0.03,
                    duplication: 0.05,
                    overtaking: 0.1,
                });
            }
            if bad && k == 2000 {
                let balls: Vec<_> = (0..5)
                    .map(|object| ("sphere", 2.0 * BALL, centre(object)))
                    .collect();
                let plan = scene_plan(&balls, 2, 8 << 20);
                scene.restart_station(scene_station(&plan, &[("sphere", &SPHERE)], 101));
            }
            let places = at(&scene);
            let record = scene.step(&places);
            assert!(k < 50 || record.probes[..2].iter().all(|probe| probe.contact));
        }
        scene.faults = None;
        scene.settle(&[1, 3].map(|object| Some(above(object, -PRESS))));
        scene.check();
        assert!(scene.controller.fault().is_none());
        scene
    };
    let (quiet, bad) = (run(false), run(true));
    assert_eq!(quiet.outputs.record.resubscribed, 0);
    assert!(bad.outputs.record.resubscribed > 2, "it was bad");
    for object in [1, 3] {
        assert_eq!(quiet.refined_front(object), bad.refined_front(object));
    }
    for probe in [0, 1] {
        let forces = [&quiet, &bad].map(|scene| scene.outputs.wrenches[probe].force);
        assert!(forces[0].distance(forces[1]) < 0.02, "{forces:?}");
    }
}

#[test]
fn one_probes_bad_samples_do_not_disturb_another() {
    let run = |bad: bool| {
        let mut scene = row(3, 2, 8 << 20);
        scene.settle(&[0, 2].map(|object| Some(above(object, 0.02))));
        let mut forces = Vec::new();
        for k in 0..1500u32 {
            let depth = PRESS * (f64::from(k) * 0.01).sin();
            let other = match (bad, k % 3) {
                (true, 0) => Some(DVec3::NAN),
                (true, 1) => None,
                (true, _) => Some(DVec3::splat(f64::INFINITY)),
                (false, _) => Some(above(2, 0.02)),
            };
            let record = scene.step(&[Some(above(0, depth)), other]);
            assert!(
                scene
                    .outputs
                    .wrenches
                    .iter()
                    .all(|wrench| wrench.is_finite())
            );
            assert_eq!(record.probes[1].rejected_sample, bad && k % 3 != 1);
            assert!(!record.probes[0].rejected_sample);
            forces.push(scene.outputs.wrenches[0].force.to_array().map(f64::to_bits));
        }
        assert!(forces.iter().any(|force| force[2] != 0));
        forces
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn chunks_and_samples_of_what_there_is_not_are_ignored() {
    let run = |noise: bool| {
        let mut scene = row(4, 1, 4 << 20);
        let mut random = Random(7);
        for k in 0..2500u32 {
            if noise && scene.inbox.len() < 32 {
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
                    words: [random.next() as u32; 16],
                }; CHUNK_SLOTS];
                scene.inbox.insert(0, InboxChunk { header, slots });
            }
            let depth = PRESS * (f64::from(k) * 0.01).sin();
            let object = k as usize / 600 % 4;
            let mut places = vec![Some(above(object, depth))];
            if noise {
                // More samples than probes.
                places.push(Some(above(1, 0.0)));
                places.push(None);
            }
            scene.step(&places);
        }
        scene.check();
        (
            scene.outputs.wrenches[0].force.to_array(),
            scene.outputs.record.contact,
            scene.outputs.record.contact_full,
        )
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn any_number_of_objects_and_probes_ticks_without_a_station() {
    for (objects, probes) in [(1, 4), (2, 1), (9, 4), (10, 4), (300, 4)] {
        let balls: Vec<_> = (0..objects)
            .map(|object| ("sphere", 2.0 * BALL, centre(object)))
            .collect();
        let plan = scene_plan(&balls, probes, 4 << 20);
        let mut scene = Scene::new(&plan, &[("sphere", &SPHERE)]);
        let samples = vec![Some(Sample::at(Pose::at(DVec3::ZERO))); probes];
        for tick in 0..100 {
            let inputs = TickInputs {
                tick,
                samples: &samples,
                station: 0,
                chunks: [&[], &[]],
                stopping: tick > 50,
            };
            let allocations = count(|| {
                scene
                    .controller
                    .tick(&inputs, &mut scene.outputs, &mut NoObserver);
            });
            assert_eq!(allocations, 0);
            assert!(!scene.outputs.record.contact);
        }
        assert!(scene.controller.is_at_rest());
    }
}

#[test]
fn a_base_mesh_that_finds_no_room_comes_again_whenever_an_object_wakes() {
    let options = BuildOptions {
        base_faces: Some(3000),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Sphere, 20_000, 1), &options);
    let balls: Vec<_> = (0..6)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, 1, 8 << 20);
    let mut scene = Scene::new(&plan, &[("sphere", &model)]);
    let mut at = above(0, 0.02);
    let known = scene.settle(&[Some(at)]).bytes_received;
    for object in [1, 2, 3, 4, 5, 0] {
        lead(&mut scene, &mut at, above(object, 0.02), 5e-4);
        lead(&mut scene, &mut at, above(object, -PRESS), 1e-4);
        let record = scene.settle(&[Some(at)]);
        assert!(
            record.contact_full && record.unserved == 0,
            "object {object}"
        );
        lead(&mut scene, &mut at, above(object, 0.02), 1e-3);
    }
    let base = 1500 * size_of::<ChunkSlot>() as u64;
    assert!(scene.outputs.record.bytes_received > known + 4 * base);
    scene.check();
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
    let mut scene = Scene::touring(&plan, &[("sphere", &SPHERE)], 2.0);
    while (0..4).any(|probe| scene.controller.tour_of(probe).is_none()) {
        if scene.tick == 20 {
            // What is lost comes again.
            scene.faults = Some(Faults {
                random: Random(1),
                loss: 0.1,
                duplication: 0.1,
                overtaking: 0.1,
            });
        }
        scene.step(&[None; 4]);
        assert!(scene.tick < 20_000, "the tours arrive");
    }
    let path = |probe: usize| scene.controller.tour_of(probe).expect("it is here").1;
    for (probe, (object, _)) in tours.into_iter().enumerate() {
        assert_eq!(
            scene.controller.tour_of(probe).map(|tour| tour.0),
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
        let mut random = Random(seed);
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
        let mut scene = Scene::new(&plan, &models);
        let mut at = vec![DVec3::ZERO; probes];
        let mut goals = at.clone();
        for tick in 0..3000 {
            if random.below(400) == 0 {
                scene.faults = (random.below(2) == 0).then(|| Faults {
                    random: Random(random.next()),
                    loss: 0.05,
                    duplication: 0.05,
                    overtaking: 0.1,
                });
            }
            if random.below(1500) == 0 {
                scene.restart_station(scene_station(&plan, &models, 101 + tick));
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
            let record = scene.step(&places);
            contacts += u32::from(record.contact);
            unseated += u32::from(record.unserved > 0);
            assert!(scene.outputs.wrenches.iter().all(|w| w.is_finite()));
            assert!(
                record.cache_bytes as usize <= bytes,
                "seed {seed}, tick {tick}"
            );
            assert!(record.work_units <= scene.controller.work_budget());
            if tick % 500 == 0 {
                scene.check();
            }
        }
        evicted += scene.outputs.record.evicted;
        scene.check();
        assert_eq!(scene.controller.fault(), None, "seed {seed}");
        assert_eq!(scene.controller.refused().0, 0, "seed {seed}");
        assert_eq!(scene.allocations, 0);
        assert!(scene.controller.bytes_high_water() <= bytes);
    }
    println!("{contacts} ticks in contact, {evicted} evicted, {unseated} ticks unseated");
    assert!(contacts > 5000 && evicted > 1000);
}
