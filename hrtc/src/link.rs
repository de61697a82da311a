//! Connection agent of the controller: one thread that owns every iceoryx2 port.
//!
//! The tick uses no port: a loan allocates, and a receive may connect a new peer. Bounded rings
//! lie between the two threads: requests and contacts leave the tick, chunks enter it. A chunk is
//! taken from iceoryx2 only when the inbox has room, so none is dropped here. The credit window
//! bounds the number of waiting chunks.

use crate::message::note;
use crate::station_heard::StationHeard;
use crate::traffic::Traffic;
use crate::tuning::{
    CLEANUP_PERIOD, HELLO_PERIOD, INBOX_CAPACITY, LINK_END_TIMEOUT, LINK_POLL_PERIOD,
    LINK_STACK_BYTES, MAX_LOGGED_SENTENCES, SEARCH_PERIOD,
};
use bytemuck::Zeroable;
use hrtc_core::streaming::chunk::InboxChunk;
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::ipc;
use protocol::{
    CHUNK_SLOTS, ChunkDecoder, ChunkHeader, ChunkSlot, CompactError, ContactReport, Encoding,
    Hello, Request, RequestKind, Role,
};
use rtrb::{Consumer, Producer};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thiserror::Error;
use transport::{Domain, Heartbeats, MAX_QUEUED, RequestSender, TransportError, receive_in_turn};

/// Called with every chunk in the order of arrival, before the tick can see it.
pub type ChunkRecorder = Box<dyn FnMut(&InboxChunk) + Send>;

/// Identity and domain of the controller.
#[derive(Debug, Clone)]
pub struct LinkOptions {
    /// The iceoryx2 domain.
    pub domain: Domain,
    /// The client's id, the same after a restart or not.
    pub client: u64,
    /// Different at every start.
    pub incarnation: u64,
    /// How the station is to send its chunks: compact over a line, plain on this machine.
    pub encoding: Encoding,
}

/// The link's ends of the rings, and its news for the tick.
pub struct LinkEndpoints {
    /// Requests of the tick, ready to send.
    pub requests: Consumer<Request>,
    /// Contacts of the tick.
    pub contacts: Consumer<ContactReport>,
    /// The tick's inbox; room for [`INBOX_CAPACITY`].
    pub inbox: Producer<InboxChunk>,
    /// Incarnation of the station that is heard; 0 when there is none.
    pub station: Arc<AtomicU64>,
    /// Round-trip time that the tick has measured, microseconds; 0 before it has.
    pub round_trip_us: Arc<AtomicU32>,
    /// What crosses the link, by kind.
    pub traffic: Arc<Traffic>,
    /// Called for every arrival; `None` without a recording.
    pub recorder: Option<ChunkRecorder>,
}

/// Reasons of a link that does not start.
#[derive(Debug, Error)]
pub enum LinkError {
    /// iceoryx2 refused.
    #[error("{0}")]
    Transport(#[from] TransportError),
    /// The operating system gave no thread.
    #[error("cannot start the thread of the link: {0}")]
    Thread(#[from] std::io::Error),
}

/// Counters of the link since its start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LinkReport {
    /// Requests sent.
    pub requests: u64,
    /// Requests without a receiver, or that could not be sent. The next epoch asks for them again.
    pub undelivered: u64,
    /// Chunks received.
    pub chunks: u64,
    /// Those of them that came compact.
    pub compact: u64,
    /// Bytes of the chunks received as they came, headers too.
    pub bytes: u64,
    /// Chunks dropped: of a length that this version has not.
    pub foreign: u64,
    /// Chunks dropped: changed on their way. The gap that each leaves ends the epoch.
    pub damaged: u64,
    /// Chunks that came compact, after others that are missing: the epoch is over with them.
    pub unreadable: u64,
    /// Receives that found the inbox full.
    pub inbox_full: u64,
    /// Heartbeats refused: of another version or byte order, or none at all.
    pub refused: u64,
}

/// The connection agent.
#[derive(Debug)]
pub struct Link;

/// A running link. Dropping it stops it too.
#[derive(Debug)]
pub struct LinkHandle {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<LinkReport>>,
}

impl Link {
    /// Starts the thread; returns when its ports are open.
    ///
    /// # Errors
    /// When iceoryx2 refuses the domain, or there is no thread.
    pub fn spawn(options: LinkOptions, endpoints: LinkEndpoints) -> Result<LinkHandle, LinkError> {
        let stop = Arc::new(AtomicBool::new(false));
        let stop_thread = Arc::clone(&stop);
        let (opened, wait) = mpsc::sync_channel(1);
        let thread = thread::Builder::new()
            .name("hrtc-link".to_owned())
            .stack_size(LINK_STACK_BYTES)
            .spawn(move || match Ports::open(&options) {
                Ok(ports) => {
                    let _ = opened.send(Ok(()));
                    Agent::new(options, ports, endpoints).run(&stop_thread)
                }
                Err(error) => {
                    let _ = opened.send(Err(error));
                    LinkReport::default()
                }
            })?;
        let handle = LinkHandle {
            stop,
            thread: Some(thread),
        };
        match wait.recv() {
            Ok(result) => result?,
            Err(_) => return Err(std::io::Error::other("it ended before it began").into()),
        }
        Ok(handle)
    }
}

impl LinkHandle {
    /// Whether the thread has ended without having been asked to.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        !self.stop.load(Ordering::Relaxed) && self.thread.as_ref().is_some_and(|t| t.is_finished())
    }

    /// Sends what the tick left, closes its sessions and the ports, and waits for the thread, at
    /// most for [`LINK_END_TIMEOUT`]: `None` when it has panicked or hangs.
    #[must_use]
    pub fn stop(mut self) -> Option<LinkReport> {
        self.join()
    }

    fn join(&mut self) -> Option<LinkReport> {
        self.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.take()?;
        let asked = Instant::now();
        while !thread.is_finished() && asked.elapsed() < LINK_END_TIMEOUT {
            thread::sleep(LINK_POLL_PERIOD);
        }
        // A thread that hangs would keep the process from its end.
        thread.is_finished().then(|| thread.join().ok()).flatten()
    }
}

impl Drop for LinkHandle {
    fn drop(&mut self) {
        self.join();
    }
}

struct Ports {
    requests: RequestSender,
    contacts: Publisher<ipc::Service, ContactReport, ()>,
    records: Subscriber<ipc::Service, [ChunkSlot], ChunkHeader>,
    hello: Heartbeats,
    // Last, so that it is dropped after its ports.
    node: Node<ipc::Service>,
}

impl Ports {
    fn open(options: &LinkOptions) -> Result<Self, TransportError> {
        let domain = &options.domain;
        let node = domain.node()?;
        // The inbox before the first request, so that no answer is lost.
        let records = domain.records_service(&node, options.client)?;
        let records = domain.subscriber(&records, "receive records")?;
        let requests = domain.request_sender(&domain.subscribe_service(&node)?)?;
        let contacts = domain.publisher(&domain.pose_service(&node)?, "send contacts")?;
        Ok(Self {
            requests,
            contacts,
            records,
            hello: domain.heartbeats(&node)?,
            node,
        })
    }
}

/// State of the thread.
struct Agent {
    options: LinkOptions,
    ports: Ports,
    ends: LinkEndpoints,
    report: LinkReport,
    decoder: ChunkDecoder,
    station: StationHeard,
    /// Newest epoch of each session that was requested and not closed, by object.
    open_sessions: BTreeMap<u32, u32>,
    /// Sentences that were said.
    warned: BTreeSet<String>,
}

impl Agent {
    fn new(options: LinkOptions, ports: Ports, ends: LinkEndpoints) -> Self {
        Self {
            options,
            ports,
            ends,
            report: LinkReport::default(),
            decoder: ChunkDecoder::default(),
            station: StationHeard::default(),
            open_sessions: BTreeMap::new(),
            warned: BTreeSet::new(),
        }
    }

    fn run(mut self, stop: &AtomicBool) -> LinkReport {
        let (mut next_hello, mut next_cleanup) = (Instant::now(), Instant::now() + CLEANUP_PERIOD);
        loop {
            let ending = stop.load(Ordering::Relaxed);
            let now = Instant::now();
            self.receive(now);
            self.send();
            self.listen(now);
            if now >= next_hello {
                // A station answers the first one it hears at once.
                let is_alone = self.station.living(now) == 0;
                next_hello = now
                    + if is_alone {
                        SEARCH_PERIOD
                    } else {
                        HELLO_PERIOD
                    };
                let LinkOptions {
                    client,
                    incarnation,
                    ..
                } = self.options;
                let round_trip = self.ends.round_trip_us.load(Ordering::Relaxed);
                let round_trip = Duration::from_micros(round_trip.into());
                self.station.set_round_trip(round_trip);
                let hello = Hello::new(Role::Controller, incarnation, client);
                let hello = hello.with_round_trip(round_trip);
                self.ends.traffic.heartbeat();
                if let Err(e) = self.ports.hello.outgoing.send_copy(hello) {
                    self.warn_port("send heartbeats", e);
                }
            }
            if now >= next_cleanup {
                next_cleanup = now + CLEANUP_PERIOD;
                // The queues of a dead station stay until another process removes them.
                let _ = self.ports.node.try_cleanup_dead_nodes();
            }
            if ending {
                self.close_sessions();
                self.ends.station.store(0, Ordering::Release);
                return self.report;
            }
            thread::sleep(LINK_POLL_PERIOD);
        }
    }

    /// Moves chunks into the inbox while it has room; the others wait in iceoryx2's queue.
    fn receive(&mut self, now: Instant) {
        for _ in 0..INBOX_CAPACITY {
            if self.ends.inbox.is_full() {
                self.report.inbox_full += 1;
                return;
            }
            let sample = match self.ports.records.receive() {
                Ok(Some(sample)) => sample,
                Ok(None) => return,
                Err(e) => return self.warn_port("receive records", e),
            };
            let used = sample.payload().len();
            let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let Some(place) = slots.get_mut(..used) else {
                self.report.foreign += 1;
                continue;
            };
            // The copy is checked: its sender could change the sample still.
            place.copy_from_slice(sample.payload());
            let header = *sample.user_header();
            drop(sample);
            let Some(chunk) = self.decode(header, &slots[..used]) else {
                continue;
            };
            self.station.chunk(chunk.header.station, now);
            if let Some(record) = &mut self.ends.recorder {
                record(&chunk);
            }
            // There is room: only this thread fills the inbox.
            let _ = self.ends.inbox.push(chunk);
        }
    }

    /// The chunk that came in these slots; `None` where there is none to take.
    fn decode(&mut self, header: ChunkHeader, sent: &[ChunkSlot]) -> Option<InboxChunk> {
        let report = &mut self.report;
        match self.decoder.decode(&header, sent) {
            Ok(slots) => {
                report.chunks += 1;
                report.compact += u64::from(sent.len() < CHUNK_SLOTS);
                let bytes = size_of::<ChunkHeader>() + size_of_val(sent);
                report.bytes += bytes as u64;
                self.ends.traffic.chunk(header.kind, bytes);
                return Some(InboxChunk { header, slots });
            }
            Err(CompactError::Gap) => {
                report.unreadable += 1;
                // The tick ends the epoch as soon as it sees that something is missing.
                let (header, slots) = header.of_gap();
                return Some(InboxChunk { header, slots });
            }
            Err(CompactError::Length) => report.foreign += 1,
            Err(CompactError::Repeated) => {}
            Err(CompactError::Damaged) => {
                report.damaged += 1;
                self.warn_once(
                    "a chunk of the station arrived damaged; it is asked for again".to_owned(),
                );
            }
        }
        None
    }

    fn send(&mut self) {
        while let Ok(mut request) = self.ends.requests.pop() {
            request.encoding = self.options.encoding as u32;
            self.report.requests += 1;
            if request.kind == RequestKind::Close as u32 {
                self.open_sessions.remove(&request.object);
            } else {
                self.open_sessions.insert(request.object, request.epoch);
            }
            self.ends.traffic.request(&request);
            match self.ports.requests.send(&request) {
                Ok(0) => self.report.undelivered += 1,
                Ok(_) => {}
                Err(e) => {
                    self.report.undelivered += 1;
                    self.warn_port("send requests", e);
                }
            }
        }
        while let Ok(contact) = self.ends.contacts.pop() {
            self.ends.traffic.contact();
            // A lost contact costs one measured error.
            if let Err(e) = self.ports.contacts.send_copy(contact) {
                self.warn_port("send contacts", e);
            }
        }
    }

    /// Gives the place at the station back at once; else it is kept until this client was silent
    /// for long. A request in a new epoch is taken whatever became of the old one.
    fn close_sessions(&mut self) {
        for (object, epoch) in std::mem::take(&mut self.open_sessions) {
            let close = Request {
                client: self.options.client,
                incarnation: self.options.incarnation,
                object,
                epoch: epoch.saturating_add(1),
                kind: RequestKind::Close as u32,
                encoding: self.options.encoding as u32,
                ..Request::zeroed()
            };
            if let Err(e) = self.ports.requests.send(&close) {
                self.warn_port("send requests", e);
            }
        }
    }

    /// Receives heartbeats and publishes the station's incarnation to the tick.
    fn listen(&mut self, now: Instant) {
        let mut hellos = Vec::new();
        let incoming = &self.ports.hello.incoming;
        let received = receive_in_turn(
            || incoming.receive(),
            2 * MAX_QUEUED,
            |hello: &Hello| hellos.push(*hello),
        );
        if let Err(e) = received {
            self.warn_port("receive heartbeats", e);
        }
        for hello in hellos {
            self.ends.traffic.heartbeat_heard();
            match hello.read() {
                Ok(greeting) if greeting.role == Role::Station => {
                    self.station.heartbeat(greeting.incarnation, now);
                    if let Some(warning) = hello.other_build() {
                        self.warn_once(warning);
                    }
                }
                Ok(_) => {}
                Err(error) => {
                    self.report.refused += 1;
                    // Other controllers are none of this one's business.
                    if error.role() != Some(Role::Controller) {
                        self.warn_once(error.to_string());
                    }
                }
            }
        }
        let living = self.station.living(now);
        self.ends.station.store(living, Ordering::Release);
    }

    fn warn_port(&mut self, what: &'static str, reason: impl std::fmt::Debug) {
        let error = self.options.domain.error(what, reason);
        self.warn_once(error.to_string());
    }

    /// Says a sentence once, up to [`MAX_LOGGED_SENTENCES`].
    fn warn_once(&mut self, sentence: String) {
        if self.warned.len() < MAX_LOGGED_SENTENCES && !self.warned.contains(&sentence) {
            note!("{sentence}");
            self.warned.insert(sentence);
        }
    }
}
