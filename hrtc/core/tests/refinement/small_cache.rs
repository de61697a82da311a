//! The cache's limit is kept at every size, and a size that is enough is enough.

use crate::common::{World, plan, spm, world};
use crate::ensure_within_capacity;
use hrtc_core::Fault;
use hrtc_core::cache::CacheError;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 60_000, 1);
    spm(mesh, &BuildOptions::default())
}

fn start(model: &[u8], bytes: usize) -> World {
    let mut plan = plan("");
    plan.cache_bytes = bytes;
    world(&plan, model, 8.0)
}

/// The bytes that the fault of a cache that is too small asks for; `None` when the model fits.
fn needed(model: &[u8], bytes: usize) -> Option<usize> {
    let mut world = start(model, bytes);
    for _ in 0..100 {
        world.step_led();
    }
    match world.controller().fault() {
        None => None,
        Some(Fault::Cache(error)) => {
            let CacheError::TooSmall { needed, .. } = error;
            let sentence = error.to_string();
            assert!(sentence.contains("cache.bytes"), "{sentence}");
            assert!(sentence.contains(&needed.to_string()), "{sentence}");
            assert_eq!(world.force().length(), 0.0);
            Some(needed)
        }
        Some(other) => panic!("{other}"),
    }
}

#[test]
fn too_small_is_said_with_the_size_that_is_enough() {
    let model = model();
    let needed_bytes = needed(&model, 20_000).expect("20 kB are too small");
    for bytes in [0, 1, 1000, needed_bytes / 2] {
        assert_eq!(needed(&model, bytes), Some(needed_bytes));
    }
    assert_eq!(
        needed(&model, needed_bytes),
        None,
        "what it asks for is enough"
    );
}

#[test]
fn every_size_keeps_its_limit_and_the_contact_comes_first() {
    let model = model();
    let least = needed(&model, 20_000).expect("20 kB are too small");
    for tenths in [10, 12, 15, 20, 30, 50] {
        let bytes = least * tenths / 10;
        let mut world = start(&model, bytes);
        for _ in 0..8000 {
            world.step_led();
            if world.tick().is_multiple_of(2000) {
                world.controller().cache().check();
            }
        }
        let s = world.summary();
        let asked_a_second = s.last.regions_subscribed as f64 / 8.0;
        println!(
            "{bytes} bytes ({tenths} tenths of the least): contact {}, full {:.1} %, evicted {}, epochs ended {}, answers sent again {}, regions a second {asked_a_second:.0}, received {}, high water {}",
            s.contact,
            100.0 * world.summary().full_share(),
            s.last.evicted,
            s.last.resubscribed,
            world.controller().resent(),
            s.last.vsps_received,
            world.controller().bytes_high_water(),
        );
        assert!(world.controller().fault().is_none());
        ensure_within_capacity(world.controller().cache());
        assert!(s.contact > 4000, "contact never needs the cache");
        assert!(s.last.evicted > 0, "the test's caches are small");
        // What was given up under an answer comes again; an epoch does not end for it.
        assert_eq!(s.last.resubscribed, 0, "the link is sound");
        let again = world.controller().resent() as f64 / s.last.regions_subscribed as f64;
        let again_most = if tenths >= 20 { 0.25 } else { 0.75 };
        assert!(again <= again_most, "it thrashes: {again}");
        // In smaller ones a coarser ring has less error: `memory_pressure_over_sizes`.
        let full_least = match tenths {
            ..12 => 0.0,
            12..15 => 0.5,
            15.. => 0.95,
        };
        assert!(world.summary().full_share() >= full_least);
    }
}
