//! Devices: what moves a probe and feels the force.

mod simulated;

pub use simulated::{Intent, Simulated};

use geometry::{Pose, Wrench};

/// What a device measured at the start of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Pose of its end effector, world, metres.
    pub pose: Pose,
}

/// What a device can do.
#[derive(Debug, Clone, PartialEq)]
pub struct Capabilities {
    /// Name for reports.
    pub name: String,
    /// Largest continuous force, newtons.
    pub force_max_n: f64,
    /// Encoder step, metres; 0 when not quantised.
    pub encoder_m: f64,
    /// Whether it renders torque.
    pub torque: bool,
}

/// A force-feedback device, read and written once a tick from the real-time thread.
///
/// Neither call may block, allocate or take a lock.
pub trait Device: Send {
    /// What it can do; asked once at start.
    fn capabilities(&self) -> Capabilities;
    /// The pose now; `None` when the device gave none this period.
    ///
    /// `periods` have gone by since the last call: 1, or more when periods were missed.
    fn read(&mut self, periods: u32) -> Option<Sample>;
    /// The wrench that acts until the next call.
    fn write(&mut self, wrench: Wrench);
}
