//! A device that is given and gives only the directions that it has, and that is switched off when
//! it is dropped.

use crate::device::{Capabilities, DegreesOfFreedom, Device, SafeStop};
use crate::sample::{Intent, Sample, TickTime, WrenchCommand};
use glam::{DQuat, DVec3};

/// Owner of a device: leaves out the directions that its [`Capabilities`] say it does not sense or
/// render, ends a command at the first read after its validity, and calls [`Device::safe_off`] when
/// it is dropped. It checks no limits of force and motion: the controller keeps to them.
pub struct GuardedDevice {
    device: Box<dyn Device>,
    capabilities: Capabilities,
    /// End of the last command's validity, ns; `None` when none stands.
    valid_until_ns: Option<u64>,
    expired: u64,
}

impl GuardedDevice {
    /// Takes the device over.
    #[must_use]
    pub fn new(device: Box<dyn Device>) -> Self {
        Self {
            capabilities: device.capabilities(),
            device,
            valid_until_ns: None,
            expired: 0,
        }
    }

    /// Abilities and limits as the device stated them at start.
    #[must_use]
    pub fn capabilities(&self) -> &Capabilities {
        &self.capabilities
    }

    /// Commands that expired before the next one came.
    #[must_use]
    pub fn expired_commands(&self) -> u64 {
        self.expired
    }

    /// The device's handle for another thread, if it has one.
    #[must_use]
    pub fn safe_stop(&self) -> Option<Box<dyn SafeStop>> {
        self.device.safe_stop()
    }

    /// Passes the scene's intent on.
    pub fn intend(&mut self, intent: Intent) {
        self.device.intend(intent);
    }

    /// The device's sample as it is; its orientation is the identity where the device does not
    /// sense it. The controller judges whether it is plausible. A command that has expired by then
    /// is ended.
    pub fn read(&mut self, time: TickTime) -> Option<Sample> {
        // Not before the read: a simulated device needs the command for the periods in which it
        // was still valid.
        let sample = self.device.read(time);
        self.end_expired(time.start_ns);
        let mut sample = sample?;
        if self.capabilities.sensed == DegreesOfFreedom::Three {
            sample.pose.orientation = DQuat::IDENTITY;
        }
        Some(sample)
    }

    /// Sends a wrench; its torque is 0 where the device does not render it.
    pub fn write(&mut self, mut command: WrenchCommand) {
        if self.capabilities.rendered == DegreesOfFreedom::Three {
            command.wrench.torque = DVec3::ZERO;
        }
        self.valid_until_ns = Some(command.valid_until_ns);
        self.device.write(command);
    }

    /// Brings the device to zero force.
    pub fn safe_off(&mut self) {
        self.valid_until_ns = None;
        self.device.safe_off();
    }

    /// Turns the device off when its last command ceased to be valid before `now_ns`
    /// (CLOCK_MONOTONIC). Whether it did.
    pub fn end_expired(&mut self, now_ns: u64) -> bool {
        let has_expired = self.valid_until_ns.is_some_and(|until| until <= now_ns);
        if has_expired {
            self.expired += 1;
            self.safe_off();
        }
        has_expired
    }
}

impl Drop for GuardedDevice {
    fn drop(&mut self) {
        self.device.safe_off();
    }
}

impl std::fmt::Debug for GuardedDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GuardedDevice")
            .field("capabilities", &self.capabilities)
            .field("valid_until_ns", &self.valid_until_ns)
            .field("expired", &self.expired)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Pose, Wrench};
    use std::sync::{Arc, Mutex};

    #[derive(Default)]
    struct Log {
        commands: Vec<Wrench>,
        safe_offs: u32,
    }

    struct Logged {
        capabilities: Capabilities,
        next: Sample,
        log: Arc<Mutex<Log>>,
    }

    impl Device for Logged {
        fn capabilities(&self) -> Capabilities {
            self.capabilities.clone()
        }
        fn read(&mut self, time: TickTime) -> Option<Sample> {
            Some(Sample {
                time_ns: time.start_ns,
                ..self.next
            })
        }
        fn write(&mut self, command: WrenchCommand) {
            self.log.lock().unwrap().commands.push(command.wrench);
        }
        fn safe_off(&mut self) {
            self.log.lock().unwrap().safe_offs += 1;
        }
        fn intend(&mut self, intent: Intent) {
            self.next.pose = intent.pose;
        }
    }

    fn guarded(capabilities: Capabilities) -> (GuardedDevice, Arc<Mutex<Log>>) {
        let log = Arc::new(Mutex::new(Log::default()));
        let device = Logged {
            capabilities,
            next: Sample::at(Pose::IDENTITY),
            log: Arc::clone(&log),
        };
        (GuardedDevice::new(Box::new(device)), log)
    }

    fn six() -> Capabilities {
        Capabilities {
            sensed: DegreesOfFreedom::Six,
            rendered: DegreesOfFreedom::Six,
            max_torque_nm: 1.0,
            ..Capabilities::translational("six", 5.0)
        }
    }

    const WRENCH: Wrench = Wrench {
        force: DVec3::X,
        torque: DVec3::Y,
    };

    #[test]
    fn a_dropped_device_is_switched_off_also_by_a_panic() {
        let (device, log) = guarded(six());
        drop(device);
        assert_eq!(log.lock().unwrap().safe_offs, 1);
        let (device, log) = guarded(six());
        let thread = std::thread::spawn(move || {
            let _device = device;
            std::panic::resume_unwind(Box::new(()));
        });
        assert!(thread.join().is_err());
        assert_eq!(log.lock().unwrap().safe_offs, 1);
    }

    #[test]
    fn an_expired_command_is_ended_once_before_the_next_sample() {
        let (mut device, log) = guarded(six());
        let read = |device: &mut GuardedDevice, start_ns: u64| {
            let time = TickTime {
                start_ns,
                periods: 1,
            };
            assert!(device.read(time).is_some());
        };
        read(&mut device, 1_000_000);
        device.write(WrenchCommand {
            wrench: WRENCH,
            valid_until_ns: 31_000_000,
        });
        read(&mut device, 30_999_999);
        assert_eq!(log.lock().unwrap().safe_offs, 0, "still valid");
        read(&mut device, 31_000_000);
        read(&mut device, 32_000_000);
        assert_eq!(log.lock().unwrap().safe_offs, 1);
        assert_eq!(device.expired_commands(), 1);
        assert!(!device.end_expired(u64::MAX), "none stands");
    }

    #[test]
    fn torque_is_masked_for_a_device_that_renders_three() {
        let (mut device, log) = guarded(Capabilities::translational("three", 5.0));
        device.write(WrenchCommand::unlimited(WRENCH));
        let masked = Wrench {
            torque: DVec3::ZERO,
            ..WRENCH
        };
        assert_eq!(log.lock().unwrap().commands, [masked]);
        let (mut device, log) = guarded(six());
        device.write(WrenchCommand::unlimited(WRENCH));
        assert_eq!(log.lock().unwrap().commands, [WRENCH]);
    }

    #[test]
    fn orientation_is_ignored_where_it_is_not_sensed() {
        let turned = Pose {
            position: DVec3::ZERO,
            orientation: DQuat::from_rotation_x(1.0),
        };
        let intent = Intent::still(turned);
        for (capabilities, expected) in [
            (Capabilities::translational("three", 5.0), DQuat::IDENTITY),
            (six(), turned.orientation),
        ] {
            let (mut device, _log) = guarded(capabilities);
            device.intend(intent);
            let sample = device.read(TickTime::default()).unwrap();
            assert_eq!(sample.pose.orientation, expected);
        }
    }
}
