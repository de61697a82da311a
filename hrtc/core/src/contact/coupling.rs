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
    /// Force and torque about the device's centre: with damping, and of the spring alone.
    /// `deflection`: from the device to the proxy; `velocity`: of the device, per second; both in
    /// metres and radians, as the gyration. Of what is no number neither is one: the force limiter
    /// makes no force of it, and says so.
    #[must_use]
    pub fn wrenches(&self, deflection: &Twist, velocity: &Twist, gyration: f64) -> [Wrench; 2] {
        let square = gyration * gyration;
        let product =
            |a: &Twist, b: &Twist| a.linear.dot(b.linear) + square * a.angular.dot(b.angular);
        let length = product(deflection, deflection).sqrt();
        if length == 0.0 {
            return [Wrench::ZERO; 2];
        }
        let out = deflection.times(1.0 / length);
        let spring = self.stiffness_n_per_m * length;
        let damper = -self.damping_ns_per_m * product(velocity, &out);
        let whole = spring + damper;
        // Damping never pulls: a wall does not stick. Not `max`: that would make 0 of no number.
        let whole = if whole < 0.0 { 0.0 } else { whole };
        [whole, spring].map(|size| Wrench {
            force: out.linear * size,
            torque: out.angular * (size * square),
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    const COUPLING: Coupling = Coupling {
        stiffness_n_per_m: 800.0,
        damping_ns_per_m: 2.0,
    };

    fn along(linear: DVec3) -> Twist {
        Twist {
            linear,
            angular: DVec3::ZERO,
        }
    }

    #[test]
    fn damping_adds_to_the_spring_and_never_pulls() {
        let forces = |speed: f64| {
            let (out, velocity) = (along(DVec3::Z * 1e-3), along(DVec3::Z * speed));
            let wrenches = COUPLING.wrenches(&out, &velocity, 0.0);
            wrenches.map(|wrench| wrench.force.z)
        };
        for (speed, due) in [(0.0, 0.8), (-0.1, 1.0), (0.1, 0.6), (1.0, 0.0)] {
            let [whole, spring] = forces(speed);
            assert!((whole - due).abs() < 1e-12, "{speed}: {whole}");
            assert!((spring - 0.8).abs() < 1e-12, "{speed}: {spring}");
        }
    }

    #[test]
    fn what_is_no_number_is_not_counted_as_zero() {
        let [still, out] = [Twist::default(), along(DVec3::Z * 1e-3)];
        for wrong in [f64::NAN, f64::INFINITY].map(|x| along(DVec3::X * x)) {
            for wrench in COUPLING.wrenches(&wrong, &still, 0.01) {
                assert!(!wrench.is_finite(), "{wrong:?}: {wrench:?}");
            }
        }
        let wrong = along(DVec3::splat(f64::NAN));
        let [whole, spring] = COUPLING.wrenches(&out, &wrong, 0.01);
        assert!(!whole.is_finite() && spring.is_finite());
        assert_eq!(COUPLING.wrenches(&still, &out, 0.01), [Wrench::ZERO; 2]);
    }
}
