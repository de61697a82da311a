//! An object that moves by time alone: its pose is a function of the tick, so that nothing adds up.

use geometry::Pose;
use glam::{DQuat, DVec3};
use scene::DrivenPlan;
use std::f64::consts::TAU;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven {
    home: Pose,
    /// What it turns about where the scene puts it, world.
    anchor: DVec3,
    /// World.
    linear: DVec3,
    angular: DVec3,
    period_s: Option<f64>,
}

impl Driven {
    pub fn new(plan: &DrivenPlan, home: Pose) -> Self {
        Self {
            home,
            anchor: home.transform_point(plan.anchor_m),
            linear: home.orientation * plan.linear_m_per_s,
            angular: home.orientation * plan.angular_rad_per_s,
            period_s: plan.period_s,
        }
    }

    /// Whether it moves at all.
    pub fn moves(&self) -> bool {
        self.linear != DVec3::ZERO || self.angular != DVec3::ZERO
    }

    /// No point within `radius` of `middle` (world, where the scene puts it) goes farther in a second.
    pub fn fastest(&self, middle: DVec3, radius: f64) -> f64 {
        self.linear.length() + self.angular.length() * (middle.distance(self.anchor) + radius)
    }

    /// Its pose after so many seconds.
    pub fn pose(&self, seconds: f64) -> Pose {
        let along = match self.period_s {
            None => seconds,
            Some(period) => (seconds * (TAU / period)).sin() * (period / TAU),
        };
        let rotation = DQuat::from_scaled_axis(self.angular * along);
        let about = self.anchor + rotation * (self.home.position - self.anchor);
        Pose {
            position: about + self.linear * along,
            orientation: (rotation * self.home.orientation).normalize(),
        }
    }
}
