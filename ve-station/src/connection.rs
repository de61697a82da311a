//! Connection agent of the station: the iceoryx2 ports around the pure [`Station`], on one thread.
//!
//! It polls: every fifth of a millisecond what came is handed to the core, and what the core has to
//! say is sent. Nothing here blocks, and what people are told, warnings too, is written by other
//! threads; what a full queue discards shows as a gap to the receiver, and epochs heal it. Between
//! two looks at the ports each client has a turn of a few steps; a session that waits for long, as
//! for a tour or the closure of a whole model, is told in time that it is being made.

use crate::clients::{ClientStatus, Clients};
use crate::telling::Teller;
use crate::tuning::link::{
    ANSWERED_HELLO, CLEANUP, FILE_CHUNKS_A_TURN, FILES_ASKED, FORGET, HELLO, MAKE_ROOM, MAX_SAID,
    POLL, REOPEN, STATUS, STEPS_A_TURN, TOLD_US, TURNED_AWAY,
};
use file_transfer::FileServer;
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{PortFactory as _, ipc};
use protocol::{
    ChunkEncoder, ChunkHeader, ChunkSlot, ContactReport, Encoding, Hello, MAX_CLIENTS, Request,
    RequestKind, RequestWord, Role,
};
use station_core::station::{Chunk, Message, Station};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;
use transport::{Domain, Heartbeats, MAX_QUEUED, Topic, TransportError, receive_in_turn};

/// A station on its topics. Create it on the thread that runs it.
#[derive(Debug)]
pub struct Connection<D> {
    station: Station<D>,
    /// Its clock's start.
    began: Instant,
    files: FileServer,
    ports: Ports,
    clients: Clients,
    /// Heartbeats refused: of another version or byte order, or none at all.
    refused: u64,
    /// Clients that are being worked for.
    waiting: BTreeSet<u64>,
    /// Coders of the clients that asked for compact chunks.
    encoders: BTreeMap<u64, ChunkEncoder>,
    /// Clients that asked for files, and when.
    asked_for_files: BTreeMap<u64, Instant>,
    /// Whether a heartbeat came from a client without a session since this station's last one.
    is_greeted: bool,
    /// Clients turned away, and when.
    turned_away: BTreeMap<u64, Instant>,
    /// Sentences about peers already said.
    said: BTreeSet<String>,
    /// Tells who is connected, while it serves.
    teller: Teller,
}

#[derive(Debug)]
struct Ports {
    domain: Domain,
    requests: Subscriber<ipc::Service, [RequestWord], ()>,
    contacts: Subscriber<ipc::Service, ContactReport, ()>,
    hello: Heartbeats,
    records: BTreeMap<u64, Records>,
    /// Clients whose topic could not be opened, and when.
    unopened: BTreeMap<u64, Instant>,
    // Last, so that it goes last.
    node: Node<ipc::Service>,
}

/// The topic of one client.
#[derive(Debug)]
struct Records {
    publisher: Publisher<ipc::Service, [ChunkSlot], ChunkHeader>,
    // Last, so that it goes last.
    topic: Topic<[ChunkSlot], ChunkHeader>,
}

impl Ports {
    fn open(domain: &Domain) -> Result<Self, TransportError> {
        let node = domain.node()?;
        let requests = domain.subscriber(&domain.subscribe_service(&node)?, "receive requests")?;
        let contacts = domain.subscriber(&domain.pose_service(&node)?, "receive contacts")?;
        Ok(Self {
            domain: domain.clone(),
            requests,
            contacts,
            hello: domain.heartbeats(&node)?,
            records: BTreeMap::new(),
            unopened: BTreeMap::new(),
            node,
        })
    }

    /// The topic of one client, opened when first needed; whether it is open. It takes files and
    /// shared memory, so that a crowd of new clients would keep all others waiting: only one is
    /// opened where `may_open` says so, which it does no more after that. One that cannot be opened
    /// does not count and is left alone for [`REOPEN`], else no other would ever be opened.
    fn open_records(
        &mut self,
        client: u64,
        now: Instant,
        may_open: &mut bool,
    ) -> Result<bool, TransportError> {
        if self.records.contains_key(&client) {
            return Ok(true);
        }
        self.unopened
            .retain(|_, &mut since| now.duration_since(since) < REOPEN);
        if !*may_open || self.unopened.contains_key(&client) {
            return Ok(false);
        }
        match self.new_records(client) {
            Ok(records) => {
                *may_open = false;
                self.records.insert(client, records);
                Ok(true)
            }
            Err(error) => {
                self.unopened.insert(client, now);
                Err(error)
            }
        }
    }

    /// In one try: nobody waits for it.
    fn new_records(&self, client: u64) -> Result<Records, TransportError> {
        let topic = self.domain.try_records_service(&self.node, client)?;
        Ok(Records {
            publisher: self.domain.records_publisher(&topic)?,
            topic,
        })
    }

    /// Whether anybody listens to the topic of a client. A tunnel learns of it from the other
    /// machine, which may take longer than the first request: what is sent before is lost.
    fn is_heard(&self, client: u64) -> bool {
        let records = self.records.get(&client);
        records.is_some_and(|of| of.topic.dynamic_config().number_of_subscribers() > 0)
    }

    /// Closes the topic of one client that is not kept, if there is such a one.
    fn close_records(&mut self, is_kept: impl Fn(u64) -> bool) {
        let gone = self.records.keys().find(|&&client| !is_kept(client));
        if let Some(&gone) = gone {
            self.records.remove(&gone);
        }
    }

    /// Sends a chunk; its bytes.
    fn send(
        &self,
        client: u64,
        header: &ChunkHeader,
        slots: &[ChunkSlot],
    ) -> Result<usize, TransportError> {
        let Some(records) = self.records.get(&client) else {
            return Ok(0);
        };
        let mut sample = records
            .publisher
            .loan_slice_uninit(slots.len())
            .map_err(|e| self.domain.error("send records", e))?;
        *sample.user_header_mut() = *header;
        // How many got it does not matter: who did not sees the gap.
        sample
            .write_from_slice(slots)
            .send()
            .map_err(|e| self.domain.error("send records", e))?;
        Ok(size_of_val(header) + size_of_val(slots))
    }
}

impl<D: AsRef<[u8]>> Connection<D> {
    /// Opens the topics of a domain for a station.
    ///
    /// # Errors
    /// When iceoryx2 refuses, after three tries.
    pub fn open(domain: &Domain, station: Station<D>) -> Result<Self, TransportError> {
        Ok(Self {
            files: FileServer::empty(station.incarnation()),
            asked_for_files: BTreeMap::new(),
            station,
            began: Instant::now(),
            ports: Ports::open(domain)?,
            clients: Clients::default(),
            refused: 0,
            waiting: BTreeSet::new(),
            encoders: BTreeMap::new(),
            is_greeted: false,
            turned_away: BTreeMap::new(),
            said: BTreeSet::new(),
            teller: Teller::default(),
        })
    }

    /// Gives these files away to whoever asks; without them every such question is refused.
    #[must_use]
    pub fn with_files(self, files: FileServer) -> Self {
        Self { files, ..self }
    }

    /// The core, for its counters.
    #[must_use]
    pub fn station(&self) -> &Station<D> {
        &self.station
    }

    /// Heartbeats refused so far.
    #[must_use]
    pub fn refused_heartbeats(&self) -> u64 {
        self.refused
    }

    /// The files of the scene, for their counters.
    #[must_use]
    pub fn files(&self) -> &FileServer {
        &self.files
    }

    /// Serves until `stop` is set. Trouble with one client or one message is logged, once, and
    /// service goes on.
    pub fn run(&mut self, stop: &AtomicBool) {
        self.run_telling(stop, |_| ());
    }

    /// The same, and tells every second who is connected. `tell` may hang, as in a write to a
    /// terminal that is paused: it has a thread of its own, and what is to be told meanwhile is
    /// left out. At the end it is dropped there, which is waited for, but not for long: one that
    /// hangs is not dropped.
    pub fn run_telling(
        &mut self,
        stop: &AtomicBool,
        tell: impl FnMut(&[ClientStatus]) + Send + 'static,
    ) {
        // Whoever runs it may hold none.
        let _lines = transport::logging::queue();
        self.teller = Teller::start(tell);
        let (mut next_hello, mut next_cleanup) = (Instant::now(), Instant::now() + CLEANUP);
        let (mut next_status, mut last_hello) = (next_cleanup, next_hello);
        while !stop.load(Ordering::Relaxed) {
            let now = Instant::now();
            self.receive(now);
            self.send(now);
            // A controller that looks for a station need not wait for the next heartbeat.
            if self.is_greeted {
                next_hello = next_hello.min(last_hello + ANSWERED_HELLO);
            }
            if now >= next_hello {
                last_hello = now;
                next_hello = now + HELLO;
                self.is_greeted = false;
                let hello = Hello::new(Role::Station, self.station.incarnation(), 0);
                if let Err(e) = self.ports.hello.outgoing.send_copy(hello) {
                    let error = self.ports.domain.error("send heartbeats", e);
                    self.warn_once(error.to_string());
                }
            }
            if now >= next_cleanup {
                next_cleanup = now + CLEANUP;
                self.forget_silent(now);
                // A peer that died leaves its files and queues to whoever looks.
                let _ = self.ports.node.try_cleanup_dead_nodes();
            }
            if now >= next_status {
                next_status = now + STATUS;
                if let Some(warning) = self.teller.status(self.clients.tell(now)) {
                    self.warn_once(warning.to_owned());
                }
            }
            if self.waiting.is_empty() {
                std::thread::sleep(POLL);
            }
        }
        if let Some(warning) = self.teller.end() {
            self.warn_once(warning.to_owned());
        }
    }

    /// Takes in what came. Each port at most twice its buffer, so that a flood cannot stop the
    /// sending, and each sender in its turn, so that it cannot silence the others.
    fn receive(&mut self, now: Instant) {
        // From here on what is asked waits.
        self.tell_time();
        let most = 2 * MAX_QUEUED;
        let mut hellos = Vec::new();
        let incoming = &self.ports.hello.incoming;
        let received = receive_in_turn(
            || incoming.receive(),
            most,
            |hello: &Hello| hellos.push(*hello),
        );
        self.check("receive heartbeats", received);
        for hello in hellos {
            self.hear(&hello, now);
        }
        let (station, clients, encoders) =
            (&mut self.station, &mut self.clients, &mut self.encoders);
        let files = &mut self.files;
        let requests = &self.ports.requests;
        let received = receive_in_turn(
            || requests.receive(),
            most,
            |words| {
                let request = Request::of_words(words);
                if request.kind == RequestKind::File as u32 {
                    files.handle(&request);
                    return;
                }
                station.handle(Message::Request(&request));
                let client = request.client;
                let is_known = station.knows(client);
                if is_known {
                    clients.asks(client, now);
                } else {
                    clients.remove(client);
                }
                if is_known && Encoding::from_code(request.encoding) == Some(Encoding::Compact) {
                    encoders.entry(client).or_default();
                } else {
                    encoders.remove(&client);
                }
            },
        );
        self.check("receive requests", received);
        let station = &mut self.station;
        let contacts = &self.ports.contacts;
        let received = receive_in_turn(
            || contacts.receive(),
            most,
            |&report: &ContactReport| {
                station.handle(Message::Contact(&report));
            },
        );
        self.check("receive contacts", received);
        for note in self.station.take_notes() {
            tracing::warn!("{note}");
        }
    }

    /// Takes a heartbeat. Whoever's is refused is not served either: the topics of another version
    /// have other names, and in a request of the other byte order no number makes sense.
    fn hear(&mut self, hello: &Hello, now: Instant) {
        match hello.read() {
            Ok(greeting) if greeting.role == Role::Controller => {
                self.is_greeted |= !self.station.knows(greeting.client);
                self.clients
                    .greets(greeting.client, greeting.round_trip, now);
                if let Some(warning) = hello.other_build() {
                    self.warn_once(warning);
                }
            }
            Ok(greeting) => {
                if greeting.incarnation != self.station.incarnation() {
                    let domain = self.ports.domain.name();
                    self.warn_once(format!(
                        "another station serves the domain \"{domain}\": stop one of them, or choose another --domain"
                    ));
                }
            }
            Err(error) => {
                self.refused += 1;
                self.warn_once(error.to_string());
            }
        }
    }

    /// Sends what the core has to say, as far as credit goes and a few steps for each client lead.
    fn send(&mut self, now: Instant) {
        let clients: Vec<u64> = self.station.clients().collect();
        let mut may_open = true;
        self.turned_away
            .retain(|_, &mut since| now.duration_since(since) < TURNED_AWAY);
        let turned_away: Vec<(u64, Chunk)> = self.station.take_turned_away().collect();
        for (client, chunk) in turned_away {
            if self.turned_away.len() < MAX_CLIENTS || self.turned_away.contains_key(&client) {
                self.turned_away.insert(client, now);
                // Without a topic it asks again, and is told then.
                if self.has_topic(client, now, &mut may_open) {
                    self.send_chunk(client, &chunk);
                }
            }
        }
        self.send_files(now, &mut may_open);
        // A client that the core forgot keeps no topic.
        let (turned_away, asked) = (&self.turned_away, &self.asked_for_files);
        let is_other = |id| turned_away.contains_key(&id) || asked.contains_key(&id);
        self.ports
            .close_records(|id| clients.contains(&id) || is_other(id));
        self.waiting.retain(|id| clients.contains(id));
        self.encoders.retain(|id, _| clients.contains(id));
        for client in clients {
            if self.has_topic(client, now, &mut may_open) && self.ports.is_heard(client) {
                self.give_turn(client);
            } else {
                self.waiting.remove(&client);
            }
        }
        for note in self.station.take_notes() {
            tracing::warn!("{note}");
        }
    }

    /// Whether the topic of a client is open: see [`Ports::open_records`].
    fn has_topic(&mut self, client: u64, now: Instant, may_open: &mut bool) -> bool {
        let opened = self.ports.open_records(client, now, may_open);
        opened.unwrap_or_else(|error| {
            self.warn_once(error.to_string());
            false
        })
    }

    /// Works for a client for a few steps, and sends it what there is. A session that has heard
    /// nothing for long is told that it is being worked for, whatever the client's others got.
    fn give_turn(&mut self, client: u64) {
        self.tell_time();
        let mut steps = STEPS_A_TURN;
        while let Some(chunk) = self.station.poll_within(client, &mut steps) {
            self.send_chunk(client, &chunk);
        }
        if steps > 0 {
            self.waiting.remove(&client);
            return;
        }
        self.waiting.insert(client);
        // The steps may have taken long, on a slow disk.
        self.tell_time();
        if let Some(chunk) = self.station.poll_unfinished(client, TOLD_US) {
            self.send_chunk(client, &chunk);
        }
    }

    fn tell_time(&mut self) {
        let clock = self.began.elapsed();
        self.station.tell_time(clock.as_micros() as u32);
    }

    /// Sends a few chunks of files to each client that waits for some. Who does not listen for
    /// [`FILES_ASKED`] is not waited for: it asks again.
    fn send_files(&mut self, now: Instant, may_open: &mut bool) {
        let files = &mut self.files;
        self.asked_for_files.retain(|&client, &mut since| {
            let is_awaited = now.duration_since(since) < FILES_ASKED;
            if !is_awaited {
                files.drop_questions(client);
            }
            is_awaited
        });
        let waiting: Vec<u64> = self.files.clients().collect();
        for client in waiting {
            let is_known = self.asked_for_files.contains_key(&client);
            if !is_known && self.asked_for_files.len() == MAX_CLIENTS {
                continue;
            }
            if !self.has_topic(client, now, may_open) {
                continue;
            }
            if !self.ports.is_heard(client) {
                // Its topic stays open, so that it is opened once.
                self.asked_for_files.entry(client).or_insert(now);
                continue;
            }
            self.asked_for_files.insert(client, now);
            for _ in 0..FILE_CHUNKS_A_TURN {
                let Some(chunk) = self.files.poll(client) else {
                    break;
                };
                self.send_chunk(client, &chunk);
            }
        }
    }

    fn send_chunk(&mut self, client: u64, (header, slots): &Chunk) {
        let encoder = self.encoders.get_mut(&client);
        let compact =
            encoder.and_then(|of| of.encode(header, slots, self.station.sizes(header.object)));
        let slots = compact.as_deref().unwrap_or(slots);
        match self.ports.send(client, header, slots) {
            Ok(bytes) => self.clients.sent(client, bytes),
            Err(error) => self.warn_once(error.to_string()),
        }
    }

    fn forget_silent(&mut self, now: Instant) {
        let station = &mut self.station;
        let timeout = if self.turned_away.is_empty() {
            FORGET
        } else {
            MAKE_ROOM
        };
        self.clients
            .forget_silent(timeout, now, |client| station.remove_client(client));
    }

    fn check(&mut self, what: &'static str, done: Result<(), impl std::fmt::Debug>) {
        if let Err(reason) = done {
            let error = self.ports.domain.error(what, reason);
            self.warn_once(error.to_string());
        }
    }

    /// Logs a warning the first time it occurs.
    fn warn_once(&mut self, sentence: String) {
        if self.said.len() < MAX_SAID && !self.said.contains(&sentence) {
            tracing::warn!("{sentence}");
            self.said.insert(sentence);
        }
    }
}

#[cfg(test)]
mod tests;
