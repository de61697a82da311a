//! `hrtc run`: the shell around the controller.
//!
//! | thread | work |
//! |---|---|
//! | `hrtc-tick` | the loop: devices, core, rings |
//! | `hrtc-link` | every iceoryx2 port |
//! | `hrtc-watchdog` | zero force when the tick does not write any more |
//! | `hrtc-stop` | requests to end, also where the caller's thread hangs |
//! | `hrtc-recorder`, `hrtc-disk` | the recording, see [`crate::recorder`] |
//! | `notes`, `hrtc-status` | lines on both outputs, which no other thread waits for |
//! | the caller's | log, messages, result |
//!
//! The threads meet in bounded rings. First everything is made that a tick uses, then the memory of
//! the process is made resident. Link, figures, status and the recording's twin start after that:
//! theirs takes what they touch.

mod drivers;
mod loaded_scene;
mod monitor;
mod outcome;
mod probe_device;
mod recording;
mod room;
mod shared;
mod status_lines;
mod tick_thread;
mod watchdog;

pub use outcome::RunError;
pub use room::next_tick_core;

use crate::devices::DeviceRegistry;
use crate::link::{Link, LinkEndpoints, LinkHandle, LinkOptions};
use crate::recorder::Taps;
use crate::result::Accumulator;
use crate::setup::{ControllerSetup, ForceLimits};
use crate::tick_record::TickRecord;
use crate::tuning::{
    DRAIN_PERIOD, INBOX_CAPACITY, LOG_CAPACITY, MAX_LOG_CAPACITY, MAX_TOUR_SECONDS, OUT_CAPACITY,
    SIGNALS_STACK_BYTES, TICK_STACK_BYTES, TOUR_SECONDS, WATCHDOG_STACK_BYTES,
};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use loaded_scene::LoadedScene;
use monitor::{Drained, Monitor};
use probe_device::ProbeDevice;
use protocol::{ContactReport, Encoding, Request};
use realtime::rights::{keep_heap_small, monotonic_ns, touch_stack};
use recording::RunRecording;
use rtrb::{Consumer, RingBuffer};
use scene::{CacheTimetable, Overrides, ScenePlan};
use shared::Shared;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use tick_thread::{TickRings, TickThread, TickThreadEnd};
use transport::Domain;
use watchdog::Watchdog;

/// Bytes of the rings and stacks of tick, watchdog and signals: what a controller of 1 kHz needs
/// beside its cache, whatever the model. Its process holds more: the program itself, the link, the
/// figures of the run, the points of a tour, and where it is recorded a second controller. See
/// [`RunResult::hrtc_rss_bytes`](crate::result::RunResult::hrtc_rss_bytes).
pub const FIXED_BYTES: usize = LOG_CAPACITY * size_of::<TickRecord>()
    + INBOX_CAPACITY * size_of::<InboxChunk>()
    + OUT_CAPACITY * (size_of::<Request>() + size_of::<ContactReport>())
    + TICK_STACK_BYTES
    + WATCHDOG_STACK_BYTES
    + SIGNALS_STACK_BYTES;

/// Bytes of a recording where no scene of this machine says how many: when `--record FILE` turns on
/// what the scene has off, and for a station's scene. As the scene's default.
const KEEP_BYTES: u64 = 512 << 20;

/// Form of the result on standard output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// A few lines for a person.
    Text,
    /// One JSON object: the result fields.
    Json,
    /// JSON lines for a supervisor: status, then result, series and histograms.
    Supervised,
}

/// Arguments of `hrtc run`.
#[derive(Debug, Clone, PartialEq)]
pub struct RunArgs {
    /// The scene file; `None` for the scene of the station, fetched before the first tick.
    pub scene: Option<PathBuf>,
    /// Name of the iceoryx2 domain.
    pub domain: String,
    /// Address of the station where it is on another machine, for messages; the first question to
    /// such a one waits longer for its answer.
    pub station: Option<String>,
    /// Length, seconds; until `stop` when absent.
    pub seconds: Option<f64>,
    /// Length of a tour, seconds, after which the hand rests. When absent that of the run, where it
    /// is no longer than [`MAX_TOUR_SECONDS`]; in a longer one the hand goes back and forth along
    /// a tour of that length, and in one without an end along one of [`TOUR_SECONDS`].
    pub tour_seconds: Option<f64>,
    /// Values of the command line that replace the scene's.
    pub overrides: Overrides,
    /// Limits of this machine, whatever the scene says.
    pub limits: ForceLimits,
    /// Form of the result.
    pub output: Output,
    /// Start of both processes on CLOCK_MONOTONIC, ns, where another process started this one: it
    /// has put it on the cores of everything but the tick. This process's own when absent.
    pub started_ns: Option<u64>,
    /// First file of the recording; `off` records nothing, and without a path it is the scene's or
    /// one in the user's state folder.
    pub record: Option<PathBuf>,
    /// How many times as long every stage of a tick takes, at least 1: the thread spins for the
    /// rest. For tests of a slower machine.
    pub slow: f64,
}

impl RunArgs {
    /// A run without end, as the scene says, that prints its result as text.
    #[must_use]
    pub fn new(scene: &Path, domain: &str) -> Self {
        Self {
            scene: Some(scene.to_path_buf()),
            ..Self::of_station(domain)
        }
    }

    /// The same with the scene of the station in the domain.
    #[must_use]
    pub fn of_station(domain: &str) -> Self {
        Self {
            scene: None,
            domain: domain.to_owned(),
            station: None,
            seconds: None,
            tour_seconds: None,
            overrides: Overrides::default(),
            limits: ForceLimits::default(),
            output: Output::Text,
            started_ns: None,
            record: None,
            slow: 1.0,
        }
    }

    /// How chunks are to come: a line between machines is thinner than coding is slow.
    fn encoding(&self) -> Encoding {
        match self.station {
            Some(_) => Encoding::Compact,
            None => Encoding::Plain,
        }
    }
}

/// Runs with the simulated device only, until the time is over or `stop` is set.
///
/// # Errors
/// See [`run_with`].
pub fn run(args: &RunArgs, stop: &AtomicBool) -> Result<(), RunError> {
    run_with(&DeviceRegistry::new(), args, stop)
}

/// Requests to end a run, from any thread.
#[derive(Debug, Clone, Copy)]
pub struct StopFlags<'a> {
    /// End with the ramp.
    pub with_ramp: &'a AtomicBool,
    /// Switch the devices off without a ramp, and end without a result.
    pub at_once: &'a AtomicBool,
}

/// Runs with the devices that the scene names, until the time is over or `stop` is set.
///
/// # Errors
/// See [`run_until`].
pub fn run_with(
    devices: &DeviceRegistry,
    args: &RunArgs,
    stop: &AtomicBool,
) -> Result<(), RunError> {
    let stop = StopFlags {
        with_ramp: stop,
        at_once: &AtomicBool::new(false),
    };
    run_until(devices, args, stop)
}

/// Runs with the devices that the scene names, until the time is over or it is asked to end.
///
/// # Errors
/// One sentence: a bad scene, an unknown device, a domain that cannot be used, a missing right that
/// the scene requires, a model that cannot be rendered, a panic of the tick or of the link.
pub fn run_until(
    devices: &DeviceRegistry,
    args: &RunArgs,
    stop: StopFlags<'_>,
) -> Result<(), RunError> {
    let started_ns = args.started_ns.unwrap_or_else(monotonic_ns);
    keep_heap_small();
    // Dropped last: what is said before the end is written then.
    let _lines = transport::logging::queue();
    let domain = Domain::new(&args.domain)?;
    let mut scene = LoadedScene::new(args, &domain, stop.with_ramp)?;
    let _core = room::claim_core(&mut scene.plan.loop_, args.started_ns.is_some());
    let devices = make_devices(devices, &scene, args.tour_seconds.is_none())?;
    let mut setup = setup_for(args, &devices).within(args.limits);
    let shared = new_shared(&scene.plan);
    // Before the costs are measured: the C library gives their stack, three times as large as this
    // one's, to the next thread, which is to be the recorder's or the tick's: they need as much.
    let watchdog = watch(&devices, &shared, &scene.plan)?;
    setup.costs = room::measure_costs(&scene.plan.loop_, args.slow);
    let controller = Box::new(setup.controller(&mut scene.plan));
    let plan = &scene.plan;
    room::check(plan, &setup, args.seconds)?;

    let (mut recording, taps) = RunRecording::start(args.record.as_deref(), &scene, &setup)?;
    let (rings, endpoints, log) = rings(taps, &shared, plan.loop_.rate_hz);
    let tick = Ticking::spawn(TickThread {
        controller,
        devices,
        rings,
        shared: Arc::clone(&shared),
        plan: plan.loop_,
        cache: CacheTimetable::new(Arc::clone(&plan.cache_changes)),
        seconds: args.seconds,
        slow: args.slow,
    })?;
    let link = Link::spawn(link_options(args, domain, &setup), endpoints)?;
    shared.refused(recording.as_mut().and_then(RunRecording::take_missing));
    let period_ns = (1e9 / plan.loop_.rate_hz).round() as u64;
    let run = Accumulator::new(period_ns, plan.probes.len());
    // Dropped before the link, which may take its time.
    let tick = tick.begin();
    let monitor = Monitor {
        args,
        plan,
        max_force_n: setup.max_force_n,
        shared: &shared,
        started_ns,
        is_recorded: recording.is_some(),
        link: &link,
        watchdog: &watchdog,
    };
    let drained = hearing(stop, &shared, &watchdog, || {
        monitor.drain(run, log, recording.as_mut(), stop)
    })?;
    let end = tick.join(&drained);
    let ended = monitor.conclude(drained, end);
    stop_link(link);
    if let Some(recording) = recording {
        recording.finish(ended.as_ref().err());
    }
    ended
}

/// What the threads share; a fault of every object and probe fits.
fn new_shared(plan: &ScenePlan) -> Arc<Shared> {
    Arc::new(Shared {
        object_faults: Mutex::new(Vec::with_capacity(plan.objects.len() + plan.probes.len())),
        ..Shared::default()
    })
}

/// Runs `drain`, and tells tick and watchdog of requests to end meanwhile, also where it hangs.
///
/// # Errors
/// When the operating system gives no thread.
fn hearing<T>(
    stop: StopFlags<'_>,
    shared: &Shared,
    watchdog: &Watchdog,
    drain: impl FnOnce() -> T,
) -> Result<T, RunError> {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let hear = || {
            while !is_over.load(Ordering::Acquire) {
                if stop.with_ramp.load(Ordering::Relaxed) {
                    shared.stop.store(true, Ordering::Relaxed);
                }
                // After the end there is a result.
                let has_ended = shared.ended.load(Ordering::Acquire);
                if !has_ended && stop.at_once.load(Ordering::Relaxed) {
                    shared.off.store(true, Ordering::Release);
                    watchdog.wake();
                }
                std::thread::sleep(DRAIN_PERIOD);
            }
        };
        std::thread::Builder::new()
            .name("hrtc-stop".to_string())
            .stack_size(SIGNALS_STACK_BYTES)
            .spawn_scoped(scope, hear)
            .map_err(|error| RunError::Thread("hrtc-stop", error))?;
        // Also after a panic.
        let _over = SetWhenDropped(&is_over);
        Ok(drain())
    })
}

struct SetWhenDropped<'a>(&'a AtomicBool);

impl Drop for SetWhenDropped<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// The tick thread. Dropping it, by an early return or a panic of the main thread, ends it with its
/// ramp.
struct Ticking {
    shared: Arc<Shared>,
    /// The word that it waits for before its first tick: dropped without it, it ends there.
    go: Option<SyncSender<()>>,
    thread: Option<JoinHandle<TickThreadEnd>>,
}

impl Ticking {
    /// Starts it, and returns when it has its rights, and with them the memory that is there now.
    fn spawn(tick: TickThread) -> Result<Self, RunError> {
        // Where the system limits locked memory, it may refuse to a resident stack what the main
        // thread needs later.
        touch_stack();
        let shared = Arc::clone(&tick.shared);
        let (ready, is_ready) = sync_channel(1);
        let (go, may_begin) = sync_channel(1);
        let wait = move || ready.send(()).is_ok() && may_begin.recv().is_ok();
        let thread = std::thread::Builder::new()
            .name("hrtc-tick".to_string())
            .stack_size(TICK_STACK_BYTES)
            .spawn(move || tick.run(wait))
            .map_err(|error| RunError::Thread("hrtc-tick", error))?;
        // An error: it panicked, which its end tells.
        let _ = is_ready.recv();
        Ok(Self {
            shared,
            go: Some(go),
            thread: Some(thread),
        })
    }

    /// Lets the ticks begin.
    fn begin(mut self) -> Self {
        if let Some(go) = self.go.take() {
            let _ = go.send(());
        }
        self
    }

    /// The thread's end; `None` for a thread that hangs, which ends with the process.
    fn join(mut self, drained: &Drained) -> Option<TickThreadEnd> {
        let thread = self.thread.take()?;
        if matches!(drained.error, Some(RunError::TickHangs)) {
            return None;
        }
        Some(thread.join().unwrap_or_else(TickThreadEnd::lost))
    }
}

impl Drop for Ticking {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        drop(self.go.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The watchdog of the devices that have a safe stop.
fn watch(
    devices: &[ProbeDevice],
    shared: &Arc<Shared>,
    plan: &ScenePlan,
) -> Result<Watchdog, RunError> {
    let stops = devices.iter().filter_map(|probe| probe.device.safe_stop());
    let shared = Arc::clone(shared);
    Watchdog::spawn(stops.collect(), shared, plan.loop_.priority)
        .map_err(|error| RunError::Thread("hrtc-watchdog", error))
}

/// The devices of the probes; `turn_back`: whether hands turn back at the ends of their tours.
fn make_devices(
    registry: &DeviceRegistry,
    scene: &LoadedScene,
    turn_back: bool,
) -> Result<Vec<ProbeDevice>, RunError> {
    let plan = &scene.plan;
    let period_s = 1.0 / plan.loop_.rate_hz;
    let make = |(index, probe)| {
        let device = registry.make(&scene.path, index, probe, period_s)?;
        tracing::debug!(capabilities = ?device.capabilities(), "device of probe {index}");
        Ok(ProbeDevice::new(device, probe).turning_back(turn_back))
    };
    plan.probes.iter().enumerate().map(make).collect()
}

/// The rings: the tick's ends, with its part of the recorder's; the link's, with its own; the log.
fn rings(
    recorded: Option<Taps>,
    shared: &Shared,
    rate_hz: f64,
) -> (TickRings, LinkEndpoints, Consumer<TickRecord>) {
    let (recorded_outputs, recorder) = recorded.map(|of| (of.outputs, of.chunks)).unzip();
    let (requests_in, requests) = RingBuffer::new(OUT_CAPACITY);
    let (contacts_in, contacts) = RingBuffer::new(OUT_CAPACITY);
    let (inbox, inbox_out) = RingBuffer::new(INBOX_CAPACITY);
    let (log_in, log) = RingBuffer::new(log_capacity(rate_hz));
    let tick = TickRings {
        requests: requests_in,
        contacts: contacts_in,
        inbox: inbox_out,
        log: log_in,
        recorded: recorded_outputs,
    };
    let link = LinkEndpoints {
        requests,
        contacts,
        inbox,
        station: Arc::clone(&shared.station),
        round_trip_us: Arc::clone(&shared.round_trip_us),
        traffic: Arc::clone(&shared.traffic),
        recorder,
    };
    (tick, link, log)
}

/// Tick records between tick and main thread: those of half a second, as far as there may be as
/// many.
fn log_capacity(rate_hz: f64) -> usize {
    let records = (1e-3 * rate_hz * LOG_CAPACITY as f64).ceil() as usize;
    records.clamp(LOG_CAPACITY, MAX_LOG_CAPACITY)
}

fn link_options(args: &RunArgs, domain: Domain, setup: &ControllerSetup) -> LinkOptions {
    LinkOptions {
        domain,
        client: setup.client,
        incarnation: setup.incarnation,
        encoding: args.encoding(),
    }
}

fn stop_link(link: LinkHandle) {
    let report = link.stop();
    tracing::debug!(?report, "link stopped");
}

/// The values beside the scene that make the controller of a run.
fn setup_for(args: &RunArgs, devices: &[ProbeDevice]) -> ControllerSetup {
    let capabilities = devices.iter().map(|probe| probe.device.capabilities());
    let of_run = args
        .seconds
        .map_or(TOUR_SECONDS, |seconds| seconds.min(MAX_TOUR_SECONDS));
    let tour_seconds = args.tour_seconds.unwrap_or(of_run);
    let mut setup = ControllerSetup::new(new_identity(), capabilities, tour_seconds);
    setup.station_is_far = args.station.is_some();
    setup
}

/// An identity that differs at every start: the clock and the process.
fn new_identity() -> Identity {
    let incarnation = monotonic_ns() ^ u64::from(std::process::id()) << 40;
    Identity {
        client: incarnation,
        incarnation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_bridges_the_same_time_at_any_rate_as_far_as_it_may() {
        for (rate_hz, expected) in [(100.0, 512), (1000.0, 512), (1500.0, 768), (4000.0, 1024)] {
            assert_eq!(log_capacity(rate_hz), expected, "{rate_hz}");
        }
    }

    /// Locked memory holds them all.
    #[test]
    fn the_points_of_a_tour_are_bounded_however_long_the_run_is() {
        let tour_of = |seconds, tour_seconds| {
            let args = RunArgs {
                seconds,
                tour_seconds,
                ..RunArgs::of_station("none")
            };
            setup_for(&args, &[]).tour_seconds
        };
        for (seconds, expected) in [
            (Some(20.0), 20.0),
            (Some(MAX_TOUR_SECONDS), MAX_TOUR_SECONDS),
            (Some(20_000.0), MAX_TOUR_SECONDS),
            (None, TOUR_SECONDS),
        ] {
            assert_eq!(tour_of(seconds, None), expected, "{seconds:?}");
            // One that is named is as long as it says.
            assert_eq!(tour_of(seconds, Some(700.0)), 700.0, "{seconds:?}");
        }
    }
}
