//! The mesh subscriber: requests out, chunks in, epochs and credit (see `shared::protocol`).

use super::link_meter::LinkMeter;
use super::outbox::Outbox;
use super::questions::Questions;
use crate::cache::{Cache, MAX_OUTSTANDING, RegionKey, RegionTable};
use crate::horizons::Horizons;
use crate::lod::predictions::Unknown;
use crate::tuning::streaming::{CREDIT_STEP, MAX_SILENCES};
use mutants::{Mutant, is};
use protocol::{
    CREDIT_CHUNKS, ChunkHeader, ChunkKind, MAX_CREDIT_CHUNKS, REGIONS_PER_REQUEST, RegionAction,
    RegionAsk, Request, RequestKind, TourAsk,
};
use spm::NONE;

/// Who this client is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Identity {
    /// The client.
    pub client: u64,
    /// Its incarnation: another one after every restart.
    pub incarnation: u64,
}

/// Subject of a session with the station.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Subject {
    /// Object of the scene.
    pub object: u32,
    /// Hash of the model's name in the scene.
    pub name: u64,
}

impl Subject {
    /// No object.
    const NONE: Self = Self {
        object: NONE,
        name: 0,
    };
}

/// Standing of a received chunk in this epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reception {
    /// The next one: to be consumed.
    Next,
    /// Of another client, station or epoch, or a repetition: to be dropped.
    Stale,
    /// Chunks before it are missing.
    Gap,
}

/// The subscriber's state.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Subscriber {
    identity: Identity,
    subject: Subject,
    /// Chunks that may be under way, as far as the link carries them.
    credit: u64,
    /// Chunks that the link carries.
    window: u64,
    /// Regions that may be outstanding.
    most_questions: usize,
    station: u64,
    epoch: u32,
    sent: u64,
    next_chunk: u64,
    consumed: u64,
    consumed_told: u64,
    model: u64,
    /// When the model was asked for in this epoch, by the clock of the meter, and from which slot;
    /// [`NONE`] once its answer has begun.
    model_asked: Option<(u64, u32)>,
    /// Slots of the model that are here.
    model_from: u32,
    tour: Option<TourAsk>,
    tour_asked: bool,
    quarters_asked: bool,
    /// Skipped periods that count as waited: with the ticks the clock of what is awaited.
    skipped: u64,
    /// When regions or a tour were awaited last, by that clock.
    awaited_at: u64,
    /// Place in the region table up to which held regions were declared in this epoch.
    declared: usize,
    questions: Questions,
    /// Chunks of the epoch that the station was allowed to send.
    granted: u64,
    /// When the last request about regions was made, and when something came last, by that clock.
    asked_at: u64,
    last_progress: u64,
    /// Epochs in a row that ended in silence.
    silences: u32,
    /// Whether a station lived when it was last looked.
    is_heard: bool,
    /// Time after which it asks for a refused region again.
    refused_ticks: u64,
    /// Regions asked for so far.
    pub subscribed: u64,
    /// Regions asked for again, with every record, because their answer counted on records that
    /// were gone.
    pub resent: u64,
    /// Epochs ended by a gap, a timeout or another station, while something was outstanding or
    /// held.
    pub resubscribed: u64,
}

impl Subscriber {
    /// A subscriber that has not met a station and has no object yet.
    #[must_use]
    pub fn new(identity: Identity, horizons: &Horizons) -> Self {
        Self {
            identity,
            subject: Subject::NONE,
            credit: MAX_CREDIT_CHUNKS,
            window: CREDIT_CHUNKS,
            most_questions: CREDIT_CHUNKS as usize,
            station: 0,
            epoch: 0,
            sent: 0,
            next_chunk: 0,
            consumed: 0,
            consumed_told: 0,
            model: 0,
            model_asked: None,
            model_from: 0,
            tour: None,
            tour_asked: false,
            quarters_asked: false,
            skipped: 0,
            awaited_at: 0,
            declared: 0,
            questions: Questions::new(),
            granted: 0,
            asked_at: 0,
            last_progress: 0,
            silences: 0,
            is_heard: false,
            refused_ticks: horizons.refused,
            subscribed: 0,
            resent: 0,
            resubscribed: 0,
        }
    }

    /// Begins a session about an object, in an epoch that no session about it has had; its totals
    /// go on.
    pub fn begin_session(&mut self, subject: Subject, epoch: u32, tick: u64) {
        self.end_session(tick);
        self.subject = subject;
        self.epoch = epoch;
    }

    /// The session ends: nothing is wanted or awaited any more.
    pub fn end_session(&mut self, tick: u64) {
        self.subject = Subject::NONE;
        self.model = 0;
        self.tour = None;
        self.start(tick);
    }

    /// Tells the station that the session ends, as far as that is heard; the epoch that it ends in.
    pub fn close(&mut self, outbox: &mut Outbox, tick: u64) -> u32 {
        outbox.begin_session(0);
        if self.sent > 0 && outbox.has_room() {
            let request = self.request(RequestKind::Close);
            self.send(outbox, request, tick, false);
        }
        self.epoch
    }

    /// Sets how many chunks may be under way from now on; at least one.
    pub fn set_credit(&mut self, chunks: u64) {
        self.credit = chunks.clamp(1, MAX_CREDIT_CHUNKS);
    }

    /// Whether a station lives that is not the one of this epoch.
    #[must_use]
    pub fn is_another(&self, station: u64) -> bool {
        station != 0 && station != self.station
    }

    /// Whether an answer should have come by now.
    fn is_overdue(&self, tick: u64, meter: &LinkMeter) -> bool {
        let waiting = !self.questions.all().is_empty()
            || (self.model_asked.is_some() && self.model == 0)
            || (self.tour_asked && self.tour.is_some())
            || self.quarters_asked;
        waiting && self.now(tick).saturating_sub(self.last_progress) > meter.timeout(self.silences)
    }

    /// The station is not silent where an overdue answer waits here behind what other objects get.
    /// `waiting`: chunks that wait, oldest first; `is_behind`: something else comes before them.
    pub fn hear_waiting<'a>(
        &mut self,
        mut waiting: impl Iterator<Item = &'a ChunkHeader>,
        mut is_behind: bool,
        (tick, meter): (u64, &LinkMeter),
    ) {
        let is_its = |of: &ChunkHeader| {
            is_behind |= of.object != self.subject.object;
            self.is_earlier(of) || self.receive(of) != Reception::Stale
        };
        if self.is_overdue(tick, meter) && waiting.any(is_its) && is_behind {
            self.has_taken(tick);
        }
    }

    /// Takes what the heartbeat says; a new incarnation ends the epoch, and so does a silence in
    /// which an answer should have come.
    pub fn observe(&mut self, station: u64, tick: u64, meter: &LinkMeter, cache: &mut Cache) {
        let is_back = station != 0 && !self.is_heard;
        self.is_heard = station != 0;
        let silent = self.is_overdue(tick, meter) && !is(Mutant::Timeout);
        let another = self.is_another(station);
        if another {
            self.station = station;
        }
        if (another && !is(Mutant::NewStation)) || (silent && station != 0) {
            // A station that was away was silent for another reason than a line that is slower than
            // was thought.
            let was_away = another || is_back;
            let silences = if was_away { 0 } else { self.silences + 1 };
            self.silences = silences.min(MAX_SILENCES);
            self.end_epoch(tick, cache);
        }
    }

    /// Periods were skipped since the last tick: link and station went on, so what is awaited was
    /// awaited for as much longer.
    pub fn skip_periods(&mut self, periods: u64) {
        self.skipped += periods;
    }

    /// A tick by the clock of what is awaited.
    fn now(&self, tick: u64) -> u64 {
        tick + self.skipped
    }

    /// Ends the epoch: forgets what is under way, and declares and asks anew.
    pub fn end_epoch(&mut self, tick: u64, cache: &mut Cache) {
        if self.sent > 0 {
            self.resubscribed += 1;
        }
        self.epoch = self.epoch.wrapping_add(1);
        self.start(tick);
        cache.end_epoch();
    }

    /// Everything of an epoch as it is at its start.
    fn start(&mut self, tick: u64) {
        self.sent = 0;
        self.next_chunk = 0;
        self.consumed = 0;
        self.consumed_told = 0;
        self.model_asked = None;
        self.tour_asked = false;
        self.quarters_asked = false;
        self.declared = 0;
        self.questions.clear();
        self.granted = 0;
        self.last_progress = self.now(tick);
    }

    /// Standing of a chunk in this epoch; consume a next one with [`Subscriber::consumed`].
    #[must_use]
    pub fn receive(&self, header: &ChunkHeader) -> Reception {
        let ours = header.client == self.identity.client
            && header.object == self.subject.object
            && header.station == self.station
            && header.epoch == self.epoch;
        if !ours || header.sequence < self.next_chunk {
            Reception::Stale
        } else if header.sequence > self.next_chunk && !is(Mutant::Gap) {
            Reception::Gap
        } else {
            Reception::Next
        }
    }

    /// Counts the chunk that [`Subscriber::receive`] called the next one.
    pub fn consumed(&mut self, tick: u64) {
        self.next_chunk += 1;
        self.consumed += 1;
        self.last_progress = self.now(tick);
        self.silences = 0;
    }

    /// A part of the next chunk was taken: what is left of it waits here, not at the station.
    pub fn has_taken(&mut self, tick: u64) {
        self.last_progress = self.last_progress.max(self.now(tick));
    }

    /// Takes a stale chunk for a sign of life, if it is of an earlier epoch with this station: what
    /// is asked now comes after what was under way. The station sends no more of them than the
    /// credit admitted. Errors that it measured say nothing: it goes on to send them where it has
    /// not heard of this epoch.
    pub fn hear_stale(&mut self, header: &ChunkHeader, tick: u64) {
        if self.is_earlier(header) {
            self.has_taken(tick);
        }
    }

    fn is_earlier(&self, header: &ChunkHeader) -> bool {
        let is_own = header.station == self.station && header.object == self.subject.object;
        is_own && header.epoch < self.epoch && header.kind != ChunkKind::Measured as u32
    }

    /// A chunk of the model that begins with a slot has come: the periods since the model was asked
    /// for, if it was from there; once, since the chunk may wait here for its turn. `now`: by the
    /// clock of the meter.
    pub fn model_begins(&mut self, slot: u32, now: u64) -> Option<u64> {
        let (asked, from) = self.model_asked.as_mut().filter(|of| of.1 == slot)?;
        *from = NONE;
        Some(now.saturating_sub(*asked))
    }

    /// So many slots of the model are here: after a loss it is asked for from there.
    pub fn model_goes_on(&mut self, from: u32) {
        self.model_from = from;
    }

    /// The answer to a region begins: the periods since it was asked for, if it was asked for once.
    /// `now`: by the clock of the meter.
    pub fn answer_begins(&mut self, region: RegionKey, now: u64) -> Option<u64> {
        self.questions.begin_answer(region, now)
    }

    /// The answer to a region is of no use: it is to be requested with every record.
    pub fn answer_is_lost(&mut self, region: RegionKey) {
        self.questions.lose(region);
    }

    /// The regions asked for whose answers are not complete.
    #[must_use]
    pub fn questions(&self) -> &Questions {
        &self.questions
    }

    /// Content hash of the model; 0 until it is known.
    #[must_use]
    pub fn model(&self) -> u64 {
        self.model
    }

    /// The model has arrived.
    pub fn model_is(&mut self, model: u64) {
        self.model = model;
    }

    /// Asks for a tour as soon as possible, and again after every loss until
    /// [`Subscriber::tour_is_here`].
    pub fn ask_tour(&mut self, tour: TourAsk) {
        self.tour = Some(tour);
        self.tour_asked = false;
    }

    /// So many points of the tour have come: after a loss it is asked for from there.
    pub fn tour_goes_on(&mut self, from: u64) {
        self.tour = self.tour.map(|tour| TourAsk { from, ..tour });
    }

    /// The tour is complete, or there is none.
    pub fn tour_is_here(&mut self) {
        self.tour = None;
    }

    /// Some of the quartered faces have come.
    pub fn quarters_are_here(&mut self) {
        self.quarters_asked = false;
    }

    /// An asked region was answered, refused or given up.
    pub fn answered(&mut self, region: RegionKey) {
        self.questions.end(region);
    }

    /// Whether the station has answered in this epoch, knows every region that is held, and owes no
    /// answer.
    #[must_use]
    pub fn is_synchronised(&self, cache: &Cache) -> bool {
        self.next_chunk > 0
            && self.questions.all().is_empty()
            && self.declared >= cache.regions.capacity()
    }

    /// Answers outstanding at once, at the most, and how many there may be.
    #[must_use]
    pub fn high_water(&self) -> (usize, usize) {
        (self.questions.high_water(), MAX_OUTSTANDING as usize)
    }

    /// Whether regions may be asked for.
    #[must_use]
    pub fn may_ask(&self, cache: &Cache) -> bool {
        self.station != 0
            && self.model != 0
            && self.questions.all().len() < self.most_questions
            && self.declared >= cache.regions.capacity()
    }

    fn request(&self, kind: RequestKind) -> Request {
        let mut request: Request = bytemuck::Zeroable::zeroed();
        request.client = self.identity.client;
        request.incarnation = self.identity.incarnation;
        request.sequence = self.sent;
        request.consumed = self.consumed;
        request.model = self.model;
        request.name = self.subject.name;
        request.epoch = self.epoch;
        request.kind = kind as u32;
        request.object = self.subject.object;
        request.credit = self.credit.min(self.window) as u32;
        request
    }

    /// `begins_wait`: an answer is expected, and none was before.
    fn send(&mut self, outbox: &mut Outbox, request: Request, tick: u64, begins_wait: bool) {
        if begins_wait {
            self.last_progress = self.last_progress.max(self.now(tick));
        }
        let granted = request.consumed + u64::from(request.credit);
        self.granted = self.granted.max(granted);
        self.sent += 1;
        self.consumed_told = self.consumed;
        outbox.push(request);
    }

    /// Writes this tick's requests: model, tour, held regions, releases, then `wanted` in its
    /// order, and quartered faces.
    pub fn requests(
        &mut self,
        tick: u64,
        cache: &mut Cache,
        wanted: impl Iterator<Item = Unknown>,
        meter: &LinkMeter,
        outbox: &mut Outbox,
    ) {
        self.window = meter.window();
        self.most_questions = meter.most_questions();
        if self.station == 0 {
            return;
        }
        if self.model == 0 {
            if self.model_asked.is_none() && outbox.has_room() {
                let from = self.model_from;
                self.model_asked = Some((meter.clock(tick), from));
                let mut request = self.request(RequestKind::Model);
                request.count = from;
                let begins_wait = self.questions.all().is_empty();
                self.send(outbox, request, tick, begins_wait);
            }
        } else {
            if let (Some(tour), false) = (self.tour, self.tour_asked)
                && outbox.has_room()
            {
                self.tour_asked = true;
                let mut request = self.request(RequestKind::Tour);
                request.tour = tour;
                let begins_wait = self.questions.all().is_empty();
                self.send(outbox, request, tick, begins_wait);
            }
            self.declare(tick, cache, outbox);
            if self.now(tick) >= self.asked_at + meter.request_ticks() {
                self.ask(tick, cache, wanted, meter, outbox);
            }
            self.ask_quarters(tick, cache, meter, outbox);
        }
        // Of what it was told the station may wait for any part: no window that grew since counts.
        let told = self.granted - self.consumed_told;
        let step = (self.window.min(self.credit).min(told) / CREDIT_STEP).max(1);
        if self.consumed - self.consumed_told >= step && outbox.has_room() {
            let request = self.request(RequestKind::Credit);
            self.send(outbox, request, tick, false);
        }
    }

    /// Asks for the next quartered faces, where no region and no tour was awaited for a round trip:
    /// a contact is as accurate without them, though less is known of it.
    fn ask_quarters(&mut self, tick: u64, cache: &Cache, meter: &LinkMeter, outbox: &mut Outbox) {
        if !self.questions.all().is_empty() || self.tour.is_some() {
            self.awaited_at = self.now(tick);
        }
        let is_idle = self.now(tick) > self.awaited_at + meter.round_trip_ticks();
        let may_ask = is_idle && !self.quarters_asked && outbox.has_room();
        if let (true, Some(next)) = (may_ask, cache.next_quarters()) {
            self.quarters_asked = true;
            let mut request = self.request(RequestKind::Quarters);
            request.count = next;
            self.send(outbox, request, tick, true);
        }
    }

    /// Tells a new epoch which regions are held.
    fn declare(&mut self, tick: u64, cache: &Cache, outbox: &mut Outbox) {
        let settled = cache.regions.settled();
        while self.declared < settled && outbox.has_room() {
            let mut request = self.request(RequestKind::Regions);
            while self.declared < settled && (request.count as usize) < REGIONS_PER_REQUEST {
                if let Some(region) = cache.regions.get(self.declared)
                    && region.is_resident()
                {
                    push(&mut request, region.key, RegionAction::Resident);
                }
                self.declared += 1;
            }
            if request.count == 0 {
                return;
            }
            self.send(outbox, request, tick, false);
        }
    }

    fn ask(
        &mut self,
        tick: u64,
        cache: &mut Cache,
        mut wanted: impl Iterator<Item = Unknown>,
        meter: &LinkMeter,
        outbox: &mut Outbox,
    ) {
        if self.declared < cache.regions.capacity() || !outbox.has_room() {
            return;
        }
        let was_idle = self.questions.all().is_empty();
        let mut request = self.request(RequestKind::Regions);
        cache
            .regions
            .drain_releases(|key| push(&mut request, key, RegionAction::Release));
        let now = meter.clock(tick);
        let again = self.request_again(&mut cache.regions, &mut request, now);
        let refused_ticks = self.refused_ticks;
        cache.regions.forget_old_refusal(tick, refused_ticks);
        let loses = self.questions.has_lost_many();
        let (mut asked, mut looked_at) = (0, 0);
        while (request.count as usize) < REGIONS_PER_REQUEST
            && self.questions.all().len() < self.most_questions
        {
            let Some(of) = wanted.next() else {
                break;
            };
            looked_at += 1;
            let open = self.questions.all().len();
            // What is needed must not wait behind what is only loaded ahead; and where the cache
            // lost what answers counted on, it holds no more of that.
            let is_short = loses || open >= meter.questions_in_transit();
            if !of.is_needed && is_short {
                break;
            }
            let comes_late = meter.comes_late(open, of.leaves - tick as f64);
            if comes_late || cache.regions.index(of.key).is_some() {
                continue;
            }
            if !cache.has_room_for_region() {
                break;
            }
            let Some(index) = cache.regions.request(of.key) else {
                break;
            };
            cache.regions.mark_used(index, tick);
            cache.regions.at_mut(index).due = of.due as u64;
            push(&mut request, of.key, RegionAction::Subscribe);
            self.questions.ask(of.key, now);
            asked += 1;
        }
        outbox.has_looked_at(looked_at);
        if request.count > 0 {
            self.send(outbox, request, tick, was_idle && asked + again > 0);
            self.asked_at = self.now(tick);
            self.subscribed += u64::from(asked);
        }
    }

    /// Requests regions again, with every record, whose answer was of no use; they are outstanding
    /// still. Their number.
    fn request_again(&mut self, regions: &mut RegionTable, request: &mut Request, now: u64) -> u32 {
        let mut again = 0;
        while (request.count as usize) < REGIONS_PER_REQUEST
            && let Some(key) = regions.request_again()
        {
            push(request, key, RegionAction::Resend);
            self.questions.ask_again(key, now);
            again += 1;
        }
        self.resent += u64::from(again);
        again
    }
}

fn push(request: &mut Request, region: RegionKey, action: RegionAction) {
    request.regions[request.count as usize] = RegionAsk {
        region: region.id.0,
        tolerance_bits: region.tolerance_bits,
        action: action as u32,
    };
    request.count += 1;
}

#[cfg(test)]
mod tests;
