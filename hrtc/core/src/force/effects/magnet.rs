//! A magnet: the surface pulls what comes near, and holds what touches until it is pulled off.
//!
//! With s the distance over the reach the force is 4 F s (1 - s): nothing at the surface and at the reach, F half way
//! (after CHAI3D's magnet, with a parabola for its two ramps). It follows from a potential of the distance alone, so a
//! closed path gains nothing by it.

use glam::DVec3;
use scene::MagnetPlan;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Magnet {
    plan: MagnetPlan,
}

impl Magnet {
    /// Of a surface.
    #[must_use]
    pub fn new(plan: MagnetPlan) -> Self {
        Self { plan }
    }

    /// Newtons on a probe that is `gap_m` away from the surface, which lies in the direction `towards` (unit).
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
