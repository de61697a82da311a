//! The inputs of a run give its outputs again, bit by bit, tick by tick.

mod common;

use common::{Faults, Pair, Random, identity, plan, spm};
use hrtc_core::{Controller, NoObserver, TickInputs, TickOutputs};
use scene::ScenePlan;
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const TICKS: usize = 3000;
const RESTART: usize = 2000;

fn model() -> Vec<u8> {
    let mesh = generate(Shape::Relief, 30_000, 1);
    spm(mesh, &BuildOptions::default())
}

/// A run with everything that may differ: a small cache, a bad link, and a station that restarts.
fn run(plan: &ScenePlan, model: &[u8], faults: u64) -> Pair {
    let mut pair = Pair::new(plan, model.to_vec(), 5.0);
    for tick in 0..TICKS {
        if tick == 500 {
            pair.faults = Some(Faults {
                random: Random(faults),
                loss: 0.02,
                duplication: 0.05,
                overtaking: 0.05,
            });
        }
        if tick == RESTART {
            pair.restart_station(model.to_vec(), 101);
        }
        pair.step();
    }
    pair
}

fn hashes(pair: &Pair) -> Vec<u64> {
    pair.log.iter().map(|&(.., hash)| hash).collect()
}

#[test]
fn the_logged_inputs_give_every_tick_again() {
    let model = model();
    let mut plan = plan("");
    plan.cache_bytes = 2 << 20;
    let pair = run(&plan, &model, 1);
    assert!(pair.summary.contact > 500, "the run touches");
    assert!(
        pair.summary.last.resubscribed > 1,
        "the link lost something"
    );

    let mut controller = Controller::new(&plan, identity(), 10.0, 5.0);
    let mut outputs = TickOutputs::new(1);
    let mut done = 0;
    for (tick, &(sample, station, arrived, hash)) in pair.log.iter().enumerate() {
        let samples = [sample];
        // Cut in two at another place than the run had it: a ring's wrap must not matter.
        let (first, second) = pair.arrivals[done..arrived].split_at((arrived - done) / 2);
        let inputs = TickInputs {
            tick: tick as u64,
            samples: &samples,
            station,
            chunks: [first, second],
            stopping: false,
        };
        controller.tick(&inputs, &mut outputs, &mut NoObserver);
        done += outputs.chunks_consumed;
        assert_eq!(controller.replay_hash(), hash, "tick {tick}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_does_not() {
    let model = model();
    let plan = plan("");
    let first = run(&plan, &model, 1);
    let second = run(&plan, &model, 1);
    assert_eq!(hashes(&first), hashes(&second));
    assert_eq!(first.summary, second.summary);
    let other = run(&plan, &model, 2);
    assert_ne!(hashes(&first).last(), hashes(&other).last());

    let mut tour = plan.clone();
    let scene::TrajectoryPlan::Tour { seed, .. } = &mut tour.probes[0].trajectory else {
        panic!("the test's scene has a tour");
    };
    *seed += 1;
    let other = run(&tour, &model, 1);
    assert_ne!(hashes(&first).last(), hashes(&other).last());
}
