//! Viscosity: drag, -c v, of the velocity that the energy account follows (first-order adaptive windowing).

use glam::DVec3;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Viscosity {
    damping_ns_per_m: f64,
}

impl Viscosity {
    /// Of so many N s/m.
    #[must_use]
    pub fn new(damping_ns_per_m: f64) -> Self {
        Self { damping_ns_per_m }
    }

    /// Newtons at a velocity, m/s.
    #[must_use]
    pub fn force(&self, velocity: DVec3) -> DVec3 {
        velocity * -self.damping_ns_per_m
    }
}
