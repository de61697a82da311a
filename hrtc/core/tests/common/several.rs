//! Scenes of several objects and probes: both cores on one link, samples given by the test.

use super::{DELAY, Faults, identity, post};
use geometry::Pose;
use glam::DVec3;
use haptic_device::Sample;
use hrtc_core::record::CoreRecord;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, NoObserver, StageObserver, TickInputs, TickOutputs};
use protocol::Request;
use realtime::counting_allocator::count;
use scene::{NoFiles, Overrides, ScenePlan, parse};
use spm::SpmFile;
use station_core::station::{Message, ServedModel, ServedObject, Station};
use std::collections::VecDeque;
use std::path::Path;

/// A scene of objects, each a name of a model, a size (metres) and a place, and of so many probes of 1 mm that
/// are led by the test.
pub fn scene_plan(objects: &[(&str, f64, DVec3)], probes: usize, cache_bytes: usize) -> ScenePlan {
    let mut text = format!("[cache]\nbytes = {cache_bytes}\n");
    for (model, size, at) in objects {
        text += &format!(
            "[[object]]\nmodel = \"{model}\"\nsize_m = {size}\npose = {{ position_m = [{}, {}, {}] }}\n",
            at.x, at.y, at.z
        );
    }
    for _ in 0..probes {
        text += "[[probe]]\n";
    }
    let mut plan = parse(
        &text,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("the test's scene is good");
    for probe in &mut plan.probes {
        // No tour is asked for.
        probe.trajectory = scene::TrajectoryPlan::Points(Vec::new());
    }
    plan
}

/// A station of a plan's objects; `models`: name and file of each.
pub fn scene_station(
    plan: &ScenePlan,
    models: &[(&str, &[u8])],
    incarnation: u64,
) -> Station<Vec<u8>> {
    let served = models.iter().map(|(name, spm)| ServedModel {
        name: (*name).to_string(),
        file: SpmFile::open(spm.to_vec()).expect("the SPM is good"),
    });
    let objects = plan.objects.iter().map(|object| {
        let name = object.model.name();
        let model = models.iter().position(|(other, _)| *other == name);
        ServedObject {
            model: model.expect("the test serves every model"),
            name: Request::name_hash(&name),
        }
    });
    Station::new(incarnation, served.collect(), objects.collect())
}

/// Both cores and a link with a delay.
pub struct Scene {
    pub controller: Controller,
    pub station: Station<Vec<u8>>,
    pub outputs: TickOutputs,
    pub tick: u64,
    /// While set, what crosses the link is lost, doubled or overtaken.
    pub faults: Option<Faults>,
    /// Allocations and frees within ticks; stays 0 without the counting allocator.
    pub allocations: u64,
    to_station: VecDeque<(u64, Request)>,
    to_controller: VecDeque<(u64, InboxChunk)>,
    pub inbox: Vec<InboxChunk>,
}

impl Scene {
    pub fn new(plan: &ScenePlan, models: &[(&str, &[u8])]) -> Self {
        Self::touring(plan, models, 0.0)
    }

    /// The same with tours of so many seconds.
    pub fn touring(plan: &ScenePlan, models: &[(&str, &[u8])], seconds: f64) -> Self {
        Self {
            controller: Controller::new(plan, identity(), 10.0, seconds),
            station: scene_station(plan, models, 100),
            outputs: TickOutputs::new(plan.probes.len()),
            tick: 0,
            faults: None,
            allocations: 0,
            to_station: VecDeque::new(),
            to_controller: VecDeque::new(),
            inbox: Vec::new(),
        }
    }

    /// The station dies and another incarnation comes up.
    pub fn restart_station(&mut self, station: Station<Vec<u8>>) {
        self.station = station;
        self.to_station.clear();
        self.to_controller.clear();
    }

    /// One tick with each probe at a place; `None` gives no sample.
    pub fn step(&mut self, places: &[Option<DVec3>]) -> CoreRecord {
        self.step_observed(places, &mut NoObserver)
    }

    /// The same, with an observer of the stages.
    pub fn step_observed(
        &mut self,
        places: &[Option<DVec3>],
        observer: &mut impl StageObserver,
    ) -> CoreRecord {
        let poses: Vec<_> = places.iter().map(|place| place.map(Pose::at)).collect();
        self.step_poses(&poses, observer)
    }

    /// The same with whole poses.
    pub fn step_poses(
        &mut self,
        poses: &[Option<Pose>],
        observer: &mut impl StageObserver,
    ) -> CoreRecord {
        let tick = self.tick;
        while self.to_station.front().is_some_and(|(due, _)| *due <= tick) {
            if let Some((_, request)) = self.to_station.pop_front() {
                self.station.handle(Message::Request(&request));
            }
        }
        while let Some((header, slots)) = self.station.poll(identity().client) {
            let chunk = InboxChunk { header, slots };
            post(
                &mut self.faults,
                &mut self.to_controller,
                tick + DELAY,
                chunk,
            );
        }
        while self.inbox.len() < 64
            && self
                .to_controller
                .front()
                .is_some_and(|(due, _)| *due <= tick)
        {
            self.inbox
                .extend(self.to_controller.pop_front().map(|(_, chunk)| chunk));
        }
        let samples: Vec<Option<Sample>> = poses.iter().map(|pose| pose.map(Sample::at)).collect();
        let inputs = TickInputs {
            tick,
            samples: &samples,
            station: self.station.incarnation(),
            chunks: [&self.inbox, &[]],
            stopping: false,
        };
        self.allocations += count(|| {
            self.controller.tick(&inputs, &mut self.outputs, observer);
        });
        self.inbox.drain(..self.outputs.chunks_consumed);
        for request in self.outputs.outbox.requests() {
            post(
                &mut self.faults,
                &mut self.to_station,
                tick + DELAY,
                *request,
            );
        }
        for report in &self.outputs.reports {
            self.station.handle(Message::Contact(report));
        }
        self.tick += 1;
        self.outputs.record
    }

    /// Steps with the probes at their places until every model is known and nothing changes on the seats.
    pub fn settle(&mut self, places: &[Option<DVec3>]) -> CoreRecord {
        let mut quiet = 0;
        for _ in 0..20_000 {
            let before = self.outputs.record.vsps_received;
            let record = self.step(places);
            let changed = record.vsplits + record.ecols > 0 || record.vsps_received != before;
            quiet = if record.ready && !changed {
                quiet + 1
            } else {
                0
            };
            if quiet == 300 {
                return record;
            }
        }
        panic!("the scene does not come to rest");
    }

    /// Checks the caches of all seats; while a base mesh is coming there is nothing to check.
    pub fn check(&self) {
        let seats = self.controller.active_objects().iter();
        for seat in seats.filter(|seat| seat.is_ready()) {
            seat.cache().check();
        }
    }

    /// Ids of the performed splits of an object that is awake, ascending.
    pub fn refined_front(&self, object: usize) -> Vec<u32> {
        let seat = self.controller.active_object(object).expect("it is awake");
        let cache = seat.cache();
        let performed = (0..cache.slots()).filter(|&slot| cache.mesh().is_performed(slot));
        let mut ids: Vec<u32> = performed.map(|slot| cache.mesh().id(slot)).collect();
        ids.sort_unstable();
        ids
    }
}
