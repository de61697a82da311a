//! The thread that ticks.

use super::{LOG, OUT, Signals};
use crate::connection::INBOX;
use crate::tick_record::{STAGES, TickRecord};
use geometry::{Pose, Wrench};
use haptic_device::{Device, Sample, Simulated};
use hrtc_core::script::Script;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Capacity, Controller, Fault, Stage, StageObserver, TickInputs, TickOutputs};
use protocol::{ContactReport, Request};
use realtime::counting_allocator;
use realtime::pacer::Pacer;
use realtime::rights::{MissingRight, monotonic_ns, obtain};
use rtrb::{Consumer, Producer};
use scene::{LoopPlan, MAX_PROBES, ProbePlan, TrajectoryPlan};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Everything that the thread owns.
pub(super) struct TickThread {
    /// Boxed: it is too large to be moved about on a small stack.
    pub controller: Box<Controller>,
    /// One for each probe.
    pub hands: Vec<Hand>,
    pub requests: Producer<Request>,
    pub contacts: Producer<ContactReport>,
    pub inbox: Consumer<InboxChunk>,
    pub log: Producer<TickRecord>,
    pub station: Arc<AtomicU64>,
    pub signals: Arc<Signals>,
    pub fault: Arc<Mutex<Option<Fault>>>,
    pub missing: Arc<Mutex<Vec<MissingRight>>>,
    pub plan: LoopPlan,
    pub seconds: Option<f64>,
}

/// What is left of the thread.
pub(super) struct Ended {
    pub controller: Box<Controller>,
    /// Most work units of a tick that its rules allow.
    pub work_budget: u32,
    /// The most that were in the rings at once.
    pub rings: Vec<Capacity>,
}

/// Wall time of each stage.
struct StageClock {
    last: u64,
    stages: [u32; STAGES.len()],
}

impl StageObserver for StageClock {
    fn ended(&mut self, stage: Stage) {
        let now = monotonic_ns();
        self.stages[stage as usize] = u32::try_from(now - self.last).unwrap_or(u32::MAX);
        self.last = now;
    }
}

impl TickThread {
    /// Ticks until the force is down after the wish to stop; gives the controller back.
    pub fn run(mut self) -> Ended {
        let obtained = obtain(self.plan.core, self.plan.priority);
        if let Ok(mut missing) = self.missing.lock() {
            *missing = obtained.missing;
        }
        let _latency = obtained.latency;
        let last_tick = self
            .seconds
            .map(|seconds| (seconds * self.plan.rate_hz).ceil() as u64);
        let mut outputs = TickOutputs::new(self.hands.len());
        let mut pacer = Pacer::new(self.plan.rate_hz, self.plan.spin_us);
        let mut arrived = 0u64;
        let mut waiting = 0usize;
        let (mut inbox, mut requests, mut log) = (0, 0, 0);
        self.signals.ticking.store(true, Ordering::Release);
        loop {
            let wake = pacer.wait();
            if wake.tick == 0 || self.signals.first_tick_ns.load(Ordering::Relaxed) == 0 {
                self.signals
                    .first_tick_ns
                    .store(monotonic_ns(), Ordering::Relaxed);
            }
            let stopping = self.signals.stop.load(Ordering::Relaxed)
                || last_tick.is_some_and(|last| wake.tick >= last);
            let calls = counting_allocator::calls();
            counting_allocator::arm(true);
            let mut samples = [None; MAX_PROBES];
            for (k, (hand, sample)) in self.hands.iter_mut().zip(&mut samples).enumerate() {
                hand.intend(k, &self.controller, wake.tick, self.plan.rate_hz);
                *sample = hand.device.read(1 + wake.skipped);
            }
            let station = self.station.load(Ordering::Relaxed);
            let slots = self.inbox.slots();
            arrived += (slots - waiting) as u64;
            inbox = slots.max(inbox);
            let mut clock = StageClock {
                last: monotonic_ns(),
                stages: [0; STAGES.len()],
            };
            let consumed = {
                let chunks = self.inbox.read_chunk(slots);
                let halves = match &chunks {
                    Ok(chunks) => {
                        let (first, second) = chunks.as_slices();
                        [first, second]
                    }
                    Err(_) => [&[][..], &[][..]],
                };
                let inputs = TickInputs {
                    tick: wake.tick,
                    samples: &samples[..self.hands.len()],
                    station,
                    chunks: halves,
                    stopping,
                };
                self.controller.tick(&inputs, &mut outputs, &mut clock);
                if let Ok(chunks) = chunks {
                    chunks.commit(outputs.chunks_consumed);
                }
                outputs.chunks_consumed
            };
            waiting = slots - consumed;
            let mut wrenches = [Wrench::ZERO; MAX_PROBES];
            for ((hand, &felt), wrench) in self
                .hands
                .iter_mut()
                .zip(&outputs.wrenches)
                .zip(&mut wrenches)
            {
                *wrench = felt;
                hand.device.write(felt);
            }
            for request in outputs.outbox.requests() {
                // A full ring loses the request; the gap in its numbers ends the epoch, which heals it.
                let _ = self.requests.push(*request);
            }
            requests = (OUT - self.requests.slots()).max(requests);
            for &report in &outputs.reports {
                let _ = self.contacts.push(report);
            }
            counting_allocator::arm(false);
            let worked = pacer.done();
            let record = TickRecord {
                tick: wake.tick,
                skipped: wake.skipped,
                miss: wake.miss,
                wake_ns: wake.wake_ns,
                period_ns: wake.period_ns,
                work_cpu_ns: worked.cpu_ns,
                work_wall_ns: worked.wall_ns,
                stage_ns: clock.stages,
                page_faults: worked.page_faults,
                allocations: (counting_allocator::calls() - calls) as u32,
                chunks_arrived: arrived,
                station,
                samples: samples.map(|sample| sample.map(|sample: Sample| sample.pose)),
                wrenches,
                core: outputs.record,
            };
            if self.log.push(record).is_err() {
                self.signals.log_dropped.fetch_add(1, Ordering::Relaxed);
            }
            log = (LOG - self.log.slots()).max(log);
            if let Some(found) = self.controller.fault() {
                // Not in touch any more, so the lock costs no force.
                if let Ok(mut fault) = self.fault.try_lock() {
                    *fault = Some(found);
                }
            }
            if stopping && self.controller.is_at_rest() {
                break;
            }
        }
        for hand in &mut self.hands {
            hand.device.write(Wrench::ZERO);
        }
        self.signals.ended.store(true, Ordering::Release);
        Ended {
            work_budget: self.controller.work_budget(),
            controller: self.controller,
            rings: vec![
                Capacity::new("chunks in the inbox", INBOX, inbox),
                Capacity::new("requests to the link", OUT, requests),
                Capacity::new("tick records for the log", LOG, log),
            ],
        }
    }
}

/// A probe's device, and what leads it.
pub(super) struct Hand {
    pub device: Simulated,
    script: Script,
    /// The scene's points; none for a tour.
    points: Vec<(f64, Pose)>,
    /// The tick in which the script began.
    start: Option<u64>,
}

impl Hand {
    /// At rest before its first point.
    pub fn new(probe: &ProbePlan, period_s: f64) -> Self {
        Self {
            device: Simulated::new(probe.device, period_s),
            script: Script::default(),
            points: match &probe.trajectory {
                TrajectoryPlan::Points(points) => points.clone(),
                TrajectoryPlan::Tour { .. } => Vec::new(),
            },
            start: None,
        }
    }

    /// Tells the simulated hand of a probe what to intend, from the scene's points or the station's tour.
    fn intend(&mut self, probe: usize, controller: &Controller, tick: u64, rate_hz: f64) {
        let t = |start: u64| (tick - start) as f64 / rate_hz;
        let intent = if self.points.is_empty() {
            let Some((object, tour)) = controller.tour_of(probe) else {
                return;
            };
            let Some(frame) = controller.frame_of(object) else {
                return;
            };
            let from = *self.start.get_or_insert(tick);
            let intent = self.script.along_tour(tour, &frame, t(from));
            intent.map(|mut intent| {
                // The hand goes with an object that moves, to where it is by the end of the coming period.
                let carried = controller.carried(object, intent.pose.position);
                intent.pose.position += carried.linear;
                intent.velocity += carried.linear * rate_hz;
                intent
            })
        } else {
            let from = *self.start.get_or_insert(tick);
            self.script.along_points(&self.points, t(from))
        };
        if let Some(intent) = intent {
            self.device.intend(intent);
        }
    }
}
