//! Several controllers at one station, each at its own pace and distance: what one gets, and when,
//! does not depend on the others.

use crate::common::{plan, spm, station};
use hrtc_core::NoObserver;
use hrtc_core::streaming::subscriber::Identity;
use simulator::{Client, ClientOptions, Drive, LinkModel, STATION, Simulation, refined_front};
use spm_builder::BuildOptions;
use spm_builder::generate::{Shape, generate};

const TICKS: u64 = 8000;
/// When one of them stops.
const STOPPED: u64 = 3000;

/// A near one, one behind 100 ms and 0.25 Mbit/s, one that stops in between.
const NAMES: [&str; 3] = ["near", "far", "stopped"];

fn client(k: usize) -> Client {
    let mut plan = plan("");
    plan.cache_bytes = 4 << 20;
    let far = LinkModel {
        delay_ticks: 50,
        bytes_per_tick: 31.25,
        ..LinkModel::default()
    };
    let options = ClientOptions {
        identity: Identity {
            client: 7 + k as u64,
            incarnation: 1,
        },
        tour_s: 8.0,
        link: [LinkModel::default(), far, LinkModel::default()][k],
        station_is_far: k == 1,
        ..ClientOptions::default()
    };
    Client::new(&plan, options)
}

/// Hashes of all outputs so far, each tick, of each client of a run.
fn run(model: &[u8], which: &[usize]) -> (Vec<Vec<u64>>, Simulation<Vec<u8>>) {
    let mut world = Simulation::new(station(&plan(""), model, STATION), client(which[0]));
    for &k in &which[1..] {
        world = world.with(client(k));
    }
    let mut hashes = vec![Vec::new(); which.len()];
    for tick in 0..TICKS {
        let drives = which.iter().map(|&k| {
            let is_stopped = k == 2 && tick >= STOPPED;
            (!is_stopped).then_some(Drive::Hands)
        });
        let drives: Vec<_> = drives.collect();
        world.advance_each(&drives, &mut NoObserver);
        for (hashes, of) in hashes.iter_mut().zip(world.clients()) {
            hashes.push(of.controller().replay_hash());
        }
    }
    (hashes, world)
}

#[test]
fn none_is_slowed_by_another() {
    let model = spm(generate(Shape::Relief, 60_000, 1), &BuildOptions::default());
    let (together, world) = run(&model, &[2, 1, 0]);
    for (hashes, of) in together.iter().zip(world.clients()) {
        let k = (of.identity().client - 7) as usize;
        let s = of.summary();
        println!(
            "{}: full {:.2} % of {} contact ticks, received {}",
            NAMES[k],
            100.0 * s.full_share(),
            s.contact,
            s.last.vsps_received
        );
        assert!(s.contact > 0 && s.last.vsps_received > 100);
        let (alone, world) = run(&model, &[k]);
        let differs = alone[0].iter().zip(hashes).position(|(a, b)| a != b);
        assert_eq!(differs, None, "{}: the first tick that differs", NAMES[k]);
        let [together, alone] =
            [of, world.client()].map(|of| refined_front(of.controller().cache()));
        assert!(together == alone && (k == 1 || !together.is_empty()));
    }
}
