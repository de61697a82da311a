//! Tours: rolled in steps, after everything else, and kept.

use super::client::{Client, region_of};
use super::*;
use crate::testing::Counted;
use crate::tour::make_tour;
use crate::tuning::service::MANY_CREDIT;
use crate::tuning::tour::MAX_KEPT_POINTS;
use proptest::prelude::*;
use protocol::{TourAsk, TourPoint, tour_points};
use std::sync::atomic::{AtomicU64, Ordering};

/// A station over bytes that are counted, and the count.
fn counted_station() -> (Station<Counted>, Arc<AtomicU64>) {
    let (bytes, reads) = Counted::new(TORUS.to_vec());
    (station_of(1, SpmFile::open(bytes).unwrap(), 1), reads)
}

fn tour_ask(seed: u64, seconds: f64) -> TourAsk {
    TourAsk {
        seed,
        seconds,
        speed: 1.0,
        depth: 0.01,
        radius: 0.02,
        from: 0,
    }
}

/// Asks for a tour.
fn ask_tour<D: AsRef<[u8]>>(server: &mut Station<D>, client: &mut Client, ask: TourAsk) {
    let mut request = client.request(RequestKind::Tour);
    request.tour = ask;
    server.handle(Message::Request(&request));
}

/// Takes a chunk of a tour in, and gives credit for it; whether it is the last.
fn take<D: AsRef<[u8]>>(
    server: &mut Station<D>,
    client: &mut Client,
    (header, slots): &Chunk,
    points: &mut Vec<TourPoint>,
) -> bool {
    assert_eq!(header.kind, ChunkKind::Tour as u32);
    assert_eq!(header.sequence, client.consumed);
    assert_eq!(header.code as usize, points.len());
    points.extend(bytemuck::cast_slice::<_, TourPoint>(
        &slots[..header.count as usize],
    ));
    client.consumed += 1;
    tell(server, [client.request(RequestKind::Credit)]);
    header.last == 1
}

/// All that is left of a tour.
fn take_all<D: AsRef<[u8]>>(
    server: &mut Station<D>,
    client: &mut Client,
    points: &mut Vec<TourPoint>,
) {
    while let Some(chunk) = server.poll(client.id) {
        if take(server, client, &chunk, points) {
            return;
        }
    }
    panic!("no last chunk after {} points", points.len());
}

#[test]
fn a_tour_arrives_whole() {
    let (mut server, mut client, file) = (station(1), Client::new(1), open());
    let ask = tour_ask(3, 2.0);
    ask_tour(&mut server, &mut client, ask);
    let mut points = Vec::new();
    take_all(&mut server, &mut client, &mut points);
    assert_eq!(points, make_tour(&file, ask).unwrap());
    assert_eq!(server.poll(1), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// However few steps are made at a time, whatever is said in between, and however often it is
    /// asked for anew.
    #[test]
    fn a_tour_cut_in_any_way_is_the_same_tour(
        seed in 0u64..1000,
        cuts in prop::collection::vec((0u64..200, 0u8..20), 1..60),
    ) {
        let (mut server, mut client) = (station(1), Client::new(1));
        let ask = tour_ask(seed, 10.0);
        let mut points = Vec::new();
        ask_tour(&mut server, &mut client, ask);
        for (steps, and_then) in cuts {
            let mut left = steps;
            while let Some(chunk) = server.poll_within(1, &mut left) {
                take(&mut server, &mut client, &chunk, &mut points);
            }
            match and_then {
                0 => {
                    client.new_epoch();
                    points.clear();
                    ask_tour(&mut server, &mut client, ask);
                }
                1..5 => if let Some(chunk) = server.poll_unfinished(1, 0) {
                    take(&mut server, &mut client, &chunk, &mut points);
                }
                _ => {}
            }
        }
        let truth = make_tour(&open(), ask).unwrap();
        if points.len() < truth.len() {
            take_all(&mut server, &mut client, &mut points);
        }
        prop_assert_eq!(points, truth);
    }
}

#[test]
fn what_is_asked_while_a_tour_is_rolled_is_answered_between_two_steps() {
    let (mut server, mut client) = (station(1), Client::new(1));
    ask_tour(&mut server, &mut client, tour_ask(1, 600.0));
    let mut steps = 100;
    assert_eq!(server.poll_within(1, &mut steps), None);
    assert_eq!(steps, 0, "it is not made in a hundred steps");
    let region = regions()[0];
    tell(&mut server, client.subscribe(region));
    let mut chunks = Vec::new();
    // A step finds so small a closure, and nothing is left for the tour.
    while let Some(chunk) = server.poll_within(1, &mut { 4 }) {
        assert_eq!(client.receive(&chunk), Some(Vec::new()));
        chunks.push(chunk);
    }
    assert_eq!(region_of(&parts(&chunks).0[0]), region);
    client.check();
    // Nor does it keep anybody else waiting.
    let mut other = Client::new(2);
    let request = other.request(RequestKind::Model);
    server.handle(Message::Request(&request));
    let (header, _) = server.poll_within(2, &mut 0).unwrap();
    assert_eq!(header.kind, ChunkKind::Model as u32);
}

#[test]
fn who_waits_for_a_tour_can_be_told_that_it_is_being_rolled() {
    let (mut server, mut client) = (station(1), Client::new(1));
    assert_eq!(server.poll_unfinished(1, 0), None);
    let ask = tour_ask(1, 2.0);
    ask_tour(&mut server, &mut client, ask);
    let mut points = Vec::new();
    for _ in 0..3 {
        assert_eq!(server.poll_within(1, &mut 2), None);
        let (header, slots) = server.poll_unfinished(1, 0).unwrap();
        assert_eq!((header.count, header.last), (0, 0));
        assert!(!take(
            &mut server,
            &mut client,
            &(header, slots),
            &mut points
        ));
    }
    take_all(&mut server, &mut client, &mut points);
    assert_eq!(points, make_tour(&open(), ask).unwrap());
    assert_eq!(server.poll_unfinished(1, 0), None);
    // The credit holds for it too.
    ask_tour(&mut server, &mut client, tour_ask(2, 2.0));
    let told = std::iter::from_fn(|| server.poll_unfinished(1, 0)).count() as u64;
    assert_eq!(told, CREDIT_CHUNKS);
}

#[test]
fn a_tour_asked_for_again_goes_on_where_it_was() {
    let (mut server, reads) = counted_station();
    let mut client = Client::new(1);
    let ask = tour_ask(5, 60.0);
    let begun = reads.load(Ordering::Relaxed);
    ask_tour(&mut server, &mut client, ask);
    let mut half = Vec::new();
    while half.len() < 6000 {
        let chunk = server.poll(1).unwrap();
        assert!(!take(&mut server, &mut client, &chunk, &mut half));
    }
    let first_half = reads.load(Ordering::Relaxed) - begun;
    assert!(first_half > 100_000, "rolling reads: {first_half}");
    // Another incarnation is as good as another epoch.
    for again in 0..4 {
        client.new_epoch();
        if again == 2 {
            client = Client::new(1);
            client.incarnation = 2;
        }
        let before = reads.load(Ordering::Relaxed);
        ask_tour(&mut server, &mut client, ask);
        let mut points = Vec::new();
        while points.len() < half.len() {
            let chunk = server.poll_within(1, &mut 0).unwrap();
            take(&mut server, &mut client, &chunk, &mut points);
        }
        assert_eq!(points, half);
        let read = reads.load(Ordering::Relaxed) - before;
        assert!(read < 1000, "{read} reads for what was rolled before");
        if again == 3 {
            take_all(&mut server, &mut client, &mut points);
            assert_eq!(points, make_tour(&open(), ask).unwrap());
        }
    }
    // Another tour is another one.
    let other = tour_ask(6, 3.0);
    ask_tour(&mut server, &mut client, other);
    let mut points = Vec::new();
    take_all(&mut server, &mut client, &mut points);
    assert_eq!(points, make_tour(&open(), other).unwrap());
}

#[test]
fn a_tour_longer_than_what_is_kept_arrives_whole_every_time() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let ask = TourAsk {
        speed: 0.1,
        ..tour_ask(1, 700.0)
    };
    let truth = make_tour(&open(), ask).unwrap();
    assert!(truth.len() > MAX_KEPT_POINTS);
    for _ in 0..2 {
        ask_tour(&mut server, &mut client, ask);
        let mut points = Vec::new();
        take_all(&mut server, &mut client, &mut points);
        assert!(points == truth, "{} of {}", points.len(), truth.len());
        client.new_epoch();
    }
}

#[test]
fn a_tour_goes_on_at_any_station_behind_what_its_client_has() {
    let ask = tour_ask(5, 20.0);
    let truth = make_tour(&open(), ask).unwrap();
    let whole = truth.len() as u64;
    for from in [1, 777, whole - 1, whole, whole + 1, u64::MAX] {
        let (mut server, mut client) = (station(1), Client::new(1));
        ask_tour(&mut server, &mut client, TourAsk { from, ..ask });
        let known = from.min(u64::from(u32::MAX)) as usize;
        let mut points = truth[..known.min(truth.len())].to_vec();
        // Nothing is to come for who has more points than there are.
        while let Some((header, slots)) = server.poll(1) {
            assert_eq!(header.code as usize, points.len().max(known));
            let count = header.count as usize;
            points.extend(bytemuck::cast_slice::<_, TourPoint>(&slots[..count]));
            client.consumed += 1;
            tell(&mut server, [client.request(RequestKind::Credit)]);
        }
        assert!(points == truth, "from {from}");
        // And from any place of what was rolled, without rolling it again.
        let (from, mut rest) = (100, Vec::new());
        ask_tour(&mut server, &mut client, TourAsk { from, ..ask });
        while let Some((header, slots)) = server.poll_within(1, &mut 0) {
            let count = header.count as usize;
            rest.extend_from_slice(bytemuck::cast_slice::<_, TourPoint>(&slots[..count]));
            client.consumed += 1;
            tell(&mut server, [client.request(RequestKind::Credit)]);
        }
        assert!(rest == truth[100..], "from {from}");
    }
}

/// Steps that a tour takes in turns of one.
fn steps_of(ask: TourAsk) -> u64 {
    let (mut server, mut client) = (station(1), Client::new(1));
    ask_tour(&mut server, &mut client, ask);
    let mut used = 0;
    loop {
        let mut steps = 1;
        let chunk = server.poll_within(1, &mut steps);
        used += 1 - steps;
        let Some((header, _)) = chunk else {
            assert_eq!(steps, 0, "it is not over");
            continue;
        };
        if header.last == 1 {
            return used;
        }
        client.consumed += 1;
        tell(&mut server, [client.request(RequestKind::Credit)]);
    }
}

/// A slow tour has millions of points between two searches: they must not all pass in one turn.
#[test]
fn points_that_a_client_has_already_take_steps_too() {
    let ask = tour_ask(5, 20.0);
    let passed = tour_points(ask.seconds) / CHUNK_SLOTS as u64;
    assert!(passed > 50);
    let from = u64::MAX;
    assert_eq!(steps_of(TourAsk { from, ..ask }), steps_of(ask) + passed);
}

#[test]
fn where_few_chunks_may_be_under_way_a_third_of_them_are_of_tours() {
    for credit in 1..=CREDIT_CHUNKS {
        let (mut server, mut client) = (station(1), Client::new(1));
        let mut request = client.request(RequestKind::Tour);
        request.tour = tour_ask(1, 60.0);
        request.credit = credit as u32;
        server.handle(Message::Request(&request));
        let sent = std::iter::from_fn(|| server.poll(1)).count() as u64;
        let most = if credit < MANY_CREDIT {
            credit.div_ceil(3).max(2)
        } else {
            credit
        };
        assert_eq!(sent, most.min(credit));
    }
}
