//! A seat: what one awake object needs, made once and used by one object after the other.

use crate::cache::base_mesh_store::{BaseMeshStore, Model};
use crate::cache::{Cache, RegionKey};
use crate::contact::query::{Surface, Work};
use crate::controller::{Fault, MIN_PROXY_WORK};
use crate::force::effects::{Clock, SurfaceEffects};
use crate::frame::ModelFrame;
use crate::lod::lod_controller::LodController;
use crate::lod::refine::Refinement;
use crate::perception::{OF_PROXY, STEP_N};
use crate::probe::Probe;
use crate::probe::pair::{ContactState, ProbeObjectPair};
use crate::streaming::ingest::Inbox;
use crate::streaming::subscriber::{Identity, Outbox, Session, Subscriber};
use geometry::Pose;
use protocol::MODEL_HEADER_SLOTS;
use scene::{EffectPlan, ModelScale, ProbePlan, RefinementPlan, ScenePlan, SurfacePlan};
use spm::NONE;
use std::sync::Arc;

/// What a scene says of an object, without its model's name.
#[derive(Debug, Clone, Copy)]
pub struct ObjectInstance {
    /// Object of the scene.
    pub object: u32,
    /// Index of its model in the library.
    pub model: usize,
    /// Hash of the model's name in the scene.
    pub name: u64,
    /// Its pose in this tick, and in the tick before if that was another.
    pub pose: Pose,
    pub before: Option<Pose>,
    pub scale: ModelScale,
    pub surface: SurfacePlan,
}

/// What is left of a tick's work, in units; all seats draw on it.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    /// Of the inbox.
    pub inbox: u32,
    /// Splits and collapses.
    pub operations: u32,
    /// Closure entries gone through.
    pub entries: u32,
    /// Closure entries let go of.
    pub leaving: u32,
}

/// What a seat did in a tick.
#[derive(Debug, Clone, Copy, Default)]
pub struct ObjectStats {
    pub vsplits: u32,
    pub ecols: u32,
    pub work_units: u32,
    /// Splits that were felt and wait: for room, or since they would turn a face over.
    pub postponed: u32,
    pub refused: u32,
    /// Tools whose budget left something to the next tick.
    pub unfinished: u32,
    /// Tools that left a part of their way to the next tick though the budget had room.
    pub early: u32,
}

/// What a seat may change beside itself in a tick.
#[derive(Debug)]
pub struct TickContext<'a> {
    pub tick: u64,
    pub library: &'a mut BaseMeshStore,
    pub probes: &'a mut [Probe],
    pub budget: &'a mut Budget,
}

/// See the module.
#[derive(Debug)]
pub struct ActiveObject {
    pub(crate) placing: Option<ObjectInstance>,
    pub(crate) operations: usize,
    pub(crate) tolerance_m: f64,
    pub(crate) refinement_plan: RefinementPlan,
    pub(crate) period_s: f64,
    /// Whether splits and collapses that are felt fly.
    pub(crate) geomorph: bool,
    pub(crate) cache: Cache,
    pub(crate) subscriber: Subscriber,
    pub(crate) inbox: Inbox,
    pub(crate) refinement: Refinement,
    pub(crate) model: Option<Model>,
    pub(crate) frame: Option<ModelFrame>,
    pub(crate) dial: Option<LodController>,
    /// The block of the whole model that was done last.
    pub(crate) global_before: Option<RegionKey>,
    pub(crate) fault: Option<Fault>,
    /// One for each probe.
    pub(crate) touches: Vec<ProbeObjectPair>,
    /// The probe whose tour is asked for.
    pub(crate) tour_of: Option<usize>,
    /// Next slot of the kept base mesh to take in, while the object wakes.
    pub(crate) waking: Option<usize>,
    /// A chunk waits for room: those behind it wait too, in this tick.
    pub(crate) is_stalled: bool,
    /// Whether the object must stay: its model or a tour is coming.
    pub(crate) is_pinned: bool,
    /// Tick when the object was last in reach or otherwise needed, and its distance then, metres.
    pub(crate) needed: u64,
    pub(crate) distance: f64,
    pub(crate) tally: ObjectStats,
    pub(crate) bytes_received: u64,
    pub(crate) vsps_received: u64,
    pub(crate) measured: Option<f64>,
    pub(crate) refused_regions: u64,
    pub(crate) last_refused: u32,
    pub(crate) dropped_constraints: u64,
    /// Effects of each object's surface.
    listed: Arc<[Arc<[EffectPlan]>]>,
}

impl ActiveObject {
    /// An empty seat with so many bytes of cache; everything is allocated now.
    ///
    /// `listed`: the effects of each object's surface.
    pub fn new(
        plan: &ScenePlan,
        bytes: usize,
        identity: Identity,
        timeout_ticks: u64,
        listed: Arc<[Arc<[EffectPlan]>]>,
    ) -> Self {
        let most = listed.iter().map(|effects| effects.len()).max();
        let new_touch = |probe: &ProbePlan| {
            let encoder_m = plan.safety.passivity.then_some(probe.device.encoder_m);
            let effects = SurfaceEffects::with_room(most.unwrap_or(0), encoder_m);
            ProbeObjectPair::new(&probe.shape, effects)
        };
        Self {
            placing: None,
            operations: plan.loop_.operations,
            tolerance_m: plan.accuracy.tolerance_m,
            refinement_plan: plan.accuracy.refinement,
            period_s: 1.0 / plan.loop_.rate_hz,
            geomorph: plan.accuracy.geomorph,
            cache: Cache::new(bytes),
            subscriber: Subscriber::new(identity, timeout_ticks),
            inbox: Inbox::new(),
            refinement: Refinement::new(plan.probes.len()),
            model: None,
            frame: None,
            dial: None,
            global_before: None,
            fault: None,
            touches: plan.probes.iter().map(new_touch).collect(),
            tour_of: None,
            waking: None,
            is_stalled: false,
            is_pinned: false,
            needed: 0,
            distance: f64::INFINITY,
            tally: ObjectStats::default(),
            bytes_received: 0,
            vsps_received: 0,
            measured: None,
            refused_regions: 0,
            last_refused: NONE,
            dropped_constraints: 0,
            listed,
        }
    }

    /// The object that sits here.
    #[must_use]
    pub fn object(&self) -> Option<u32> {
        self.placing.map(|placing| placing.object)
    }

    /// The cache.
    #[must_use]
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// The rings, once the model is there.
    #[must_use]
    pub fn dial(&self) -> Option<&LodController> {
        self.dial.as_ref()
    }

    /// The frame of the object, once its model is there.
    #[must_use]
    pub fn frame(&self) -> Option<ModelFrame> {
        self.frame
    }

    /// Whether the model is there, so that a touch could be answered.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.model.is_some()
    }

    /// Whether a probe touches the object.
    #[must_use]
    pub fn is_touched(&self) -> bool {
        self.touches.iter().any(|touch| touch.felt.is_some())
    }

    /// Gives the seat to an object whose session goes on from an epoch. With `kept`, a base mesh in the library, it
    /// is taken in from there; else it is asked for. Nothing is freed or allocated.
    pub(crate) fn give(
        &mut self,
        placing: ObjectInstance,
        epoch: u32,
        kept: Option<Model>,
        tick: u64,
    ) {
        self.cache.reset();
        self.inbox = Inbox::new();
        self.refinement.reset();
        self.model = None;
        self.frame = None;
        self.dial = None;
        self.global_before = None;
        self.tour_of = None;
        self.waking = None;
        for touch in &mut self.touches {
            touch.leave();
            touch.effects.assign(&self.listed[placing.object as usize]);
        }
        self.subscriber.begin_session(
            Session {
                object: placing.object,
                name: placing.name,
            },
            epoch,
            tick,
        );
        if let Some(model) = kept {
            // Checked when it came: the same storage takes the same base mesh.
            match self.cache.begin_model(&model.header) {
                Ok(()) => {
                    self.waking = Some(MODEL_HEADER_SLOTS);
                    self.subscriber.model_is(model.header.model);
                }
                Err(error) => self.fault = Some(error.into()),
            }
        }
        self.needed = tick;
        self.distance = f64::INFINITY;
        self.placing = Some(placing);
    }

    /// Ends the session, as far as the station hears of it. The epoch that it ends with.
    pub(crate) fn close(&mut self, outbox: &mut Outbox, tick: u64) -> u32 {
        self.subscriber.close(outbox, tick)
    }

    /// The object has moved, or does no more.
    pub(crate) fn move_to(&mut self, pose: Pose, before: Option<Pose>) {
        if let Some(placing) = &mut self.placing {
            (placing.pose, placing.before) = (pose, before);
        }
        if let Some(frame) = &mut self.frame {
            frame.pose = pose;
        }
    }

    /// Model and frame of the object, once they are there.
    pub(crate) fn known(&self) -> Option<(Model, ModelFrame)> {
        self.model.zip(self.frame)
    }

    /// Takes the poses of the probes.
    pub(crate) fn aim(&mut self, probes: &[Probe]) {
        let Some(frame) = self.frame else {
            return;
        };
        for (touch, probe) in self.touches.iter_mut().zip(probes) {
            touch.aim(&frame, probe.pose);
        }
        self.feel(probes);
    }

    /// Moves the proxies, measures the clearances and feels the surface. `most_work`: what all queries of the tick
    /// may cost, of which `work` is spent.
    pub(crate) fn query(&mut self, tick: u64, probes: &[Probe], work: &mut Work, most_work: u32) {
        let (Some((_, frame)), Some(placing)) = (self.known(), self.placing) else {
            return;
        };
        let clock = Clock {
            tick,
            period_s: self.period_s,
        };
        for (k, probe) in probes.iter().enumerate() {
            let touch = &mut self.touches[k];
            touch.felt = None;
            touch.rendered = None;
            if !touch.is_followed {
                continue;
            }
            let surface = Surface {
                mesh: self.cache.mesh(),
                tree: self.cache.tree(),
            };
            let unfelt_m = OF_PROXY * STEP_N / placing.surface.stiffness_n_per_m;
            touch
                .follower
                .set_imperceptible(unfelt_m / frame.metres_per_unit);
            let left = most_work.saturating_sub(work.nodes + work.faces);
            let Some(followed) = touch.advance(surface, left.max(MIN_PROXY_WORK)) else {
                continue;
            };
            work.add(followed.work);
            self.dropped_constraints += u64::from(followed.dropped);
            self.tally.unfinished += u32::from(followed.unfinished);
            self.tally.early += u32::from(followed.early);
            let Some(contact) = followed.contact else {
                touch.render_near(clock, &frame);
                continue;
            };
            let certified = ProbeObjectPair::certified(surface, &contact);
            let feels = (&frame, placing.before.as_ref(), &placing.surface);
            let depth_m = touch.render(clock, feels, surface, &contact, probe, work);
            let reached = if certified == 0.0 {
                Some(0.0)
            } else {
                self.tolerance_at(&contact)
            };
            let as_fine = reached.is_some_and(|t| t <= self.finest_tolerance());
            // What waits for the contact to go comes no sooner for asking less.
            let is_held_up = self.tally.postponed + self.tally.refused > 0;
            self.refinement.economy.felt(as_fine || is_held_up);
            // What is still on its way is none of what is asked for.
            let mesh = self.cache.mesh();
            let faces = contact.faces.iter().take_while(|&&face| face != NONE);
            let is_in_flight = mesh.any_in_flight(&contact.faces[..faces.count()]);
            let reached = reached.filter(|_| !is_in_flight);
            let asked = self.is_as_asked(certified, reached);
            self.touches[k].felt = Some(ContactState {
                contact,
                certified,
                tolerance_m: reached.map_or(-1.0, |t| f64::from(t) * frame.metres_per_unit),
                asked,
                depth_m,
            });
        }
    }

    /// Whether a contact of this certified error and reached tolerance, model units, is what was asked for.
    fn is_as_asked(&self, certified: f32, reached: Option<f32>) -> bool {
        match (self.refinement_plan, &self.model) {
            (RefinementPlan::Global { lod: Some(lod) }, Some(model)) => {
                let count = lod.min(model.header.vsps);
                certified == 0.0 || self.global_before == Some(RegionKey::prefix(count))
            }
            _ => reached.is_some_and(|t| self.dial.as_ref().is_some_and(|d| t <= d.asked())),
        }
    }
}
