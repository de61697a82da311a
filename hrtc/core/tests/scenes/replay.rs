//! The inputs of a run give its outputs again, bit by bit, tick by tick.

use crate::common::{faulty, plan, spm, station, world};
use hrtc_core::{Controller, ControllerOptions, NoObserver, TickInputs, WrenchLimits};
use scene::ScenePlan;
use simulator::{ClientOptions, InputRecording, Playback, Summary};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const TICKS: usize = 3000;
const RESTART: usize = 2000;
const OPTIONS: ControllerOptions<'_> = ControllerOptions {
    limits: &[WrenchLimits::of_force(10.0)],
    tour_seconds: 5.0,
};

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 30_000, 1);
    spm(mesh, &BuildOptions::default())
}

/// A run with everything that may differ: a small cache, a bad link, and a station that restarts.
fn run(plan: &ScenePlan, model: &[u8], faults: u64) -> (Summary, InputRecording) {
    let mut world = world(plan, model, 5.0);
    world.client_mut().record();
    for tick in 0..TICKS {
        if tick == 500 {
            let model = faulty(0.02, 0.05, 0.05);
            world.client_mut().link().disturb(model, faults);
        }
        if tick == RESTART {
            world.start_station(station(plan, model, 101));
        }
        world.step_led();
    }
    let recording = world.client_mut().take_recording();
    (world.summary().clone(), recording.expect("it was recorded"))
}

fn hashes(recording: &InputRecording) -> Vec<u64> {
    recording.hashes().collect()
}

#[test]
fn the_recorded_inputs_give_every_tick_again() {
    let model = model();
    let mut plan = plan("");
    plan.cache_bytes = 2 << 20;
    let (summary, recording) = run(&plan, &model, 1);
    assert!(summary.contact > 500, "the run touches");
    assert!(summary.last.resubscribed > 1, "the link lost something");

    let identity = ClientOptions::default().identity;
    let controller = Controller::new(&plan, identity, OPTIONS);
    // The chunks are cut at another place than in the run: a ring's wrap must not matter.
    let mut playback = Playback::new(&recording, controller).wrapped();
    for tick in 0..TICKS {
        assert_eq!(playback.step(&mut NoObserver), Some(true), "tick {tick}");
    }
    assert_eq!(playback.step(&mut NoObserver), None);
}

#[test]
fn the_hash_covers_the_requests() {
    let plan = plan("");
    let of_client = |client: u64| {
        let mut identity = ClientOptions::default().identity;
        identity.client = client;
        let mut controller = Controller::new(&plan, identity, OPTIONS);
        let mut outputs = controller.new_outputs();
        let inputs = TickInputs {
            tick: 0,
            samples: &[None],
            station: 100,
            chunks: [&[], &[]],
            stopping: false,
        };
        controller.tick(&inputs, &mut outputs, &mut NoObserver);
        assert_eq!(outputs.outbox.requests().len(), 1, "it asks for its model");
        controller.replay_hash()
    };
    // Nothing else differs.
    assert_ne!(of_client(1), of_client(2));
    assert_eq!(of_client(1), of_client(1));
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_does_not() {
    let model = model();
    let plan = plan("");
    let (summary, first) = run(&plan, &model, 1);
    let (again, second) = run(&plan, &model, 1);
    assert_eq!(hashes(&first), hashes(&second));
    assert_eq!(summary, again);
    let (_, other) = run(&plan, &model, 2);
    assert_ne!(hashes(&first).last(), hashes(&other).last());

    let mut tour = plan.clone();
    let scene::TrajectoryPlan::Tour { seed, .. } = &mut tour.probes[0].trajectory else {
        panic!("the test's scene has a tour");
    };
    *seed += 1;
    let (_, other) = run(&tour, &model, 1);
    assert_ne!(hashes(&first).last(), hashes(&other).last());
}
