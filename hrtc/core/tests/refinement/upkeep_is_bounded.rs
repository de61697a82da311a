//! Closures that are given up, and places that change hands, cost bounded and counted work in every
//! tick, whatever their size; the end is the same.

use crate::common::{World, places_on_tour, plan, rest, scene_plan, scene_world, spm, world};
use glam::DVec3;
use hrtc_core::record::CoreRecord;
use protocol::ChunkKind;
use scene::RefinementPlan;
use simulator::refined_front;
use spm::SpmFile;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Entries gone through for a work unit.
const ENTRIES_PER_UNIT: u32 = 4;

fn closure_entries(world: &World) -> u32 {
    let regions = &world.controller().cache().regions;
    let entries = regions.indices().map(|k| regions.at(k).closure.length());
    entries.sum()
}

fn ensure_within_budget(world: &World, record: &CoreRecord) {
    let budget = world.controller().work_budget();
    let (units, tick) = (record.work_units, world.tick());
    assert!(units <= budget, "tick {tick}: {units} of {budget}");
}

#[test]
fn a_lost_chunk_of_a_whole_model_is_given_up_over_ticks_and_ends_in_the_same_front() {
    let model = spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default());
    let vsps = SpmFile::open(model.clone()).unwrap().model_header().vsps;
    let [touch] = places_on_tour(&plan(""), &model, [1.0]);
    let mut plan = plan("");
    plan.accuracy.refinement = RefinementPlan::Global { lod: None };
    plan.cache_bytes = 64 << 20;
    let mut world = world(&plan, &model, 8.0);
    while world.controller().cache().loaded() < vsps / 2 {
        let record = world.step_at(touch.above).record;
        ensure_within_budget(&world, &record);
    }
    let entries = closure_entries(&world);
    assert!(entries > 16_000, "{entries} entries are given up");
    let mut is_lost = false;
    world.client_mut().link().tamper(move |chunk| {
        if chunk.header.kind == ChunkKind::Answers as u32 && !is_lost {
            is_lost = true;
            // As if the one before had not come.
            chunk.header.sequence += 1;
        }
    });
    while world.outputs().record.resubscribed == 0 {
        world.step_at(touch.above);
    }
    let (mut units, mut ticks) = (world.outputs().record.work_units, 1);
    while closure_entries(&world) >= entries {
        let record = world.step_at(touch.above).record;
        ensure_within_budget(&world, &record);
        units += record.work_units;
        ticks += 1;
        assert!(ticks < 200, "it is given up");
    }
    println!("{entries} entries given up in {ticks} ticks, {units} work units");
    assert!(
        units >= entries / ENTRIES_PER_UNIT,
        "{units} units are counted for {entries} entries"
    );
    rest(&mut world, touch, 40_000);
    let controller = world.controller();
    controller.cache().check();
    assert_eq!(
        refined_front(controller.cache()),
        (0..vsps).collect::<Vec<u32>>()
    );
}

#[test]
fn a_place_that_changes_hands_is_emptied_in_counted_parts() {
    const NAMES: [&str; 4] = ["a.spm", "b.spm", "c.spm", "d.spm"];
    let model = spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default());
    let vsps = SpmFile::open(model.clone()).unwrap().model_header().vsps;
    let centre = |object: usize| DVec3::X * (0.3 * object as f64);
    let balls: Vec<_> = (0..4).map(|k| (NAMES[k], 0.1, centre(k))).collect();
    let mut plan = scene_plan(&balls, 1, 12 << 20);
    plan.accuracy.refinement = RefinementPlan::Global { lod: None };
    let mut world = scene_world(&plan, &NAMES.map(|name| (name, &model[..])), 0.0);
    let places = world.controller().active_objects().len();
    assert!(places < NAMES.len(), "places change hands");
    let state = |world: &World| {
        let objects = world.controller().active_objects().iter();
        let state = objects.map(|of| (of.object(), of.cache().loaded()));
        state.collect::<Vec<_>>()
    };
    let (mut emptied, mut at) = (0, centre(0));
    for step in 0..12 {
        let goal = centre(step % 4) + DVec3::Z * 0.055;
        let mut before = state(&world);
        // Records given up in places that are not ready for another object, and work since.
        let (mut given_up, mut units) = (0, 0);
        for _ in 0..3000 {
            at += (goal - at).clamp_length_max(1e-3);
            let record = world.step_at(at).record;
            ensure_within_budget(&world, &record);
            let now = state(&world);
            for (old, new) in before.iter().zip(&now) {
                if old.0.is_some() && old.0 != new.0 {
                    given_up += old.1;
                }
            }
            units += record.work_units;
            if now.iter().all(|(object, _)| object.is_some()) {
                assert!(
                    units >= given_up / ENTRIES_PER_UNIT,
                    "{units} units are counted for {given_up} records"
                );
                emptied += u32::from(given_up > vsps / 2);
                (given_up, units) = (0, 0);
            }
            before = now;
        }
    }
    println!("{emptied} places with a whole model changed hands");
    assert!(emptied > 4, "{emptied}");
}
