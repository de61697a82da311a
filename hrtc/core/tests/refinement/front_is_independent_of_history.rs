//! Where the probe rests, place and tolerance alone decide on the front (Theorem 4, thesis 3.3):
//! through loads, evictions, reloads and changes of the tolerance.

use crate::common::{Place, World, places_on_tour, plan, rest, spm, world};
use simulator::{front_faces, refined_front};
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

fn start(model: &[u8], tolerance_m: f64, cache_bytes: usize) -> World {
    let mut plan = plan("");
    plan.accuracy.tolerance_m = tolerance_m;
    plan.cache_bytes = cache_bytes;
    world(&plan, model, 8.0)
}

/// Compares two pairs that rest at the same place.
fn same_front(one: &World, other: &World, what: &str) {
    for world in [one, other] {
        world.controller().cache().check();
        assert!(world.summary().last.contact, "{what}: it touches");
        assert!(world.summary().last.contact_asked, "{what}: as was asked");
        assert_eq!(
            world.controller().pressure_steps(),
            0,
            "{what}: room enough"
        );
    }
    let contacts = [one, other].map(|world| world.outputs().contact().expect("it touches").point);
    println!(
        "{what}: contacts {:.1e} units apart",
        contacts[0].distance(contacts[1])
    );
    let (a, b) = (
        front_faces(one.controller()),
        front_faces(other.controller()),
    );
    println!(
        "{what}: {} faces, {} differ",
        b.len(),
        a.symmetric_difference(&b).count()
    );
    assert_eq!(
        refined_front(one.controller().cache()),
        refined_front(other.controller().cache()),
        "{what}: splits"
    );
    assert_eq!(a, b, "{what}: faces");
}

#[test]
fn a_tolerance_changed_in_mid_run_ends_as_a_fresh_start_with_it() {
    let model = model();
    let bytes = 32 << 20;
    let places = places_on_tour(&plan(""), &model, PLACES_S);
    for (place, turns) in places
        .into_iter()
        .zip([[0.0, 3e-4], [1e-3, 0.0], [1e-4, 5e-4]])
    {
        let mut turned = start(&model, turns[0], bytes);
        rest(&mut turned, place, MAX_TICKS);
        let before = front_faces(turned.controller());
        for tolerance in [turns[1], turns[0], turns[1]] {
            turned.controller_mut().set_tolerance(tolerance);
            rest(&mut turned, place, MAX_TICKS);
            let mut fresh = start(&model, tolerance, bytes);
            rest(&mut fresh, place, MAX_TICKS);
            same_front(&turned, &fresh, &format!("{tolerance} m at {}", place.goal));
        }
        assert_ne!(
            before,
            front_faces(turned.controller()),
            "the tolerance was changed"
        );
    }
}

/// Where the probe is, and half a millimetre above the surface that holds it.
fn lifted(world: &World) -> Place {
    let goal = world.controller().probe();
    let out = world.force().normalize();
    Place {
        above: goal + (world.summary().last.depth_m + 5e-4) * out,
        goal,
    }
}

#[test]
fn loads_evictions_and_reloads_leave_the_mesh_of_a_fresh_load() {
    let model = model();
    for (ticks, bytes) in [(3000, 2 << 20), (5000, 3 << 20), (8000, 2 << 20)] {
        let mut moved = start(&model, 0.0, bytes);
        for _ in 0..ticks {
            moved.step_led();
        }
        assert!(
            moved.summary().last.contact,
            "the probe is under the surface"
        );
        let place = lifted(&moved);
        assert!(moved.summary().last.evicted > 1000, "the cache is small");
        let received = moved.summary().last.vsps_received;
        rest(&mut moved, place, MAX_TICKS);
        assert!(
            moved.summary().last.vsps_received > received,
            "it comes again"
        );
        let mut fresh = start(&model, 0.0, bytes);
        rest(&mut fresh, place, MAX_TICKS);
        same_front(&moved, &fresh, &format!("{bytes} bytes at {}", place.goal));
        assert!(moved.controller().bytes_high_water() <= bytes);
    }
}
