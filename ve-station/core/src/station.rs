//! The pure core of the station: requests in, chunks out. It opens no file, reads no clock, never
//! blocks.
//!
//! # What a client is believed to hold
//! A *session* is a client and an object. Per session the station counts, for every VSP, the
//! regions held that contain it. The answer to a subscription is the whole closure (ids, ascending)
//! and then the records whose count was 0. That belief is right as long as both sides have
//! processed the same requests in the same order, and it is thrown away whenever this is not
//! certain:
//!
//! - A new epoch of the session or a new incarnation of the client clears queue, numbers and
//!   belief. The client then says what it holds ([`protocol::RegionAction::Resident`]) and asks for
//!   the rest.
//! - A gap in the numbers of the requests *breaks* the epoch: queue and assumed residency are
//!   emptied and nothing of this epoch is listened to. The client is told once
//!   ([`ChunkHeader::of_gap`]) and starts a new epoch; where that chunk is lost, when it has heard
//!   nothing for [`protocol::ANSWER_TIMEOUT_MS`]. So a lost request can never leave a belief behind
//!   that the client does not share.
//! - A request of an older epoch, or of an incarnation that another has replaced, is ignored.
//!
//! One race remains that the station cannot see: a client that gives up a region while the answer
//! to an earlier question is still under way may have dropped records which that answer counts on.
//! The answer says of every VSP whether its record follows, so the client notices, and asks for
//! that region again with every record ([`protocol::RegionAction::Resend`]).
//!
//! # Turns
//! Closures, contacts and tours are worked on in steps, and [`Station::poll_within`] makes a few
//! for one client: so each has its turn, whatever the others ask for, and the shell listens and
//! sends heartbeats in between. Each session of a client begins in its turn too. While a session
//! waits for long, [`Station::poll_unfinished`] tells its client that it is being worked for.
//!
//! # Tours
//! A tour takes thousands of searches of the full mesh, seconds where that is dense. So it comes
//! after everything else that a client asked for. What was rolled is kept, whatever becomes of the
//! epoch, and it is rolled on from there. Whoever asks again says how many points came, and gets
//! those behind them: so nothing of a tour travels twice, also where another station goes on with
//! it. Where few chunks may be under way, at most a third of them are of tours, so that an answer
//! does not wait for many. Of a closure the search is kept.
//!
//! # Memory
//! Answers are made chunk by chunk under the credit window, as many to a chunk as there is room: of
//! a queued question only its name is kept, of the one being answered its closure, four bytes a
//! VSP. [`MAX_JOBS`] questions may wait; one more breaks the epoch. Of the tour that is rolled or
//! was rolled last the points are kept, eleven minutes of it at the most.

mod answer;
mod contacts;
mod path_generator;
mod requests;
mod residency_change;
mod session;

pub use session::MAX_JOBS;

use crate::collection::{CollectError, RegionAt};
use crate::tuning::service::{MAX_NOTES, SEARCHED_A_STEP};
use answer::{Job, Progress, blank};
use path_generator::PathGenerator;
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, ContactReport, Refusal, RegionAsk, Request,
};
use session::Session;
use spm::{NONE, RegionId, Sizes, SpmFile};
use std::collections::{BTreeMap, BTreeSet};

/// A chunk: header and slots.
pub type Chunk = (ChunkHeader, [ChunkSlot; CHUNK_SLOTS]);

/// Something that a controller said.
#[derive(Debug, Clone, Copy)]
pub enum Message<'a> {
    /// A question, or credit.
    Request(&'a Request),
    /// Where it is and what it touches.
    Contact(&'a ContactReport),
}

/// A model that the station serves.
#[derive(Debug)]
pub struct ServedModel<D> {
    /// Name for notes.
    pub name: String,
    /// Its file.
    pub file: SpmFile<D>,
}

/// An object of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServedObject {
    /// Index of its model.
    pub model: usize,
    /// [`Request::name_hash`] of the model's name in the scene.
    pub name: u64,
}

/// What happened since the start. Totals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counters {
    /// Requests processed.
    pub requests: u64,
    /// Messages ignored because they make no sense.
    pub damaged: u64,
    /// Requests ignored because they belong to the past.
    pub stale: u64,
    /// Epochs broken by a gap or by too many questions.
    pub broken_epochs: u64,
    /// Regions answered.
    pub regions: u64,
    /// Refusals answered.
    pub refused: u64,
    /// Chunks handed out.
    pub chunks: u64,
    /// Records in them.
    pub records: u64,
    /// Contacts measured.
    pub measured: u64,
    /// Contacts so far from the mesh that they were not measured.
    pub unmeasured: u64,
    /// Requests of clients turned away because others have every place.
    pub turned_away: u64,
}

/// The station's core.
#[derive(Debug)]
pub struct Station<D> {
    incarnation: u64,
    models: Vec<ServedModel<D>>,
    objects: Vec<ServedObject>,
    /// In the order in which they came.
    sessions: Vec<Session>,
    /// By client: the place of the session whose turn it is.
    turns: BTreeMap<u64, usize>,
    /// Refusals for clients that have no place; one each, and as many as there are places.
    turned_away: BTreeMap<u64, Chunk>,
    counters: Counters,
    /// Messages handled; the order in which clients were heard.
    heard: u64,
    clock_us: u32,
    /// Sentences for the shell to print.
    notes: Vec<String>,
    /// Refusals already put into words: (model, region).
    named: BTreeSet<(usize, u32)>,
}

impl<D: AsRef<[u8]>> Station<D> {
    /// A station of this incarnation that serves these objects.
    ///
    /// Objects whose model index has no model are refused when asked for.
    #[must_use]
    pub fn new(incarnation: u64, models: Vec<ServedModel<D>>, objects: Vec<ServedObject>) -> Self {
        Self {
            incarnation,
            models,
            objects,
            sessions: Vec::new(),
            turns: BTreeMap::new(),
            turned_away: BTreeMap::new(),
            counters: Counters::default(),
            heard: 0,
            clock_us: 0,
            notes: Vec::new(),
            named: BTreeSet::new(),
        }
    }

    /// Its incarnation, which every chunk carries.
    #[must_use]
    pub fn incarnation(&self) -> u64 {
        self.incarnation
    }

    /// Sizes of the model of an object; `None` for an object that it does not serve.
    #[must_use]
    pub fn sizes(&self, object: u32) -> Option<Sizes> {
        let object = self.objects.get(object as usize)?;
        let served = self.models.get(object.model)?;
        Some(served.file.model_header().sizes())
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Ids of the clients it knows, in the order in which they came.
    pub fn clients(&self) -> impl Iterator<Item = u64> + '_ {
        let mut seen = BTreeSet::new();
        let all = self.sessions.iter().map(|session| session.client);
        all.filter(move |&client| seen.insert(client))
    }

    /// Whether a client has a place.
    #[must_use]
    pub fn knows(&self, client: u64) -> bool {
        self.sessions.iter().any(|s| s.client == client)
    }

    /// What is to be told to clients that have no place here.
    pub fn take_turned_away(&mut self) -> impl Iterator<Item = (u64, Chunk)> {
        std::mem::take(&mut self.turned_away).into_iter()
    }

    /// Sentences for people (regions refused, requests for unknown models), each said once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Removes a client that has been silent for long. When it comes back, its
    /// epoch is incomplete here, so it starts another.
    pub fn remove_client(&mut self, client: u64) {
        self.sessions.retain(|s| s.client != client);
        self.turns.remove(&client);
    }

    /// Tells the time, microseconds from any start, modulo 2^32. Chunks carry the time that was
    /// told last, so that a client can tell what the link delays from what the station does. By it
    /// are also judged silences, and how long measured errors wait.
    pub fn tell_time(&mut self, clock_us: u32) {
        self.clock_us = clock_us;
    }

    /// Takes a message in. Whatever it holds, the worst that happens is that it is counted and
    /// ignored, or that it ends a session for good: a request has no checksum, and where a bit of
    /// its epoch or incarnation flips, all that its client asks in that session afterwards belongs
    /// to the past, until the client is removed or is another incarnation. So the transports have
    /// to deliver messages whole or not at all, as shared memory and TLS do.
    pub fn handle(&mut self, message: Message<'_>) {
        self.heard += 1;
        match message {
            Message::Request(request) => self.handle_request(request),
            Message::Contact(report) => self.handle_contact(report),
        }
    }

    /// The next chunk for a client, `None` when there is nothing to say or no credit left. Works
    /// for as long as a chunk takes.
    pub fn poll(&mut self, client: u64) -> Option<Chunk> {
        self.poll_within(client, &mut { u64::MAX })
    }

    /// Like [`Station::poll`], but works for so many steps at the most, and counts them down: a
    /// step of a tour is a search of the full mesh, one of a closure goes through
    /// `SEARCHED_A_STEP` VSPs. `None` with no steps left means that there may be more to say:
    /// call again.
    pub fn poll_within(&mut self, client: u64, steps: &mut u64) -> Option<Chunk> {
        if let Some(chunk) = self.tell_broken(client) {
            return Some(chunk);
        }
        self.measure_contacts(client, steps);
        self.each_in_turn(client, steps, Self::answer)
            .or_else(|| self.each_in_turn(client, steps, Self::roll))
    }

    /// What there is of an answer or tour that is being made in a session of a client, perhaps
    /// nothing at all, where that session has heard nothing for so many microseconds while it
    /// waited: a controller gives up each by itself, whatever comes in the others. `None` when
    /// there is none, or no credit.
    pub fn poll_unfinished(&mut self, client: u64, silent_us: u32) -> Option<Chunk> {
        let clock_us = self.clock_us;
        self.each_in_turn(client, &mut { u64::MAX }, |station, at, _| {
            if station.sessions[at].silence_us(clock_us) < silent_us {
                return None;
            }
            if let Some(chunk) = station.unfinished_answer(at) {
                return Some(station.send(at, chunk));
            }
            let session = &mut station.sessions[at];
            let generator = session.next_tour()?;
            Some(station.hand_out(at, generator))
        })
    }

    /// The first chunk that one of a client's sessions with credit has to give; the next time
    /// another begins, so that none waits for the end of what the others asked for.
    fn each_in_turn(
        &mut self,
        client: u64,
        steps: &mut u64,
        mut give: impl FnMut(&mut Self, usize, &mut u64) -> Option<Chunk>,
    ) -> Option<Chunk> {
        let count = self.sessions.len();
        let start = self.turns.get(&client).copied().unwrap_or(0);
        (0..count).find_map(|k| {
            let at = (start + k) % count;
            let session = &mut self.sessions[at];
            if session.client != client || !session.may_send() {
                return None;
            }
            let had_steps = *steps > 0;
            let chunk = give(self, at, steps);
            if chunk.is_some() || (had_steps && *steps == 0) {
                self.turns.insert(client, at + 1);
            }
            chunk
        })
    }

    /// Tells a client that the epoch of one of its sessions is broken, if it is to be told.
    fn tell_broken(&mut self, client: u64) -> Option<Chunk> {
        let mut sessions = self.sessions.iter_mut();
        let at = sessions.position(|s| s.client == client && s.take_broken())?;
        let (mut header, _) = blank(ChunkKind::Refused, self.sessions[at].object);
        self.address(at, &mut header);
        self.counters.chunks += 1;
        Some(header.of_gap())
    }

    /// The next chunk of a session but for tours.
    fn answer(&mut self, at: usize, steps: &mut u64) -> Option<Chunk> {
        if let Some(chunk) = self.sessions[at].measured_chunk(self.clock_us) {
            return Some(self.send(at, chunk));
        }
        if !self.apply_residency_changes(at, steps) {
            return None;
        }
        let mut job = self.sessions[at].jobs.pop_front()?;
        match self.advance(at, &mut job, steps) {
            Progress::Working => {
                self.sessions[at].jobs.push_front(job);
                None
            }
            Progress::Chunk(chunk) => {
                self.sessions[at].jobs.push_front(job);
                Some(self.send(at, chunk))
            }
            Progress::Last(chunk) => Some(self.send(at, chunk)),
        }
    }

    /// Rolls the tour that a session asked for first; a chunk when one is full.
    fn roll(&mut self, at: usize, steps: &mut u64) -> Option<Chunk> {
        let mut generator = self.sessions[at].next_tour()?;
        let served = &self.models[generator.model];
        match generator.roll(&served.file, steps) {
            Ok(true) => Some(self.hand_out(at, generator)),
            Ok(false) => {
                self.sessions[at].tours.push_front(generator);
                None
            }
            Err(_) => {
                let name = &served.name;
                let note = format!("a tour of {name} is refused: the file is damaged all over");
                self.note((generator.model, NONE), note);
                let object = self.sessions[at].object;
                let chunk = self.refused(object, None, Refusal::DamagedBlock);
                Some(self.send(at, chunk))
            }
        }
    }

    /// The next chunk of a tour, which waits for its turn again or is kept.
    fn hand_out(&mut self, at: usize, mut generator: PathGenerator) -> Chunk {
        let chunk = generator.chunk(self.sessions[at].object);
        if chunk.0.last == 1 {
            self.sessions[at].rolled = Some(generator);
        } else {
            self.sessions[at].tours.push_front(generator);
        }
        self.send(at, chunk)
    }

    /// Numbers a chunk and addresses it.
    fn send(&mut self, at: usize, (mut header, slots): Chunk) -> Chunk {
        self.address(at, &mut header);
        let session = &mut self.sessions[at];
        header.sequence = session.sent;
        header.waited_for_credit = u32::from(std::mem::take(&mut session.waits_for_credit));
        session.silent_since_us = self.clock_us;
        header.seal(&slots);
        session.sent += 1;
        self.counters.chunks += 1;
        (header, slots)
    }

    /// Says of a chunk from whom it comes, to whom it goes, and what it is about.
    fn address(&self, at: usize, header: &mut ChunkHeader) {
        let session = &self.sessions[at];
        header.station = self.incarnation;
        header.client = session.client;
        header.epoch = session.epoch;
        header.sent_us = self.clock_us;
        header.model = self
            .objects
            .get(header.object as usize)
            .and_then(|o| self.models.get(o.model))
            .map_or(0, |m| m.file.model_header().model);
    }

    /// Answers that a region which a client says it holds has no closure here.
    fn refuse_held(&mut self, at: usize, model: usize, ask: RegionAsk, error: &CollectError) {
        self.refuse_region(model, error);
        self.sessions[at].jobs.push_back(Job::Refused {
            ask: Some(ask),
            refusal: error.refusal(),
        });
    }

    fn refuse_region(&mut self, model: usize, error: &CollectError) {
        let note = format!("{}: {error}", self.models[model].name);
        self.note((model, error.asked().region.0), note);
    }

    fn note(&mut self, key: (usize, u32), note: String) {
        if self.named.len() < MAX_NOTES && self.named.insert(key) {
            self.notes.push(note);
        }
    }
}

/// The region and tolerance that an ask names.
fn region_at(ask: &RegionAsk) -> RegionAt {
    RegionAt {
        region: RegionId(ask.region),
        tolerance_bits: ask.tolerance_bits,
    }
}

#[cfg(test)]
mod tests;
