//! Turns: a controller gets its answers as soon as if it were alone, whatever others ask for.

use super::client::Client;
use super::*;
use crate::testing::Counted;
use crate::tuning::service::{MAX_CONTACTS, MAX_VISITS, VISITS_A_STEP};
use proptest::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Steps of a turn.
const STEPS: u64 = 4;

/// A station over bytes that are counted, and the count.
fn counted_station() -> (Station<Counted>, Arc<AtomicU64>) {
    let (bytes, reads) = Counted::new(TORUS.to_vec());
    let served = ServedModel {
        name: "torus".to_owned(),
        file: SpmFile::open(bytes).unwrap(),
    };
    let object = ServedObject {
        model: 0,
        name: Request::name_hash("torus"),
    };
    (Station::new(1, vec![served], vec![object]), reads)
}

/// A client's turn, as the shell gives it: chunks come in, and what is to be said goes out.
fn turn<D: AsRef<[u8]>>(server: &mut Station<D>, client: &mut Client, steps: u64) -> usize {
    let mut steps = steps;
    let mut chunks = Vec::new();
    while let Some(chunk) = server.poll_within(client.id, &mut steps) {
        chunks.push(chunk);
    }
    for chunk in &chunks {
        let said = client.receive(chunk).expect("no gap");
        let credit = client.request(RequestKind::Credit);
        for request in said.into_iter().chain([credit]) {
            server.handle(Message::Request(&request));
        }
    }
    chunks.len()
}

/// Turns until a client has all that it asked for.
fn turns_until_held(
    server: &mut Station<Counted>,
    client: &mut Client,
    mut others: impl FnMut(&mut Station<Counted>),
) -> u32 {
    let mut turns = 0;
    while !client.asked.is_empty() {
        others(server);
        turn(server, client, STEPS);
        turns += 1;
        assert!(turns < 10_000, "it is never answered");
    }
    turns
}

/// The whole model at a tolerance that it takes many steps to search.
fn whole() -> RegionAt {
    RegionAt::tolerance(RegionId::WHOLE, f32::MIN_POSITIVE)
}

/// Something that a hostile client says: floods, whole models, contradictions, forged names.
fn hostile_message(server: &mut Station<Counted>, id: u64, sequence: &mut u64, draw: [u32; 4]) {
    let mut request = Client::new(id).request(RequestKind::Regions);
    request.sequence = *sequence;
    request.count = REGIONS_PER_REQUEST as u32;
    let forged = draw[0].is_multiple_of(7);
    if forged {
        request.client = u64::from(draw[1]) << 8 | 0xF0;
    } else {
        *sequence += 1;
    }
    for (k, ask) in request.regions.iter_mut().enumerate() {
        let region = match (draw[2] as usize + k) % 4 {
            0 => whole(),
            1 => RegionAt::full(RegionId::WHOLE),
            2 => RegionAt::tolerance(RegionId::WHOLE, 1e-6 * (draw[3] % 1000) as f32),
            _ => regions()[draw[3] as usize % 30],
        };
        *ask = RegionAsk {
            region: region.region.0,
            tolerance_bits: region.tolerance_bits,
            action: (draw[1] >> (k % 16)) % 6,
        };
    }
    server.handle(Message::Request(&request));
    if draw[0].is_multiple_of(5) {
        // So that a broken epoch is not the end of it.
        *sequence = 0;
        let mut request = Client::new(id).request(RequestKind::Credit);
        request.incarnation = u64::from(draw[3]);
        server.handle(Message::Request(&request));
        *sequence += 1;
    }
    let mut report = ContactReport::zeroed();
    report.client = id;
    for _ in 0..draw[2] % 300 {
        server.handle(Message::Contact(&report));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn a_hostile_client_delays_nobody(
        wanted in prop::collection::vec(0usize..36, 1..12),
        draws in prop::collection::vec(prop::array::uniform4(any::<u32>()), 50),
    ) {
        let regions = regions();
        let ask = |server: &mut Station<Counted>| {
            let mut client = Client::new(7);
            for &k in &wanted {
                for request in client.subscribe(regions[k % regions.len()]) {
                    server.handle(Message::Request(&request));
                }
            }
            client
        };
        let (mut server, _) = counted_station();
        let mut client = ask(&mut server);
        let alone = turns_until_held(&mut server, &mut client, |_| {});

        let (mut server, _) = counted_station();
        let (mut sequence, mut round) = (0, 0);
        let mut client = ask(&mut server);
        let beside = turns_until_held(&mut server, &mut client, |server| {
            for _ in 0..3 {
                hostile_message(server, 9, &mut sequence, draws[round % draws.len()]);
                round += 1;
            }
            for id in server.clients().filter(|&id| id != 7).collect::<Vec<_>>() {
                let mut steps = STEPS;
                while server.poll_within(id, &mut steps).is_some() {}
            }
        });
        prop_assert_eq!(beside, alone);
        client.check();
        prop_assert!(server.clients().count() <= MAX_CLIENTS);
    }
}

#[test]
fn a_turn_reads_a_bounded_part_of_the_model() {
    let (mut server, reads) = counted_station();
    let mut client = Client::new(7);
    for request in client.subscribe(whole()) {
        server.handle(Message::Request(&request));
    }
    let (mut largest, mut turns) = (0, 0);
    while !client.asked.is_empty() {
        let before = reads.load(Ordering::Relaxed);
        let chunks = turn(&mut server, &mut client, 1) as u64;
        let read = reads.load(Ordering::Relaxed) - before;
        // A chunk holds 64 records at the most, and a record is a read or two.
        largest = largest.max(read.saturating_sub(128 * chunks));
        turns += 1;
    }
    assert!(turns > 20, "{turns} turns");
    assert!(largest <= 8 * u64::from(SEARCHED_A_STEP), "{largest} reads");
}

#[test]
fn a_closure_that_takes_longer_than_patience_is_found_all_the_same() {
    let (mut server, reads) = counted_station();
    let mut client = Client::new(7);
    let requests = client.subscribe(whole());
    requests
        .iter()
        .for_each(|r| server.handle(Message::Request(r)));
    let mut epochs = 0;
    let mut turns = 0;
    let before = reads.load(Ordering::Relaxed);
    while !client.held.contains_key(&whole()) {
        // Silence: it asks anew, every third turn while nothing comes.
        if turn(&mut server, &mut client, 1) == 0 && turns % 3 == 2 {
            let requests = client.new_epoch();
            requests
                .iter()
                .for_each(|r| server.handle(Message::Request(r)));
            epochs += 1;
        }
        turns += 1;
        assert!(turns < 10_000, "a livelock");
    }
    assert!(epochs > 5);
    client.check();
    // The work was done about once.
    let read = reads.load(Ordering::Relaxed) - before;
    let vsps = u64::from(open().model_header().vsps);
    assert!(read < 12 * vsps, "{read} reads for {vsps} VSPs");
}

#[test]
fn who_waits_for_a_closure_hears_that_it_is_being_found() {
    let mut server = station(1);
    let mut client = Client::new(7);
    let requests = client.subscribe(whole());
    requests
        .iter()
        .for_each(|r| server.handle(Message::Request(r)));
    assert_eq!(turn(&mut server, &mut client, 1), 0);
    let chunk = server.poll_unfinished(7, 0).expect("a sign of life");
    assert_eq!((chunk.0.last, chunk.0.sequence), (0, 0));
    client.receive(&chunk).expect("it is the next chunk");
    assert!(!client.held.contains_key(&whole()));
    for _ in 0..10_000 {
        turn(&mut server, &mut client, STEPS);
    }
    client.check();
    assert_eq!(
        server.poll_unfinished(7, 0),
        None,
        "nothing is being made any more"
    );
}

/// A controller gives up each of its sessions by itself: what comes in another is no sign of life.
#[test]
fn a_session_that_waits_is_told_in_time_whatever_another_one_gets() {
    const TURN_US: u32 = 10_000;
    const SILENT_US: u32 = 50_000;
    let mut server = station_of(1, open(), 2);
    let mut clients = [Client::new(7), Client::new(7)];
    let say = |server: &mut Station<Bytes>, object: usize, requests: Vec<Request>| {
        for mut request in requests {
            request.object = object as u32;
            server.handle(Message::Request(&request));
        }
    };
    // The clock wraps around meanwhile.
    let began_us = u32::MAX - 12 * TURN_US;
    server.tell_time(began_us);
    say(&mut server, 1, clients[1].subscribe(whole()));
    let (mut last_us, mut signs, mut others) = (0, 0, 0);
    for turn in 1.. {
        let now_us = TURN_US * turn;
        server.tell_time(began_us.wrapping_add(now_us));
        let again = clients[0].regions(RegionAction::Resend, &[regions()[0]]);
        say(&mut server, 0, again);
        let mut steps = 2;
        let mut chunks = Vec::new();
        while let Some(chunk) = server.poll_within(7, &mut steps) {
            chunks.push(chunk);
        }
        if let Some(sign) = server.poll_unfinished(7, SILENT_US) {
            assert_eq!((sign.0.object, sign.0.last), (1, 0));
            signs += 1;
            chunks.push(sign);
        }
        for chunk in &chunks {
            let object = chunk.0.object as usize;
            match object {
                0 => others += 1,
                _ => last_us = now_us,
            }
            let client = &mut clients[object];
            let mut said = client.receive(chunk).expect("no gap");
            said.push(client.request(RequestKind::Credit));
            say(&mut server, object, said);
        }
        assert!(now_us - last_us <= SILENT_US, "silent at {now_us} us");
        if clients[1].asked.is_empty() {
            break;
        }
        assert!(turn < 10_000, "it is never answered");
    }
    assert!(signs >= 2 && others >= 5, "{signs} signs, {others} chunks");
    clients[1].check();
}

/// After a silence it says what it holds, which takes a while to go through.
#[test]
fn who_waits_while_what_it_holds_is_gone_through_is_not_forgotten() {
    let mut server = station(1);
    let mut client = Client::new(7);
    let say = |server: &mut Station<_>, requests: Vec<Request>| {
        requests
            .iter()
            .for_each(|request| server.handle(Message::Request(request)));
    };
    say(&mut server, client.subscribe(whole()));
    while !client.asked.is_empty() {
        turn(&mut server, &mut client, STEPS);
    }
    let coarser = RegionAt::tolerance(RegionId::WHOLE, 1e-3);
    say(&mut server, client.new_epoch());
    say(&mut server, client.subscribe(coarser));
    assert_eq!(turn(&mut server, &mut client, 1), 0);
    let chunk = server.poll_unfinished(7, 0).expect("a sign of life");
    assert_eq!((chunk.0.last, chunk.0.count), (0, 0));
    client.receive(&chunk).expect("it is the next chunk");
    for turns in 0.. {
        if client.asked.is_empty() {
            break;
        }
        turn(&mut server, &mut client, STEPS);
        assert!(turns < 10_000, "it is never answered");
    }
    client.check();
}

#[test]
fn a_question_asked_again_while_its_closure_is_searched_does_not_begin_anew() {
    let count = |again: bool| {
        let (mut server, _) = counted_station();
        let mut client = Client::new(7);
        let requests = client.subscribe(whole());
        requests
            .iter()
            .for_each(|r| server.handle(Message::Request(r)));
        turns_until_held_asking(&mut server, &mut client, again)
    };
    assert_eq!(count(false), count(true));
}

/// Turns of one step until the first chunk.
fn turns_until_held_asking(server: &mut Station<Counted>, client: &mut Client, again: bool) -> u32 {
    for turns in 1..10_000 {
        if turn(server, client, 1) > 0 {
            return turns;
        }
        if again {
            for request in client.regions(RegionAction::Subscribe, &[whole()]) {
                server.handle(Message::Request(&request));
            }
        }
    }
    panic!("it is never answered");
}

/// From the middle of a sphere all faces are about as far: the search would look at every box.
#[test]
fn a_contact_far_from_the_mesh_is_not_searched_without_end() {
    let mut server = station_of(1, model(Shape::Sphere, 20_000, 8), 1);
    let credit = Client::new(1).request(RequestKind::Credit);
    server.handle(Message::Request(&credit));
    let mut report = ContactReport::zeroed();
    report.client = 1;
    for _ in 0..200 {
        server.handle(Message::Contact(&report));
    }
    let mut turns = 0;
    loop {
        let mut steps = 1;
        assert_eq!(server.poll_within(1, &mut steps), None);
        if steps == 1 {
            break;
        }
        turns += 1;
    }
    assert_eq!(
        turns, MAX_CONTACTS,
        "old reports make room, and each is a step at least"
    );
    server.handle(Message::Contact(&report));
    let mut steps = 1000;
    assert_eq!(server.poll_within(1, &mut steps), None);
    assert_eq!(1000 - steps, u64::from(MAX_VISITS / VISITS_A_STEP));
    let counters = server.counters();
    let all = (MAX_CONTACTS + 1) as u64;
    assert_eq!((counters.measured, counters.unmeasured), (0, all));
}
