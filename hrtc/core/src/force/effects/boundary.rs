//! The limits of the workspace: outside a ball or a box a spring pushes back, `F = k (c - x)` with
//! c the nearest point inside. The energy account limits it like a surface. A boundary that comes
//! where the probe is has an energy that no motion has put in: it begins without force
//! ([`PaidCoupling`]), and pushes with nearly all of it after a second.

use super::DeviceSample;
use crate::contact::motion::Twist;
use crate::force::paid_coupling::PaidCoupling;
use crate::force::passivity::CouplingSpring;
use geometry::Wrench;
use glam::DVec3;
use scene::{BoundaryPlan, Workspace};

/// Boundary of a workspace.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Boundary {
    plan: BoundaryPlan,
    coupling: PaidCoupling,
}

impl Boundary {
    /// Boundary of the planned shape and stiffness.
    #[must_use]
    pub fn new(plan: BoundaryPlan) -> Self {
        Self {
            plan,
            coupling: PaidCoupling::default(),
        }
    }

    /// Wrench (world) on a device, and its spring, of a boundary that is there by so large an
    /// `amount`, 0 to 1; both zero inside.
    pub fn render(
        &mut self,
        device: &DeviceSample<'_>,
        amount: f64,
        period_s: f64,
    ) -> (Wrench, CouplingSpring) {
        self.coupling.begin_tick();
        let (force, spring) = self.force(device.pose.position);
        if force == DVec3::ZERO {
            return Default::default();
        }
        let wrench = Wrench {
            force: force * amount,
            torque: DVec3::ZERO,
        };
        let coupled = (wrench, spring.times(amount));
        let moved = Twist {
            linear: device.displacement,
            angular: DVec3::ZERO,
        };
        self.coupling.pay(coupled, &moved, false, period_s)
    }

    /// Force (newtons) at a place (world, metres), and its spring; both zero inside.
    fn force(&self, position: DVec3) -> (DVec3, CouplingSpring) {
        let inside = match self.plan.shape {
            Workspace::Ball { centre, radius } => {
                centre + (position - centre).clamp_length_max(radius)
            }
            Workspace::Box { lower, upper } => position.clamp(lower, upper),
        };
        let back = inside - position;
        let is_in = match self.plan.shape {
            // The clamped point is rounded, so it does not tell inside from outside.
            Workspace::Ball { centre, radius } => {
                position.distance_squared(centre) <= radius * radius
            }
            Workspace::Box { .. } => back == DVec3::ZERO,
        };
        if is_in || !back.is_finite() {
            return (DVec3::ZERO, CouplingSpring::default());
        }
        let stiffness_n_per_m = self.plan.stiffness_n_per_m;
        let spring = CouplingSpring {
            stiffness_n_per_m,
            stored_j: 0.5 * stiffness_n_per_m * back.length_squared(),
            raised_j: 0.0,
        };
        (back * stiffness_n_per_m, spring)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;

    const PERIOD_S: f64 = 1e-3;

    fn boundary() -> Boundary {
        Boundary::new(BoundaryPlan {
            shape: Workspace::Ball {
                centre: DVec3::ZERO,
                radius: 0.01,
            },
            stiffness_n_per_m: 800.0,
        })
    }

    /// The force on a device that has come to a place from another.
    fn force(of: &mut Boundary, [from, to]: [DVec3; 2], amount: f64) -> DVec3 {
        let device = DeviceSample {
            pose: &Pose::at(to),
            velocity: (to - from) / PERIOD_S,
            displacement: to - from,
            elapsed: 1,
        };
        of.render(&device, amount, PERIOD_S).0.force
    }

    #[test]
    fn one_that_is_there_pushes_with_all_of_its_force() {
        let mut boundary = boundary();
        // To and fro, inside and beyond in turn.
        let place = |tick: i32| {
            let across = 1e-4 * f64::from(100 - (tick - 100).abs());
            let height = if tick.rem_euclid(50) < 25 { 0.0 } else { 0.012 };
            DVec3::new(across, height, 0.0)
        };
        for tick in 0..200 {
            let [from, to] = [place(tick - 1), place(tick)];
            let due = boundary.force(to).0;
            assert_eq!(force(&mut boundary, [from, to], 1.0), due, "{tick}");
        }
    }

    #[test]
    fn one_that_comes_where_the_probe_is_begins_without_force() {
        let mut boundary = boundary();
        let at = DVec3::X * 0.012;
        let due = boundary.force(at).0.length();
        let mut last = 0.0;
        for tick in 0..1000 {
            let amount = (f64::from(tick) * PERIOD_S / 0.1).min(1.0);
            let now = force(&mut boundary, [at; 2], amount).length();
            assert!(
                now >= last && now - last < 0.01 * due,
                "{tick}: {last} {now}"
            );
            last = now;
        }
        assert!(last > 0.98 * due, "{last} {due}");
    }
}
