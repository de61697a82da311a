//! A free body: translation of the middle of its box, and rotation about it.
//!
//! The state of the rotation is the angular momentum L. Only a torque changes it, so the energy of
//! a tumbling body stays between `L² / (2 I_max)` and `L² / (2 I_min)` at any step length. Between
//! these it stays where it was as long as a step turns by a small angle. A step over missed ticks
//! may turn a rod so far that it spins about its length with all of L, at many times its energy:
//! after such a step L is shortened, so that the energy is what it was.

use super::body::Step;
use super::extent::Extent;
use super::spring_damper::SpringDamper;
use geometry::portable::{rotation, rotation_vector};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use scene::FreePlan;

#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Free {
    linear: SpringDamper,
    /// About each of the body's axes.
    angular: [SpringDamper; 3],
    /// World, newtons.
    weight_n: DVec3,
    /// Middle of the box in the object's axes, metres.
    arm: DVec3,
    /// Middle in the scene, world, metres.
    home: DVec3,
    /// Axes in the scene.
    home_axes: DQuat,
    /// Middle now, world, metres.
    pub middle: DVec3,
    /// Axes now.
    axes: DQuat,
    /// World, m/s.
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

    /// Kinetic energy of the rotation, joules.
    fn turning_j(&self) -> f64 {
        0.5 * self.momentum.dot(self.turning(self.axes))
    }

    /// Angular velocity of the body at an orientation, world, rad/s.
    fn turning(&self, axes: DQuat) -> DVec3 {
        let [x, y, z] = self.angular.map(|spring_damper| spring_damper.inertia);
        axes * ((axes.conjugate() * self.momentum) / DVec3::new(x, y, z))
    }

    /// One period under a load (world, newtons; newton metres about the middle).
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

        // In the body's axes the rotation is three coordinates, each with its own inertia.
        let to_body = self.axes.conjugate();
        let turned = to_body * from_home(self.home_axes, self.axes);
        let turning = to_body * self.turning(self.axes);
        let torque = to_body * load.torque;
        let speed =
            |k: usize| self.angular[k].speed_after(turning[k], torque[k], turned[k], period);
        let turning = limited(DVec3::new(speed(0), speed(1), speed(2)), step.fastest_turn);
        let [x, y, z] = self.angular.map(|spring_damper| spring_damper.inertia);
        self.momentum = self.axes * (turning * DVec3::new(x, y, z));
        if !step.is_long {
            self.turn(step);
            return;
        }
        let before_j = self.turning_j();
        self.turn(step);
        let now_j = self.turning_j();
        if now_j > before_j {
            self.momentum *= (before_j / now_j).sqrt();
        }
    }

    /// Turns it by its angular momentum: midpoint rule.
    fn turn(&mut self, step: &Step) {
        let period = step.period_s;
        let first = self.turning(self.axes);
        let mid_axes = (rotation(first * (0.5 * period)) * self.axes).normalize();
        let mean = limited(self.turning(mid_axes), step.fastest_turn);
        self.axes = (rotation(mean * period) * self.axes).normalize();
    }

    pub fn pose(&self) -> Pose {
        Pose {
            position: self.middle - self.axes * self.arm,
            orientation: self.axes,
        }
    }

    /// Speeds of its middle, m/s, and of its rotation, rad/s.
    pub fn speeds(&self) -> [f64; 2] {
        [self.velocity.length(), self.turning(self.axes).length()]
    }

    pub fn kinetic_j(&self) -> f64 {
        0.5 * self.linear.inertia * self.velocity.length_squared() + self.turning_j()
    }

    pub fn stop(&mut self) {
        self.velocity = DVec3::ZERO;
        self.momentum = DVec3::ZERO;
    }
}

/// Rotation vector from `home` to `axes`, radians, length at most π.
fn from_home(home: DQuat, axes: DQuat) -> DVec3 {
    rotation_vector(axes * home.conjugate())
}

/// The vector, shortened to this length; zero for one that is not finite.
fn limited(vector: DVec3, most: f64) -> DVec3 {
    if vector.is_finite() {
        vector.clamp_length_max(most)
    } else {
        DVec3::ZERO
    }
}
