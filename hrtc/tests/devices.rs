//! Devices of one's own in a run: named in the scene, made by the registry, called by the tick.

use haptic_device::{
    Capabilities, DegreesOfFreedom, Device, Pose, Sample, TickTime, WrenchCommand,
};
use hrtc::devices::DeviceRegistry;
use hrtc::run::{RunArgs, run_with};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Calls of a device.
#[derive(Default)]
struct Calls {
    reads: AtomicU64,
    periods: AtomicU64,
    writes: AtomicU64,
    /// Commands that were to end before they began.
    stale: AtomicU64,
    safe_offs: AtomicU64,
}

struct Counted {
    calls: Arc<Calls>,
    start_ns: u64,
}

impl Device for Counted {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational("counted", 3.0)
    }
    fn read(&mut self, time: TickTime) -> Option<Sample> {
        self.start_ns = time.start_ns;
        self.calls.reads.fetch_add(1, Ordering::Relaxed);
        let periods = u64::from(time.periods);
        self.calls.periods.fetch_add(periods, Ordering::Relaxed);
        Some(Sample::at(Pose::IDENTITY))
    }
    fn write(&mut self, command: WrenchCommand) {
        self.calls.writes.fetch_add(1, Ordering::Relaxed);
        let is_stale = command.valid_until_ns <= self.start_ns;
        let stale = u64::from(is_stale);
        self.calls.stale.fetch_add(stale, Ordering::Relaxed);
    }
    fn safe_off(&mut self) {
        self.calls.safe_offs.fetch_add(1, Ordering::Relaxed);
    }
}

/// A scene whose device stands on line 5.
fn scene(folder: &Path, device: &str) -> RunArgs {
    let text = format!(
        "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[[probe]]\ndevice = {{ custom = {device} }}\n"
    );
    let path = folder.join("own.toml");
    std::fs::write(&path, text).unwrap();
    RunArgs {
        seconds: Some(0.3),
        record: Some("off".into()),
        ..RunArgs::new(&path, &format!("devices-{}", std::process::id()))
    }
}

#[test]
fn a_custom_device_is_read_and_written_once_a_tick_and_switched_off() {
    let folder = tempfile::tempdir().unwrap();
    let args = scene(
        folder.path(),
        "{ name = \"counted\", port = \"/dev/none\" }",
    );
    let calls = Arc::new(Calls::default());
    let ports = Arc::new(Mutex::new(Vec::new()));
    let registry = {
        let (calls, ports) = (Arc::clone(&calls), Arc::clone(&ports));
        DeviceRegistry::new().with("counted", move |request| {
            let port = request.settings["port"].as_str().unwrap().to_owned();
            ports.lock().unwrap().push((port, request.settings.len()));
            Ok(Box::new(Counted {
                calls: Arc::clone(&calls),
                start_ns: 0,
            }))
        })
    };
    run_with(&registry, &args, &AtomicBool::new(false)).unwrap();
    transport::Domain::new(&args.domain).unwrap().remove_files();
    assert_eq!(*ports.lock().unwrap(), [("/dev/none".to_owned(), 1)]);
    let get = |count: &AtomicU64| count.load(Ordering::Relaxed);
    assert_eq!(get(&calls.reads), get(&calls.writes));
    assert!(get(&calls.periods) >= get(&calls.reads));
    assert!(get(&calls.periods) >= 300, "0.3 s at 1 kHz");
    assert_eq!(get(&calls.stale), 0);
    assert!(get(&calls.safe_offs) >= 1);
}

/// A device that is never asked for anything but this.
struct Unfit(Capabilities);

impl Device for Unfit {
    fn capabilities(&self) -> Capabilities {
        self.0.clone()
    }

    fn read(&mut self, _: TickTime) -> Option<Sample> {
        None
    }

    fn write(&mut self, _: WrenchCommand) {}

    fn safe_off(&mut self) {}
}

type Change = fn(&mut Capabilities);

/// What no device may say of itself, and the words for it.
const FAULTS: [(&str, Change); 5] = [
    ("max_force_n is -1", |of| of.max_force_n = -1.0),
    ("max_force_n is NaN", |of| of.max_force_n = f64::NAN),
    ("position_resolution_m", |of| {
        of.position_resolution_m = f64::NAN
    }),
    ("max_torque_nm is 0", |of| {
        (of.sensed, of.rendered) = (DegreesOfFreedom::Six, DegreesOfFreedom::Six);
    }),
    ("senses 3", |of| {
        (of.rendered, of.max_torque_nm) = (DegreesOfFreedom::Six, 0.1);
    }),
];

#[test]
fn a_device_that_cannot_be_made_is_refused_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |registry: &DeviceRegistry, device: &str| {
        let args = scene(folder.path(), device);
        let stop = AtomicBool::new(false);
        run_with(registry, &args, &stop).unwrap_err().to_string()
    };
    let empty = DeviceRegistry::new();
    let message = refusal(&empty, "{ name = \"absent\" }");
    assert!(
        message.contains("own.toml, line 5: there is no device \"absent\""),
        "{message}"
    );
    assert!(message.contains("simulated"), "{message}");
    let known = DeviceRegistry::new()
        .with("left", |_| Err("it is not plugged in".to_owned()))
        .with("right", |_| Err("it is not plugged in".to_owned()));
    let message = refusal(&known, "{ name = \"absent\" }");
    assert!(
        message.contains("line 5") && message.contains("\"left\", \"right\""),
        "{message}"
    );
    let message = refusal(&known, "{ name = \"left\" }");
    assert!(
        message.contains("line 5") && message.contains("it is not plugged in"),
        "{message}"
    );
    for (fault, change) in FAULTS {
        let unfit = DeviceRegistry::new().with("unfit", move |_| {
            let mut of = Capabilities::translational("unfit", 5.0);
            change(&mut of);
            Ok(Box::new(Unfit(of)))
        });
        let message = refusal(&unfit, "{ name = \"unfit\" }");
        assert!(
            message.contains("line 5") && message.contains(fault),
            "{message}"
        );
    }
    let message = refusal(&known, "{ port = 1 }");
    assert!(
        message.contains("line 5") && message.contains("name"),
        "{message}"
    );
}
