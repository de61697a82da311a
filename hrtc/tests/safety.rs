//! The chain of safety of a run with a real force: a device taps on a ball and, while the ball
//! pushes it, does what no device should.

use glam::DVec3;
use haptic_device::{Capabilities, Device, Pose, SafeStop, Sample, TickTime, WrenchCommand};
use hrtc::devices::DeviceRegistry;
use hrtc::recorder::replay;
use hrtc::run::{RunArgs, RunError, StopFlags, run_until};
use hrtc::tuning::COMMAND_VALIDITY_NS;
use realtime::rights::monotonic_ns;
use spm_builder::generate::{Shape, generate};
use spm_builder::{BuildOptions, NoProgress, build_model, write_spm_file};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;
use ve_station::serve::{ServeArgs, serve};

/// Force at which the fault happens, newtons: the tap reaches 1.6 N.
const PUSHED: f64 = 0.5;
/// Largest force of the scene, newtons.
const MOST: f64 = 8.0;
/// Ticks of the scene's ramp: 0.2 s at 1 kHz.
const RAMP: f64 = 200.0;
/// Writes after a fault that does not end the run.
const AFTER: usize = 100;

/// What the device does in one read while it is pushed.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    Panics,
    /// Hangs until the watchdog has stopped it.
    Hangs,
    /// The same, in the write of its wrench.
    HangsInWrite,
    /// Asks the run to end at once.
    IsSwitchedOff,
    /// The same, and hangs until the test ends.
    HangsForGood,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    /// Force, newtons.
    Wrote(f64),
    Fault,
    Stopped,
    Off,
}

/// What the device and the test share.
#[derive(Default)]
struct Told {
    events: Mutex<Vec<Event>>,
    stopped: AtomicBool,
    with_ramp: AtomicBool,
    at_once: AtomicBool,
    is_over: AtomicBool,
    /// A wrench was valid for longer than it may, or had expired.
    too_long: AtomicBool,
    too_late: AtomicBool,
}

impl Told {
    fn note(&self, event: Event) {
        self.events.lock().unwrap().push(event);
    }
}

struct Stop(Arc<Told>);

impl SafeStop for Stop {
    fn stop(&self) {
        self.0.note(Event::Stopped);
        self.0.stopped.store(true, Ordering::Release);
    }
}

struct Tapper {
    fault: Option<Fault>,
    told: Arc<Told>,
    ticks: u64,
    force: f64,
}

impl Tapper {
    /// The fault, if it is one of these and the ball pushes.
    fn may_happen(&mut self, which: impl Fn(Fault) -> bool) {
        if self.force > PUSHED
            && let Some(fault) = self.fault.take_if(|fault| which(*fault))
        {
            self.happens(fault);
        }
    }

    fn happens(&mut self, fault: Fault) {
        self.told.note(Event::Fault);
        let wait = |flag: &AtomicBool| {
            while !flag.load(Ordering::Acquire) {
                thread::sleep(Duration::from_millis(1));
            }
        };
        match fault {
            Fault::Panics => panic!("made on purpose in the device"),
            Fault::Hangs | Fault::HangsInWrite => wait(&self.told.stopped),
            Fault::IsSwitchedOff => self.told.at_once.store(true, Ordering::Release),
            Fault::HangsForGood => {
                self.told.at_once.store(true, Ordering::Release);
                wait(&self.told.is_over);
            }
        }
    }
}

impl Device for Tapper {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("tapper", 10.0)
    }
    fn read(&mut self, time: TickTime) -> Option<Sample> {
        self.ticks += u64::from(time.periods);
        self.may_happen(|fault| fault != Fault::HangsInWrite);
        // 0.4 s a tap, down to 2 mm in the ball.
        let phase = std::f64::consts::TAU * (self.ticks % 400) as f64 / 400.0;
        let z = 0.054 + 0.005 * phase.cos();
        Some(Sample::at(Pose::at(DVec3::Z * z)))
    }
    fn write(&mut self, command: WrenchCommand) {
        let is_late =
            command.wrench.force != DVec3::ZERO && command.valid_until_ns < monotonic_ns();
        self.told.too_late.fetch_or(is_late, Ordering::Relaxed);
        self.force = command.wrench.force.length();
        self.told.note(Event::Wrote(self.force));
        self.may_happen(|fault| fault == Fault::HangsInWrite);
        let most = monotonic_ns() + COMMAND_VALIDITY_NS;
        let too_long = self.force > 0.0 && command.valid_until_ns > most;
        self.told.too_long.fetch_or(too_long, Ordering::Relaxed);
        let events = self.told.events.lock().unwrap();
        let fault = events.iter().rposition(|event| *event == Event::Fault);
        if fault.is_some_and(|at| events.len() - at > AFTER) {
            self.told.with_ramp.store(true, Ordering::Release);
        }
    }
    fn safe_off(&mut self) {
        self.told.note(Event::Off);
    }
    fn safe_stop(&self) -> Option<Box<dyn SafeStop>> {
        Some(Box::new(Stop(Arc::clone(&self.told))))
    }
}

fn ball(folder: &Path) {
    let mesh = generate(Shape::Sphere, 2000, 1);
    let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
    write_spm_file(&parts, &folder.join("ball.spm")).unwrap();
}

/// A run with a fault; how it ended, the force before the fault, and all events after it.
fn run_with_fault(name: &str, fault: Fault) -> (Result<(), RunError>, f64, Vec<Event>) {
    let (ended, events) = record_with_fault(name, fault, "off".as_ref());
    let at = events.iter().position(|event| *event == Event::Fault);
    let at = at.expect("the ball never pushed");
    let before = events[..at].iter().rev().find_map(force).unwrap();
    assert!(before > PUSHED);
    (ended, before, events[at + 1..].to_vec())
}

/// A run with a fault and its recording; how it ended, and all events.
fn record_with_fault(
    name: &str,
    fault: Fault,
    record: &Path,
) -> (Result<(), RunError>, Vec<Event>) {
    record_beside(&Arc::default(), name, fault, record)
}

/// The same; a second device that taps alike tells it.
fn record_beside(
    beside: &Arc<Told>,
    name: &str,
    fault: Fault,
    record: &Path,
) -> (Result<(), RunError>, Vec<Event>) {
    let folder = tempfile::tempdir().unwrap();
    ball(folder.path());
    let scene = folder.path().join("tap.toml");
    let text = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[loop]\ncore = -1\n[safety]\nramp_s = 0.2\n[[probe]]\ndevice = { custom = { name = \"tapper\" } }\n[[probe]]\ndevice = { custom = { name = \"second\" } }\n";
    std::fs::write(&scene, text).unwrap();
    let domain = format!("safety-{name}-{}", std::process::id());
    let served = ServeArgs {
        scene: scene.clone(),
        domain: domain.clone(),
        overrides: scene::Overrides::default(),
        view: None,
        json: false,
    };
    let told = Arc::new(Told::default());
    let registry = {
        let tapper = |fault: Option<Fault>, told: &Arc<Told>| Tapper {
            fault,
            told: Arc::clone(told),
            ticks: 0,
            force: 0.0,
        };
        let (told, beside) = (Arc::clone(&told), Arc::clone(beside));
        DeviceRegistry::new()
            .with("tapper", move |_| Ok(Box::new(tapper(Some(fault), &told))))
            .with("second", move |_| Ok(Box::new(tapper(None, &beside))))
    };
    let mut args = RunArgs::new(&scene, &domain);
    args.record = Some(record.into());
    // Far longer than it takes.
    args.seconds = Some(60.0);
    let stop = AtomicBool::new(false);
    let ended = thread::scope(|scope| {
        scope.spawn(|| serve(&served, &stop).unwrap());
        let flags = StopFlags {
            with_ramp: &told.with_ramp,
            at_once: &told.at_once,
        };
        let ended = run_until(&registry, &args, flags);
        stop.store(true, Ordering::Relaxed);
        ended
    });
    let events = told.events.lock().unwrap().clone();
    told.is_over.store(true, Ordering::Release);
    transport::Domain::new(&domain).unwrap().remove_files();
    assert!(!told.too_long.load(Ordering::Relaxed), "valid for too long");
    (ended, events)
}

fn force(event: &Event) -> Option<f64> {
    match event {
        Event::Wrote(force) => Some(*force),
        _ => None,
    }
}

#[test]
fn a_panic_under_force_ramps_down_switches_off_and_names_itself() {
    let (ended, before, after) = run_with_fault("panic", Fault::Panics);
    let message = ended.unwrap_err().to_string();
    assert!(
        message.contains("made on purpose in the device"),
        "{message}"
    );
    let forces: Vec<f64> = after.iter().filter_map(force).collect();
    // None at all when a stall of this machine let the last wrench expire.
    assert!(forces.first().is_none_or(|first| *first < before));
    assert!(
        forces.is_sorted_by(|a, b| a > b),
        "it only falls: {forces:?}"
    );
    let is_stopped = after.contains(&Event::Stopped);
    assert!(is_stopped || forces.last() == Some(&0.0), "{forces:?}");
    assert_eq!(after.last(), Some(&Event::Off));
}

#[test]
fn a_panic_leaves_a_black_box_up_to_its_tick_that_names_it_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let (ended, events) = record_with_fault("black-box", Fault::Panics, &file);
    let message = ended.unwrap_err().to_string();
    let black_box = folder.path().join("run-fault.mcap");
    let found = replay(&black_box).unwrap();
    assert!(found.equal && found.whole, "{found:?}");
    // The run is shorter than ten seconds, so every tick that wrote before the fault is in it.
    let fault = events.iter().position(|event| *event == Event::Fault);
    let written = events[..fault.unwrap()].iter().filter_map(force).count();
    assert_eq!(found.ticks, written as u64);
    let told = format!("the run ended by a fault: {message}");
    let bytes = std::fs::read(&black_box).unwrap();
    let mut places = bytes.windows(told.len());
    assert!(places.any(|at| at == told.as_bytes()), "{told}");
}

#[test]
fn a_tick_that_hangs_is_stopped_by_the_watchdog_and_comes_back_softly() {
    let (ended, _, after) = run_with_fault("hang", Fault::Hangs);
    ended.unwrap();
    assert_eq!(after[0], Event::Stopped, "before anything else");
    let forces: Vec<f64> = after.iter().filter_map(force).collect();
    assert!(forces.len() >= AFTER - 10);
    // The share of the ramp bounds the force, and the first wrench is zero.
    for (k, force) in forces.iter().enumerate().take(RAMP as usize) {
        let most = MOST * k as f64 / RAMP;
        assert!(*force <= most, "write {k}: {force} N");
    }
    assert_eq!(after.last(), Some(&Event::Off));
}

/// The wrench of the second device is computed before the first one hangs, and is to be written
/// after the watchdog has stopped both.
#[test]
fn a_device_that_hangs_in_a_write_leaves_no_expired_force_on_the_next() {
    let beside = Arc::default();
    let (ended, events) = record_beside(&beside, "write", Fault::HangsInWrite, "off".as_ref());
    ended.unwrap();
    assert!(events.contains(&Event::Fault) && events.contains(&Event::Stopped));
    assert!(!beside.too_late.load(Ordering::Relaxed), "expired");
    let events = beside.events.lock().unwrap().clone();
    let at = events.iter().position(|event| *event == Event::Stopped);
    let at = at.expect("the watchdog stops both");
    let before = events[..at].iter().rev().find_map(force).unwrap();
    assert!(before > 0.5 * PUSHED, "{before} N");
    let after: Vec<f64> = events[at..].iter().filter_map(force).collect();
    for (k, force) in after.iter().enumerate().take(RAMP as usize) {
        let most = MOST * k as f64 / RAMP;
        assert!(*force <= most, "write {k}: {force} N");
    }
}

#[test]
fn a_run_that_is_switched_off_leaves_no_force() {
    let (ended, _, after) = run_with_fault("off", Fault::IsSwitchedOff);
    assert!(matches!(ended, Err(RunError::SwitchedOff)));
    assert!(after.contains(&Event::Off));
    // Tick and watchdog switch off, in either order.
    let last = after.last();
    assert!(
        matches!(last, Some(Event::Off | Event::Stopped)),
        "{after:?}"
    );
}

#[test]
fn a_run_whose_tick_hangs_for_good_is_switched_off_and_ends() {
    let (ended, _, after) = run_with_fault("for-good", Fault::HangsForGood);
    assert!(matches!(ended, Err(RunError::TickHangs)));
    assert!(after.contains(&Event::Stopped));
    assert!(!after.iter().any(|event| force(event).is_some()), "no more");
}
