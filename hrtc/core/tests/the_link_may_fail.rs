//! Whatever the link and the station do, touching goes on, and when they are well again the mesh is what it
//! would have been.

mod common;

use common::{Faults, Pair, Random, plan, spm};
use glam::DVec3;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Trouble begins here, ticks; before it every run is the same.
const TROUBLE: u64 = 1500;
const PEACE: u64 = 4500;
const END: u64 = 6000;
/// Seconds of the tour at which the hand stops.
const REST_AT: f64 = 4.7;
/// Ticks that it may take until all is at rest at the place where every run ends: where a hand that slid over another
/// surface on its way came to rest may be another dip.
const MAX_TICKS: u64 = 20_000;

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 60_000, 1);
    spm(mesh, &BuildOptions::default())
}

/// Where the hand is led to in the end, world: inside the object.
fn intent(pair: &Pair) -> DVec3 {
    let tour = pair.controller.tour().expect("the tour is there");
    let last = tour.iter().rfind(|point| point.t <= REST_AT);
    let place = DVec3::from_array(last.expect("it has begun").position);
    let frame = pair.controller.frame().expect("the model is there");
    frame.to_world(place - frame.origin)
}

/// A run with some trouble between [`TROUBLE`] and [`PEACE`].
fn run(name: &str, model: &[u8], mut trouble: impl FnMut(&mut Pair)) -> Pair {
    let plan = plan("");
    let step_max = plan.safety.slew_n_per_s / plan.loop_.rate_hz;
    let mut pair = Pair::new(&plan, model.to_vec(), 6.0);
    pair.rest_at = REST_AT;
    while pair.tick < END {
        if (TROUBLE..PEACE).contains(&pair.tick) {
            trouble(&mut pair);
        }
        if pair.tick == PEACE {
            pair.cut = false;
            pair.faults = None;
            pair.controller.cache().check();
        }
        pair.step();
    }
    // Off, straight away from the middle, round through free space, and down where every run ends.
    let (left, inside) = (pair.controller.probe(), intent(&pair));
    let corners = [left, left * 3.0, inside * 3.0];
    for k in 0..1000 {
        let way = f64::from(k) / 500.0;
        let piece = way as usize;
        pair.hold(corners[piece].lerp(corners[piece + 1], way.fract()));
    }
    let touch = pair.touch(model, inside);
    pair.rest(touch, MAX_TICKS);
    pair.controller.cache().check();
    let s = &pair.summary;
    println!(
        "{name}: contact {} of {} ticks, full {:.2} %, step max {:.3} N, asked again {}, received {}",
        s.contact,
        s.ticks,
        100.0 * pair.full_share(),
        s.force_step_max,
        s.last.resubscribed,
        s.last.vsps_received,
    );
    assert!(pair.controller.fault().is_none());
    assert_eq!(pair.controller.refused().0, 0);
    assert!(s.force_step_max <= step_max * (1.0 + 1e-12));
    assert!(
        s.last.contact && s.last.contact_full,
        "{name}: {:?}",
        s.last
    );
    pair
}

/// The run without trouble is what the others end like.
fn ends_like_an_undisturbed_run(name: &str, trouble: impl FnMut(&mut Pair)) -> Pair {
    let model = model();
    let quiet = run("undisturbed", &model, |_| {});
    let pair = run(name, &model, trouble);
    let held = |pair: &Pair| pair.summary.contact;
    assert!(
        held(&pair) * 100 >= held(&quiet) * 90,
        "{name}: touching went on"
    );
    assert_eq!(quiet.summary.last.resubscribed, 0);
    assert!(pair.summary.last.resubscribed > 0, "{name}: it is counted");
    let wanted: Vec<u32> = quiet.refined_front();
    assert_eq!(pair.refined_front(), wanted, "{name}: the same front");
    let apart = (pair.force() - quiet.force()).length();
    assert!(apart < 0.02, "{name}: the same force, {apart} N apart");
    pair
}

#[test]
fn a_station_that_dies_while_touched_comes_back_as_another_one() {
    let model = model();
    let mut incarnation = 100;
    ends_like_an_undisturbed_run("restarts", |pair| {
        if pair.tick.is_multiple_of(700) {
            pair.cut = true;
        }
        if pair.tick % 700 == 300 {
            incarnation += 1;
            pair.restart_station(model.clone(), incarnation);
            pair.cut = false;
        }
    });
}

#[test]
fn a_link_that_is_silent_for_two_seconds() {
    ends_like_an_undisturbed_run("cut", |pair| pair.cut = pair.tick < TROUBLE + 2000);
}

#[test]
fn a_link_that_loses_doubles_and_reorders() {
    for seed in 1..=4 {
        let name = format!("bad link, seed {seed}");
        ends_like_an_undisturbed_run(&name, |pair| {
            pair.faults.get_or_insert(Faults {
                random: Random(seed),
                loss: 0.03,
                duplication: 0.05,
                overtaking: 0.1,
            });
        });
    }
}
