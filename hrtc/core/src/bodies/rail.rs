//! A body on a rail.

use super::body::Step;
use super::rest::{Coordinate, Rest};
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::RailPlan;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rail {
    home: Pose,
    /// World.
    axis: DVec3,
    weight_n: DVec3,
    slide: Coordinate,
}

impl Rail {
    pub fn new(plan: &RailPlan, home: Pose) -> Self {
        let rest = Rest::new(&plan.linear, plan.mass.mass_kg);
        Self {
            home,
            axis: home.orientation * plan.axis,
            weight_n: plan.mass.gravity_m_per_s2 * plan.mass.mass_kg,
            slide: Coordinate::new(rest, plan.limits_m),
        }
    }

    pub fn step(&mut self, load: &Wrench, step: &Step) {
        let force = self.axis.dot(load.force + self.weight_n);
        self.slide.step(force, step.period_s, step.fastest);
    }

    pub fn pose(&self) -> Pose {
        Pose {
            position: self.home.position + self.axis * self.slide.at,
            ..self.home
        }
    }

    pub fn kinetic_j(&self) -> f64 {
        self.slide.kinetic_j()
    }

    pub fn stop(&mut self) {
        self.slide.stop();
    }
}
