//! A fault on one object: it is named, and the others are touched as before.

use crate::common::{World, check, scene_plan, scene_station, scene_world, settle, spm};
use glam::DVec3;
use hrtc_core::Fault;
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{AnswerItem, AnswersReader, ChunkKind, MODEL_HEADER_SLOTS, Refusal};
use scene::{ScenePlan, TrajectoryPlan};
use simulator::LinkModel;
use spm::NONE;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::LazyLock;

/// Radius of the balls and of the probes, metres.
const BALL: f64 = 0.05;
const PROBE: f64 = 0.001;
const NAMES: [&str; 5] = ["a.spm", "b.spm", "c.spm", "d.spm", "e.spm"];
/// The object with the fault.
const BAD: u32 = 2;

static SPHERE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 3000, 1), &BuildOptions::default()));
/// The same ball with other faces.
static REBUILT: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 3500, 1), &BuildOptions::default()));

fn centre(object: u32) -> DVec3 {
    DVec3::X * (0.13 * f64::from(object))
}

fn above(object: u32, gap: f64) -> DVec3 {
    centre(object) + DVec3::Z * (BALL + PROBE + gap)
}

/// A row of balls, each of a model of its own.
fn row(cache_bytes: usize) -> (ScenePlan, World) {
    let balls = (0u32..).zip(NAMES);
    let balls: Vec<_> = balls
        .map(|(k, name)| (name, 2.0 * BALL, centre(k)))
        .collect();
    let plan = scene_plan(&balls, 1, cache_bytes);
    let world = scene_world(&plan, &NAMES.map(|name| (name, &SPHERE[..])), 0.0);
    (plan, world)
}

/// The force of a press on an object, newtons.
fn press(world: &mut World, object: u32) -> f64 {
    for k in 0..900 {
        // Down within a third of the time, from where the probe may come and go freely.
        let down = (f64::from(k) / 300.0).min(1.0);
        world.step_at(above(object, 0.02 - 0.021 * down));
    }
    let force = world.force().length();
    for k in (0..300).rev() {
        world.step_at(above(object, 0.02 - 0.021 * f64::from(k) / 300.0));
    }
    force
}

fn expect_all_but_the_bad_one(world: &mut World, fault: Fault) {
    for _ in 0..1500 {
        world.step_at(above(0, 0.02));
    }
    let faults: Vec<_> = world.controller().faults().collect();
    assert_eq!(faults, [(BAD as usize, fault)]);
    assert_eq!(world.controller().fault(), None, "the run goes on");
    for object in 0..NAMES.len() as u32 {
        let force = press(world, object);
        println!("object {object}: {force} N");
        assert_eq!(force > 0.5, object != BAD, "object {object}: {force} N");
    }
    let faults: Vec<_> = world.controller().faults().collect();
    assert_eq!(faults, [(BAD as usize, fault)]);
}

type Damage = fn(&mut InboxChunk);

fn zeroed(chunk: &mut InboxChunk) {
    for slot in &mut chunk.slots {
        slot.words.fill(0);
    }
}

fn refused(chunk: &mut InboxChunk) {
    chunk.header.kind = ChunkKind::Refused as u32;
    chunk.header.code = Refusal::UnknownModel as u32;
}

/// The header is sound, but not what follows it.
fn changed_base_mesh(chunk: &mut InboxChunk) {
    let first = if chunk.header.code == 0 {
        MODEL_HEADER_SLOTS
    } else {
        0
    };
    for slot in &mut chunk.slots[first..] {
        slot.words.fill(u32::MAX);
    }
}

/// Another model from the second chunk on.
fn rebuilt_meanwhile(chunk: &mut InboxChunk) {
    chunk.header.model ^= u64::from(chunk.header.code > 0);
}

fn no_place(chunk: &mut InboxChunk) {
    refused(chunk);
    chunk.header.code = Refusal::NoPlace as u32;
}

#[test]
fn a_faulty_model_leaves_the_others_touchable_and_a_repaired_one_is_touched() {
    let faults: [(Fault, Damage); 5] = [
        (Fault::DamagedModel, zeroed),
        (Fault::DamagedModel, changed_base_mesh),
        (Fault::UnknownModel, refused),
        (Fault::NoPlace, no_place),
        (Fault::AnotherModel, rebuilt_meanwhile),
    ];
    for (fault, damage) in faults {
        // Places take turns.
        let (plan, mut world) = row(6 << 20);
        assert_eq!(world.controller().active_objects().len(), 3);
        println!("{fault:?}");
        world.client_mut().link().tamper(move |chunk| {
            let is_model = chunk.header.kind == ChunkKind::Model as u32;
            if is_model && chunk.header.object == BAD {
                damage(chunk);
            }
        });
        expect_all_but_the_bad_one(&mut world, fault);
        // A station that serves it well.
        world.client_mut().link().stop_tampering();
        let models = NAMES.map(|name| (name, &SPHERE[..]));
        world.start_station(scene_station(&plan, &models, 101));
        settle(&mut world, &[Some(above(BAD, 0.02))]);
        assert_eq!(world.controller().faults().count(), 0);
        let force = press(&mut world, BAD);
        assert!(force > 0.5, "{force} N on the repaired object");
    }
}

/// A controller that ends leaves its place to one that was turned away, for one object of several
/// too.
#[test]
fn what_the_station_had_no_place_for_is_asked_for_again() {
    let (_, mut world) = row(6 << 20);
    world.client_mut().link().tamper(|chunk| {
        if chunk.header.kind == ChunkKind::Model as u32 && chunk.header.object == BAD {
            no_place(chunk);
        }
    });
    expect_all_but_the_bad_one(&mut world, Fault::NoPlace);
    // Meanwhile another one is touched, without a break, with the station and without it.
    for silent in [false, true] {
        world.mute_station(silent);
        for k in 0..5000 {
            let down = (f64::from(k) / 300.0).min(1.0);
            world.step_at(above(0, 0.02 - 0.021 * down));
            let force = world.force().length();
            assert!(k < 600 || force > 0.5, "{silent} {k}: {force} N");
        }
        for k in (0..300).rev() {
            world.step_at(above(0, 0.02 - 0.021 * f64::from(k) / 300.0));
        }
    }
    world.mute_station(false);
    world.client_mut().link().stop_tampering();
    // Nor when it comes.
    for k in 0..4500 {
        let down = (f64::from(k) / 300.0).min(1.0);
        world.step_at(above(0, 0.02 - 0.021 * down));
        let force = world.force().length();
        assert!(world.outputs().record.ready, "{k}");
        assert!(k < 600 || force > 0.75, "{k}: {force} N");
    }
    for k in (0..300).rev() {
        world.step_at(above(0, 0.02 - 0.021 * f64::from(k) / 300.0));
    }
    assert_eq!(world.controller().faults().count(), 0);
    let force = press(&mut world, BAD);
    assert!(force > 0.5, "{force} N");
}

/// From now on the station does not know the models of these objects.
fn refuse_models(world: &mut World, objects: std::ops::Range<u32>) {
    world.client_mut().link().tamper(move |chunk| {
        let is_model = chunk.header.kind == ChunkKind::Model as u32;
        if is_model && objects.contains(&chunk.header.object) {
            refused(chunk);
        }
    });
}

/// Goes on to press the first object, with a force in every tick.
fn stay_pressed(world: &mut World, ticks: u32) {
    for k in 0..ticks {
        let is_ready = world.step_at(above(0, -1e-3)).record.ready;
        let force = world.force().length();
        assert!(is_ready && force > 0.5, "{k} of {ticks}: {force} N");
    }
}

/// Another station may serve what the last one could not, and is asked for it; whether it answers
/// or not, contact with the others goes on.
#[test]
fn another_station_takes_no_force_off_a_sound_object() {
    for silent in [false, true] {
        println!("silent: {silent}");
        let (plan, mut world) = row(6 << 20);
        let models = NAMES.map(|name| (name, &SPHERE[..]));
        refuse_models(&mut world, BAD..BAD + 1);
        expect_all_but_the_bad_one(&mut world, Fault::UnknownModel);
        for k in 0..600 {
            let down = (f64::from(k) / 300.0).min(1.0);
            world.step_at(above(0, 0.02 - 0.021 * down));
        }
        stay_pressed(&mut world, 100);
        world.start_station(scene_station(&plan, &models, 101));
        // It is heard once.
        stay_pressed(&mut world, 1);
        world.mute_station(silent);
        stay_pressed(&mut world, 1000);
        world.mute_station(false);
        stay_pressed(&mut world, 3000);
        let faults: Vec<_> = world.controller().faults().collect();
        assert_eq!(faults, [(BAD as usize, Fault::UnknownModel)]);
        world.client_mut().link().stop_tampering();
        world.start_station(scene_station(&plan, &models, 102));
        stay_pressed(&mut world, 2000);
        assert_eq!(world.controller().faults().count(), 0);
        for k in (0..300).rev() {
            world.step_at(above(0, 0.02 - 0.021 * f64::from(k) / 300.0));
        }
        let force = press(&mut world, BAD);
        assert!(force > 0.5, "{force} N");
    }
}

/// While nothing is in reach, the models that a silent station is asked for again fill all places.
#[test]
fn what_is_asked_for_in_vain_leaves_its_place_to_an_object_in_reach() {
    let (plan, mut world) = row(6 << 20);
    refuse_models(&mut world, BAD..u32::MAX);
    for _ in 0..1500 {
        world.step_at(above(0, 0.02));
    }
    let lost = world.controller().faults().count();
    assert!(lost >= world.controller().active_objects().len(), "{lost}");
    let models = NAMES.map(|name| (name, &SPHERE[..]));
    world.start_station(scene_station(&plan, &models, 101));
    let far = above(0, 0.1);
    world.step_at(far);
    world.mute_station(true);
    for _ in 0..300 {
        world.step_at(far);
    }
    let mut objects = world.controller().active_objects().iter();
    assert!(objects.all(|of| !of.is_ready()), "all places are taken");
    for object in [1, 0, 1] {
        let force = press(&mut world, object);
        assert!(force > 0.5, "object {object}: {force} N");
    }
    assert_eq!(world.controller().faults().count(), lost);
}

/// There is no force before every model is known. A hand that rests near so many objects that all
/// places are needed does not keep the others from that: first where every object has a model of
/// its own, then where the first model has more objects, which are in reach before the last models
/// are known.
#[test]
fn every_model_comes_while_the_hand_rests_near_more_objects_than_there_are_places() {
    for more in [0, 3] {
        let names = [NAMES[0]; 3].into_iter().take(more).chain(NAMES);
        let balls: Vec<_> = (0u32..)
            .zip(names)
            .map(|(k, name)| (name, 2.0 * BALL, DVec3::X * (1e-3 * f64::from(k))))
            .collect();
        let plan = scene_plan(&balls, 1, 6 << 20);
        let models = NAMES.map(|name| (name, &SPHERE[..]));
        let mut world = scene_world(&plan, &models, 0.0);
        let places = world.controller().active_objects().len();
        assert!(places < NAMES.len(), "{places} places");
        for _ in 0..1500 {
            world.step_at(above(0, 0.005));
        }
        let controller = world.controller();
        let objects = 0..balls.len();
        let near = objects.filter(|&object| controller.proxy_of(0, object).is_some());
        assert_eq!(near.count(), places, "all places are needed");
        assert!(world.outputs().record.ready, "{more} more objects");
        let force = press(&mut world, 0);
        assert!(force > 0.5, "{more} more objects: {force} N");
        assert_eq!(world.client().allocations(), 0);
        check(&world);
    }
}

/// No force is given before every model is known, but a hand that enters an object meanwhile has
/// its proxy outside, to which the force leads then.
#[test]
fn a_hand_that_presses_while_another_model_is_awaited_stays_outside() {
    for (late, pressed) in [(0, 1), (0, 4), (BAD, 0), (BAD, 3)] {
        let (_, mut world) = row(6 << 20);
        world.client_mut().link().tamper(move |chunk| {
            // As if lost: for an object that there is not.
            if chunk.header.kind == ChunkKind::Model as u32 && chunk.header.object == late {
                chunk.header.object = u32::MAX;
            }
        });
        for _ in 0..1500 {
            world.step_at(above(pressed, 0.02));
        }
        // So deep that a proxy that began now would be inside.
        let depth = 3.0 * PROBE;
        for k in 1..=300 {
            let down = f64::from(k) / 300.0;
            world.step_at(above(pressed, 0.02 - (0.02 + depth) * down));
        }
        assert!(!world.outputs().record.ready, "{late} is known");
        assert_eq!(world.force(), DVec3::ZERO);
        world.client_mut().link().stop_tampering();
        for _ in 0..1500 {
            world.step_at(above(pressed, -depth));
        }
        assert!(world.outputs().record.ready, "{late} is not known");
        let proxy = world.controller().proxy_of(0, pressed as usize);
        let outside = proxy.map(|proxy| proxy.distance(centre(pressed)) - BALL - PROBE);
        // Chords of the mesh lie under the ball.
        assert!(
            outside.is_some_and(|outside| outside > -3e-4),
            "{pressed}, {late} late: {outside:?}"
        );
        let force = world.force().z;
        assert!(force > 0.5, "{pressed}, {late} late: {force} N");
    }
}

#[test]
fn a_model_that_does_not_fit_leaves_the_others_touchable() {
    let (plan, _) = row(6 << 20);
    let options = BuildOptions {
        base_faces: Some(15_000),
        ..BuildOptions::default()
    };
    let large = spm(generate(Shape::Sphere, 20_000, 1), &options);
    let mut models = NAMES.map(|name| (name, &SPHERE[..]));
    models[BAD as usize].1 = &large;
    let mut world = scene_world(&plan, &models, 0.0);
    for _ in 0..1500 {
        world.step_at(above(0, 0.02));
    }
    let Some((object, fault)) = world.controller().faults().next() else {
        panic!("it does not fit");
    };
    assert_eq!(object, BAD as usize);
    assert!(matches!(fault, Fault::Cache(_)), "{fault}");
    expect_all_but_the_bad_one(&mut world, fault);
}

#[test]
fn refused_regions_leave_the_base_mesh_and_the_others_touchable() {
    for refusal in [
        Refusal::UnknownModel,
        Refusal::UnknownRegion,
        Refusal::DamagedBlock,
        Refusal::Tolerance,
    ] {
        let (_, mut world) = row(6 << 20);
        world.client_mut().link().tamper(move |chunk| {
            let is_answer = chunk.header.kind == ChunkKind::Answers as u32;
            if is_answer && chunk.header.object == BAD {
                let head = AnswersReader::new(chunk.header.count).next(&chunk.slots);
                let Ok(Some(AnswerItem::Part(head))) = head else {
                    panic!("answers begin with a part");
                };
                chunk.header.kind = ChunkKind::Refused as u32;
                chunk.header.code = refusal as u32;
                chunk.header.region = head.region;
                chunk.header.tolerance_bits = head.tolerance_bits;
            }
        });
        for object in 0..NAMES.len() as u32 {
            let force = press(&mut world, object);
            assert!(force > 0.3, "{refusal:?}, object {object}: {force} N");
        }
        assert_eq!(world.controller().fault(), None);
    }
}

#[test]
fn a_rebuilt_model_is_named_and_its_old_mesh_is_touched_on() {
    let plan = scene_plan(&[("a.spm", 2.0 * BALL, DVec3::ZERO)], 1, 8 << 20);
    let mut world = scene_world(&plan, &[("a.spm", &SPHERE)], 0.0);
    let pressed = above(0, -1e-3);
    settle(&mut world, &[Some(above(0, 0.02))]);
    for k in 0..=300 {
        world.step_at(above(0, 0.02).lerp(pressed, f64::from(k) / 300.0));
    }
    settle(&mut world, &[Some(pressed)]);
    let force = world.force();
    assert!(force.length() > 0.5, "{force}");
    world.start_station(scene_station(&plan, &[("a.spm", &REBUILT)], 101));
    for tick in 0..1000 {
        world.step_at(pressed);
        let differs = world.force().distance(force);
        assert!(differs < 1e-6 * force.length(), "tick {tick}: {differs} N");
    }
    let faults: Vec<_> = world.controller().faults().collect();
    assert_eq!(faults, [(0, Fault::AnotherModel)]);
    assert!(Fault::AnotherModel.to_string().contains("rebuilt"));
    assert_eq!(world.controller().fault(), None);
    // The model of before comes back.
    world.start_station(scene_station(&plan, &[("a.spm", &SPHERE)], 102));
    settle(&mut world, &[Some(pressed)]);
    assert_eq!(world.controller().faults().count(), 0);
}

/// A base mesh arrives slowly, and its station comes back with another model under the same name:
/// once when there is a fault already, and once without.
#[test]
fn a_model_that_is_rebuilt_while_its_base_mesh_arrives_is_touched() {
    let rebuilt: [(&str, &[u8]); 2] = [("a.spm", &REBUILT), ("b.spm", &REBUILT)];
    for is_damaged in [false, true] {
        let balls = [
            ("a.spm", 2.0 * BALL, centre(0)),
            ("b.spm", 2.0 * BALL, centre(1)),
        ];
        let plan = scene_plan(&balls, 1, 16 << 20);
        let mut world = scene_world(&plan, &[("a.spm", &SPHERE), ("b.spm", &SPHERE)], 0.0);
        let link = world.client_mut().link();
        link.set_model(LinkModel {
            bytes_per_tick: 500.0,
            ..LinkModel::default()
        });
        if is_damaged {
            link.tamper(|chunk| {
                let is_later = chunk.header.code > 0;
                if is_later && chunk.header.kind == ChunkKind::Model as u32 {
                    for slot in &mut chunk.slots {
                        slot.words.fill(u32::MAX);
                    }
                }
            });
        }
        // Two chunks of three.
        for _ in 0..30 {
            world.step_at(above(0, 0.02));
        }
        assert!(!world.controller().active_objects()[0].is_ready());
        assert_eq!(world.controller().has_faults(), is_damaged);
        let link = world.client_mut().link();
        link.stop_tampering();
        link.set_model(LinkModel::default());
        world.start_station(scene_station(&plan, &rebuilt, 101));
        settle(&mut world, &[Some(above(0, 0.02))]);
        let faults: Vec<_> = world.controller().faults().collect();
        assert_eq!(faults, []);
        for object in 0..2 {
            let force = press(&mut world, object);
            assert!(force > 0.5, "object {object}: {force} N");
        }
        assert_eq!(world.client().allocations(), 0);
        world.controller().cache().check();
    }
}

#[test]
fn a_tour_that_cannot_be_made_leaves_the_other_probe_its_force() {
    let balls = [
        ("a.spm", 2.0 * BALL, centre(0)),
        ("b.spm", 2.0 * BALL, centre(1)),
    ];
    let mut plan = scene_plan(&balls, 2, 16 << 20);
    plan.probes[0].trajectory = TrajectoryPlan::Tour {
        object: 0,
        seed: 1,
        speed_m_per_s: 0.1,
        depth_m: 1e-3,
    };
    let mut world = scene_world(&plan, &[("a.spm", &SPHERE), ("b.spm", &SPHERE)], 5.0);
    world.client_mut().link().tamper(|chunk| {
        if chunk.header.kind == ChunkKind::Tour as u32 {
            chunk.header.kind = ChunkKind::Refused as u32;
            chunk.header.code = Refusal::DamagedBlock as u32;
            chunk.header.region = NONE;
        }
    });
    for k in 0..2000 {
        let down = (f64::from(k) / 1000.0).min(1.0);
        world.step_places(&[None, Some(above(1, 0.02 - 0.021 * down))]);
    }
    let faults: Vec<_> = world.controller().faults().collect();
    assert_eq!(faults, [(0, Fault::NoTour)]);
    assert_eq!(world.controller().fault(), None);
    let force = world.outputs().wrenches[1].force.length();
    assert!(force > 0.5, "{force} N");
}

#[test]
fn a_refused_tour_is_asked_for_again_after_a_while_and_of_another_station() {
    let balls = [
        ("a.spm", 2.0 * BALL, centre(0)),
        ("b.spm", 2.0 * BALL, centre(1)),
    ];
    let mut plan = scene_plan(&balls, 2, 16 << 20);
    plan.probes[0].trajectory = TrajectoryPlan::Tour {
        object: 0,
        seed: 1,
        speed_m_per_s: 0.1,
        depth_m: 1e-3,
    };
    for is_another_station in [false, true] {
        let models = [("a.spm", &SPHERE[..]), ("b.spm", &SPHERE[..])];
        let mut world = scene_world(&plan, &models, 5.0);
        world.client_mut().link().tamper(|chunk| {
            if chunk.header.kind == ChunkKind::Tour as u32 {
                chunk.header.kind = ChunkKind::Refused as u32;
                chunk.header.code = Refusal::Tour as u32;
                chunk.header.region = NONE;
            }
        });
        let places = [None, Some(above(1, 0.02))];
        while world.controller().faults().count() == 0 {
            world.step_places(&places);
            assert!(world.tick() < 2000, "it is refused");
        }
        assert!(world.controller().tour_of(0).is_none());
        world.client_mut().link().stop_tampering();
        if is_another_station {
            world.start_station(scene_station(&plan, &models, 101));
        }
        let from = world.tick();
        while world.controller().tour_of(0).is_none() {
            world.step_places(&places);
            assert!(
                world.tick() < from + 4000,
                "another station: {is_another_station}"
            );
        }
        println!(
            "another station: {is_another_station}: after {} ticks",
            world.tick() - from
        );
        assert_eq!(world.controller().faults().count(), 0);
    }
}

#[test]
fn a_scene_of_which_nothing_can_be_touched_is_a_fault_of_the_run() {
    let plan = scene_plan(&[("a.spm", 2.0 * BALL, DVec3::ZERO)], 1, 8 << 20);
    let mut world = scene_world(&plan, &[("a.spm", &SPHERE)], 0.0);
    world.client_mut().link().tamper(refused);
    for _ in 0..200 {
        world.step_at(above(0, -1e-3));
    }
    assert_eq!(world.controller().fault(), Some(Fault::UnknownModel));
    assert_eq!(world.force(), DVec3::ZERO);
}
