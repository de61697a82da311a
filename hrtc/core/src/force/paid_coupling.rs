//! A coupling whose energy the motion of the device has paid for.
//!
//! Energy that the motion of the device since the tick before does not explain, by the wrench
//! before or by that of now, has come otherwise. What a surface adds that is refined under the
//! probe is given, as far as that is imperceptible. The rest (a contact that is found late, or that
//! the probe began in; a boundary that comes where the probe is) is not: the spring begins with the
//! share that is paid for, and the rest returns slowly. A motion of the device leaves the share as
//! it is, and so does a wrench that is no number.
//!
//! Energy that is lost otherwise is paid for, too: what comes again soon after, as where a tool's
//! end of the coupling was an estimate for a tick, is given at once.

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
    /// Energy that is paid for and was lost of late, joules.
    lost_j: f64,
}

impl Default for PaidCoupling {
    fn default() -> Self {
        Self {
            coupled: [None; 2],
            share: 1.0,
            lost_j: 0.0,
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

    /// Scales the wrench of a spring, and the spring, by the share that is paid for. Returns them
    /// with what the spring was given. What damping takes is no energy of the spring: with it in
    /// the wrench, each stroke would pay for a contact that is found late. `moved`: motion of the
    /// device against what it is coupled to, in the axes of the wrench, metres and radians.
    /// `surface_moves`: whether the surface is refined under the probe in this tick.
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
            (self.share, self.lost_j) = (1.0, 0.0);
        }
        self.coupled[0] = Some((wrench, spring.stored_j));
        let pressed = |of: &Wrench| -(of.force.dot(moved.linear) + of.torque.dot(moved.angular));
        let change = spring.stored_j - before_j;
        let explained = [pressed(&wrench_before), pressed(&wrench)];
        let mut unexplained = change - explained[0].max(explained[1]);
        let lost = (explained[0].min(explained[1]) - change).max(0.0);
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
        let lost_j = (self.share * (spring.stored_j + lost) - spring.stored_j).max(0.0);
        if spring.stored_j > 0.0 {
            let paid_j = self.share * (spring.stored_j - unexplained);
            let again = (spring.stored_j - paid_j).clamp(0.0, self.lost_j);
            self.lost_j -= again;
            self.share = ((paid_j + again) / spring.stored_j).clamp(0.0, 1.0);
        }
        self.lost_j *= UNPAID_RETURNS_S / (UNPAID_RETURNS_S + period_s);
        self.lost_j += lost_j;
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

    const STIFFNESS_N_PER_M: f64 = 1000.0;

    /// A tick with a spring that is compressed so far, after the device has pressed it by so much:
    /// the force that is paid for, newtons.
    fn force(coupling: &mut PaidCoupling, depth_m: f64, pressed_m: f64) -> f64 {
        coupling.begin_tick();
        let wrench = Wrench {
            force: DVec3::Z * (STIFFNESS_N_PER_M * depth_m),
            torque: DVec3::ZERO,
        };
        let spring = CouplingSpring {
            stiffness_n_per_m: STIFFNESS_N_PER_M,
            stored_j: 0.5 * STIFFNESS_N_PER_M * depth_m * depth_m,
            raised_j: 0.0,
        };
        let moved = Twist {
            linear: DVec3::NEG_Z * pressed_m,
            angular: DVec3::ZERO,
        };
        let coupled = (wrench, spring);
        coupling.pay(coupled, &moved, false, 1e-3).0.force.z
    }

    /// A contact whose coupling is no number for one tick has its force in the next.
    #[test]
    fn a_force_that_is_no_number_is_gone_for_its_tick_only() {
        let mut coupling = PaidCoupling::default();
        for tick in 1..=100 {
            force(&mut coupling, 1e-5 * f64::from(tick), 1e-5);
        }
        for wrong in [f64::NAN, f64::INFINITY] {
            assert!(!force(&mut coupling, wrong, 0.0).is_finite());
            assert_eq!(force(&mut coupling, 1e-3, 0.0), 1.0);
        }
    }

    /// The device has pressed the spring as far as before: after a tick at an estimate all but the
    /// work of a tick's motion is paid for.
    #[test]
    fn energy_that_an_estimate_hides_for_a_tick_is_paid_for() {
        let forces = |estimate_m: f64| {
            let mut coupling = PaidCoupling::default();
            let pressed_m = 1e-5;
            let at = |tick: u32| {
                let hidden = if tick == 50 { estimate_m } else { 0.0 };
                let depth_m = pressed_m * f64::from(tick + 1) - hidden;
                force(&mut coupling, depth_m, pressed_m)
            };
            (0..60).map(at).collect::<Vec<_>>()
        };
        let (known, hidden) = (forces(0.0), forces(2e-4));
        assert!(hidden[50] < 0.7 * known[50]);
        for (known, hidden) in known[51..].iter().zip(&hidden[51..]) {
            assert!(
                (hidden / known - 1.0).abs() < 0.02,
                "{hidden} N of {known} N"
            );
        }
    }

    /// What was never lost is not paid for: a surface that comes to a device that stays.
    #[test]
    fn energy_that_comes_of_itself_is_not_paid_for() {
        let mut coupling = PaidCoupling::default();
        force(&mut coupling, 1e-6, 0.0);
        assert!(force(&mut coupling, 1e-3, 0.0) < 0.01);
    }
}
