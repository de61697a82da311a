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
//!   belief. The client then says what it holds ([`RegionAction::Resident`]) and asks for the rest.
//! - A gap in the numbers of the requests *breaks* the epoch: queue and assumed residency are
//!   emptied, nothing
//!   more is sent and nothing of this epoch is listened to. The client, hearing nothing for
//!   [`protocol::ANSWER_TIMEOUT_MS`], starts a new epoch. So a lost request can never leave a
//!   belief behind that the client does not share.
//! - A request of an older epoch, or of an incarnation that another has replaced, is ignored.
//!
//! One race remains that the station cannot see: a client that gives up a region while the answer
//! to an earlier question is still under way may have dropped records which that answer counts on.
//! The answer says of every VSP whether its record follows, so the client notices, and asks for
//! that region again with every record ([`RegionAction::Resend`]).
//!
//! # Tours
//! A tour takes thousands of searches of the full mesh, seconds where that is dense. So it comes
//! after everything else that a client asked for, and [`Station::poll_within`] makes a few steps of
//! it at a time, between which the shell listens to others. What was rolled is kept, whatever
//! becomes of the epoch: whoever asks for the same tour again gets it from the start, and it is
//! rolled on from where it was.
//!
//! # Memory
//! Answers are made chunk by chunk under the credit window, as many to a chunk as there is room: of
//! a queued question only its name is kept, of the one being answered its closure, four bytes a
//! VSP. [`MAX_JOBS`] questions may wait; one more breaks the epoch. Of the tour that is rolled or
//! was rolled last the points are kept, eleven minutes of it at the most.

mod answer;
mod path_generator;
mod session;

pub use session::MAX_JOBS;

use crate::collection::{CollectError, Collection, RegionAt};
use answer::{Job, Progress};
use glam::DVec3;
use path_generator::PathGenerator;
use protocol::MAX_CLIENTS;
use protocol::{
    CHUNK_SLOTS, ChunkHeader, ChunkSlot, ContactReport, MAX_SESSIONS, MeasuredError,
    REGIONS_PER_REQUEST, Refusal, RegionAction, RegionAsk, Request, RequestKind,
};
use session::{Accepted, Session};
use spm::{NONE, RegionId, SpmFile};
use std::collections::BTreeSet;

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
    /// Clients forgotten to make room.
    pub forgotten: u64,
}

/// A model with its search.
#[derive(Debug)]
struct Model<D> {
    served: ServedModel<D>,
    collection: Collection,
}

impl<D: AsRef<[u8]>> Model<D> {
    fn closure(&mut self, asked: RegionAt) -> Result<Vec<u32>, CollectError> {
        self.collection.closure(&self.served.file, asked)
    }
}

/// The station's core.
#[derive(Debug)]
pub struct Station<D> {
    incarnation: u64,
    models: Vec<Model<D>>,
    objects: Vec<ServedObject>,
    /// In the order in which they came.
    sessions: Vec<Session>,
    /// Sessions served so far: whose turn it is.
    turns: usize,
    counters: Counters,
    /// Messages handled; the order in which clients were heard.
    heard: u64,
    /// Sentences for the shell to print.
    notes: Vec<String>,
    /// Refusals already put into words: (model, region).
    named: BTreeSet<(usize, u32)>,
}

/// Sentences kept until the shell takes them, and refusals worded at the most.
const MAX_NOTES: usize = 256;

impl<D: AsRef<[u8]>> Station<D> {
    /// A station of this incarnation that serves these objects.
    ///
    /// Objects whose model index has no model are refused when asked for.
    #[must_use]
    pub fn new(incarnation: u64, models: Vec<ServedModel<D>>, objects: Vec<ServedObject>) -> Self {
        let models = models
            .into_iter()
            .map(|served| Model {
                collection: Collection::new(served.file.model_header().vsps),
                served,
            })
            .collect();
        Self {
            incarnation,
            models,
            objects,
            sessions: Vec::new(),
            turns: 0,
            counters: Counters::default(),
            heard: 0,
            notes: Vec::new(),
            named: BTreeSet::new(),
        }
    }

    /// Its incarnation, which every chunk carries.
    #[must_use]
    pub fn incarnation(&self) -> u64 {
        self.incarnation
    }

    /// What happened so far.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Ids of the clients it knows, in the order in which they came.
    pub fn clients(&self) -> impl Iterator<Item = u64> + '_ {
        let sessions = self.sessions.iter().enumerate();
        sessions
            .filter(|&(at, session)| self.first_of(session.client) == Some(at))
            .map(|(_, session)| session.client)
    }

    /// The place of a client's first session.
    fn first_of(&self, client: u64) -> Option<usize> {
        self.sessions.iter().position(|s| s.client == client)
    }

    /// Sentences for people (regions refused, requests for unknown models), each said once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Removes a client that has been silent for long. When it comes back, its
    /// epoch is incomplete here, so it starts another.
    pub fn remove_client(&mut self, client: u64) {
        self.sessions.retain(|s| s.client != client);
    }

    /// Takes a message in. Whatever it holds, the worst that happens is that it is counted and
    /// ignored.
    pub fn handle(&mut self, message: Message<'_>) {
        self.heard += 1;
        match message {
            Message::Request(request) => self.handle_request(request),
            Message::Contact(report) => self.handle_contact(report),
        }
    }

    /// The next chunk for a client, `None` when there is nothing to say or no credit left. Rolls a
    /// tour for as long as a chunk of it takes.
    pub fn poll(&mut self, client: u64) -> Option<Chunk> {
        self.poll_within(client, &mut { u64::MAX })
    }

    /// Like [`Station::poll`], but rolls a tour for so many steps at the most (each a search of the
    /// full mesh), and counts them down. `None` with no steps left means that there may be more to
    /// say: call again.
    pub fn poll_within(&mut self, client: u64, steps: &mut u64) -> Option<Chunk> {
        self.each_in_turn(client, |station, at| station.answer(at))
            .or_else(|| self.each_in_turn(client, |station, at| station.roll(at, steps)))
    }

    /// What there is of a tour that is being rolled for a client, perhaps no point at all: so that
    /// it knows that it is not forgotten. `None` when there is no such tour, or no credit.
    pub fn poll_unfinished(&mut self, client: u64) -> Option<Chunk> {
        self.each_in_turn(client, |station, at| {
            let generator = station.sessions[at].tours.pop_front()?;
            Some(station.hand_out(at, generator))
        })
    }

    /// The first chunk that one of a client's sessions with credit has to give; the next time
    /// another begins, so that none waits for the end of what the others asked for.
    fn each_in_turn(
        &mut self,
        client: u64,
        mut give: impl FnMut(&mut Self, usize) -> Option<Chunk>,
    ) -> Option<Chunk> {
        let count = self.sessions.len();
        let start = self.turns;
        (0..count).find_map(|k| {
            let at = (start + k) % count;
            let session = &self.sessions[at];
            if session.client != client || !session.has_credit() {
                return None;
            }
            let chunk = give(self, at)?;
            self.turns = at + 1;
            Some(chunk)
        })
    }

    /// The next chunk of a session but for tours.
    fn answer(&mut self, at: usize) -> Option<Chunk> {
        if let Some(chunk) = self.sessions[at].measured_chunk() {
            return Some(self.send(at, chunk));
        }
        let mut job = self.sessions[at].jobs.pop_front()?;
        match self.advance(at, &mut job) {
            Progress::Chunk(chunk) => {
                self.sessions[at].jobs.push_front(job);
                Some(self.send(at, chunk))
            }
            Progress::Last(chunk) => Some(self.send(at, chunk)),
        }
    }

    /// Rolls the tour that a session asked for first; a chunk when one is full.
    fn roll(&mut self, at: usize, steps: &mut u64) -> Option<Chunk> {
        let mut generator = self.sessions[at].tours.pop_front()?;
        let served = &self.models[generator.model].served;
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
        let session = &mut self.sessions[at];
        header.station = self.incarnation;
        header.client = session.client;
        header.epoch = session.epoch;
        header.sequence = session.sent;
        header.model = self
            .objects
            .get(header.object as usize)
            .and_then(|o| self.models.get(o.model))
            .map_or(0, |m| m.served.file.model_header().model);
        session.sent += 1;
        self.counters.chunks += 1;
        (header, slots)
    }

    fn handle_request(&mut self, request: &Request) {
        let Some(kind) = RequestKind::from_code(request.kind) else {
            self.counters.damaged += 1;
            return;
        };
        let asks = match request.regions.get(..request.count as usize) {
            Some(asks) if kind == RequestKind::Regions => asks,
            None if kind == RequestKind::Regions => {
                debug_assert!(request.count as usize > REGIONS_PER_REQUEST);
                self.counters.damaged += 1;
                return;
            }
            _ => &[],
        };
        let at = self.session_of(request);
        match self.sessions[at].accept(request, self.heard) {
            Accepted::Yes => self.counters.requests += 1,
            Accepted::Stale => {
                self.counters.stale += 1;
                return;
            }
            Accepted::Broken => {
                self.counters.broken_epochs += 1;
                return;
            }
            Accepted::Damaged => {
                self.counters.damaged += 1;
                return;
            }
        }
        match kind {
            RequestKind::Credit => {}
            RequestKind::Model => self.ask_model(at, request),
            RequestKind::Tour => self.ask_tour(at, request),
            RequestKind::Regions => {
                for ask in asks {
                    self.ask_region(at, request, ask);
                }
            }
            RequestKind::Close => {
                self.sessions.remove(at);
                return;
            }
        }
        if self.sessions[at].asks_too_much() {
            self.sessions[at].break_epoch();
            self.counters.broken_epochs += 1;
        }
    }

    /// The session of a request. Of too many clients the stalest makes room for a new one, of too
    /// many sessions of one client its stalest.
    fn session_of(&mut self, request: &Request) -> usize {
        let (client, object) = (request.client, request.object);
        let is_of = |s: &Session| s.client == client && s.object == object;
        if let Some(at) = self.sessions.iter().position(is_of) {
            return at;
        }
        let is_known = self.first_of(client).is_some();
        if !is_known && self.clients().count() == MAX_CLIENTS {
            let heard = |id: u64| self.sessions.iter().filter(move |s| s.client == id);
            let stalest = self
                .clients()
                .min_by_key(|&id| heard(id).map(|s| s.last_heard).max());
            if let Some(stalest) = stalest {
                self.remove_client(stalest);
            }
            self.counters.forgotten += 1;
        }
        let own = || (0..self.sessions.len()).filter(|&at| self.sessions[at].client == client);
        if own().count() == MAX_SESSIONS
            && let Some(stalest) = own().min_by_key(|&at| self.sessions[at].last_heard)
        {
            self.sessions.remove(stalest);
        }
        self.sessions.push(Session::new(request));
        self.sessions.len() - 1
    }

    /// The model of a request's object, when both mean the same.
    fn model_of(&self, request: &Request, by_name: bool) -> Option<usize> {
        let object = self.objects.get(request.object as usize)?;
        let model = self.models.get(object.model)?;
        let hash = model.served.file.model_header().model;
        let same = if by_name {
            request.name == object.name && (request.model == 0 || request.model == hash)
        } else {
            request.model == hash
        };
        same.then_some(object.model)
    }

    fn ask_model(&mut self, at: usize, request: &Request) {
        match self.model_of(request, true) {
            Some(model) => self.sessions[at].jobs.push_back(Job::Model {
                model,
                next_slot: 0,
            }),
            None => self.refuse_model(at, request),
        }
    }

    fn ask_tour(&mut self, at: usize, request: &Request) {
        let Some(model) = self.model_of(request, true) else {
            self.refuse_model(at, request);
            return;
        };
        let ask = request.tour;
        let session = &mut self.sessions[at];
        if let Some(mut rolled) = session.rolled.take_if(|r| r.serves(&ask)) {
            rolled.again();
            session.tours.push_back(rolled);
            return;
        }
        match PathGenerator::new(&self.models[model].served.file, model, ask) {
            Ok(generator) => session.tours.push_back(generator),
            Err(error) => {
                let name = &self.models[model].served.name;
                let note = format!("a tour of {name} is refused: {error}");
                self.note((model, NONE), note);
                self.sessions[at].jobs.push_back(Job::Refused {
                    ask: None,
                    refusal: error.refusal(),
                });
            }
        }
    }

    fn refuse_model(&mut self, at: usize, request: &Request) {
        let object = request.object;
        self.note(
            (usize::MAX, object),
            format!(
                "a controller asked for another model of object {object} than this scene names: start both with the same scene and options"
            ),
        );
        self.sessions[at].jobs.push_back(Job::Refused {
            ask: None,
            refusal: Refusal::UnknownModel,
        });
    }

    fn ask_region(&mut self, at: usize, request: &Request, ask: &RegionAsk) {
        let Some(action) = RegionAction::from_code(ask.action) else {
            self.counters.damaged += 1;
            return;
        };
        let refused = |refusal| Job::Refused {
            ask: Some(*ask),
            refusal,
        };
        let Some(model) = self.model_of(request, false) else {
            if action != RegionAction::Release {
                self.sessions[at]
                    .jobs
                    .push_back(refused(Refusal::UnknownModel));
            }
            return;
        };
        let region = region_at(ask);
        let vsps = self.models[model].served.file.model_header().vsps;
        match action {
            RegionAction::Subscribe => self.sessions[at].subscribe(model, *ask, false),
            RegionAction::Resend => self.sessions[at].subscribe(model, *ask, true),
            RegionAction::Resident => match self.models[model].closure(region) {
                Ok(mut closure) => {
                    self.sessions[at]
                        .residency
                        .insert(region, &mut closure, vsps);
                }
                Err(error) => {
                    let job = refused(error.refusal());
                    self.refuse_region(model, &error);
                    self.sessions[at].jobs.push_back(job);
                }
            },
            RegionAction::Release => {
                self.sessions[at].cancel(region);
                if !self.sessions[at].residency.holds(region) {
                    return;
                }
                match self.models[model].closure(region) {
                    Ok(closure) => self.sessions[at].residency.remove(region, &closure),
                    // It was readable when it was taken in. Without it the belief cannot be kept.
                    Err(_) => self.sessions[at].break_epoch(),
                }
            }
        }
    }

    fn refuse_region(&mut self, model: usize, error: &CollectError) {
        let note = format!("{}: {error}", self.models[model].served.name);
        self.note((model, error.asked().region.0), note);
    }

    fn note(&mut self, key: (usize, u32), note: String) {
        if self.named.len() < MAX_NOTES && self.named.insert(key) {
            self.notes.push(note);
        }
    }

    fn handle_contact(&mut self, report: &ContactReport) {
        let mut sessions = self.sessions.iter_mut();
        if report.object == NONE {
            for session in sessions.filter(|s| s.client == report.client) {
                session.flush_measured(report.probe);
            }
            return;
        }
        let is_of = |s: &&mut Session| s.client == report.client && s.object == report.object;
        let Some(session) = sessions.find(is_of) else {
            self.counters.stale += 1;
            return;
        };
        let model = self
            .objects
            .get(report.object as usize)
            .and_then(|o| self.models.get(o.model));
        let found = model.map(|m| {
            let contact = DVec3::from_array(report.contact);
            m.served.file.closest_point(contact)
        });
        match found {
            Some(Ok((_, closest))) => {
                self.counters.measured += 1;
                session.push_measured(
                    report.probe,
                    MeasuredError {
                        tick: report.tick,
                        distance: closest.distance_squared.sqrt(),
                        reserved: [0; 2],
                    },
                );
            }
            _ => self.counters.damaged += 1,
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
