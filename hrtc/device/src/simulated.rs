//! The simulated device: a mass with damping, an encoder, and a hand that holds it.
//!
//! The loop through it is closed: the rendered force moves the mass, the mass moves the probe. So a rendering
//! that is not stable shakes here as it would in a hand.

use super::{Capabilities, Device, Sample};
use geometry::{Pose, Wrench};
use glam::DVec3;
use scene::SimulatedDevicePlan;

/// Steps of the integrator a period.
const SUBSTEPS: u32 = 16;
/// What the simulated motors can do, newtons.
const FORCE_MAX_N: f64 = 10.0;

/// What the hand intends at the end of the coming period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intent {
    /// Pose, world, metres.
    pub pose: Pose,
    /// Velocity, m/s.
    pub velocity: DVec3,
}

/// A point mass at the end of a spring and damper that the hand holds.
#[derive(Debug, Clone)]
pub struct Simulated {
    plan: SimulatedDevicePlan,
    period_s: f64,
    position: DVec3,
    velocity: DVec3,
    force: DVec3,
    intent: Option<Intent>,
}

impl Simulated {
    /// At rest, held by nobody: it gives no sample until the hand intends something.
    #[must_use]
    pub fn new(plan: SimulatedDevicePlan, period_s: f64) -> Self {
        Self {
            plan,
            period_s,
            position: DVec3::ZERO,
            velocity: DVec3::ZERO,
            force: DVec3::ZERO,
            intent: None,
        }
    }

    /// Sets the hand's intent; the first one also puts the device there.
    pub fn intend(&mut self, intent: Intent) {
        if self.intent.is_none() {
            self.position = intent.pose.position;
            self.velocity = intent.velocity;
        }
        self.intent = Some(intent);
    }

    /// Exact state, without the encoder: position (m) and velocity (m/s).
    #[must_use]
    pub fn state(&self) -> (DVec3, DVec3) {
        (self.position, self.velocity)
    }

    /// One period under the held force, by symplectic Euler in [`SUBSTEPS`] steps.
    fn advance(&mut self, intent: Intent) {
        let dt = self.period_s / f64::from(SUBSTEPS);
        let plan = &self.plan;
        for step in 1..=SUBSTEPS {
            let to_end = f64::from(SUBSTEPS - step) * dt;
            let target = intent.pose.position - intent.velocity * to_end;
            let hand = (target - self.position) * plan.hand.stiffness_n_per_m
                + (intent.velocity - self.velocity) * plan.hand.damping_ns_per_m;
            let force = self.force + hand - self.velocity * plan.damping_ns_per_m;
            self.velocity += force * (dt / plan.mass_kg);
            self.position += self.velocity * dt;
        }
    }
}

impl Device for Simulated {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            name: "simulated".to_string(),
            force_max_n: FORCE_MAX_N,
            encoder_m: self.plan.encoder_m,
            torque: false,
        }
    }

    fn read(&mut self, periods: u32) -> Option<Sample> {
        let intent = self.intent?;
        // A long stall is a long stall: the force has been held for all of it.
        for _ in 0..periods.min(1000) {
            self.advance(intent);
        }
        let encoder = self.plan.encoder_m;
        let position = if encoder > 0.0 {
            (self.position / encoder).round() * encoder
        } else {
            self.position
        };
        Some(Sample {
            pose: Pose {
                position,
                orientation: intent.pose.orientation,
            },
        })
    }

    fn write(&mut self, wrench: Wrench) {
        self.force = wrench.force;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::Hand;

    const PLAN: SimulatedDevicePlan = SimulatedDevicePlan {
        mass_kg: 0.1,
        damping_ns_per_m: 1.0,
        encoder_m: 0.0,
        hand: Hand {
            stiffness_n_per_m: 200.0,
            damping_ns_per_m: 2.0,
        },
    };

    fn still(position: DVec3) -> Intent {
        Intent {
            pose: Pose::at(position),
            velocity: DVec3::ZERO,
        }
    }

    /// A sampled wall in the loop, from a contact at 0.1 m/s; the largest |x| in the last half second.
    fn rebound(stiffness: f64) -> f64 {
        let mut device = Simulated::new(PLAN, 1e-3);
        device.intend(still(DVec3::ZERO));
        device.velocity = DVec3::X * 0.1;
        let mut largest: f64 = 0.0;
        for tick in 0..2000 {
            let x = device.read(1).unwrap().pose.position.x;
            device.write(Wrench {
                force: DVec3::X * (-stiffness * x),
                torque: DVec3::ZERO,
            });
            if tick > 1500 {
                largest = largest.max(x.abs());
            }
        }
        largest
    }

    #[test]
    fn the_loop_is_closed_so_too_stiff_a_wall_is_unstable() {
        // b + b_hand = 3 N s/m: passive up to 2 b / T = 6000 N/m, and far beyond that it diverges.
        assert!(rebound(2000.0) < 1e-4);
        assert!(rebound(40_000.0) > 1.0);
    }

    #[test]
    fn the_encoder_quantises_and_the_state_does_not() {
        let mut device = Simulated::new(
            SimulatedDevicePlan {
                encoder_m: 1e-5,
                ..PLAN
            },
            1e-3,
        );
        assert!(device.read(1).is_none());
        device.intend(still(DVec3::new(1.234_567e-3, 0.0, 0.0)));
        let x = device.read(1).unwrap().pose.position.x;
        assert!((x / 1e-5 - (x / 1e-5).round()).abs() < 1e-9);
        assert!((device.state().0.x - 1.234_567e-3).abs() < 1e-12);
    }
}
