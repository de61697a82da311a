//! Both pure cores on a link of this test's own: no clock, no transport, and nothing of the
//! simulators, which may change.

use super::digest::Digest;
use super::outputs::{PARTS, Tally, put_tick};
use geometry::Pose;
use haptic_device::{Device, Sample, TickTime, WrenchCommand};
use hrtc_core::script::Script;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, ControllerOptions, NoObserver, TickInputs, WrenchLimits};
use protocol::{ContactReport, Request};
use scene::{Overrides, ProbePlan, ScenePlan, TrajectoryPlan, load};
use scene_files::DiskFiles;
use simulated_device::SimulatedDevice;
use spm::SpmFile;
use station_core::station::{Message, ServedModel, ServedObject, Station};
use std::collections::VecDeque;
use std::path::Path;

/// Ticks of a run.
pub const TICKS: u64 = 3000;
/// Periods that a message takes each way.
const DELAY: u64 = 2;
/// Chunks that wait for the tick at the most.
const INBOX: usize = 64;
/// Incarnation of the station.
const STATION: u64 = 100;
/// What every device can render, and the length of the tours.
const OPTIONS: ControllerOptions<'_> = ControllerOptions {
    limits: &[WrenchLimits::of_force(10.0)],
    tour_seconds: 4.0,
};
const IDENTITY: Identity = Identity {
    client: 7,
    incarnation: 8,
};

/// Folder of the scenes' files.
pub fn folder() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden"))
}

/// What a run is told before each of its ticks.
#[derive(Debug, Default)]
pub struct Orders {
    /// What the link does to what is posted now: probabilities of a loss, of a second copy, and of
    /// being overtaken.
    pub faults: [f64; 3],
    /// Whether the station is away: nothing reaches it, and nothing comes.
    pub is_silent: bool,
    /// Of the chunks that come out of the station, every so many is damaged on its way; 0 for none.
    pub damaged_every: u64,
    /// Whether the devices give nothing.
    pub is_blind: bool,
    /// Whether the first device gives what is no number.
    pub is_mad: bool,
    /// Whether the force is to ramp down.
    pub is_stopping: bool,
    /// The expected error that is asked for from now on, metres.
    pub tolerance_m: Option<f64>,
}

/// A scene of the test.
#[derive(Debug, Clone, Copy)]
pub struct Scene {
    /// Its name, and that of its file of hashes.
    pub name: &'static str,
    /// Bytes that are flipped in the files that the station opens: model, place.
    pub flipped: &'static [(&'static str, usize)],
    /// What happens before a tick.
    pub before: fn(u64, &mut Orders),
}

impl Scene {
    /// The scene of `NAME.toml`, with sound files and no orders.
    pub fn new(name: &'static str) -> Self {
        Self {
            name,
            flipped: &[],
            before: |_, _| {},
        }
    }
}

/// What a run gave: the hashes of every tick so far after each tick, and what it was like.
pub fn run(scene: &Scene) -> (Vec<[Digest; PARTS.len()]>, Tally) {
    let path = folder().join(format!("{}.toml", scene.name));
    let plan = load(&path, &Overrides::default(), &DiskFiles).expect("the scene is good");
    let mut controller = Controller::new(&plan, IDENTITY, OPTIONS);
    let mut station = station(&plan, scene.flipped);
    let mut outputs = controller.new_outputs();
    let mut hands: Vec<Hand> = plan.probes.iter().map(|of| Hand::new(of, &plan)).collect();
    let mut orders = Orders::default();
    let mut requests: Line<Request> = Line::new(1);
    let mut reports: Line<ContactReport> = Line::new(2);
    let mut chunks: Line<InboxChunk> = Line::new(3);
    let (mut inbox, mut sent) = (Vec::new(), 0);
    let (mut digests, mut tally) = ([Digest::default(); PARTS.len()], Tally::default());
    let mut after = Vec::new();
    for tick in 0..TICKS {
        (scene.before)(tick, &mut orders);
        if let Some(tolerance_m) = orders.tolerance_m.take() {
            controller.set_tolerance(tolerance_m);
        }
        let is_heard = !orders.is_silent;
        while let Some(request) = requests.take(tick) {
            if is_heard {
                station.handle(Message::Request(&request));
            }
        }
        while let Some(report) = reports.take(tick) {
            if is_heard {
                station.handle(Message::Contact(&report));
            }
        }
        station.tell_time((1000 * tick) as u32);
        while is_heard && let Some((header, slots)) = station.poll(IDENTITY.client) {
            let mut chunk = InboxChunk { header, slots };
            sent += 1;
            if orders.damaged_every > 0 && sent % orders.damaged_every == 0 {
                damage(&mut chunk);
            }
            chunks.post(tick, chunk, orders.faults);
        }
        let waiting = inbox.len();
        while inbox.len() < INBOX
            && let Some(chunk) = chunks.take(tick)
        {
            inbox.push(chunk);
        }
        let sampled = hands.iter_mut().enumerate();
        let mut samples: Vec<_> = sampled
            .map(|(probe, hand)| hand.sample(probe, tick, &controller))
            .collect();
        if orders.is_blind {
            samples.fill(None);
        }
        if let (true, Some(sample)) = (orders.is_mad, &mut samples[0]) {
            sample.pose.position.y = f64::NAN;
        }
        let inputs = TickInputs {
            tick,
            samples: &samples,
            station: if is_heard { STATION } else { 0 },
            chunks: [&inbox, &[]],
            stopping: orders.is_stopping,
        };
        controller.tick(&inputs, &mut outputs, &mut NoObserver);
        for (hand, wrench) in hands.iter_mut().zip(&outputs.wrenches) {
            hand.device.write(WrenchCommand::unlimited(*wrench));
        }
        put_tick(&mut digests, tick, &controller, &outputs, &inbox[waiting..]);
        after.push(digests);
        inbox.drain(..outputs.chunks_consumed);
        tally.take(&controller, &outputs, inbox.len());
        for &request in outputs.outbox.requests() {
            requests.post(tick, request, orders.faults);
        }
        for &report in &outputs.reports {
            reports.post(tick, report, orders.faults);
        }
    }
    assert!(controller.fault().is_none(), "{:?}", controller.fault());
    (after, tally)
}

/// A station that serves the plan's objects from the files of the folder.
fn station(plan: &ScenePlan, flipped: &[(&str, usize)]) -> Station<Vec<u8>> {
    let mut names: Vec<String> = Vec::new();
    let mut objects = Vec::new();
    for object in &plan.objects {
        let name = object.model.name();
        let known = names.iter().position(|other| *other == name);
        objects.push(ServedObject {
            model: known.unwrap_or(names.len()),
            name: Request::name_hash(&name),
        });
        if known.is_none() {
            names.push(name);
        }
    }
    let served = names.into_iter().map(|name| {
        let mut bytes = std::fs::read(folder().join(&name)).expect("the file is in the repository");
        for &(_, place) in flipped.iter().filter(|(model, _)| *model == name) {
            bytes[place] ^= 1;
        }
        let file = SpmFile::open(bytes).expect("the SPM is good");
        ServedModel { name, file }
    });
    Station::new(STATION, served.collect(), objects)
}

/// What no record and no model may hold: positions that are no numbers, ids that are none.
fn damage(chunk: &mut InboxChunk) {
    for slot in &mut chunk.slots[40..44] {
        slot.words.fill(u32::MAX);
    }
}

/// The simulated device in a hand that follows the plan's path; the loop is closed.
struct Hand {
    device: SimulatedDevice,
    script: Script,
    points: Vec<(f64, Pose)>,
    period_s: f64,
    start: Option<u64>,
}

impl Hand {
    fn new(plan: &ProbePlan, scene: &ScenePlan) -> Self {
        let period_s = 1.0 / scene.loop_.rate_hz;
        let points = match &plan.trajectory {
            TrajectoryPlan::Points(points) => points.clone(),
            TrajectoryPlan::Tour { .. } => Vec::new(),
        };
        Self {
            device: SimulatedDevice::new(plan.device, period_s),
            script: Script::default(),
            points,
            period_s,
            start: None,
        }
    }

    /// The sample of a tick: none before a tour has come.
    fn sample(&mut self, probe: usize, tick: u64, controller: &Controller) -> Option<Sample> {
        let mut intent = None;
        if !self.points.is_empty() {
            let t = tick as f64 * self.period_s;
            intent = self.script.along_points(&self.points, t);
        } else if let Some((object, tour)) = controller.tour_of(probe)
            && let Some(frame) = controller.frame_of(object)
        {
            let start = *self.start.get_or_insert(tick);
            let t = (tick - start) as f64 * self.period_s;
            intent = self.script.along_tour(tour, &frame, t);
        }
        if let Some(intent) = intent {
            self.device.intend(intent);
        }
        self.device.read(TickTime::default())
    }
}

/// One direction of the link: messages under way.
struct Line<T> {
    under_way: VecDeque<(u64, T)>,
    random: u64,
}

impl<T: Copy> Line<T> {
    fn new(seed: u64) -> Self {
        Self {
            under_way: VecDeque::new(),
            random: seed,
        }
    }

    /// splitmix64, from 0 to 1.
    fn unit(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.random;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ z >> 31) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Puts a message on its way; a bad link may do something to it.
    fn post(&mut self, tick: u64, message: T, [loss, duplication, overtaking]: [f64; 3]) {
        if self.unit() < loss {
            return;
        }
        let due = tick + DELAY;
        self.under_way.push_back((due, message));
        if self.unit() < duplication {
            self.under_way.push_back((due, message));
        }
        let last = self.under_way.len() - 1;
        if last > 0 && self.unit() < overtaking {
            self.under_way.swap(last, last - 1);
        }
    }

    /// The next message, if it is due.
    fn take(&mut self, tick: u64) -> Option<T> {
        let is_due = self.under_way.front().is_some_and(|(due, _)| *due <= tick);
        is_due
            .then(|| self.under_way.pop_front())?
            .map(|(_, of)| of)
    }
}
