mod client;
mod fairness;
mod packing;
mod sessions;
mod tours;

use super::*;
use crate::collection::closure;
use crate::testing::model;
use bytemuck::Zeroable;
use client::{Client, region_of};
use glam::DVec3;
use protocol::{AnswerItem, AnswersReader, CREDIT_CHUNKS, MODEL_HEADER_SLOTS, PartHead};
use protocol::{MAX_CLIENTS, MAX_SESSIONS, MeasuredError, REGIONS_PER_REQUEST, RegionAction};
use protocol::{QUARTERED_PER_CHUNK, RequestKind, quartered_faces};
use spm::VspRecord;
use spm::{BaseFace, BaseVertex, ModelHeader};
use spm_builder::generate::Shape;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, LazyLock};

/// Bytes that several stations of a test share.
#[derive(Debug, Clone)]
struct Bytes(Arc<Vec<u8>>);

impl AsRef<[u8]> for Bytes {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

static TORUS: LazyLock<Arc<Vec<u8>>> =
    LazyLock::new(|| Arc::new(crate::testing::model_bytes(Shape::Torus, 3000, 8)));

fn open() -> SpmFile<Bytes> {
    SpmFile::open(Bytes(Arc::clone(&TORUS))).unwrap()
}

fn station(incarnation: u64) -> Station<Bytes> {
    station_of(incarnation, open(), 1)
}

/// A station of so many objects of one model.
fn station_of<D: AsRef<[u8]>>(incarnation: u64, file: SpmFile<D>, objects: usize) -> Station<D> {
    let name = "torus".to_owned();
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(&name),
    };
    let served = ServedModel { name, file };
    Station::new(incarnation, vec![served], vec![object; objects])
}

fn tell<D: AsRef<[u8]>>(server: &mut Station<D>, requests: impl IntoIterator<Item = Request>) {
    for request in requests {
        server.handle(Message::Request(&request));
    }
}

/// What sessions ask for: occupied cells, one without faces (the axis of the torus), some at
/// tolerances, the whole at one and a prefix.
fn regions() -> Vec<RegionAt> {
    let file = open();
    let header = file.model_header();
    let all = file.regions();
    let mut regions: Vec<RegionAt> = all.iter().copied().map(RegionAt::full).take(30).collect();
    let rung = header.level_tolerances[1];
    assert!(
        rung > 0.0 && rung.is_finite(),
        "{:?}",
        header.level_tolerances
    );
    let coarse = header.grid_of(rung);
    let cells = (0..coarse.cells[0]).map(|x| RegionId::of_cell(glam::UVec3::new(x, 1, 0)));
    regions.extend(cells.map(|cell| RegionAt::tolerance(cell, rung)).take(4));
    regions.extend(
        all.iter()
            .take(2)
            .map(|&cell| RegionAt::tolerance(cell, rung / 8.0)),
    );
    regions.push(RegionAt::tolerance(RegionId::WHOLE, rung));
    regions.push(RegionAt {
        region: RegionId::PREFIX,
        tolerance_bits: 300,
    });
    let empty = (0..1 << 30)
        .map(RegionId)
        .find(|r| header.grid.contains(*r) && !all.contains(r));
    regions.extend(empty.map(RegionAt::full));
    regions
}

/// Everything that a client gets for one request, with credit given as needed.
fn ask(server: &mut Station<Bytes>, client: &mut Client, request: Request) -> Vec<Chunk> {
    server.handle(Message::Request(&request));
    let mut chunks = Vec::new();
    loop {
        let mut burst = 0;
        while let Some(chunk) = server.poll(client.id) {
            burst += 1;
            assert!(burst <= CREDIT_CHUNKS, "more under way than credit");
            assert_eq!(chunk.0.sequence, client.consumed);
            client.consumed += 1;
            chunks.push(chunk);
        }
        if burst == 0 {
            return chunks;
        }
        tell(server, [client.request(RequestKind::Credit)]);
    }
}

#[test]
fn a_model_arrives_as_it_lies_in_the_file() {
    let (mut server, mut client, file) = (station(9), Client::new(1), open());
    let request = client.request(RequestKind::Model);
    let chunks = ask(&mut server, &mut client, request);
    let mut slots = Vec::new();
    for (k, (header, chunk)) in chunks.iter().enumerate() {
        assert_eq!(header.kind, ChunkKind::Model as u32);
        assert_eq!(header.code as usize, slots.len());
        assert_eq!(header.last == 1, k + 1 == chunks.len());
        assert_eq!((header.station, header.client), (9, 1));
        slots.extend_from_slice(chunk);
    }
    let bytes: &[u8] = bytemuck::cast_slice(&slots);
    let head: ModelHeader = bytemuck::pod_read_unaligned(&bytes[..size_of::<ModelHeader>()]);
    assert_eq!(head, file.model_header());
    let vertices = &bytes[64 * MODEL_HEADER_SLOTS..];
    let length = size_of_val(file.base_vertices());
    assert_eq!(
        bytemuck::cast_slice::<_, BaseVertex>(&vertices[..length]),
        file.base_vertices()
    );
    let faces = &vertices[length.next_multiple_of(64)..];
    let length = size_of_val(file.base_faces());
    assert_eq!(
        bytemuck::cast_slice::<_, BaseFace>(&faces[..length]),
        file.base_faces()
    );
    let items: u32 = chunks.iter().map(|(header, _)| header.count).sum();
    assert_eq!(items, head.base_vertices + head.base_faces);
}

/// After a loss a client says how many slots it has.
#[test]
fn a_model_goes_on_from_where_its_client_is() {
    let (mut server, mut client) = (station(9), Client::new(1));
    let mut slots_from = |from: u32| {
        let request = Request {
            count: from,
            ..client.request(RequestKind::Model)
        };
        let chunks = ask(&mut server, &mut client, request);
        let (last, first) = (chunks[chunks.len() - 1].0.last, chunks[0].0.code);
        assert_eq!(last, 1, "from {from}");
        let slots: Vec<_> = chunks.into_iter().flat_map(|(_, slots)| slots).collect();
        (first, slots)
    };
    let (first, whole) = slots_from(0);
    assert_eq!(first, 0);
    let file = open();
    let vertices = file.base_vertices().len().div_ceil(4);
    let end = MODEL_HEADER_SLOTS + vertices + file.base_faces().len().div_ceil(2);
    for from in [1, MODEL_HEADER_SLOTS, end / 3, end / 2, end - 1] {
        let (first, rest) = slots_from(from as u32);
        assert_eq!(first as usize, from);
        assert_eq!(rest[..end - from], whole[from..end], "from {from}");
    }
    // Whoever has more than there is has another model.
    for from in [end as u32, end as u32 + 1, u32::MAX] {
        assert_eq!(slots_from(from), (0, whole.clone()), "from {from}");
    }
}

#[test]
fn quartered_faces_arrive_chunk_by_chunk_as_they_lie_in_the_file() {
    let (mut server, mut client, file) = (station(9), Client::new(1), open());
    let model = file.model_header().model;
    let expected = file.quartered_faces();
    assert!(expected.len() > QUARTERED_PER_CHUNK, "more than one chunk");
    let mut faces = Vec::new();
    while faces.len() < expected.len() {
        let request = Request {
            model,
            count: faces.len() as u32,
            ..client.request(RequestKind::Quarters)
        };
        let chunks = ask(&mut server, &mut client, request);
        let [(header, slots)] = chunks[..] else {
            panic!("one chunk: {}", chunks.len());
        };
        assert_eq!(header.kind, ChunkKind::Quarters as u32);
        assert_eq!((header.code as usize, header.last), (faces.len(), 1));
        assert!(header.count > 0);
        faces.extend_from_slice(&quartered_faces(&slots)[..header.count as usize]);
    }
    assert_eq!(faces, expected);
    for (first, of) in [
        (expected.len() as u32, model),
        (u32::MAX, model),
        (0, model ^ 1),
    ] {
        let request = Request {
            model: of,
            count: first,
            ..client.request(RequestKind::Quarters)
        };
        let chunks = ask(&mut server, &mut client, request);
        let [(header, _)] = chunks[..] else {
            panic!("one chunk: {}", chunks.len());
        };
        let refused = header.kind == ChunkKind::Refused as u32;
        assert_eq!((header.count == 0, refused), (true, of != model));
    }
}

/// Heads of the parts of chunks, and all of their ids and records.
fn parts(chunks: &[Chunk]) -> (Vec<PartHead>, Vec<(u32, bool)>, Vec<u32>) {
    let (mut heads, mut ids, mut records) = (Vec::new(), Vec::new(), Vec::new());
    for (header, slots) in chunks {
        assert_eq!(header.kind, ChunkKind::Answers as u32);
        let mut reader = AnswersReader::new(header.count);
        while let Some(item) = reader.next(slots).unwrap() {
            match item {
                AnswerItem::Part(head) => heads.push(head),
                AnswerItem::Id { id, record_follows } => ids.push((id, record_follows)),
                AnswerItem::Record(record) => records.push(record.i),
                AnswerItem::End(_) => {}
            }
        }
    }
    (heads, ids, records)
}

#[test]
fn without_credit_the_station_waits() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let long = [u32::MAX, 1400, 1300].map(|tolerance_bits| RegionAt {
        region: RegionId::PREFIX,
        tolerance_bits,
    });
    tell(&mut server, client.regions(RegionAction::Resend, &long));
    let sent = std::iter::from_fn(|| server.poll(1)).count() as u64;
    assert_eq!(sent, CREDIT_CHUNKS);
    client.consumed = 5;
    tell(&mut server, [client.request(RequestKind::Credit)]);
    assert_eq!(std::iter::from_fn(|| server.poll(1)).count(), 5);
    // Who claims more than was sent is not believed, and gets nothing more in this epoch.
    client.consumed = 1000;
    tell(&mut server, [client.request(RequestKind::Credit)]);
    assert_eq!(server.poll(1), None);
    assert_eq!(server.counters().damaged, 1);
}

#[test]
fn what_cannot_be_served_is_refused_by_name() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let mut refusal = |change: &dyn Fn(&mut Request), kind| {
        let mut request = client.request(kind);
        request.count = 1;
        request.regions[0].action = RegionAction::Subscribe as u32;
        request.regions[0].region = regions()[0].region.0;
        change(&mut request);
        let chunks = ask(&mut server, &mut client, request);
        assert_eq!(chunks.len(), 1);
        assert_eq!(chunks[0].0.kind, ChunkKind::Refused as u32);
        Refusal::from_code(chunks[0].0.code).unwrap()
    };
    let asked = RequestKind::Regions;
    assert_eq!(
        refusal(&|r| r.regions[0].region = u32::MAX, asked),
        Refusal::UnknownRegion
    );
    assert_eq!(refusal(&|r| r.model ^= 1, asked), Refusal::UnknownModel);
    for tolerance in [f32::INFINITY, f32::NAN, -1.0] {
        let bits = tolerance.to_bits();
        assert_eq!(
            refusal(&|r| r.regions[0].tolerance_bits = bits, asked),
            Refusal::Tolerance
        );
    }
    assert_eq!(
        refusal(&|r| r.name ^= 1, RequestKind::Model),
        Refusal::UnknownModel
    );
    assert_eq!(
        refusal(&|r| r.tour.speed = f64::NAN, RequestKind::Tour),
        Refusal::Tour
    );
    let mut other = Client::new(2).request(RequestKind::Model);
    other.object = 3;
    server.handle(Message::Request(&other));
    let (header, _) = server.poll(2).unwrap();
    assert_eq!(header.kind, ChunkKind::Refused as u32);
    assert_eq!(header.code, Refusal::UnknownModel as u32);
    assert!(!server.take_notes().is_empty());
    assert!(server.take_notes().is_empty(), "each is said once");
}

#[test]
fn a_gap_is_told_and_nothing_else_is_said_until_the_next_epoch() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let [a, b] = [regions()[0], regions()[1]];
    tell(&mut server, client.subscribe(a));
    let _lost = client.request(RequestKind::Credit);
    tell(&mut server, client.subscribe(b));
    tell(&mut server, [client.request(RequestKind::Credit)]);
    let (header, slots) = server.poll(1).unwrap();
    assert!(header.is_sound(&slots));
    assert_eq!((header.epoch, header.sequence), (0, u64::MAX));
    assert_eq!(
        server.poll(1),
        None,
        "it is told once, and what was asked before the gap is dropped too"
    );
    assert_eq!(server.counters().broken_epochs, 1);
    tell(&mut server, client.new_epoch());
    let chunk = server.poll(1).unwrap();
    assert_eq!((chunk.0.epoch, chunk.0.sequence), (1, 0));
    assert_eq!(region_of(&parts(&[chunk]).0[0]), a);
}

#[test]
fn a_release_cancels_the_answer_that_waits() {
    let (mut server, mut client) = (station(1), Client::new(1));
    let [a, b] = [regions()[0], regions()[1]];
    let mut requests = client.subscribe(a);
    requests.extend(client.subscribe(b));
    requests.extend(client.release(a));
    tell(&mut server, requests);
    let chunks: Vec<Chunk> = std::iter::from_fn(|| server.poll(1)).collect();
    assert!(parts(&chunks).0.iter().all(|head| region_of(head) == b));
    assert!(
        chunks
            .iter()
            .all(|chunk| client.receive(chunk) == Some(Vec::new()))
    );
    client.check();
}

#[test]
fn the_past_does_not_disturb_a_new_incarnation() {
    let mut server = station(1);
    let (mut old, mut new) = (Client::new(1), Client::new(1));
    new.incarnation = 2;
    let region = regions()[0];
    let early = old.regions(RegionAction::Subscribe, &[region])[0];
    let late = old.request(RequestKind::Credit);
    server.handle(Message::Request(&early));
    let fresh = new.regions(RegionAction::Subscribe, &[region])[0];
    server.handle(Message::Request(&fresh));
    server.handle(Message::Request(&late));
    assert_eq!(server.counters().stale, 1);
    let chunk = server.poll(1).unwrap();
    assert_eq!(chunk.0.sequence, 0);
    assert_eq!(region_of(&parts(&[chunk]).0[0]), region);
}

/// As from the queue of a station that stood still over two restarts of its client.
#[test]
fn no_incarnation_of_the_past_comes_back() {
    let mut server = station(1);
    let mut clients = [1, 2, 3].map(|incarnation| Client {
        incarnation,
        ..Client::new(1)
    });
    for _ in 0..2 {
        for client in &mut clients {
            tell(&mut server, [client.request(RequestKind::Credit)]);
        }
    }
    let counters = server.counters();
    assert_eq!((counters.requests, counters.stale), (4, 2));
    assert_eq!(counters.broken_epochs, 0);
}

#[test]
fn one_client_too_many_is_turned_away_and_told_so() {
    let mut server = station(1);
    let most = MAX_CLIENTS as u64;
    for id in 0..4 * most {
        let mut request = Client::new(id).request(RequestKind::Model);
        request.epoch = 3;
        server.handle(Message::Request(&request));
    }
    // Who ends without a place is told nothing.
    let request = Client::new(99).request(RequestKind::Close);
    server.handle(Message::Request(&request));
    assert_eq!(server.counters().stale, 1);
    assert!(server.clients().eq(0..most));
    assert_eq!(server.counters().turned_away, 3 * most);
    let told: Vec<(u64, Chunk)> = server.take_turned_away().collect();
    assert_eq!(told.len(), MAX_CLIENTS, "no more than there are places");
    for (id, (header, _)) in told {
        assert!(id >= most);
        assert_eq!((header.client, header.epoch, header.sequence), (id, 3, 0));
        assert_eq!(header.kind, ChunkKind::Refused as u32);
        assert_eq!(Refusal::from_code(header.code), Some(Refusal::NoPlace));
    }
    assert_eq!(server.take_turned_away().count(), 0);
    assert_eq!(server.take_notes().len(), 1);
    // A place that is given up is there for the next one.
    server.remove_client(5);
    let request = Client::new(100).request(RequestKind::Model);
    server.handle(Message::Request(&request));
    assert!(server.knows(100));
}

#[test]
fn contacts_come_back_with_their_distance_to_the_full_mesh() {
    let (mut server, mut client, file) = (station(1), Client::new(1), open());
    tell(&mut server, [client.request(RequestKind::Credit)]);
    let report = |tick: u64| {
        let mut report = ContactReport::zeroed();
        report.client = 1;
        report.tick = tick;
        report.contact = [1.0 + 0.01 * tick as f64, 0.3, 0.2];
        report
    };
    for tick in 0..3 {
        server.handle(Message::Contact(&report(tick)));
    }
    assert_eq!(
        server.poll(1),
        None,
        "three reports of three ticks can wait"
    );
    let mut free = report(3);
    free.object = NONE;
    server.handle(Message::Contact(&free));
    let (header, slots) = server.poll(1).unwrap();
    assert_eq!((header.kind, header.count, header.last), (4, 3, 1));
    let errors: &[MeasuredError] = bytemuck::cast_slice(&slots);
    for (tick, error) in errors[..3].iter().enumerate() {
        let contact = DVec3::from_array(report(tick as u64).contact);
        let truth = file
            .closest_point(contact)
            .unwrap()
            .1
            .distance_squared
            .sqrt();
        assert_eq!((error.tick, error.distance), (tick as u64, truth));
    }
    // They wait for others for a twentieth of a second, whatever a tick of the client is, and also
    // where the station's clock wraps around.
    for rate_hz in [100, 1000, 10_000] {
        for k in 0..=5_u32 {
            server.tell_time((10_000 * k).wrapping_sub(20_000));
            let mut later = report(1);
            later.tick = 100 + u64::from(k) * rate_hz / 100;
            server.handle(Message::Contact(&later));
            let count = server.poll(1).map(|(header, _)| header.count);
            assert_eq!(count, (k == 5).then_some(6), "{rate_hz} Hz");
        }
    }
}

#[test]
fn too_many_open_questions_end_the_epoch() {
    let (mut server, mut client) = (station(1), Client::new(1));
    client.model ^= 1;
    let full = [RegionAt::full(RegionId(0)); REGIONS_PER_REQUEST];
    for _ in 0..=MAX_JOBS / REGIONS_PER_REQUEST {
        tell(&mut server, client.regions(RegionAction::Subscribe, &full));
    }
    assert_eq!(server.counters().broken_epochs, 1);
    assert_eq!(server.poll(1).unwrap().0.sequence, u64::MAX);
    assert_eq!(server.poll(1), None);
}

#[test]
fn models_are_told_apart_in_answers() {
    let sphere = model(Shape::Sphere, 1000, 4);
    let torus = model(Shape::Torus, 1000, 4);
    let hashes = [sphere.model_header().model, torus.model_header().model];
    let served = [("a", sphere), ("b", torus)].map(|(name, file)| ServedModel {
        name: name.to_owned(),
        file,
    });
    let objects = [0, 1, 0].map(|model| ServedObject {
        model,
        name: Request::name_hash(["a", "b"][model]),
    });
    let mut server = Station::new(1, served.into(), objects.into());
    for (object, model) in [(0, 0), (1, 1), (2, 0)] {
        let mut request = Client::new(object).request(RequestKind::Model);
        request.model = 0;
        request.object = object as u32;
        request.name = objects[object as usize].name;
        server.handle(Message::Request(&request));
        let (header, _) = server.poll(object).unwrap();
        assert_eq!(header.object, object as u32);
        assert_eq!(header.model, hashes[model]);
    }
}
