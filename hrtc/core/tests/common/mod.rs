//! The two cores and the simulated device in one process: no clock, no transport, every run repeats.
#![allow(dead_code, reason = "every test file uses another part")]

use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{Device, Intent, Sample, TickTime, WrenchCommand};
use hrtc_core::record::CoreRecord;
use hrtc_core::script::Script;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, NoObserver, StageObserver, TickInputs, TickOutputs};
use protocol::{AnswerItem, AnswersReader, AnswersWriter, ChunkKind, Request};
use realtime::counting_allocator::count;
use scene::{NoFiles, Overrides, ScenePlan, parse};
use simulated_device::SimulatedDevice;
use spm::{SpmFile, VspRecord, write_spm};
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model, read_mesh};
use station_core::station::{Message, ServedModel, ServedObject, Station};
use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

pub mod several;

/// Periods that a message takes each way.
const DELAY: u64 = 2;

/// Ticks without any change after which a front at rest is taken to be complete.
const QUIET_TICKS: u64 = 500;

/// Ticks above a place before it is touched.
const APPROACH_TICKS: u64 = 500;

/// Name by which both cores know the model.
const NAME: &str = "model.spm";

/// A scene of one object and one tour.
pub fn plan(extra: &str) -> ScenePlan {
    let text = format!(
        r#"
[cache]
bytes = "16MiB"
[[object]]
model = "{NAME}"
size_m = 0.15
surface = {{ stiffness_n_per_m = 800.0, damping_ns_per_m = 0.5 }}
[[probe]]
shape = {{ sphere = {{ radius_m = 0.001 }} }}
device = {{ simulated = {{ mass_kg = 0.1, damping_ns_per_m = 1.0, encoder_m = 1e-5, hand = {{ stiffness_n_per_m = 200.0, damping_ns_per_m = 2.0 }} }} }}
trajectory = {{ tour = {{ seed = 1, speed_m_per_s = 0.1, depth_m = 0.002 }} }}
{extra}
"#
    );
    parse(
        &text,
        "test",
        Path::new(""),
        &Overrides::default(),
        &NoFiles,
    )
    .expect("the test's scene is good")
}

/// A file of `../shared/models`, or `None` with a line that says so.
pub fn real_model(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/models")
        .join(name);
    if path.exists() {
        Some(path)
    } else {
        println!("skipped: {name} is not there ({})", path.display());
        None
    }
}

/// Bytes of the SPM of a mesh file.
pub fn spm_of_file(path: &Path) -> Vec<u8> {
    spm(
        read_mesh(path).expect("the model is read"),
        &BuildOptions::default(),
    )
}

/// Bytes of the SPM of a mesh.
pub fn spm(mesh: SoupMesh, options: &BuildOptions) -> Vec<u8> {
    let parts = build_model(mesh, options, &NoProgress).expect("the model is built");
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).expect("memory takes it");
    bytes
}

/// What a run was like.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary {
    pub ticks: u64,
    pub contact: u64,
    pub full: u64,
    pub force_max: f64,
    pub force_step_max: f64,
    pub faces_max: u32,
    pub faces_sum: u64,
    pub vsplits: u64,
    pub ecols: u64,
    pub work_max: u32,
    pub certified_max: f64,
    pub measured_max: f64,
    pub cache_max: u64,
    pub last: CoreRecord,
}

/// Both cores, the device, and a link with a delay.
pub struct Pair {
    pub controller: Controller,
    pub station: Station<Vec<u8>>,
    pub device: SimulatedDevice,
    pub tick: u64,
    pub summary: Summary,
    script: Script,
    script_start: Option<u64>,
    to_station: VecDeque<(u64, Request)>,
    to_controller: VecDeque<(u64, InboxChunk)>,
    inbox: Vec<InboxChunk>,
    /// What the last tick gave.
    pub outputs: TickOutputs,
    rate: f64,
    last_force: DVec3,
    /// What each tick gave, for replays: inputs and hash.
    pub log: Vec<(Option<Sample>, u64, usize, u64)>,
    /// Every chunk that arrived.
    pub arrivals: Vec<InboxChunk>,
    /// While set, nothing crosses the link.
    pub cut: bool,
    /// While set, what crosses the link is lost, doubled or overtaken.
    pub faults: Option<Faults>,
    /// Changes chunks on their way to the controller.
    pub tamper: Option<Tamper>,
    /// Seconds of the tour at which the hand stops and stays.
    pub rest_at: f64,
    /// Allocations and frees within device and tick; stays 0 without the counting allocator.
    pub allocations: u64,
    last_wrench: Wrench,
}

/// A place on the surface and one above it, metres of the world.
#[derive(Debug, Clone, Copy)]
pub struct Touch {
    /// In free space.
    pub above: DVec3,
    /// The probe's centre on the surface: pressed in by its radius.
    pub goal: DVec3,
}

/// Places on the surface under a plan's tour at some times, seconds.
pub fn touches<const N: usize>(plan: &ScenePlan, spm: &[u8], seconds: [f64; N]) -> [Touch; N] {
    let mut pair = Pair::new(plan, spm.to_vec(), 8.0);
    while pair.controller.tour().is_none() {
        pair.step();
        assert!(pair.tick < 10_000, "the tour arrives");
    }
    let tour = pair.controller.tour().expect("it was waited for");
    let frame = pair.controller.frame().expect("the model is there");
    seconds.map(|seconds| {
        let point = tour.iter().find(|point| point.t >= seconds);
        // Points of a tour lie under the surface.
        let inside = point.expect("the tour is longer").position;
        let inside = frame.to_world(DVec3::from_array(inside) - frame.origin);
        pair.touch(spm, inside)
    })
}

/// Changes a chunk.
pub type Tamper = Box<dyn FnMut(&mut InboxChunk)>;

/// Packs a chunk of answers again with its records changed.
pub fn change_records(chunk: &mut InboxChunk, mut change: impl FnMut(&mut VspRecord)) {
    if chunk.header.kind != ChunkKind::Answers as u32 {
        return;
    }
    let mut reader = AnswersReader::new(chunk.header.count);
    let mut writer = AnswersWriter::new();
    while let Some(item) = reader.next(&chunk.slots).expect("the station packs well") {
        match item {
            AnswerItem::Part(head) => {
                writer.begin(head.region, head.tolerance_bits, head.is_first());
            }
            AnswerItem::Id { id, record_follows } => assert!(writer.id(id, record_follows)),
            AnswerItem::Record(mut record) => {
                change(&mut record);
                assert!(writer.record(&record));
            }
            AnswerItem::End(head) => writer.end(head.is_last()),
        }
    }
    (chunk.header.count, chunk.slots) = writer.finish();
}

/// splitmix64: the tests' own randomness, the same on every machine.
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ z >> 31
    }

    /// From 0 to 1.
    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }
}

/// What a bad link does to a message: each with its probability.
#[derive(Debug, Clone)]
pub struct Faults {
    pub random: Random,
    pub loss: f64,
    pub duplication: f64,
    pub overtaking: f64,
}

/// Puts a message on its way; a bad link may do something to it.
fn post<T: Copy>(faults: &mut Option<Faults>, queue: &mut VecDeque<(u64, T)>, due: u64, item: T) {
    let Some(faults) = faults else {
        queue.push_back((due, item));
        return;
    };
    if faults.random.unit() < faults.loss {
        return;
    }
    queue.push_back((due, item));
    if faults.random.unit() < faults.duplication {
        queue.push_back((due, item));
    }
    let last = queue.len() - 1;
    if last > 0 && faults.random.unit() < faults.overtaking {
        queue.swap(last, last - 1);
    }
}

pub fn identity() -> Identity {
    Identity {
        client: 7,
        incarnation: 8,
    }
}

pub fn station(spm: Vec<u8>, incarnation: u64) -> Station<Vec<u8>> {
    let served = ServedModel {
        name: NAME.to_string(),
        file: SpmFile::open(spm).expect("the SPM is good"),
    };
    let object = ServedObject {
        model: 0,
        name: Request::name_hash(NAME),
    };
    Station::new(incarnation, vec![served], vec![object])
}

impl Pair {
    pub fn new(plan: &ScenePlan, spm: Vec<u8>, seconds: f64) -> Self {
        Self::with_device_limit(plan, spm, seconds, 10.0)
    }

    /// The same with a device that can render up to `device_max_n`.
    pub fn with_device_limit(
        plan: &ScenePlan,
        spm: Vec<u8>,
        seconds: f64,
        device_max_n: f64,
    ) -> Self {
        let rate = plan.loop_.rate_hz;
        let device = SimulatedDevice::new(plan.probes[0].device, 1.0 / rate);
        Self {
            controller: Controller::new(plan, identity(), device_max_n, seconds),
            station: station(spm, 100),
            device,
            tick: 0,
            summary: Summary::default(),
            script: Script::default(),
            script_start: None,
            to_station: VecDeque::new(),
            to_controller: VecDeque::new(),
            inbox: Vec::new(),
            outputs: TickOutputs::new(1),
            rate,
            last_force: DVec3::ZERO,
            log: Vec::new(),
            arrivals: Vec::new(),
            cut: false,
            faults: None,
            tamper: None,
            rest_at: f64::INFINITY,
            allocations: 0,
            last_wrench: Wrench::ZERO,
        }
    }

    /// Chunks that have arrived and wait.
    pub fn waiting(&self) -> usize {
        self.inbox.len()
    }

    /// One tick with the hand on the tour.
    pub fn step(&mut self) -> CoreRecord {
        self.step_observed(&mut NoObserver)
    }

    /// The same, with an observer of the stages.
    pub fn step_observed(&mut self, observer: &mut impl StageObserver) -> CoreRecord {
        let intent = match (self.controller.tour(), self.controller.frame()) {
            (Some(tour), Some(frame)) => {
                let start = *self.script_start.get_or_insert(self.tick);
                let t = (self.tick - start) as f64 / self.rate;
                let resting = t >= self.rest_at;
                let intent = self.script.along_tour(tour, &frame, t.min(self.rest_at));
                intent.map(|intent| Intent {
                    velocity: if resting {
                        DVec3::ZERO
                    } else {
                        intent.velocity
                    },
                    ..intent
                })
            }
            _ => None,
        };
        self.step_with(intent, observer)
    }

    /// One tick with the hand at a place.
    pub fn step_at(&mut self, position: DVec3) -> CoreRecord {
        let intent = Intent {
            pose: Pose::at(position),
            velocity: DVec3::ZERO,
        };
        self.step_with(Some(intent), &mut NoObserver)
    }

    fn step_with(
        &mut self,
        intent: Option<Intent>,
        observer: &mut impl StageObserver,
    ) -> CoreRecord {
        if let Some(intent) = intent {
            self.device.intend(intent);
        }
        let mut sample = None;
        self.allocations += count(|| sample = self.device.read(TickTime::default()));
        self.step_sample(sample, observer)
    }

    /// One tick with a sample of the caller's; the device feels the wrench.
    pub fn step_sample(
        &mut self,
        sample: Option<Sample>,
        observer: &mut impl StageObserver,
    ) -> CoreRecord {
        let tick = self.tick;
        let station = if self.cut {
            0
        } else {
            self.station.incarnation()
        };
        if !self.cut {
            while self.to_station.front().is_some_and(|(due, _)| *due <= tick) {
                if let Some((_, request)) = self.to_station.pop_front() {
                    self.station.handle(Message::Request(&request));
                }
            }
            while let Some((header, slots)) = self.station.poll(identity().client) {
                let mut chunk = InboxChunk { header, slots };
                if let Some(tamper) = &mut self.tamper {
                    tamper(&mut chunk);
                }
                let queue = &mut self.to_controller;
                post(&mut self.faults, queue, tick + DELAY, chunk);
            }
        }
        while self
            .to_controller
            .front()
            .is_some_and(|(due, _)| *due <= tick)
            && self.inbox.len() < 64
        {
            if let Some((_, chunk)) = self.to_controller.pop_front() {
                self.inbox.push(chunk);
                self.arrivals.push(chunk);
            }
        }
        let samples = [sample];
        let inputs = TickInputs {
            tick,
            samples: &samples,
            station,
            chunks: [&self.inbox, &[]],
            stopping: false,
        };
        self.allocations += count(|| {
            self.controller.tick(&inputs, &mut self.outputs, observer);
        });
        let available = self.arrivals.len();
        self.log
            .push((sample, station, available, self.outputs.record.replay_hash));
        self.inbox.drain(..self.outputs.chunks_consumed);
        for request in self.outputs.outbox.requests() {
            let queue = &mut self.to_station;
            post(&mut self.faults, queue, tick + DELAY, *request);
        }
        for report in &self.outputs.reports {
            self.station.handle(Message::Contact(report));
        }
        let wrench = self.outputs.wrenches[0];
        self.allocations += count(|| self.device.write(WrenchCommand::unlimited(wrench)));
        self.last_wrench = wrench;
        self.account(wrench);
        self.tick += 1;
        self.outputs.record
    }

    fn account(&mut self, wrench: Wrench) {
        let record = self.outputs.record;
        let s = &mut self.summary;
        s.ticks += 1;
        s.contact += u64::from(record.contact);
        s.full += u64::from(record.contact_full);
        s.force_max = s.force_max.max(wrench.force.length());
        s.force_step_max = s.force_step_max.max(wrench.force.distance(self.last_force));
        self.last_force = wrench.force;
        s.faces_max = s.faces_max.max(record.active_faces);
        s.faces_sum += u64::from(record.active_faces);
        s.vsplits += u64::from(record.vsplits);
        s.ecols += u64::from(record.ecols);
        s.work_max = s.work_max.max(record.work_units);
        s.certified_max = s.certified_max.max(record.certified_error_m);
        s.measured_max = s.measured_max.max(record.measured_error_m);
        s.cache_max = s.cache_max.max(record.cache_bytes);
        s.last = record;
    }

    /// The station dies and another incarnation comes up with the same file.
    pub fn restart_station(&mut self, spm: Vec<u8>, incarnation: u64) {
        self.station = station(spm, incarnation);
        self.to_station.clear();
        self.to_controller.clear();
    }

    /// The force of the last tick, newtons.
    pub fn force(&self) -> DVec3 {
        self.last_wrench.force
    }

    /// The surface over a point under it, metres of the world.
    pub fn touch(&self, spm: &[u8], inside: DVec3) -> Touch {
        let frame = self.controller.frame().expect("the model is there");
        let inside = frame.to_model(inside);
        let file = SpmFile::open(spm).expect("the SPM is good");
        let (_, closest) = file.closest_point(inside).expect("the SPM is good");
        let out = frame.vector_to_world(closest.point - inside).normalize();
        let goal = frame.to_world(closest.point);
        Touch {
            above: goal + 0.0025 * out,
            goal,
        }
    }

    /// Ticks with the probe first above a place and then at it, until the front has not changed and nothing has
    /// arrived for [`QUIET_TICKS`] ticks.
    pub fn rest(&mut self, touch: Touch, most: u64) {
        let (mut quiet, mut received, start) = (0, u64::MAX, self.tick);
        while quiet < QUIET_TICKS {
            let ticks = self.tick - start;
            assert!(
                ticks < most,
                "the front does not come to rest in {most} ticks"
            );
            let is_down = ticks >= APPROACH_TICKS;
            let place = if is_down { touch.goal } else { touch.above };
            let record = self.hold(place);
            let changes = record.vsplits + record.ecols + record.geomorphing;
            let changed = changes > 0 || record.vsps_received != received;
            received = record.vsps_received;
            assert!(
                is_down || ticks < APPROACH_TICKS / 2 || !record.contact,
                "it is free"
            );
            quiet = if is_down && !changed { quiet + 1 } else { 0 };
        }
    }

    /// One tick with the device held at a place.
    pub fn hold(&mut self, place: DVec3) -> CoreRecord {
        let sample = Sample::at(Pose::at(place));
        self.step_sample(Some(sample), &mut NoObserver)
    }

    /// The active faces by the file's ids, which no slot has a part in.
    pub fn front_faces(&self) -> BTreeSet<u32> {
        let header = self.controller.header().expect("the model is there");
        let mesh = self.controller.cache().mesh();
        let mut faces = BTreeSet::new();
        mesh.for_each_active_face(|face| {
            let id = mesh.creator_of_face(face).map_or(face, |slot| {
                header.base_faces + 2 * mesh.id(slot) + (face - mesh.fl(slot))
            });
            assert!(faces.insert(id), "a face is there once");
        });
        faces
    }

    /// Ids of the VSPs that are performed, ascending: the refined front.
    pub fn refined_front(&self) -> Vec<u32> {
        let cache = self.controller.cache();
        let performed = (0..cache.slots()).filter(|&slot| cache.mesh().is_performed(slot));
        let mut ids: Vec<u32> = performed.map(|slot| cache.mesh().id(slot)).collect();
        ids.sort_unstable();
        ids
    }

    /// Whether every face of the front that holds the probe is of the full mesh, in share of contact ticks.
    pub fn full_share(&self) -> f64 {
        self.summary.full as f64 / self.summary.contact.max(1) as f64
    }
}
