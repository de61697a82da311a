//! Spring and damper of one coordinate of a body.
//!
//! A step is implicit in both, so it is stable at any stiffness, damping and rate.

use crate::tuning::bodies::DEFAULT_DECAY_PER_S;
use scene::SpringDamperPlan;

/// Inertia, spring and damper of one coordinate: of a displacement (kg, N/m, N s/m) or of an angle
/// (kg m², N m/rad, N m s/rad).
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SpringDamper {
    pub inertia: f64,
    spring: f64,
    damping: f64,
}

impl SpringDamper {
    /// Without a damping in the plan it is the larger of `2 m` per second and the critical damping
    /// `2 √(k m)`.
    pub fn new(plan: &SpringDamperPlan, inertia: f64) -> Self {
        let default_damping =
            || (DEFAULT_DECAY_PER_S * inertia).max(2.0 * (plan.spring * inertia).sqrt());
        Self {
            inertia,
            spring: plan.spring,
            damping: plan.damping.unwrap_or_else(default_damping),
        }
    }

    /// Speed v' after a period T under a force F, from the speed v at the displacement x (`at`)
    /// from the rest place: the solution of `m (v' - v) / T = F - k (x + T v') - d v'`.
    pub fn speed_after(&self, speed: f64, force: f64, at: f64, period_s: f64) -> f64 {
        let gain = period_s / self.inertia;
        let resistance = 1.0 + gain * (self.damping + self.spring * period_s);
        (speed + gain * (force - self.spring * at)) / resistance
    }
}

/// A coordinate that a force moves: a displacement in metres or an angle in radians.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Coordinate {
    /// Value now, 0 in the scene.
    pub at: f64,
    speed: f64,
    spring_damper: SpringDamper,
    /// Smallest and largest value. A stop is inelastic: the speed becomes 0.
    limits: Option<[f64; 2]>,
}

impl Coordinate {
    /// At rest at 0.
    pub fn new(spring_damper: SpringDamper, limits: Option<[f64; 2]>) -> Self {
        Self {
            at: 0.0,
            speed: 0.0,
            spring_damper,
            limits,
        }
    }

    /// One period under a force; the speed is at most `fastest`. A speed that is not a number is 0.
    pub fn step(&mut self, force: f64, period_s: f64, fastest: f64) {
        let speed = self
            .spring_damper
            .speed_after(self.speed, force, self.at, period_s);
        self.speed = if speed.is_nan() {
            0.0
        } else {
            speed.clamp(-fastest, fastest)
        };
        self.at += self.speed * period_s;
        if let Some([least, most]) = self.limits
            && !(least..=most).contains(&self.at)
        {
            self.at = self.at.clamp(least, most);
            self.speed = 0.0;
        }
    }

    /// Mass or moment of inertia.
    pub fn inertia(&self) -> f64 {
        self.spring_damper.inertia
    }

    /// In either direction.
    pub fn speed(&self) -> f64 {
        self.speed.abs()
    }

    pub fn kinetic_j(&self) -> f64 {
        0.5 * self.spring_damper.inertia * self.speed * self.speed
    }

    pub fn stop(&mut self) {
        self.speed = 0.0;
    }
}
