//! A hand on a tour of real and generated models: the contact is at full resolution, the cache
//! bounded.

use crate::common::{plan, real_model, spm, spm_of_file, world};
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
    assert!(s.cache_max <= plan.cache_bytes as u64);
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
