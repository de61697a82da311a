//! What becomes of a request: its session, and what is queued there.

use super::Station;
use super::answer::Job;
use super::path_generator::PathGenerator;
use super::region_at;
use super::residency_change::ResidencyChange;
use super::session::{Accepted, Session};
use protocol::{
    MAX_CLIENTS, MAX_SESSIONS, REGIONS_PER_REQUEST, Refusal, RegionAction, RegionAsk, Request,
    RequestKind,
};
use spm::NONE;

impl<D: AsRef<[u8]>> Station<D> {
    pub(super) fn handle_request(&mut self, request: &Request) {
        // Files belong to no session; the shell has them.
        let kind = RequestKind::from_code(request.kind).filter(|&kind| kind != RequestKind::File);
        let Some(kind) = kind else {
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
        let at = match self.known_session(request) {
            Some(at) => at,
            None if kind == RequestKind::Close => {
                self.counters.stale += 1;
                return;
            }
            None => match self.new_session(request) {
                Some(at) => at,
                None => return self.turn_away(request),
            },
        };
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
        let was_asked = self.sessions[at].is_asked();
        match kind {
            RequestKind::Credit | RequestKind::File => {}
            RequestKind::Model => {
                let next_slot = request.count as usize;
                self.ask_model(at, request, |model| Job::Model { model, next_slot });
            }
            RequestKind::Tour => self.ask_tour(at, request),
            RequestKind::Quarters => {
                let first = request.count as usize;
                self.ask_model(at, request, |model| Job::Quarters { model, first });
            }
            RequestKind::Regions => {
                for ask in asks {
                    self.ask_region(at, request, ask);
                }
            }
            RequestKind::Close => return self.close(at),
        }
        let session = &mut self.sessions[at];
        if !was_asked && session.is_asked() {
            session.silent_since_us = self.clock_us;
        }
        if session.asks_too_much() {
            session.break_epoch();
            self.counters.broken_epochs += 1;
        }
    }

    /// Ends a session; of a client without another one nothing is kept.
    fn close(&mut self, at: usize) {
        let client = self.sessions.remove(at).client;
        if !self.knows(client) {
            self.turns.remove(&client);
        }
    }

    /// Notes the refusal for a client that has no place: others keep theirs until they end or fall
    /// silent.
    fn turn_away(&mut self, request: &Request) {
        self.counters.turned_away += 1;
        let (client, object) = (request.client, request.object);
        if self.turned_away.len() == MAX_CLIENTS && !self.turned_away.contains_key(&client) {
            return;
        }
        let (mut header, slots) = self.refused(object, None, Refusal::NoPlace);
        header.station = self.incarnation;
        header.client = client;
        header.epoch = request.epoch;
        header.seal(&slots);
        self.turned_away.insert(client, (header, slots));
        let note = format!(
            "a controller more than the {MAX_CLIENTS} that this station serves is turned away: stop one, or start another station in a --domain of its own"
        );
        self.note((usize::MAX, NONE), note);
    }

    /// The session of a request, if there is one.
    fn known_session(&self, request: &Request) -> Option<usize> {
        let (client, object) = (request.client, request.object);
        let is_of = |s: &Session| s.client == client && s.object == object;
        self.sessions.iter().position(is_of)
    }

    /// A session for a request; `None` for a new client when every place is taken. Of too many
    /// sessions of one client the stalest makes room.
    fn new_session(&mut self, request: &Request) -> Option<usize> {
        let client = request.client;
        if !self.knows(client) && self.clients().count() == MAX_CLIENTS {
            return None;
        }
        let own = || (0..self.sessions.len()).filter(|&at| self.sessions[at].client == client);
        if own().count() == MAX_SESSIONS
            && let Some(stalest) = own().min_by_key(|&at| self.sessions[at].last_heard)
        {
            self.sessions.remove(stalest);
        }
        self.sessions.push(Session::new(request));
        Some(self.sessions.len() - 1)
    }

    /// The model of a request's object, when both mean the same.
    fn model_of(&self, request: &Request, by_name: bool) -> Option<usize> {
        let object = self.objects.get(request.object as usize)?;
        let model = self.models.get(object.model)?;
        let hash = model.file.model_header().model;
        let same = if by_name {
            request.name == object.name && (request.model == 0 || request.model == hash)
        } else {
            request.model == hash
        };
        same.then_some(object.model)
    }

    /// Queues a question about the model of a request's object.
    fn ask_model(&mut self, at: usize, request: &Request, job: impl FnOnce(usize) -> Job) {
        match self.model_of(request, true) {
            Some(model) => self.sessions[at].jobs.push_back(job(model)),
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
            rolled.go_on(&ask);
            session.tours.push_back(rolled);
            return;
        }
        match PathGenerator::new(&self.models[model].file, model, ask) {
            Ok(generator) => session.tours.push_back(generator),
            Err(error) => {
                let name = &self.models[model].name;
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
        match action {
            RegionAction::Subscribe => self.sessions[at].subscribe(model, *ask, false),
            RegionAction::Resend => self.sessions[at].subscribe(model, *ask, true),
            RegionAction::Resident => {
                self.sessions[at]
                    .residency_changes
                    .push_back(ResidencyChange::Held {
                        model,
                        ask: *ask,
                        change: None,
                    })
            }
            RegionAction::Release => self.sessions[at].release(model, region),
        }
    }
}
