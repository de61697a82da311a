//! The tick: the order of the algorithm, and its inputs and outputs.
//!
//! | step | does | thesis |
//! |---|---|---|
//! | sample | takes the devices' poses | |
//! | activate | moves objects, finds those near a probe | broad phase |
//! | receive | loads base meshes and records into the caches | Cache Agent |
//! | predict | names the regions that the probes will need, requests them | Mesh Subscriber, 5.6.2 |
//! | refine | splits, collapses, geomorphs | Figure 5.17 |
//! | refit | updates the AB-trees | |
//! | contact | advances the proxies, renders each pair | Physics Engine |
//! | render | sums the forces of each probe | |
//! | limit | energy account, limiter | |
//! | record | counters, hash | |
//!
//! Skipped periods have passed for the world, but not for the controller: velocities, the energy
//! account, bodies, phases of effects, a device's silence and what is measured of the link go by
//! the tick's index, since link and station go on. Horizons of session and front count only ticks
//! that were run (`Controller::own_tick`), since nothing could be taken in or done in between; so
//! do timeouts in a stall, but not where a slow machine skips a few periods again and again
//! (`MAX_WAITED_S` in `tuning.rs`).
//!
//! Force k acts over `[k, k + 1]`; the sample of tick k gives the force of tick k. The cache's
//! bytes are shared out to the active objects ([`scene::ScenePlan::active_objects`]) half of
//! them by importance; in equal parts where there are more objects than places. All active objects
//! draw on one budget of work, the nearest to a contact first.

use crate::active::active_set::ActiveSet;
use crate::active::object::ActiveObject;
use crate::budget::{Budget, QueryBudget};
use crate::contact::sphere_proxy::Contact;
use crate::controller::Controller;
use crate::force::effects::{Clock, Rendered};
use crate::force::limiter::Passed;
use crate::force::passivity::CarriedWork;
use crate::governor::TickLoad;
use crate::observer::{Stage, StageObserver, ToolBefore};
use crate::policy::reactive::Load;
use crate::record::CoreRecord;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::{Outbox, turn_of};
use crate::tuning::governor::{ENTRIES_SHARE, RECEIVED_SHARE, UPKEEP_SHARE, USUAL_TOOL_UNITS};
use crate::tuning::lod::{CHANGES_PER_UNIT, ENTRIES_PER_OPERATION};
use crate::tuning::streaming::MIN_UNITS;
use geometry::Wrench;
use glam::DVec3;
use haptic_device::Sample;
use mutants::{Mutant, is};
use protocol::ContactReport;
use scene::MAX_ACTIVE_OBJECTS;
use serde::{Deserialize, Serialize};
use spm::NONE;

/// Inputs of a tick.
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

/// Outputs of a tick; storage allocated once, by [`Controller::new_outputs`].
#[derive(Debug, Clone)]
pub struct TickOutputs {
    /// The wrench for each probe's device.
    pub wrenches: Vec<Wrench>,
    /// Requests to the station.
    pub outbox: Outbox,
    /// Contact reports to the station, one a probe every few ticks.
    pub reports: Vec<ContactReport>,
    /// The contact of each probe, of several objects the one that pushes most; `None` in free
    /// space.
    pub contacts: Vec<Option<ProbeContact>>,
    /// How many of the given chunks are done with.
    pub chunks_consumed: usize,
    /// Counters and measures of the tick.
    pub record: CoreRecord,
}

impl TickOutputs {
    /// Storage for a number of probes: with less, the wrench of one would go nowhere.
    fn new(probes: usize) -> Self {
        Self {
            wrenches: vec![Wrench::ZERO; probes],
            outbox: Outbox::new(2 * MAX_ACTIVE_OBJECTS),
            reports: Vec::with_capacity(probes),
            contacts: vec![None; probes],
            chunks_consumed: 0,
            record: CoreRecord::default(),
        }
    }

    /// Empties what a tick adds to.
    fn clear(&mut self) {
        self.outbox.clear();
        self.reports.clear();
        self.wrenches.fill(Wrench::ZERO);
        self.contacts.fill(None);
    }

    /// The contact of the first probe, model units.
    #[must_use]
    pub fn contact(&self) -> Option<Contact> {
        let first = self.contacts.first().copied().flatten();
        first.map(|of| of.contact)
    }
}

/// A contact of a probe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ProbeContact {
    /// Object of the scene.
    pub object: u32,
    /// The contact, in the units of the object's model.
    pub contact: Contact,
}

impl Controller {
    /// Storage for the outputs of its ticks; allocates.
    #[must_use]
    pub fn new_outputs(&self) -> TickOutputs {
        TickOutputs::new(self.probes.len())
    }

    /// One tick; `outputs` are those of [`Controller::new_outputs`].
    pub fn tick(
        &mut self,
        inputs: &TickInputs<'_>,
        outputs: &mut TickOutputs,
        observer: &mut impl StageObserver,
    ) {
        let tick = inputs.tick;
        let waiting = inputs.chunks.iter().map(|run| run.len()).sum();
        let mut record = CoreRecord {
            stopping: inputs.stopping,
            ..CoreRecord::default()
        };
        outputs.clear();

        let elapsed = self.begin(tick);
        self.sample(inputs, elapsed);
        let load = self.load(self.movables.awake());
        self.governor.begin_tick(load);
        let mut budget = self.budget(observer);
        let mut upkeep = budget.upkeep;
        record.unserved = self.activate(inputs, &mut budget, &mut outputs.outbox);
        self.count_load(&mut budget, &mut upkeep);
        budget.observer.ended(Stage::BroadPhase);

        budget.ingest = self.ingest_units(waiting);
        outputs.chunks_consumed = self.receive(inputs, &mut budget, &mut record);
        self.charge_refinement(upkeep - budget.upkeep);
        let requests = self.governor.time.requests(record.work_units);
        outputs.outbox.share_out(requests);
        self.predict(waiting, &mut outputs.outbox);
        let requests = outputs.outbox.requests().len();
        // To look at a region costs about as much as a unit.
        let units = record.work_units + outputs.outbox.looked_at();
        self.governor.time.charge_inbox(units, requests);
        // Received data and operations share their time.
        upkeep -= budget.upkeep;
        self.limit_refinement(&mut budget, 1.0 - UPKEEP_SHARE);
        upkeep += budget.upkeep;
        budget.observer.ended(Stage::Inbox);

        self.refine(&mut budget, &mut record, upkeep);
        observer.ended(Stage::Refine);
        self.refit();
        observer.ended(Stage::Refit);

        self.contact(tick, &mut record, observer);
        observer.ended(Stage::Query);

        let is_open =
            !inputs.stopping && self.is_ready() && (is(Mutant::Fault) || self.fault().is_none());
        let is_open = is_open && (inputs.station != 0 || !is(Mutant::Silence));
        for probe in 0..self.probes.len() {
            let rendered = self.render(probe, &mut record);
            let passed = self.limit(probe, tick, is_open, &rendered);
            record.probes[probe].pass(passed.force);
            self.report(probe, tick, &rendered, outputs, &mut record);
        }
        self.record(outputs, &mut record);
        outputs.record = record;
        observer.ended(Stage::Force);
    }

    /// Periods since the tick before: more than 1 where some were skipped.
    fn begin(&mut self, tick: u64) -> u64 {
        let Some(last) = self.last_tick.replace(tick) else {
            self.own_tick = tick;
            return 1;
        };
        self.own_tick += 1;
        let elapsed = tick.saturating_sub(last).max(1);
        self.active.meter.begin_tick(elapsed - 1);
        if elapsed > 1 {
            // What still waits here has come: then no station is silent.
            let is_empty = self.active.meter.left() == 0;
            let waited = if is_empty {
                self.horizons.waited(elapsed - 1)
            } else {
                0
            };
            for object in &mut self.active.objects {
                object.front.skip_periods(elapsed - 1);
                object.session.skip_periods(waited);
            }
        }
        elapsed
    }

    /// Takes the devices' poses, `elapsed` periods after the tick before.
    fn sample(&mut self, inputs: &TickInputs<'_>, elapsed: u64) {
        for (k, probe) in self.probes.iter_mut().enumerate() {
            probe.sample(inputs.samples.get(k).copied().flatten(), elapsed);
        }
    }

    /// Moves the objects, and makes those near a probe active. Returns the pairs of a probe and an
    /// object that could touch though the object is not ready.
    fn activate(
        &mut self,
        inputs: &TickInputs<'_>,
        budget: &mut Budget,
        outbox: &mut Outbox,
    ) -> u32 {
        let is_another = self
            .active
            .begin_tick(inputs.station, self.own_tick, inputs.chunks);
        self.active.move_objects(&mut self.movables, inputs.tick);
        for (k, probe) in self.probes.iter_mut().enumerate() {
            probe.retry_tour(self.own_tick, is_another);
            let work = self.movables.take_carried_work(k);
            for (sum, work) in probe.carried.iter_mut().zip(work) {
                *sum += work;
            }
        }
        let own_tick = self.own_tick;
        self.active.activate(&self.probes, own_tick, budget, outbox)
    }

    /// What the tick does in any case, with so many steps of bodies, as far as it is known by now.
    fn load(&self, body_steps: usize) -> TickLoad {
        let (objects, probes) = (self.active.instances.len(), self.probes.len());
        TickLoad::new(self.active.near_pairs(), objects, probes, body_steps)
    }

    /// Counts the pairs that have begun in this tick, and the steps that bodies took after missed
    /// ones: they are allowed on any machine, and what they take is not there for anything else.
    /// `upkeep`: the budget for it before any was spent; lowered where the budget is.
    fn count_load(&mut self, budget: &mut Budget, upkeep: &mut u32) {
        let spent = *upkeep - budget.upkeep;
        let load = TickLoad {
            entries: spent.div_ceil(CHANGES_PER_UNIT),
            ..self.load(self.movables.steps())
        };
        self.governor.set_load(&load);
        self.limit_refinement(budget, 1.0 - UPKEEP_SHARE - RECEIVED_SHARE);
        *upkeep = spent + budget.upkeep;
    }

    /// The work of a tick, but for received data. While that comes, operations have what it leaves.
    fn budget<'a>(&self, observer: &'a mut dyn StageObserver) -> Budget<'a> {
        let operations = self.operations as u32;
        let mut budget = Budget {
            observer,
            ingest: 0,
            unspent_ingest: 0,
            operations: operations * if is(Mutant::Budget) { 4 } else { 1 },
            faces: 0,
            max_fan: 0,
            entries: operations * ENTRIES_PER_OPERATION,
            prepaid: 0,
            upkeep: self.work.upkeep,
            forgotten: self.work.forgotten,
        };
        self.limit_refinement(&mut budget, 1.0 - UPKEEP_SHARE - RECEIVED_SHARE);
        budget.forgotten = budget.forgotten.min(budget.upkeep / 2);
        budget
    }

    /// Limits refinement to the time there is for it now; `share`: the part of it for operations.
    fn limit_refinement(&self, budget: &mut Budget, share: f64) {
        let time = &self.governor.time;
        budget.set_faces(time.faces(share));
        budget.entries = budget.entries.min(time.entries(ENTRIES_SHARE));
        budget.upkeep = budget.upkeep.min(time.upkeep());
    }

    /// Charges what was split, collapsed and gone through in the tick so far; `upkeep`: entries of
    /// the latter. Returns the faces that have changed.
    fn charge_refinement(&mut self, upkeep: u32) -> u32 {
        let stats = || self.active.objects.iter().map(|of| of.front.stats);
        let faces = stats().map(|of| of.faces).sum();
        let entries: u32 = stats().map(|of| of.entries).sum();
        let entries = entries + upkeep.div_ceil(CHANGES_PER_UNIT);
        self.governor.time.set_refinement(faces, entries);
        faces
    }

    /// The work for received data in a tick with so many chunks that wait.
    fn ingest_units(&self, waiting: usize) -> u32 {
        let is_loading = self.active.objects.iter().any(|of| of.session.is_loading());
        let most = if is_loading {
            self.work.max_ingest(self.operations)
        } else {
            self.work.ingest_for(waiting, self.operations)
        };
        // With less no slot would ever be taken.
        most.min(self.governor.time.received_units().max(MIN_UNITS))
    }

    /// Takes base meshes and chunks in. Returns how many chunks are done with.
    fn receive(
        &mut self,
        inputs: &TickInputs<'_>,
        budget: &mut Budget,
        record: &mut CoreRecord,
    ) -> usize {
        let before = budget.ingest;
        let (active, probes) = (&mut self.active, &mut self.probes);
        let consumed = active.receive(inputs.chunks, probes, self.own_tick, budget);
        record.work_units = before - budget.ingest - budget.unspent_ingest;
        consumed
    }

    /// Predicts and requests regions.
    fn predict(&mut self, waiting: usize, outbox: &mut Outbox) {
        self.active.sort_by_clearance();
        let now = (self.own_tick, waiting);
        let ActiveSet {
            order,
            objects,
            meter,
            ..
        } = &mut self.active;
        // Each has its turn, whatever those do that are nearer.
        let turn = turn_of(self.own_tick, order.len());
        for (&(_, k), place) in order.iter().zip(0..) {
            outbox.begin_session(usize::from(Some(place) < turn));
            objects[k].predict(&self.probes, now, meter, outbox);
        }
    }

    /// Splits, collapses and geomorphs. `allowed_upkeep`: entries for upkeep that the tick began
    /// with.
    fn refine(&mut self, budget: &mut Budget, record: &mut CoreRecord, allowed_upkeep: u32) {
        for &(_, k) in &self.active.order {
            let operations = self.active.operations_of(k, self.governor.operations());
            let object = &mut self.active.objects[k];
            let detail = self.policy.detail(object.front.detail(), || object.seen());
            object.front.set_detail(detail);
            let steps = self.policy.steps(self.governor.steps());
            object.front.set_time(operations, steps);
            object.refine(self.own_tick, budget);
        }
        let upkeep = allowed_upkeep - budget.upkeep;
        record.work_units += upkeep.div_ceil(CHANGES_PER_UNIT);
        record.operation_faces = self.charge_refinement(upkeep);
    }

    /// Updates the AB-trees.
    fn refit(&mut self) {
        for object in &mut self.active.objects {
            object.refit();
        }
    }

    /// Advances the proxies and renders the forces of each pair.
    fn contact(&mut self, tick: u64, record: &mut CoreRecord, observer: &mut impl StageObserver) {
        self.active.order_pairs(self.own_tick);
        let (pairs, objects) = (&self.active.pairs, &mut self.active.objects);
        let time = &mut self.governor.time;
        let probes = pairs.iter().map(|&(_, probe)| probe);
        let ns = time.for_queries();
        let mut budget = QueryBudget::new(&self.work, (time.costs(), ns), probes, observer);
        // A tool may need several ticks with all time that there is, a ball does not.
        let is_short = f64::from(ns) < USUAL_TOOL_UNITS * time.costs().tool;
        for &(k, probe) in pairs {
            if let Some((proxy, surface, goal)) = objects[k].tool_before(probe) {
                let tool = ToolBefore {
                    proxy,
                    surface,
                    goal,
                };
                budget.observer.tool_before(probe, &tool);
            }
            objects[k].find_contact(tick, (probe, &self.probes[probe]), &mut budget);
        }
        // The nearest to a contact looks first: where it goes matters most.
        for &(k, probe) in pairs.iter().rev() {
            objects[k].look_ahead(probe, &mut budget);
        }
        time.charge_queries(budget.spent_ns());
        record.query_work = budget.spent();
        record.query_units = budget.units();
        record.unfinished = objects.iter().map(|of| of.contacts.unfinished).sum();
        let with_ball = objects.iter().any(|of| of.contacts.unfinished_balls > 0);
        let is_cut = with_ball || (is_short && record.unfinished > 0);
        let can_ask_for_less = objects.iter().any(ActiveObject::can_ask_for_less);
        self.governor
            .end_queries(self.own_tick, is_cut, can_ask_for_less);
        self.end_policy();
        record.allowed_ns = self.governor.time.allowed() as u32;
        record.spent_ns = self.governor.time.spent.total() as u32;
        record.slowness = self.governor.slowness();
        record.time_share = self.governor.time_share();
        record.operations = self.governor.operations();
        let contacts = || self.active.objects.iter().map(|of| &of.contacts);
        record.early = contacts().map(|of| of.early).sum();
        record.late_contacts = contacts().map(|of| of.late_contacts).sum();
        record.stuck = contacts().map(|of| of.stuck).sum();
    }

    /// Tells the policy what the tick took.
    fn end_policy(&mut self) {
        let (time, objects) = (&self.governor.time, &self.active.objects);
        let left: u32 = objects.iter().map(|of| of.front.stats.left).sum();
        let load = Load {
            allowed: time.allowed(),
            spent: time.spent.total(),
            left: f64::from(left) * time.operation_ns(),
        };
        self.policy
            .end_tick(load, || objects.iter().any(ActiveObject::can_rise));
    }

    /// Sums the forces of a probe's pairs.
    fn render(&self, k: usize, record: &mut CoreRecord) -> ProbeForces {
        let mut sum: Option<Rendered> = None;
        let mut strongest: Option<(f64, ProbeContact)> = None;
        let mut ahead = CarriedWork::default();
        let at = self.position_of(k);
        for active in &self.active.objects {
            let pair = &active.contacts.pairs[k];
            if let Some(rendered) = pair.rendered {
                // A sum begins with its first term, not with a zero that would round.
                sum = Some(sum.map_or(rendered, |sum| sum + rendered));
                if let (false, Some(object)) = (self.movables.is_empty(), active.object()) {
                    ahead = ahead + self.movables.work_ahead(object, &rendered.passive, at);
                }
            }
            let (Some(state), Some(rendered), Some(object), Some(frame)) =
                (&pair.contact, &pair.rendered, active.object(), active.frame)
            else {
                continue;
            };
            record.probes[k].add(
                state,
                frame.metres_per_unit,
                active.front.finest_tolerance(),
            );
            let force = rendered.passive.force.length();
            if strongest.is_none_or(|(most, _)| force > most) {
                let contact = state.contact;
                strongest = Some((force, ProbeContact { object, contact }));
            }
        }
        ProbeForces {
            sum: sum.unwrap_or_default(),
            ahead,
            strongest: strongest.map(|(_, contact)| contact),
        }
    }

    /// Passes a probe's forces through energy account and limiter; the objects that move get the
    /// reaction. What has passed of the passive forces.
    fn limit(&mut self, k: usize, tick: u64, is_open: bool, forces: &ProbeForces) -> Passed {
        let at = self.position_of(k);
        let clock = Clock {
            tick,
            period_s: self.period_s,
        };
        let probe = &mut self.probes[k];
        let shares = probe.limit(clock, forces.sum, forces.ahead, is_open);
        if self.movables.is_empty() {
            return shares[0];
        }
        for active in &self.active.objects {
            let rendered = &active.contacts.pairs[k].rendered;
            if let (Some(object), Some(rendered)) = (active.object(), rendered) {
                let passed = shares[0].times(if is(Mutant::Reaction) { 0.5 } else { 1.0 });
                let given = [(rendered.passive, passed), (rendered.active, shares[1])];
                self.movables.push(object, k, given, at);
            }
        }
        shares[0]
    }

    /// Writes a probe's outputs.
    fn report(
        &self,
        k: usize,
        tick: u64,
        forces: &ProbeForces,
        outputs: &mut TickOutputs,
        record: &mut CoreRecord,
    ) {
        let probe = &self.probes[k];
        let of_probe = &mut record.probes[k];
        of_probe.rejected_sample = probe.rejected;
        of_probe.clamped = probe.clamped;
        of_probe.energy_j = probe.energy.joules();
        of_probe.given_j = probe.energy.given_j();
        let contact = forces.strongest;
        if let Some(place) = outputs.wrenches.get_mut(k) {
            *place = probe.wrench;
        }
        if let Some(place) = outputs.contacts.get_mut(k) {
            *place = contact;
        }
        if let (Some(pose), true) = (
            probe.pose,
            self.own_tick.is_multiple_of(self.horizons.report),
        ) && outputs.reports.len() < outputs.reports.capacity()
        {
            outputs.reports.push(ContactReport {
                client: self.identity.client,
                tick,
                probe: k as u32,
                object: contact.map_or(NONE, |contact| contact.object),
                position: pose.position.to_array(),
                orientation_wxyz: pose.wxyz(),
                contact: contact.map_or([0.0; 3], |of| of.contact.point.to_array()),
                force: probe.wrench.force.to_array(),
            });
        }
    }

    /// Position of a probe in this tick, world, metres; the origin before its first sample.
    fn position_of(&self, k: usize) -> DVec3 {
        self.probes[k]
            .pose
            .map_or(DVec3::ZERO, |pose| pose.position)
    }
}

/// Forces that the pairs of a probe render in a tick.
struct ProbeForces {
    sum: Rendered,
    /// Work of the passive forces over the motion of the material in the coming period.
    ahead: CarriedWork,
    /// The contact that pushes most.
    strongest: Option<ProbeContact>,
}
