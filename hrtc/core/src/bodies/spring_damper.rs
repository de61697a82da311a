//! What brings a body to rest: a spring and a damping of its own, solved for at the end of the step, so that any of
//! them is stable at any rate.

use scene::SpringDamperPlan;

/// Share of the speed that is lost in a second where the scene does not say.
const DECAY_PER_S: f64 = 2.0;

/// Spring and damping beside what they hold, of one coordinate: metres and kg, or radians and kg m².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpringDamper {
    pub inertia: f64,
    spring: f64,
    damping: f64,
}

impl SpringDamper {
    pub fn new(plan: &SpringDamperPlan, inertia: f64) -> Self {
        let default_damping = || (DECAY_PER_S * inertia).max(2.0 * (plan.spring * inertia).sqrt());
        Self {
            inertia,
            spring: plan.spring,
            damping: plan.damping.unwrap_or_else(default_damping),
        }
    }

    /// The speed after a step under a force; `at`: where it is, from the rest place.
    ///
    /// `m (v' - v) / T = F - k (x + T v') - d v'`.
    pub fn speed_after(&self, speed: f64, force: f64, at: f64, period_s: f64) -> f64 {
        let gain = period_s / self.inertia;
        let resistance = 1.0 + gain * (self.damping + self.spring * period_s);
        (speed + gain * (force - self.spring * at)) / resistance
    }
}

/// A coordinate that a force moves: a way or an angle, perhaps between two stops, which take all of the speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coordinate {
    pub at: f64,
    speed: f64,
    spring_damper: SpringDamper,
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

    /// A step under a force, no faster than `fastest`.
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

    pub fn kinetic_j(&self) -> f64 {
        0.5 * self.spring_damper.inertia * self.speed * self.speed
    }

    pub fn stop(&mut self) {
        self.speed = 0.0;
    }
}
