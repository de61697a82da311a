//! The gate that every force passes: finite, clamped, slew-limited, ramped in and out.

use shared::geometry::Wrench;
use shared::scene::SafetyPlan;

/// The state of the gate.
#[derive(Debug, Clone)]
pub struct Gate {
    force_max: f64,
    /// Largest change a tick, newtons.
    step_max: f64,
    ramp_ticks: f64,
    ramp: f64,
    last: Wrench,
}

/// What the gate let through.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gated {
    /// The wrench for the device.
    pub wrench: Wrench,
    /// Whether the force was cut to its maximum, or was not finite.
    pub clamped: bool,
}

impl Gate {
    /// A closed gate; `device_max_n` is what the device can render.
    #[must_use]
    pub fn new(plan: SafetyPlan, device_max_n: f64, rate_hz: f64) -> Self {
        Self {
            force_max: plan.force_max_n.min(device_max_n),
            step_max: plan.slew_n_per_s / rate_hz,
            ramp_ticks: (plan.ramp_s * rate_hz).max(1.0),
            ramp: 0.0,
            last: Wrench::ZERO,
        }
    }

    /// Largest force, newtons.
    #[must_use]
    pub fn force_max(&self) -> f64 {
        self.force_max
    }

    /// One tick. `open` ramps up over the soft start; otherwise the force ramps down to nothing.
    ///
    /// A wrench that is not finite counts as none. Torque passes when finite: no probe of this version
    /// renders one.
    pub fn pass(&mut self, wanted: Wrench, open: bool) -> Gated {
        let change = 1.0 / self.ramp_ticks;
        self.ramp = (self.ramp + if open { change } else { -change }).clamp(0.0, 1.0);
        let finite = wanted.is_finite();
        let wanted = if finite { wanted } else { Wrench::ZERO };
        let size = wanted.force.length();
        let clamped = size > self.force_max;
        let limited = if clamped {
            wanted.force * (self.force_max / size)
        } else {
            wanted.force
        };
        let target = limited * self.ramp;
        let step = target - self.last.force;
        let length = step.length();
        let mut force = if length > self.step_max {
            self.last.force + step * (self.step_max / length)
        } else {
            target
        };
        // Between two forces inside the ball of the maximum every force is inside; rounding is not.
        let size = force.length();
        if size > self.force_max {
            force *= self.force_max / size * (1.0 - f64::EPSILON);
        }
        self.last = Wrench {
            force,
            torque: wanted.torque * self.ramp,
        };
        Gated {
            wrench: self.last,
            clamped: clamped || !finite,
        }
    }

    /// Whether the ramp down has ended.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.ramp == 0.0 && self.last.force.length() == 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    const PLAN: SafetyPlan = SafetyPlan {
        force_max_n: 8.0,
        slew_n_per_s: 500.0,
        ramp_s: 0.1,
        passivity: false,
    };

    proptest! {
        #[test]
        fn every_force_is_finite_clamped_and_slew_limited(
            forces in prop::collection::vec(prop::array::uniform3(
                prop_oneof![-1e3..1e3f64, Just(f64::NAN), Just(f64::INFINITY), Just(f64::MAX)]), 1..300),
        ) {
            let mut gate = Gate::new(PLAN, 10.0, 1000.0);
            let mut last = DVec3::ZERO;
            for f in forces {
                let wanted = Wrench { force: DVec3::from_array(f), torque: DVec3::ZERO };
                let force = gate.pass(wanted, true).wrench.force;
                prop_assert!(force.is_finite());
                prop_assert!(force.length() <= 8.0);
                prop_assert!(force.distance(last) <= 0.5 * (1.0 + 1e-12));
                last = force;
            }
            for _ in 0..200 {
                gate.pass(Wrench::ZERO, false);
            }
            prop_assert!(gate.is_closed());
        }
    }
}
