//! The device of the cases: a mass, free or in a hand, that keeps its own account of energy.

use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{Device, Intent, TickTime, WrenchCommand};
use scene::{HandImpedance, SimulatedDevicePlan};
use simulated_device::SimulatedDevice;

/// The device that the cases name: 0.1 kg with 1 N s/m, in nobody's hand.
#[derive(Debug)]
pub struct FreeMass {
    device: SimulatedDevice,
    /// Work of the rendered forces over the exact motion, joules.
    work_j: f64,
}

/// Mass of the device, kg.
pub const MASS_KG: f64 = 0.1;
/// Its damping, N s/m.
pub const DAMPING_NS_PER_M: f64 = 1.0;

impl FreeMass {
    /// At a place with a velocity, in periods of `period_s`; `encoder_m` is the step of its encoder
    /// or 0.
    #[must_use]
    pub fn new(place: DVec3, velocity: DVec3, period_s: f64, encoder_m: f64) -> Self {
        Self::held(place, velocity, period_s, encoder_m, [0.0, 0.0])
    }

    /// Another device, of this mass, kg, and damping, N s/m.
    #[must_use]
    pub fn of(
        [mass_kg, damping_ns_per_m]: [f64; 2],
        place: DVec3,
        velocity: DVec3,
        period_s: f64,
    ) -> Self {
        let plan = SimulatedDevicePlan {
            mass_kg,
            damping_ns_per_m,
            encoder_m: 0.0,
            hand: HandImpedance {
                stiffness_n_per_m: 0.0,
                damping_ns_per_m: 0.0,
            },
            ..SimulatedDevicePlan::default()
        };
        Self::planned(plan, place, velocity, period_s)
    }

    /// Held to `place` by a hand of this stiffness (N/m) and damping (N s/m).
    #[must_use]
    pub fn held(
        place: DVec3,
        velocity: DVec3,
        period_s: f64,
        encoder_m: f64,
        [stiffness_n_per_m, damping_ns_per_m]: [f64; 2],
    ) -> Self {
        let plan = SimulatedDevicePlan {
            mass_kg: MASS_KG,
            damping_ns_per_m: DAMPING_NS_PER_M,
            encoder_m,
            hand: HandImpedance {
                stiffness_n_per_m,
                damping_ns_per_m,
            },
            ..SimulatedDevicePlan::default()
        };
        Self::planned(plan, place, velocity, period_s)
    }

    fn planned(plan: SimulatedDevicePlan, place: DVec3, velocity: DVec3, period_s: f64) -> Self {
        let mut device = SimulatedDevice::new(plan, period_s);
        device.intend(Intent {
            velocity,
            ..Intent::still(Pose::at(place))
        });
        Self {
            device,
            work_j: 0.0,
        }
    }

    /// Moves the place that the hand holds it to.
    pub fn intend(&mut self, place: DVec3, velocity: DVec3) {
        self.device.intend(Intent {
            velocity,
            ..Intent::still(Pose::at(place))
        });
    }

    /// Its velocity, m/s.
    #[must_use]
    pub fn velocity(&self) -> DVec3 {
        self.device.state().velocity
    }

    /// Its exact position, metres.
    #[must_use]
    pub fn position(&self) -> DVec3 {
        self.device.state().pose.position
    }

    /// Energy that the forces have put into it so far, joules: force times exact motion, period by
    /// period, without a look at the product's account or at the encoder.
    #[must_use]
    pub fn work_j(&self) -> f64 {
        self.work_j
    }

    /// A period under the force; what the encoder reads then.
    pub fn advance(&mut self, force: DVec3) -> DVec3 {
        let before = self.position();
        self.device.write(WrenchCommand::unlimited(Wrench {
            force,
            torque: DVec3::ZERO,
        }));
        let sample = self.device.read(TickTime::default());
        self.work_j += force.dot(self.position() - before);
        sample.map_or(DVec3::NAN, |sample| sample.pose.position)
    }
}

/// The same along z with dry friction: it holds still while no more than that pulls.
#[derive(Debug)]
pub struct DryMass {
    /// Exact height, metres.
    pub height: f64,
    speed: f64,
    /// The hand's stiffness, N/m, and damping, N s/m.
    hand: [f64; 2],
    dry_n: f64,
}

impl DryMass {
    /// Steps in a period.
    const STEPS: u32 = 64;

    /// At rest at a height, metres, in a hand, with so much dry friction, newtons.
    #[must_use]
    pub fn new(height: f64, hand: [f64; 2], dry_n: f64) -> Self {
        Self {
            height,
            speed: 0.0,
            hand,
            dry_n,
        }
    }

    /// A period under a force, while the hand wants it at a height.
    pub fn advance(&mut self, wanted: f64, force: f64, period_s: f64) {
        let dt = period_s / f64::from(Self::STEPS);
        for _ in 0..Self::STEPS {
            let pull = (wanted - self.height) * self.hand[0] - self.speed * self.hand[1];
            let sum = force + pull - self.speed * DAMPING_NS_PER_M;
            let free = self.speed + sum * (dt / MASS_KG);
            // Implicit in the friction: it takes speed, and never turns it.
            let taken = self.dry_n * (dt / MASS_KG);
            self.speed = free.signum() * (free.abs() - taken).max(0.0);
            self.height += self.speed * dt;
        }
    }
}
