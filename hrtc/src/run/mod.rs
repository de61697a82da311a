//! `hrtc run`: the shell around the controller.
//!
//! | thread | work |
//! |---|---|
//! | `hrtc-tick` | the loop: devices, core, rings |
//! | `hrtc-link` | every iceoryx2 port |
//! | the caller's | log, recording, messages, result |
//!
//! The threads meet in bounded rings.

mod monitor;
mod outcome;
mod probe_device;
mod shared;
mod tick_thread;

pub use outcome::RunError;

use crate::devices::DeviceRegistry;
use crate::link::{ChunkRecorder, Link, LinkEndpoints, LinkHandle, LinkOptions};
use crate::recorder::{Recording, RecordingHead};
use crate::setup::ControllerSetup;
use crate::tick_record::TickRecord;
use crate::tuning::{INBOX_CAPACITY, LOG_CAPACITY, OUT_CAPACITY, TICK_STACK_BYTES, TOUR_SECONDS};
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use monitor::Monitor;
use probe_device::ProbeDevice;
use protocol::{ContactReport, Request};
use realtime::rights::monotonic_ns;
use rtrb::{Consumer, RingBuffer};
use scene::{Overrides, ScenePlan};
use scene_files::DiskFiles;
use shared::Shared;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU32};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;
use tick_thread::{TickRings, TickThread, TickThreadEnd};
use transport::Domain;

/// Bytes of the rings and of the tick's stack: memory of a controller's process beside its cache,
/// whatever the model.
pub const FIXED_BYTES: usize = LOG_CAPACITY * size_of::<TickRecord>()
    + INBOX_CAPACITY * size_of::<InboxChunk>()
    + OUT_CAPACITY * (size_of::<Request>() + size_of::<ContactReport>())
    + TICK_STACK_BYTES;

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
    /// The scene file.
    pub scene: PathBuf,
    /// Name of the iceoryx2 domain.
    pub domain: String,
    /// Length, seconds; until `stop` when absent.
    pub seconds: Option<f64>,
    /// Values of the command line that replace the scene's.
    pub overrides: Overrides,
    /// Form of the result.
    pub output: Output,
    /// Start of both processes on CLOCK_MONOTONIC, ns; this process's own when absent.
    pub started_ns: Option<u64>,
    /// File for a recording of every input of every tick.
    pub record: Option<PathBuf>,
}

impl RunArgs {
    /// A run without end, as the scene says, that prints its result as text.
    #[must_use]
    pub fn new(scene: &Path, domain: &str) -> Self {
        Self {
            scene: scene.to_path_buf(),
            domain: domain.to_owned(),
            seconds: None,
            overrides: Overrides::default(),
            output: Output::Text,
            started_ns: None,
            record: None,
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

/// Runs with the devices that the scene names, until the time is over or `stop` is set.
///
/// # Errors
/// One sentence: a bad scene, an unknown device, a domain that cannot be used, a missing right that
/// the scene requires, a model that cannot be rendered.
pub fn run_with(
    devices: &DeviceRegistry,
    args: &RunArgs,
    stop: &AtomicBool,
) -> Result<(), RunError> {
    let started_ns = args.started_ns.unwrap_or_else(monotonic_ns);
    let mut plan = scene::load(&args.scene, &args.overrides, &DiskFiles)?;
    let domain = Domain::new(&args.domain)?;
    let devices = make_devices(devices, args, &plan)?;
    let capabilities = devices.iter().map(|probe| probe.device.capabilities());
    let tour_seconds = args.seconds.unwrap_or(TOUR_SECONDS);
    let setup = ControllerSetup::new(new_identity(), capabilities, tour_seconds);
    let controller = Box::new(setup.controller(&mut plan));
    let (recorder, recording) = open_recording(args, &setup)?;

    let shared = Arc::new(Shared {
        object_faults: Mutex::new(Vec::with_capacity(plan.objects.len() + plan.probes.len())),
        ..Shared::default()
    });
    let other_version = Arc::new(AtomicU32::new(0));
    let (rings, requests, contacts, inbox, log) = rings();
    let link = Link::spawn(
        LinkOptions {
            domain,
            client: setup.client,
            incarnation: setup.incarnation,
        },
        LinkEndpoints {
            requests,
            contacts,
            inbox,
            station: Arc::clone(&shared.station),
            other_version: Arc::clone(&other_version),
            recorder,
        },
    )?;
    let thread = spawn_tick(TickThread {
        controller,
        devices,
        rings,
        shared: Arc::clone(&shared),
        plan: plan.loop_,
        seconds: args.seconds,
    })?;
    let monitor = Monitor {
        args,
        plan: &plan,
        shared: &shared,
        other_version: &other_version,
        started_ns,
    };
    let drained = monitor.drain(log, recording, stop);
    let end = thread.join();
    stop_link(link);
    let end = end.map_err(|_| RunError::TickPanicked)?;
    monitor.finish(drained?, &end)
}

fn make_devices(
    registry: &DeviceRegistry,
    args: &RunArgs,
    plan: &ScenePlan,
) -> Result<Vec<ProbeDevice>, RunError> {
    let period_s = 1.0 / plan.loop_.rate_hz;
    let make = |(index, probe)| {
        let device = registry.make(&args.scene, index, probe, period_s)?;
        tracing::debug!(capabilities = ?device.capabilities(), "device of probe {index}");
        Ok(ProbeDevice::new(device, probe))
    };
    plan.probes.iter().enumerate().map(make).collect()
}

/// The file of a recording, and the chunks that the link sends to it.
type OpenRecording = (Recording, mpsc::Receiver<InboxChunk>);

fn open_recording(
    args: &RunArgs,
    setup: &ControllerSetup,
) -> Result<(Option<ChunkRecorder>, Option<OpenRecording>), RunError> {
    let Some(path) = &args.record else {
        return Ok((None, None));
    };
    let head = RecordingHead::new(&args.scene, &args.overrides, setup)?;
    let (to_file, from_link) = mpsc::channel();
    let recorder: ChunkRecorder = Box::new(move |chunk| {
        // The receiver is gone only after the run.
        let _ = to_file.send(*chunk);
    });
    let recording = Recording::create(path, &head)?;
    Ok((Some(recorder), Some((recording, from_link))))
}

type RingEnds = (
    TickRings,
    Consumer<Request>,
    Consumer<ContactReport>,
    rtrb::Producer<InboxChunk>,
    Consumer<TickRecord>,
);

/// The rings: the tick's ends, then the link's, then the log.
fn rings() -> RingEnds {
    let (requests_in, requests_out) = RingBuffer::new(OUT_CAPACITY);
    let (contacts_in, contacts_out) = RingBuffer::new(OUT_CAPACITY);
    let (inbox_in, inbox_out) = RingBuffer::new(INBOX_CAPACITY);
    let (log_in, log_out) = RingBuffer::new(LOG_CAPACITY);
    let tick = TickRings {
        requests: requests_in,
        contacts: contacts_in,
        inbox: inbox_out,
        log: log_in,
    };
    (tick, requests_out, contacts_out, inbox_in, log_out)
}

fn spawn_tick(tick: TickThread) -> Result<JoinHandle<TickThreadEnd>, RunError> {
    std::thread::Builder::new()
        .name("hrtc-tick".to_string())
        .stack_size(TICK_STACK_BYTES)
        .spawn(move || tick.run())
        .map_err(RunError::Thread)
}

fn stop_link(link: LinkHandle) {
    let report = link.stop();
    tracing::debug!(?report, "link stopped");
}

/// An identity that differs at every start: the clock and the process.
fn new_identity() -> Identity {
    let incarnation = monotonic_ns() ^ u64::from(std::process::id()) << 40;
    Identity {
        client: incarnation,
        incarnation,
    }
}
