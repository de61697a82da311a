//! The limits of the workspace: outside a ball or a box a spring pushes back, `F = k (c - x)` with
//! c the nearest point inside. The energy account limits it like a surface.

use crate::force::passivity::CouplingSpring;
use glam::DVec3;
use scene::{BoundaryPlan, Workspace};

/// Boundary of a workspace.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Boundary {
    plan: BoundaryPlan,
}

impl Boundary {
    /// Boundary of the planned shape and stiffness.
    #[must_use]
    pub fn new(plan: BoundaryPlan) -> Self {
        Self { plan }
    }

    /// Force (newtons) at a place (world, metres), and its spring; both zero inside.
    #[must_use]
    pub fn force(&self, position: DVec3) -> (DVec3, CouplingSpring) {
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
