//! The simulated device: a mass with damping, an encoder, and a hand that holds it.
//!
//! The loop through it is closed: the rendered force moves the mass, and the mass moves the probe.
//! A rendering that is unstable in a hand is therefore unstable here as well.
//!
//! ```
//! use haptic_device::{Device, Intent, Pose, TickTime};
//! use simulated_device::SimulatedDevice;
//!
//! let plan = scene::SimulatedDevicePlan {
//!     mass_kg: 0.1,
//!     damping_ns_per_m: 1.0,
//!     encoder_m: 0.0,
//!     hand: scene::HandImpedance { stiffness_n_per_m: 200.0, damping_ns_per_m: 2.0 },
//! };
//! let mut device = SimulatedDevice::new(plan, 1e-3);
//! assert!(device.read(TickTime::default()).is_none(), "nobody holds it yet");
//! let pose = Pose::at(glam::DVec3::Z);
//! device.intend(Intent { pose, velocity: glam::DVec3::ZERO });
//! assert_eq!(device.read(TickTime::default()).unwrap().pose, pose);
//! ```

#![forbid(unsafe_code)]

use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{
    Capabilities, DegreesOfFreedom, Device, Intent, Sample, TickTime, WrenchCommand,
};
use scene::SimulatedDevicePlan;

/// Steps of the integrator a period.
const SUBSTEPS: u32 = 16;
/// Force limit of the simulated motors, newtons: that of a small desktop device.
const MAX_FORCE_N: f64 = 10.0;
/// Limit of the periods that one read simulates: bounds the work after a stall.
const MAX_PERIODS: u32 = 1000;

/// A point mass at the end of a spring and damper that the hand holds. Its orientation is the one
/// that the hand intends.
#[derive(Debug, Clone)]
pub struct SimulatedDevice {
    plan: SimulatedDevicePlan,
    period_s: f64,
    position: DVec3,
    velocity: DVec3,
    command: WrenchCommand,
    intent: Option<Intent>,
}

impl SimulatedDevice {
    /// At rest, held by nobody: it gives no sample until the hand intends something.
    #[must_use]
    pub fn new(plan: SimulatedDevicePlan, period_s: f64) -> Self {
        Self {
            plan,
            period_s,
            position: DVec3::ZERO,
            velocity: DVec3::ZERO,
            command: WrenchCommand::unlimited(Wrench::ZERO),
            intent: None,
        }
    }

    /// Exact state, without the encoder: position (m) and velocity (m/s).
    #[must_use]
    pub fn state(&self) -> (DVec3, DVec3) {
        (self.position, self.velocity)
    }

    /// One period under a constant rendered force (newtons), by symplectic Euler in [`SUBSTEPS`]
    /// steps.
    fn advance(&mut self, intent: Intent, rendered: DVec3) {
        let dt = self.period_s / f64::from(SUBSTEPS);
        let plan = &self.plan;
        for step in 1..=SUBSTEPS {
            let to_end = f64::from(SUBSTEPS - step) * dt;
            let target = intent.pose.position - intent.velocity * to_end;
            let hand = (target - self.position) * plan.hand.stiffness_n_per_m
                + (intent.velocity - self.velocity) * plan.hand.damping_ns_per_m;
            let force = rendered + hand - self.velocity * plan.damping_ns_per_m;
            self.velocity += force * (dt / plan.mass_kg);
            self.position += self.velocity * dt;
        }
    }

    /// The rendered force in the period that ends so many periods before a time, newtons: zero once
    /// the command is no longer valid.
    fn force_before(&self, time: TickTime, periods: u32) -> DVec3 {
        let period_ns = (self.period_s * 1e9) as u64;
        let begin = time
            .start_ns
            .saturating_sub(period_ns * (u64::from(periods) + 1));
        if begin < self.command.valid_until_ns {
            self.command.wrench.force
        } else {
            DVec3::ZERO
        }
    }
}

impl Device for SimulatedDevice {
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            sensed: DegreesOfFreedom::Six,
            position_resolution_m: self.plan.encoder_m,
            ..Capabilities::translational("simulated", MAX_FORCE_N)
        }
    }

    fn read(&mut self, time: TickTime) -> Option<Sample> {
        let intent = self.intent?;
        // The force has acted during skipped periods too.
        let periods = time.periods.min(MAX_PERIODS);
        for left in (0..periods).rev() {
            let force = self.force_before(time, left);
            self.advance(intent, force);
        }
        let encoder = self.plan.encoder_m;
        let position = if encoder > 0.0 {
            (self.position / encoder).round() * encoder
        } else {
            self.position
        };
        let pose = Pose {
            position,
            orientation: intent.pose.orientation,
        };
        Some(Sample {
            time_ns: time.start_ns,
            linear_velocity: Some(self.velocity),
            in_hand: Some(true),
            ..Sample::at(pose)
        })
    }

    fn write(&mut self, command: WrenchCommand) {
        self.command = command;
    }

    fn safe_off(&mut self) {
        self.command = WrenchCommand::unlimited(Wrench::ZERO);
    }

    /// Sets the hand's target; the first one also puts the device there.
    fn intend(&mut self, intent: Intent) {
        if self.intent.is_none() {
            self.position = intent.pose.position;
            self.velocity = intent.velocity;
        }
        self.intent = Some(intent);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::HandImpedance;

    const PLAN: SimulatedDevicePlan = SimulatedDevicePlan {
        mass_kg: 0.1,
        damping_ns_per_m: 1.0,
        encoder_m: 0.0,
        hand: HandImpedance {
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

    /// A command of this force along x, newtons.
    fn push(force_n: f64) -> WrenchCommand {
        WrenchCommand::unlimited(Wrench {
            force: DVec3::X * force_n,
            torque: DVec3::ZERO,
        })
    }

    /// A sampled wall in the loop, from a contact at 0.1 m/s; the largest |x| in the last half
    /// second.
    fn rebound(stiffness: f64) -> f64 {
        let mut device = SimulatedDevice::new(PLAN, 1e-3);
        device.intend(still(DVec3::ZERO));
        device.velocity = DVec3::X * 0.1;
        let mut largest: f64 = 0.0;
        for tick in 0..2000 {
            let x = device.read(TickTime::default()).unwrap().pose.position.x;
            device.write(push(-stiffness * x));
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
        let mut device = SimulatedDevice::new(
            SimulatedDevicePlan {
                encoder_m: 1e-5,
                ..PLAN
            },
            1e-3,
        );
        assert!(device.read(TickTime::default()).is_none());
        device.intend(still(DVec3::new(1.234_567e-3, 0.0, 0.0)));
        let x = device.read(TickTime::default()).unwrap().pose.position.x;
        assert!((x / 1e-5 - (x / 1e-5).round()).abs() < 1e-9);
        assert!((device.state().0.x - 1.234_567e-3).abs() < 1e-12);
    }

    /// Position after ten periods, m, of a device that a force holds against its hand.
    fn pushed(valid_until_ns: u64, is_off: bool) -> f64 {
        let mut device = SimulatedDevice::new(PLAN, 1e-3);
        device.intend(still(DVec3::ZERO));
        device.write(WrenchCommand {
            valid_until_ns,
            ..push(1.0)
        });
        if is_off {
            device.safe_off();
            device.safe_off();
        }
        let time = TickTime {
            start_ns: 20_000_000,
            periods: 10,
        };
        device.read(time).unwrap().pose.position.x
    }

    #[test]
    fn a_force_ends_with_its_validity_and_by_safe_off() {
        let whole = pushed(u64::MAX, false);
        let half = pushed(15_000_000, false);
        assert!(0.0 < half && half < whole, "{half} {whole}");
        assert_eq!(
            pushed(10_000_000, false),
            0.0,
            "ended before the first period"
        );
        assert_eq!(pushed(u64::MAX, true), 0.0);
    }
}
