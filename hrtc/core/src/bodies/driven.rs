//! An object whose pose is a function of time alone, so that no rounding accumulates.
//!
//! With a constant velocity v the displacement is `v t`; with a period P it is
//! `v (P / 2π) sin(2π t / P)`. The rotation follows the same law.

use geometry::Pose;
use geometry::portable::{rotation, sin};
use glam::DVec3;
use scene::DrivenPlan;
use std::f64::consts::TAU;

#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Driven {
    home: Pose,
    /// Centre of the rotation at time 0, world, metres.
    anchor: DVec3,
    /// Largest velocity, world, m/s.
    linear: DVec3,
    /// Largest angular velocity, world, rad/s.
    angular: DVec3,
    /// Period of the sine, seconds; `None` for a constant velocity.
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

    /// Upper bound of the speed, m/s, of any point within `radius` (metres) of `middle` (world,
    /// metres, at time 0).
    pub fn fastest(&self, middle: DVec3, radius: f64) -> f64 {
        self.linear.length() + self.angular.length() * (middle.distance(self.anchor) + radius)
    }

    /// Pose at a time, seconds after the start.
    pub fn pose(&self, seconds: f64) -> Pose {
        let along = match self.period_s {
            None => seconds,
            Some(period) => sin(seconds * (TAU / period)) * (period / TAU),
        };
        let rotation = rotation(self.angular * along);
        let about = self.anchor + rotation * (self.home.position - self.anchor);
        Pose {
            position: about + self.linear * along,
            orientation: (rotation * self.home.orientation).normalize(),
        }
    }
}
