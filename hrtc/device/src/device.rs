//! The trait that a driver implements.

use crate::sample::{Intent, Sample, TickTime, WrenchCommand};

/// Number of directions that a device senses or renders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DegreesOfFreedom {
    /// Translation only.
    Three,
    /// Translation and rotation.
    Six,
}

/// Limits of an end effector's motion. A sample to which no motion within them leads is no motion
/// but a fault of the measurement: the controller rejects it. May be infinite.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MotionLimits {
    /// Limit of the speed, m/s.
    pub speed_m_per_s: f64,
    /// Limit of the acceleration, m/s².
    pub acceleration_m_per_s2: f64,
    /// Limit of the angular speed, rad/s.
    pub angular_speed_rad_per_s: f64,
}

impl MotionLimits {
    /// What no hand exceeds that holds a handle: 20 m/s is twice the speed of a thrown fist,
    /// 2000 m/s² what 200 N do to a handle of 0.1 kg, 100 rad/s 16 turns a second.
    pub const HAND: Self = Self {
        speed_m_per_s: 20.0,
        acceleration_m_per_s2: 2000.0,
        angular_speed_rad_per_s: 100.0,
    };

    /// No limit: every pose whose numbers are usable is a motion.
    pub const UNLIMITED: Self = Self {
        speed_m_per_s: f64::INFINITY,
        acceleration_m_per_s2: f64::INFINITY,
        angular_speed_rad_per_s: f64::INFINITY,
    };
}

/// Abilities and limits of a device. Limits may be infinite, resolutions may be 0; none is NaN.
#[derive(Debug, Clone, PartialEq)]
pub struct Capabilities {
    /// Name for reports.
    pub name: String,
    /// Sensed directions. With [`DegreesOfFreedom::Three`] the orientation of a sample is ignored.
    pub sensed: DegreesOfFreedom,
    /// Rendered directions. With [`DegreesOfFreedom::Three`] every commanded torque is 0.
    pub rendered: DegreesOfFreedom,
    /// Limit of the continuous force, newtons.
    pub max_force_n: f64,
    /// Limit of the continuous torque, newton metres.
    pub max_torque_nm: f64,
    /// Limits of the end effector's motion: a sample beyond them is not rendered.
    pub motion: MotionLimits,
    /// Step of the measured position, metres. Motion within it does no work.
    pub position_resolution_m: f64,
    /// Step of the measured orientation, radians. A turn within it does no work.
    pub orientation_resolution_rad: f64,
}

impl Capabilities {
    /// What is wrong with them, in words; `None` where a device may be used with them.
    #[must_use]
    pub fn fault(&self) -> Option<String> {
        let is_six = |of: DegreesOfFreedom| of == DegreesOfFreedom::Six;
        let MotionLimits {
            speed_m_per_s,
            acceleration_m_per_s2,
            angular_speed_rad_per_s,
        } = self.motion;
        let above_0 = [
            ("max_force_n", self.max_force_n, true),
            ("max_torque_nm", self.max_torque_nm, is_six(self.rendered)),
            ("motion.speed_m_per_s", speed_m_per_s, true),
            ("motion.acceleration_m_per_s2", acceleration_m_per_s2, true),
            (
                "motion.angular_speed_rad_per_s",
                angular_speed_rad_per_s,
                is_six(self.sensed),
            ),
        ];
        let not_below_0 = [
            ("position_resolution_m", self.position_resolution_m),
            (
                "orientation_resolution_rad",
                self.orientation_resolution_rad,
            ),
        ];
        let limit = above_0
            .into_iter()
            .find(|&(_, limit, counts)| counts && (limit.is_nan() || limit <= 0.0));
        let step = not_below_0
            .into_iter()
            .find(|&(_, step)| !(step >= 0.0 && step.is_finite()));
        if let Some((name, limit, _)) = limit {
            return Some(format!("its {name} is {limit}, and has to be above 0"));
        }
        if let Some((name, step)) = step {
            return Some(format!("its {name} is {step}, and has to be 0 or more"));
        }
        (is_six(self.rendered) && !is_six(self.sensed)).then(|| {
            "it renders 6 degrees of freedom and senses 3: the work of a torque is not known without the turn"
                .to_owned()
        })
    }

    /// A device that senses and renders translation only, with exact measurements and the motion of
    /// a hand.
    #[must_use]
    pub fn translational(name: &str, max_force_n: f64) -> Self {
        Self {
            name: name.to_owned(),
            sensed: DegreesOfFreedom::Three,
            rendered: DegreesOfFreedom::Three,
            max_force_n,
            max_torque_nm: 0.0,
            motion: MotionLimits::HAND,
            position_resolution_m: 0.0,
            orientation_resolution_rad: 0.0,
        }
    }
}

/// Zero force from outside the tick thread, when the tick does not answer any more.
pub trait SafeStop: Send {
    /// Brings the device to zero force until the next [`Device::write`]. Called from any one
    /// thread, any number of times, while the tick thread may be in any call of the driver, also in
    /// one that never ends; so it waits for no lock that such a call holds. Must not panic.
    fn stop(&self);
}

/// A force-feedback device. The contract of every method is on the page of the crate.
pub trait Device: Send {
    /// Abilities and limits. Called at start, off the tick; must not change.
    fn capabilities(&self) -> Capabilities;

    /// The newest sample; `None` when the device has none for this period. What this and `write`
    /// take, by work or by waiting, comes off the time that a tick has for contacts.
    fn read(&mut self, time: TickTime) -> Option<Sample>;

    /// Renders a wrench until the next call or the end of its validity.
    fn write(&mut self, command: WrenchCommand);

    /// Brings the device to zero force. Callable at any time, any number of times, also from `Drop`
    /// while a panic unwinds; must not panic.
    fn safe_off(&mut self);

    /// A handle that brings the device to zero force from another thread; `None` when the driver
    /// has none, and relies on the validity of its commands alone. Called once, at start.
    fn safe_stop(&self) -> Option<Box<dyn SafeStop>> {
        None
    }

    /// Takes the motion that the scene's path asks for, before each `read`. For devices that a
    /// program moves; a device in a real hand ignores it.
    fn intend(&mut self, _intent: Intent) {}
}
