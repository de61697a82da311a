//! Messages to the station: requests and contact reports of any bytes, between sensible ones.

use super::common::build;
use super::memory::most_bytes;
use super::mutate::Mutator;
use super::{check_sentence, keeping, rounds_and_seed, turn};
use bytemuck::Zeroable;
use protocol::MAX_CLIENTS;
use protocol::{ContactReport, Request};
use spm::{RegionId, SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use station_core::station::{Message, ServedModel, ServedObject, Station};

/// What a client said and heard in its epoch.
#[derive(Clone, Copy, Default)]
struct Spoken {
    incarnation: u64,
    sequence: u64,
    received: u64,
}

impl Spoken {
    fn next(&mut self, at: usize) -> Request {
        let mut request = Request::zeroed();
        request.client = at as u64 + 1;
        request.incarnation = self.incarnation;
        request.sequence = self.sequence;
        request.consumed = self.received;
        request.credit = protocol::CREDIT_CHUNKS as u32;
        request.name = Request::name_hash("torus");
        self.sequence += 1;
        request
    }
}

#[test]
fn the_station_answers_or_ignores_any_message() {
    let _turn = turn();
    let (rounds, seed) = rounds_and_seed();
    let mut bytes = Vec::new();
    write_spm(
        &build(&generate(Shape::Torus, 3000, 1), Some(100)),
        &mut bytes,
    )
    .unwrap();
    let length = bytes.len();
    let file = SpmFile::open(bytes).unwrap();
    let regions = file.regions().to_vec();
    let model = file.model_header().model;
    let served = ServedModel {
        name: "torus".to_string(),
        file,
    };
    let object = ServedObject {
        model: 0,
        name: Request::name_hash("torus"),
    };
    let mut station = Station::new(7, vec![served], vec![object]);
    let mut mutator = Mutator::new(seed);
    let mut clients = [Spoken::default(); 4];
    let mut chunks = 0u64;
    let (_, most) = most_bytes(|| {
        for _ in 0..10 * rounds {
            let at = mutator.below(clients.len());
            let mut request = clients[at].next(at);
            request.model = if mutator.below(8) == 0 { 0 } else { model };
            request.kind = 1 + mutator.below(4) as u32;
            request.count = mutator.below(5) as u32;
            request.tour.seconds = 0.1;
            request.tour.speed = mutator.below(3) as f64;
            for ask in &mut request.regions[..4] {
                ask.region = match mutator.below(8) {
                    0 => RegionId::WHOLE,
                    1 => RegionId::PREFIX,
                    _ => regions[mutator.below(regions.len())],
                }
                .0;
                ask.tolerance_bits = match mutator.below(4) {
                    0 => mutator.below(1 << 32) as u32,
                    1 => 1e-2f32.to_bits(),
                    _ => 0,
                };
                ask.action = 1 + mutator.below(3) as u32;
            }
            let mut message = bytemuck::bytes_of(&request).to_vec();
            if mutator.below(16) == 0 {
                mutator.damage(&mut message, &[], false);
                // Who knows what was understood: all start anew.
                for spoken in &mut clients {
                    *spoken = Spoken {
                        incarnation: spoken.incarnation + 1,
                        ..Spoken::default()
                    };
                }
            }
            keeping(&message, "request", || {
                let request: Request = bytemuck::pod_read_unaligned(&message);
                station.handle(Message::Request(&request));
                let mut report = ContactReport::zeroed();
                mutator.damage_report(&mut report);
                station.handle(Message::Contact(&report));
                let known: Vec<u64> = station.clients().collect();
                assert!(known.len() <= MAX_CLIENTS);
                for client in known {
                    let said = (0..4).filter(|_| station.poll(client).is_some()).count() as u64;
                    chunks += said;
                    if let Some(spoken) = clients.get_mut((client as usize).wrapping_sub(1)) {
                        spoken.received += said;
                    }
                }
                for sentence in station.take_notes() {
                    check_sentence(&sentence);
                }
            });
        }
    });
    println!(
        "{:?}, {chunks} chunks, {most} bytes at most",
        station.counters()
    );
    assert!(chunks > rounds && station.counters().damaged > 0);
    assert!(most < 64 * length, "{most} bytes for a file of {length}");
}

impl Mutator {
    fn damage_report(&mut self, report: &mut ContactReport) {
        report.client = self.below(6) as u64;
        let mut bytes = bytemuck::bytes_of(report).to_vec();
        self.damage(&mut bytes, &[], false);
        *report = bytemuck::pod_read_unaligned(&bytes);
    }
}
