//! The contract between the controller and a force-feedback device.
//!
//! A device senses a pose and renders a wrench. The controller reads it once at the start of a tick
//! and writes to it once at the end, usually 1000 times a second. This crate holds the contract
//! only, so that a driver can be written without the controller.
//!
//! | module | contents |
//! |---|---|
//! | [`device`] | [`Device`]: the trait that a driver implements; [`Capabilities`], [`MotionLimits`], [`SafeStop`] |
//! | [`sample`] | values that cross it: [`Sample`], [`WrenchCommand`], [`TickTime`], [`Intent`] |
//! | [`guard`] | [`GuardedDevice`]: leaves out directions that the device does not have, ends expired commands, switches it off when dropped |
//!
//! # The contract
//! **Threads.** A driver is made on the main thread and moved to the tick thread (`Send`). From
//! then on every call comes from the tick thread, one at a time, except [`SafeStop::stop`], which
//! the shell's watchdog calls when the tick thread is stuck. A driver whose hardware needs a
//! thread of its own (USB, a network) starts one and exchanges the newest values with it without a
//! lock, for example through atomics or a triple buffer.
//!
//! **Timing.** `read` and `write` run inside the period of the loop (1 ms at 1 kHz) under
//! `SCHED_FIFO`. They must not block, sleep, allocate, free, take a lock, print or make system
//! calls that wait. A few microseconds each is usual. All memory is taken in the constructor.
//! Periods may be skipped; [`TickTime::periods`] says how many have passed.
//!
//! **Frames and units.** Poses, velocities and wrenches are in the world frame: metres, radians,
//! seconds, newtons, newton metres. A wrench acts at the position of the pose.
//!
//! **Time.** Nanoseconds on `CLOCK_MONOTONIC`, as `u64`.
//!
//! **Deadman.** A device that senses its hand says so in [`Sample::in_hand`]: its force ramps to
//! zero when no hand holds it, and rises softly when one does again.
//!
//! **Validity.** A [`WrenchCommand`] is valid until a stated time. A driver whose hardware keeps
//! the last command must go to zero by itself at that time: the controller may have died.
//! [`GuardedDevice`] sees to it where the process still runs: it turns the device off at the read
//! that finds the last command expired.
//!
//! **Safe-off.** [`Device::safe_off`] brings the device to zero force, at any time, any number of
//! times, also before the first `write` and during a panic. The shell calls it at the end of a run,
//! and [`GuardedDevice`] calls it when it is dropped.
//!
//! **Plausibility.** The controller rejects and counts samples that are no numbers, or to which no
//! motion within [`MotionLimits`] leads; it holds the last plausible pose instead.
//!
//! **Missing samples.** A `read` that returns `None` has no sample for this period, as of a device
//! slower than the loop: motion is taken to go on. A fault of the hardware is one that goes on
//! returning it: the controller ramps the force down after 20 ms of these. A driver that has no
//! newer sample than in the period before returns `None`, or that one again with its own
//! [`Sample::time_ns`], which tells it: a pose with another time, or with 0, is measured anew, so
//! that the same pose is a device at rest.
//!
//! **Panics.** A driver must not panic.
//!
//! # Example
//! ```
//! use haptic_device::{
//!     Capabilities, Device, GuardedDevice, Pose, Sample, TickTime, Wrench, WrenchCommand,
//! };
//! use glam::DVec3;
//!
//! /// A handle that is fixed 1 mm above the origin.
//! struct Fixed {
//!     force: DVec3,
//! }
//!
//! impl Device for Fixed {
//!     fn capabilities(&self) -> Capabilities {
//!         Capabilities::translational("fixed", 5.0)
//!     }
//!     fn read(&mut self, time: TickTime) -> Option<Sample> {
//!         Some(Sample {
//!             time_ns: time.start_ns,
//!             ..Sample::at(Pose::at(DVec3::Z * 1e-3))
//!         })
//!     }
//!     fn write(&mut self, command: WrenchCommand) {
//!         self.force = command.wrench.force;
//!     }
//!     fn safe_off(&mut self) {
//!         self.force = DVec3::ZERO;
//!     }
//! }
//!
//! let mut device = GuardedDevice::new(Box::new(Fixed { force: DVec3::ZERO }));
//! let sample = device.read(TickTime::default()).unwrap();
//! assert_eq!(sample.pose.position.z, 1e-3);
//! device.write(WrenchCommand::unlimited(Wrench { force: DVec3::Z, torque: DVec3::ZERO }));
//! ```

#![forbid(unsafe_code)]

pub mod device;
pub mod guard;
pub mod sample;

pub use device::{Capabilities, DegreesOfFreedom, Device, MotionLimits, SafeStop};
pub use geometry::{Pose, Wrench};
pub use guard::GuardedDevice;
pub use sample::{COMMAND_VALIDITY_S, Intent, Sample, TickTime, WrenchCommand};
