//! Where the probe rests, the front is what the place and the dial make it, whatever was before: Theorem 4 of the
//! thesis at the controller, through loads, evictions, reloads and a turned dial.

mod common;

use common::{Pair, Touch, plan, spm, touches};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Where on the tour the probe rests, seconds.
const PLACES_S: [f64; 3] = [1.0, 2.5, 4.0];
/// Ticks within which a front at rest must be complete.
const MAX_TICKS: u64 = 40_000;

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 60_000, 1);
    spm(mesh, &BuildOptions::default())
}

fn pair(model: &[u8], tolerance_m: f64, cache_bytes: usize) -> Pair {
    let mut plan = plan("");
    plan.accuracy.tolerance_m = tolerance_m;
    plan.cache_bytes = cache_bytes;
    Pair::new(&plan, model.to_vec(), 8.0)
}

/// Compares two pairs that rest at the same place.
fn same_front(one: &Pair, other: &Pair, what: &str) {
    for pair in [one, other] {
        pair.controller.cache().check();
        assert!(pair.summary.last.contact, "{what}: it touches");
        assert!(pair.summary.last.contact_asked, "{what}: as was asked");
        assert_eq!(pair.controller.pressure_steps(), 0, "{what}: room enough");
    }
    let contacts = [one, other].map(|pair| pair.outputs.contact().expect("it touches").point);
    println!(
        "{what}: contacts {:.1e} units apart",
        contacts[0].distance(contacts[1])
    );
    let (a, b) = (one.front_faces(), other.front_faces());
    println!(
        "{what}: {} faces, {} differ",
        b.len(),
        a.symmetric_difference(&b).count()
    );
    assert_eq!(one.refined_front(), other.refined_front(), "{what}: splits");
    assert_eq!(a, b, "{what}: faces");
}

#[test]
fn a_tolerance_changed_in_mid_run_ends_as_a_fresh_start_with_it() {
    let model = model();
    let bytes = 32 << 20;
    let places = touches(&plan(""), &model, PLACES_S);
    for (place, turns) in places
        .into_iter()
        .zip([[0.0, 3e-4], [1e-3, 0.0], [1e-4, 5e-4]])
    {
        let mut turned = pair(&model, turns[0], bytes);
        turned.rest(place, MAX_TICKS);
        let before = turned.front_faces();
        for tolerance in [turns[1], turns[0], turns[1]] {
            turned.controller.set_tolerance(tolerance);
            turned.rest(place, MAX_TICKS);
            let mut fresh = pair(&model, tolerance, bytes);
            fresh.rest(place, MAX_TICKS);
            same_front(&turned, &fresh, &format!("{tolerance} m at {}", place.goal));
        }
        assert_ne!(before, turned.front_faces(), "the dial was turned");
    }
}

/// Where the probe is, and half a millimetre above the surface that holds it.
fn lifted(pair: &Pair) -> Touch {
    let goal = pair.controller.probe();
    let out = pair.force().normalize();
    Touch {
        above: goal + (pair.summary.last.depth_m + 5e-4) * out,
        goal,
    }
}

#[test]
fn loads_evictions_and_reloads_leave_the_mesh_of_a_fresh_load() {
    let model = model();
    for (ticks, bytes) in [(3000, 2 << 20), (5000, 3 << 20), (8000, 2 << 20)] {
        let mut moved = pair(&model, 0.0, bytes);
        for _ in 0..ticks {
            moved.step();
        }
        assert!(moved.summary.last.contact, "the probe is under the surface");
        let place = lifted(&moved);
        assert!(moved.summary.last.evicted > 1000, "the cache is small");
        let received = moved.summary.last.vsps_received;
        moved.rest(place, MAX_TICKS);
        assert!(
            moved.summary.last.vsps_received > received,
            "it comes again"
        );
        let mut fresh = pair(&model, 0.0, bytes);
        fresh.rest(place, MAX_TICKS);
        same_front(&moved, &fresh, &format!("{bytes} bytes at {}", place.goal));
        assert!(moved.controller.cache().bytes_high_water() <= bytes);
    }
}
