//! Inertia: a simulated mass, coupled to the device by a spring and damper (Colgate 1995). No
//! acceleration is measured, so its noise cannot shake the device.

use crate::tuning::bodies::MAX_STEP_PERIODS;
use glam::DVec3;
use scene::InertiaPlan;

/// A mass on a virtual coupling.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Inertia {
    plan: InertiaPlan,
    /// The mass; `None` before the first tick.
    mass: Option<Mass>,
}

/// State of the mass, world.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Mass {
    /// Its position, metres.
    place: DVec3,
    /// Its velocity, m/s.
    speed: DVec3,
    /// Position of the device, metres.
    device: DVec3,
}

impl Inertia {
    /// The mass starts at rest at the first position of the device.
    #[must_use]
    pub fn new(plan: InertiaPlan) -> Self {
        Self { plan, mass: None }
    }

    /// The mass starts anew, at rest at the next position of the device.
    pub fn go_to_new_place(&mut self) {
        self.mass = None;
    }

    /// Force (newtons) on a device at a position (metres) with a velocity (m/s), world. It advances
    /// the mass by the periods since the last call (symplectic Euler), in which the device moved
    /// evenly. Beyond as many as a body makes up for by longer steps the mass is carried along.
    pub fn force(
        &mut self,
        position: DVec3,
        velocity: DVec3,
        (elapsed, period_s): (u64, f64),
    ) -> DVec3 {
        let mut mass = self.mass.unwrap_or(Mass {
            place: position,
            speed: DVec3::ZERO,
            device: position,
        });
        let motion = position - mass.device;
        let steps = elapsed.clamp(1, u64::from(MAX_STEP_PERIODS));
        let share = |periods: u64| periods as f64 / elapsed.max(1) as f64;
        mass.place += motion * share(elapsed.saturating_sub(steps));
        let mut force = DVec3::ZERO;
        for left in (0..steps).rev() {
            mass.device = position - motion * share(left);
            force = (mass.place - mass.device) * self.plan.stiffness_n_per_m
                + (mass.speed - velocity) * self.plan.damping_ns_per_m;
            mass.speed -= force * (period_s / self.plan.mass_kg);
            mass.place += mass.speed * period_s;
        }
        self.mass = Some(mass);
        force
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: InertiaPlan = InertiaPlan {
        mass_kg: 0.2,
        stiffness_n_per_m: 400.0,
        damping_ns_per_m: 4.0,
    };

    #[test]
    fn an_accelerated_device_gets_the_force_of_inertia() {
        let (a, period) = (3.0, 1e-3);
        let mut inertia = Inertia::new(PLAN);
        let mut force = DVec3::ZERO;
        for tick in 0..5000 {
            let t = period * f64::from(tick);
            let (place, speed) = (DVec3::X * (0.5 * a * t * t), DVec3::X * (a * t));
            force = inertia.force(place, speed, (1, period));
        }
        assert!(
            force.distance(DVec3::NEG_X * PLAN.mass_kg * a) < 1e-3,
            "{force}"
        );
        // With the device at rest the mass comes to rest.
        for _ in 0..5000 {
            force = inertia.force(DVec3::ZERO, DVec3::ZERO, (1, period));
        }
        assert!(force.length() < 1e-6, "{force}");
    }

    #[test]
    fn an_even_motion_stays_without_force_through_a_stall_of_any_length() {
        let (speed, period) = (DVec3::X * 0.1, 1e-3);
        for periods in [2, 19, 20, 21, 300, 60_000] {
            let mut inertia = Inertia::new(PLAN);
            let mut tick = 0u64;
            let mut force_after = |elapsed: u64| {
                tick += elapsed;
                let place = speed * (period * tick as f64);
                inertia.force(place, speed, (elapsed, period))
            };
            // Until the mass moves as the device does.
            for _ in 0..5000 {
                force_after(1);
            }
            for elapsed in [periods, 1] {
                let force = force_after(elapsed);
                assert!(force.length() < 1e-6, "{periods} periods: {force}");
            }
        }
    }
}
