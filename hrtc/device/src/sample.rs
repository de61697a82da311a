//! Values that cross the contract. World frame, SI units.

use geometry::{Pose, Wrench};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Time of a read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TickTime {
    /// Start of the tick on CLOCK_MONOTONIC, ns; 0 in a simulation without a clock.
    pub start_ns: u64,
    /// Periods since the last read: 1, or more when periods were skipped.
    pub periods: u32,
}

impl Default for TickTime {
    /// One period after the last read, in a simulation without a clock.
    fn default() -> Self {
        Self {
            start_ns: 0,
            periods: 1,
        }
    }
}

/// One measurement of a device.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Time of the measurement on CLOCK_MONOTONIC, ns; of the tick's start for a device without a
    /// clock. A time that is not 0 and was given before is that of no new sample.
    pub time_ns: u64,
    /// Pose of the end effector, metres.
    pub pose: Pose,
    /// Velocity of the end effector, m/s; `None` when the device does not measure it.
    pub linear_velocity: Option<DVec3>,
    /// Angular velocity of the end effector, rad/s; `None` when the device does not measure it.
    pub angular_velocity: Option<DVec3>,
    /// Buttons that are down: bit k for button k.
    pub buttons: u32,
    /// Whether a hand holds the device; `None` when it cannot tell.
    pub in_hand: Option<bool>,
}

impl Sample {
    /// A pose and nothing else: time 0, no velocity, no button.
    #[must_use]
    pub const fn at(pose: Pose) -> Self {
        Self {
            time_ns: 0,
            pose,
            linear_velocity: None,
            angular_velocity: None,
            buttons: 0,
            in_hand: None,
        }
    }
}

/// Time for which a wrench is valid from its write, seconds. Longer than the stalls measured on a
/// busy virtual machine (8, 18, 28 ms); a hand moves a few millimetres in it.
pub const COMMAND_VALIDITY_S: f64 = 0.03;

/// A wrench to render.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrenchCommand {
    /// Force and torque on the hand, at the position of the sample.
    pub wrench: Wrench,
    /// Time on CLOCK_MONOTONIC, ns, from which the wrench must not act any more.
    pub valid_until_ns: u64,
}

impl WrenchCommand {
    /// A command that is valid until the next one: for simulations.
    #[must_use]
    pub const fn unlimited(wrench: Wrench) -> Self {
        Self {
            wrench,
            valid_until_ns: u64::MAX,
        }
    }
}

/// Motion that the path of a scene asks for, at the end of the coming period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intent {
    /// Pose, metres.
    pub pose: Pose,
    /// Velocity, m/s.
    pub velocity: DVec3,
    /// Angular velocity, rad/s.
    pub angular_velocity: DVec3,
}

impl Intent {
    /// At rest at a pose.
    #[must_use]
    pub const fn still(pose: Pose) -> Self {
        Self {
            pose,
            velocity: DVec3::ZERO,
            angular_velocity: DVec3::ZERO,
        }
    }
}
