//! The limits of the workspace: outside a ball or a box a spring pushes back, `F = k (c - x)` with
//! c the nearest point inside. The energy account limits it like a surface.

use super::DeviceSample;
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
        self.coupling.pay(coupled, &device.moved, false, period_s)
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
