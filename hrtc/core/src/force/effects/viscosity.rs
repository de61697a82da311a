//! Viscosity: drag `-c v`, with the velocity estimate of the energy account (Janabi-Sharifi 2000).

use glam::DVec3;

/// Drag in the whole scene.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Viscosity {
    damping_ns_per_m: f64,
}

impl Viscosity {
    /// Drag with a coefficient c, N s/m.
    #[must_use]
    pub fn new(damping_ns_per_m: f64) -> Self {
        Self { damping_ns_per_m }
    }

    /// Force (newtons) at a velocity (m/s), world.
    #[must_use]
    pub fn force(&self, velocity: DVec3) -> DVec3 {
        velocity * -self.damping_ns_per_m
    }
}
