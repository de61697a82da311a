//! A device in a process of its own: a page of memory that the controller's driver and the device
//! share, so that a controller that dies in any way leaves its last wrench behind.
//!
//! The device renders the wrench that stands in the page as long as it is valid, looking once a
//! millisecond, as the firmware of a device does.

use super::stamped_device::{self, StampedDevice};
use super::stop::is_set;
use crate::failure::Failure;
use clap::Args;
use haptic_device::{Capabilities, Device, Intent, SafeStop, Sample, TickTime, WrenchCommand};
use hrtc::devices::{DeviceRegistry, DeviceRequest};
use memmap2::MmapRaw;
use realtime::pacer::Pacer;
use realtime::rights::{monotonic_ns, obtain};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Name in a scene: `device = { custom = { name = "page", file = "FILE" } }`.
pub const NAME: &str = "page";
/// Limit of the device's force, newtons: that of a small desktop device.
const MAX_FORCE_N: f64 = 10.0;
/// Looks of the device a second.
const RATE_HZ: f64 = 1000.0;
/// SCHED_FIFO priority of the device: above the controller's, whose lateness it is to show.
const PRIORITY: i32 = 90;

/// Numbers of the page, 8 bytes each.
#[derive(Debug, Clone, Copy)]
enum Cell {
    /// Written by the driver: the commanded force, newtons, as bits.
    Force,
    /// Written by the driver: the end of its validity on CLOCK_MONOTONIC, ns.
    ValidUntil,
    /// Written by the supervisor: whether the driver is to panic.
    Panic,
    /// Written by the device: the rendered force, newtons, as bits.
    Rendered,
    /// Written by the device: the time of its last look on CLOCK_MONOTONIC, ns.
    Looked,
    /// Written by the device: the time at which the force became zero; 0 while there is one.
    ZeroSince,
    /// Written by the device: the end of the validity of the last wrench that it rendered.
    LastValidUntil,
    /// One past the last.
    Count,
}

/// The page.
#[derive(Debug)]
pub struct DevicePage {
    memory: MmapRaw,
}

impl DevicePage {
    /// Makes the file of a page with zeros in it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let file = File::create(path)?;
        file.set_len((Cell::Count as usize * size_of::<u64>()) as u64)?;
        Self::open(path)
    }

    /// Maps the file of a page.
    ///
    /// # Errors
    /// When there is no such file, or it is too short.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::options().read(true).write(true).open(path)?;
        let memory = MmapRaw::map_raw(&file)?;
        if memory.len() < Cell::Count as usize * size_of::<u64>() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(Self { memory })
    }

    fn cell(&self, cell: Cell) -> &AtomicU64 {
        let words = self.memory.as_mut_ptr().cast::<u64>();
        // SAFETY: a mapping begins at a page, so every word is aligned; `open` saw that it holds
        // all cells; it lives as long as `self`; all processes use its words as atomics only, and
        // the file is not cut.
        unsafe { AtomicU64::from_ptr(words.add(cell as usize)) }
    }

    fn get(&self, cell: Cell) -> u64 {
        self.cell(cell).load(Ordering::Acquire)
    }

    fn set(&self, cell: Cell, value: u64) {
        self.cell(cell).store(value, Ordering::Release);
    }

    /// The force that the device renders, newtons.
    #[must_use]
    pub fn rendered_n(&self) -> f64 {
        f64::from_bits(self.get(Cell::Rendered))
    }

    /// Time of the device's last look on CLOCK_MONOTONIC, ns; 0 before the first.
    #[must_use]
    pub fn looked_ns(&self) -> u64 {
        self.get(Cell::Looked)
    }

    /// Time at which the force became zero on CLOCK_MONOTONIC, ns, and the end of the validity of
    /// the last wrench before; `None` while there is a force, or was none yet.
    #[must_use]
    pub fn zero_since_ns(&self) -> Option<(u64, u64)> {
        let since = self.get(Cell::ZeroSince);
        (since > 0).then(|| (since, self.get(Cell::LastValidUntil)))
    }

    /// Has the driver panic in its next read, or not any more.
    pub fn set_panic(&self, on: bool) {
        self.set(Cell::Panic, u64::from(on));
    }

    /// Forgets the last command, as a device that is switched off and on.
    pub fn reset(&self) {
        self.set(Cell::Force, 0);
        self.set(Cell::ValidUntil, 0);
        self.set_panic(false);
    }

    /// One look of the device.
    fn look(&self, now: u64) {
        let valid_until = self.get(Cell::ValidUntil);
        let force = f64::from_bits(self.get(Cell::Force));
        let before = self.rendered_n();
        let rendered = if now < valid_until { force } else { 0.0 };
        if rendered != 0.0 {
            self.set(Cell::LastValidUntil, valid_until);
            self.set(Cell::ZeroSince, 0);
        } else if before != 0.0 {
            self.set(Cell::ZeroSince, now);
        }
        self.set(Cell::Rendered, rendered.to_bits());
        self.set(Cell::Looked, now);
    }
}

/// The driver: at the pose that the scene's path asks for, as stiff as can be.
struct PageDevice {
    page: Arc<DevicePage>,
    intent: Option<Intent>,
}

/// Zero force from the controller's watchdog.
struct PageStop(Arc<DevicePage>);

impl SafeStop for PageStop {
    fn stop(&self) {
        self.0.set(Cell::Force, 0);
    }
}

impl Device for PageDevice {
    fn capabilities(&self) -> Capabilities {
        Capabilities::translational(NAME, MAX_FORCE_N)
    }

    fn read(&mut self, time: TickTime) -> Option<Sample> {
        assert!(
            self.page.get(Cell::Panic) == 0,
            "the test asked the driver to panic"
        );
        let intent = self.intent?;
        Some(Sample {
            time_ns: time.start_ns,
            ..Sample::at(intent.pose)
        })
    }

    fn write(&mut self, command: WrenchCommand) {
        // The end first: a new force never stands with an old end that is later.
        self.page.set(Cell::ValidUntil, command.valid_until_ns);
        let force = command.wrench.force.length();
        self.page.set(Cell::Force, force.to_bits());
    }

    fn safe_off(&mut self) {
        self.page.set(Cell::Force, 0);
    }

    fn safe_stop(&self) -> Option<Box<dyn SafeStop>> {
        Some(Box::new(PageStop(Arc::clone(&self.page))))
    }

    fn intend(&mut self, intent: Intent) {
        self.intent = Some(intent);
    }
}

/// The devices of the controller's role: a scene may name that of a page, or one with stamps.
#[must_use]
pub fn registry() -> DeviceRegistry {
    let registry = DeviceRegistry::new().with(stamped_device::NAME, |request| {
        Ok(Box::new(StampedDevice::of_request(request)?))
    });
    registry.with(NAME, |request: &DeviceRequest<'_>| {
        let file = request.settings.get("file").and_then(|file| file.as_str());
        let file = file.ok_or("its settings need file = \"FILE\"")?;
        let page = DevicePage::open(Path::new(file)).map_err(|error| format!("{file}: {error}"))?;
        Ok(Box::new(PageDevice {
            page: Arc::new(page),
            intent: None,
        }))
    })
}

/// What the device's role is told.
#[derive(Debug, Args)]
pub struct DeviceArgs {
    /// File of the page.
    pub page: PathBuf,
}

/// The device, until `stop` is set.
///
/// # Errors
/// When there is no such page.
pub fn device(args: &DeviceArgs, stop: &AtomicBool) -> Result<(), Failure> {
    let page = DevicePage::open(&args.page)
        .map_err(|error| Failure::Input(format!("{}: {error}", args.page.display())))?;
    // Without the right it is only later, which shows.
    let _rights = obtain(None, PRIORITY);
    let mut pacer = Pacer::new(RATE_HZ, 0);
    while !is_set(stop) {
        pacer.wait();
        page.look(monotonic_ns());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Wrench;
    use glam::DVec3;

    #[test]
    fn the_device_renders_a_wrench_as_long_as_it_is_valid_and_notes_when_it_ceased() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page");
        let page = DevicePage::create(&path).unwrap();
        let mut driver = PageDevice {
            page: Arc::new(DevicePage::open(&path).unwrap()),
            intent: None,
        };
        page.look(10);
        assert_eq!((page.rendered_n(), page.zero_since_ns()), (0.0, None));
        let wrench = Wrench {
            force: DVec3::X * 2.0,
            ..Wrench::ZERO
        };
        driver.write(WrenchCommand {
            wrench,
            valid_until_ns: 100,
        });
        page.look(99);
        assert_eq!((page.rendered_n(), page.zero_since_ns()), (2.0, None));
        page.look(103);
        page.look(104);
        assert_eq!(page.rendered_n(), 0.0);
        assert_eq!(page.zero_since_ns(), Some((103, 100)));
        driver.write(WrenchCommand::unlimited(wrench));
        page.look(105);
        driver.safe_off();
        page.look(106);
        assert_eq!(page.zero_since_ns(), Some((106, u64::MAX)));
    }

    #[test]
    fn a_page_that_is_too_short_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page");
        std::fs::write(&path, [0; 20]).unwrap();
        assert!(DevicePage::open(&path).is_err());
    }
}
