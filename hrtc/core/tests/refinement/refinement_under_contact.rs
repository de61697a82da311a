//! Changes under the probe are geomorphs. At every tick mesh, tree and queues are valid; and
//! however contact, tolerance, link or cache interrupt geomorphs, the front ends as that of a fresh
//! start.

use crate::common::{
    Place, World, faulty, places_on_tour, plan, rest, scene_plan, scene_world, settle, spm, world,
};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::{Stage, StageObserver, Timed};
use simulator::{Drive, LinkModel, Random, refined_front};
use spm::{Handle, NONE};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

/// Ticks within which a front at rest must be complete.
const MAX_TICKS: u64 = 40_000;

fn model() -> Vec<u8> {
    spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default())
}

fn start(model: &[u8], tolerance_m: f64, geomorph: bool) -> World {
    let mut plan = plan("");
    plan.accuracy.tolerance_m = tolerance_m;
    plan.accuracy.geomorph = geomorph;
    world(&plan, model, 8.0)
}

fn touch(model: &[u8]) -> Place {
    let [touch] = places_on_tour(&plan(""), model, [1.0]);
    touch
}

/// Where the active faces' corners are, as bits.
fn corners(world: &World) -> Vec<[[u64; 3]; 3]> {
    let mesh = world.controller().cache().mesh();
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
fn interrupted_geomorphs_leave_valid_ticks_and_end_as_a_fresh_start() {
    let model = model();
    let place = touch(&model);
    let mut random = Random::new(5);
    let mut fresh = start(&model, 0.0, true);
    rest(&mut fresh, place, MAX_TICKS);
    let expected = corners(&fresh);
    for round in 0..3 {
        let mut tried = start(&model, 2e-3, true);
        rest(&mut tried, place, MAX_TICKS);
        let (mut in_flight, mut both_ways) = (0, [0, 0]);
        for tick in 0..3000 {
            match random.below(400) {
                0 => tried.controller_mut().set_tolerance(0.0),
                1 => tried.controller_mut().set_tolerance(2e-3),
                2 => tried.controller_mut().set_tolerance(3e-4),
                3 => {
                    let link = tried.client_mut().link();
                    let cut = round == 1 && !link.is_cut();
                    link.cut(cut);
                }
                4 if round == 2 => {
                    tried
                        .client_mut()
                        .link()
                        .disturb(faulty(0.05, 0.05, 0.05), random.bits());
                }
                _ => {}
            }
            let depth = random.unit() * 1e-4;
            let lifts = tick % 1000 > 900;
            let goal = if lifts { place.above } else { place.goal };
            let record = tried
                .step_at(goal + depth * (place.goal - place.above))
                .record;
            in_flight += u32::from(record.geomorphing > 0);
            for flight in tried.controller().cache().mesh().geomorphs() {
                both_ways[usize::from(flight.is_to_parent())] += 1;
            }
            // Boxes of the tree equal those of a fresh refit bit for bit, among the rest.
            tried.controller().cache().check();
            // And the contact's faces are active.
            if let Some(contact) = tried.outputs().contact() {
                let mesh = tried.controller().cache().mesh();
                for &face in contact.faces.iter().filter(|&&face| face != NONE) {
                    assert!(mesh.is_active(face));
                }
            }
        }
        println!(
            "round {round}: {in_flight} ticks with geomorphs, finished and reversed {both_ways:?}"
        );
        assert!(in_flight > 100 && both_ways[0] > 0 && both_ways[1] > 0);
        tried.client_mut().link().cut(false);
        tried.client_mut().link().set_model(LinkModel::default());
        tried.controller_mut().set_tolerance(0.0);
        rest(&mut tried, place, MAX_TICKS);
        tried.controller().cache().check();
        assert_eq!(
            refined_front(tried.controller().cache()),
            refined_front(fresh.controller().cache())
        );
        assert!(corners(&tried) == expected, "round {round}");
    }
}

#[test]
fn without_geomorphs_none_are_under_way() {
    let model = model();
    let place = touch(&model);
    let mut world = start(&model, 2e-3, false);
    rest(&mut world, place, MAX_TICKS);
    world.controller_mut().set_tolerance(0.0);
    for _ in 0..2000 {
        assert_eq!(world.step_at(place.goal).record.geomorphing, 0);
    }
    assert!(world.summary().last.contact_full);
}

#[test]
fn a_contact_in_a_geomorph_is_reported_as_unfinished() {
    let model = model();
    let place = touch(&model);
    let mut world = start(&model, 2e-3, true);
    rest(&mut world, place, MAX_TICKS);
    world.controller_mut().set_tolerance(0.0);
    let mut on_the_way = 0;
    for _ in 0..MAX_TICKS {
        let record = world.step_at(place.goal).record;
        let mesh = world.controller().cache().mesh();
        let faces = world
            .outputs()
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
        world.summary().last.contact_full && on_the_way > 0,
        "{on_the_way}"
    );
}

/// The time for refinement is over when it begins, in every tick.
#[derive(Default)]
struct Late {
    refines: bool,
}

impl StageObserver for Late {
    fn ended(&mut self, stage: Stage) {
        self.refines = stage == Stage::Inbox;
    }

    fn is_over(&mut self, work: Timed) -> bool {
        self.refines && work == Timed::Refinement
    }
}

#[test]
fn where_ticks_are_late_geomorphs_take_turns() {
    const SIDES: [DVec3; 4] = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X];
    let ball = spm(generate(Shape::Sphere, 20_000, 1), &BuildOptions::default());
    let mut plan = scene_plan(&[("ball", 0.1, DVec3::ZERO)], SIDES.len(), 16 << 20);
    plan.accuracy.tolerance_m = 2e-3;
    let mut world = scene_world(&plan, &[("ball", &ball)], 0.0);
    // First above the ball of 5 cm, then 3 mm in it.
    for radius in [0.06, 0.048] {
        settle(&mut world, &SIDES.map(|side| Some(radius * side)));
    }
    let pressed = SIDES.map(|side| Some(Sample::at(Pose::at(0.048 * side))));
    let under_way = |world: &World| -> Vec<(Handle, f64)> {
        let geomorphs = world.controller().cache().mesh().geomorphs().iter();
        let moving = geomorphs.filter(|of| !of.is_to_parent() && of.done() < 1.0);
        moving.map(|of| (of.vertex(), of.done())).collect()
    };
    world.controller_mut().set_tolerance(0.0);
    let start = world.tick();
    // Two pairs at the least.
    while under_way(&world).len() < 4 {
        world.step_each(&pressed);
        assert!(world.tick() < start + MAX_TICKS, "they begin");
    }
    let before = under_way(&world);
    let mut moved_after = |ticks: usize| {
        for _ in 0..ticks {
            world.advance(Drive::Samples(&pressed), &mut Late::default());
        }
        let now = under_way(&world);
        let stays = |of: &&(Handle, f64)| now.contains(of);
        before.len() - before.iter().filter(stays).count()
    };
    let of_one_tick = moved_after(1);
    assert!((1..=2).contains(&of_one_tick), "{of_one_tick} moved");
    assert_eq!(moved_after(before.len()), before.len());
}
