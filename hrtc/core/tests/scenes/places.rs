//! Objects that have their places late, or that a probe reaches at once: it is outside of them.

use crate::common::{World, check, scene_plan, scene_world, settle, spm};
use glam::DVec3;
use protocol::{ChunkKind, MODEL_HEADER_SLOTS};
use scene::{DrivenPlan, MovablePlan};
use simulator::LinkModel;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::LazyLock;

/// Radius of the balls and of the probes, metres.
const BALL: f64 = 0.05;
const PROBE: f64 = 0.001;

static SPHERE: LazyLock<Vec<u8>> =
    LazyLock::new(|| spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default()));
/// Of so many base faces that a coarse front does not reach far.
static PLATE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let options = BuildOptions {
        base_faces: Some(800),
        ..BuildOptions::default()
    };
    spm(generate(Shape::Plate, 5000, 1), &options)
});

/// Leads the first probe from where it is to a place, at most `step` metres a tick.
fn lead(world: &mut World, at: &mut DVec3, to: DVec3, step: f64) {
    while *at != to {
        let way = to - *at;
        let share = (step / way.length()).min(1.0);
        *at = if share < 1.0 { *at + way * share } else { to };
        world.step_places(&[Some(*at)]);
    }
}

/// How far the proxy at an object is outside of a ball, metres; `None` where there is no proxy.
fn outside(world: &World, object: usize, (centre, radius): (DVec3, f64)) -> Option<f64> {
    let proxy = world.controller().proxy_of(0, object)?;
    Some(proxy.distance(centre) - radius - PROBE)
}

/// Four balls that touch each other, and three places. So few base faces that their coarse fronts
/// may reach beyond the middle between them.
#[test]
fn each_of_four_objects_beside_each_other_is_touched() {
    let options = BuildOptions {
        base_faces: Some(40),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Sphere, 20_000, 1), &options);
    let centres = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
    let centres = centres.map(|(x, y)| DVec3::new(x, y, 0.0) * BALL);
    let balls = centres.map(|centre| ("sphere", 2.0 * BALL, centre));
    let plan = scene_plan(&balls, 1, 8 << 20);
    let mut world = scene_world(&plan, &[("sphere", &model)], 0.0);
    assert_eq!(world.controller().active_objects().len(), 3);
    let middle = DVec3::Z * 0.03;
    let mut at = middle;
    settle(&mut world, &[Some(at)]);
    for object in [0, 1, 2, 3, 0] {
        let centre = centres[object];
        // Towards the middle, and up.
        let out = (DVec3::Z * 0.027 - centre).normalize();
        let above = |gap: f64| centre + out * (BALL + PROBE + gap);
        lead(&mut world, &mut at, above(0.01), 2e-4);
        lead(&mut world, &mut at, above(-1e-3), 1e-4);
        for tick in 0..500 {
            let record = world.step_places(&[Some(at)]).record;
            let touched = world.outputs().contacts[0].map(|of| of.object as usize);
            let is_felt = record.contact && touched == Some(object);
            // At first a coarse front may lie under the ball.
            assert!(is_felt || tick < 200, "{object}, {tick}");
        }
        let off = outside(&world, object, (centre, BALL));
        assert!(off.is_some_and(|off| off.abs() < 1e-3), "{object}: {off:?}");
        lead(&mut world, &mut at, above(0.01), 1e-3);
        lead(&mut world, &mut at, middle, 1e-3);
    }
    assert_eq!(world.client().allocations(), 0);
    check(&world);
}

/// Three large balls, in the corners of whose boxes a small one lies: as long as a probe is in all
/// three boxes they keep their places, though nothing of them is near.
#[test]
fn what_has_its_place_late_is_touched_from_where_the_hand_came() {
    const SMALL: f64 = 0.01;
    // The first box ends 6 mm beside the middle of the small ball.
    let corners = [
        DVec3::new(0.206, 0.19, 0.19),
        DVec3::new(-0.18, 0.18, 0.18),
        DVec3::new(0.18, -0.18, 0.18),
    ];
    let mut balls: Vec<_> = corners.map(|centre| ("sphere", 0.4, centre)).to_vec();
    balls.push(("sphere", 2.0 * SMALL, DVec3::ZERO));
    let plan = scene_plan(&balls, 1, 8 << 20);
    let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
    let mut at = DVec3::X * 0.018;
    settle(&mut world, &[Some(at)]);
    assert!(world.controller().active_object(3).is_none(), "no place");
    // It sinks in by 3.5 mm without being felt, and so far that the first box is left.
    lead(&mut world, &mut at, DVec3::X * 0.0075, 1e-5);
    assert!(!world.outputs().record.contact);
    assert!(world.controller().active_object(3).is_none(), "no place");
    lead(&mut world, &mut at, DVec3::X * 0.003, 1e-5);
    for _ in 0..300 {
        world.step_places(&[Some(at)]);
    }
    let proxy = world.controller().proxy_of(0, 3).expect("it has a place");
    let off = outside(&world, 3, (DVec3::ZERO, SMALL));
    assert!(off.is_some_and(|off| off.abs() < 1e-3), "{proxy}");
    assert!(
        proxy.x > 0.0,
        "on the side from which the hand came: {proxy}"
    );
    assert!(world.outputs().record.contact);
}

/// A hand that was at rest goes on while periods are skipped, and is behind a sheet then: with one
/// object, with two, and with more than there are places, which others have.
#[test]
fn a_stall_leads_no_hand_through_an_object_that_was_not_near() {
    const SIZE: f64 = 0.2;
    for objects in [1usize, 2, 6] {
        let centre = |object: usize| DVec3::X * (0.5 * object as f64);
        let plates: Vec<_> = (0..objects)
            .map(|object| ("plate", SIZE, centre(object)))
            .collect();
        let plan = scene_plan(&plates, 1, 8 << 20);
        let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
        let last = centre(objects - 1);
        let mut at = centre(0) + DVec3::Z * 0.005;
        settle(&mut world, &[Some(at)]);
        for object in 0..objects.min(4) {
            lead(&mut world, &mut at, centre(object) + DVec3::Z * 0.005, 1e-3);
            settle(&mut world, &[Some(at)]);
        }
        let up = DVec3 { z: 0.08, ..at };
        lead(&mut world, &mut at, up, 1e-3);
        lead(&mut world, &mut at, last + DVec3::Z * 0.08, 1e-3);
        for _ in 0..300 {
            world.step_places(&[Some(at)]);
        }
        world.skip(300);
        at = last - DVec3::Z * 0.08;
        for _ in 0..200 {
            world.step_places(&[Some(at)]);
        }
        let proxy = world.controller().proxy_of(0, objects - 1);
        let is_above = proxy.is_some_and(|proxy| proxy.z > 0.0);
        assert!(is_above, "of {objects}: {proxy:?}");
        assert!(world.outputs().record.contact, "of {objects}");
        assert_eq!(world.client().allocations(), 0);
    }
}

/// A floor of four plates, and three places. The hand goes round the edge of the first plate, so
/// near that a coarse front might reach it all the way, and feels it from below. In the midst of
/// the floor the plate loses its place to the one across, and has it again beside it.
#[test]
fn what_the_hand_went_round_is_touched_from_there_when_it_has_its_place_again() {
    const SIZE: f64 = 0.1;
    // Few base faces: their vertices may move by more than the hand is away.
    let options = BuildOptions {
        base_faces: Some(200),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Plate, 5000, 1), &options);
    let middles = [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)];
    let plates = middles.map(|(x, y)| ("plate", SIZE, DVec3::new(x, y, 0.0) * 0.5 * SIZE));
    let plan = scene_plan(&plates, 1, 8 << 20);
    let mut world = scene_world(&plan, &[("plate", &model)], 0.0);
    let place = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * 1e-3;
    let mut at = place(-98.0, -50.0, 30.0);
    settle(&mut world, &[Some(at)]);
    lead(&mut world, &mut at, place(-98.0, -50.0, 2.0), 1e-4);
    settle(&mut world, &[Some(at)]);
    for [x, z] in [[-102.0, 2.0], [-102.0, -2.0], [-98.0, -2.0], [-98.0, -0.5]] {
        lead(&mut world, &mut at, place(x, -50.0, z), 1e-4);
    }
    settle(&mut world, &[Some(at)]);
    assert!(world.outputs().record.contact, "it is felt from below");
    let proxy = world.controller().proxy_of(0, 0).expect("it has a place");
    assert!(proxy.z < -0.5 * PROBE, "{proxy}");
    lead(&mut world, &mut at, place(-98.0, -50.0, -1.5), 1e-4);
    lead(&mut world, &mut at, place(-10.0, -10.0, -1.2), 2e-4);
    // Below the plate across the middle, 2.8 mm from the first one.
    lead(&mut world, &mut at, place(1.8, 1.8, -1.2), 1e-4);
    for _ in 0..200 {
        world.step_places(&[Some(at)]);
    }
    assert!(world.controller().active_object(0).is_none(), "no place");
    assert!(world.controller().proxy_of(0, 3).is_some());
    assert!(!world.outputs().record.contact);
    lead(&mut world, &mut at, place(-10.0, -10.0, -3.0), 1e-4);
    for _ in 0..300 {
        world.step_places(&[Some(at)]);
    }
    let proxy = world.controller().proxy_of(0, 0).expect("it has a place");
    assert!(proxy.distance(at) < 1e-6, "{proxy}, {at}");
    assert!(!world.outputs().record.contact);
    assert_eq!(world.client().allocations(), 0);
    check(&world);
}

/// Plates whose base mesh is asked for each time, over a line of 0.4 s. The hand is above one when
/// that has its place, and below when its base mesh is there.
#[test]
fn what_waits_for_its_mesh_is_touched_from_where_the_hand_is_by_then() {
    const SIZE: f64 = 0.1;
    // So many base faces that there is no room for them beside the caches, and so small that the
    // hand goes round them all.
    let options = BuildOptions {
        base_faces: Some(4000),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Plate, 20_000, 1), &options);
    let centre = |object: usize| DVec3::X * (0.5 * object as f64);
    let plates: Vec<_> = (0..4)
        .map(|object| ("plate", SIZE, centre(object)))
        .collect();
    let plan = scene_plan(&plates, 1, 8 << 20);
    let mut world = scene_world(&plan, &[("plate", &model)], 0.0);
    world.client_mut().link().set_model(LinkModel {
        delay_ticks: 200,
        ..LinkModel::default()
    });
    let mut at = centre(0) + DVec3::Z * 0.4;
    while !world.outputs().record.ready {
        world.step_places(&[Some(at)]);
        assert!(world.tick() < 20_000, "the model arrives");
    }
    let is_ready = |world: &World| {
        let active = world.controller().active_object(3);
        active.map(|object| object.is_ready())
    };
    let beside = |x: f64, z: f64| centre(3) + DVec3::new(x, 0.0, z);
    lead(&mut world, &mut at, beside(-0.04, 0.4), 1e-3);
    assert_eq!(is_ready(&world), None, "no place");
    lead(&mut world, &mut at, beside(-0.04, 0.01), 1e-3);
    assert_eq!(is_ready(&world), Some(false), "it waits for its mesh");
    for (x, z) in [(-0.06, 0.01), (-0.06, -0.01), (-0.04, -0.01)] {
        lead(&mut world, &mut at, beside(x, z), 1e-3);
    }
    assert_eq!(is_ready(&world), Some(false), "it waits for its mesh");
    let mut ticks = 0;
    while is_ready(&world) != Some(true) {
        world.step_places(&[Some(at)]);
        ticks += 1;
        assert!(ticks < 10_000, "the mesh arrives");
    }
    for _ in 0..300 {
        world.step_places(&[Some(at)]);
        assert!(!world.outputs().record.contact);
    }
    let proxy = world.controller().proxy_of(0, 3).expect("it is near");
    assert!(proxy.distance(at) < 1e-6, "{proxy}, {at}");
}

/// A plate passes over a hand at rest while periods are skipped, and goes on: with as many places
/// as objects, and with more objects, which have them.
#[test]
fn what_passes_over_a_hand_in_a_stall_takes_it_along() {
    const SIZE: f64 = 0.2;
    const SPEED: f64 = 0.3;
    /// Last tick before the stall.
    const STALLS: u64 = 10_000;
    for objects in [2usize, 6] {
        let last = objects - 1;
        // The last plate comes from far above, and is 80 mm above the hand then.
        let above = DVec3::Z * (0.08 + SPEED * 1e-3 * STALLS as f64);
        let centre = |object: usize| DVec3::X * (0.5 * object as f64);
        let plates: Vec<_> = (0..objects)
            .map(|object| {
                let up = if object == last { above } else { DVec3::ZERO };
                ("plate", SIZE, centre(object) + up)
            })
            .collect();
        let mut plan = scene_plan(&plates, 1, 8 << 20);
        plan.objects[last].movable = Some(MovablePlan::Driven(DrivenPlan {
            linear_m_per_s: DVec3::NEG_Z * SPEED,
            angular_rad_per_s: DVec3::ZERO,
            anchor_m: DVec3::ZERO,
            period_s: None,
        }));
        let mut world = scene_world(&plan, &[("plate", &PLATE)], 0.0);
        let mut at = centre(0) + DVec3::Z * 0.005;
        for object in 0..last.min(4) {
            lead(&mut world, &mut at, centre(object) + DVec3::Z * 0.005, 1e-3);
            for _ in 0..500 {
                world.step_places(&[Some(at)]);
            }
        }
        let up = DVec3 { z: 0.08, ..at };
        lead(&mut world, &mut at, up, 1e-3);
        lead(&mut world, &mut at, centre(last), 1e-3);
        assert!(world.tick() < STALLS, "of {objects}");
        while world.tick() <= STALLS {
            world.step_places(&[Some(at)]);
        }
        assert_eq!(world.controller().proxy_of(0, last), None, "of {objects}");
        world.skip(600);
        for _ in 0..200 {
            world.step_places(&[Some(at)]);
        }
        let plate = world.controller().movables().body(last as u32);
        let height = plate.expect("it moves").pose().position.z;
        let proxy = world.controller().proxy_of(0, last);
        let is_below = proxy.is_some_and(|proxy| proxy.z < height);
        assert!(is_below, "of {objects}: {proxy:?}, {height}");
        assert!(world.outputs().record.contact, "of {objects}");
        assert_eq!(world.client().allocations(), 0);
    }
}

#[test]
fn the_most_bytes_are_those_of_a_tick_and_marks_stay_when_objects_go() {
    let centre = |object: usize| DVec3::X * (0.13 * object as f64);
    let above = |object, gap: f64| centre(object) + DVec3::Z * (BALL + PROBE + gap);
    let balls: Vec<_> = (0..6)
        .map(|object| ("sphere", 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, 1, 4 << 20);
    let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
    let mut most = 0;
    let mut at = above(0, 0.02);
    let mut go = |world: &mut World, to: DVec3| {
        while at != to {
            let way = to - at;
            let share = (2e-4 / way.length()).min(1.0);
            at = if share < 1.0 { at + way * share } else { to };
            most = most.max(world.step_places(&[Some(at)]).record.cache_bytes);
        }
        most
    };
    go(&mut world, above(0, 0.021));
    for object in 0..6 {
        go(&mut world, above(object, 0.02));
        go(&mut world, above(object, -1e-3));
        go(&mut world, above(object, 0.02));
    }
    let most = go(&mut world, above(5, 0.5));
    assert_eq!(world.controller().bytes_high_water() as u64, most);
    let all = world.controller().capacities();
    for of in &all {
        assert!(of.high_water <= of.capacity, "{of:?}");
    }
    // The run ends in the air, and no proxy is there.
    for used in [
        "splits in the cache",
        "faces of the front and its tree",
        "faces near the probe",
        "half-spaces of the proxy",
    ] {
        let of = all.iter().find(|of| of.name == used);
        assert!(of.is_some_and(|of| of.high_water > 0), "{used}: {of:?}");
    }
}

/// A station says of one base vertex that nothing is certified of it, so that its R is infinite.
#[test]
fn a_base_vertex_without_a_bound_makes_its_object_near_to_nothing_far_away() {
    const BAD: u32 = 1;
    let centre = |object: usize| DVec3::X * (0.13 * object as f64);
    let names = ["a", "b", "c", "d"];
    let balls: Vec<_> = names
        .iter()
        .enumerate()
        .map(|(object, name)| (*name, 2.0 * BALL, centre(object)))
        .collect();
    let plan = scene_plan(&balls, 1, 8 << 20);
    let models = names.map(|name| (name, SPHERE.as_slice()));
    let mut world = scene_world(&plan, &models, 0.0);
    world.client_mut().link().tamper(|chunk| {
        let is_model = chunk.header.kind == ChunkKind::Model as u32;
        if is_model && chunk.header.object == BAD && chunk.header.code == 0 {
            // The first byte after the position of the first vertex.
            let words = &mut chunk.slots[MODEL_HEADER_SLOTS].words;
            words[3] |= 0xFF;
        }
    });
    let far = DVec3::new(0.13, 0.0, 1.0);
    for _ in 0..2000 {
        world.step_places(&[Some(far)]);
    }
    assert!(world.outputs().record.ready, "every model is known");
    assert_eq!(world.controller().faults().count(), 0);
    for object in 0..names.len() {
        assert_eq!(world.controller().proxy_of(0, object), None, "{object}");
    }
    // And it is touched where it is.
    let mut at = far;
    let above = |gap: f64| centre(BAD as usize) + DVec3::Z * (BALL + PROBE + gap);
    lead(&mut world, &mut at, above(0.02), 1e-3);
    lead(&mut world, &mut at, above(-1e-3), 1e-4);
    settle(&mut world, &[Some(at)]);
    assert!(world.force().length() > 0.5, "{}", world.force());
}

/// Leads the second probe to a place, at most `step` metres a tick; the first one rests at the
/// origin.
fn lead_second(world: &mut World, at: &mut DVec3, to: DVec3, step: f64) {
    while *at != to {
        let left = to - *at;
        let share = (step / left.length()).min(1.0);
        *at = if share < 1.0 { *at + left * share } else { to };
        world.step_places(&[Some(DVec3::ZERO), Some(*at)]);
    }
}

/// One hand rests in the corners of the boxes of large balls and touches nothing, the other one
/// goes to two small balls.
#[test]
fn a_hand_in_a_crowd_leaves_the_other_one_what_it_touches() {
    for crowd in [3usize, 5, 8] {
        let side = |bit: usize| if bit == 1 { 0.18 } else { -0.18 };
        let corner = |k: usize| DVec3::new(side(k & 1), side(k >> 1 & 1), side(k >> 2 & 1));
        let mut balls: Vec<_> = (0..crowd).map(|k| ("sphere", 0.4, corner(k))).collect();
        let centres = [1.0, 1.13].map(|x| DVec3::X * x);
        balls.extend(centres.map(|centre| ("sphere", 2.0 * BALL, centre)));
        let plan = scene_plan(&balls, 2, 16 << 20);
        let mut world = scene_world(&plan, &[("sphere", &SPHERE)], 0.0);
        assert_eq!(world.controller().active_objects().len(), 5, "places");
        let mut at = centres[0] + DVec3::Z * 0.2;
        settle(&mut world, &[Some(DVec3::ZERO), Some(at)]);
        for (k, centre) in centres.into_iter().enumerate() {
            let above = |gap: f64| centre + DVec3::Z * (BALL + PROBE + gap);
            lead_second(&mut world, &mut at, above(0.02), 1e-3);
            lead_second(&mut world, &mut at, above(-2e-3), 1e-4);
            let (mut touched, mut active) = (0, Vec::new());
            for tick in 0..500 {
                world.step_places(&[Some(DVec3::ZERO), Some(at)]);
                let contact = world.outputs().contacts[1];
                touched += u32::from(contact.is_some_and(|of| of.object as usize == crowd + k));
                let places = world.controller().active_objects().iter();
                let now: Vec<_> = places.map(|of| of.object()).collect();
                assert!(tick <= 200 || now == active, "{crowd}: {active:?}, {now:?}");
                active = now;
            }
            assert!(touched > 250, "{crowd}, ball {k}: {touched} ticks");
            assert!(world.outputs().contacts[0].is_none(), "{crowd}");
            lead_second(&mut world, &mut at, above(0.02), 1e-3);
        }
        assert_eq!(world.client().allocations(), 0);
        check(&world);
    }
}

/// The station goes away. A hand passes three plates whose base mesh finds no room beside the
/// caches, and comes back to a ball whose base mesh does.
#[test]
fn what_a_hand_has_left_gives_its_place_though_its_mesh_never_came() {
    let options = BuildOptions {
        base_faces: Some(4000),
        ..BuildOptions::default()
    };
    let plate = spm(generate(Shape::Plate, 20_000, 1), &options);
    let centre = |object: usize| DVec3::X * (0.5 * object as f64);
    let mut objects = vec![("sphere", 2.0 * BALL, centre(0))];
    objects.extend((1..5).map(|object| ("plate", 0.1, centre(object))));
    let plan = scene_plan(&objects, 1, 8 << 20);
    let models = [("sphere", SPHERE.as_slice()), ("plate", plate.as_slice())];
    let mut world = scene_world(&plan, &models, 0.0);
    assert_eq!(world.controller().active_objects().len(), 3, "places");
    let over = |object: usize, height: f64| centre(object) + DVec3::Z * height;
    let mut at = over(0, 0.4);
    while !world.outputs().record.ready {
        world.step_places(&[Some(at)]);
        assert!(world.tick() < 20_000, "the models arrive");
    }
    world.mute_station(true);
    for object in 2..5 {
        lead(&mut world, &mut at, over(object, 0.4), 1e-3);
        lead(&mut world, &mut at, over(object, 0.01), 1e-3);
        let active = world.controller().active_object(object);
        let waits = active.is_some_and(|of| !of.is_ready());
        assert!(waits, "object {object} waits for its mesh");
        lead(&mut world, &mut at, over(object, 0.4), 1e-3);
    }
    assert!(world.controller().active_object(0).is_none(), "no place");
    lead(&mut world, &mut at, over(0, 0.4), 1e-3);
    lead(&mut world, &mut at, over(0, BALL + 0.02), 1e-3);
    lead(&mut world, &mut at, over(0, BALL - 1e-3), 1e-4);
    for _ in 0..300 {
        world.step_places(&[Some(at)]);
    }
    let touched = world.outputs().contacts[0].map(|of| of.object);
    assert_eq!(touched, Some(0));
    assert_eq!(world.client().allocations(), 0);
    check(&world);
}
