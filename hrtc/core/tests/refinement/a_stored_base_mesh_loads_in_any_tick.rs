//! A stored base mesh loads, however little received data a tick has time for.

use crate::common::{World, scene_plan, scene_world, settle, spm};
use glam::DVec3;
use hrtc_core::governor::WorkCosts;
use protocol::RequestKind;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Radius of the balls, and from each to the next, metres.
const BALL: f64 = 0.05;
const SPACING: f64 = 0.2;
/// What a unit of received data takes, nanoseconds: a period. So a tick has the fewest that there
/// are.
const SLOW_NS: f64 = 1e6;
/// Motion of the probe in a tick, metres.
const STEP: f64 = 5e-4;
/// Ticks within which the base mesh is there: some times the slots that it has.
const MAX_TICKS: u64 = 5_000;

#[test]
fn a_stored_base_mesh_loads_where_ticks_have_the_least_time_for_data() {
    let model = spm(generate(Shape::Sphere, 2_000, 1), &BuildOptions::default());
    let centre = |object: usize| DVec3::X * (SPACING * object as f64);
    // One more than there are places: what is far is not active.
    let balls = [0, 1, 2, 3].map(|object| ("ball", 2.0 * BALL, centre(object)));
    let plan = scene_plan(&balls, 1, 4 << 20);
    let mut world = scene_world(&plan, &[("ball", &model)], 0.0);
    let above = |object: usize| centre(object) + DVec3::Z * (BALL + 0.005);
    settle(&mut world, &[Some(above(0))]);
    let is_ready = |world: &World| {
        let object = world.controller().active_object(1);
        object.is_some_and(|object| object.is_ready())
    };
    assert!(!is_ready(&world));
    let costs = WorkCosts {
        received: SLOW_NS,
        ..WorkCosts::REFERENCE
    };
    world.controller_mut().set_costs(costs);
    let (start, mut at) = (world.tick(), above(0));
    while !is_ready(&world) {
        at += (above(1) - at).clamp_length_max(STEP);
        world.step_places(&[Some(at)]);
        let mut asked = world.asked().iter();
        let is_asked_for = asked.any(|request| request.kind == RequestKind::Model as u32);
        assert!(!is_asked_for, "it is stored");
        assert!(world.tick() < start + MAX_TICKS, "it loads");
    }
    println!("ready after {} ticks", world.tick() - start);
}
