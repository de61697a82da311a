//! A vibration: `A sin(2π f t)` along a direction of the world. Its phase counts ticks, so a replay
//! is exact.

use super::Clock;
use geometry::portable::sin;
use glam::DVec3;
use mutants::{Mutant, is};
use scene::VibrationPlan;

/// A sine force.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Vibration {
    plan: VibrationPlan,
}

impl Vibration {
    /// Vibration of a surface or of a scene.
    #[must_use]
    pub fn new(plan: VibrationPlan) -> Self {
        Self { plan }
    }

    /// Force in a tick, world, newtons.
    #[must_use]
    pub fn force(&self, clock: Clock) -> DVec3 {
        let is_odd = is(Mutant::WallClock);
        let tick = clock.tick + if is_odd { mutants::count() } else { 0 };
        let waves = (self.plan.frequency_hz * clock.period_s * tick as f64).fract();
        self.plan.direction * (self.plan.amplitude_n * sin(std::f64::consts::TAU * waves))
    }
}
