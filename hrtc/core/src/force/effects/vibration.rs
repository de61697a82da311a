//! A vibration: A sin(2 pi f t) along a direction of the world. Its phase counts ticks, so a recorded run repeats.

use super::Clock;
use glam::DVec3;
use scene::VibrationPlan;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Vibration {
    plan: VibrationPlan,
}

impl Vibration {
    /// Of a surface or a scene.
    #[must_use]
    pub fn new(plan: VibrationPlan) -> Self {
        Self { plan }
    }

    /// Newtons in a tick, world.
    #[must_use]
    pub fn force(&self, clock: Clock) -> DVec3 {
        let waves = (self.plan.frequency_hz * clock.period_s * clock.tick as f64).fract();
        self.plan.direction * (self.plan.amplitude_n * (std::f64::consts::TAU * waves).sin())
    }
}
