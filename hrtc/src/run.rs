//! `hrtc run`: the shell around the controller. Three threads: the tick, the link that owns every iceoryx2
//! port, and this one, which drains the log; they meet the tick in bounded rings.

mod outcome;
mod tick_thread;

pub use outcome::RunError;

use crate::connection::{INBOX, Link, LinkEndpoints, LinkHandle, LinkOptions, Recorder};
use crate::recorder::{Recording, RecordingHead};
use crate::result::{Accumulator, RunMeta, SupervisedLine};
use crate::tick_record::TickRecord;
use haptic_device::Device;
use hrtc_core::contact::sphere_proxy::MAX_CONSTRAINTS;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, Fault};
use outcome::{Outcome, rights};
use protocol::{ContactReport, Request};
use realtime::rights::{MissingRight, monotonic_ns};
use rtrb::{Consumer, RingBuffer};
use scene::{self, Overrides, ScenePlan, TrajectoryPlan};
use scene_files::DiskFiles;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;
use tick_thread::{Ended, Hand, TickThread};
use transport::Domain;

/// Records between the tick and the log, which is drained every [`DRAIN`]: a second at 1 kHz. Locked memory
/// commits them all.
const LOG: usize = 1024;
/// Requests and contacts between the tick and the link.
const OUT: usize = 64;
/// The tick's stack; locked memory commits it whole.
const STACK: usize = 384 << 10;
/// Bytes of the rings and of the stack of the tick: what a controller's process holds beside its cache,
/// whatever the model.
pub const FIXED_BYTES: usize = LOG * size_of::<TickRecord>()
    + INBOX * size_of::<InboxChunk>()
    + OUT * (size_of::<Request>() + size_of::<ContactReport>())
    + STACK;
/// Time between two looks at the log.
const DRAIN: Duration = Duration::from_millis(10);
/// Time between two status lines.
const STATUS_NS: u64 = 200_000_000;
/// Silence after which it is said that no station is there.
const LONELY_NS: u64 = 1_500_000_000;
/// Length of a tour when the run has no end of its own, seconds.
const TOUR_SECONDS: f64 = 600.0;

/// How a run tells its result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// A few lines for a person.
    Text,
    /// One JSON object: the result fields.
    Json,
    /// JSON lines for a supervisor: status, then result, series and histograms.
    Supervised,
}

/// What `hrtc run` was told.
#[derive(Debug, Clone, PartialEq)]
pub struct RunArgs {
    /// The scene file.
    pub scene: PathBuf,
    /// Name of the iceoryx2 domain.
    pub domain: String,
    /// Length, seconds; until Ctrl-C when absent.
    pub seconds: Option<f64>,
    /// What the command line says over the scene.
    pub overrides: Overrides,
    /// How to tell the result.
    pub output: Output,
    /// Start of both processes on CLOCK_MONOTONIC, ns; this process's own when absent.
    pub started_ns: Option<u64>,
    /// Where to record every input of every tick.
    pub record: Option<PathBuf>,
}

/// What the tick tells the other threads, and they it, without a lock.
#[derive(Debug, Default)]
struct Signals {
    /// Wish: ramp down and end.
    stop: AtomicBool,
    /// The tick thread has ended.
    ended: AtomicBool,
    /// The tick thread has its rights and ticks.
    ticking: AtomicBool,
    /// CLOCK_MONOTONIC of tick 0.
    first_tick_ns: AtomicU64,
    /// Records that found the log full.
    log_dropped: AtomicU64,
}

/// Runs until the time is over or `stop` is set.
///
/// # Errors
/// One sentence: a bad scene, a domain that cannot be used, a missing right that the scene requires, a model
/// that cannot be touched.
pub fn run(args: &RunArgs, stop: &AtomicBool) -> Result<(), RunError> {
    let started = args.started_ns.unwrap_or_else(monotonic_ns);
    let plan = scene::load(&args.scene, &args.overrides, &DiskFiles)?;
    let domain = Domain::new(&args.domain)?;
    let incarnation = incarnation();
    let identity = Identity {
        client: incarnation,
        incarnation,
    };
    let tour_seconds = args.seconds.unwrap_or(TOUR_SECONDS);
    let hands: Vec<Hand> = plan
        .probes
        .iter()
        .map(|probe| Hand::new(probe, 1.0 / plan.loop_.rate_hz))
        .collect();
    let weakest = hands
        .iter()
        .map(|hand| hand.device.capabilities().force_max_n);
    let device_max_n = weakest.fold(f64::INFINITY, f64::min);
    let controller = Box::new(Controller::new(&plan, identity, device_max_n, tour_seconds));
    let (arrivals, recording) = match &args.record {
        None => (None, None),
        Some(path) => {
            let head = RecordingHead::new(
                &args.scene,
                &args.overrides,
                identity,
                device_max_n,
                tour_seconds,
            )?;
            let (to_file, from_link) = mpsc::channel();
            let recorder: Recorder = Box::new(move |chunk| {
                // The file's thread is gone only when the run ends.
                let _ = to_file.send(*chunk);
            });
            (
                Some(recorder),
                Some((Recording::create(path, &head)?, from_link)),
            )
        }
    };

    let (requests_in, requests_out) = RingBuffer::new(OUT);
    let (contacts_in, contacts_out) = RingBuffer::new(OUT);
    let (inbox_in, inbox_out) = RingBuffer::new(INBOX);
    let (log_in, log_out) = RingBuffer::new(LOG);
    let station = Arc::new(AtomicU64::new(0));
    let other_version = Arc::new(AtomicU32::new(0));
    let link = Link::spawn(
        LinkOptions {
            domain,
            client: identity.client,
            incarnation,
        },
        LinkEndpoints {
            requests: requests_out,
            contacts: contacts_out,
            inbox: inbox_in,
            station: Arc::clone(&station),
            other_version: Arc::clone(&other_version),
            recorder: arrivals,
        },
    )?;
    let signals = Arc::new(Signals::default());
    let fault = Arc::new(Mutex::new(None));
    let missing = Arc::new(Mutex::new(Vec::new()));
    let tick = TickThread {
        controller,
        hands,
        requests: requests_in,
        contacts: contacts_in,
        inbox: inbox_out,
        log: log_in,
        station: Arc::clone(&station),
        signals: Arc::clone(&signals),
        fault: Arc::clone(&fault),
        missing: Arc::clone(&missing),
        plan: plan.loop_,
        seconds: args.seconds,
    };
    let thread = std::thread::Builder::new()
        .name("hrtc-tick".to_string())
        .stack_size(STACK)
        .spawn(move || tick.run())
        .map_err(RunError::Thread)?;
    let shell = Shell {
        args,
        plan: &plan,
        signals: &signals,
        station: &station,
        other_version: &other_version,
        fault: &fault,
        missing: &missing,
        started,
    };
    let drained = shell.drain(log_out, recording, stop);
    let ended = thread.join();
    stop_link(link);
    let ended = ended.map_err(|_| RunError::TickPanicked)?;
    let outcome = drained?;
    shell.finish(outcome, &ended)
}

fn stop_link(link: LinkHandle) {
    let report = link.stop();
    tracing::debug!(?report, "link stopped");
}

/// A number that differs at every start: the clock and the process.
fn incarnation() -> u64 {
    monotonic_ns() ^ u64::from(std::process::id()) << 40
}

/// What the main thread looks at while the others work.
struct Shell<'a> {
    args: &'a RunArgs,
    plan: &'a ScenePlan,
    signals: &'a Signals,
    station: &'a AtomicU64,
    other_version: &'a AtomicU32,
    fault: &'a Mutex<Option<Fault>>,
    missing: &'a Mutex<Vec<MissingRight>>,
    started: u64,
}

type RecordingEnds = (
    Recording,
    mpsc::Receiver<hrtc_core::streaming::chunk::InboxChunk>,
);

impl Shell<'_> {
    /// Drains the log until the tick has ended; wording happens here, never in the tick.
    fn drain(
        &self,
        mut log: Consumer<TickRecord>,
        mut recording: Option<RecordingEnds>,
        stop: &AtomicBool,
    ) -> Result<Outcome, RunError> {
        let period_ns = (1e9 / self.plan.loop_.rate_hz).round() as u64;
        let mut run =
            Accumulator::new(period_ns, self.plan.probes.len()).ok_or(RunError::Histogram)?;
        let mut next_status = 0;
        let mut said = Said::default();
        let mut error = None;
        loop {
            let ended = self.signals.ended.load(Ordering::Acquire);
            while let Ok(record) = log.pop() {
                run.push(&record);
                if let Some((file, _)) = &mut recording {
                    file.tick(&record)?;
                }
            }
            if let Some((file, chunks)) = &mut recording {
                for chunk in chunks.try_iter() {
                    file.chunk(&chunk)?;
                }
            }
            if ended {
                break;
            }
            if stop.load(Ordering::Relaxed) {
                self.signals.stop.store(true, Ordering::Relaxed);
            }
            error = error.or_else(|| self.look(&mut said));
            if error.is_some() {
                self.signals.stop.store(true, Ordering::Relaxed);
            }
            let now = monotonic_ns();
            if self.args.output == Output::Supervised && now >= next_status {
                next_status = now + STATUS_NS;
                let mut status = run.status();
                status.station = self.station.load(Ordering::Relaxed) != 0;
                print_line(&SupervisedLine::Status { status })?;
            }
            std::thread::sleep(DRAIN);
        }
        if let Some((file, _)) = recording {
            file.finish()?;
        }
        match error {
            Some(error) => Err(error),
            None => Ok(Outcome { run }),
        }
    }

    /// What is to be said or ends the run.
    fn look(&self, said: &mut Said) -> Option<RunError> {
        if let Some(fault) = *self.fault.lock().unwrap_or_else(|e| e.into_inner()) {
            return Some(RunError::Fault(fault));
        }
        if self.signals.ticking.load(Ordering::Acquire) && !said.rights {
            said.rights = true;
            let missing = self.missing.lock().unwrap_or_else(|e| e.into_inner());
            if let (Some(first), true) = (missing.first(), self.plan.loop_.require_realtime) {
                return Some(RunError::Right(first.to_string()));
            }
            for right in missing.iter() {
                eprintln!("hrtc: {right}");
            }
        }
        let other = self.other_version.load(Ordering::Relaxed);
        if other != 0 && other != said.other_version {
            said.other_version = other;
            eprintln!(
                "hrtc: a station here speaks protocol version {other}, this program another: install the same release on both sides"
            );
        }
        let here = self.station.load(Ordering::Relaxed) != 0;
        if here && !said.station {
            said.station = true;
            eprintln!("hrtc: station found in domain {}", self.args.domain);
        } else if !here && said.station {
            said.station = false;
            said.lonely = true;
            eprintln!("hrtc: the station is gone; touching goes on with what is loaded");
        } else if !here && !said.lonely && monotonic_ns() > self.started + LONELY_NS {
            said.lonely = true;
            eprintln!(
                "hrtc: no station in domain {} yet: ticking without a model until one starts (ve-station serve {})",
                self.args.domain,
                self.args.scene.display()
            );
        }
        None
    }

    fn finish(&self, outcome: Outcome, ended: &Ended) -> Result<(), RunError> {
        let controller = &ended.controller;
        let first = self.signals.first_tick_ns.load(Ordering::Relaxed);
        let header = controller.header();
        let seed = match &self.plan.probes[0].trajectory {
            TrajectoryPlan::Tour { seed, .. } => *seed,
            TrajectoryPlan::Points(_) => 0,
        };
        let missing = self.missing.lock().unwrap_or_else(|e| e.into_inner());
        let meta = RunMeta {
            scene: self.plan.name.clone(),
            model: self.plan.objects[0].model.name(),
            faces: header.map_or(0, |h| u64::from(h.faces)),
            seed,
            cache_bytes: self.plan.cache_bytes as u64,
            bytes_full_mesh: controller.headers().map(outcome::bytes_full_mesh).sum(),
            objects: self.plan.objects.len() as u64,
            seats: self.plan.active_objects() as u64,
            rss_bytes: outcome::resident_bytes(),
            start_to_first_tick_ms: first.saturating_sub(self.started) as f64 / 1e6,
            operations_budget: u64::from(ended.work_budget),
            rights: rights(&self.plan.loop_, &missing),
        };
        let mut finished = outcome.run.finish(meta);
        finished.result.cache.high_water_bytes = controller.bytes_high_water() as u64;
        outcome::add_dial(&mut finished.result, controller, self.plan.loop_.rate_hz);
        finished.result.capacities.extend_from_slice(&ended.rings);
        let dropped = self.signals.log_dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            eprintln!("hrtc: {dropped} tick records found the log full and are not in the figures");
        }
        let (refused, last) = controller.refused();
        if refused > 0 {
            eprintln!(
                "hrtc: {refused} regions were refused or did not fit the mesh, the last one {last:#x}; they stayed coarse"
            );
        }
        let constraints = controller.dropped_constraints();
        if constraints > 0 {
            eprintln!(
                "hrtc: {constraints} times a face at the contact found no place beside {MAX_CONSTRAINTS} deeper ones; the probe was swept against it instead"
            );
        }
        match self.args.output {
            Output::Supervised => print_line(&SupervisedLine::Finished(Box::new(finished))),
            Output::Json => print_line(&finished.result),
            Output::Text => {
                outcome::print_text(&finished);
                Ok(())
            }
        }
    }
}

/// What was said already.
#[derive(Default)]
struct Said {
    rights: bool,
    station: bool,
    lonely: bool,
    other_version: u32,
}

fn print_line(value: &impl serde::Serialize) -> Result<(), RunError> {
    let line = serde_json::to_string(value).map_err(|e| RunError::Print(e.into()))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")
        .and_then(|()| out.flush())
        .map_err(RunError::Print)
}
