//! A tour that takes long to roll keeps nobody waiting: over real iceoryx2, with a model that is
//! read slowly.

use bytemuck::Zeroable;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, Hello, RegionAction, Request, RequestKind, Role,
};
use spm::{RegionId, SpmFile, write_spm};
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model};
use station_core::station::{ServedModel, ServedObject, Station};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};
use transport::{Domain, RequestSender};
use ve_station::connection::Connection;

const CLIENT: u64 = 0xC11E;

/// Bytes whose every read takes a time; it can be changed.
struct Slow {
    bytes: Vec<u8>,
    nanoseconds: Arc<AtomicU64>,
}

impl AsRef<[u8]> for Slow {
    fn as_ref(&self) -> &[u8] {
        let time = Duration::from_nanos(self.nanoseconds.load(Ordering::Relaxed));
        let start = Instant::now();
        while start.elapsed() < time {
            std::hint::spin_loop();
        }
        &self.bytes
    }
}

/// A client's ports, for one of its objects.
struct Client {
    requests: RequestSender,
    records: Subscriber<ipc::Service, [ChunkSlot], ChunkHeader>,
    hello: Subscriber<ipc::Service, Hello, ()>,
    model: u64,
    object: u32,
    sent: u64,
    consumed: u64,
}

impl Client {
    fn open(
        domain: &Domain,
        node: &iceoryx2::node::Node<ipc::Service>,
        (model, object): (u64, u32),
    ) -> Self {
        let records = domain.records_service(node, CLIENT).unwrap();
        let requests = domain.subscribe_service(node).unwrap();
        Self {
            requests: domain.request_sender(&requests).unwrap(),
            records: domain.subscriber(&records, "receive records").unwrap(),
            hello: domain.heartbeats(node).unwrap().incoming,
            model,
            object,
            sent: 0,
            consumed: 0,
        }
    }

    fn ask(&mut self, kind: RequestKind, change: impl FnOnce(&mut Request)) {
        let mut request = Request::zeroed();
        request.client = CLIENT;
        request.incarnation = 1;
        request.sequence = self.sent;
        request.consumed = self.consumed;
        request.credit = protocol::CREDIT_CHUNKS as u32;
        request.model = self.model;
        request.object = self.object;
        request.name = Request::name_hash("torus");
        request.kind = kind as u32;
        change(&mut request);
        self.requests.send(&request).unwrap();
        self.sent += 1;
    }

    fn heartbeats(&self) -> u64 {
        let mut heard = 0;
        while let Some(hello) = self.hello.receive().unwrap() {
            heard += u64::from(hello.read().is_ok_and(|of| of.role == Role::Station));
        }
        heard
    }

    /// The head of the object's next chunk, which is acknowledged.
    fn chunk(&mut self) -> Option<ChunkHeader> {
        loop {
            let sample = self.records.receive().unwrap()?;
            assert_eq!(sample.payload().len(), CHUNK_SLOTS);
            let header = *sample.user_header();
            drop(sample);
            if header.object != self.object {
                continue;
            }
            assert_eq!(header.sequence, self.consumed);
            self.consumed += 1;
            self.ask(RequestKind::Credit, |_| {});
            return Some(header);
        }
    }

    fn ask_tour(&mut self) {
        self.ask(RequestKind::Tour, |request| {
            request.tour.seed = 1;
            request.tour.seconds = 20.0;
            request.tour.speed = 1.0;
            request.tour.depth = 0.01;
            request.tour.radius = 0.02;
        });
    }

    /// Asks for a region with all of its records, whatever it has.
    fn ask_region(&mut self, region: RegionId) {
        self.ask(RequestKind::Regions, |request| {
            request.count = 1;
            request.regions[0].region = region.0;
            request.regions[0].action = RegionAction::Resend as u32;
        });
    }
}

/// A station on its own thread, stopped whatever becomes of the test.
struct Served {
    domain: Domain,
    stop: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Served {
    fn start(domain: &Domain, file: SpmFile<Slow>) -> Self {
        let stop = Arc::<AtomicBool>::default();
        let (on, stopped) = (domain.clone(), Arc::clone(&stop));
        let thread = thread::spawn(move || {
            let served = ServedModel {
                name: "torus".to_owned(),
                file,
            };
            let object = ServedObject {
                model: 0,
                name: Request::name_hash("torus"),
            };
            let station = Station::new(1, vec![served], vec![object; 2]);
            Connection::open(&on, station).unwrap().run(&stopped);
        });
        Self {
            domain: domain.clone(),
            stop,
            thread: Some(thread),
        }
    }

    fn runs(&self) -> bool {
        self.thread.as_ref().is_some_and(|t| !t.is_finished())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(thread::JoinHandle::join);
        self.domain.remove_files();
        assert!(thread::panicking() || matches!(ended, Some(Ok(()))));
    }
}

/// A model whose reads take so long.
fn torus(nanoseconds: &Arc<AtomicU64>) -> SpmFile<Slow> {
    let parts = build_model(
        generate(Shape::Torus, 3000, 1),
        &BuildOptions::default(),
        &NoProgress,
    )
    .unwrap();
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).unwrap();
    let nanoseconds = Arc::clone(nanoseconds);
    SpmFile::open(Slow { bytes, nanoseconds }).unwrap()
}

/// Between machines the first request may arrive before the tunnel knows of its client's topic.
#[test]
fn an_answer_waits_until_somebody_hears_it() {
    let domain = Domain::new(&format!("unheard-{}", std::process::id())).unwrap();
    let served = Served::start(&domain, torus(&Arc::default()));
    let node = domain.node().unwrap();
    let hello = domain.heartbeats(&node).unwrap().incoming;
    let wait_for_heartbeat = || {
        while hello.receive().unwrap().is_none() {
            assert!(served.runs());
            thread::sleep(Duration::from_millis(1));
        }
    };
    wait_for_heartbeat();
    let topic = domain.subscribe_service(&node).unwrap();
    let request = Request {
        client: CLIENT,
        incarnation: 1,
        credit: 1,
        name: Request::name_hash("torus"),
        kind: RequestKind::Model as u32,
        ..Request::zeroed()
    };
    // It lasts as long as its messages may be under way.
    let sender = domain.request_sender(&topic).unwrap();
    assert_eq!(sender.send(&request).unwrap(), 1);
    // It looks at requests between any two heartbeats.
    (0..3).for_each(|_| wait_for_heartbeat());
    let topic = domain.records_service(&node, CLIENT).unwrap();
    let records = domain.subscriber(&topic, "receive records").unwrap();
    let chunk = loop {
        assert!(served.runs());
        if let Some(chunk) = records.receive().unwrap() {
            break chunk;
        }
        thread::sleep(Duration::from_millis(1));
    };
    assert_eq!(chunk.user_header().sequence, 0);
}

#[test]
fn heartbeats_regions_and_signs_of_life_come_while_a_touch_is_rolled() {
    let nanoseconds = Arc::<AtomicU64>::default();
    let file = torus(&nanoseconds);
    let (model, region) = (file.model_header().model, file.regions()[0]);
    // A touch takes some 200 000 reads: two seconds.
    nanoseconds.store(10_000, Ordering::Relaxed);

    let domain = Domain::new(&format!("slow-disk-{}", std::process::id())).unwrap();
    let served = Served::start(&domain, file);
    let node = domain.node().unwrap();
    let mut client = Client::open(&domain, &node, (model, 0));
    while client.heartbeats() == 0 {
        assert!(served.runs());
        thread::sleep(Duration::from_millis(1));
    }
    client.ask_tour();
    // Until the first points: heartbeats, and chunks that say nothing but that it is there.
    let (mut heard, mut signs, mut answered) = (0, 0, false);
    let mut asked = false;
    let points = loop {
        heard += client.heartbeats();
        match client.chunk() {
            Some(header) if header.kind == ChunkKind::Tour as u32 && header.count > 0 => {
                break header.count;
            }
            Some(header) if header.kind == ChunkKind::Tour as u32 => signs += 1,
            Some(header) => {
                assert_eq!(header.kind, ChunkKind::Answers as u32);
                answered = true;
            }
            None => thread::sleep(Duration::from_micros(500)),
        }
        if signs == 2 && !asked {
            asked = true;
            client.ask_region(region);
        }
    };
    println!("{heard} heartbeats, {signs} signs of life before the first {points} points");
    assert!(heard >= 3 && signs >= 3, "{heard} {signs}");
    assert!(answered, "the region waited for the tour");
    assert_eq!(points, CHUNK_SLOTS as u32);
    // Then quickly to the end.
    nanoseconds.store(0, Ordering::Relaxed);
    let mut given = points;
    while given < 4001 {
        match client.chunk() {
            Some(header) => {
                assert_eq!((header.kind, header.code), (ChunkKind::Tour as u32, given));
                given += header.count;
                assert_eq!(header.last == 1, given == 4001);
            }
            None => thread::sleep(Duration::from_millis(1)),
        }
    }
}

/// A controller gives up each of its sessions by itself: what comes in another is no sign of life.
#[test]
fn signs_of_life_of_a_tour_come_while_another_object_gets_its_regions() {
    let nanoseconds = Arc::<AtomicU64>::default();
    let file = torus(&nanoseconds);
    let (model, region) = (file.model_header().model, file.regions()[0]);
    nanoseconds.store(10_000, Ordering::Relaxed);

    let domain = Domain::new(&format!("two-objects-{}", std::process::id())).unwrap();
    let served = Served::start(&domain, file);
    let node = domain.node().unwrap();
    let [mut tour, mut regions] =
        [0, 1].map(|object| Client::open(&domain, &node, (model, object)));
    while tour.heartbeats() == 0 {
        assert!(served.runs());
        thread::sleep(Duration::from_millis(1));
    }
    tour.ask_tour();
    regions.ask_region(region);
    let (mut signs, mut answers) = (0, 0);
    loop {
        assert!(served.runs());
        while let Some(header) = regions.chunk() {
            if header.last == 1 {
                answers += 1;
                regions.ask_region(region);
            }
        }
        match tour.chunk() {
            Some(header) if header.count > 0 => break,
            Some(_) => signs += 1,
            None => thread::sleep(Duration::from_micros(500)),
        }
    }
    println!("{signs} signs of life before the first points, {answers} regions");
    assert!(signs >= 3 && answers >= 3, "{signs} {answers}");
}
