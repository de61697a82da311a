//! The thread that ticks.

use super::probe_device::ProbeDevice;
use super::shared::Shared;
use crate::tick_record::{STAGES, TickRecord};
use crate::tuning::{COMMAND_VALIDITY_NS, INBOX_CAPACITY, LOG_CAPACITY, OUT_CAPACITY};
use geometry::Wrench;
use haptic_device::{Sample, TickTime, WrenchCommand};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Capacity, Controller, Stage, StageObserver, TickInputs, TickOutputs};
use protocol::{ContactReport, Request};
use realtime::counting_allocator;
use realtime::pacer::{Pacer, Wake, Worked};
use realtime::rights::{LatencyHold, monotonic_ns, obtain};
use rtrb::{Consumer, Producer};
use scene::{LoopPlan, MAX_PROBES};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The tick's ends of the rings.
pub(super) struct TickRings {
    pub requests: Producer<Request>,
    pub contacts: Producer<ContactReport>,
    pub inbox: Consumer<InboxChunk>,
    pub log: Producer<TickRecord>,
}

/// Largest number of entries in each ring.
#[derive(Debug, Default)]
struct HighWater {
    inbox: usize,
    requests: usize,
    log: usize,
}

/// Everything that the thread owns.
pub(super) struct TickThread {
    /// Boxed: too large for a move over a small stack.
    pub controller: Box<Controller>,
    /// One a probe.
    pub devices: Vec<ProbeDevice>,
    pub rings: TickRings,
    pub shared: Arc<Shared>,
    pub plan: LoopPlan,
    /// Length of the run, seconds; without end when absent.
    pub seconds: Option<f64>,
}

/// Results of the thread beside its tick records.
pub(super) struct TickThreadEnd {
    pub controller: Box<Controller>,
    /// Limit of a tick's work units.
    pub work_budget: u32,
    /// Size and high water of each ring.
    pub rings: Vec<Capacity>,
}

/// Wall time of each stage.
struct StageClock {
    /// End of the last stage on CLOCK_MONOTONIC, ns.
    last: u64,
    /// Wall time of each stage, ns.
    stages: [u32; STAGES.len()],
}

impl StageClock {
    fn start() -> Self {
        Self {
            last: monotonic_ns(),
            stages: [0; STAGES.len()],
        }
    }
}

impl StageObserver for StageClock {
    fn ended(&mut self, stage: Stage) {
        let now = monotonic_ns();
        self.stages[stage as usize] = u32::try_from(now - self.last).unwrap_or(u32::MAX);
        self.last = now;
    }
}

/// Chunks that have arrived since the start, and those of them that wait.
#[derive(Debug, Default)]
struct Arrivals {
    arrived: u64,
    waiting: usize,
}

/// Results of one tick without its timing.
struct Ticked {
    /// Incarnation of the station; 0 for none.
    station: u64,
    /// Wall time of each stage, ns.
    stages: [u32; STAGES.len()],
    allocations: u32,
    samples: [Option<Sample>; MAX_PROBES],
    wrenches: [Wrench; MAX_PROBES],
}

impl TickThread {
    /// Ticks until the force has ramped down after a request to stop.
    pub fn run(mut self) -> TickThreadEnd {
        let _latency = self.obtain_rights();
        let last_tick = self
            .seconds
            .map(|seconds| (seconds * self.plan.rate_hz).ceil() as u64);
        let mut outputs = TickOutputs::new(self.devices.len());
        let mut pacer = Pacer::new(self.plan.rate_hz, self.plan.spin_us);
        let mut arrivals = Arrivals::default();
        let mut high_water = HighWater::default();
        self.shared.ticking.store(true, Ordering::Release);
        loop {
            let wake = pacer.wait();
            if wake.tick == 0 || self.shared.first_tick_ns.load(Ordering::Relaxed) == 0 {
                let first = &self.shared.first_tick_ns;
                first.store(wake.start_ns, Ordering::Relaxed);
            }
            let stopping = self.shared.stop.load(Ordering::Relaxed)
                || last_tick.is_some_and(|last| wake.tick >= last);
            let ticked = self.tick(
                &wake,
                stopping,
                &mut outputs,
                &mut arrivals,
                &mut high_water,
            );
            let worked = pacer.done();
            let record = record(&wake, &worked, &ticked, &outputs, arrivals.arrived);
            if self.rings.log.push(record).is_err() {
                self.shared.log_dropped.fetch_add(1, Ordering::Relaxed);
            }
            high_water.log = (LOG_CAPACITY - self.rings.log.slots()).max(high_water.log);
            self.report_faults();
            if stopping && self.controller.is_at_rest() {
                break;
            }
        }
        self.end(&high_water)
    }

    /// Asks for the real-time rights; deep sleep is kept away as long as the result lives.
    fn obtain_rights(&self) -> Option<LatencyHold> {
        let obtained = obtain(self.plan.core, self.plan.priority);
        if let Ok(mut missing) = self.shared.missing.lock() {
            *missing = obtained.missing;
        }
        obtained.latency
    }

    /// Samples, computes, renders and sends: the part of the period that allocates nothing.
    fn tick(
        &mut self,
        wake: &Wake,
        stopping: bool,
        outputs: &mut TickOutputs,
        arrivals: &mut Arrivals,
        high_water: &mut HighWater,
    ) -> Ticked {
        let calls = counting_allocator::calls();
        counting_allocator::arm(true);
        let samples = self.sample(wake);
        let station = self.shared.station.load(Ordering::Relaxed);
        let slots = self.rings.inbox.slots();
        arrivals.arrived += (slots - arrivals.waiting) as u64;
        high_water.inbox = slots.max(high_water.inbox);
        let mut clock = StageClock::start();
        let inputs = TickInputs {
            tick: wake.tick,
            samples: &samples[..self.devices.len()],
            station,
            chunks: [&[], &[]],
            stopping,
        };
        let consumed = self.compute(inputs, slots, outputs, &mut clock);
        arrivals.waiting = slots - consumed;
        let wrenches = self.render(wake, outputs);
        self.send(outputs);
        high_water.requests = (OUT_CAPACITY - self.rings.requests.slots()).max(high_water.requests);
        counting_allocator::arm(false);
        Ticked {
            station,
            stages: clock.stages,
            allocations: (counting_allocator::calls() - calls) as u32,
            samples,
            wrenches,
        }
    }

    /// One sample a probe.
    fn sample(&mut self, wake: &Wake) -> [Option<Sample>; MAX_PROBES] {
        let time = TickTime {
            start_ns: wake.start_ns,
            periods: 1 + wake.skipped,
        };
        let mut samples = [None; MAX_PROBES];
        for (k, (device, sample)) in self.devices.iter_mut().zip(&mut samples).enumerate() {
            *sample = device.sample(k, &self.controller, wake.tick, self.plan.rate_hz, time);
        }
        samples
    }

    /// Runs the core over the inputs and the first `slots` chunks of the inbox; the number
    /// consumed.
    fn compute(
        &mut self,
        inputs: TickInputs<'_>,
        slots: usize,
        outputs: &mut TickOutputs,
        clock: &mut StageClock,
    ) -> usize {
        let chunks = self.rings.inbox.read_chunk(slots);
        let halves = match &chunks {
            Ok(chunks) => {
                let (first, second) = chunks.as_slices();
                [first, second]
            }
            Err(_) => [&[][..], &[][..]],
        };
        let inputs = TickInputs {
            chunks: halves,
            ..inputs
        };
        self.controller.tick(&inputs, outputs, clock);
        if let Ok(chunks) = chunks {
            chunks.commit(outputs.chunks_consumed);
        }
        outputs.chunks_consumed
    }

    /// Sends each device its wrench.
    fn render(&mut self, wake: &Wake, outputs: &TickOutputs) -> [Wrench; MAX_PROBES] {
        let mut wrenches = [Wrench::ZERO; MAX_PROBES];
        for ((device, &wanted), wrench) in self
            .devices
            .iter_mut()
            .zip(&outputs.wrenches)
            .zip(&mut wrenches)
        {
            *wrench = wanted;
            device.device.write(WrenchCommand {
                wrench: wanted,
                valid_until_ns: wake.start_ns + COMMAND_VALIDITY_NS,
            });
        }
        wrenches
    }

    /// Hands requests and contacts to the link. A full ring loses a request; the gap in the request
    /// numbers ends the epoch, and the next epoch asks again.
    fn send(&mut self, outputs: &TickOutputs) {
        for request in outputs.outbox.requests() {
            let _ = self.rings.requests.push(*request);
        }
        for &report in &outputs.reports {
            let _ = self.rings.contacts.push(report);
        }
    }

    /// Tells the main thread of faults. Nothing waits for a lock.
    fn report_faults(&self) {
        if !self.controller.has_faults() {
            return;
        }
        if let Ok(mut told) = self.shared.object_faults.try_lock() {
            let room = told.capacity();
            told.clear();
            told.extend(self.controller.faults().take(room));
        }
        if let Some(found) = self.controller.fault()
            && let Ok(mut fault) = self.shared.fault.try_lock()
        {
            *fault = Some(found);
        }
    }

    fn end(mut self, high_water: &HighWater) -> TickThreadEnd {
        for device in &mut self.devices {
            device.device.safe_off();
        }
        self.shared.ended.store(true, Ordering::Release);
        TickThreadEnd {
            work_budget: self.controller.work_budget(),
            controller: self.controller,
            rings: vec![
                Capacity::new("chunks in the inbox", INBOX_CAPACITY, high_water.inbox),
                Capacity::new("requests to the link", OUT_CAPACITY, high_water.requests),
                Capacity::new("tick records for the log", LOG_CAPACITY, high_water.log),
            ],
        }
    }
}

/// The log's record of a tick.
fn record(
    wake: &Wake,
    worked: &Worked,
    ticked: &Ticked,
    outputs: &TickOutputs,
    chunks_arrived: u64,
) -> TickRecord {
    TickRecord {
        tick: wake.tick,
        skipped: wake.skipped,
        miss: wake.miss,
        wake_ns: wake.wake_ns,
        period_ns: wake.period_ns,
        work_cpu_ns: worked.cpu_ns,
        work_wall_ns: worked.wall_ns,
        stage_ns: ticked.stages,
        page_faults: worked.page_faults,
        allocations: ticked.allocations,
        chunks_arrived,
        station: ticked.station,
        samples: ticked
            .samples
            .map(|sample| sample.map(|sample| sample.pose)),
        wrenches: ticked.wrenches,
        core: outputs.record,
    }
}
