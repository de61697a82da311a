//! The controller: the pure core of the tick. Values in, values out; no clock, no I/O, no allocation.
//!
//! Order of a tick: inbox, predict, refine (collapses first only when room is short), refit, query, force,
//! gate. Force k acts over `[k, k + 1]`; the sample of tick k gives the force of tick k.

mod ask;
mod capacity;
mod inbox;
mod refine;

pub use capacity::Capacity;

use crate::cache::{Cache, CacheError, RegionKey};
use crate::device::Sample;
use crate::dial::Dial;
use crate::energy::EnergyAccount;
use crate::gate::Gate;
use crate::inbox::InboxChunk;
use crate::predict::{Predictor, Sources};
use crate::proxy::{Contact, Proxy};
use crate::query::{Surface, Work};
use crate::subscriber::{Identity, Outbox, Subscriber};
use crate::tick_record::CoreRecord;
use glam::DVec3;
use inbox::Inbox;
use refine::Refinement;
use shared::geometry::{Pose, Wrench};
use shared::protocol::{ANSWER_TIMEOUT_MS, ContactReport, ModelHeader, TourAsk, TourPoint};
use shared::scene::{ObjectPlan, RefinementPlan, ScenePlan, TrajectoryPlan};
use shared::spm::{Handle, NONE};
use thiserror::Error;

/// Ticks between two contact reports to the station.
const REPORT_EVERY: u64 = 10;
/// Ticks without a good sample after which the force ramps down.
const SAMPLES_MISSED_MOST: u32 = 20;

/// Nodes visited and faces tested by the proxy's steps in a tick without splits and collapses.
const PROXY_WORK: u32 = 4096;
/// ... what an operation takes of them: it costs as much as so many; and what is left in any tick.
const PROXY_WORK_PER_OPERATION: u32 = 32;
const PROXY_WORK_LEAST: u32 = 1024;

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
    /// Contact report to the station, every few ticks.
    pub report: Option<ContactReport>,
    /// What holds the probe, model units; `None` in free space.
    pub contact: Option<Contact>,
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
            outbox: Outbox::new(),
            report: None,
            contact: None,
            chunks_consumed: 0,
            record: CoreRecord::default(),
        }
    }
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

/// The frame of an object: between the world and the model's stored coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelFrame {
    /// Pose of the model's own frame in the world.
    pub pose: Pose,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// Origin of the stored coordinates, model units.
    pub origin: DVec3,
}

impl ModelFrame {
    fn new(plan: &ObjectPlan, header: &ModelHeader) -> Self {
        let sides = DVec3::from_array(header.upper) - DVec3::from_array(header.lower);
        Self {
            pose: plan.pose,
            metres_per_unit: plan.scale.metres_per_unit(sides.max_element()),
            origin: DVec3::from_array(header.origin),
        }
    }

    /// A point of the world in stored coordinates.
    #[must_use]
    pub fn to_model(&self, world: DVec3) -> DVec3 {
        self.pose.inverse_transform_point(world) / self.metres_per_unit - self.origin
    }

    /// A point in stored coordinates in the world.
    #[must_use]
    pub fn to_world(&self, model: DVec3) -> DVec3 {
        self.pose
            .transform_point((model + self.origin) * self.metres_per_unit)
    }

    /// A direction or displacement in model units as metres of the world.
    #[must_use]
    pub fn vector_to_world(&self, model: DVec3) -> DVec3 {
        self.pose.orientation * (model * self.metres_per_unit)
    }
}

/// What the controller knows of its object once the model is there.
#[derive(Debug, Clone, Copy)]
struct Model {
    header: ModelHeader,
    frame: ModelFrame,
    /// The largest R of the base mesh: no full-mesh point is farther from the front, model units.
    radius_max: f64,
    /// Area of the base mesh, square model units.
    area: f64,
}

/// See the module.
#[derive(Debug)]
pub struct Controller {
    object: ObjectPlan,
    tour: Option<(u64, f64, f64, f64)>,
    radius_m: f64,
    period_s: f64,
    operations: usize,
    tolerance_m: f64,
    refinement_plan: RefinementPlan,
    cache: Cache,
    subscriber: Subscriber,
    inbox: Inbox,
    predictor: Predictor,
    refinement: Refinement,
    model: Option<Model>,
    dial: Option<Dial>,
    /// The block of the whole model that was done last.
    global_before: Option<RegionKey>,
    fault: Option<Fault>,
    proxy: Option<Proxy>,
    gate: Gate,
    energy: EnergyAccount,
    path: Vec<TourPoint>,
    path_is_whole: bool,
    hint: Option<Handle>,
    clearance: f64,
    last_position: Option<DVec3>,
    samples_missed: u32,
    bytes_received: u64,
    vsps_received: u64,
    measured: Option<f64>,
    refused_regions: u64,
    last_refused: u32,
    dropped_constraints: u64,
    replay_hash: u64,
}

impl Controller {
    /// Everything sized from the plan; nothing is allocated after this.
    ///
    /// `device_max_n` is what the device can render; `tour_seconds` how long a tour to ask for.
    #[must_use]
    pub fn new(plan: &ScenePlan, identity: Identity, device_max_n: f64, tour_seconds: f64) -> Self {
        let rate = plan.loop_.rate_hz;
        let probe = &plan.probes[0];
        let tour = match &probe.trajectory {
            TrajectoryPlan::Tour {
                seed,
                speed_m_per_s,
                depth_m,
            } => Some((*seed, *speed_m_per_s, *depth_m, tour_seconds)),
            TrajectoryPlan::Points(_) => None,
        };
        let timeout_ticks = (ANSWER_TIMEOUT_MS as f64 * 1e-3 * rate).ceil() as u64;
        Self {
            object: plan.objects[0].clone(),
            tour,
            radius_m: probe.radius_m,
            period_s: 1.0 / rate,
            operations: plan.loop_.operations,
            tolerance_m: plan.accuracy.tolerance_m,
            refinement_plan: plan.accuracy.refinement,
            cache: Cache::new(plan.cache_bytes),
            subscriber: Subscriber::new(identity, timeout_ticks),
            inbox: Inbox::new(),
            predictor: Predictor::new(),
            refinement: Refinement::new(),
            model: None,
            dial: None,
            global_before: None,
            fault: None,
            proxy: None,
            gate: Gate::new(plan.safety, device_max_n, rate),
            energy: EnergyAccount::default(),
            path: Vec::with_capacity(Self::path_capacity(tour_seconds)),
            path_is_whole: false,
            hint: None,
            clearance: 0.0,
            last_position: None,
            samples_missed: 0,
            bytes_received: 0,
            vsps_received: 0,
            measured: None,
            refused_regions: 0,
            last_refused: NONE,
            dropped_constraints: 0,
            replay_hash: 0,
        }
    }

    /// Points that a tour of some seconds may have: four a tick of 200 Hz, with room to spare.
    fn path_capacity(seconds: f64) -> usize {
        (seconds * 400.0).clamp(0.0, 4e6) as usize + 1024
    }

    /// Predicts from these sources from now on: to see what each of them buys.
    pub fn set_sources(&mut self, sources: Sources) {
        self.predictor.set_sources(sources);
    }

    /// The frame of the object, once its model is there.
    #[must_use]
    pub fn frame(&self) -> Option<ModelFrame> {
        self.model.map(|model| model.frame)
    }

    /// The model's header, once it is there.
    #[must_use]
    pub fn header(&self) -> Option<&ModelHeader> {
        self.model.as_ref().map(|model| &model.header)
    }

    /// The tour in the file's own frame and units, once it is whole.
    #[must_use]
    pub fn tour(&self) -> Option<&[TourPoint]> {
        self.path_is_whole.then_some(self.path.as_slice())
    }

    /// What keeps it from touching, if anything.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        self.fault
    }

    /// The probe's centre in the world as it was last sampled, metres; the origin before.
    #[must_use]
    pub fn probe(&self) -> DVec3 {
        self.last_position.unwrap_or(DVec3::ZERO)
    }

    /// The proxy's centre in the world, metres: where the probe would be if it could not enter the object.
    #[must_use]
    pub fn proxy(&self) -> Option<DVec3> {
        let proxy = self.proxy.as_ref().filter(|proxy| proxy.is_placed())?;
        Some(self.model?.frame.to_world(proxy.position()))
    }

    /// The cache.
    #[must_use]
    pub fn cache(&self) -> &Cache {
        &self.cache
    }

    /// Regions that the station refused so far, and the last one.
    #[must_use]
    pub fn refused(&self) -> (u64, u32) {
        (self.refused_regions, self.last_refused)
    }

    /// Regions asked for again, with every record, so far: their answer counted on records that were gone.
    #[must_use]
    pub fn resent(&self) -> u64 {
        self.subscriber.resent
    }

    /// Constraints of the proxy that did not fit beside the [`crate::proxy::MOST_CONSTRAINTS`] deepest, so far.
    #[must_use]
    pub fn dropped_constraints(&self) -> u64 {
        self.dropped_constraints
    }

    /// Whether the force has ramped down after `stopping`.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.gate.is_closed()
    }

    /// Hash over the outputs of every tick so far.
    #[must_use]
    pub fn replay_hash(&self) -> u64 {
        self.replay_hash
    }

    /// Work units that a tick may take at the most: the bound that `work_units` is compared with.
    #[must_use]
    pub fn work_budget(&self) -> u32 {
        inbox::budget(self.operations) + refine::budget(self.operations)
    }

    /// One tick.
    pub fn tick(
        &mut self,
        inputs: &TickInputs<'_>,
        outputs: &mut TickOutputs,
        observer: &mut impl StageObserver,
    ) {
        outputs.outbox.clear();
        outputs.report = None;
        let mut record = CoreRecord {
            stopping: inputs.stopping,
            ..CoreRecord::default()
        };
        self.measured = None;

        self.subscriber
            .observe(inputs.station, inputs.tick, &mut self.cache);
        let mut left = self.operations as u32;
        outputs.chunks_consumed = self.drain(inputs, &mut left, &mut record);
        let sample = self.sample(inputs, &mut record);
        let waiting = inputs.chunks.iter().map(|run| run.len()).sum();
        self.predict(sample, inputs.tick, waiting, outputs);
        observer.ended(Stage::Inbox);

        self.refine(inputs.tick, &mut left, &mut record);
        observer.ended(Stage::Refine);
        self.cache.refit();
        observer.ended(Stage::Refit);

        let contact = self.query(sample, &mut record);
        self.look_ahead();
        observer.ended(Stage::Query);

        let wrench = self.render(sample, contact, inputs, &mut record);
        outputs.wrenches.fill(Wrench::ZERO);
        if let Some(place) = outputs.wrenches.first_mut() {
            *place = wrench;
        }
        self.report(inputs.tick, sample, contact, wrench, outputs);
        outputs.contact = contact;
        self.finish_record(&mut record, wrench);
        outputs.record = record;
        observer.ended(Stage::Force);
    }

    /// The sample of the first probe if it is usable, else the last usable one.
    fn sample(&mut self, inputs: &TickInputs<'_>, record: &mut CoreRecord) -> Option<Pose> {
        let given = inputs.samples.first().copied().flatten();
        match given {
            Some(sample) if sample.pose.is_finite() => {
                self.samples_missed = 0;
                Some(sample.pose)
            }
            Some(_) | None => {
                record.rejected_sample = given.is_some();
                self.samples_missed = self.samples_missed.saturating_add(1);
                self.last_position.map(Pose::at)
            }
        }
    }

    /// Moves the proxy and measures the clearance.
    fn query(&mut self, sample: Option<Pose>, record: &mut CoreRecord) -> Option<Contact> {
        let (Some(model), Some(pose)) = (&self.model, sample) else {
            return None;
        };
        let goal = model.frame.to_model(pose.position);
        let proxy = self.proxy.as_mut()?;
        let surface = Surface {
            mesh: self.cache.mesh(),
            tree: self.cache.tree(),
        };
        let mut work = Work::default();
        let operations = PROXY_WORK_PER_OPERATION * (record.vsplits + record.ecols);
        let most_work = PROXY_WORK.saturating_sub(operations).max(PROXY_WORK_LEAST);
        let advance = proxy.advance(surface, goal, most_work);
        work.add(advance.work);
        self.dropped_constraints += u64::from(advance.dropped);
        let hint = self.hint.filter(|&face| surface.mesh.is_active(face));
        let nearest = proxy.nearest(surface, hint, &mut work);
        self.hint = nearest.map(|nearest| nearest.face);
        self.clearance = nearest.map_or(f64::INFINITY, |n| n.closest.distance_squared.sqrt());
        record.query_work = work.nodes + work.faces;
        if let Some(contact) = advance.contact {
            record.contact = true;
            record.contact_bounded = true;
            let certified = contact
                .faces
                .iter()
                .filter(|&&face| face != NONE)
                .fold(0.0f32, |most, &face| {
                    most.max(surface.mesh.certified_error(face))
                });
            record.contact_full = certified == 0.0;
            let scale = model.frame.metres_per_unit;
            record.certified_error_m = f64::from(certified) * scale;
            let reached = if record.contact_full {
                Some(0.0)
            } else {
                self.tolerance_at(&contact)
            };
            let finest = self.finest_tolerance();
            let as_fine = reached.is_some_and(|t| t <= finest);
            self.refinement.economy.felt(as_fine);
            record.contact_tolerance_m = reached.map_or(-1.0, |t| f64::from(t) * scale);
            record.contact_asked = match self.refinement_plan {
                RefinementPlan::Global { lod: Some(lod) } => {
                    let count = lod.min(model.header.vsps);
                    record.contact_full || self.global_before == Some(RegionKey::prefix(count))
                }
                _ => reached.is_some_and(|t| self.dial.as_ref().is_some_and(|d| t <= d.asked())),
            };
        }
        advance.contact
    }

    /// Stiffness and damping, then the gate.
    fn render(
        &mut self,
        sample: Option<Pose>,
        contact: Option<Contact>,
        inputs: &TickInputs<'_>,
        record: &mut CoreRecord,
    ) -> Wrench {
        let mut wrench = Wrench::ZERO;
        let position = sample.map(|pose| pose.position);
        if let (Some(model), Some(proxy), Some(position), Some(_)) =
            (&self.model, &self.proxy, position, contact)
        {
            let goal = model.frame.to_model(position);
            let out = model.frame.vector_to_world(proxy.position() - goal);
            let depth = out.length();
            record.depth_m = depth;
            if depth > 0.0 {
                let normal = out / depth;
                let surface = &self.object.surface;
                let velocity = self
                    .last_position
                    .map_or(DVec3::ZERO, |last| (position - last) / self.period_s);
                let spring = surface.stiffness_n_per_m * depth;
                let damper = -surface.damping_ns_per_m * velocity.dot(normal);
                // Damping never pulls: a wall does not stick.
                wrench.force = normal * (spring + damper).max(0.0);
            }
        }
        if position.is_some() {
            self.last_position = position;
        }
        let open = !inputs.stopping
            && self.model.is_some()
            && self.fault.is_none()
            && self.samples_missed <= SAMPLES_MISSED_MOST;
        let gated = self.gate.pass(wrench, open);
        record.clamped = gated.clamped;
        if let Some(position) = position {
            self.energy.tick(position, gated.wrench.force);
        }
        gated.wrench
    }

    fn report(
        &self,
        tick: u64,
        sample: Option<Pose>,
        contact: Option<Contact>,
        wrench: Wrench,
        outputs: &mut TickOutputs,
    ) {
        let (Some(pose), true) = (sample, tick.is_multiple_of(REPORT_EVERY)) else {
            return;
        };
        outputs.report = Some(ContactReport {
            client: self.subscriber.identity().client,
            tick,
            probe: 0,
            object: contact.map_or(NONE, |_| self.subscriber.identity().object),
            position: pose.position.to_array(),
            orientation_wxyz: pose.wxyz(),
            contact: contact.map_or([0.0; 3], |contact| contact.point.to_array()),
            force: wrench.force.to_array(),
        });
    }

    fn finish_record(&mut self, record: &mut CoreRecord, wrench: Wrench) {
        record.active_faces = self.cache.mesh().active_faces();
        record.vsps_received = self.vsps_received;
        record.bytes_received = self.bytes_received;
        record.regions_subscribed = self.subscriber.subscribed;
        record.resubscribed = self.subscriber.resubscribed;
        record.resent = self.subscriber.resent;
        record.evicted = self.cache.evicted();
        record.vsps_loaded = self.cache.loaded();
        record.cache_bytes = self.cache.bytes_used() as u64;
        record.energy_j = self.energy.joules();
        record.finest_tolerance_m = match &self.model {
            Some(model) => f64::from(self.finest_tolerance()) * model.frame.metres_per_unit,
            None => 0.0,
        };
        record.ready = self.model.is_some() && self.proxy.is_some();
        record.measured_error_m = match (self.measured, &self.model) {
            (Some(distance), Some(model)) => distance * model.frame.metres_per_unit,
            _ => -1.0,
        };
        let mut mix = |word: u64| {
            // One round of splitmix64 a word.
            let mut z = (self.replay_hash ^ word).wrapping_add(0x9E37_79B9_7F4A_7C15);
            z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
            self.replay_hash = z ^ z >> 31;
        };
        for value in wrench
            .force
            .to_array()
            .into_iter()
            .chain(wrench.torque.to_array())
        {
            mix(value.to_bits());
        }
        mix(u64::from(record.contact) | u64::from(record.contact_full) << 1);
        mix(u64::from(record.active_faces) << 32 | u64::from(record.vsps_loaded));
        mix(u64::from(record.vsplits) << 32 | u64::from(record.ecols));
        mix(record.certified_error_m.to_bits());
        mix(record.finest_tolerance_m.to_bits());
        record.replay_hash = self.replay_hash;
    }

    /// The tour to ask for, in the model's units.
    fn tour_ask(&self, frame: &ModelFrame) -> Option<TourAsk> {
        let (seed, speed, depth, seconds) = self.tour?;
        let scale = frame.metres_per_unit;
        Some(TourAsk {
            seed,
            seconds,
            speed: speed / scale,
            depth: depth / scale,
            radius: self.radius_m / scale,
        })
    }
}
