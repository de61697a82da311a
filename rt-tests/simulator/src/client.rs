//! A controller with everything on its side of the link.

use crate::hand::Hand;
use crate::link::{Link, LinkModel, Upward};
use crate::recording::InputRecording;
use crate::samples::{SampleFaults, SampleModel};
use crate::summary::Summary;
use geometry::Wrench;
use haptic_device::{COMMAND_VALIDITY_S, DegreesOfFreedom, Sample, WrenchCommand};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{
    Controller, ControllerOptions, StageObserver, TickInputs, TickOutputs, WrenchLimits,
};
use protocol::{ChunkHeader, ChunkKind};
use realtime::counting_allocator::count;
use scene::{CacheTimetable, ScenePlan, TrajectoryPlan};
use std::sync::Arc;

/// Chunks that the inbox holds; further ones wait on the link. The product's inbox is as large.
pub const INBOX_CHUNKS: usize = 64;

/// Properties of a client beside its scene.
#[derive(Debug, Clone, Copy)]
pub struct ClientOptions {
    /// Its number and incarnation; clients of one station have different numbers.
    pub identity: Identity,
    /// Largest force that its devices render, newtons.
    pub device_max_n: f64,
    /// Length of the tours that it asks the station for, seconds; 0 for none.
    pub tour_s: f64,
    /// Its link.
    pub link: LinkModel,
    /// Whether it is told that the station is on another machine.
    pub station_is_far: bool,
    /// Seed of the link's faults.
    pub link_seed: u64,
}

impl Default for ClientOptions {
    fn default() -> Self {
        Self {
            identity: Identity {
                client: 7,
                incarnation: 8,
            },
            device_max_n: 10.0,
            tour_s: 0.0,
            link: LinkModel::default(),
            station_is_far: false,
            link_seed: 1,
        }
    }
}

/// The source of a tick's samples.
#[derive(Debug, Clone, Copy)]
pub enum Drive<'a> {
    /// Prescribed, one a probe.
    Samples(&'a [Option<Sample>]),
    /// The hands along their paths.
    Hands,
}

/// The controller of a client before its first tick; a recording of the client plays through it.
#[must_use]
pub fn new_controller(plan: &ScenePlan, options: &ClientOptions) -> Controller {
    let of_devices = ControllerOptions {
        limits: &[WrenchLimits::of_force(options.device_max_n)],
        tour_seconds: options.tour_s,
    };
    let mut controller = Controller::new(plan, options.identity, of_devices);
    if options.station_is_far {
        controller.station_is_far();
    }
    for (k, probe) in plan.probes.iter().enumerate() {
        if let Some(rotation) = &probe.device.rotation {
            let rendered = if rotation.is_rendered {
                DegreesOfFreedom::Six
            } else {
                DegreesOfFreedom::Three
            };
            controller.set_rendered(k, rendered);
        }
    }
    controller
}

/// A controller, its inbox, its link, and a hand for each probe.
#[derive(Debug)]
pub struct Client {
    controller: Controller,
    identity: Identity,
    link: Link,
    hands: Vec<Hand>,
    sample_faults: SampleFaults,
    inbox: Vec<InboxChunk>,
    arrived: Vec<ChunkHeader>,
    station: u64,
    samples: Vec<Option<Sample>>,
    outputs: TickOutputs,
    summary: Summary,
    recording: Option<InputRecording>,
    cache_changes: CacheTimetable,
    last_tick: Option<u64>,
    is_stopping: bool,
    /// Whether wrenches are valid for [`COMMAND_VALIDITY_S`] only.
    commands_expire: bool,
    /// Whether zero was written in place of the last wrenches.
    wrote_zero: bool,
    period_s: f64,
    mesh_bytes: u64,
    allocations: u64,
}

impl Client {
    /// A client of a scene that has not ticked yet.
    #[must_use]
    pub fn new(plan: &ScenePlan, options: ClientOptions) -> Self {
        let ClientOptions {
            identity,
            link,
            link_seed,
            ..
        } = options;
        let controller = new_controller(plan, &options);
        let outputs = controller.new_outputs();
        let period_s = 1.0 / plan.loop_.rate_hz;
        let hands = plan.probes.iter().map(|probe| {
            let hand = Hand::new(probe.device, period_s);
            match &probe.trajectory {
                TrajectoryPlan::Points(points) => hand.along_points(points.clone()),
                TrajectoryPlan::Tour { .. } => hand,
            }
        });
        Self {
            controller,
            identity,
            link: Link::new(link, link_seed),
            hands: hands.collect(),
            sample_faults: SampleFaults::new(plan.probes.len()),
            inbox: Vec::with_capacity(INBOX_CHUNKS),
            arrived: Vec::new(),
            station: 0,
            samples: Vec::with_capacity(plan.probes.len()),
            outputs,
            summary: Summary::default(),
            recording: None,
            cache_changes: CacheTimetable::new(Arc::clone(&plan.cache_changes)),
            last_tick: None,
            is_stopping: false,
            commands_expire: false,
            wrote_zero: false,
            period_s,
            mesh_bytes: 0,
            allocations: 0,
        }
    }

    /// Period of its loop, seconds.
    #[must_use]
    pub fn period_s(&self) -> f64 {
        self.period_s
    }

    /// The controller.
    #[must_use]
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The controller, to change its settings.
    pub fn controller_mut(&mut self) -> &mut Controller {
        &mut self.controller
    }

    /// Its number and incarnation.
    #[must_use]
    pub fn identity(&self) -> Identity {
        self.identity
    }

    /// The link.
    pub fn link(&mut self) -> &mut Link {
        &mut self.link
    }

    /// The hand of a probe.
    pub fn hand(&mut self, probe: usize) -> &mut Hand {
        &mut self.hands[probe]
    }

    /// Disturbs the samples of the hands from now on; the seed decides how.
    pub fn disturb_samples(&mut self, model: SampleModel, seed: u64) {
        self.sample_faults.disturb(model, seed);
    }

    /// What was done to the samples of the hands.
    #[must_use]
    pub fn sample_faults(&self) -> &SampleFaults {
        &self.sample_faults
    }

    /// The samples of the last tick.
    #[must_use]
    pub fn samples(&self) -> &[Option<Sample>] {
        &self.samples
    }

    /// The outputs of the last tick.
    #[must_use]
    pub fn outputs(&self) -> &TickOutputs {
        &self.outputs
    }

    /// Counts and extremes of all ticks.
    #[must_use]
    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    /// Bytes of the chunks that have arrived, without those of measured errors.
    #[must_use]
    pub fn mesh_bytes(&self) -> u64 {
        self.mesh_bytes
    }

    /// Allocations and frees within ticks and devices. Counted by
    /// [`realtime::counting_allocator::CountingAllocator`]; 0 with any other allocator.
    #[must_use]
    pub fn allocations(&self) -> u64 {
        self.allocations
    }

    /// Chunks in the inbox.
    #[must_use]
    pub fn inbox_len(&self) -> usize {
        self.inbox.len()
    }

    /// Headers of the chunks that came into the inbox in the last tick, in their order.
    #[must_use]
    pub fn arrived(&self) -> &[ChunkHeader] {
        &self.arrived
    }

    /// Incarnation of the last station that it saw; 0 before the first.
    #[must_use]
    pub fn station(&self) -> u64 {
        self.station
    }

    /// Lets the forces ramp down from the next tick on, or ends that.
    pub fn stop(&mut self, is_stopping: bool) {
        self.is_stopping = is_stopping;
    }

    /// Wrenches expire from now on, as in the product: the devices go to zero in a long stall, and
    /// the tick after it writes zero once more. Before, a wrench acts until the next tick.
    pub fn expire_commands(&mut self) {
        self.commands_expire = true;
    }

    /// Puts a chunk into the inbox, before all others.
    pub fn inject(&mut self, chunk: InboxChunk) {
        if let Some(recording) = &mut self.recording {
            recording.add_chunk_before(self.inbox.len(), chunk);
        }
        self.inbox.insert(0, chunk);
    }

    /// Records every input from now on; to be played back, from before the first tick.
    pub fn record(&mut self) {
        self.recording = Some(InputRecording::default());
    }

    /// Ends the recording and gives it.
    pub fn take_recording(&mut self) -> Option<InputRecording> {
        self.recording.take()
    }

    /// One tick; `station`: the incarnation that the client sees, 0 for none.
    pub(crate) fn tick(
        &mut self,
        tick: u64,
        station: u64,
        drive: Drive<'_>,
        observer: &mut impl StageObserver,
    ) {
        if station != 0 {
            self.station = station;
        }
        self.receive(tick);
        self.sample(tick, drive);
        let validity = (COMMAND_VALIDITY_S / self.period_s).round() as u64;
        let elapsed = self.last_tick.map_or(1, |last| tick - last);
        let has_expired = self.commands_expire && elapsed >= validity;
        let was_cut = has_expired || self.wrote_zero;
        if was_cut {
            self.controller.force_was_cut();
        }
        let cache_limit = self.cache_changes.due(tick as f64 * self.period_s);
        if let Some(bytes) = cache_limit {
            self.controller.set_cache_limit(bytes);
        }
        let inputs = TickInputs {
            tick,
            samples: &self.samples,
            station,
            chunks: [&self.inbox, &[]],
            stopping: self.is_stopping,
        };
        let (controller, outputs) = (&mut self.controller, &mut self.outputs);
        self.allocations += count(|| controller.tick(&inputs, outputs, observer));
        if let Some(recording) = &mut self.recording {
            recording.add_tick(&inputs, (was_cut, cache_limit), outputs.record.replay_hash);
        }
        self.inbox.drain(..self.outputs.chunks_consumed);
        for &request in self.outputs.outbox.requests() {
            self.link.send_up(tick, Upward::Request(request));
        }
        for &report in &self.outputs.reports {
            self.link.send_up(tick, Upward::Report(report));
        }
        self.wrote_zero = has_expired;
        if has_expired {
            self.outputs.wrenches.fill(Wrench::ZERO);
        }
        let valid_until_ns = if self.commands_expire {
            self.ns(tick + validity)
        } else {
            u64::MAX
        };
        for (hand, &wrench) in self.hands.iter_mut().zip(&self.outputs.wrenches) {
            let command = WrenchCommand {
                wrench,
                valid_until_ns,
            };
            self.allocations += count(|| hand.obey(command));
        }
        let first = self.outputs.wrenches.first().copied().unwrap_or_default();
        self.summary.add(&self.outputs.record, first);
        self.last_tick = Some(tick);
    }

    /// Time of a tick, ns.
    fn ns(&self, tick: u64) -> u64 {
        tick * (self.period_s * 1e9) as u64
    }

    /// Moves what is due from the link into the inbox.
    fn receive(&mut self, tick: u64) {
        self.arrived.clear();
        while self.inbox.len() < INBOX_CHUNKS
            && let Some(chunk) = self.link.receive_down(tick)
        {
            if let Some(recording) = &mut self.recording {
                recording.add_chunk(chunk);
            }
            self.arrived.push(chunk.header);
            if chunk.header.kind != ChunkKind::Measured as u32 {
                self.mesh_bytes += size_of::<InboxChunk>() as u64;
            }
            self.inbox.push(chunk);
        }
    }

    /// Fills in the samples of a tick.
    fn sample(&mut self, tick: u64, drive: Drive<'_>) {
        self.samples.clear();
        match drive {
            Drive::Samples(samples) => self.samples.extend_from_slice(samples),
            Drive::Hands => {
                let periods = self.last_tick.map_or(1, |last| tick - last);
                let periods = u32::try_from(periods).unwrap_or(u32::MAX);
                let start_ns = self.ns(tick);
                for (probe, hand) in self.hands.iter_mut().enumerate() {
                    hand.follow(tick, &self.controller, probe);
                    let mut sample = None;
                    self.allocations += count(|| sample = hand.read_at(start_ns, periods));
                    self.samples.push(self.sample_faults.pass(probe, sample));
                }
            }
        }
    }
}
