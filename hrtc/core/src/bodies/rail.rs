//! A body on a rail: one coordinate, the displacement.

use super::body::Step;
use super::spring_damper::{Coordinate, SpringDamper};
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::RailPlan;

#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Rail {
    home: Pose,
    /// Unit vector, world.
    axis: DVec3,
    /// World, newtons.
    weight_n: DVec3,
    /// Displacement from the pose in the scene, metres.
    travel: Coordinate,
}

impl Rail {
    pub fn new(plan: &RailPlan, home: Pose) -> Self {
        let spring_damper = SpringDamper::new(&plan.linear, plan.mass.mass_kg);
        Self {
            home,
            axis: home.orientation * plan.axis,
            weight_n: plan.mass.gravity_m_per_s2 * plan.mass.mass_kg,
            travel: Coordinate::new(spring_damper, plan.limits_m),
        }
    }

    /// One period under a load (world, newtons); its torque has no effect.
    pub fn step(&mut self, load: &Wrench, step: &Step) {
        let force = self.axis.dot(load.force + self.weight_n);
        self.travel.step(force, step.period_s, step.fastest);
    }

    pub fn pose(&self) -> Pose {
        Pose {
            position: self.home.position + self.axis * self.travel.at,
            ..self.home
        }
    }

    /// Metres per second.
    pub fn speed(&self) -> f64 {
        self.travel.speed()
    }

    pub fn kinetic_j(&self) -> f64 {
        self.travel.kinetic_j()
    }

    pub fn stop(&mut self) {
        self.travel.stop();
    }
}
