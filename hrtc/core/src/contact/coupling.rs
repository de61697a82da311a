//! The virtual coupling: a spring and damper between the device and the proxy (Colgate 1995).
//!
//! Its energy is half the stiffness times the squared distance, in the metric in which the proxy is
//! the nearest placement. So force and torque are exactly those of the contacts, without a
//! component along the surface. The metric is diagonal: two vectors, no matrix.

use super::motion::Twist;
use geometry::Wrench;
use glam::DVec3;

/// Stiffness and damping of a surface; those of rotation follow from the tool's radius of gyration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// N/m, not negative.
    pub stiffness_n_per_m: f64,
    /// N s/m, not negative.
    pub damping_ns_per_m: f64,
}

impl Coupling {
    /// Force and torque about the device's centre. `deflection`: from the device to the proxy;
    /// `velocity`: of the device, per second; both in metres and radians, as the gyration.
    #[must_use]
    pub fn wrench(&self, deflection: &Twist, velocity: &Twist, gyration: f64) -> Wrench {
        let square = gyration * gyration;
        let product =
            |a: &Twist, b: &Twist| a.linear.dot(b.linear) + square * a.angular.dot(b.angular);
        let length = product(deflection, deflection).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            return Wrench::ZERO;
        }
        let out = deflection.times(1.0 / length);
        let spring = self.stiffness_n_per_m * length;
        let damper = -self.damping_ns_per_m * product(velocity, &out);
        // Damping never pulls: a wall does not stick.
        let size = (spring + damper).max(0.0);
        Wrench {
            force: out.linear * size,
            torque: out.angular * (size * square),
        }
    }
}

/// The same wrench about a point `arm` away.
#[must_use]
pub fn about(wrench: &Wrench, arm: DVec3) -> Wrench {
    Wrench {
        force: wrench.force,
        torque: wrench.torque - arm.cross(wrench.force),
    }
}
