//! Queries and settings of the controller, for shells and tests, between two ticks.

use crate::active::object::ActiveObject;
use crate::bodies::{Movables, material_motion};
use crate::cache::{Cache, CacheError};
use crate::contact::motion::Twist;
use crate::contact::rigid_proxy::StepSettings;
use crate::controller::Controller;
use crate::force::effects::UsageByKind;
use crate::instance::ModelFrame;
use crate::lod::predict::Sources;
use crate::probe::Probe;
use crate::streaming::Fault;
use crate::summary::mixed;
use geometry::Pose;
use glam::DVec3;
use protocol::TourPoint;
use spm::ModelHeader;
use spm::NONE;

impl Controller {
    /// Predicts from these sources from now on, to compare them.
    pub fn set_sources(&mut self, sources: Sources) {
        for object in &mut self.active.objects {
            object.front.set_sources(sources);
        }
    }

    /// Steps tools with these settings from now on, to compare them.
    pub fn set_steps(&mut self, settings: StepSettings) {
        let objects = self.active.objects.iter_mut();
        for pair in objects.flat_map(|object| &mut object.contacts.pairs) {
            pair.proxy.set_steps(settings);
        }
    }

    /// Asks for another expected error at the contact from the next tick on, metres; not a number
    /// and negative ones count as 0. No geometry is sent for it that is here already, and nothing
    /// is forgotten.
    pub fn set_tolerance(&mut self, tolerance_m: f64) {
        self.tolerance_m = tolerance_m.max(0.0);
        for object in &mut self.active.objects {
            object.front.set_tolerance(self.tolerance_m);
        }
    }

    /// The expected error asked for at the contact, metres.
    #[must_use]
    pub fn tolerance_m(&self) -> f64 {
        self.tolerance_m
    }

    /// Movable objects, and their poses.
    #[must_use]
    pub fn movables(&self) -> &Movables {
        &self.movables
    }

    /// Motion of the material of an object at a place (world, metres) in a period, by the last
    /// tick, metres and radians; zero for an object that does not move.
    #[must_use]
    pub fn carried(&self, object: usize, at: DVec3) -> Twist {
        let motion = self.movables.body(object as u32).and_then(|body| {
            let motion = material_motion(&body.before()?, &body.pose(), at);
            Some(motion.times(1.0 / body.since().max(1) as f64))
        });
        motion.unwrap_or_default()
    }

    /// Number of probes.
    #[must_use]
    pub fn probes(&self) -> usize {
        self.probes.len()
    }

    /// Places for active objects; with one object there is one.
    #[must_use]
    pub fn active_objects(&self) -> &[ActiveObject] {
        &self.active.objects
    }

    /// An object, while it is active.
    #[must_use]
    pub fn active_object(&self, object: usize) -> Option<&ActiveObject> {
        let object = Some(object as u32);
        self.active.objects.iter().find(|of| of.object() == object)
    }

    /// The cache of the first active object.
    #[must_use]
    pub fn cache(&self) -> &Cache {
        self.active.objects[0].cache()
    }

    /// Steps of memory pressure of the first active object now.
    #[must_use]
    pub fn pressure_steps(&self) -> u32 {
        self.active.objects[0].pressure_steps()
    }

    /// The frame of the first object, once its model is known.
    #[must_use]
    pub fn frame(&self) -> Option<ModelFrame> {
        self.frame_of(0)
    }

    /// The frame of an object, once its model is known.
    #[must_use]
    pub fn frame_of(&self, object: usize) -> Option<ModelFrame> {
        let instance = self.active.instances.get(object)?;
        let header = &self.active.store.model(instance.model)?.header;
        Some(ModelFrame::new(instance.pose, instance.scale, header))
    }

    /// The header of the first object's model, once it is known.
    #[must_use]
    pub fn header(&self) -> Option<&ModelHeader> {
        self.header_of(0)
    }

    /// The header of an object's model, once it is known.
    #[must_use]
    pub fn header_of(&self, object: usize) -> Option<&ModelHeader> {
        let instance = self.active.instances.get(object)?;
        self.active
            .store
            .model(instance.model)
            .map(|model| &model.header)
    }

    /// Headers of the models that are known, each once.
    pub fn headers(&self) -> impl Iterator<Item = &ModelHeader> {
        self.active.store.models().map(|model| &model.header)
    }

    /// The first probe's tour in the file's own frame and units, once it is whole.
    #[must_use]
    pub fn tour(&self) -> Option<&[TourPoint]> {
        self.tour_of(0).map(|(_, points)| points)
    }

    /// A probe's tour, once it is whole: the object, and points in its file's own frame and units.
    #[must_use]
    pub fn tour_of(&self, probe: usize) -> Option<(usize, &[TourPoint])> {
        let tour = self.probes.get(probe)?.tour.as_ref()?;
        let whole = tour.is_whole.then_some(tour.points.as_slice())?;
        Some((tour.object as usize, whole))
    }

    /// Where a probe's tour begins, as soon as that is known: the object, and a point in its file's
    /// own frame and units.
    #[must_use]
    pub fn tour_begin_of(&self, probe: usize) -> Option<(usize, &TourPoint)> {
        let tour = self.probes.get(probe)?.tour.as_ref()?;
        Some((tour.object as usize, tour.points.first()?))
    }

    /// The fault that leaves nothing to do: no object can be touched, or no probe is led.
    #[must_use]
    pub fn fault(&self) -> Option<Fault> {
        let is_unled = || self.probes.iter().all(Probe::is_tour_refused);
        let is_over = self.active.is_lost() || is_unled();
        is_over
            .then(|| self.faults().next())?
            .map(|(_, fault)| fault)
    }

    /// Whether any object has a fault.
    #[must_use]
    pub fn has_faults(&self) -> bool {
        self.active.has_fault() || self.probes.iter().any(Probe::is_tour_refused)
    }

    /// Another number whenever [`Controller::faults`] are others; 0 while there was none. It costs
    /// next to nothing, they a look at every object.
    #[must_use]
    pub fn faults_stamp(&self) -> u64 {
        let refused = self.probes.iter().map(Probe::is_tour_refused);
        refused.fold(self.active.fault_changes(), |stamp, is_refused| {
            2 * stamp + u64::from(is_refused)
        })
    }

    /// Faults of the objects of the scene: contact with the others goes on, and with these as far
    /// as their meshes have come.
    pub fn faults(&self) -> impl Iterator<Item = (usize, Fault)> {
        let tours = self.probes.iter().filter_map(|probe| probe.tour.as_ref());
        let refused = tours.filter(|tour| tour.is_refused());
        let without_tour = refused.map(|tour| (tour.object as usize, Fault::NoTour));
        let instances = self.active.instances.iter();
        let of_models = instances.filter_map(|instance| {
            let fault = self.active.fault_of(instance)?;
            Some((instance.object as usize, self.of_all_objects(fault)))
        });
        of_models.chain(without_tour)
    }

    /// A fault as a person sees it: an active object knows its own share of the cache only.
    fn of_all_objects(&self, fault: Fault) -> Fault {
        match fault {
            Fault::Cache(CacheError::TooSmall {
                needed, base_faces, ..
            }) => Fault::Cache(CacheError::TooSmall {
                bytes: self.cache_bytes,
                needed: self.active.bytes_for_least(needed) + self.active.store.bytes(),
                base_faces,
            }),
            other => other,
        }
    }

    /// The first probe's centre in the world as it was last sampled, metres; the origin before.
    #[must_use]
    pub fn probe(&self) -> DVec3 {
        self.probe_of(0)
    }

    /// A probe's centre in the world as it was last sampled, metres; the origin before.
    #[must_use]
    pub fn probe_of(&self, probe: usize) -> DVec3 {
        self.probes[probe]
            .last
            .map_or(DVec3::ZERO, |pose| pose.position)
    }

    /// The first probe's proxy at the first object, see [`Controller::proxy_of`].
    #[must_use]
    pub fn proxy(&self) -> Option<DVec3> {
        self.proxy_of(0, 0)
    }

    /// The centre of a probe's proxy at an object in the world, metres: where the probe would be if
    /// it could not enter that object. `None` while the two are far from each other.
    #[must_use]
    pub fn proxy_of(&self, probe: usize, object: usize) -> Option<DVec3> {
        let active = self.active_object(object)?;
        let position = active.contacts.pairs[probe].proxy.position()?;
        Some(active.frame?.to_world(position))
    }

    /// The pose of a probe's proxy at an object in the world, metres; the axes of a ball are the
    /// object's. `None` while the two are far from each other.
    #[must_use]
    pub fn proxy_pose_of(&self, probe: usize, object: usize) -> Option<Pose> {
        let active = self.active_object(object)?;
        let pose = active.contacts.pairs[probe].proxy.pose()?;
        let frame = active.frame?;
        Some(Pose {
            position: frame.to_world(pose.position),
            orientation: frame.pose.orientation * pose.orientation,
        })
    }

    /// The base mesh of an object's model, once it is known, where it is kept beside the active
    /// objects: vertices in stored coordinates, and corners of faces. Not for a tick: it allocates.
    #[must_use]
    pub fn kept_base_mesh(&self, object: usize) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
        let instance = self.active.instances.get(object)?;
        self.active.store.base_mesh(instance.model)
    }

    /// Samples rejected so far, of all probes: no plausible motion led to them.
    #[must_use]
    pub fn rejected_samples(&self) -> u64 {
        self.probes.iter().map(|probe| probe.rejected_samples).sum()
    }

    /// Regions that the station refused so far, and the last one.
    #[must_use]
    pub fn refused(&self) -> (u64, u32) {
        let fronts = || self.active.objects.iter().map(|of| &of.front);
        let last = fronts().rfind(|front| front.refused_regions > 0);
        let sum = fronts().map(|front| front.refused_regions).sum();
        (sum, last.map_or(NONE, |front| front.last_refused))
    }

    /// Regions asked for again, with every record, so far: their answer counted on records that
    /// were gone.
    #[must_use]
    pub fn resent(&self) -> u64 {
        let sessions = self.active.objects.iter().map(|of| &of.session);
        sessions.map(|session| session.subscriber().resent).sum()
    }

    /// Constraints of the proxies that did not fit beside the
    /// [`crate::contact::sphere_proxy::MAX_CONSTRAINTS`] deepest, so far.
    #[must_use]
    pub fn dropped_constraints(&self) -> u64 {
        let contacts = self.active.objects.iter().map(|of| &of.contacts);
        contacts.map(|of| of.dropped_constraints).sum()
    }

    /// What the effects of each kind cost so far, in the order of [`scene::Effect::NAMES`]: nothing
    /// where a scene lists none. The cost of an object that is not active any more is not counted.
    #[must_use]
    pub fn effects(&self) -> UsageByKind {
        let mut usage = UsageByKind::default();
        for probe in &self.probes {
            probe.effects.add_usage(&mut usage);
        }
        for pair in self.active.objects.iter().flat_map(|of| &of.contacts.pairs) {
            pair.effects.add_usage(&mut usage);
        }
        usage
    }

    /// Whether all forces have ramped down after `stopping`.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.probes.iter().all(Probe::is_at_rest)
    }

    /// Hash over the fronts: the ids of the performed splits of each active object. At rest it is a
    /// function of place and tolerance, whatever came before. Not for a tick: it allocates.
    #[must_use]
    pub fn front_hash(&self) -> u64 {
        self.active.objects.iter().fold(0, |hash, active| {
            let (cache, mesh) = (active.cache(), active.cache().mesh());
            let performed = (0..cache.slots()).filter(|&slot| mesh.is_performed(slot));
            let mut ids: Vec<u32> = performed.map(|slot| mesh.id(slot)).collect();
            ids.sort_unstable();
            let ids = ids.into_iter().map(u64::from);
            ids.fold(mixed(hash, u64::MAX), mixed)
        })
    }

    /// Hash over the outputs of every tick so far.
    #[must_use]
    pub fn replay_hash(&self) -> u64 {
        self.replay_hash
    }
}
