//! A free body: the motion of the middle of its box, and its rotation by angular momentum, which nothing but a torque
//! changes: so the energy of a body that tumbles stays between two bounds, whatever the step.

use super::body::Step;
use super::extent::Extent;
use super::spring_damper::SpringDamper;
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use scene::FreePlan;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Free {
    linear: SpringDamper,
    /// About the body's axes.
    angular: [SpringDamper; 3],
    weight_n: DVec3,
    /// The middle of the box in the object's axes.
    arm: DVec3,
    /// Where the scene puts middle and axes.
    home: DVec3,
    home_axes: DQuat,
    /// Now; world, metres.
    pub middle: DVec3,
    axes: DQuat,
    velocity: DVec3,
    /// Angular momentum about the middle, world, kg m²/s.
    momentum: DVec3,
}

impl Free {
    pub fn new(plan: &FreePlan, home: Pose, extent: &Extent) -> Self {
        let mass = plan.mass.mass_kg;
        let moments = plan.mass.inertia_kgm2.unwrap_or(extent.moments(mass));
        let middle = home.transform_point(extent.middle);
        Self {
            linear: SpringDamper::new(&plan.linear, mass),
            angular: moments
                .to_array()
                .map(|i| SpringDamper::new(&plan.angular, i)),
            weight_n: plan.mass.gravity_m_per_s2 * mass,
            arm: extent.middle,
            home: middle,
            home_axes: home.orientation,
            middle,
            axes: home.orientation,
            velocity: DVec3::ZERO,
            momentum: DVec3::ZERO,
        }
    }

    /// Angular velocity of what has the momentum at an orientation.
    fn turning(&self, axes: DQuat) -> DVec3 {
        let [x, y, z] = self.angular.map(|spring_damper| spring_damper.inertia);
        axes * ((axes.conjugate() * self.momentum) / DVec3::new(x, y, z))
    }

    /// A step; the torque of `load` is about the middle.
    pub fn step(&mut self, load: &Wrench, step: &Step) {
        let period = step.period_s;
        let force = load.force + self.weight_n;
        let away = self.middle - self.home;
        let speed = |k: usize| {
            self.linear
                .speed_after(self.velocity[k], force[k], away[k], period)
        };
        let velocity = DVec3::new(speed(0), speed(1), speed(2));
        self.velocity = limited(velocity, step.fastest);
        self.middle += self.velocity * period;

        // The rotation in the body's axes, where the inertia is that of three coordinates.
        let to_body = self.axes.conjugate();
        let turned = to_body * from_home(self.home_axes, self.axes);
        let turning = to_body * self.turning(self.axes);
        let torque = to_body * load.torque;
        let speed =
            |k: usize| self.angular[k].speed_after(turning[k], torque[k], turned[k], period);
        let turning = limited(DVec3::new(speed(0), speed(1), speed(2)), step.fastest_turn);
        let [x, y, z] = self.angular.map(|spring_damper| spring_damper.inertia);
        self.momentum = self.axes * (turning * DVec3::new(x, y, z));
        // With the angular velocity of the middle of the step.
        let first = self.turning(self.axes);
        let half_way = (DQuat::from_scaled_axis(first * (0.5 * period)) * self.axes).normalize();
        let mean = limited(self.turning(half_way), step.fastest_turn);
        self.axes = (DQuat::from_scaled_axis(mean * period) * self.axes).normalize();
    }

    pub fn pose(&self) -> Pose {
        Pose {
            position: self.middle - self.axes * self.arm,
            orientation: self.axes,
        }
    }

    pub fn kinetic_j(&self) -> f64 {
        let of_turn = self.momentum.dot(self.turning(self.axes));
        0.5 * (self.linear.inertia * self.velocity.length_squared() + of_turn)
    }

    pub fn stop(&mut self) {
        self.velocity = DVec3::ZERO;
        self.momentum = DVec3::ZERO;
    }
}

/// The rotation vector from one orientation to another, by the shorter way round.
fn from_home(home: DQuat, axes: DQuat) -> DVec3 {
    let turn = axes * home.conjugate();
    (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis()
}

/// A vector of at most this length; none of what is no vector.
fn limited(vector: DVec3, most: f64) -> DVec3 {
    if vector.is_finite() {
        vector.clamp_length_max(most)
    } else {
        DVec3::ZERO
    }
}
