//! A body on a hinge: one coordinate, the angle.

use super::body::Step;
use super::extent::Extent;
use super::spring_damper::{Coordinate, SpringDamper};
use geometry::portable::about;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use scene::HingePlan;

#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Hinge {
    home: Pose,
    /// Unit vector, world.
    axis: DVec3,
    /// A point of the axis, world, metres.
    pub anchor: DVec3,
    /// From the anchor to the middle of the box at angle 0, world, metres.
    arm: DVec3,
    /// World, newtons.
    weight_n: DVec3,
    /// Angle from the pose in the scene, radians.
    turn: Coordinate,
}

impl Hinge {
    pub fn new(plan: &HingePlan, home: Pose, extent: &Extent) -> Self {
        let mass = plan.mass.mass_kg;
        let moments = plan.mass.inertia_kgm2.unwrap_or(extent.moments(mass));
        let from_axis = (extent.middle - plan.anchor_m).reject_from_normalized(plan.axis);
        let about_middle = moments.dot(plan.axis * plan.axis);
        let inertia = about_middle + mass * from_axis.length_squared();
        Self {
            home,
            axis: home.orientation * plan.axis,
            anchor: home.transform_point(plan.anchor_m),
            arm: home.orientation * (extent.middle - plan.anchor_m),
            weight_n: plan.mass.gravity_m_per_s2 * mass,
            turn: Coordinate::new(SpringDamper::new(&plan.angular, inertia), plan.limits_rad),
        }
    }

    fn rotation(&self) -> DQuat {
        about(self.axis, self.turn.at)
    }

    /// One period under a load (world, newtons; newton metres about the anchor).
    pub fn step(&mut self, load: &Wrench, step: &Step) {
        let of_weight = (self.rotation() * self.arm).cross(self.weight_n);
        let torque = self.axis.dot(load.torque + of_weight);
        self.turn.step(torque, step.period_s, step.fastest_turn);
    }

    /// The longest step in which its weight gives no energy: of a pendulum, two over its angular
    /// frequency (symplectic Euler); half of that.
    pub fn longest_step_s(&self) -> f64 {
        let arm = self.arm.reject_from_normalized(self.axis).length();
        let weight_n = self.weight_n.reject_from_normalized(self.axis).length();
        let squared = weight_n * arm / self.turn.inertia();
        squared.sqrt().recip()
    }

    pub fn pose(&self) -> Pose {
        let rotation = self.rotation();
        Pose {
            position: self.anchor + rotation * (self.home.position - self.anchor),
            orientation: (rotation * self.home.orientation).normalize(),
        }
    }

    /// Speeds of the middle of its box, m/s, and of its rotation, rad/s.
    pub fn speeds(&self) -> [f64; 2] {
        let arm = self.arm.reject_from_normalized(self.axis).length();
        let turning = self.turn.speed();
        [turning * arm, turning]
    }

    pub fn kinetic_j(&self) -> f64 {
        self.turn.kinetic_j()
    }

    pub fn stop(&mut self) {
        self.turn.stop();
    }
}
