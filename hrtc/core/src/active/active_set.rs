//! The active set: objects near a probe, each with session, front and contacts.
//!
//! An object becomes active when a probe comes near, long before a contact is possible: the reach
//! grows with the speed. It stays active as long as no other object needs its place; then those go
//! first that have been out of reach for longest. Where more objects are in reach than there are
//! places, the nearest have them. One object becomes active a tick, so that a tick stays short.

use super::broad_phase::{Ball, BroadPhase, Near};
use super::faults::ModelFaults;
use super::object::ActiveObject;
use super::shares::{part_of, weights_of};
use crate::bodies::{Extent, Movables};
use crate::budget::Budget;
use crate::cache::base_mesh_store::{BaseMeshStore, Model};
use crate::horizons::Horizons;
use crate::instance::{ModelFrame, ObjectInstance};
use crate::probe::Probe;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::link_meter::{LinkMeter, Sent};
use crate::streaming::session::TickContext;
use crate::streaming::subscriber::Identity;
use crate::streaming::{Fault, Outbox};
use crate::tuning::active::{NEARER, PLACED_A_TICK, REACH_RADII};
use glam::DVec3;
use protocol::Request;
use scene::{MAX_PROBES, ScenePlan};
use std::collections::VecDeque;
use std::sync::Arc;

/// Received chunks that are looked at in a tick: one for each bit of a set.
const MAX_CHUNKS: u32 = u64::BITS;

/// All objects of a scene, and those that are active.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct ActiveSet {
    /// All objects of the scene.
    pub instances: Vec<ObjectInstance>,
    /// Places for active objects.
    pub objects: Vec<ActiveObject>,
    /// Base meshes of all models.
    pub store: BaseMeshStore,
    /// Places in the order of a tick: the object nearest to a contact first, with its urgency: a
    /// distance, which importance makes shorter.
    pub order: Vec<(f64, usize)>,
    /// Pairs whose contact is looked for in this tick, as place and probe, in the order in which
    /// they draw on its work.
    pub pairs: Vec<(usize, usize)>,
    broad_phase: BroadPhase,
    horizons: Horizons,
    /// Of the link to the station, which all sessions share.
    pub meter: LinkMeter,
    /// Objects whose box is not known yet, the next one last; at first in the order in which models
    /// are requested.
    unplaced: VecDeque<u32>,
    /// Objects in the order in which their models are requested: those of scripted paths first.
    to_fetch: Vec<u32>,
    /// The first of them whose model may be unknown.
    next_fetch: usize,
    /// Faults that ended the use of each model.
    faults: ModelFaults,
    /// Incarnation of the last station that lived.
    station: u64,
    /// The epoch in which the next session of each object begins.
    epochs: Vec<u32>,
    /// Received chunks that were taken out of turn, the oldest chunk at bit 0: an older one waits
    /// for room.
    taken: u64,
    /// Weight of each place in the shares of the cache.
    pub(super) weights: Vec<f64>,
}

impl ActiveSet {
    /// Everything sized from the plan; nothing is allocated after this. `toured`: objects with a
    /// scripted path.
    #[must_use]
    pub fn new(
        plan: &ScenePlan,
        identity: Identity,
        moving: usize,
        toured: impl Iterator<Item = u32>,
    ) -> Self {
        let horizons = Horizons::new(plan.loop_.rate_hz);
        let (instances, models) = instances_of(plan);
        let count = plan.active_objects();
        let all_active = count == instances.len();
        let stored = BaseMeshStore::bytes_for(models, plan.cache_bytes, all_active);
        let weights = weights_of(&instances, count);
        let shared = plan.cache_bytes - stored;
        let effects: Arc<[_]> = plan.objects.iter().map(|of| of.effects.clone()).collect();
        let new_place = |k| {
            let bytes = part_of(shared, &weights, k);
            ActiveObject::new(plan, bytes, identity, &horizons, effects.clone())
        };
        let mut objects: Vec<ActiveObject> = (0..count).map(new_place).collect();
        if all_active {
            for (object, instance) in objects.iter_mut().zip(&instances) {
                object.assign(*instance, 0, None, 0);
            }
        }
        if let [only] = &mut objects[..] {
            // A single place always counts as near.
            for probe in 0..plan.probes.len() {
                only.approached_by(probe, None);
            }
        }
        let mut to_fetch: Vec<u32> = toured.collect();
        to_fetch.extend(0..instances.len() as u32);
        Self {
            store: BaseMeshStore::new(models, stored),
            broad_phase: BroadPhase::new(instances.len(), moving),
            meter: LinkMeter::new(&horizons),
            horizons,
            unplaced: to_fetch.iter().rev().copied().collect(),
            to_fetch,
            next_fetch: 0,
            faults: ModelFaults::new(models),
            station: 0,
            epochs: vec![0; instances.len()],
            order: Vec::with_capacity(count),
            pairs: Vec::with_capacity(count * plan.probes.len()),
            taken: 0,
            weights,
            instances,
            objects,
        }
    }

    /// A tick begins; `station` is the incarnation of the living one. Returns whether that is
    /// another one, which may serve what the last one could not.
    pub fn begin_tick(&mut self, station: u64, tick: u64) -> bool {
        for object in &mut self.objects {
            object.begin_tick(station, tick, &self.meter);
        }
        let is_another = station != 0 && station != self.station;
        if is_another {
            self.station = station;
            self.faults.clear();
        }
        let after = self.horizons.refused;
        let is_known = |model| self.store.model(model).is_some();
        if station != 0 && self.faults.try_again(tick, after, is_known) {
            for object in &mut self.objects {
                object.try_place_again(tick);
            }
        }
        is_another
    }

    /// Whether every model is known that can be.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.store.known() + self.faults.lost() == self.faults.models()
    }

    /// Whether nothing of the scene can be touched: no model is known or can be.
    #[must_use]
    pub fn is_lost(&self) -> bool {
        self.faults.lost() == self.faults.models()
    }

    /// Whether a fault ended the use of any model.
    #[must_use]
    pub fn has_fault(&self) -> bool {
        self.faults.any()
    }

    /// The fault that ended the use of an object's model.
    #[must_use]
    pub fn fault_of(&self, instance: &ObjectInstance) -> Option<Fault> {
        self.faults.of(instance.model)
    }

    /// Whether an object's model is not known and is not to be asked for.
    fn is_lost_object(&self, object: u32) -> bool {
        let model = self.instances[object as usize].model;
        self.faults.is_closed(model) && self.store.model(model).is_none()
    }

    /// Takes the faults of the sessions over.
    fn note_faults(&mut self, tick: u64) {
        let ended = self.objects.iter().filter(|of| of.session.is_ended());
        let faults = ended.filter_map(|of| Some((of.instance?.model, of.session.fault)));
        let is_known = |model| self.store.model(model).is_some();
        self.faults.note(faults, is_known, tick);
    }

    /// The active object of the scene's number, if it is active.
    pub fn get_mut(&mut self, object: u32) -> Option<&mut ActiveObject> {
        let object = Some(object);
        self.objects.iter_mut().find(|of| of.object() == object)
    }

    /// The objects that move take their poses of this tick.
    pub fn move_objects(&mut self, movables: &mut Movables, tick: u64) {
        if movables.is_empty() {
            return;
        }
        movables.set_extent(|object| {
            let instance = &self.instances[object as usize];
            let header = &self.store.model(instance.model)?.header;
            let frame = ModelFrame::new(instance.pose, instance.scale, header);
            Extent::new(header, frame.metres_per_unit)
        });
        movables.step(tick);
        for (object, body) in movables.moved() {
            let instance = &mut self.instances[object as usize];
            instance.pose = body.pose();
            instance.before = body.before();
            let (pose, before) = (instance.pose, instance.before);
            if let Some(model) = self.store.model(instance.model) {
                place(&mut self.broad_phase, instance, model);
            }
            if let Some(active) = self.get_mut(object) {
                active.move_to(pose, before);
            }
        }
        let moved = movables.moved();
        self.broad_phase.set_displacements(
            moved.map(|(object, body)| (object as usize, body.max_displacement())),
        );
    }

    /// Takes base meshes and chunks in. Returns how many chunks are done with.
    pub fn receive(
        &mut self,
        chunks: [&[InboxChunk]; 2],
        probes: &mut [Probe],
        tick: u64,
        budget: &mut Budget,
    ) -> usize {
        let waiting = chunks.iter().map(|run| run.len()).sum::<usize>();
        let mut new = chunks.into_iter().flatten().skip(self.meter.left());
        let ends = new.next().map(|first| [first, new.last().unwrap_or(first)]);
        let sent = ends.map(|of| of.map(|chunk| Sent::of(&chunk.header)));
        self.meter.arrive(waiting, sent, tick);
        let mut context = TickContext {
            tick,
            store: &mut self.store,
            probes,
            budget,
            meter: &mut self.meter,
        };
        for object in &mut self.objects {
            object.load_stored(&mut context);
            object.retry_tour(context.probes);
        }
        let consumed = Self::take_chunks(&mut self.objects, &mut self.taken, chunks, &mut context);
        self.meter.leave(waiting - consumed);
        for object in &mut self.objects {
            object.go_on_unloading(budget);
        }
        // Also where a model has come that was given up.
        if self.faults.lost() > 0 || self.objects.iter().any(|of| of.session.is_ended()) {
            self.note_faults(tick);
        }
        consumed
    }

    /// Gives the chunks to their objects. Returns how many, from the oldest on, are done with.
    fn take_chunks(
        objects: &mut [ActiveObject],
        taken: &mut u64,
        chunks: [&[InboxChunk]; 2],
        context: &mut TickContext<'_, '_>,
    ) -> usize {
        let [first, second] = chunks;
        for (k, chunk) in (0..MAX_CHUNKS).zip(first.iter().chain(second)) {
            if *taken >> k & 1 == 1 {
                continue;
            }
            let number = Some(chunk.header.object);
            let object = objects.iter_mut().find(|of| of.object() == number);
            // Chunks of an object that is not active are dropped.
            let is_done = object.is_none_or(|object| object.receive(chunk, context));
            *taken |= u64::from(is_done) << k;
            if context.budget.ingest == 0 {
                break;
            }
        }
        let consumed = taken.trailing_ones();
        *taken = taken.checked_shr(consumed).unwrap_or(0);
        consumed as usize
    }

    /// Sorts the places, the object nearest to a contact first; one of twice the importance counts
    /// as half as far.
    pub fn sort_by_clearance(&mut self) {
        self.order.clear();
        for (k, object) in self.objects.iter().enumerate() {
            if object.instance.is_some() {
                self.order.push((object.urgency(), k));
            }
        }
        self.order
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    /// Orders the pairs of a tick. The pair of each probe that is nearest to a contact comes last,
    /// of these a tool's after a ball's: the others need little and leave it the rest. The probes
    /// take turns in being the last.
    pub fn order_pairs(&mut self, tick: u64) {
        self.pairs.clear();
        let mut nearest = [(f64::INFINITY, usize::MAX); MAX_PROBES];
        for &(_, place) in &self.order {
            let object = &self.objects[place];
            let Some(frame) = object.frame else {
                continue;
            };
            let pairs = object.contacts.pairs.iter().enumerate();
            for (probe, pair) in pairs.filter(|(_, pair)| pair.is_near && pair.goal.is_some()) {
                self.pairs.push((place, probe));
                let clearance_m = pair.clearance * frame.metres_per_unit;
                if clearance_m < nearest[probe].0 || nearest[probe].1 == usize::MAX {
                    nearest[probe] = (clearance_m, place);
                }
            }
        }
        self.pairs.sort_unstable_by_key(|&(place, probe)| {
            let turn = (tick + probe as u64) % MAX_PROBES as u64;
            let pair = &self.objects[place].contacts.pairs[probe];
            (nearest[probe].1 == place, pair.proxy.is_tool(), turn, place)
        });
    }

    /// Pairs of a ball, and of a tool, and an object near it, as the tick before left them.
    #[must_use]
    pub fn near_pairs(&self) -> [usize; 2] {
        let known = self.objects.iter().filter(|of| of.frame.is_some());
        let near = known.flat_map(|of| of.contacts.pairs.iter().filter(|pair| pair.is_near));
        let tools = near.clone().filter(|pair| pair.tool().is_some()).count();
        [near.count() - tools, tools]
    }

    /// Finds the objects near a probe, and makes the one that needs it most active. Returns the
    /// pairs of a probe and an object that could touch now though the object is not ready.
    pub fn activate(
        &mut self,
        probes: &[Probe],
        tick: u64,
        budget: &mut Budget,
        outbox: &mut Outbox,
    ) -> u32 {
        if self.instances.len() == 1 {
            return 0;
        }
        self.place_objects();
        let reach_ticks = self.horizons.reach;
        let balls = probes.iter().enumerate().filter_map(|(probe, p)| {
            Some(Ball {
                probe,
                centre: p.pose?.position,
                radius: REACH_RADII * p.reach_m + reach_ticks * p.speed,
            })
        });
        self.broad_phase.find(balls, reach_ticks);
        self.note_needs(probes, tick);
        if self.objects.len() < self.instances.len() {
            self.activate_one(probes, tick, budget, outbox);
        }
        self.share_credit(tick);
        self.count_unserved(probes)
    }

    /// Tells the broad phase where objects are whose models have become known: at once where an
    /// object can be touched by now, and the others in turn. None waits for another's model: a hand
    /// would enter it.
    fn place_objects(&mut self) {
        if self.unplaced.is_empty() {
            return;
        }
        for active in self.objects.iter().filter(|of| of.is_ready()) {
            if let Some(instance) = &active.instance
                && let Some(model) = self.store.model(instance.model)
            {
                place(&mut self.broad_phase, instance, model);
            }
        }
        for _ in 0..PLACED_A_TICK.min(self.unplaced.len()) {
            let Some(object) = self.unplaced.pop_back() else {
                return;
            };
            let instance = &self.instances[object as usize];
            match self.store.model(instance.model) {
                Some(model) => place(&mut self.broad_phase, instance, model),
                None => self.unplaced.push_front(object),
            }
        }
    }

    /// Notes which active objects are needed in this tick, and begins and ends the pairs with their
    /// probes.
    fn note_needs(&mut self, probes: &[Probe], tick: u64) {
        for object in &mut self.objects {
            object.distance = f64::INFINITY;
        }
        for k in 0..self.broad_phase.near().len() {
            let near = self.broad_phase.near()[k];
            if let Some(object) = self.get_mut(near.object as u32) {
                object.comes_near(near, &probes[near.probe], tick);
            }
        }
        for active in &mut self.objects {
            let object = active.object();
            let awaits = object.is_some_and(|o| probes.iter().any(|p| p.awaits_tour_of(o)));
            let is_used = object.is_some() && !active.session.is_ended();
            active.is_pinned = is_used && (!active.is_ready() || awaits);
            if active.contacts.any_contact() {
                active.distance = 0.0;
            }
            if active.is_pinned || active.distance.is_finite() {
                active.needed = tick;
            }
            for pair in &mut active.contacts.pairs {
                if pair.contact.is_some() {
                    pair.near_at = tick;
                }
                if pair.is_near && pair.near_at + self.horizons.sleep < tick {
                    pair.end();
                }
            }
        }
    }

    /// Makes the object active that needs it most. A place that changes hands forgets the object
    /// before first, over as many ticks as that takes.
    fn activate_one(
        &mut self,
        probes: &[Probe],
        tick: u64,
        budget: &mut Budget,
        outbox: &mut Outbox,
    ) {
        let Some((object, distance)) = self.next_to_activate(probes) else {
            return;
        };
        let Some(k) = self.place_for(distance, tick) else {
            return;
        };
        let active = &mut self.objects[k];
        if let Some(before) = active.object() {
            let epoch = active.session.close(outbox, tick);
            self.epochs[before as usize] = epoch.wrapping_add(1);
            active.vacate(tick);
        }
        if !active.is_vacant(budget) {
            return;
        }
        let instance = self.instances[object as usize];
        let is_stored = self.store.slots(instance.model).is_some();
        let stored = self.store.model(instance.model).filter(|_| is_stored);
        let epoch = self.epochs[object as usize];
        active.assign(instance, epoch, stored, tick);
        for near in self.broad_phase.near() {
            if near.object == object as usize {
                active.comes_near(*near, &probes[near.probe], tick);
            }
        }
    }

    /// Whether an object is active.
    fn is_active(&self, object: u32) -> bool {
        self.objects.iter().any(|of| of.object() == Some(object))
    }

    /// The object that needs most to become active, and its distance from a probe: one whose
    /// scripted path is to be made, one in reach, one whose model is not known yet.
    fn next_to_activate(&mut self, probes: &[Probe]) -> Option<(u32, f64)> {
        let toured = probes.iter().find_map(|probe| {
            let tour = probe.tour.as_ref().filter(|tour| tour.is_awaited())?;
            let is_needed = !self.is_active(tour.object) && !self.is_lost_object(tour.object);
            is_needed.then_some((tour.object, 0.0))
        });
        if toured.is_some() {
            return toured;
        }
        let near = self.broad_phase.near().iter().find_map(|near| {
            let object = near.object as u32;
            let is_needed = !self.is_active(object) && !self.is_lost_object(object);
            is_needed.then_some((object, near.distance))
        });
        near.or_else(|| {
            let object = self.next_to_fetch()?;
            Some((object, f64::INFINITY))
        })
    }

    /// An object whose model is neither known nor requested.
    fn next_to_fetch(&mut self) -> Option<u32> {
        if self.is_complete() && !self.faults.is_asking() {
            return None;
        }
        let (instances, store) = (&self.instances, &self.store);
        let model = |object: u32| instances[object as usize].model;
        while let Some(&object) = self.to_fetch.get(self.next_fetch)
            && store.model(model(object)).is_some()
        {
            self.next_fetch += 1;
        }
        let rest = &self.to_fetch[self.next_fetch..];
        rest.iter().copied().find(|&object| {
            let is_coming =
                |of: &ActiveObject| of.instance.is_some_and(|p| p.model == model(object));
            let is_unknown = store.model(model(object)).is_none();
            is_unknown && !self.is_lost_object(object) && !self.objects.iter().any(is_coming)
        })
    }

    /// The place for an object at a distance, metres; infinite for one whose model is only to be
    /// known.
    fn place_for(&self, distance: f64, tick: u64) -> Option<usize> {
        let places = || self.objects.iter().enumerate();
        if let Some((k, _)) = places().find(|(_, of)| of.instance.is_none()) {
            return Some(k);
        }
        let waits = if distance.is_finite() {
            self.horizons.sleep
        } else {
            0
        };
        let idle = places().filter(|(_, of)| !of.is_pinned && of.needed + waits < tick);
        let longest = idle.min_by_key(|(_, of)| of.needed);
        let farthest = || {
            let farther = places().filter(|(_, of)| {
                !of.is_pinned && of.distance > 0.0 && of.distance > NEARER * distance
            });
            farther.max_by(|(_, a), (_, b)| a.distance.total_cmp(&b.distance))
        };
        longest.or_else(farthest).map(|(k, _)| k)
    }

    /// Pairs of a probe and an object that could touch now though the object is not ready.
    fn count_unserved(&self, probes: &[Probe]) -> u32 {
        if !self.is_complete() {
            return 0;
        }
        let within = self.broad_phase.near().iter().filter(|near| {
            let probe = &probes[near.probe];
            let motion = self.broad_phase.displacement(near.object);
            near.distance <= probe.reach_m + self.horizons.touch * (probe.speed + motion)
        });
        let missing = within.filter(|near| {
            let object = Some(near.object as u32);
            let is_ready = |of: &ActiveObject| of.object() == object && of.is_ready();
            !self.objects.iter().any(is_ready)
        });
        missing.count() as u32
    }
}

impl ActiveObject {
    /// A probe is in reach.
    fn comes_near(&mut self, near: Near, probe: &Probe, tick: u64) {
        self.distance = self.distance.min(near.distance);
        if self.instance.is_none() {
            return;
        }
        let pair = &mut self.contacts.pairs[near.probe];
        pair.near_at = tick;
        if !pair.is_near {
            self.approached_by(near.probe, probe.last);
        }
    }
}

/// Tells the broad phase where an object is.
fn place(broad_phase: &mut BroadPhase, instance: &ObjectInstance, model: &Model) {
    let frame = ModelFrame::new(instance.pose, instance.scale, &model.header);
    let [lower, upper] = [model.header.lower, model.header.upper]
        .map(|corner| DVec3::from_array(corner) - frame.origin);
    // The front of a coarse mesh may stick out by R.
    let (lower, upper) = frame.box_to_world(lower, upper, model.radius_max);
    broad_phase.place(instance.object as usize, lower, upper);
}

/// The objects of a scene, and the number of different models.
fn instances_of(plan: &ScenePlan) -> (Vec<ObjectInstance>, usize) {
    let mut names: Vec<u64> = Vec::new();
    let importances = plan.objects.iter().map(|of| of.importance);
    let greatest = importances.fold(0.0, f64::max);
    let instances = (0u32..).zip(&plan.objects).map(|(object, of)| {
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
            importance: of.importance / greatest,
        }
    });
    let instances = instances.collect();
    (instances, names.len())
}
