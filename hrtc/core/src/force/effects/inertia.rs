//! Inertia: a simulated mass, coupled to the device by a spring and damper (Colgate 1995). No
//! acceleration is measured, so its noise cannot shake the device.

use glam::DVec3;
use scene::InertiaPlan;

/// A mass on a virtual coupling.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Inertia {
    plan: InertiaPlan,
    /// Position (metres) and velocity (m/s) of the mass, world; `None` before the first tick.
    mass: Option<(DVec3, DVec3)>,
}

impl Inertia {
    /// The mass starts at rest at the first position of the device.
    #[must_use]
    pub fn new(plan: InertiaPlan) -> Self {
        Self { plan, mass: None }
    }

    /// Force (newtons) on a device at a position (metres) with a velocity (m/s), world. It advances
    /// the mass by one period (symplectic Euler).
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
    fn an_accelerated_device_gets_the_force_of_inertia() {
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
        // With the device at rest the mass comes to rest.
        for _ in 0..5000 {
            force = inertia.force(DVec3::ZERO, DVec3::ZERO, period);
        }
        assert!(force.length() < 1e-6, "{force}");
    }
}
