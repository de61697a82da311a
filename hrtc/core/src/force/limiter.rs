//! The force limiter: every wrench to a device passes it.
//!
//! In this order: a wrench that is not finite becomes zero; force and torque are clamped to their
//! maximum; the ramp of the soft start or end scales them; their change in a tick is limited.

use geometry::Wrench;
use glam::DVec3;
use mutants::{Mutant, is};
use scene::SafetyPlan;

/// Limits of one device, the ramp, and the last wrench.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct ForceLimiter {
    force: Limit,
    torque: Limit,
    /// Length of the ramp, ticks, at least 1.
    ramp_ticks: f64,
    /// Share of the wanted wrench, 0 (closed) to 1 (open).
    ramp: f64,
    last: Wrench,
}

/// Maximum of a force (N) or a torque (N m), and of its change in a tick.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Limit {
    most: f64,
    step: f64,
}

/// A limited force or torque.
struct LimitedVector {
    vector: DVec3,
    /// Whether it was clamped.
    is_cut: bool,
    /// The shares of the last vector and of the wanted one of which it is the sum, 0 to 1.
    shares: [f64; 2],
}

impl Limit {
    /// The wanted vector, clamped, scaled by `share` (0 to 1), and within one step of the last.
    fn pass(&self, wanted: DVec3, share: f64, last: DVec3) -> LimitedVector {
        let most = self.most * if is(Mutant::Clamp) { 2.0 } else { 1.0 };
        let size = wanted.length();
        let is_cut = size > most;
        let clamp = if is_cut { most / size } else { 1.0 };
        let limited = if is_cut { wanted * clamp } else { wanted };
        let target = limited * share;
        let step = target - last;
        let length = step.length();
        let (mut vector, part) = if length > self.step && !is(Mutant::Slew) {
            let part = self.step / length;
            (last + step * part, part)
        } else {
            (target, 1.0)
        };
        // The ball of the maximum is convex, so only rounding can lead outside.
        let size = vector.length();
        if size > most {
            vector *= most / size * (1.0 - f64::EPSILON);
        }
        // Whatever the limits are.
        if vector.is_finite() {
            LimitedVector {
                vector,
                is_cut,
                shares: [1.0 - part, part * clamp * share],
            }
        } else {
            LimitedVector {
                vector: DVec3::ZERO,
                is_cut: true,
                shares: [0.0; 2],
            }
        }
    }
}

/// Output of the limiter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LimitedWrench {
    /// The wrench for the device.
    pub wrench: Wrench,
    /// Whether force or torque was clamped to its maximum, or was not finite.
    pub clamped: bool,
    /// The shares of the last wrench and of the wanted one of which it is the sum, 0 to 1: of
    /// force, and of torque.
    shares: [[f64; 2]; 2],
}

impl LimitedWrench {
    /// What of it comes from a part of the last wrench and a finite part of the wanted one.
    #[must_use]
    pub fn part_of(&self, last: &Wrench, wanted: &Wrench) -> Wrench {
        let sum = |shares: [f64; 2], last: DVec3, wanted: DVec3| {
            let [of_last, of_wanted] = shares;
            last * of_last + wanted * of_wanted
        };
        let [force, torque] = self.shares;
        Wrench {
            force: sum(force, last.force, wanted.force),
            torque: sum(torque, last.torque, wanted.torque),
        }
    }
}

/// The shares of a wrench's force and torque that a limiter passed, 0 to 1: each has a maximum of
/// its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Passed {
    /// Of the force; where there is none, of the torque.
    pub force: f64,
    /// Of the torque; where there is none, of the force, and 0 where the device renders none.
    pub torque: f64,
}

impl Passed {
    /// What of a wanted wrench is in a limited one.
    #[must_use]
    pub fn of(wanted: &Wrench, limited: &Wrench) -> Self {
        let share = |passed: DVec3, whole: DVec3| {
            let (passed, whole) = (passed.length(), whole.length());
            let share = passed / whole;
            // Of a wrench that is not finite nothing has passed; `min` would make it all.
            (whole != 0.0).then_some(if share.is_nan() { 0.0 } else { share.min(1.0) })
        };
        let force = share(limited.force, wanted.force);
        let torque = share(limited.torque, wanted.torque);
        Self {
            force: force.or(torque).unwrap_or(1.0),
            torque: torque.or(force).unwrap_or(1.0),
        }
    }

    /// Less of both.
    #[must_use]
    pub fn times(self, share: f64) -> Self {
        Self {
            force: self.force * share,
            torque: self.torque * share,
        }
    }

    /// The part of another wrench that has passed with it; nothing of what is not finite.
    #[must_use]
    pub fn scale(&self, wrench: &Wrench) -> Wrench {
        if !wrench.is_finite() {
            return Wrench::ZERO;
        }
        Wrench {
            force: wrench.force * self.force,
            torque: wrench.torque * self.torque,
        }
    }
}

impl ForceLimiter {
    /// A closed limiter, at the start of its ramp. `device_max_n`: largest force of the device,
    /// newtons.
    #[must_use]
    pub fn new(plan: SafetyPlan, device_max_n: f64, rate_hz: f64) -> Self {
        let force = Limit {
            most: plan.force_max_n.min(device_max_n),
            step: plan.slew_n_per_s / rate_hz,
        };
        // A torque takes as long to its limit as a force to its own, which may be the device's.
        let torque = Limit {
            most: plan.torque_max_nm,
            step: force.step * (plan.torque_max_nm / force.most),
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

    /// Largest change in a tick: of the force, newtons, and of the torque, newton metres.
    #[must_use]
    pub fn most_changes(&self) -> [f64; 2] {
        [self.force.step, self.torque.step]
    }

    /// One tick, so many periods after the one before. The ramp rises to 1 while `open`, by no more
    /// than a period's part a tick, and falls to 0 otherwise, by that of every period. A wrench
    /// that is not finite counts as zero.
    pub fn pass(&mut self, wanted: Wrench, open: bool, elapsed: u64) -> LimitedWrench {
        let change = if open { 1.0 } else { -(elapsed as f64) };
        self.ramp = (self.ramp + change / self.ramp_ticks).clamp(0.0, 1.0);
        let finite = wanted.is_finite();
        let wanted = if finite { wanted } else { Wrench::ZERO };
        let force = self.force.pass(wanted.force, self.ramp, self.last.force);
        let torque = self.torque.pass(wanted.torque, self.ramp, self.last.torque);
        let passed = Wrench {
            force: force.vector,
            torque: torque.vector,
        };
        let before = std::mem::replace(&mut self.last, passed);
        let is_late = is(Mutant::LateForce);
        LimitedWrench {
            wrench: if is_late { before } else { self.last },
            clamped: force.is_cut || torque.is_cut || !finite,
            shares: [force.shares, torque.shares],
        }
    }

    /// The device went to zero by itself: the next wrench starts there, at the start of the ramp.
    pub fn close(&mut self) {
        (self.ramp, self.last) = (0.0, Wrench::ZERO);
    }

    /// Whether the ramp and the last wrench are zero.
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
                prop_oneof![
                    -1e3..1e3f64, Just(f64::NAN), Just(f64::INFINITY), Just(f64::MAX)
                ]), 1..300),
        ) {
            let mut limiter = ForceLimiter::new(PLAN, 10.0, 1000.0);
            let mut last = Wrench::ZERO;
            for f in forces {
                let force = DVec3::from_array(f);
                let wanted = Wrench { force, torque: force.zxy() };
                let Wrench { force, torque } = limiter.pass(wanted, true, 1).wrench;
                prop_assert!(force.is_finite() && torque.is_finite());
                prop_assert!(force.length() <= 8.0 && torque.length() <= 0.4);
                prop_assert!(force.distance(last.force) <= 0.5 * (1.0 + 1e-12));
                prop_assert!(torque.distance(last.torque) <= 0.025 * (1.0 + 1e-12));
                last = Wrench { force, torque };
            }
            for _ in 0..200 {
                limiter.pass(Wrench::ZERO, false, 1);
            }
            prop_assert!(limiter.is_closed());
        }
    }

    #[test]
    fn force_and_torque_take_as_long_to_their_limits_on_a_weak_device_too() {
        for device_max_n in [10.0, 8.0, 3.0, 0.1] {
            let limiter = ForceLimiter::new(PLAN, device_max_n, 1000.0);
            let [force, torque] = limiter.most_changes();
            let ticks = limiter.force_max() / force;
            let of_torque = PLAN.torque_max_nm / torque;
            assert!(
                (of_torque - ticks).abs() <= 1e-12 * ticks,
                "{device_max_n} N: {ticks} {of_torque}"
            );
        }
        // Where the scene's limit counts, the bits are those of its share.
        let strong = ForceLimiter::new(PLAN, 10.0, 1000.0);
        assert_eq!(strong.torque.step, 0.5 * (0.4 / 8.0));
    }

    /// However many periods are skipped, the force is gone after the time of the ramp.
    #[test]
    fn the_ramp_down_takes_its_time_whatever_ticks_are_skipped() {
        let wanted = Wrench {
            force: DVec3::X * 5.0,
            torque: DVec3::ZERO,
        };
        let ramp_periods = 100;
        for elapsed in [1, 3, 8, 40, 300] {
            let mut limiter = ForceLimiter::new(PLAN, 10.0, 1000.0);
            for _ in 0..200 {
                limiter.pass(wanted, true, elapsed);
            }
            assert_eq!(limiter.last.force.x, 5.0, "every {elapsed}");
            let mut periods = 0;
            while limiter.ramp > 0.0 {
                limiter.pass(wanted, false, elapsed);
                periods += elapsed;
            }
            let most = ramp_periods + elapsed;
            assert!(
                (ramp_periods..=most).contains(&periods),
                "every {elapsed}: {periods}"
            );
        }
    }
}
