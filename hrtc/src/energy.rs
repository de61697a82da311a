//! The energy account of a probe (passivity observer, Hannaford and Ryu 2002).

use glam::DVec3;

/// Counts the energy that the rendering puts out, exact under zero-order hold (facts of haptics, F5).
#[derive(Debug, Clone, Default)]
pub struct EnergyAccount {
    joules: f64,
    last: Option<(DVec3, DVec3)>,
}

impl EnergyAccount {
    /// Force k acts over the period that ends with the sample of tick k + 1: `E += f[k] . (x[k+1] - x[k])`.
    ///
    /// Position in metres, force on the device in newtons, both of this tick.
    pub fn tick(&mut self, position: DVec3, force: DVec3) {
        if let Some((old_position, old_force)) = self.last {
            self.joules += old_force.dot(position - old_position);
        }
        self.last = Some((position, force));
    }

    /// Energy put out so far, joules; above 0 the rendering pushed energy into the hand.
    #[must_use]
    pub fn joules(&self) -> f64 {
        self.joules
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sampled_spring_leaks_what_theory_says() {
        // Into a wall of stiffness K at speed v and out again: the hold leaks K T / 2 * integral of v^2.
        let (k, v, dt) = (1000.0, 0.1, 1e-3);
        let mut account = EnergyAccount::default();
        let mut x: f64 = 0.0;
        for tick in 0..=40 {
            account.tick(DVec3::X * x, DVec3::X * (-k * x.max(0.0)));
            x += if tick < 20 { v * dt } else { -v * dt };
        }
        let leak = k * dt / 2.0 * v * v * (40.0 * dt);
        assert!(
            (account.joules() - leak).abs() < 1e-9,
            "{}",
            account.joules()
        );
    }
}
