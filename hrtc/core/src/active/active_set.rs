//! The active set: objects near a probe, each with session, front and contacts. Which these are,
//! and in which places: see `activation`.

use super::broad_phase::BroadPhase;
use super::faults::ModelFaults;
use super::object::ActiveObject;
use super::shares::{part_of, weights_of};
use super::starts::Start;
use crate::bodies::{Extent, Movables};
use crate::budget::Budget;
use crate::cache::base_mesh_store::{BaseMeshStore, Model};
use crate::horizons::Horizons;
use crate::instance::{ModelFrame, ObjectInstance};
use crate::probe::Probe;
use crate::streaming::Fault;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::link_meter::{LinkMeter, Sent};
use crate::streaming::session::TickContext;
use crate::streaming::subscriber::Identity;
use glam::DVec3;
use protocol::Request;
use scene::{Effect, MAX_PROBES, ScenePlan};
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
    pub(super) broad_phase: BroadPhase,
    /// Where the pairs of each object begin, one for each probe.
    pub(super) starts: Vec<Start>,
    /// How far each probe went in a tick, metres, at the most of late; it fades.
    pub(super) paths: [f64; MAX_PROBES],
    /// Ticks within whose motion a movable object is looked for, at the least: as many as passed
    /// since the tick before, at the most of late; it fades.
    pub(super) passed_ticks: f64,
    /// The farthest that an effect of a surface acts on what does not touch it, metres.
    pub(super) effects_m: f64,
    pub(super) horizons: Horizons,
    /// Of the link to the station, which all sessions share.
    pub meter: LinkMeter,
    /// Objects whose box is not known yet, the next one last; at first in the order in which models
    /// are requested.
    pub(super) unplaced: VecDeque<u32>,
    /// Models that were known when the look at these began, and how many of them were looked at
    /// since: the first ones.
    pub(super) looked_at: (usize, usize),
    /// An object of each model, in the order in which the models are requested: those of scripted
    /// paths first.
    pub(super) to_fetch: Vec<u32>,
    /// The one of them that is looked at next.
    pub(super) next_fetch: usize,
    /// Faults that ended the use of each model.
    pub(super) faults: ModelFaults,
    /// Models known, and the places whose session had ended, a bit each, when the faults were taken
    /// over last; `None` where that is to be done again.
    pub(super) noted: Option<(usize, u32)>,
    /// Incarnation of the last station that lived.
    station: u64,
    /// The epoch in which the next session of each object begins.
    pub(super) epochs: Vec<u32>,
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
        let unplaced = to_fetch.iter().rev().copied().collect();
        let mut is_first = vec![true; models];
        to_fetch.retain(|&object| {
            let model = instances[object as usize].model;
            std::mem::take(&mut is_first[model])
        });
        Self {
            store: BaseMeshStore::new(models, stored),
            broad_phase: BroadPhase::new(instances.len(), moving),
            starts: vec![Start::default(); instances.len() * plan.probes.len()],
            paths: [0.0; MAX_PROBES],
            passed_ticks: 1.0,
            effects_m: reach_of_effects(plan),
            meter: LinkMeter::new(&horizons),
            horizons,
            unplaced,
            looked_at: (0, 0),
            to_fetch,
            next_fetch: 0,
            faults: ModelFaults::new(models),
            noted: None,
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

    /// A tick begins; `station` is the incarnation of the living one, `chunks` are those that wait.
    /// Returns whether the station is another one, which may serve what the last one could not.
    pub fn begin_tick(&mut self, station: u64, tick: u64, chunks: [&[InboxChunk]; 2]) -> bool {
        // What is loaded from the store comes before any chunk.
        let is_behind = self.objects.iter().any(|of| of.session.is_loading());
        let [first, second] = chunks;
        let taken = self.taken;
        for object in &mut self.objects {
            let waiting = (0..MAX_CHUNKS).zip(first.iter().chain(second));
            let waiting = waiting.filter(|&(k, _)| taken >> k & 1 == 0);
            let waiting = waiting.map(|(_, chunk)| &chunk.header);
            let now = (tick, &self.meter);
            object.session.hear_waiting(waiting, is_behind, now);
            object.begin_tick(station, tick, &self.meter);
        }
        let is_another = station != 0 && station != self.station;
        let is_known = |model| self.store.model(model).is_some();
        if is_another {
            self.station = station;
            self.faults.ask_again(is_known);
            self.noted = None;
            self.next_fetch = 0;
        }
        let after = self.horizons.refused;
        if station != 0 && self.faults.try_again(tick, after, is_known) {
            self.noted = None;
            self.next_fetch = 0;
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

    /// Another number whenever the fault of a model is another one or has ended.
    #[must_use]
    pub fn fault_changes(&self) -> u64 {
        self.faults.changes()
    }

    /// The fault that ended the use of an object's model.
    #[must_use]
    pub fn fault_of(&self, instance: &ObjectInstance) -> Option<Fault> {
        self.faults.of(instance.model)
    }

    /// Whether a fault keeps an object's model from being known, be it asked for again or not.
    pub(super) fn is_lost_object(&self, object: u32) -> bool {
        let model = self.instances[object as usize].model;
        self.faults.of(model).is_some() && self.store.model(model).is_none()
    }

    /// Takes the faults of the sessions over, where there is any news: a session has ended, or a
    /// model has come, which may be one that was given up. It looks at every model.
    fn note_faults(&mut self, tick: u64) {
        let places = self.objects.iter().enumerate();
        let ended = places.filter(|(_, of)| of.session.is_ended());
        let ended = ended.fold(0, |bits, (k, _)| bits | 1 << k);
        let now = Some((self.store.known(), ended));
        let is_news = std::mem::replace(&mut self.noted, now) != now;
        if !is_news || (ended == 0 && self.faults.lost() == 0) {
            return;
        }
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
        movables.set_extent(self.store.known(), |object| {
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
        self.note_faults(tick);
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
    /// of these a tool's after a ball's: the others need little and leave it the rest. Of probes of
    /// one kind each has its turn to be the last.
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
            let of_probes = &self.objects[place].contacts.pairs;
            let turn = (tick + probe as u64) % of_probes.len() as u64;
            let is_tool = of_probes[probe].proxy.is_tool();
            (nearest[probe].1 == place, is_tool, turn, place)
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
}

/// Tells the broad phase where an object is.
pub(super) fn place(broad_phase: &mut BroadPhase, instance: &ObjectInstance, model: &Model) {
    let frame = ModelFrame::new(instance.pose, instance.scale, &model.header);
    let [lower, upper] = [model.header.lower, model.header.upper]
        .map(|corner| DVec3::from_array(corner) - frame.origin);
    let (lower, upper) = frame.box_to_world(lower, upper);
    // The front of a coarse mesh may stick out by R: each of its vertices is within R of a vertex
    // of the full mesh, and the box is convex.
    let margin = model.radius_max * frame.metres_per_unit;
    broad_phase.place(instance.object as usize, lower, upper, margin);
}

/// The farthest that an effect of a surface of the scene acts on what does not touch it, metres.
fn reach_of_effects(plan: &ScenePlan) -> f64 {
    let effects = plan.objects.iter().flat_map(|of| of.effects.iter());
    let reaches = effects.map(|of| match &of.effect {
        Effect::Magnet(magnet) => magnet.reach_m,
        _ => 0.0,
    });
    reaches.fold(0.0, f64::max)
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
