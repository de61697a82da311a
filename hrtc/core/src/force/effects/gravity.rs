//! Gravity: the weight of the tool, at its centre of mass.

use geometry::Wrench;
use glam::{DQuat, DVec3};
use scene::GravityPlan;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// Weight of a tool.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Gravity {
    /// World, newtons.
    weight: DVec3,
    /// Centre of mass in the probe's axes, metres.
    centre_m: DVec3,
}

impl Gravity {
    /// Weight of the planned mass.
    #[must_use]
    pub fn new(plan: GravityPlan) -> Self {
        Self {
            weight: plan.direction * (plan.mass_kg * GRAVITY),
            centre_m: plan.centre_m,
        }
    }

    /// Force and torque about the probe's position, world, at an orientation of the probe.
    #[must_use]
    pub fn wrench(&self, orientation: DQuat) -> Wrench {
        Wrench {
            force: self.weight,
            torque: (orientation * self.centre_m).cross(self.weight),
        }
    }
}
