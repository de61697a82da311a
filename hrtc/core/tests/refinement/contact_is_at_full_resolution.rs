//! A hand on a tour of real and generated models: the contact is at full resolution, the cache
//! bounded.

use crate::common::{plan, real_model, scene_plan, scene_world, settle, spm, spm_of_file, world};
use crate::ensure_within_capacity;
use glam::DVec3;
use scene::ProbeShape;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

fn tour(name: &str, bytes: Vec<u8>) {
    let plan = plan("");
    let mut world = world(&plan, &bytes, 10.0);
    for _ in 0..10_000 {
        world.step_led();
        if world.tick().is_multiple_of(2500) {
            world.controller().cache().check();
        }
    }
    let s = world.summary();
    println!(
        "{name}: contact {} of {} ticks, full {:.2} %, force max {:.2} N, step max {:.2} N, faces max {} mean {}, splits {} collapses {}, regions {} again {}, work max {} of {}, certified max {:.2e} m, measured max {:.2e} m, cache {} KiB, evicted {}, energy {:.2e} J",
        s.contact,
        s.ticks,
        100.0 * world.summary().full_share(),
        s.force_max,
        s.force_step_max,
        s.faces_max,
        s.faces_sum / s.ticks,
        s.vsplits,
        s.ecols,
        s.last.regions_subscribed,
        s.last.resubscribed,
        s.work_max,
        world.controller().work_budget(),
        s.certified_max,
        s.measured_max,
        s.cache_max / 1024,
        s.last.evicted,
        s.last.energy_j,
    );
    assert!(s.contact > 3000, "{name}: the tour touches");
    assert!(
        world.summary().full_share() >= 0.99,
        "{name}: {}",
        world.summary().full_share()
    );
    assert!(s.force_max <= 8.0 && s.force_max > 0.1);
    assert!(s.vsplits > 0 && s.ecols > 0);
    ensure_within_capacity(world.controller().cache());
    assert!(s.last.resubscribed <= 1, "nothing was lost");
}

#[test]
fn on_generated_relief() {
    let mesh = generate(Shape::Relief, 60_000, 1);
    tour("relief", spm(mesh, &BuildOptions::default()));
}

#[test]
fn on_real_models() {
    for name in ["stanford-bunny.obj", "dragon.obj", "terrain257.obj"] {
        if let Some(path) = real_model(name) {
            tour(name, spm_of_file(&path));
        }
    }
}

/// What it touches lies more cells away from its centre than a look goes.
#[test]
fn under_a_ball_at_rest_that_is_wider_than_cells() {
    let (ball, radius_m) = (0.025, 0.012);
    let model = spm(
        generate(Shape::Sphere, 100_000, 1),
        &BuildOptions::default(),
    );
    let mut plan = scene_plan(&[("model.spm", 2.0 * ball, DVec3::ZERO)], 1, 16 << 20);
    plan.probes[0].shape = ProbeShape::Sphere { radius_m };
    let mut world = scene_world(&plan, &[("model.spm", &model[..])], 0.0);
    // A millimetre inside.
    let place = DVec3::new(0.3, -0.4, 0.8).normalize() * (ball + radius_m - 0.001);
    settle(&mut world, &[Some(place)]);
    let controller = world.controller();
    let header = controller.header().expect("the model is there");
    let frame = controller.frame().expect("the model is there");
    let cells = radius_m / (header.grid.cell * frame.metres_per_unit);
    println!("a ball of {cells:.1} cells");
    assert!(cells > 3.0);
    for tick in 0..2000 {
        let record = world.step_at(place).record;
        assert!(record.contact && record.contact_full, "tick {tick}");
    }
}
