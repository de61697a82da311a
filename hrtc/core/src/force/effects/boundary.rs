//! The end of the workspace: outside of a ball or a box a spring pushes back in. The energy account limits it like a
//! surface, so it holds still at any stiffness.

use crate::force::passivity::CouplingSpring;
use glam::DVec3;
use scene::{BoundaryPlan, Workspace};

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Boundary {
    plan: BoundaryPlan,
}

impl Boundary {
    /// Of a workspace.
    #[must_use]
    pub fn new(plan: BoundaryPlan) -> Self {
        Self { plan }
    }

    /// Newtons at a place, world, metres, and the spring that they come from.
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
            // The clamped length is rounded: what was not beyond it is inside.
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
        };
        (back * stiffness_n_per_m, spring)
    }
}
