//! The gate that every force passes: finite, clamped, slew-limited, ramped in and out.

use geometry::Wrench;
use glam::DVec3;
use scene::SafetyPlan;

/// The state of the gate.
#[derive(Debug, Clone)]
pub struct ForceLimiter {
    force: Limit,
    torque: Limit,
    ramp_ticks: f64,
    ramp: f64,
    last: Wrench,
}

/// The most that a force or a torque may be, and change by in a tick.
#[derive(Debug, Clone, Copy)]
struct Limit {
    most: f64,
    step: f64,
}

impl Limit {
    /// Cut to the most, scaled, and no farther from the last than a step; and whether it was cut.
    fn pass(&self, wanted: DVec3, share: f64, last: DVec3) -> (DVec3, bool) {
        let size = wanted.length();
        let cut = size > self.most;
        let limited = if cut {
            wanted * (self.most / size)
        } else {
            wanted
        };
        let target = limited * share;
        let step = target - last;
        let length = step.length();
        let mut passed = if length > self.step {
            last + step * (self.step / length)
        } else {
            target
        };
        // Between two vectors inside the ball of the maximum every vector is inside; rounding is not.
        let size = passed.length();
        if size > self.most {
            passed *= self.most / size * (1.0 - f64::EPSILON);
        }
        (passed, cut)
    }
}

/// What the gate let through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitedWrench {
    /// The wrench for the device.
    pub wrench: Wrench,
    /// Whether force or torque was cut to its maximum, or was not finite.
    pub clamped: bool,
}

impl ForceLimiter {
    /// A closed gate; `device_max_n` is what the device can render.
    #[must_use]
    pub fn new(plan: SafetyPlan, device_max_n: f64, rate_hz: f64) -> Self {
        let force = Limit {
            most: plan.force_max_n.min(device_max_n),
            step: plan.slew_n_per_s / rate_hz,
        };
        let torque = Limit {
            most: plan.torque_max_nm,
            step: force.step * (plan.torque_max_nm / plan.force_max_n),
        };
        Self {
            force,
            torque,
            ramp_ticks: (plan.ramp_s * rate_hz).max(1.0),
            ramp: 0.0,
            last: Wrench::ZERO,
        }
    }

    /// Largest force, newtons.
    #[must_use]
    pub fn force_max(&self) -> f64 {
        self.force.most
    }

    /// One tick. `open` ramps up over the soft start; otherwise the wrench ramps down to nothing.
    ///
    /// A wrench that is not finite counts as none.
    pub fn pass(&mut self, wanted: Wrench, open: bool) -> LimitedWrench {
        let change = 1.0 / self.ramp_ticks;
        self.ramp = (self.ramp + if open { change } else { -change }).clamp(0.0, 1.0);
        let finite = wanted.is_finite();
        let wanted = if finite { wanted } else { Wrench::ZERO };
        let (force, force_cut) = self.force.pass(wanted.force, self.ramp, self.last.force);
        let (torque, torque_cut) = self.torque.pass(wanted.torque, self.ramp, self.last.torque);
        self.last = Wrench { force, torque };
        LimitedWrench {
            wrench: self.last,
            clamped: force_cut || torque_cut || !finite,
        }
    }

    /// Whether the ramp down has ended.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.ramp == 0.0 && self.last == Wrench::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3Swizzles;
    use proptest::prelude::*;

    const PLAN: SafetyPlan = SafetyPlan {
        force_max_n: 8.0,
        torque_max_nm: 0.4,
        slew_n_per_s: 500.0,
        ramp_s: 0.1,
        passivity: false,
    };

    proptest! {
        #[test]
        fn every_force_and_torque_is_finite_clamped_and_slew_limited(
            forces in prop::collection::vec(prop::array::uniform3(
                prop_oneof![-1e3..1e3f64, Just(f64::NAN), Just(f64::INFINITY), Just(f64::MAX)]), 1..300),
        ) {
            let mut gate = ForceLimiter::new(PLAN, 10.0, 1000.0);
            let mut last = Wrench::ZERO;
            for f in forces {
                let wanted = Wrench { force: DVec3::from_array(f), torque: DVec3::from_array(f).zxy() };
                let Wrench { force, torque } = gate.pass(wanted, true).wrench;
                prop_assert!(force.is_finite() && torque.is_finite());
                prop_assert!(force.length() <= 8.0 && torque.length() <= 0.4);
                prop_assert!(force.distance(last.force) <= 0.5 * (1.0 + 1e-12));
                prop_assert!(torque.distance(last.torque) <= 0.025 * (1.0 + 1e-12));
                last = Wrench { force, torque };
            }
            for _ in 0..200 {
                gate.pass(Wrench::ZERO, false);
            }
            prop_assert!(gate.is_closed());
        }
    }
}
