//! Whatever the link and the station do, contact goes on; when they work again, the mesh becomes
//! that of an undisturbed run.

use crate::common::{World, faulty, plan, rest, spm, station, surface_over, world};
use glam::DVec3;
use protocol::{ChunkKind, RequestKind};
use simulator::{LinkModel, refined_front};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Trouble begins here, ticks; before it every run is the same.
const TROUBLE: u64 = 1500;
const PEACE: u64 = 4500;
const END: u64 = 6000;
/// Seconds of the tour at which the hand stops.
const REST_AT: f64 = 4.7;
/// Ticks within which the front is complete at the place where every run ends. The hand itself may
/// rest in another dip, since it slid over another surface.
const MAX_TICKS: u64 = 20_000;

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 60_000, 1);
    spm(mesh, &BuildOptions::default())
}

/// Where the hand is led to in the end, world: inside the object.
fn intent(world: &World) -> DVec3 {
    let tour = world.controller().tour().expect("the tour is there");
    let last = tour.iter().rfind(|point| point.t <= REST_AT);
    let place = DVec3::from_array(last.expect("it has begun").position);
    let frame = world.controller().frame().expect("the model is there");
    frame.to_world(place - frame.origin)
}

/// A run with some trouble between [`TROUBLE`] and [`PEACE`].
fn run(name: &str, model: &[u8], mut trouble: impl FnMut(&mut World)) -> World {
    let plan = plan("");
    let step_max = plan.safety.slew_n_per_s / plan.loop_.rate_hz;
    let mut world = world(&plan, model, 6.0);
    world.client_mut().hand(0).stop_at(REST_AT);
    while world.tick() < END {
        if (TROUBLE..PEACE).contains(&world.tick()) {
            trouble(&mut world);
        }
        if world.tick() == PEACE {
            world.client_mut().link().cut(false);
            world.client_mut().link().set_model(LinkModel::default());
            world.controller().cache().check();
        }
        world.step_led();
    }
    // Off, straight away from the middle, round through free space, and down to the common end.
    let (left, inside) = (world.controller().probe(), intent(&world));
    let corners = [left, left * 3.0, inside * 3.0];
    for k in 0..1000 {
        let share = f64::from(k) / 500.0;
        let piece = share as usize;
        world.step_at(corners[piece].lerp(corners[piece + 1], share.fract()));
    }
    let touch = surface_over(&world, model, inside);
    rest(&mut world, touch, MAX_TICKS);
    world.controller().cache().check();
    let s = world.summary();
    println!(
        "{name}: contact {} of {} ticks, full {:.2} %, step max {:.3} N, asked again {}, received {}",
        s.contact,
        s.ticks,
        100.0 * world.summary().full_share(),
        s.force_step_max,
        s.last.resubscribed,
        s.last.vsps_received,
    );
    assert!(world.controller().fault().is_none());
    assert_eq!(world.controller().refused().0, 0);
    assert!(s.force_step_max <= step_max * (1.0 + 1e-12));
    assert!(
        s.last.contact && s.last.contact_full,
        "{name}: {:?}",
        s.last
    );
    world
}

/// The run without trouble is what the others end like.
fn ends_like_an_undisturbed_run(name: &str, trouble: impl FnMut(&mut World)) -> World {
    let model = model();
    let quiet = run("undisturbed", &model, |_| {});
    let world = run(name, &model, trouble);
    let contacts = |world: &World| world.summary().contact;
    assert!(
        contacts(&world) * 100 >= contacts(&quiet) * 90,
        "{name}: contact went on"
    );
    assert_eq!(quiet.summary().last.resubscribed, 0);
    assert!(
        world.summary().last.resubscribed > 0,
        "{name}: it is counted"
    );
    let wanted: Vec<u32> = refined_front(quiet.controller().cache());
    assert_eq!(
        refined_front(world.controller().cache()),
        wanted,
        "{name}: the same front"
    );
    let apart = (world.force() - quiet.force()).length();
    assert!(apart < 0.02, "{name}: the same force, {apart} N apart");
    world
}

#[test]
fn a_station_that_restarts_during_contact() {
    let (plan, model) = (plan(""), model());
    let mut incarnation = 100;
    ends_like_an_undisturbed_run("restarts", |world| {
        if world.tick().is_multiple_of(700) {
            world.client_mut().link().cut(true);
        }
        if world.tick() % 700 == 300 {
            incarnation += 1;
            world.start_station(station(&plan, &model, incarnation));
            world.client_mut().link().cut(false);
        }
    });
}

#[test]
fn a_link_that_is_silent_for_two_seconds() {
    ends_like_an_undisturbed_run("cut", |world| {
        let is_cut = world.tick() < TROUBLE + 2000;
        world.client_mut().link().cut(is_cut);
    });
}

#[test]
fn a_link_that_loses_doubles_and_reorders() {
    for seed in 1..=4 {
        let name = format!("bad link, seed {seed}");
        ends_like_an_undisturbed_run(&name, |world| {
            if world.tick() == TROUBLE {
                world
                    .client_mut()
                    .link()
                    .disturb(faulty(0.03, 0.05, 0.1), seed);
            }
        });
    }
}

#[test]
fn a_bad_link_of_compact_chunks() {
    for seed in 1..=2 {
        let name = format!("bad link, compact, seed {seed}");
        ends_like_an_undisturbed_run(&name, |world| {
            if world.tick() == TROUBLE {
                let bad = LinkModel {
                    is_compact: true,
                    damage: 0.02,
                    ..faulty(0.02, 0.05, 0.05)
                };
                world.client_mut().link().disturb(bad, seed);
            }
        });
    }
}

/// A base mesh of forty chunks, of which every tenth is lost: so many never come in a row.
#[test]
fn a_base_mesh_goes_on_from_where_a_loss_ended_it() {
    const EVERY: u64 = 10;
    let options = BuildOptions {
        base_faces: Some(4000),
        ..BuildOptions::default()
    };
    let model = spm(generate(Shape::Relief, 20_000, 1), &options);
    let mut world = world(&plan(""), &model, 6.0);
    let mut sent = 0_u64;
    world.client_mut().link().tamper(move |chunk| {
        if chunk.header.kind == ChunkKind::Model as u32 {
            sent += 1;
            // It looks like another client's.
            chunk.header.client ^= u64::from(sent.is_multiple_of(EVERY));
        }
    });
    let (mut asks, mut here) = (0, 0);
    while !world.outputs().record.ready {
        assert!(world.tick() < MAX_TICKS, "the base mesh arrives");
        world.step_at(DVec3::ONE);
        let kind = RequestKind::Model as u32;
        for request in world.asked().iter().filter(|of| of.kind == kind) {
            assert!(request.count >= here, "what came stays");
            (asks, here) = (asks + 1, request.count);
        }
    }
    println!(
        "{asks} requests in {} ticks, the last from slot {here}",
        world.tick()
    );
    assert!(asks > 3 && here > 0, "{asks} {here}");
    world.controller().cache().check();
}
