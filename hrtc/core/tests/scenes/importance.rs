//! What is short goes to the more important of two objects.

use crate::common::{World, scene_plan, scene_world, spm};
use glam::DVec3;
use hrtc_core::governor::{CostGroup, WorkCosts};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const SIZE_M: f64 = 0.1;
const RADIUS_M: f64 = 0.001;
const PRESS_M: f64 = 0.001;
/// Ticks of the approach, and of the slide after it.
const APPROACH: u64 = 600;
const SLIDE: u64 = 3_000;

/// Two equal balls, each touched by a probe alike, in little cache and on a slow machine.
fn start(importances: [f64; 2], cache_bytes: usize, slow: f64) -> World {
    let centre = |k: usize| DVec3::X * (0.2 * k as f64);
    let balls = [0, 1].map(|k| ("sphere", SIZE_M, centre(k)));
    let mut plan = scene_plan(&balls, 2, cache_bytes);
    for (object, importance) in plan.objects.iter_mut().zip(importances) {
        object.importance = importance;
    }
    let sphere = spm(
        generate(Shape::Sphere, 200_000, 1),
        &BuildOptions::default(),
    );
    let mut world = scene_world(&plan, &[("sphere", &sphere)], 0.0);
    let costs = WorkCosts::REFERENCE.scaled([slow; CostGroup::ALL.len()]);
    world.controller_mut().set_costs(costs);
    world
}

/// What the contact of each probe was like: ticks at full resolution, and the mean of the certified
/// error in metres.
fn touch(world: &mut World) -> [(u32, f64); 2] {
    let (mut sums, mut contacts) = ([(0, 0.0); 2], [0u32; 2]);
    for tick in 0..APPROACH + SLIDE {
        let gap = 0.02 * (1.0 - tick as f64 / APPROACH as f64).max(0.0);
        let angle = 2.5e-3 * tick.saturating_sub(APPROACH) as f64;
        let out = DVec3::new(angle.sin(), 0.0, angle.cos());
        let reach = 0.5 * SIZE_M + RADIUS_M - PRESS_M + gap;
        let places = [0, 1].map(|k| Some(DVec3::X * (0.2 * k as f64) + reach * out));
        let record = world.step_places(&places).record;
        if tick < APPROACH {
            continue;
        }
        for ((sum, contacts), of) in sums.iter_mut().zip(&mut contacts).zip(&record.probes) {
            if of.contact {
                assert!(of.contact_bounded);
                *contacts += 1;
                sum.0 += u32::from(of.contact_full);
                sum.1 += of.certified_error_m;
            }
        }
    }
    for (sum, &contacts) in sums.iter_mut().zip(&contacts) {
        assert!(2 * u64::from(contacts) > SLIDE, "{contacts} of {SLIDE}");
        sum.1 /= f64::from(contacts);
    }
    sums
}

#[test]
fn in_a_short_tick_the_more_important_of_two_objects_is_finer() {
    for importances in [[1.0, 4.0], [4.0, 1.0]] {
        let of = touch(&mut start(importances, 16 << 20, 12.0));
        println!("{importances:?}: {of:?}");
        let more = usize::from(importances[1] > 1.0);
        assert!(of[more].1 < 0.75 * of[1 - more].1);
    }
}

#[test]
fn the_share_of_a_short_cache_follows_importance() {
    for importances in [[1.0, 4.0], [4.0, 1.0]] {
        let mut world = start(importances, 3 << 20, 1.0);
        let of = touch(&mut world);
        println!("{importances:?}: {of:?}");
        let objects = world.controller().active_objects();
        let bytes = [0, 1].map(|k| objects[k].cache().bytes());
        let more = usize::from(importances[1] > 1.0);
        assert!(2 * bytes[more] > 3 * bytes[1 - more], "{bytes:?}");
        assert!(of[more].0 > of[1 - more].0 + 300);
        assert!(
            world.controller().fault().is_none(),
            "the least part holds a base mesh"
        );
    }
}

#[test]
fn equal_importances_change_nothing() {
    let hash = |importance: f64| {
        let mut world = start([importance; 2], 2 << 20, 8.0);
        touch(&mut world);
        world.hash()
    };
    let one = hash(1.0);
    assert!([0.1, 3.0, 10.0].into_iter().all(|other| hash(other) == one));
}
