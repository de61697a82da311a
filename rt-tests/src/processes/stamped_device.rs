//! The simulated device of a scene in a real loop, with stamps: when each sample was read and each
//! wrench written, and what they were.
//!
//! To every sample it adds a dither, smaller than an encoder's step, at random. The wrench that
//! answers to the dither of a sample tells in which tick it was made, whatever the path.

use geometry::Wrench;
use glam::DVec3;
use haptic_device::{Capabilities, Device, Intent, Sample, TickTime, WrenchCommand};
use hrtc::devices::DeviceRequest;
use realtime::rights::monotonic_ns;
use scene::{Overrides, load};
use scene_files::DiskFiles;
use simulated_device::SimulatedDevice;
use std::io;
use std::path::{Path, PathBuf};

/// Name in a scene: `device = { custom = { name = "stamped", scene = "FILE", stamps = "FILE" } }`;
/// the device is that of the first probe of the scene.
pub const NAME: &str = "stamped";
/// Size of the dither along each axis, metres: half a step of the default encoder.
pub const DITHER_M: f64 = 5e-6;
/// Seconds of a run whose stamps are kept, from its start: the room for them is locked in memory.
const ROOM_S: f64 = 300.0;

/// A tick as its device saw it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamp {
    /// Time of the read on CLOCK_MONOTONIC, ns.
    pub read_ns: u64,
    /// Time of the write, ns.
    pub write_ns: u64,
    /// What was added to the position, metres.
    pub dither: DVec3,
    /// Force written, newtons.
    pub force: DVec3,
}

/// Bytes of a stamp in the file.
const STAMP_BYTES: usize = 64;

impl Stamp {
    fn words(&self) -> [u64; 8] {
        let numbers = [self.dither, self.force].map(|of| of.to_array().map(f64::to_bits));
        let [[a, b, c], [d, e, f]] = numbers;
        [self.read_ns, self.write_ns, a, b, c, d, e, f]
    }

    fn of_words([read_ns, write_ns, a, b, c, d, e, f]: [u64; 8]) -> Self {
        let vector = |words: [u64; 3]| DVec3::from_array(words.map(f64::from_bits));
        Self {
            read_ns,
            write_ns,
            dither: vector([a, b, c]),
            force: vector([d, e, f]),
        }
    }
}

/// The stamps in a file.
///
/// # Errors
/// When it cannot be read.
pub fn read_stamps(file: &Path) -> io::Result<Vec<Stamp>> {
    let bytes = std::fs::read(file)?;
    let stamps = bytes.chunks_exact(STAMP_BYTES).map(|stamp| {
        let mut words = [0; 8];
        for (word, bytes) in words.iter_mut().zip(stamp.chunks_exact(8)) {
            *word = u64::from_le_bytes(std::array::from_fn(|k| bytes[k]));
        }
        Stamp::of_words(words)
    });
    Ok(stamps.collect())
}

/// See the module. It writes its stamps when it is dropped.
#[derive(Debug)]
pub struct StampedDevice {
    device: SimulatedDevice,
    stamps: Vec<Stamp>,
    /// Read, and not yet written.
    open: Option<Stamp>,
    random: u64,
    file: PathBuf,
}

impl StampedDevice {
    /// The device that a scene's table asks for.
    ///
    /// # Errors
    /// One sentence when a setting is missing, or the scene is refused.
    pub fn of_request(request: &DeviceRequest<'_>) -> Result<Self, String> {
        let text = |key: &str| {
            let value = request.settings.get(key).and_then(|value| value.as_str());
            value.ok_or(format!("its settings need {key} = \"FILE\""))
        };
        let scene = Path::new(text("scene")?);
        let plan = load(scene, &Overrides::default(), &DiskFiles);
        let plan = plan.map_err(|error| error.to_string())?;
        Ok(Self {
            device: SimulatedDevice::new(plan.probes[0].device, request.period_s),
            stamps: Vec::with_capacity((ROOM_S / request.period_s) as usize),
            open: None,
            random: 1,
            file: text("stamps")?.into(),
        })
    }

    /// One of eight directions (splitmix64).
    fn dither(&mut self) -> DVec3 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.random;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        let side = |axis: u32| {
            if z >> (40 + axis) & 1 == 1 {
                DITHER_M
            } else {
                -DITHER_M
            }
        };
        DVec3::new(side(0), side(1), side(2))
    }
}

impl Device for StampedDevice {
    fn capabilities(&self) -> Capabilities {
        self.device.capabilities()
    }

    fn read(&mut self, time: TickTime) -> Option<Sample> {
        let mut sample = self.device.read(time)?;
        let dither = self.dither();
        sample.pose.position += dither;
        self.open = Some(Stamp {
            read_ns: monotonic_ns(),
            write_ns: 0,
            dither,
            force: DVec3::ZERO,
        });
        Some(sample)
    }

    fn write(&mut self, command: WrenchCommand) {
        self.device.write(command);
        let Wrench { force, .. } = command.wrench;
        let has_room = self.stamps.len() < self.stamps.capacity();
        if let Some(open) = self.open.take().filter(|_| has_room) {
            self.stamps.push(Stamp {
                write_ns: monotonic_ns(),
                force,
                ..open
            });
        }
    }

    fn safe_off(&mut self) {
        self.device.safe_off();
    }

    fn intend(&mut self, intent: Intent) {
        self.device.intend(intent);
    }
}

impl Drop for StampedDevice {
    fn drop(&mut self) {
        let words = self.stamps.iter().flat_map(Stamp::words);
        let bytes: Vec<u8> = words.flat_map(u64::to_le_bytes).collect();
        // A file that is missing or short is noticed by its reader.
        let _ = std::fs::write(&self.file, bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use scene::SimulatedDevicePlan;

    #[test]
    fn stamps_are_kept_in_order_and_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stamps");
        let mut device = StampedDevice {
            device: SimulatedDevice::new(SimulatedDevicePlan::default(), 1e-3),
            stamps: Vec::with_capacity(3),
            open: None,
            random: 1,
            file: file.clone(),
        };
        assert!(device.read(TickTime::default()).is_none());
        let wrench = |force: f64| Wrench {
            force: DVec3::X * force,
            ..Wrench::ZERO
        };
        device.write(WrenchCommand::unlimited(wrench(1.0)));
        assert!(device.stamps.is_empty(), "nothing was read");
        device.intend(Intent::still(Pose::IDENTITY));
        for force in 0..5 {
            let sample = device.read(TickTime::default()).unwrap();
            let apart = sample.pose.position - device.device.sample().pose.position;
            assert!((apart.abs() - DITHER_M).abs().max_element() < 1e-12);
            device.write(WrenchCommand::unlimited(wrench(f64::from(force))));
        }
        let kept = device.stamps.clone();
        drop(device);
        assert_eq!(read_stamps(&file).unwrap(), kept);
        let forces: Vec<f64> = kept.iter().map(|of| of.force.x).collect();
        assert_eq!(forces, [0.0, 1.0, 2.0], "no more than there is room for");
        assert!(kept.iter().all(|of| of.write_ns >= of.read_ns));
    }
}
