//! A magnet: the surface attracts a probe that is near, and retains one in contact until it is
//! pulled off.
//!
//! With s the distance over the range (`reach_m`) the force is `4 F s (1 - s)`: 0 at the surface
//! and at the end of the range, F half way. CHAI3D's magnet has two linear ramps instead. The force
//! has a potential that depends on the distance alone, so a closed path gains no energy.
//!
//! The distance is that of the probe's own surface, of a ball or a tool, and the pull acts at its
//! nearest point: then its torque belongs to the same potential.

use glam::DVec3;
use scene::MagnetPlan;

/// Attraction of a surface.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Magnet {
    plan: MagnetPlan,
}

impl Magnet {
    /// Magnet of the planned force and range.
    #[must_use]
    pub fn new(plan: MagnetPlan) -> Self {
        Self { plan }
    }

    /// Distance up to which it pulls, metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        self.plan.reach_m
    }

    /// Force (newtons) on a probe at a distance `gap_m` (metres) from the surface; `towards`: unit
    /// vector to the surface.
    #[must_use]
    pub fn pull(&self, gap_m: f64, towards: DVec3) -> DVec3 {
        let share = gap_m / self.plan.reach_m;
        if share > 0.0 && share < 1.0 {
            towards * (4.0 * self.plan.force_n * share * (1.0 - share))
        } else {
            DVec3::ZERO
        }
    }
}
