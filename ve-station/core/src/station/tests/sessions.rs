//! Any session over any link ends in what was asked for.

use super::client::{Client, Wire};
use super::*;
use proptest::prelude::*;

/// What may happen to a session.
#[derive(Debug, Clone)]
enum Step {
    Subscribe(usize),
    Release(usize),
    NewEpoch,
    Credit,
    Up(usize),
    Pull(usize),
    Down(usize),
    LoseRequest,
    LoseChunk,
    DuplicateRequest,
    RestartStation,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => (0usize..40).prop_map(Step::Subscribe),
        4 => (0usize..40).prop_map(Step::Release),
        1 => Just(Step::NewEpoch),
        3 => Just(Step::Credit),
        6 => (1usize..6).prop_map(Step::Up),
        6 => (1usize..20).prop_map(Step::Pull),
        6 => (1usize..20).prop_map(Step::Down),
        1 => Just(Step::LoseRequest),
        1 => Just(Step::LoseChunk),
        1 => Just(Step::DuplicateRequest),
        1 => Just(Step::RestartStation),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    #[test]
    fn any_session_ends_in_the_union_of_the_closures(
        steps in prop::collection::vec(step(), 1..120),
    ) {
        let regions = regions();
        let mut server = station(1);
        let mut client = Client::new(7);
        let mut wire = Wire::default();
        for step in steps {
            match step {
                Step::Subscribe(k) => wire.up.extend(client.subscribe(regions[k % regions.len()])),
                Step::Release(k) => wire.up.extend(client.release(regions[k % regions.len()])),
                Step::NewEpoch => wire.up.extend(client.new_epoch()),
                Step::Credit => wire.up.push_back(client.request(RequestKind::Credit)),
                Step::Up(n) => wire.carry_up(&mut server, n),
                Step::Pull(n) => wire.pull(&mut server, 7, n),
                Step::Down(n) => wire.carry_down(&mut client, n),
                Step::LoseRequest => { wire.up.pop_front(); }
                Step::LoseChunk => { wire.down.pop_front(); }
                Step::DuplicateRequest => {
                    if let Some(&request) = wire.up.front() {
                        wire.up.push_front(request);
                    }
                }
                Step::RestartStation => server = station(server.incarnation() + 1),
            }
            prop_assert!(wire.down.len() as u64 <= 2 * CREDIT_CHUNKS + 64);
        }
        // Quiet: nothing is lost any more; silence ends an epoch.
        for _ in 0..600 {
            wire.carry_up(&mut server, usize::MAX);
            wire.pull(&mut server, 7, usize::MAX);
            let silent = wire.down.is_empty();
            wire.carry_down(&mut client, usize::MAX);
            if client.asked.is_empty() && wire.up.is_empty() {
                break;
            }
            if silent {
                wire.up.extend(client.new_epoch());
            } else {
                wire.up.push_back(client.request(RequestKind::Credit));
            }
        }
        prop_assert!(client.asked.is_empty(), "open: {:?}", client.asked);
        client.check();
    }

    #[test]
    fn no_bytes_make_the_station_panic_or_exceed_the_credit(
        garbage in prop::collection::vec(
            (
                prop::collection::vec(any::<u8>(), size_of::<Request>()),
                0u64..3,
                0u32..8,
                0u32..3,
                0u64..4,
            ),
            1..40,
        ),
        contacts in prop::collection::vec(
            prop::collection::vec(any::<u8>(), size_of::<ContactReport>()),
            0..8,
        ),
    ) {
        let mut server = station(1);
        for (bytes, client, kind, epoch, sequence) in garbage {
            let mut request: Request = bytemuck::pod_read_unaligned(&bytes);
            // Plain noise rarely gets past the first check: some fields are made likely.
            request.client = client;
            request.incarnation = 1;
            request.kind = kind;
            request.epoch = epoch;
            request.sequence = sequence;
            request.object %= 2;
            request.model = if client == 0 { open().model_header().model } else { request.model };
            request.name = Request::name_hash("torus");
            request.consumed %= 3;
            server.handle(Message::Request(&request));
            for id in 0..3 {
                let mut sent = 0;
                while server.poll(id).is_some() {
                    sent += 1;
                    prop_assert!(sent <= CREDIT_CHUNKS);
                }
            }
        }
        for bytes in contacts {
            let mut report: ContactReport = bytemuck::pod_read_unaligned(&bytes);
            report.client %= 3;
            report.object %= 3;
            server.handle(Message::Contact(&report));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Who releases only while nothing is open, on a link that loses nothing, never needs a new
    /// epoch: so the station's belief was right all the time.
    #[test]
    fn a_careful_client_on_a_sound_link_never_starts_again(
        steps in prop::collection::vec((0usize..40, any::<bool>(), 1usize..8), 1..80),
    ) {
        let regions = regions();
        let mut server = station(1);
        let mut client = Client::new(7);
        let mut wire = Wire::default();
        for (k, subscribe, most) in steps {
            let region = regions[k % regions.len()];
            if subscribe {
                wire.up.extend(client.subscribe(region));
            } else {
                while !client.asked.is_empty() {
                    wire.exchange(&mut server, &mut client, most);
                    wire.up.push_back(client.request(RequestKind::Credit));
                }
                wire.up.extend(client.release(region));
            }
        }
        while !client.asked.is_empty() {
            wire.exchange(&mut server, &mut client, usize::MAX);
            wire.up.push_back(client.request(RequestKind::Credit));
        }
        prop_assert_eq!((client.epoch, client.incomplete), (0, 0));
        client.check();
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// Who gives regions up at any moment, answers under way or not, and drops their records at
    /// once, may find answers that count on them. It asks for those again, and no more is needed on
    /// a link that loses nothing.
    #[test]
    fn a_careless_client_on_a_sound_link_never_starts_again(
        steps in prop::collection::vec((0usize..40, 0..5u8, 1usize..5), 1..120),
    ) {
        let regions = regions();
        let mut server = station(1);
        let mut client = Client::new(7);
        let mut wire = Wire::default();
        for (k, step, most) in steps {
            let region = regions[k % regions.len()];
            match step {
                0 | 1 => wire.up.extend(client.subscribe(region)),
                2 => wire.up.extend(client.release(region)),
                3 => {
                    wire.carry_up(&mut server, most);
                    wire.pull(&mut server, 7, most);
                }
                _ => {
                    wire.carry_down(&mut client, most);
                    wire.up.push_back(client.request(RequestKind::Credit));
                }
            }
        }
        for _ in 0..600 {
            wire.exchange(&mut server, &mut client, usize::MAX);
            if client.asked.is_empty() && wire.up.is_empty() {
                break;
            }
            wire.up.push_back(client.request(RequestKind::Credit));
        }
        prop_assert!(client.asked.is_empty(), "open: {:?}", client.asked);
        prop_assert_eq!(client.epoch, 0);
        client.check();
    }
}

/// Two clients, each at a station of its own, that ask for the same in the same order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asker {
    Once,
    Twice,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]

    /// A question that is put again while it waits, is searched for or is being answered changes
    /// nothing of what is said, and when.
    #[test]
    fn a_question_put_again_restarts_no_answer(
        steps in prop::collection::vec((0usize..40, 0..6u8, 1u64..12), 1..150),
    ) {
        let regions = regions();
        let mut pairs = [Asker::Once, Asker::Twice].map(|of| (of, station(1), Client::new(7)));
        for (k, step, most) in steps {
            let region = regions[k % regions.len()];
            let mut said = pairs.each_mut().map(|(asker, server, client)| {
                let asked: Vec<RegionAt> = client.asked.iter().copied().collect();
                let requests = match step {
                    0 | 1 => client.subscribe(region),
                    2 => client.release(region),
                    3 if *asker == Asker::Twice && !asked.is_empty() => {
                        client.regions(RegionAction::Subscribe, &[asked[k % asked.len()]])
                    }
                    _ => vec![client.request(RequestKind::Credit)],
                };
                tell(server, requests);
                let mut steps = most;
                let chunk = server.poll_within(7, &mut steps);
                if let Some(chunk) = &chunk {
                    let again = client.receive(chunk).expect("nothing is lost");
                    tell(server, again);
                }
                chunk
            });
            let twice = said[1].take();
            prop_assert!(said[0] == twice, "{:?}", (said[0].map(|c| c.0), twice.map(|c| c.0)));
        }
        let held = pairs.each_ref().map(|(_, _, client)| client.held.clone());
        prop_assert_eq!(&held[0], &held[1]);
        let counters = pairs.each_ref().map(|(_, server, _)| server.counters().records);
        prop_assert_eq!(counters[0], counters[1]);
    }
}

#[test]
fn records_dropped_under_an_answer_come_again_without_another_epoch() {
    let file = open();
    let (mut server, mut client, mut wire) = (station(1), Client::new(7), Wire::default());
    // Two regions that share VSPs: one is given up while the answer to the other counts on it.
    let [a, b] = [regions()[0], regions()[1]];
    let shared: BTreeSet<u32> = closure(&file, a).unwrap().into_iter().collect();
    assert!(
        closure(&file, b)
            .unwrap()
            .iter()
            .any(|i| shared.contains(i))
    );
    let mut settle = |client: &mut Client, server: &mut Station<Bytes>| {
        for _ in 0..10 {
            wire.up.push_back(client.request(RequestKind::Credit));
            wire.exchange(server, client, usize::MAX);
        }
    };
    tell(&mut server, client.subscribe(a));
    settle(&mut client, &mut server);
    tell(&mut server, client.subscribe(b));
    let under_way: Vec<Chunk> = std::iter::from_fn(|| server.poll(7)).collect();
    tell(&mut server, client.release(a));
    for chunk in &under_way {
        tell(&mut server, client.receive(chunk).unwrap());
    }
    assert_eq!((client.incomplete, client.epoch), (1, 0));
    settle(&mut client, &mut server);
    assert_eq!((client.incomplete, client.epoch), (1, 0));
    client.check();
}

/// A client of one object of two that have the same model.
fn twin(object: u32) -> (Client, u32) {
    (Client::new(1), object)
}

/// What the twin's session says, with its object.
fn said(object: u32, requests: Vec<Request>) -> impl Iterator<Item = Request> {
    requests.into_iter().map(move |mut request| {
        request.object = object;
        request
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Two objects of one model are two sessions: whatever is asked about one, given up and asked
    /// anew, the other's numbers and belief are its own.
    #[test]
    fn sessions_of_two_objects_of_one_model_do_not_mix(
        steps in prop::collection::vec((0usize..40, 0..4u8, 0usize..2), 1..80),
    ) {
        let mut server = station_of(1, open(), 2);
        let regions = regions();
        let mut twins = [twin(0), twin(1)];
        for (k, step, which) in steps {
            let region = regions[k % regions.len()];
            let (client, object) = &mut twins[which];
            let requests = match step {
                0 | 1 => client.subscribe(region),
                2 => client.release(region),
                _ => client.new_epoch(),
            };
            tell(&mut server, said(*object, requests));
            // All chunks of the client come on one topic.
            while let Some(chunk) = server.poll(1) {
                let (client, object) = &mut twins[chunk.0.object as usize];
                let requests = client.receive(&chunk);
                prop_assert!(requests.is_some(), "its numbers are its own");
                let credit = vec![client.request(RequestKind::Credit)];
                let requests = requests.unwrap_or_default();
                tell(&mut server, said(*object, requests).chain(said(*object, credit)));
            }
        }
        for (client, _) in &mut twins {
            prop_assert!(client.asked.is_empty());
            client.check();
        }
        prop_assert_eq!(server.counters().broken_epochs, 0);
    }
}

#[test]
fn a_closed_session_is_forgotten_and_begins_anew() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let region = regions()[0];
    tell(&mut server, client.subscribe(region));
    let first: Vec<Chunk> = std::iter::from_fn(|| server.poll(1)).collect();
    tell(&mut server, [client.request(RequestKind::Close)]);
    assert_eq!(server.clients().count(), 0);
    let mut anew = Client::new(1);
    anew.epoch = 1;
    tell(&mut server, anew.subscribe(region));
    let again: Vec<Chunk> = std::iter::from_fn(|| server.poll(1)).collect();
    assert_eq!(again.len(), first.len());
    assert!(again.iter().all(|chunk| anew.receive(chunk).is_some()));
    anew.check();
}

/// A probe that slides on to another object lifts off none of them.
#[test]
fn measured_errors_come_in_time_wherever_the_probe_went() {
    let mut server = station_of(1, open(), 2);
    for object in [0, 1] {
        let credit = Client::new(1).request(RequestKind::Credit);
        tell(&mut server, said(object, vec![credit]));
    }
    let mut report = ContactReport::zeroed();
    report.client = 1;
    report.contact = [1.4, 0.0, 0.0];
    for (time_us, object) in [(0, 0), (10_000, 0), (20_000, 0), (30_000, 1)] {
        server.tell_time(time_us);
        report.object = object;
        server.handle(Message::Contact(&report));
        assert_eq!(server.poll(1), None, "others may follow");
    }
    server.tell_time(1_000_000);
    let mut counts = [0, 0];
    while let Some((header, _)) = server.poll(1) {
        assert_eq!(header.kind, ChunkKind::Measured as u32);
        counts[header.object as usize] += header.count;
    }
    assert_eq!(counts, [3, 1]);
}

#[test]
fn of_clients_that_end_nothing_is_kept() {
    let mut server = station_of(1, open(), 2);
    for id in 0..100 {
        let mut client = Client::new(id);
        for object in [0, 1] {
            let model = Client::new(id).request(RequestKind::Model);
            tell(&mut server, said(object, vec![model]));
        }
        assert_eq!(server.poll(id).map(|(header, _)| header.object), Some(0));
        client.next_request = 1;
        let close = client.request(RequestKind::Close);
        tell(&mut server, said(0, vec![close]));
        assert_eq!(server.turns.len(), 1, "it has another session");
        tell(&mut server, said(1, vec![close]));
        assert!(server.turns.is_empty() && server.sessions.is_empty());
    }
}

#[test]
fn the_sessions_of_a_client_are_bounded_and_each_has_its_own_credit() {
    let objects = 3 * MAX_SESSIONS;
    let mut server = station_of(1, open(), objects);
    for object in 0..objects as u32 {
        let mut request = Client::new(1).request(RequestKind::Model);
        request.object = object;
        request.credit = 1;
        server.handle(Message::Request(&request));
    }
    assert_eq!(server.clients().collect::<Vec<_>>(), [1]);
    let heads: Vec<u32> = std::iter::from_fn(|| server.poll(1))
        .map(|(header, _)| header.object)
        .collect();
    let last = (objects - MAX_SESSIONS) as u32..objects as u32;
    assert_eq!(
        heads,
        last.collect::<Vec<_>>(),
        "the stalest made room, and each of the others says one chunk in its turn"
    );
}
