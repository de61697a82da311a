//! A client that speaks the protocol and abuses it: it asks for whole models, forges ids, measures
//! contacts where that is dear, and floods every topic.
//!
//! It does not take the ids of others: a client says itself who it is, and whoever may write to the
//! domain's shared memory may say so too.

use super::bench::Bench;
use super::touch::{Start, own_domain, start_controller, start_station_for};
use super::verdict::{Answer, Verdicts};
use crate::processes::surroundings::Surroundings;
use crate::processes::watched::{PATIENCE, Watched};
use bytemuck::Zeroable;
use protocol::{
    CREDIT_CHUNKS, ContactReport, Hello, REGIONS_PER_REQUEST, RegionAction, RegionAsk, Request,
    RequestKind, Role,
};
use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use spm::RegionId;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;
use transport::{Domain, MAX_QUEUED, TransportError};

/// Controllers beside the hostile client.
const OTHERS: usize = 3;
/// Seed of what the client says.
const SEED: u64 = 1;
/// Its own id.
const CLIENT: u64 = 0xBAD;
/// Messages of each kind that it sends before it looks again: what a queue holds.
const FLOOD: usize = MAX_QUEUED;
/// Time between two floods: that of the station between two looks.
const PAUSE: Duration = Duration::from_micros(200);
/// Floods after which it begins another epoch: the station has broken the last one by then.
const FLOODS_AN_EPOCH: u64 = 64;

/// The running client.
struct Hostile {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<Said, TransportError>>,
}

/// What it has said and heard.
#[derive(Debug, Default)]
struct Said {
    messages: u64,
    chunks: u64,
}

impl Hostile {
    fn start(domain: &Domain, scene_model: &str) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (domain, stopped) = (domain.clone(), Arc::clone(&stop));
        let name = Request::name_hash(scene_model);
        let thread = std::thread::spawn(move || abuse(&domain, name, &stopped));
        Self { stop, thread }
    }

    fn end(self) -> Result<Said, String> {
        self.stop.store(true, Ordering::Relaxed);
        let said = self.thread.join();
        let said = said.map_err(|_| "the hostile client panicked".to_string())?;
        said.map_err(|error| error.to_string())
    }
}

/// Floods until it is stopped.
fn abuse(domain: &Domain, name: u64, stop: &AtomicBool) -> Result<Said, TransportError> {
    let node = domain.node()?;
    let records = domain.records_service(&node, CLIENT)?;
    let records = domain.subscriber(&records, "receive records")?;
    let requests = domain.request_sender(&domain.subscribe_service(&node)?)?;
    let contacts = domain.publisher(&domain.pose_service(&node)?, "send contacts")?;
    let hello = domain.heartbeats(&node)?.outgoing;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let mut said = Said::default();
    let mut own = Request {
        client: CLIENT,
        incarnation: 1,
        name,
        credit: CREDIT_CHUNKS as u32,
        kind: RequestKind::Model as u32,
        ..Request::zeroed()
    };
    let wrong = |error: &dyn std::fmt::Debug| domain.error("flood the station", error);
    for flood in 1.. {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        while let Some(chunk) = records.receive().map_err(|e| wrong(&e))? {
            said.chunks += 1;
            let header = chunk.user_header();
            own.consumed += u64::from(header.epoch == own.epoch);
            own.model = header.model;
        }
        // First, while the queue has room.
        requests.send(&own).map_err(|e| wrong(&e))?;
        said.messages += 1;
        for _ in 0..FLOOD {
            let forged = forged(&own, &mut random);
            let contact = ContactReport {
                client: [CLIENT, forged.client][random.random_range(0..2)],
                tick: random.random(),
                // The centre of the model: the whole surface is about as near.
                ..ContactReport::zeroed()
            };
            let heard = Hello::new(Role::Controller, random.random(), forged.client);
            requests.send(&forged).map_err(|e| wrong(&e))?;
            contacts.send_copy(contact).map_err(|e| wrong(&e))?;
            hello.send_copy(heard).map_err(|e| wrong(&e))?;
            said.messages += 3;
        }
        if flood % FLOODS_AN_EPOCH == 0 {
            (own.sequence, own.consumed) = (0, 0);
            own.epoch += 1;
        } else {
            own.sequence += 1;
        }
        ask_for_all(&mut own, &mut random);
        std::thread::sleep(PAUSE);
    }
    Ok(said)
}

/// The next request of its own: the whole model, in many tolerances at once, again and again.
fn ask_for_all(own: &mut Request, random: &mut Xoshiro256PlusPlus) {
    own.kind = RequestKind::Regions as u32;
    own.count = REGIONS_PER_REQUEST as u32;
    let actions = [
        RegionAction::Subscribe,
        RegionAction::Resend,
        RegionAction::Release,
    ];
    for ask in &mut own.regions {
        *ask = RegionAsk {
            region: RegionId::WHOLE.0,
            tolerance_bits: (random.random::<f32>() * 1e-4).to_bits(),
            action: actions[random.random_range(0..actions.len())] as u32,
        };
    }
}

/// A request in the name of somebody who does not exist: for a model, for all of it, or noise.
fn forged(own: &Request, random: &mut Xoshiro256PlusPlus) -> Request {
    let mut forged = Request {
        client: random.random(),
        incarnation: random.random(),
        sequence: 0,
        consumed: 0,
        ..*own
    };
    if random.random_bool(0.5) {
        forged.kind = random.random_range(0..8);
        forged.object = random.random_range(0..3);
        forged.count = random.random_range(0..2 * REGIONS_PER_REQUEST as u32);
        forged.sequence = random.random_range(0..3);
        forged.credit = random.random();
    }
    forged
}

/// Three controllers in contact beside the hostile client: they keep full resolution, their epochs
/// and the station.
pub fn hostile(bench: &Bench, _kills: u64, verdicts: &mut Verdicts) -> Answer {
    let seconds = bench.add_large()?;
    let domain = own_domain()?;
    let mut station = start_station_for(bench, &domain, "large.toml")?;
    let mut others: Vec<Watched> = Vec::new();
    for count in 1..=OTHERS {
        bench.bar.set_message(format!("controller {count}"));
        let start = Start {
            scene: "large.toml",
            seconds,
            around: Surroundings {
                core: None,
                ..bench.around()
            },
            ..Start::usual(bench)
        };
        let (mut other, _) = start_controller(bench, &domain, start)?;
        other.wait_for("the first touch", bench.stop, Watched::is_touching)?;
        others.push(other);
    }
    bench.bar.set_message("a hostile client");
    let hostile = Hostile::start(&domain, "large.spm");
    let longest = PATIENCE + Duration::from_secs_f64(seconds);
    let ended: Vec<_> = others
        .iter_mut()
        .map(|other| other.wait_for_end(longest, bench.stop))
        .collect();
    let said = hostile.end()?;
    station.end()?;
    let mut wrong = Vec::new();
    let mut contact_ticks = 0;
    for ((other, ended), count) in others.iter_mut().zip(ended).zip(1..) {
        ended?;
        let finished = other.finished.take();
        let finished = finished.ok_or("a controller without a result")?;
        let result = &finished.result;
        contact_ticks += result.contact_ticks;
        verdicts.faults.missed_own_cpu += result.missed_own_cpu;
        let coarse = result.contact_ticks - result.contact_full_ticks;
        let lost = finished.stations.len() - 1;
        if coarse > 0 || result.contact_ticks == 0 || result.resubscribed > 0 || lost > 0 {
            wrong.push(format!(
                "controller {count}: {coarse} of {} ticks in contact not at full resolution, {} epochs ended, the station lost {lost} times",
                result.contact_ticks, result.resubscribed
            ));
        }
    }
    let abuse = format!(
        "{} messages of the hostile client (seed {SEED}), which got {} chunks of a model of {} faces",
        said.messages, said.chunks, bench.large_faces
    );
    if wrong.is_empty() {
        return Ok(format!(
            "{contact_ticks} ticks in contact, all full; {abuse}"
        ));
    }
    Err(format!("{}; {abuse}", wrong.join("; ")))
}
