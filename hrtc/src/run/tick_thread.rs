//! The thread that ticks.
//!
//! A panic in it, of the core or of a driver, ends the run: the devices' last wrenches ramp down to
//! zero in a few periods without the core, then the devices are switched off. Whatever the way out,
//! [`EndMark`] tells the main thread when the devices are off.

mod quiet_panics;

use super::drivers::Drivers;
use super::probe_device::ProbeDevice;
use super::shared::Shared;
use super::watchdog::Lease;
use crate::recorder::OutputTap;
use crate::tick_record::{STAGES, TickRecord};
use crate::time_answers::{NotedAnswers, TimeAnswers};
use crate::tuning::{
    COMMAND_VALIDITY_NS, INBOX_CAPACITY, MIN_PANIC_STEPS, OUT_CAPACITY, PANIC_RAMP_S,
};
use geometry::Wrench;
use haptic_device::{Sample, TickTime, WrenchCommand};
use hrtc_core::governor::MeasuredTick;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Capacity, Controller, Stage, StageObserver, TickInputs, TickOutputs, Timed};
use protocol::{ContactReport, Request};
use quiet_panics::{QuietPanics, message};
use realtime::counting_allocator;
use realtime::pacer::{Pacer, Wake, Worked};
use realtime::rights::{LatencyHold, monotonic_ns, obtain};
use realtime::slow_thread::SlowThread;
use rtrb::{Consumer, Producer};
use scene::{CacheTimetable, LoopPlan, MAX_PROBES};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The tick's ends of the rings.
pub(super) struct TickRings {
    pub requests: Producer<Request>,
    pub contacts: Producer<ContactReport>,
    pub inbox: Consumer<InboxChunk>,
    pub log: Producer<TickRecord>,
    /// `None` without a recording.
    pub recorded: Option<OutputTap>,
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
    /// Changes of the cache's limit.
    pub cache: CacheTimetable,
    /// Length of the run, seconds; without end when absent.
    pub seconds: Option<f64>,
    /// See [`super::RunArgs::slow`].
    pub slow: f64,
}

/// Results of the thread beside its tick records.
#[derive(Default)]
pub(super) struct TickThreadEnd {
    /// `None` after a panic, which may have left it in any state.
    pub controller: Option<Box<Controller>>,
    /// Message of the panic that ended the thread.
    pub panic: Option<String>,
    /// Limit of a tick's work units.
    pub work_budget: u32,
    /// Limit of the work of a tick's queries.
    pub query_budget: u32,
    /// Size and high water of each ring.
    pub rings: Vec<Capacity>,
}

/// Wall time of each stage, and whether the time of the tick is over.
struct StageClock {
    /// See [`super::RunArgs::slow`].
    slow: SlowThread,
    /// End of the last stage on CLOCK_MONOTONIC, ns.
    last: u64,
    /// Wall time of each stage, ns.
    stages: [u32; STAGES.len()],
    /// When the time for each of [`Timed::ALL`] is over, ns.
    ends: [u64; Timed::ALL.len()],
    answers: NotedAnswers,
}

impl StageClock {
    fn start(slow: f64, ends: [u64; Timed::ALL.len()]) -> Self {
        Self {
            ends,
            answers: NotedAnswers::default(),
            slow: SlowThread::begin(slow),
            last: monotonic_ns(),
            stages: [0; STAGES.len()],
        }
    }
}

/// When the time for each kind of work is over in a tick of a period, ns: counted from the period
/// that it is in, behind those that the sleep before it lost. Reading the devices took `read_ns` of
/// it.
fn ends_of(wake: &Wake, period_ns: f64, read_ns: u64) -> [u64; Timed::ALL.len()] {
    let lost = f64::from(wake.misses[1].periods);
    let last = |work: Timed| lost + work.last_begin_after(read_ns as f64 / period_ns);
    Timed::ALL.map(|work| wake.planned_ns + (last(work) * period_ns) as u64)
}

impl StageObserver for StageClock {
    fn ended(&mut self, stage: Stage) {
        #[cfg(test)]
        tests::panic_in_core(stage);
        self.slow.end_part();
        let now = monotonic_ns();
        self.stages[stage as usize] = u32::try_from(now - self.last).unwrap_or(u32::MAX);
        self.last = now;
    }

    fn is_over(&mut self, work: Timed) -> bool {
        let (slow, end) = (&self.slow, self.ends[work as usize]);
        let is_over = || monotonic_ns() + slow.extra_ns() > end;
        self.answers.answer(work, is_over)
    }
}

/// Chunks that have arrived since the start, and those of them that wait.
#[derive(Debug, Default)]
struct Arrivals {
    arrived: u64,
    waiting: usize,
}

/// What lasts from tick to tick beside the core.
struct Lasting {
    outputs: TickOutputs,
    arrivals: Arrivals,
    high_water: HighWater,
    /// Wrenches that the devices render.
    written: [Wrench; MAX_PROBES],
    /// Whether the last wrenches are zero because those before had expired.
    force_cut: bool,
    /// Wall time of handing over the last tick, ns.
    record_ns: u32,
    drivers: Drivers,
    /// What the last tick took; `None` before the first.
    measured: Option<MeasuredTick>,
    /// Stamp of the faults that the main thread was told last.
    faults_told: u64,
}

/// Tells the main thread that the tick thread has ended, by being dropped, also by a panic.
struct EndMark(Arc<Shared>);

impl Drop for EndMark {
    fn drop(&mut self) {
        self.0.ended.store(true, Ordering::Release);
    }
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
    rises_again: bool,
    measured: Option<MeasuredTick>,
    time: TimeAnswers,
    cache_limit: Option<u64>,
}

/// Takes the lease for the wrenches that are about to be written. Time until which they are valid,
/// ns; `None` when the last ones have expired.
fn extend(lease: &Lease) -> Option<u64> {
    let now = monotonic_ns();
    let until = now + COMMAND_VALIDITY_NS;
    lease.extend(now, until).then_some(until)
}

impl TickThread {
    /// Takes the rights, with them all memory that a tick uses, and ticks once it may, until the
    /// force has ramped down after a request to stop, or until a panic.
    pub fn run(self, may_begin: impl FnOnce() -> bool) -> TickThreadEnd {
        // Dropped last, when the devices have been.
        let _mark = EndMark(Arc::clone(&self.shared));
        let _quiet = QuietPanics::begin();
        let mut thread = self;
        let mut lasting = Lasting {
            outputs: thread.controller.new_outputs(),
            arrivals: Arrivals::default(),
            high_water: HighWater::default(),
            written: [Wrench::ZERO; MAX_PROBES],
            force_cut: false,
            record_ns: 0,
            drivers: Drivers::new(thread.plan.rate_hz),
            measured: None,
            faults_told: 0,
        };
        let _latency = thread.obtain_rights();
        if !may_begin() {
            return thread.end(&lasting.high_water, None);
        }
        let mut pacer = Pacer::new(thread.plan.rate_hz, thread.plan.spin_us);
        thread.shared.ticking.store(true, Ordering::Release);
        let ticking = AssertUnwindSafe(|| thread.tick_until_stopped(&mut pacer, &mut lasting));
        let panic = catch_unwind(ticking).err().map(message);
        if panic.is_some() {
            counting_allocator::arm(false);
            thread.ramp_down(&mut pacer, &lasting.written);
        } else if lasting.written.iter().all(|of| *of == Wrench::ZERO) {
            // No force is left to guard, however long the devices take to switch off.
            thread.shared.lease.release();
        }
        for device in &mut thread.devices {
            survives(|| device.device.safe_off());
        }
        thread.shared.lease.release();
        thread.end(&lasting.high_water, panic)
    }

    fn tick_until_stopped(&mut self, pacer: &mut Pacer, lasting: &mut Lasting) {
        let ticks = |seconds: f64| (seconds * self.plan.rate_hz).ceil() as u64;
        let last_tick = self.seconds.map(ticks);
        while !self.shared.off.load(Ordering::Acquire) {
            let wake = pacer.wait();
            self.shared.note_first(&wake, self.plan.rate_hz);
            let stopping = self.shared.stop.load(Ordering::Relaxed)
                || last_tick.is_some_and(|last| wake.tick >= last);
            let ticked = self.tick(&wake, stopping, lasting);
            // A part of the tick, so that its time is seen: it looks at every object.
            self.report_faults(lasting);
            let worked = pacer.done();
            self.hand_over(&wake, &worked, &ticked, lasting);
            lasting.measured = Some(lasting.drivers.beside(&worked, lasting.record_ns));
            if stopping && self.controller.is_at_rest() {
                break;
            }
        }
    }

    /// Brings the devices from their last wrenches to zero in equal steps, one a period, without
    /// the core. Ends early when those wrenches have expired: the devices are at zero then.
    fn ramp_down(&mut self, pacer: &mut Pacer, from: &[Wrench; MAX_PROBES]) {
        let mut answers = [true; MAX_PROBES];
        let steps = panic_steps(&self.plan);
        for left in (0..steps).rev() {
            let share = f64::from(left) / f64::from(steps);
            let Some(valid_until_ns) = extend(&self.shared.lease) else {
                return;
            };
            let devices = self.devices.iter_mut().zip(from).zip(&mut answers);
            for ((device, &wrench), answers) in devices.filter(|(_, answers)| **answers) {
                if self.shared.lease.has_run_out(monotonic_ns()) {
                    return;
                }
                let command = WrenchCommand {
                    wrench: wrench * share,
                    valid_until_ns,
                };
                *answers = survives(|| device.device.write(command));
                if !*answers {
                    survives(|| device.device.safe_off());
                }
            }
            pacer.wait();
        }
    }

    /// Asks for the real-time rights; deep sleep is kept away as long as the result lives.
    fn obtain_rights(&self) -> Option<LatencyHold> {
        let obtained = obtain(self.plan.core, self.plan.priority);
        self.shared.refused(obtained.missing);
        obtained.latency
    }

    /// Samples, computes, renders and sends: the part of the period that allocates nothing.
    fn tick(&mut self, wake: &Wake, stopping: bool, lasting: &mut Lasting) -> Ticked {
        let calls = counting_allocator::calls();
        counting_allocator::arm(true);
        // Zero was written last, or what was written has expired: the devices are at zero.
        let has_expired = self.shared.lease.has_run_out(wake.start_ns);
        let rises_again = lasting.force_cut || has_expired;
        if rises_again {
            self.controller.force_was_cut();
        }
        let measured = lasting.measured;
        if let Some(measured) = measured {
            self.controller.note_work(measured);
        }
        let t_s = wake.tick as f64 / self.plan.rate_hz;
        let cache_limit = self.cache.due(t_s);
        if let Some(bytes) = cache_limit {
            self.controller.set_cache_limit(bytes);
        }
        let Lasting {
            outputs,
            arrivals,
            high_water,
            drivers,
            ..
        } = &mut *lasting;
        drivers.begin_tick();
        let samples = drivers.time(|| self.sample(wake));
        let station = self.shared.station.load(Ordering::Relaxed);
        let slots = self.rings.inbox.slots();
        arrivals.arrived += (slots - arrivals.waiting) as u64;
        high_water.inbox = slots.max(high_water.inbox);
        let ends = ends_of(wake, 1e9 / self.plan.rate_hz, drivers.taken_ns());
        let mut clock = StageClock::start(self.slow, ends);
        let inputs = TickInputs {
            tick: wake.tick,
            samples: &samples[..self.devices.len()],
            station,
            chunks: [&[], &[]],
            stopping,
        };
        let consumed = self.compute(inputs, slots, outputs, &mut clock);
        // `as` saturates: a negative one, which means none, is 0.
        let round_trip_us = (1e6 * outputs.record.round_trip_s) as u32;
        let told = &self.shared.round_trip_us;
        told.store(round_trip_us, Ordering::Relaxed);
        arrivals.waiting = slots - consumed;
        self.send(outputs);
        let mut drivers = lasting.drivers;
        drivers.time(|| self.render(lasting));
        lasting.drivers = drivers;
        let high_water = &mut lasting.high_water;
        high_water.requests = (OUT_CAPACITY - self.rings.requests.slots()).max(high_water.requests);
        counting_allocator::arm(false);
        Ticked {
            station,
            stages: clock.stages,
            time: clock.answers.all(),
            allocations: (counting_allocator::calls() - calls) as u32,
            samples,
            wrenches: lasting.written,
            rises_again,
            measured,
            cache_limit: cache_limit.map(|bytes| bytes as u64),
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

    /// Sends each device its wrench; zero when the wrench before has expired, since the device is
    /// at zero then. The force rises from there in the next tick. Where a device took so long to
    /// take its wrench that those before expired, all go to zero.
    fn render(&mut self, lasting: &mut Lasting) {
        let lease = extend(&self.shared.lease);
        let mut is_cut = lease.is_none();
        let devices = self.devices.iter_mut().zip(&lasting.outputs.wrenches);
        for ((device, &wanted), written) in devices.zip(&mut lasting.written) {
            is_cut |= self.shared.lease.has_run_out(monotonic_ns());
            *written = if is_cut { Wrench::ZERO } else { wanted };
            device.device.write(WrenchCommand {
                wrench: *written,
                // A zero wrench does not expire.
                valid_until_ns: lease.filter(|_| !is_cut).unwrap_or(u64::MAX),
            });
        }
        if self.shared.lease.has_run_out(monotonic_ns()) {
            is_cut = true;
            // For the zeros, so that the next tick finds no other end of a force.
            let _ = extend(&self.shared.lease);
        }
        if is_cut {
            self.shared.force_cuts.fetch_add(1, Ordering::Relaxed);
            // What was written before, or came late.
            let devices = self.devices.iter_mut().zip(&mut lasting.written);
            for (device, written) in devices.filter(|(_, written)| **written != Wrench::ZERO) {
                device.device.safe_off();
                *written = Wrench::ZERO;
            }
        }
        lasting.force_cut = is_cut;
    }

    /// Hands requests and contacts to the link. A full ring loses a request; the gap in the request
    /// numbers ends the epoch, and the next epoch asks again.
    fn send(&mut self, outputs: &TickOutputs) {
        for request in outputs.outbox.requests() {
            if self.rings.requests.push(*request).is_err() {
                self.shared.requests_lost.fetch_add(1, Ordering::Relaxed);
            }
        }
        for &report in &outputs.reports {
            if self.rings.contacts.push(report).is_err() {
                self.shared.contacts_lost.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    /// Hands a tick to log and recorder, and notes for the next one how long that took.
    fn hand_over(&mut self, wake: &Wake, worked: &Worked, ticked: &Ticked, lasting: &mut Lasting) {
        counting_allocator::arm(true);
        let before = monotonic_ns();
        if let Some(recorded) = &mut self.rings.recorded {
            recorded.push(wake.tick, &lasting.outputs);
        }
        let record = record(wake, worked, ticked, lasting);
        if self.rings.log.push(record).is_err() {
            self.shared.log_dropped.fetch_add(1, Ordering::Relaxed);
        }
        lasting.record_ns = u32::try_from(monotonic_ns() - before).unwrap_or(u32::MAX);
        counting_allocator::arm(false);
        let log = &self.rings.log;
        let used = log.buffer().capacity() - log.slots();
        lasting.high_water.log = used.max(lasting.high_water.log);
    }

    /// Tells the main thread of faults when they have changed. Nothing waits for a lock: where one
    /// is taken, they are told in the next tick.
    fn report_faults(&self, lasting: &mut Lasting) {
        let stamp = self.controller.faults_stamp();
        if stamp == lasting.faults_told {
            return;
        }
        let (Ok(mut told), Ok(mut fault)) = (
            self.shared.object_faults.try_lock(),
            self.shared.fault.try_lock(),
        ) else {
            return;
        };
        lasting.faults_told = stamp;
        if !self.controller.has_faults() {
            return;
        }
        let room = told.capacity();
        told.clear();
        told.extend(self.controller.faults().take(room));
        if let Some(found) = self.controller.fault() {
            *fault = Some(found);
        }
    }

    fn end(self, high_water: &HighWater, panic: Option<String>) -> TickThreadEnd {
        let log_room = self.rings.log.buffer().capacity();
        TickThreadEnd {
            work_budget: self.controller.work_budget(),
            query_budget: self.controller.query_budget(),
            controller: panic.is_none().then_some(self.controller),
            panic,
            rings: vec![
                Capacity::new("chunks in the inbox", INBOX_CAPACITY, high_water.inbox),
                Capacity::new("requests to the link", OUT_CAPACITY, high_water.requests),
                Capacity::new("tick records for the log", log_room, high_water.log),
            ],
        }
    }
}

impl TickThreadEnd {
    /// The end of a thread that panicked outside its loop.
    pub fn lost(payload: Box<dyn Any + Send>) -> Self {
        Self {
            panic: Some(message(payload)),
            ..Self::default()
        }
    }
}

/// Periods of the ramp after a panic.
fn panic_steps(plan: &LoopPlan) -> u32 {
    let periods = (PANIC_RAMP_S * plan.rate_hz).round() as u32;
    periods.max(MIN_PANIC_STEPS)
}

/// Whether some work ended without a panic.
fn survives(work: impl FnOnce()) -> bool {
    catch_unwind(AssertUnwindSafe(work)).is_ok()
}

/// The log's record of a tick.
fn record(wake: &Wake, worked: &Worked, ticked: &Ticked, lasting: &Lasting) -> TickRecord {
    let outputs = &lasting.outputs;
    TickRecord {
        tick: wake.tick,
        planned_ns: wake.planned_ns,
        start_ns: wake.start_ns,
        skipped: wake.skipped,
        misses: wake.misses,
        wake_ns: wake.wake_ns,
        period_ns: wake.period_ns,
        spun_ns: wake.spun_ns,
        extra_switches: wake.extra_switches,
        work_cpu_ns: worked.cpu_ns,
        work_wall_ns: worked.wall_ns,
        stage_ns: ticked.stages,
        record_ns: lasting.record_ns,
        page_faults: worked.page_faults,
        allocations: ticked.allocations,
        chunks_arrived: lasting.arrivals.arrived,
        station: ticked.station,
        samples: ticked.samples,
        force_cut: lasting.force_cut,
        rises_again: ticked.rises_again,
        measured: ticked.measured,
        time: ticked.time,
        cache_limit: ticked.cache_limit,
        wrenches: ticked.wrenches,
        contacts: std::array::from_fn(|k| outputs.contacts.get(k).copied().flatten()),
        chunks_consumed: outputs.chunks_consumed as u32,
        requests: outputs.outbox.requests().len() as u32,
        reports: outputs.reports.len() as u32,
        core: outputs.record,
    }
}

#[cfg(test)]
mod tests;
