//! Ticks whose time for received data and refinement is over when they begin: what such a tick did
//! not do is not counted.

use crate::common::{World, scene_plan, scene_world, spm};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::governor::CostGroup;
use hrtc_core::{Stage, StageObserver, Timed};
use simulator::Drive;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Radius of the object, metres; where a probe is above it, and pressed into it.
const BALL: f64 = 0.05;
const ABOVE: f64 = BALL + 0.005;
const PRESSED: f64 = BALL - 0.002;
/// Ticks within which the base mesh is here, and ticks with a touch.
const MAX_TICKS: u64 = 1_000;
const TICKS: u64 = 2_000;
/// Work units of two items at the most: the last of a chunk and the first of the next.
const TWO_ITEMS: f64 = 16.0;

/// Over when a tick begins.
struct Over;

impl StageObserver for Over {
    fn ended(&mut self, _: Stage) {}

    fn is_over(&mut self, work: Timed) -> bool {
        work == Timed::Refinement
    }
}

fn at(radius: f64) -> [Option<Sample>; 1] {
    [Some(Sample::at(Pose::at(radius * DVec3::X)))]
}

/// A ball of so many faces whose base mesh is known, with the probe above it.
fn world(faces: u32) -> World {
    let ball = spm(generate(Shape::Sphere, faces, 1), &BuildOptions::default());
    let plan = scene_plan(&[("ball", 2.0 * BALL, DVec3::ZERO)], 1, 16 << 20);
    let mut world = scene_world(&plan, &[("ball", &ball)], 0.0);
    while !world.step_each(&at(ABOVE)).record.ready {
        assert!(world.tick() < MAX_TICKS, "the base mesh comes");
    }
    world
}

#[test]
fn received_data_is_counted_where_it_was_taken_in() {
    let mut world = world(20_000);
    let mut waited = 0;
    for tick in 0..TICKS {
        let quarters = world.controller().cache().next_quarters();
        world.advance(Drive::Samples(&at(PRESSED)), &mut Over);
        // Bounds of quarters come many at once.
        if world.controller().cache().next_quarters() != quarters {
            continue;
        }
        let governor = world.controller().governor();
        let costs = governor.costs();
        let inbox = governor.spent().by_group[CostGroup::Inbox as usize];
        let requests = world.outputs().outbox.requests().len() as f64 * costs.request;
        // One pair of a probe and an object, or none yet.
        let units = (inbox - requests - costs.prediction) / costs.received;
        assert!(units <= TWO_ITEMS + 1e-6, "tick {tick}: {units} units");
        waited += u64::from(world.client().inbox_len() > 0);
    }
    assert!(waited > TICKS / 10, "chunks waited in {waited} ticks only");
}
