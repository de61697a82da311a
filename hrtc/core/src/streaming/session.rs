//! Session of an active object with the station: requests out, chunks in.
//!
//! | file | does |
//! |---|---|
//! | `session` | takes each chunk by its kind; scripted paths, refusals, faults |
//! | `subscriber` | the mesh subscriber: sequence numbers, epochs, credit, requests |
//! | `questions` | the regions whose answers are outstanding |
//! | `link_meter` | round-trip time and rate, and what follows from them |
//! | `outbox` | the requests of a tick |
//! | `base_mesh` | header and base mesh into the cache |
//! | `answers` | closures and records into the cache |

use super::Fault;
use super::base_mesh::BaseMeasures;
use super::chunk::InboxChunk;
use super::link_meter::LinkMeter;
use super::outbox::Outbox;
use super::subscriber::{Identity, Reception, Subject, Subscriber};
use crate::budget::Budget;
use crate::cache::AfterUnload;
use crate::cache::base_mesh_store::{BaseMeshStore, Model};
use crate::horizons::Horizons;
use crate::instance::{ModelFrame, ObjectInstance};
use crate::lod::front::Front;
use crate::probe::Probe;
use crate::probe::contacts::Contacts;
use crate::record::max_or_nan;
use crate::tuning::streaming::MIN_UNITS;
use protocol::{
    AnswersReader, ChunkHeader, ChunkKind, MODEL_HEADER_SLOTS, MeasuredError, Refusal, TourPoint,
};
use spm::{ModelHeader, NONE};

/// Parts of the tick that received data may change.
pub struct TickContext<'a, 'b> {
    /// Index of the tick.
    pub tick: u64,
    /// Base meshes of all models.
    pub store: &'a mut BaseMeshStore,
    /// All probes: their scripted paths arrive with the chunks.
    pub probes: &'a mut [Probe],
    /// Remaining work of the tick.
    pub budget: &'a mut Budget<'b>,
    /// Of the link to the station.
    pub meter: &'a mut LinkMeter,
}

/// Parts of the object that received data may change.
#[derive(Debug)]
pub struct Receiver<'a> {
    /// The object.
    pub instance: &'a ObjectInstance,
    /// Its frame; set when the base mesh is complete.
    pub frame: &'a mut Option<ModelFrame>,
    /// Its front, which loads the records.
    pub front: &'a mut Front,
    /// Its contacts: records may need slots that only a collapse frees, which a probe may perceive.
    pub contacts: &'a mut Contacts,
}

/// Progress within the oldest chunk and the base mesh.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Progress {
    /// Items of the oldest chunk that are done.
    pub done: usize,
    /// Position in its answers, if it holds answers and was begun.
    pub reader: Option<AnswersReader>,
    /// Slots of the base mesh that are done.
    pub model_slots: u32,
    /// Header of a model whose base mesh is incomplete, and what is measured of that so far.
    pub header: Option<ModelHeader>,
    pub measures: BaseMeasures,
    /// Ticks for which the next record has waited for room.
    pub waited: u32,
}

impl Progress {
    /// The next chunk begins.
    fn next_chunk(&mut self) {
        self.done = 0;
        self.reader = None;
        self.waited = 0;
    }
}

/// Outcome of taking a chunk.
pub(super) enum Taken {
    /// All of it is taken.
    Whole,
    /// The rest waits for budget or room.
    Part,
    /// It does not continue the data received: the epoch ends.
    Gap,
}

/// Session of an active object with the station.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Session {
    pub(super) subscriber: Subscriber,
    pub(super) progress: Progress,
    /// Ticks for which a record may wait for room.
    pub(super) max_room_wait: u32,
    /// Next slot of the stored base mesh to load, while the object becomes active.
    pub(super) loading: Option<usize>,
    /// The probe whose scripted path is requested.
    tour_probe: Option<usize>,
    /// A chunk waits for room: later chunks wait too, in this tick.
    is_stalled: bool,
    /// The fault that ended the use of a model, if any.
    pub fault: Option<Fault>,
    /// Largest measured error of this tick, model units; not a number where one of them is none.
    pub measured: Option<f64>,
    /// Bytes received, total.
    pub bytes_received: u64,
    /// Records received, total.
    pub vsps_received: u64,
}

impl Session {
    /// No object yet.
    #[must_use]
    pub fn new(identity: Identity, horizons: &Horizons) -> Self {
        Self {
            max_room_wait: horizons.max_room_wait,
            subscriber: Subscriber::new(identity, horizons),
            progress: Progress::default(),
            loading: None,
            tour_probe: None,
            is_stalled: false,
            fault: None,
            measured: None,
            bytes_received: 0,
            vsps_received: 0,
        }
    }

    /// Begins a session about an object, in an epoch after all of its earlier sessions. A `stored`
    /// base mesh is loaded from the store, else it is requested. The front is clear already.
    pub fn begin(
        &mut self,
        instance: &ObjectInstance,
        epoch: u32,
        stored: Option<&Model>,
        front: &mut Front,
        tick: u64,
    ) {
        let subject = Subject {
            object: instance.object,
            name: instance.name,
        };
        self.subscriber.begin_session(subject, epoch, tick);
        if let Some(model) = stored {
            // Checked when it arrived: the same storage takes the same base mesh.
            match front.cache.begin_model(&model.header) {
                Ok(()) => {
                    self.loading = Some(MODEL_HEADER_SLOTS);
                    self.subscriber.model_is(model.header.model);
                }
                Err(error) => self.fault = Some(error.into()),
            }
        }
    }

    /// Ends the session, as far as the station hears of it. Returns the epoch that it ends in.
    pub fn close(&mut self, outbox: &mut Outbox, tick: u64) -> u32 {
        self.subscriber.close(outbox, tick)
    }

    /// Forgets everything of the session; it is about no object until the next one begins.
    pub fn end(&mut self, tick: u64) {
        self.progress = Progress::default();
        self.tour_probe = None;
        self.loading = None;
        self.fault = None;
        self.subscriber.end_session(tick);
    }

    /// A tick begins; `station` is the incarnation of the living one. Another station may serve
    /// what the last one could not, or another model: then a base mesh that is not whole begins
    /// anew.
    pub fn begin_tick(&mut self, station: u64, tick: u64, meter: &LinkMeter, front: &mut Front) {
        self.measured = None;
        self.is_stalled = false;
        if self.subscriber.is_another(station) {
            let is_partial = self.progress.header.is_some() && front.model().is_none();
            if is_partial || self.is_ended() {
                self.begin_anew(front);
            }
        }
        if !self.is_ended() {
            self.subscriber
                .observe(station, tick, meter, &mut front.cache);
        }
    }

    /// Chunks wait here: see [`Subscriber::hear_waiting`].
    pub fn hear_waiting<'a>(
        &mut self,
        waiting: impl Iterator<Item = &'a ChunkHeader>,
        is_behind: bool,
        now: (u64, &LinkMeter),
    ) {
        if !self.is_ended() {
            self.subscriber.hear_waiting(waiting, is_behind, now);
        }
    }

    /// Periods were skipped since the last tick, of which so many count as waited for an answer.
    pub fn skip_periods(&mut self, periods: u64) {
        self.subscriber.skip_periods(periods);
    }

    /// What was going on is over, and the fault that ended it.
    fn begin_anew(&mut self, front: &mut Front) {
        self.progress = Progress::default();
        if front.model().is_none() {
            front.begin_clear();
            self.loading = None;
            self.subscriber.model_is(0);
        }
        if self.is_ended() {
            self.fault = None;
        }
    }

    /// Asks again if the station had no place.
    pub fn try_place_again(&mut self, front: &mut Front, tick: u64) {
        if self.fault == Some(Fault::NoPlace) {
            self.begin_anew(front);
            self.subscriber.end_epoch(tick, &mut front.cache);
        }
    }

    /// Whether a fault keeps the session from going on.
    #[must_use]
    pub fn is_ended(&self) -> bool {
        self.fault.is_some_and(Fault::ends_session)
    }

    /// The subscriber, for its totals.
    #[must_use]
    pub fn subscriber(&self) -> &Subscriber {
        &self.subscriber
    }

    /// Whether a stored base mesh is being loaded.
    #[must_use]
    pub fn is_loading(&self) -> bool {
        self.loading.is_some()
    }

    /// Sets how many chunks may be under way.
    pub fn set_credit(&mut self, chunks: u64) {
        self.subscriber.set_credit(chunks);
    }

    /// Writes the requests of a tick; `waiting`: received chunks that wait for the tick.
    pub fn request(
        &mut self,
        front: &mut Front,
        (tick, waiting): (u64, usize),
        meter: &LinkMeter,
        outbox: &mut Outbox,
    ) {
        if self.is_ended() {
            // Nobody is told any more, so that a lowered limit is kept without the station too.
            front.cache.regions.drain_releases(|_| ());
            return;
        }
        if front.cache.is_clearing() {
            return;
        }
        self.subscriber.model_goes_on(self.progress.model_slots);
        let may_request = front.may_request(tick) && self.subscriber.may_ask(&front.cache);
        let (cache, wanted) = front.requests(may_request, waiting);
        self.subscriber.requests(tick, cache, wanted, meter, outbox);
    }

    /// Takes a chunk of the object as far as budget and room go. Returns whether it is done with.
    pub fn receive(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> bool {
        if self.is_ended() {
            return true;
        }
        if self.is_stalled {
            return false;
        }
        match self.subscriber.receive(&chunk.header) {
            Reception::Stale => {
                self.subscriber.hear_stale(&chunk.header, context.tick);
                self.progress.next_chunk();
                return true;
            }
            Reception::Gap => {
                self.end_epoch(of, context);
                return true;
            }
            Reception::Next => {}
        }
        let before = self.progress.done;
        match self.take(chunk, of, context) {
            Taken::Whole => {
                self.subscriber.consumed(context.tick);
                if chunk.header.kind == ChunkKind::Answers as u32 {
                    context.meter.answers_taken();
                }
                self.bytes_received += size_of::<InboxChunk>() as u64;
                self.progress.next_chunk();
                true
            }
            Taken::Part => {
                // Room is short when budget remains and nothing moved; a region that is being
                // unloaded makes some.
                let is_stuck = self.progress.done == before && context.budget.ingest > 0;
                if self.progress.done > before {
                    self.progress.waited = 0;
                    self.subscriber.has_taken(context.tick);
                }
                if is_stuck && !of.front.is_unloading() {
                    self.progress.waited += 1;
                }
                self.is_stalled = true;
                false
            }
            Taken::Gap => {
                self.end_epoch(of, context);
                true
            }
        }
    }

    fn end_epoch(&mut self, of: &mut Receiver<'_>, context: &mut TickContext<'_, '_>) {
        self.subscriber.end_epoch(context.tick, &mut of.front.cache);
        self.progress.next_chunk();
    }

    fn take(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        match ChunkKind::from_code(chunk.header.kind) {
            Some(ChunkKind::Model) => {
                let (slot, now) = (chunk.header.code, context.meter.clock(context.tick));
                if let Some(periods) = self.subscriber.model_begins(slot, now) {
                    context.meter.answered(periods, context.tick);
                }
                return self.take_model(chunk, of, context);
            }
            Some(ChunkKind::Answers) => return self.take_answers(chunk, of, context),
            Some(ChunkKind::Quarters) => return self.take_quarters(chunk, of, context),
            Some(ChunkKind::Measured) => {
                let items: &[MeasuredError] = bytemuck::cast_slice(&chunk.slots);
                let count = (chunk.header.count as usize).min(items.len());
                for item in &items[..count] {
                    let most = self.measured.unwrap_or(0.0);
                    self.measured = Some(max_or_nan(most, item.distance));
                }
            }
            Some(ChunkKind::Tour) => return self.take_tour(chunk, of, context),
            Some(ChunkKind::Refused) => self.take_refusal(chunk, of, context),
            // A file belongs to no session, and a kind of a later version is skipped; the sequence
            // numbers go on.
            Some(ChunkKind::File) | None => {}
        }
        Taken::Whole
    }

    fn take_tour(
        &mut self,
        chunk: &InboxChunk,
        of: &Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        let probe = self.tour_probe.map(|k| &mut context.probes[k]);
        let Some(tour) = probe.and_then(|probe| probe.tour.as_mut()) else {
            return Taken::Whole;
        };
        if context.budget.ingest < MIN_UNITS {
            context.budget.end_ingest();
            return Taken::Part;
        }
        context.budget.ingest -= MIN_UNITS;
        let points: &[TourPoint] = bytemuck::cast_slice(&chunk.slots);
        let count = (chunk.header.count as usize).min(points.len());
        if !tour.take(chunk.header.code, &points[..count]) {
            return Taken::Gap;
        }
        self.subscriber.tour_goes_on(tour.taken());
        if chunk.header.last == 1 {
            tour.is_whole = true;
            self.fault = self.fault.filter(|&fault| fault != Fault::NoTour);
            self.subscriber.tour_is_here();
            self.request_next_tour(of, context.probes);
        }
        Taken::Whole
    }

    /// Requests a scripted path that was refused and is awaited again.
    pub fn retry_tour(&mut self, of: &Receiver<'_>, probes: &[Probe]) {
        if self.tour_probe.is_none() && !self.is_ended() {
            self.request_next_tour(of, probes);
        }
    }

    /// Requests the scripted path of the next probe that awaits one of this object.
    pub(super) fn request_next_tour(&mut self, of: &Receiver<'_>, probes: &[Probe]) {
        let Some(frame) = *of.frame else {
            return;
        };
        let object = of.instance.object;
        self.tour_probe = probes.iter().position(|probe| probe.awaits_tour_of(object));
        if let Some(ask) = self.tour_probe.and_then(|k| probes[k].tour_ask(&frame)) {
            self.subscriber.ask_tour(ask);
        }
    }

    fn take_refusal(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) {
        let header = &chunk.header;
        match Refusal::from_code(header.code) {
            // A station that knows the name, but not the model that is here or in the store.
            Some(Refusal::UnknownModel) if self.subscriber.model() != 0 => {
                self.fault = Some(Fault::AnotherModel);
            }
            Some(Refusal::UnknownModel) => self.fault = Some(Fault::UnknownModel),
            Some(Refusal::NoPlace) => self.fault = Some(Fault::NoPlace),
            // Only a scripted path is refused without a region.
            _ if header.region == NONE && self.tour_probe.is_some() => {
                self.fault = Some(Fault::NoTour);
                let probe = self.tour_probe.map(|k| &mut context.probes[k]);
                if let Some(tour) = probe.and_then(|probe| probe.tour.as_mut()) {
                    tour.refused_at = Some(context.tick);
                }
                self.subscriber.tour_is_here();
                self.request_next_tour(of, context.probes);
            }
            _ => {
                let name = (header.region, header.tolerance_bits);
                if let Some(region) = of.front.cache.requested(name) {
                    let (front, tick) = (&mut *of.front, context.tick);
                    self.refuse(region, front, (AfterUnload::Refuse, tick));
                }
            }
        }
    }

    /// Gives up a requested region that cannot be used.
    pub(super) fn refuse(
        &mut self,
        region: usize,
        front: &mut Front,
        (why, tick): (AfterUnload, u64),
    ) {
        let key = front.cache.regions.at(region).key;
        if front.refuse(region, why, tick) {
            self.subscriber.answered(key);
        }
    }
}
