//! The two connection agents over real iceoryx2, in one process, each test in a domain of its own.

mod clients;

use bytemuck::Zeroable;
use hrtc::link::{ChunkRecorder, Link, LinkEndpoints, LinkHandle, LinkOptions, LinkReport};
use hrtc::tuning::INBOX_CAPACITY;
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{
    AnswerItem, AnswersReader, CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, ContactReport,
    Encoding, HELLO_PERIOD_MS, Hello, MAX_CLIENTS, PROTOCOL_VERSION, Refusal, RegionAction,
    RegionAsk, Request, RequestKind, Role,
};
use rtrb::{Consumer, Producer, RingBuffer};
use spm::{NONE, SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::{Counters, ServedModel, ServedObject, Station};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use transport::Domain;
use ve_station::clients::ClientStatus;
use ve_station::connection::Connection;

const CLIENT: u64 = 0xC11E;

/// A domain that no other test and no other run uses; its files go with it.
struct OwnDomain(Domain);

impl std::ops::Deref for OwnDomain {
    type Target = Domain;

    fn deref(&self) -> &Domain {
        &self.0
    }
}

impl Drop for OwnDomain {
    fn drop(&mut self) {
        self.0.remove_files();
    }
}

fn domain(test: &str) -> OwnDomain {
    OwnDomain(Domain::new(&format!("{test}-{}", std::process::id())).unwrap())
}

fn torus() -> Vec<u8> {
    let mesh = generate(Shape::Torus, 3000, 1);
    let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).unwrap();
    bytes
}

/// A station on its own thread.
struct Served {
    stop: Arc<AtomicBool>,
    /// What it told last of its clients.
    status: Arc<Mutex<Vec<ClientStatus>>>,
    thread: thread::JoinHandle<(Counters, u64)>,
}

impl Served {
    fn start(domain: &Domain, incarnation: u64, bytes: Vec<u8>) -> Self {
        let status = Arc::new(Mutex::new(Vec::new()));
        let told = Arc::clone(&status);
        let tell = move |clients: &[ClientStatus]| *told.lock().unwrap() = clients.to_vec();
        Self {
            status,
            ..Self::start_telling(domain, incarnation, bytes, tell)
        }
    }

    /// One that tells of its clients otherwise.
    fn start_telling(
        domain: &Domain,
        incarnation: u64,
        bytes: Vec<u8>,
        tell: impl FnMut(&[ClientStatus]) + Send + 'static,
    ) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (domain, stopped) = (domain.clone(), Arc::clone(&stop));
        let thread = thread::spawn(move || {
            let served = ServedModel {
                name: "torus".to_owned(),
                file: SpmFile::open(bytes).unwrap(),
            };
            let object = ServedObject {
                model: 0,
                name: Request::name_hash("torus"),
            };
            let station = Station::new(incarnation, vec![served], vec![object]);
            let mut connection = Connection::open(&domain, station).unwrap();
            connection.run_telling(&stopped, tell);
            let counters = connection.station().counters();
            (counters, connection.refused_heartbeats())
        });
        Self {
            stop,
            status: Arc::default(),
            thread,
        }
    }

    fn stop(self) -> Counters {
        self.stop_refusing().0
    }

    /// The same, with the number of heartbeats that it refused.
    fn stop_refusing(self) -> (Counters, u64) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// The tick's ends of a link.
struct Tick {
    requests: Producer<Request>,
    contacts: Producer<ContactReport>,
    inbox: Consumer<InboxChunk>,
    station: Arc<AtomicU64>,
    round_trip_us: Arc<AtomicU32>,
    recorded: Arc<Mutex<Vec<u64>>>,
    link: LinkHandle,
    next: u64,
    consumed: u64,
    client: u64,
}

impl Tick {
    fn start(domain: &Domain) -> Self {
        Self::start_as(CLIENT, domain)
    }

    fn start_as(client: u64, domain: &Domain) -> Self {
        Self::start_with(client, Encoding::Plain, domain)
    }

    fn start_with(client: u64, encoding: Encoding, domain: &Domain) -> Self {
        let recorded = Arc::new(Mutex::new(Vec::new()));
        let record = Arc::clone(&recorded);
        let recorder: ChunkRecorder = Box::new(move |chunk| {
            record.lock().unwrap().push(chunk.header.sequence);
        });
        let inbox = RingBuffer::new(INBOX_CAPACITY);
        Self::with_ends((client, encoding), domain, inbox, (recorder, recorded))
    }

    fn with_recorder(domain: &Domain, recorder: ChunkRecorder) -> Self {
        let inbox = RingBuffer::new(INBOX_CAPACITY);
        let recorder = (recorder, Arc::default());
        Self::with_ends((CLIENT, Encoding::Plain), domain, inbox, recorder)
    }

    /// With an inbox of so many chunks.
    fn with_inbox(domain: &Domain, chunks: usize) -> Self {
        let recorder: ChunkRecorder = Box::new(|_| ());
        let recorder = (recorder, Arc::default());
        let inbox = RingBuffer::new(chunks);
        Self::with_ends((CLIENT, Encoding::Plain), domain, inbox, recorder)
    }

    fn with_ends(
        (client, encoding): (u64, Encoding),
        domain: &Domain,
        (inbox_in, inbox): (Producer<InboxChunk>, Consumer<InboxChunk>),
        (recorder, recorded): (ChunkRecorder, Arc<Mutex<Vec<u64>>>),
    ) -> Self {
        let (requests, requests_out) = RingBuffer::new(64);
        let (contacts, contacts_out) = RingBuffer::new(64);
        let station = Arc::new(AtomicU64::new(0));
        let round_trip_us = Arc::new(AtomicU32::new(0));
        let link = Link::spawn(
            LinkOptions {
                domain: domain.clone(),
                client,
                incarnation: 1,
                encoding,
            },
            LinkEndpoints {
                requests: requests_out,
                contacts: contacts_out,
                inbox: inbox_in,
                station: Arc::clone(&station),
                round_trip_us: Arc::clone(&round_trip_us),
                traffic: Arc::default(),
                recorder: Some(recorder),
            },
        )
        .unwrap();
        Self {
            requests,
            contacts,
            inbox,
            station,
            round_trip_us,
            recorded,
            link,
            next: 0,
            consumed: 0,
            client,
        }
    }

    fn request(&mut self, kind: RequestKind, change: impl Fn(&mut Request)) {
        let mut request = Request::zeroed();
        request.client = self.client;
        request.incarnation = 1;
        request.sequence = self.next;
        request.consumed = self.consumed;
        request.credit = protocol::CREDIT_CHUNKS as u32;
        request.name = Request::name_hash("torus");
        request.kind = kind as u32;
        change(&mut request);
        self.next += 1;
        self.requests.push(request).unwrap();
    }

    /// Chunks until one of this kind is the last of its answer.
    fn answer(&mut self) -> Vec<InboxChunk> {
        let mut chunks = Vec::new();
        until("an answer", || match self.inbox.pop() {
            Ok(chunk) => {
                assert_eq!(chunk.header.sequence, self.consumed);
                self.consumed += 1;
                chunks.push(chunk);
                chunk.header.last == 1
            }
            Err(_) => false,
        });
        chunks
    }

    fn wait_for_station(&self, incarnation: u64) {
        until("the heartbeat", || {
            self.station.load(Ordering::Acquire) == incarnation
        });
    }
}

/// Waits for something that must come; a minute is a hang, not a measurement.
fn until(what: &str, mut came: impl FnMut() -> bool) {
    let start = Instant::now();
    while !came() {
        assert!(
            start.elapsed() < Duration::from_secs(60),
            "{what} never came"
        );
        thread::sleep(Duration::from_micros(200));
    }
}

#[test]
fn a_link_that_died_is_noticed_and_can_be_stopped() {
    let (domain, bytes) = (domain("died"), torus());
    let served = Served::start(&domain, 78, bytes);
    let recorder: ChunkRecorder = Box::new(|_| panic!("made on purpose in the link"));
    let mut tick = Tick::with_recorder(&domain, recorder);
    tick.wait_for_station(78);
    assert!(!tick.link.has_ended());
    tick.request(RequestKind::Model, |_| {});
    until("the end", || tick.link.has_ended());
    assert_eq!(tick.link.stop(), None);
    served.stop();
}

#[test]
fn a_model_a_region_and_a_measured_contact_cross_real_shared_memory() {
    let plain = cross(Encoding::Plain);
    assert_eq!(plain.compact, 0);
    assert_eq!(
        plain.bytes,
        plain.chunks * size_of::<InboxChunk>() as u64,
        "all slots travel"
    );
    // All but the first, for a client that asks for it.
    let compact = cross(Encoding::Compact);
    assert_eq!(compact.compact + 1, compact.chunks);
    assert!(2 * compact.bytes < plain.bytes, "{compact:?} {plain:?}");
}

/// What the link of a controller saw that was given a model, a region and a measured contact.
fn cross(encoding: Encoding) -> LinkReport {
    let (domain, bytes) = (domain(&format!("loop{}", encoding as u32)), torus());
    let file = SpmFile::open(bytes.clone()).unwrap();
    let served = Served::start(&domain, 77, bytes);
    let mut tick = Tick::start_with(CLIENT, encoding, &domain);
    tick.wait_for_station(77);

    tick.request(RequestKind::Model, |_| {});
    let chunks = tick.answer();
    let head = file.model_header();
    assert!(
        chunks
            .iter()
            .all(|c| c.header.kind == ChunkKind::Model as u32)
    );
    assert!(
        chunks
            .iter()
            .all(|c| c.header.model == head.model && c.header.station == 77)
    );

    let region = file.regions()[0];
    tick.request(RequestKind::Regions, |request| {
        request.model = head.model;
        request.count = 1;
        request.regions[0] = RegionAsk {
            region: region.0,
            tolerance_bits: 0,
            action: RegionAction::Subscribe as u32,
        };
    });
    let chunks = tick.answer();
    let (mut ids, mut records) = (BTreeSet::new(), BTreeSet::new());
    for chunk in &chunks {
        let mut reader = AnswersReader::new(chunk.header.count);
        while let Some(item) = reader.next(&chunk.slots).unwrap() {
            match item {
                AnswerItem::Id { id, .. } => {
                    ids.insert(id);
                }
                AnswerItem::Record(record) => {
                    assert_eq!(record, file.record(record.i).unwrap());
                    records.insert(record.i);
                }
                AnswerItem::Part(_) | AnswerItem::End(_) => {}
            }
        }
    }
    assert_eq!(ids, records);
    assert!(!ids.is_empty());

    let mut report = ContactReport::zeroed();
    report.client = CLIENT;
    report.contact = [1.4, 0.0, 0.0];
    tick.contacts.push(report).unwrap();
    // Its end: nothing is waited for any more.
    report.tick = 60;
    report.object = NONE;
    tick.contacts.push(report).unwrap();
    let chunks = tick.answer();
    assert_eq!(chunks[0].header.kind, ChunkKind::Measured as u32);

    let recorded = tick.recorded.lock().unwrap().clone();
    assert!(
        recorded.iter().copied().eq(0..tick.consumed),
        "recorded in order of arrival"
    );
    let report = tick.link.stop().unwrap();
    assert_eq!((report.undelivered, report.foreign), (0, 0));
    assert_eq!(report.chunks, tick.consumed);
    let counters = served.stop();
    assert_eq!(counters.records, records.len() as u64);
    report
}

#[test]
fn a_chunk_that_was_changed_on_its_way_is_dropped_and_counted() {
    let domain = domain("damaged");
    let mut tick = Tick::start(&domain);
    let node = domain.node().unwrap();
    let topic = domain.records_service(&node, CLIENT).unwrap();
    let publisher = domain.records_publisher(&topic).unwrap();
    for sequence in 0..3 {
        let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        slots[5].words[3] = 1.5f32.to_bits();
        let mut header = ChunkHeader::zeroed();
        header.sequence = sequence;
        header.seal(&slots);
        if sequence == 1 {
            // A coordinate that is a number still.
            slots[5].words[3] = 1.25f32.to_bits();
        }
        let mut sample = publisher.loan_slice_uninit(CHUNK_SLOTS).unwrap();
        *sample.user_header_mut() = header;
        sample.write_from_slice(&slots).send().unwrap();
    }
    let mut arrived = Vec::new();
    until("two sound chunks", || {
        arrived.extend(tick.inbox.pop().map(|chunk| chunk.header.sequence));
        arrived.len() == 2
    });
    assert_eq!(arrived, [0, 2]);
    let report = tick.link.stop().unwrap();
    assert_eq!((report.chunks, report.damaged), (2, 1));
}

#[test]
fn a_full_inbox_delays_chunks_and_loses_none() {
    let (domain, bytes) = (domain("full"), torus());
    let file = SpmFile::open(bytes.clone()).unwrap();
    let served = Served::start(&domain, 5, bytes);
    // Smaller than the credit, so that it is full time and again.
    let mut tick = Tick::with_inbox(&domain, 8);
    tick.wait_for_station(5);
    let regions: Vec<u32> = file.regions().iter().map(|r| r.0).take(32).collect();
    let mut last = 0;
    // The inbox is left alone until it is full, again and again.
    for round in 0..4 {
        tick.request(RequestKind::Regions, |request| {
            request.model = file.model_header().model;
            request.count = regions.len() as u32;
            for (ask, &region) in request.regions.iter_mut().zip(&regions) {
                ask.region = region;
                // With every record, so that it is more than the credit every time.
                ask.action = RegionAction::Resend as u32;
            }
        });
        until("a full inbox", || tick.inbox.slots() == 8);
        until("the round's answers", || {
            while let Ok(chunk) = tick.inbox.pop() {
                assert_eq!(chunk.header.sequence, tick.consumed);
                tick.consumed += 1;
                let mut reader = AnswersReader::new(chunk.header.count);
                while let Some(item) = reader.next(&chunk.slots).unwrap() {
                    last += u64::from(matches!(item, AnswerItem::End(head) if head.is_last()));
                }
            }
            tick.request(RequestKind::Credit, |_| {});
            thread::sleep(Duration::from_millis(1));
            last == (round + 1) * regions.len() as u64
        });
    }
    let report = tick.link.stop().unwrap();
    assert!(report.inbox_full > 0, "{report:?}");
    assert_eq!(report.chunks, tick.consumed);
    served.stop();
}

#[test]
fn a_station_that_comes_late_or_again_is_seen_and_one_that_leaves_is_missed() {
    let domain = domain("late");
    let tick = Tick::start(&domain);
    thread::sleep(Duration::from_millis(3 * HELLO_PERIOD_MS));
    assert_eq!(tick.station.load(Ordering::Acquire), 0);
    let bytes = torus();
    for incarnation in [11, 12] {
        let served = Served::start(&domain, incarnation, bytes.clone());
        tick.wait_for_station(incarnation);
        served.stop();
    }
    tick.wait_for_station(0);
}

#[test]
fn a_peer_of_another_protocol_version_is_counted_and_not_believed() {
    let domain = domain("version");
    let tick = Tick::start(&domain);
    let node = domain.node().unwrap();
    let hellos = domain.heartbeats(&node).unwrap().outgoing;
    for role in [Role::Controller, Role::Station] {
        let other = Hello::of_version(PROTOCOL_VERSION + 1, role, 1, 0);
        hellos.send_copy(other).unwrap();
    }
    until("a station of this version", || {
        hellos.send_copy(Hello::new(Role::Station, 34, 0)).unwrap();
        thread::sleep(Duration::from_millis(HELLO_PERIOD_MS));
        let station = tick.station.load(Ordering::Acquire);
        assert_ne!(station, 1, "it is no station of ours");
        station == 34
    });
    assert_eq!(tick.link.stop().unwrap().refused, 2);
}

#[test]
fn a_peer_of_another_byte_order_is_refused_by_both_sides() {
    let domain = domain("order");
    let served = Served::start(&domain, 31, torus());
    let mut tick = Tick::start(&domain);
    tick.wait_for_station(31);
    let node = domain.node().unwrap();
    let hellos = domain.heartbeats(&node).unwrap().outgoing;
    let topic = domain.subscribe_service(&node).unwrap();
    let requests = domain.request_sender(&topic).unwrap();
    let forged = |role| Hello::new(role, 99, 99).with_other_byte_order();
    let last = Hello::of_version(PROTOCOL_VERSION + 1, Role::Station, 1, 0);
    for hello in [forged(Role::Station), forged(Role::Controller), last] {
        hellos.send_copy(hello).unwrap();
    }
    let mut swapped = Request::zeroed();
    swapped.client = CLIENT.swap_bytes();
    swapped.kind = (RequestKind::Model as u32).swap_bytes();
    requests.send(&swapped).unwrap();
    // Both sides look at heartbeats between two requests: they have heard them at the second one.
    for _ in 0..2 {
        tick.request(RequestKind::Model, |_| {});
        tick.answer();
    }
    assert_eq!(tick.station.load(Ordering::Acquire), 31);
    let report = tick.link.stop().unwrap();
    assert_eq!(report.refused, 3);
    let (counters, refused) = served.stop_refusing();
    assert_eq!((counters.damaged, refused), (1, 3));
    assert_eq!(counters.refused, 0, "nothing was answered to it");
}

#[test]
fn a_peer_of_another_build_is_served() {
    let domain = domain("build");
    let tick = Tick::start(&domain);
    let node = domain.node().unwrap();
    let hellos = domain.heartbeats(&node).unwrap().outgoing;
    until("the station", || {
        let other = Hello::new(Role::Station, 32, 0).with_build("0.0.0-other");
        hellos.send_copy(other).unwrap();
        tick.station.load(Ordering::Acquire) == 32
    });
    assert_eq!(tick.link.stop().unwrap().refused, 0);
}

#[test]
fn the_station_tells_who_is_connected_from_how_far_and_what_was_sent() {
    let domain = domain("status");
    let served = Served::start(&domain, 33, torus());
    let mut ticks = [Tick::start(&domain), Tick::start_as(CLIENT + 1, &domain)];
    ticks[1].round_trip_us.store(20_340, Ordering::Relaxed);
    for tick in &mut ticks {
        tick.wait_for_station(33);
        tick.request(RequestKind::Model, |_| {});
        tick.answer();
    }
    let each = (CHUNK_SLOTS * size_of::<ChunkSlot>() + size_of::<ChunkHeader>()) as u64;
    let sent = ticks.each_ref().map(|tick| tick.consumed * each);
    until("the status", || {
        let status = served.status.lock().unwrap();
        let told = status.iter().map(|of| (of.client, of.round_trip, of.bytes));
        let far = Some(Duration::from_micros(20_340));
        told.eq([(CLIENT, None, sent[0]), (CLIENT + 1, far, sent[1])])
    });
    for tick in ticks {
        assert!(tick.link.stop().is_some());
    }
    until("their end", || served.status.lock().unwrap().is_empty());
    served.stop();
}

#[test]
fn a_domain_that_cannot_be_used_is_named_in_one_sentence() {
    let domain = domain("blocked");
    let root = domain.root();
    // A file where the domain's folder should be.
    std::fs::write(&root, "").unwrap();
    let error = Connection::open(&domain, Station::<Vec<u8>>::new(1, vec![], vec![])).unwrap_err();
    std::fs::remove_file(&root).unwrap();
    let sentence = error.to_string();
    assert!(
        sentence.contains("--domain") && sentence.contains(domain.name()),
        "{sentence}"
    );
    assert!(!sentence.contains('\n'), "{sentence}");
}
