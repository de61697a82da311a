//! Ways out of the tick thread, on the thread of the test.

use super::*;
use crate::run::watchdog::Watchdog;
use crate::setup::ControllerSetup;
use crate::tuning::LOG_CAPACITY;
use geometry::Pose;
use haptic_device::{Capabilities, Device, GuardedDevice, SafeStop};
use hrtc_core::streaming::subscriber::Identity;
use realtime::pacer::Miss;
use rtrb::RingBuffer;
use scene::{NoFiles, Overrides, parse};
use std::cell::Cell;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

thread_local! {
    /// Ticks of this thread until its core panics in the middle of one; never at 0.
    static PANICS_IN: Cell<u32> = const { Cell::new(0) };
}

/// Called by the stage clock within the core.
pub(super) fn panic_in_core(stage: Stage) {
    let left = PANICS_IN.get();
    if stage == Stage::Query && left > 0 {
        PANICS_IN.set(left - 1);
        assert!(left > 1, "made on purpose in the core");
    }
}

/// What the device was told, in order: the size of each force, then the offs.
#[derive(Default)]
struct Told {
    forces: Vec<f64>,
    offs: usize,
    ended_before_off: bool,
    /// Whether the watchdog saw a force expire while it was being switched off.
    expired_in_off: bool,
}

struct Panics {
    read_in: u32,
    write_in: u32,
    off_takes: Duration,
    told: Arc<Mutex<Told>>,
    shared: Arc<Shared>,
}

impl Device for Panics {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("panics", 5.0)
    }
    fn read(&mut self, _time: TickTime) -> Option<Sample> {
        self.read_in = self.read_in.wrapping_sub(1);
        assert!(self.read_in != 0, "made on purpose in read");
        Some(Sample::at(Pose::IDENTITY))
    }
    fn write(&mut self, command: WrenchCommand) {
        self.write_in = self.write_in.wrapping_sub(1);
        assert!(self.write_in != 0, "made on purpose in write");
        let force = command.wrench.force.length();
        self.told.lock().unwrap().forces.push(force);
    }
    fn safe_off(&mut self) {
        let expiries = || self.shared.expiries.load(Ordering::Relaxed);
        let before = expiries();
        std::thread::sleep(self.off_takes);
        let mut told = self.told.lock().unwrap();
        told.expired_in_off |= expiries() != before;
        told.offs += 1;
        told.ended_before_off |= self.shared.ended.load(Ordering::Relaxed);
    }
}

/// A thread that ticks without a station, and what its device is told.
fn thread(read_in: u32, write_in: u32) -> (TickThread, Arc<Mutex<Told>>) {
    thread_with(read_in, write_in, Duration::ZERO)
}

/// The same with a device that takes so long to switch off.
fn thread_with(read_in: u32, write_in: u32, off_takes: Duration) -> (TickThread, Arc<Mutex<Told>>) {
    let text = "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[loop]\ncore = -1\npriority = 1\n[[probe]]\n";
    let overrides = Overrides::default();
    let mut plan = parse(text, "ends", Path::new(""), &overrides, &NoFiles).unwrap();
    let shared = Arc::new(Shared::default());
    let told = Arc::new(Mutex::new(Told::default()));
    let device = GuardedDevice::new(Box::new(Panics {
        read_in,
        write_in,
        off_takes,
        told: Arc::clone(&told),
        shared: Arc::clone(&shared),
    }));
    let identity = Identity {
        client: 1,
        incarnation: 1,
    };
    let setup = ControllerSetup::new(identity, [device.capabilities()].into_iter(), 1.0);
    let controller = Box::new(setup.controller(&mut plan));
    let device = ProbeDevice::new(device, &plan.probes[0]);
    let rings = TickRings {
        requests: RingBuffer::new(OUT_CAPACITY).0,
        contacts: RingBuffer::new(OUT_CAPACITY).0,
        inbox: RingBuffer::new(INBOX_CAPACITY).1,
        log: RingBuffer::new(LOG_CAPACITY).0,
        recorded: None,
    };
    let thread = TickThread {
        controller,
        devices: vec![device],
        rings,
        shared,
        plan: plan.loop_,
        cache: CacheTimetable::new(Arc::clone(&plan.cache_changes)),
        seconds: Some(1.0),
        slow: 1.0,
    };
    (thread, told)
}

/// Runs until a panic; its message, and what the device was told.
fn panicked(read_in: u32, write_in: u32) -> (String, Arc<Mutex<Told>>) {
    let (thread, told) = thread(read_in, write_in);
    let shared = Arc::clone(&thread.shared);
    let end = thread.run(|| true);
    assert!(shared.ended.load(Ordering::Relaxed));
    assert!(end.controller.is_none(), "it may be in any state");
    {
        let told = told.lock().unwrap();
        assert!(told.offs >= 1);
        assert!(!told.ended_before_off, "the end is told when it is off");
    }
    (end.panic.unwrap(), told)
}

#[test]
fn a_panic_of_a_read_ends_with_zero_force_and_its_message() {
    let (message, told) = panicked(100, 0);
    assert!(message.contains("made on purpose in read"), "{message}");
    assert!(message.contains(file!()), "with its place: {message}");
    let told = told.lock().unwrap();
    // The ramp follows, unless the last wrench expired on a machine that stood still.
    assert!(told.forces.len() >= 99, "every tick before it wrote");
    assert_eq!(*told.forces.last().unwrap(), 0.0);
}

#[test]
fn a_panic_of_a_write_ends_the_same_way() {
    let (message, _) = panicked(0, 100);
    assert!(message.contains("made on purpose in write"), "{message}");
}

#[test]
fn a_panic_in_the_core_ends_the_same_way() {
    PANICS_IN.set(100);
    let (message, told) = panicked(0, 0);
    assert!(message.contains("made on purpose in the core"), "{message}");
    assert_eq!(*told.lock().unwrap().forces.last().unwrap(), 0.0);
}

#[test]
fn the_ramp_after_a_panic_falls_in_equal_steps_to_zero() {
    let (mut thread, told) = thread(0, 0);
    let mut from = [Wrench::ZERO; MAX_PROBES];
    from[0].force = glam::DVec3::X * 4.0;
    let mut pacer = Pacer::new(thread.plan.rate_hz, 0);
    thread.ramp_down(&mut pacer, &from);
    let steps = f64::from(panic_steps(&thread.plan));
    let told = told.lock().unwrap();
    assert!(!told.forces.is_empty());
    for (k, force) in (1..).zip(&told.forces) {
        assert!((force - 4.0 * (1.0 - f64::from(k) / steps)).abs() < 1e-12);
    }
}

#[test]
fn a_ramp_ends_at_once_when_the_wrench_has_expired() {
    let (mut thread, told) = thread(0, 0);
    assert!(thread.shared.lease.extend(0, 1_000));
    let mut pacer = Pacer::new(thread.plan.rate_hz, 0);
    let mut from = [Wrench::ZERO; MAX_PROBES];
    from[0].force = glam::DVec3::X;
    thread.ramp_down(&mut pacer, &from);
    assert!(told.lock().unwrap().forces.is_empty(), "no jump back up");
}

#[test]
fn a_run_that_is_switched_off_ends_without_a_ramp() {
    let (thread, told) = thread(0, 0);
    thread.shared.off.store(true, Ordering::Relaxed);
    let end = thread.run(|| true);
    assert!(end.panic.is_none() && end.controller.is_some());
    assert!(told.lock().unwrap().offs >= 1);
}

#[test]
fn a_run_whose_other_threads_do_not_start_ends_before_its_first_tick() {
    let (thread, told) = thread(1, 1);
    let shared = Arc::clone(&thread.shared);
    let end = thread.run(|| false);
    // Its device would panic in that.
    assert!(end.panic.is_none());
    assert!(shared.ended.load(Ordering::Relaxed) && !shared.ticking.load(Ordering::Relaxed));
    let told = told.lock().unwrap();
    assert!(told.offs >= 1 && told.forces.is_empty());
}

struct NoStop;

impl SafeStop for NoStop {
    fn stop(&self) {}
}

/// Zero is written by then: nothing expires, and the watchdog has nothing to stop.
#[test]
fn a_device_that_is_slow_to_switch_off_at_the_end_is_not_stopped() {
    // The watchdog looks at least once in such a time after a wrench has expired.
    let long = Duration::from_nanos(4 * COMMAND_VALIDITY_NS);
    let (thread, told) = thread_with(0, 0, long);
    let shared = Arc::clone(&thread.shared);
    let watchdog = Watchdog::spawn(vec![Box::new(NoStop)], Arc::clone(&shared), 1).unwrap();
    shared.stop.store(true, Ordering::Relaxed);
    let end = thread.run(|| true);
    assert!(end.panic.is_none());
    drop(watchdog);
    let told = told.lock().unwrap();
    assert!(told.offs >= 1 && !told.expired_in_off);
}

#[test]
fn a_full_ring_to_the_link_is_counted() {
    let (mut thread, _) = thread(0, 0);
    let mut outputs = thread.controller.new_outputs();
    outputs.reports.push(bytemuck::Zeroable::zeroed());
    for _ in 0..OUT_CAPACITY + 2 {
        thread.send(&outputs);
    }
    assert_eq!(thread.shared.contacts_lost.load(Ordering::Relaxed), 2);
}

/// Tick 7, behind so many periods that the sleep lost.
fn wake(lost: u32, start_ns: u64) -> Wake {
    Wake {
        tick: 7,
        planned_ns: 1_000_000,
        start_ns,
        skipped: lost,
        misses: [
            Miss::default(),
            Miss {
                periods: lost,
                ..Miss::default()
            },
        ],
        wake_ns: 0,
        period_ns: 0,
        spun_ns: 0,
        extra_switches: 0,
    }
}

#[test]
fn times_since_the_start_count_from_tick_0_also_where_it_was_skipped() {
    let shared = Shared::default();
    shared.note_first(&wake(7, 9_000_000), 1000.0);
    shared.note_first(&wake(7, 10_000_000), 1000.0);
    assert_eq!(shared.first_tick_ns.load(Ordering::Relaxed), 2_000_000);
}

#[test]
fn after_a_lost_period_the_time_counts_from_the_one_that_the_tick_is_in() {
    for (lost, start_ns) in [(0, 1_001_000), (3, 4_001_000)] {
        let wake = wake(lost, start_ns);
        let ends = ends_of(&wake, 1e6, 0);
        for (work, end) in Timed::ALL.into_iter().zip(ends) {
            // The tick began a microsecond late.
            assert_eq!(end + 1_000 - start_ns, (work.last_begin() * 1e6) as u64);
        }
    }
}

/// A device that is read for half of a period, or for all of it.
#[test]
fn what_reading_the_devices_takes_is_not_taken_off_the_time_of_the_core() {
    let wake = wake(0, 1_001_000);
    for (read_ns, least_ns) in [(500_000, 500_001), (2_000_000, 699_999)] {
        let [refinement, contact] = ends_of(&wake, 1e6, read_ns).map(|end| end - wake.planned_ns);
        assert!(refinement >= least_ns, "{read_ns}: {refinement}");
        // The wrenches have to be written within the period.
        assert!(
            refinement <= contact && contact <= 700_000,
            "{read_ns}: {contact}"
        );
    }
}
