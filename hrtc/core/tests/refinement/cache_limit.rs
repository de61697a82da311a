//! The cache's limit is lowered and raised while a probe touches.

use crate::common::{plan, scene_plan, scene_world, settle, spm, world};
use glam::DVec3;
use hrtc_core::{Controller, ControllerOptions, NoObserver, WrenchLimits};
use scene::{CacheChangePlan, ProbeShape, RefinementPlan, ScenePlan};
use simulator::{ClientOptions, Playback, Random};
use spm::SpmFile;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};
use std::sync::Arc;

/// Ticks within which a lowered limit holds: as many as sixteen steps of memory pressure take.
const OBEYS_TICKS: u64 = 1_000;

fn model() -> Vec<u8> {
    spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default())
}

fn plan_with(changes: &[(f64, usize)]) -> ScenePlan {
    let mut plan = plan("");
    let changes = changes.iter();
    plan.cache_changes = changes
        .map(|&(at_s, bytes)| CacheChangePlan { at_s, bytes })
        .collect::<Arc<[_]>>();
    plan
}

/// What a run was like while a limit held.
#[derive(Debug, Default, Clone, Copy)]
struct Held {
    /// Ticks until no more was in use than might be.
    ticks: u64,
    /// In use at its end, and faces of the front then.
    bytes: u64,
    faces: u32,
    contacts: u32,
    full: u32,
    coarser: u32,
}

/// Runs a tour of some ticks; what each limit was like, that of the start first. After every tick
/// no more is allocated, contacts have their bound, and what is over the limit only becomes less.
fn run(plan: &ScenePlan, model: &[u8], ticks: u64) -> Vec<Held> {
    let mut world = world(plan, model, 8.0);
    world.client_mut().record();
    let mut all = vec![Held::default()];
    let (mut limit, mut begun, mut before) = (plan.cache_bytes as u64, 0, u64::MAX);
    for tick in 0..ticks {
        let record = world.step_led().record;
        if record.cache_limit_bytes != limit {
            (limit, begun) = (record.cache_limit_bytes, tick);
            all.push(Held::default());
        }
        let held = all.last_mut().unwrap();
        if record.cache_bytes > limit {
            held.ticks = tick + 1 - begun;
            assert!(record.cache_bytes <= before, "tick {tick}: more is in use");
        }
        before = record.cache_bytes;
        held.bytes = record.cache_bytes;
        held.faces = record.active_faces;
        held.contacts += u32::from(record.contact);
        held.full += u32::from(record.contact_full);
        held.coarser += u32::from(record.finest_tolerance_m > 0.0);
        assert!(!record.contact || record.contact_bounded, "tick {tick}");
        assert!(record.vsplits + record.ecols <= 96, "tick {tick}");
        if tick % 250 == 0 {
            world.controller().cache().check();
        }
    }
    assert_eq!(world.client().allocations(), 0);
    assert!(world.controller().fault().is_none());
    let recording = world.client_mut().take_recording().unwrap();
    let identity = ClientOptions::default().identity;
    let options = ControllerOptions {
        limits: &[WrenchLimits::of_force(10.0)],
        tour_seconds: 8.0,
    };
    let mut playback = Playback::new(&recording, Controller::new(plan, identity, options));
    for tick in 0..ticks {
        assert_eq!(playback.step(&mut NoObserver), Some(true), "tick {tick}");
    }
    all
}

#[test]
fn a_lowered_limit_is_obeyed_with_the_contact_at_full_resolution_where_it_fits() {
    let model = model();
    let plan = plan_with(&[(2.5, 1 << 20), (5.0, 16 << 20)]);
    let all = run(&plan, &model, 8_000);
    println!("{all:#?}");
    let [first, low, last] = all[..] else {
        panic!("three limits");
    };
    assert!(first.bytes > 3 << 19, "there is something to unload");
    assert!(low.ticks > 0 && low.ticks < OBEYS_TICKS && low.bytes <= 1 << 20);
    let share = |held: Held| f64::from(held.full) / f64::from(held.contacts);
    assert!(low.contacts > 1_000 && share(low) >= 0.98 && share(low) >= share(first) - 0.01);
    assert!(
        last.bytes > 3 << 19 && share(last) >= 0.98,
        "room is used again"
    );
}

#[test]
fn where_the_contact_does_not_fit_it_is_coarser_until_the_limit_is_raised() {
    let model = model();
    let mut plan = plan_with(&[(2.5, 240 << 10), (5.0, 16 << 20)]);
    plan.probes[0].shape = ProbeShape::Sphere { radius_m: 0.008 };
    let all = run(&plan, &model, 8_000);
    println!("{all:#?}");
    let [first, low, last] = all[..] else {
        panic!("three limits");
    };
    assert_eq!(first.coarser, 0);
    assert!(low.ticks < OBEYS_TICKS && low.bytes <= 240 << 10);
    assert!(low.coarser > 1_000, "it is said");
    assert!(f64::from(last.full) >= 0.9 * f64::from(last.contacts));
}

#[test]
fn limits_that_change_at_random_do_no_harm() {
    let model = model();
    for seed in 1..=4 {
        let mut random = Random::new(seed);
        let mut changes = Vec::new();
        let mut at_s = 0.0;
        while at_s < 5.0 {
            at_s += 0.02 + 1.2 * random.unit();
            let bytes = (16 << 20) as f64 * 0.02_f64.powf(random.unit());
            changes.push((at_s, bytes as usize));
        }
        let plan = plan_with(&changes);
        let all = run(&plan, &model, 6_000);
        assert_eq!(
            all.len(),
            changes.iter().filter(|of| of.0 < 5.999).count() + 1
        );
        for (held, of) in all[1..].iter().zip(&changes) {
            println!("seed {seed}, {of:?}: {held:?}");
            assert!(held.ticks <= OBEYS_TICKS);
        }
    }
}

/// The block of the whole model goes though the smaller one has not come: it finds no room before.
#[test]
fn a_block_of_the_whole_model_obeys_the_limit_and_a_smaller_one_comes() {
    let model = spm(generate(Shape::Relief, 30_000, 1), &BuildOptions::default());
    let file = SpmFile::open(model.clone()).expect("the model is good");
    let base_faces = file.model_header().base_faces;
    for lod in [None, Some(u32::MAX)] {
        let mut plan = plan_with(&[(2.5, 1 << 20), (7.5, 16 << 20)]);
        plan.accuracy.refinement = RefinementPlan::Global { lod };
        let all = run(&plan, &model, 10_000);
        println!("{lod:?}: {all:#?}");
        let [first, low, last] = all[..] else {
            panic!("three limits");
        };
        assert!(first.bytes > 3 << 19, "there is something to unload");
        assert!(low.ticks > 0 && low.ticks < OBEYS_TICKS && low.bytes <= 1 << 20);
        assert!(low.faces > base_faces, "a smaller block has come");
        assert!(last.bytes > 3 << 19, "room is used again");
    }
}

/// What is only loaded ahead, around a probe that rests, goes before the contact comes coarser.
#[test]
fn at_rest_the_contact_keeps_its_resolution_while_its_neighbours_go() {
    let model = spm(generate(Shape::Sphere, 60_000, 1), &BuildOptions::default());
    let plan = scene_plan(&[("model.spm", 0.15, DVec3::ZERO)], 1, 16 << 20);
    // A hair inside, so that it is touched.
    let place = DVec3::new(0.3, -0.4, 0.8).normalize() * 0.0755;
    for share in [0.9, 0.8, 0.7] {
        let mut world = scene_world(&plan, &[("model.spm", &model[..])], 0.0);
        settle(&mut world, &[Some(place)]);
        let used = world.outputs().record.cache_bytes;
        let limit = (share * used as f64) as u64;
        world.controller_mut().set_cache_limit(limit as usize);
        let mut ticks = 0;
        for tick in 0..3 * OBEYS_TICKS {
            world.step_at(place);
            let record = &world.outputs().record;
            assert!(record.contact_full, "{share}: tick {tick}");
            assert_eq!(record.finest_tolerance_m, 0.0, "{share}: tick {tick}");
            if record.cache_bytes > limit {
                ticks = tick + 1;
            }
        }
        println!("{share} of {used} bytes: kept after {ticks} ticks");
        assert!(ticks > 0 && ticks < OBEYS_TICKS);
    }
}
