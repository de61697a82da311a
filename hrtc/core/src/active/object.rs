//! An active object: session with the station, front and contacts, allocated once and assigned to
//! one object after the other. Only this type knows all three parts.

use crate::budget::{Budget, QueryBudget};
use crate::cache::Cache;
use crate::cache::base_mesh_store::Model;
use crate::contact::query::{Surface, Work};
use crate::contact::rigid_proxy::ToolProxy;
use crate::horizons::Horizons;
use crate::instance::{ModelFrame, ObjectInstance};
use crate::lod::front::Front;
use crate::lod::lod_controller::LodController;
use crate::policy::reactive::eagerness;
use crate::policy::{Detail, Seen};
use crate::probe::Probe;
use crate::probe::contacts::Contacts;
use crate::probe::pair::ContactState;
use crate::streaming::Outbox;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::link_meter::LinkMeter;
use crate::streaming::session::{Receiver, Session, TickContext};
use crate::streaming::subscriber::Identity;
use geometry::Pose;
use scene::{EffectPlan, ScenePlan};
use std::sync::Arc;

/// Entries of upkeep that take as long as a node or face that a search visits.
const ENTRIES_A_SEARCH: u32 = 10;

/// An active object, or a place for one.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct ActiveObject {
    pub(crate) instance: Option<ObjectInstance>,
    pub(crate) frame: Option<ModelFrame>,
    pub(crate) session: Session,
    pub(crate) front: Front,
    pub(crate) contacts: Contacts,
    /// Whether the object must stay active: its model or a scripted path is to come, or the mesh
    /// for a hand in reach.
    pub(super) is_pinned: bool,
    /// Tick when the object was last in reach or otherwise needed.
    pub(super) needed: u64,
    /// Distance from the nearest probe in this tick, metres; infinite out of reach.
    pub(super) distance: f64,
}

impl ActiveObject {
    /// A place for an object, with so many bytes of cache; everything is allocated now. `effects`:
    /// those of each object's surface.
    #[must_use]
    pub(crate) fn new(
        plan: &ScenePlan,
        bytes: usize,
        identity: Identity,
        horizons: &Horizons,
        effects: Arc<[Arc<[EffectPlan]>]>,
    ) -> Self {
        Self {
            instance: None,
            frame: None,
            session: Session::new(identity, horizons),
            front: Front::new(plan, bytes),
            contacts: Contacts::new(plan, effects),
            is_pinned: false,
            needed: 0,
            distance: f64::INFINITY,
        }
    }

    /// The object of the scene.
    #[must_use]
    pub fn object(&self) -> Option<u32> {
        self.instance.map(|instance| instance.object)
    }

    /// The cache.
    #[must_use]
    pub fn cache(&self) -> &Cache {
        &self.front.cache
    }

    /// The tolerances asked for, once the model is known.
    #[must_use]
    pub fn lod(&self) -> Option<&LodController> {
        self.front.lod()
    }

    /// The frame of the object, once its model is known.
    #[must_use]
    pub fn frame(&self) -> Option<ModelFrame> {
        self.frame
    }

    /// Whether the base mesh is complete, so that a contact could be answered.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.front.model().is_some()
    }

    /// Steps of memory pressure now: 0 while the cache has room for everything.
    #[must_use]
    pub fn pressure_steps(&self) -> u32 {
        self.front.pressure_steps()
    }

    /// The greatest speed that the finest ring admits for the widest probe, model units a tick; 0
    /// without a model.
    #[must_use]
    pub fn greatest_speed(&self) -> f64 {
        let widths = self.contacts.pairs.iter().map(|pair| pair.patch_m);
        self.front.greatest_speed(widths.fold(0.0, f64::max))
    }

    /// The largest distance from a surface at rest at which contacts of a tool acted here so far,
    /// metres; 0 where no tool came near.
    #[must_use]
    pub fn contact_offset_m(&self) -> f64 {
        let offsets = self.contacts.pairs.iter().map(|pair| pair.contact_offset_m);
        offsets.fold(0.0, f64::max)
    }

    /// The object gives its place up: nothing of it can be touched any more. Its session is closed
    /// already.
    pub(crate) fn vacate(&mut self, tick: u64) {
        self.instance = None;
        self.frame = None;
        self.contacts.end();
        self.session.end(tick);
        self.front.begin_clear();
        self.is_pinned = false;
        self.distance = f64::INFINITY;
    }

    /// Goes on to forget the object that had this place, if any. Returns whether another object may
    /// have it.
    pub(crate) fn is_vacant(&mut self, budget: &mut Budget) -> bool {
        if self.instance.is_some() {
            return false;
        }
        let most = budget.upkeep.min(budget.forgotten);
        let mut entries = most;
        self.front.cache.go_on_unloading(&mut entries);
        budget.upkeep -= most - entries;
        !self.front.cache.is_clearing()
    }

    /// Goes on to unload what is not needed any more, so that what waits for it can be requested in
    /// this tick.
    pub(crate) fn go_on_unloading(&mut self, budget: &mut Budget) {
        if self.instance.is_some() {
            self.front.cache.go_on_unloading(&mut budget.upkeep);
        }
    }

    /// Makes an object active in a vacant place: its session goes on from an epoch. A `stored` base
    /// mesh is loaded from the store, else it is requested. Nothing is freed or allocated.
    pub(crate) fn assign(
        &mut self,
        instance: ObjectInstance,
        epoch: u32,
        stored: Option<&Model>,
        tick: u64,
    ) {
        self.contacts.assign(instance.object);
        self.session
            .begin(&instance, epoch, stored, &mut self.front, tick);
        self.needed = tick;
        self.distance = f64::INFINITY;
        self.instance = Some(instance);
    }

    /// The object has moved, or stopped.
    pub(crate) fn move_to(&mut self, pose: Pose, before: Option<Pose>) {
        if let Some(instance) = &mut self.instance {
            (instance.pose, instance.before) = (pose, before);
        }
        if let Some(frame) = &mut self.frame {
            frame.pose = pose;
        }
    }

    /// A probe comes near; `start`: where it is known to have been outside of the object, object's
    /// axes, metres.
    pub(crate) fn approached_by(&mut self, probe: usize, start: Option<Pose>) {
        self.contacts.pairs[probe].begin(start);
        self.front.begin_approach(probe);
    }

    /// A place beside the proxy of a probe that is outside of every front, object's axes, metres,
    /// where one is known; see [`crate::probe::pair::ProbeObjectPair::outside`].
    pub(super) fn outside(&self, (k, probe): (usize, &Probe), budget: &mut Budget) -> Option<Pose> {
        let (frame, of) = (self.frame?, self.front.model()?);
        let around = probe.reach_m / frame.metres_per_unit;
        // Each front is within R of the full mesh, and that of each front.
        let bulge = 2.0 * of.model.radius_max;
        let mut work = Work::default();
        let pair = &self.contacts.pairs[k];
        let place = pair.outside(self.front.surface(), [around, bulge], &mut work);
        let entries = ENTRIES_A_SEARCH * (work.nodes + work.faces);
        budget.upkeep = budget.upkeep.saturating_sub(entries);
        place.map(|place| frame.model_to_object(place))
    }

    /// Distance of the surface from the nearest probe, metres; infinite without one.
    pub(super) fn clearance_m(&self) -> f64 {
        let scale = self.frame.map_or(1.0, |frame| frame.metres_per_unit);
        let near = self.contacts.pairs.iter().filter(|pair| pair.is_near);
        let clearances = near.map(|pair| pair.clearance * scale);
        clearances.fold(f64::INFINITY, f64::min)
    }

    /// Its distance from a contact in this tick as it counts beside others', metres.
    pub(super) fn urgency(&self) -> f64 {
        let clearance = self.clearance_m();
        let importance = self.importance();
        if clearance > 0.0 {
            clearance / importance
        } else {
            clearance * importance
        }
    }

    /// What a policy goes by; `None` away from every probe.
    pub(crate) fn seen(&self) -> Option<Seen> {
        self.front.seen(self.importance(), &self.contacts)
    }

    /// Whether the policy may let the object be finer than it is.
    pub(crate) fn can_rise(&self) -> bool {
        let seen = || self.seen().map_or(0.0, |seen| eagerness(&seen));
        matches!(self.front.detail(), Detail::Splits(share) if share < 1.0) && seen() > 0.0
    }

    /// Whether another step for want of time would change what a near probe asks for.
    pub(crate) fn can_ask_for_less(&self) -> bool {
        self.is_near() && self.front.can_ask_for_less()
    }

    /// Whether a probe is near.
    pub(super) fn is_near(&self) -> bool {
        self.contacts.pairs.iter().any(|pair| pair.is_near)
    }

    /// Its share of the importance of the most important object; 1 without an object.
    pub(super) fn importance(&self) -> f64 {
        self.instance.map_or(1.0, |instance| instance.importance)
    }

    /// A tick begins; `station` is the incarnation of the living one.
    pub(crate) fn begin_tick(&mut self, station: u64, tick: u64, meter: &LinkMeter) {
        self.front.stats = Default::default();
        self.contacts.begin_tick();
        self.session
            .begin_tick(station, tick, meter, &mut self.front);
    }

    /// Asks the station again, if it had no place.
    pub(crate) fn try_place_again(&mut self, tick: u64) {
        self.session.try_place_again(&mut self.front, tick);
    }

    /// Loads more of a stored base mesh.
    pub(crate) fn load_stored(&mut self, context: &mut TickContext<'_, '_>) {
        if let Some((session, mut of)) = self.receiver() {
            session.load_stored(&mut of, context);
        }
    }

    /// Requests a scripted path that was refused and is awaited again.
    pub(crate) fn retry_tour(&mut self, probes: &[Probe]) {
        if let Some((session, of)) = self.receiver() {
            session.retry_tour(&of, probes);
        }
    }

    /// Takes a chunk of the object as far as budget and room go. Returns whether it is done with.
    pub(crate) fn receive(
        &mut self,
        chunk: &InboxChunk,
        context: &mut TickContext<'_, '_>,
    ) -> bool {
        self.receiver()
            .is_none_or(|(session, mut of)| session.receive(chunk, &mut of, context))
    }

    fn receiver(&mut self) -> Option<(&mut Session, Receiver<'_>)> {
        let of = Receiver {
            instance: self.instance.as_ref()?,
            frame: &mut self.frame,
            front: &mut self.front,
            contacts: &mut self.contacts,
        };
        Some((&mut self.session, of))
    }

    /// Takes the poses of the probes, predicts regions, and writes the requests; `waiting`:
    /// received chunks that wait for the tick.
    pub(crate) fn predict(
        &mut self,
        probes: &[Probe],
        (tick, waiting): (u64, usize),
        meter: &LinkMeter,
        outbox: &mut Outbox,
    ) {
        if let (Some(frame), Some(instance)) = (&self.frame, &self.instance) {
            self.contacts.update(frame, instance, probes);
        }
        let link = (meter.lead(), meter.request_ticks());
        self.front.cache.set_in_transit(meter.records_in_transit());
        self.front.predict(tick, link, &self.contacts);
        self.session
            .request(&mut self.front, (tick, waiting), meter, outbox);
    }

    /// Splits and collapses.
    pub(crate) fn refine(&mut self, tick: u64, budget: &mut Budget) {
        self.front.refine(tick, budget, &mut self.contacts);
    }

    /// Updates the boxes of the AB-tree over deformed faces.
    pub(crate) fn refit(&mut self) {
        self.front.cache.refit();
    }

    /// The proxy of a probe's tool, while it is near.
    #[must_use]
    pub fn tool(&self, probe: usize) -> Option<&ToolProxy> {
        self.contacts.pairs.get(probe)?.tool()
    }

    /// The tool of a probe before it is advanced.
    pub(crate) fn tool_before(&self, probe: usize) -> Option<(&ToolProxy, Surface<'_>, Pose)> {
        let goal = self.contacts.pairs.get(probe)?.goal?;
        Some((self.tool(probe)?, self.front.surface(), goal))
    }

    /// Advances the proxy of a probe and renders the forces of the pair.
    pub(crate) fn find_contact(
        &mut self,
        tick: u64,
        (k, probe): (usize, &Probe),
        budget: &mut QueryBudget,
    ) {
        let (Some(frame), Some(instance)) = (&self.frame, &self.instance) else {
            return;
        };
        let surface = self.front.surface();
        let place = (frame, instance);
        let touch = self
            .contacts
            .advance((k, probe), place, surface, tick, budget);
        let Some(touch) = touch else {
            return;
        };
        let accuracy = self.front.accuracy_at(k, &touch.contact, touch.certified);
        self.contacts.pairs[k].contact = Some(ContactState {
            contact: touch.contact,
            certified: touch.certified,
            tolerance_m: accuracy.tolerance_m,
            is_as_asked: accuracy.is_as_asked,
            depth_m: touch.depth_m,
            paid: self.contacts.pairs[k].paid(),
        });
    }

    /// Looks where a probe may touch next.
    pub(crate) fn look_ahead(&mut self, probe: usize, budget: &mut QueryBudget) {
        self.front.look_ahead(probe, &self.contacts, budget);
    }
}
