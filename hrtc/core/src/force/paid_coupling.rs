//! A coupling whose energy the motion of the device has paid for.
//!
//! Energy that the motion of the device since the tick before does not explain, by the wrench
//! before or by that of now, has come otherwise. What a surface adds that is refined under the
//! probe is given, as far as that is imperceptible. The rest (a contact that is found late, or that
//! the probe began in; a boundary that comes where the probe is) is not: the spring begins with the
//! share that is paid for, and the rest returns slowly. A motion of the device leaves the share as
//! it is, and so does a wrench that is no number.

use super::passivity::CouplingSpring;
use crate::contact::motion::Twist;
use crate::perception::{GROWTH_PER_S, IMPERCEPTIBLE_N};
use crate::tuning::force::UNPAID_RETURNS_S;
use geometry::Wrench;

/// See the module.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct PaidCoupling {
    /// Wrench and energy (joules), while there is a coupling: in this tick, and in the one before.
    coupled: [Option<(Wrench, f64)>; 2],
    /// Share of the energy that is paid for, 0 to 1.
    share: f64,
}

impl Default for PaidCoupling {
    fn default() -> Self {
        Self {
            coupled: [None; 2],
            share: 1.0,
        }
    }
}

impl PaidCoupling {
    /// Share of the energy that is paid for, and of the wrench, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.share
    }

    /// A tick begins, in which nothing is coupled yet.
    pub fn begin_tick(&mut self) {
        self.coupled = [None, self.coupled[0]];
    }

    /// Scales a wrench and its spring by the share that is paid for. Returns them with what the
    /// spring was given. `moved`: motion of the device against what it is coupled to, in the axes
    /// of the wrench, metres and radians. `surface_moves`: whether the surface is refined under the
    /// probe in this tick.
    pub fn pay(
        &mut self,
        (wrench, spring): (Wrench, CouplingSpring),
        moved: &Twist,
        surface_moves: bool,
        period_s: f64,
    ) -> (Wrench, CouplingSpring) {
        let stiffness = spring.stiffness_n_per_m;
        let (wrench_before, before_j) = self.coupled[1].unwrap_or_default();
        if self.coupled[1].is_none() {
            self.share = 1.0;
        }
        self.coupled[0] = Some((wrench, spring.stored_j));
        let pressed = |of: &Wrench| -(of.force.dot(moved.linear) + of.torque.dot(moved.angular));
        let explained = pressed(&wrench_before).max(pressed(&wrench));
        let mut unexplained = spring.stored_j - before_j - explained;
        if !(unexplained.is_finite() && wrench.is_finite()) {
            // The force limiter makes no force of it. The balance goes on from the tick before.
            self.coupled[0] = self.coupled[1];
            return (wrench, spring);
        }
        let mut given = 0.0;
        if surface_moves && self.coupled[1].is_some() {
            let least = 0.5 * IMPERCEPTIBLE_N * IMPERCEPTIBLE_N / stiffness;
            let most = GROWTH_PER_S * period_s * before_j.max(least);
            given = unexplained.clamp(0.0, most);
            unexplained -= given;
        }
        if spring.stored_j > 0.0 {
            let paid_j = self.share * (spring.stored_j - unexplained);
            self.share = (paid_j / spring.stored_j).clamp(0.0, 1.0);
        }
        let returned = (1.0 - self.share) * period_s / (UNPAID_RETURNS_S + period_s);
        self.share += returned;
        let raised_j = self.share * given + returned * spring.stored_j;
        let spring = CouplingSpring {
            raised_j,
            ..spring.times(self.share)
        };
        (wrench * self.share, spring)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A contact whose coupling is no number for one tick has its force in the next.
    #[test]
    fn a_force_that_is_no_number_is_gone_for_its_tick_only() {
        let mut coupling = PaidCoupling::default();
        let stiffness_n_per_m = 1000.0;
        let mut force = |depth_m: f64, pressed_m: f64| {
            coupling.begin_tick();
            let wrench = Wrench {
                force: DVec3::Z * (stiffness_n_per_m * depth_m),
                torque: DVec3::ZERO,
            };
            let spring = CouplingSpring {
                stiffness_n_per_m,
                stored_j: 0.5 * stiffness_n_per_m * depth_m * depth_m,
                raised_j: 0.0,
            };
            let moved = Twist {
                linear: DVec3::NEG_Z * pressed_m,
                angular: DVec3::ZERO,
            };
            let coupled = (wrench, spring);
            coupling.pay(coupled, &moved, false, 1e-3).0.force.z
        };
        for tick in 1..=100 {
            force(1e-5 * f64::from(tick), 1e-5);
        }
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(!force(wrong, 0.0).is_finite());
            assert_eq!(force(1e-3, 0.0), 1.0);
        }
    }
}
