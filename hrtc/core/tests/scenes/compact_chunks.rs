//! Chunks that travel compact: the same to the bit, in a fraction of the bytes.

use crate::common::{plan, scene_plan, scene_world, station, world};
use glam::DVec3;
use protocol::{CHUNK_SLOTS, ChunkEncoder, ChunkHeader, ChunkKind, ChunkSlot};
use simulator::LinkModel;
use spm::SpmFile;
use std::cell::Cell;
use std::path::Path;
use std::rc::Rc;

/// Bytes of records and closures a VSP received, in slots and with headers.
const MAX_BYTES_A_VSP: f64 = 45.0;

/// A model of the golden runs.
fn golden(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../rt-tests/tests/golden");
    std::fs::read(folder.join(name)).expect("the model is part of the repository")
}

fn compact() -> LinkModel {
    LinkModel {
        is_compact: true,
        ..LinkModel::default()
    }
}

#[test]
fn every_tick_is_as_with_plain_chunks_over_several_epochs() {
    let (plan, model) = (plan(""), golden("relief.spm"));
    let run = |link: LinkModel| {
        let mut world = world(&plan, &model, 4.0);
        world.client_mut().link().set_model(link);
        let mut hashes = Vec::new();
        while world.tick() < 6000 {
            if world.tick().is_multiple_of(1500) {
                let incarnation = 200 + world.tick();
                world.start_station(station(&plan, &model, incarnation));
            }
            world.step_led();
            hashes.push(world.hash());
        }
        let summary = world.summary();
        assert!(summary.contact > 1000 && summary.last.resubscribed > 0);
        (hashes, world.client_mut().link().bytes_down())
    };
    let (plain, plain_bytes) = run(LinkModel::default());
    let (compact, compact_bytes) = run(compact());
    println!("{compact_bytes} bytes in place of {plain_bytes}");
    assert!(plain == compact, "a tick differs");
    assert!(3 * compact_bytes < plain_bytes);
}

#[test]
fn every_tick_is_as_with_plain_chunks_with_several_objects() {
    let models = [golden("torus.spm"), golden("wedge.spm")];
    let objects = [
        ("a.spm", 0.1, DVec3::ZERO),
        ("b.spm", 0.1, DVec3::new(0.15, 0.0, 0.0)),
        ("a.spm", 0.1, DVec3::new(0.0, 0.15, 0.0)),
    ];
    let plan = scene_plan(&objects, 1, 16 << 20);
    let run = |link: LinkModel| {
        let served = [("a.spm", &models[0][..]), ("b.spm", &models[1][..])];
        let mut world = scene_world(&plan, &served, 0.0);
        world.client_mut().link().set_model(link);
        let mut hashes = Vec::new();
        for tick in 0..4000 {
            let angle = f64::from(tick) * 2e-3;
            let (sin, cos) = angle.sin_cos();
            world.step_at(DVec3::new(0.07 + 0.08 * cos, 0.07 + 0.08 * sin, 0.0));
            hashes.push(world.hash());
        }
        assert!(world.summary().last.vsps_received > 0);
        hashes
    };
    assert!(
        run(LinkModel::default()) == run(compact()),
        "a tick differs"
    );
}

#[test]
fn records_and_closures_stay_below_45_bytes_a_vsp() {
    for name in ["relief.spm", "terrain.spm"] {
        let mut plan = plan("");
        plan.cache_bytes = 4 << 20;
        let model = golden(name);
        let sizes = SpmFile::open(model.clone())
            .expect("the SPM is good")
            .model_header()
            .sizes();
        let mut world = world(&plan, &model, 8.0);
        let bytes = Rc::new(Cell::new(0));
        let (sum, mut encoder) = (Rc::clone(&bytes), ChunkEncoder::default());
        world.client_mut().link().tamper(move |chunk| {
            let compact = encoder.encode(&chunk.header, &chunk.slots, Some(sizes));
            let slots = compact.map_or(CHUNK_SLOTS, |slots| slots.len());
            if chunk.header.kind == ChunkKind::Answers as u32 {
                let length = size_of::<ChunkHeader>() + slots * size_of::<ChunkSlot>();
                sum.set(sum.get() + length);
            }
        });
        while world.tick() < 8000 {
            world.step_led();
        }
        let vsps = world.summary().last.vsps_received;
        let each = bytes.get() as f64 / vsps as f64;
        println!("{name}: {each:.1} bytes a VSP, {vsps} VSPs");
        assert!(vsps > 1000 && each <= MAX_BYTES_A_VSP, "{name}: {each}");
    }
}
