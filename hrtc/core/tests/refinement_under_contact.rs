//! What changes under the probe flies: at every tick mesh, tree and queues are whole, and however the contact, the dial,
//! the link or the cache break in on vertices in flight, the front is in the end that of a fresh start.

mod common;

use common::{Faults, Pair, Random, Touch, plan, spm, touches};
use spm::NONE;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Ticks within which a front at rest must be complete.
const MAX_TICKS: u64 = 40_000;

fn model() -> Vec<u8> {
    spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default())
}

fn pair(model: &[u8], tolerance_m: f64, geomorph: bool) -> Pair {
    let mut plan = plan("");
    plan.accuracy.tolerance_m = tolerance_m;
    plan.accuracy.geomorph = geomorph;
    Pair::new(&plan, model.to_vec(), 8.0)
}

fn touch(model: &[u8]) -> Touch {
    let [touch] = touches(&plan(""), model, [1.0]);
    touch
}

/// Where the active faces' corners are, as bits.
fn corners(pair: &Pair) -> Vec<[[u64; 3]; 3]> {
    let mesh = pair.controller.cache().mesh();
    let mut all = Vec::new();
    mesh.for_each_active_face(|face| {
        let mut bits = mesh.corners(face).map(|p| p.to_array().map(f64::to_bits));
        let least = (0..3).min_by_key(|&k| bits[k]).unwrap_or(0);
        bits.rotate_left(least);
        all.push(bits);
    });
    all.sort_unstable();
    all
}

#[test]
fn whatever_breaks_in_on_flights_every_tick_is_whole_and_the_end_is_that_of_a_fresh_start() {
    let model = model();
    let place = touch(&model);
    let mut random = Random(5);
    let mut fresh = pair(&model, 0.0, true);
    fresh.rest(place, MAX_TICKS);
    let expected = corners(&fresh);
    for round in 0..3 {
        let mut tried = pair(&model, 2e-3, true);
        tried.rest(place, MAX_TICKS);
        let (mut in_flight, mut both_ways) = (0, [0, 0]);
        for tick in 0..3000 {
            match random.below(400) {
                0 => tried.controller.set_tolerance(0.0),
                1 => tried.controller.set_tolerance(2e-3),
                2 => tried.controller.set_tolerance(3e-4),
                3 => tried.cut = round == 1 && !tried.cut,
                4 if round == 2 => {
                    tried.faults = Some(Faults {
                        random: random.clone(),
                        loss: 0.05,
                        duplication: 0.05,
                        overtaking: 0.05,
                    });
                }
                _ => {}
            }
            let depth = random.unit() * 1e-4;
            let lifts = tick % 1000 > 900;
            let goal = if lifts { place.above } else { place.goal };
            let record = tried.hold(goal + depth * (place.goal - place.above));
            in_flight += u32::from(record.geomorphing > 0);
            for flight in tried.controller.cache().mesh().geomorphs() {
                both_ways[usize::from(flight.is_to_parent())] += 1;
            }
            // Boxes of the tree equal those of a fresh refit bit for bit, among the rest.
            tried.controller.cache().check();
            // And whoever holds the probe is there.
            if let Some(contact) = tried.outputs.contact() {
                let mesh = tried.controller.cache().mesh();
                for &face in contact.faces.iter().filter(|&&face| face != NONE) {
                    assert!(mesh.is_active(face));
                }
            }
        }
        println!("round {round}: {in_flight} ticks in flight, home and to parents {both_ways:?}");
        assert!(in_flight > 100 && both_ways[0] > 0 && both_ways[1] > 0);
        tried.cut = false;
        tried.faults = None;
        tried.controller.set_tolerance(0.0);
        tried.rest(place, MAX_TICKS);
        tried.controller.cache().check();
        assert_eq!(tried.refined_front(), fresh.refined_front());
        assert!(corners(&tried) == expected, "round {round}");
    }
}

#[test]
fn without_geomorphs_nothing_flies() {
    let model = model();
    let place = touch(&model);
    let mut pair = pair(&model, 2e-3, false);
    pair.rest(place, MAX_TICKS);
    pair.controller.set_tolerance(0.0);
    for _ in 0..2000 {
        assert_eq!(pair.hold(place.goal).geomorphing, 0);
    }
    assert!(pair.summary.last.contact_full);
}

#[test]
fn a_morphed_contact_says_that_it_is_not_there_yet() {
    let model = model();
    let place = touch(&model);
    let mut pair = pair(&model, 2e-3, true);
    pair.rest(place, MAX_TICKS);
    pair.controller.set_tolerance(0.0);
    let mut on_the_way = 0;
    for _ in 0..MAX_TICKS {
        let record = pair.hold(place.goal);
        let mesh = pair.controller.cache().mesh();
        let faces = pair
            .outputs
            .contact()
            .map_or([NONE; 6], |contact| contact.faces);
        let count = faces.iter().take_while(|&&face| face != NONE).count();
        if mesh.any_geomorphing(&faces[..count]) {
            on_the_way += 1;
            assert!(
                record.certified_error_m > 0.0 && !record.contact_full && !record.contact_asked
            );
        }
        if record.contact_full {
            break;
        }
    }
    assert!(
        pair.summary.last.contact_full && on_the_way > 0,
        "{on_the_way}"
    );
}
