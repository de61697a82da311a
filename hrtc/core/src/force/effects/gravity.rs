//! Gravity: the weight of the tool that the probe stands for, at its centre of mass.

use geometry::Wrench;
use glam::{DQuat, DVec3};
use scene::GravityPlan;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Gravity {
    weight: DVec3,
    centre_m: DVec3,
}

impl Gravity {
    /// Of a mass.
    #[must_use]
    pub fn new(plan: GravityPlan) -> Self {
        Self {
            weight: plan.direction * (plan.mass_kg * GRAVITY),
            centre_m: plan.centre_m,
        }
    }

    /// Force and torque about the probe's position, which stands so in the world.
    #[must_use]
    pub fn wrench(&self, orientation: DQuat) -> Wrench {
        Wrench {
            force: self.weight,
            torque: (orientation * self.centre_m).cross(self.weight),
        }
    }
}
