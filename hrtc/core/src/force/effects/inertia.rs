//! Inertia: a mass that the device carries along on a spring and damper (a virtual coupling, Colgate, Stanley and Brown
//! 1995). The mass is integrated by the loop, so no acceleration is measured, whose noise would shake the device.

use glam::DVec3;
use scene::InertiaPlan;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Inertia {
    plan: InertiaPlan,
    /// Place, metres, and velocity, m/s, of the mass in the world.
    mass: Option<(DVec3, DVec3)>,
}

impl Inertia {
    /// At rest where the device is first seen.
    #[must_use]
    pub fn new(plan: InertiaPlan) -> Self {
        Self { plan, mass: None }
    }

    /// Newtons on a device at a place, metres, with a velocity, m/s; moves the mass on by a tick (symplectic Euler).
    pub fn force(&mut self, position: DVec3, velocity: DVec3, period_s: f64) -> DVec3 {
        let (place, speed) = self.mass.unwrap_or((position, DVec3::ZERO));
        let force = (place - position) * self.plan.stiffness_n_per_m
            + (speed - velocity) * self.plan.damping_ns_per_m;
        let speed = speed - force * (period_s / self.plan.mass_kg);
        self.mass = Some((place + speed * period_s, speed));
        force
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_device_that_is_accelerated_feels_the_mass() {
        let (mass_kg, a, period) = (0.2, 3.0, 1e-3);
        let mut inertia = Inertia::new(InertiaPlan {
            mass_kg,
            stiffness_n_per_m: 400.0,
            damping_ns_per_m: 4.0,
        });
        let mut force = DVec3::ZERO;
        for tick in 0..5000 {
            let t = period * f64::from(tick);
            let (place, speed) = (DVec3::X * (0.5 * a * t * t), DVec3::X * (a * t));
            force = inertia.force(place, speed, period);
        }
        assert!(force.distance(DVec3::NEG_X * mass_kg * a) < 1e-3, "{force}");
        // At rest it comes to rest.
        for _ in 0..5000 {
            force = inertia.force(DVec3::ZERO, DVec3::ZERO, period);
        }
        assert!(force.length() < 1e-6, "{force}");
    }
}
