//! The controller: the pure core of the tick. Values in, values out; no clock, no I/O, no allocation.
//!
//! Order of a tick: what moves, broad phase, inbox, predict, refine (collapses first only when room is short), refit, query,
//! force, gate. Force k acts over `[k, k + 1]`; the sample of tick k gives the force of tick k.
//!
//! | part | is |
//! |---|---|
//! | [`ActiveObject`] | what one awake object needs: cache, session with the station, refinement, and a touch for each probe |
//! | touch | one probe and one object: proxy, prediction, what was felt |
//! | probe | sample, tour, gate and energy account; its force is the sum of its touches |
//! | library | heads and base meshes, one of each model |
//! | seating | which objects sit on the seats: those near a probe |
//!
//! The cache's bytes are shared out to equal seats ([`ScenePlan::seats`]); an object without one costs its box in
//! the broad phase. The work of a tick is one budget, which the seats draw on in turn, the nearest to a contact first.

use crate::active::active_set::{ActiveSet, seat_of};
use crate::active::broad_phase::BroadPhase;
use crate::active::object::{ActiveObject, Budget, ObjectInstance, ObjectStats, TickContext};
use crate::bodies::Movables;
use crate::cache::CacheError;
use crate::cache::base_mesh_store::BaseMeshStore;
use crate::contact::query::Work;
use crate::contact::sphere_proxy::Contact;
use crate::force::effects::{Clock, Rendered};
use crate::force::passivity::CarriedWork;
use crate::lod::refine;
use crate::probe::Probe;
use crate::record::CoreRecord;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::ingest;
use crate::streaming::subscriber::{Identity, Outbox};
use geometry::Wrench;
use glam::DVec3;
use haptic_device::Sample;
use protocol::{ANSWER_TIMEOUT_MS, ContactReport, Request};
use scene::{MAX_ACTIVE_OBJECTS, ScenePlan};
use spm::NONE;
use std::sync::Arc;
use thiserror::Error;

/// Ticks between two contact reports of a probe to the station.
const REPORT_EVERY: u64 = 10;
/// Nodes visited and faces tested by the steps of all proxies in a tick without splits and collapses.
const PROXY_WORK: u32 = 4096;
/// ... what an operation takes of them: it costs as much as so many; and what is left for each proxy in any tick.
const PROXY_WORK_PER_OPERATION: u32 = 32;
pub(crate) const MIN_PROXY_WORK: u32 = 1024;
/// Chunks that are looked at in a tick: what the inbox holds.
const CHUNKS_A_TICK: u32 = u64::BITS;

/// Stages of a tick, told to an observer when they end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Inbox and prediction.
    Inbox,
    /// Splits and collapses.
    Refine,
    /// Boxes.
    Refit,
    /// Closest point and proxy.
    Query,
    /// Force, gate, reports.
    Force,
    /// What moves, broad phase and seats; the first of a tick.
    BroadPhase,
}

/// Told when a stage ends: how a shell measures stages without giving the core a clock.
pub trait StageObserver {
    /// A stage has ended.
    fn ended(&mut self, stage: Stage);
}

/// Observes nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoObserver;

impl StageObserver for NoObserver {
    fn ended(&mut self, _: Stage) {}
}

/// What goes into a tick.
#[derive(Debug, Clone, Copy)]
pub struct TickInputs<'a> {
    /// Index of the tick.
    pub tick: u64,
    /// The device's sample, one a probe; `None` when it gave none.
    pub samples: &'a [Option<Sample>],
    /// Incarnation of the station that is alive; 0 for none.
    pub station: u64,
    /// Chunks that have arrived and were not consumed by earlier ticks, oldest first, in two runs.
    pub chunks: [&'a [InboxChunk]; 2],
    /// Whether the force is to ramp down.
    pub stopping: bool,
}

/// What comes out of a tick; storage made once.
#[derive(Debug, Clone)]
pub struct TickOutputs {
    /// The wrench for each probe's device.
    pub wrenches: Vec<Wrench>,
    /// Requests to the station.
    pub outbox: Outbox,
    /// Contact reports to the station, one a probe every few ticks.
    pub reports: Vec<ContactReport>,
    /// What holds each probe, of several objects the one that pushes most; `None` in free space.
    pub contacts: Vec<Option<ProbeContact>>,
    /// How many of the given chunks are done with.
    pub chunks_consumed: usize,
    /// What the tick was like.
    pub record: CoreRecord,
}

impl TickOutputs {
    /// Storage for a number of probes.
    #[must_use]
    pub fn new(probes: usize) -> Self {
        Self {
            wrenches: vec![Wrench::ZERO; probes],
            outbox: Outbox::new(2 * MAX_ACTIVE_OBJECTS),
            reports: Vec::with_capacity(probes),
            contacts: vec![None; probes],
            chunks_consumed: 0,
            record: CoreRecord::default(),
        }
    }

    /// What holds the first probe, model units.
    #[must_use]
    pub fn contact(&self) -> Option<Contact> {
        let first = self.contacts.first().copied().flatten();
        first.map(|touched| touched.contact)
    }
}

/// What holds a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbeContact {
    /// Object of the scene.
    pub object: u32,
    /// The contact, in the units of the object's model.
    pub contact: Contact,
}

/// Why the controller cannot go on with a model. It keeps ticking without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Fault {
    /// The cache is too small.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// The station does not know the model that the scene names.
    #[error(
        "the station serves another scene: it does not know this object's model; start both with the same scene and the same --model"
    )]
    UnknownModel,
    /// The model's head or base mesh makes no sense.
    #[error("the model's header or base mesh is damaged: build the SPM file anew")]
    DamagedModel,
    /// The station cannot make the tour that the scene asks for.
    #[error(
        "the station cannot make a tour of this model (its own message says why): build the SPM file anew, or give the scene a path with trajectory = {{ csv = \"FILE\" }}"
    )]
    NoTour,
    /// The station came back with another model under the same name.
    #[error("the station now serves another model under the same name: restart the controller")]
    AnotherModel,
}

/// See the module.
#[derive(Debug)]
pub struct Controller {
    pub(crate) identity: Identity,
    pub(crate) operations: usize,
    pub(crate) period_s: f64,
    pub(crate) tolerance_m: f64,
    pub(crate) cache_bytes: usize,
    pub(crate) placings: Vec<ObjectInstance>,
    pub(crate) probes: Vec<Probe>,
    pub(crate) seats: Vec<ActiveObject>,
    pub(crate) library: BaseMeshStore,
    pub(crate) broad_phase: BroadPhase,
    /// What moves.
    pub(crate) movables: Movables,
    pub(crate) seating: ActiveSet,
    /// Of the chunks that wait, oldest at bit 0: which were taken before their turn, because one before them waits
    /// for room on another seat.
    pub(crate) taken: u64,
    /// The seats in the order of a tick: the nearest to a contact first.
    pub(crate) order: Vec<(f64, usize)>,
    pub(crate) replay_hash: u64,
}

impl Controller {
    /// Everything sized from the plan; nothing is allocated after this.
    ///
    /// `device_max_n` is what every device can render; `tour_seconds` how long a tour to ask for.
    #[must_use]
    pub fn new(plan: &ScenePlan, identity: Identity, device_max_n: f64, tour_seconds: f64) -> Self {
        let rate = plan.loop_.rate_hz;
        let timeout_ticks = (ANSWER_TIMEOUT_MS as f64 * 1e-3 * rate).ceil() as u64;
        let (placings, models) = placings(plan);
        let count = plan.active_objects();
        let all_awake = count == placings.len();
        let kept = BaseMeshStore::bytes_for(models, plan.cache_bytes, all_awake);
        let bytes = (plan.cache_bytes - kept) / count;
        let listed: Arc<[_]> = plan.objects.iter().map(|of| of.effects.clone()).collect();
        let new_seat = |_| ActiveObject::new(plan, bytes, identity, timeout_ticks, listed.clone());
        let mut seats: Vec<ActiveObject> = (0..count).map(new_seat).collect();
        if all_awake {
            for (seat, placing) in seats.iter_mut().zip(&placings) {
                seat.give(*placing, 0, None, 0);
            }
        }
        if let [only] = &mut seats[..] {
            // What is alone is never out of reach.
            for touch in &mut only.touches {
                touch.follow(None);
            }
        }
        let new_probe = |probe| Probe::new(plan, probe, device_max_n, tour_seconds);
        let probes: Vec<Probe> = plan.probes.iter().map(new_probe).collect();
        let movables = Movables::new(plan);
        let toured = probes.iter().filter_map(|probe| probe.tour.as_ref());
        Self {
            identity,
            operations: plan.loop_.operations,
            period_s: 1.0 / rate,
            tolerance_m: plan.accuracy.tolerance_m,
            cache_bytes: plan.cache_bytes,
            library: BaseMeshStore::new(models, kept),
            broad_phase: BroadPhase::new(placings.len(), movables.iter().count()),
            movables,
            seating: ActiveSet::new(placings.len(), toured.map(|tour| tour.object)),
            placings,
            probes,
            seats,
            taken: 0,
            order: Vec::with_capacity(count),
            replay_hash: 0,
        }
    }

    /// Work units that a tick may take at the most: the bound that `work_units` is compared with.
    #[must_use]
    pub fn work_budget(&self) -> u32 {
        ingest::budget(self.operations) + refine::budget(self.operations)
    }

    /// One tick.
    pub fn tick(
        &mut self,
        inputs: &TickInputs<'_>,
        outputs: &mut TickOutputs,
        observer: &mut impl StageObserver,
    ) {
        outputs.outbox.clear();
        outputs.reports.clear();
        let mut record = CoreRecord {
            stopping: inputs.stopping,
            ..CoreRecord::default()
        };
        for (k, probe) in self.probes.iter_mut().enumerate() {
            probe.sample(inputs, k);
        }
        for seat in &mut self.seats {
            seat.measured = None;
            seat.is_stalled = false;
            seat.tally = ObjectStats::default();
            seat.observe(inputs.station, inputs.tick);
        }
        self.move_objects(inputs.tick);
        record.unseated = self.seat_objects(inputs.tick, &mut outputs.outbox);
        observer.ended(Stage::BroadPhase);

        let waiting = inputs.chunks.iter().map(|run| run.len()).sum();
        let mut budget = self.budget(waiting);
        let inbox = budget.inbox;
        outputs.chunks_consumed = self.drain(inputs, &mut budget);
        record.work_units = inbox - budget.inbox;
        self.order_seats();
        for &(_, k) in &self.order {
            let seat = &mut self.seats[k];
            seat.aim(&self.probes);
            seat.predict(inputs.tick, waiting, &mut outputs.outbox);
        }
        observer.ended(Stage::Inbox);

        for &(_, k) in &self.order {
            self.seats[k].refine(inputs.tick, &mut budget);
        }
        let let_go = refine::LEAVING_A_TICK - budget.leaving;
        record.work_units += let_go.div_ceil(refine::CHANGES_PER_UNIT);
        observer.ended(Stage::Refine);
        for seat in &mut self.seats {
            seat.cache.refit();
        }
        observer.ended(Stage::Refit);

        let mut work = Work::default();
        let tallies = self.seats.iter().map(|seat| seat.tally);
        let operations: u32 = tallies.map(|tally| tally.vsplits + tally.ecols).sum();
        let most_work = PROXY_WORK.saturating_sub(PROXY_WORK_PER_OPERATION * operations);
        for &(_, k) in &self.order {
            let seat = &mut self.seats[k];
            seat.query(inputs.tick, &self.probes, &mut work, most_work);
            seat.look_ahead();
        }
        record.query_work = work.nodes + work.faces;
        record.unfinished = self.seats.iter().map(|seat| seat.tally.unfinished).sum();
        record.early = self.seats.iter().map(|seat| seat.tally.early).sum();
        observer.ended(Stage::Query);

        self.render(inputs, outputs, &mut record);
        self.finish_record(&mut record);
        outputs.record = record;
        observer.ended(Stage::Force);
    }

    /// What a tick with so many chunks that wait may do.
    fn budget(&self, waiting: usize) -> Budget {
        let is_waking = self.seats.iter().any(|seat| seat.waking.is_some());
        Budget {
            inbox: if is_waking {
                ingest::budget(self.operations)
            } else {
                ingest::allowed(waiting, self.operations)
            },
            operations: self.operations as u32,
            entries: self.operations as u32 * refine::ENTRIES_PER_OPERATION,
            leaving: refine::LEAVING_A_TICK,
        }
    }

    /// Takes base meshes and chunks in; returns how many chunks are done with.
    fn drain(&mut self, inputs: &TickInputs<'_>, budget: &mut Budget) -> usize {
        let Self {
            seats,
            library,
            probes,
            taken,
            ..
        } = self;
        let mut desk = TickContext {
            tick: inputs.tick,
            library,
            probes,
            budget,
        };
        for seat in seats.iter_mut() {
            seat.wake(&mut desk);
        }
        let [first, second] = inputs.chunks;
        for (k, chunk) in (0..CHUNKS_A_TICK).zip(first.iter().chain(second)) {
            if *taken >> k & 1 == 1 {
                continue;
            }
            let is_done = match seat_of(seats, chunk.header.object) {
                // The object has gone to sleep, or there is none: nobody waits for it.
                None => true,
                Some(seat) if seat.is_stalled => false,
                Some(seat) => seat.receive(chunk, &mut desk),
            };
            *taken |= u64::from(is_done) << k;
            if desk.budget.inbox == 0 {
                break;
            }
        }
        let consumed = taken.trailing_ones();
        *taken = taken.checked_shr(consumed).unwrap_or(0);
        consumed as usize
    }

    /// Puts the seats in order, the nearest to a contact first.
    fn order_seats(&mut self) {
        self.order.clear();
        for (k, seat) in self.seats.iter().enumerate() {
            if seat.placing.is_none() {
                continue;
            }
            let scale = seat.frame.map_or(1.0, |frame| frame.metres_per_unit);
            let followed = seat.touches.iter().filter(|touch| touch.is_followed);
            let clearance = followed.map(|touch| touch.clearance * scale);
            self.order
                .push((clearance.fold(f64::INFINITY, f64::min), k));
        }
        self.order
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    /// Each probe's force is the sum of its touches, through its gate; and the reports.
    fn render(
        &mut self,
        inputs: &TickInputs<'_>,
        outputs: &mut TickOutputs,
        record: &mut CoreRecord,
    ) {
        let is_open = !inputs.stopping && self.is_ready() && self.fault().is_none();
        outputs.wrenches.fill(Wrench::ZERO);
        outputs.contacts.fill(None);
        let due = inputs.tick.is_multiple_of(REPORT_EVERY);
        let clock = Clock {
            tick: inputs.tick,
            period_s: self.period_s,
        };
        for (k, probe) in self.probes.iter_mut().enumerate() {
            let mut wanted: Option<Rendered> = None;
            let mut strongest: Option<(f64, ProbeContact)> = None;
            let at = probe.pose.map_or(DVec3::ZERO, |pose| pose.position);
            let mut ahead = CarriedWork::default();
            for seat in &self.seats {
                let touch = &seat.touches[k];
                if let Some(rendered) = touch.rendered {
                    // A sum begins with its first term, not with a zero that would round.
                    wanted = Some(wanted.map_or(rendered, |sum| sum + rendered));
                    if let (false, Some(object)) = (self.movables.is_empty(), seat.object()) {
                        ahead = ahead + self.movables.work_ahead(object, &rendered.passive, at);
                    }
                }
                let (Some(felt), Some(rendered), Some(object), Some(frame)) =
                    (&touch.felt, &touch.rendered, seat.object(), seat.frame)
                else {
                    continue;
                };
                record.probes[k].add(felt, frame.metres_per_unit, seat.finest_tolerance());
                let force = rendered.passive.force.length();
                if strongest.is_none_or(|(most, _)| force > most) {
                    let contact = felt.contact;
                    strongest = Some((force, ProbeContact { object, contact }));
                }
            }
            let shares = probe.feel(clock, wanted.unwrap_or_default(), ahead, is_open);
            for seat in &self.seats {
                if let (false, Some(object), Some(rendered)) = (
                    self.movables.is_empty(),
                    seat.object(),
                    &seat.touches[k].rendered,
                ) {
                    let given = [rendered.passive * shares[0], rendered.active * shares[1]];
                    self.movables.push(object, k, given, at);
                }
            }
            let of_probe = &mut record.probes[k];
            of_probe.rejected_sample = probe.rejected;
            of_probe.clamped = probe.clamped;
            of_probe.energy_j = probe.energy.joules();
            let touched = strongest.map(|(_, touched)| touched);
            if let Some(place) = outputs.wrenches.get_mut(k) {
                *place = probe.wrench;
            }
            if let Some(place) = outputs.contacts.get_mut(k) {
                *place = touched;
            }
            if let (Some(pose), true) = (probe.pose, due)
                && outputs.reports.len() < outputs.reports.capacity()
            {
                outputs.reports.push(ContactReport {
                    client: self.identity.client,
                    tick: inputs.tick,
                    probe: k as u32,
                    object: touched.map_or(NONE, |touched| touched.object),
                    position: pose.position.to_array(),
                    orientation_wxyz: pose.wxyz(),
                    contact: touched.map_or([0.0; 3], |touched| touched.contact.point.to_array()),
                    force: probe.wrench.force.to_array(),
                });
            }
        }
    }

    /// Whether every model is known, so that any touch could be answered.
    pub(crate) fn is_ready(&self) -> bool {
        self.library.is_complete()
    }
}

/// The objects of a scene, and the number of different models.
fn placings(plan: &ScenePlan) -> (Vec<ObjectInstance>, usize) {
    let mut names: Vec<u64> = Vec::new();
    let placings = (0u32..).zip(&plan.objects).map(|(object, of)| {
        let name = Request::name_hash(&of.model.name());
        let known = names.iter().position(|&other| other == name);
        let model = known.unwrap_or(names.len());
        if known.is_none() {
            names.push(name);
        }
        ObjectInstance {
            object,
            model,
            name,
            pose: of.pose,
            before: None,
            scale: of.scale,
            surface: of.surface,
        }
    });
    let placings = placings.collect();
    (placings, names.len())
}
