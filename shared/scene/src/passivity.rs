//! Whether the surfaces of a scene are passive at the rate of its loop.
//!
//! A wall of stiffness K and damping B that is sampled every T and held in between is passive at a
//! device of damping b if `b >= K T / 2 + B` (Colgate 1994).

use crate::plan::ScenePlan;
use std::fmt;

/// A surface that the device of a probe does not make passive: of all that which needs most.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveSurface {
    /// Name of the object's model.
    pub model: String,
    /// Index of the probe.
    pub probe: usize,
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping of the surface, N s/m.
    pub damping_ns_per_m: f64,
    /// Damping that it needs, `K T / 2 + B`, N s/m.
    pub needed_ns_per_m: f64,
    /// Damping of the device, N s/m.
    pub device_ns_per_m: f64,
    /// Rate of the loop, 1/s.
    pub rate_hz: f64,
    /// Whether the energy account limits the force.
    pub is_limited: bool,
}

impl ActiveSurface {
    /// Looks at every surface and every device; `None` when all are passive.
    #[must_use]
    pub fn of(plan: &ScenePlan) -> Option<Self> {
        let rate_hz = plan.loop_.rate_hz;
        let probes = plan.probes.iter().enumerate();
        let least = probes.min_by(|(_, a), (_, b)| {
            a.device
                .damping_ns_per_m
                .total_cmp(&b.device.damping_ns_per_m)
        });
        let (probe, device_ns_per_m) = least.map(|(k, of)| (k, of.device.damping_ns_per_m))?;
        let needed = |surface: &crate::SurfacePlan| {
            0.5 * surface.stiffness_n_per_m / rate_hz + surface.damping_ns_per_m
        };
        let objects = plan.objects.iter();
        let most = objects.max_by(|a, b| needed(&a.surface).total_cmp(&needed(&b.surface)))?;
        let needed_ns_per_m = needed(&most.surface);
        (needed_ns_per_m > device_ns_per_m * (1.0 + ROUNDING)).then(|| Self {
            model: most.model.name(),
            probe,
            stiffness_n_per_m: most.surface.stiffness_n_per_m,
            damping_ns_per_m: most.surface.damping_ns_per_m,
            needed_ns_per_m,
            device_ns_per_m,
            rate_hz,
            is_limited: plan.safety.passivity,
        })
    }

    /// What of the device's damping the surface's own leaves, N s/m.
    fn left(&self) -> f64 {
        self.device_ns_per_m - self.damping_ns_per_m
    }
}

/// Of a surface that takes all of the device's damping, relative.
const ROUNDING: f64 = 1e-9;

impl fmt::Display for ActiveSurface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            model,
            probe,
            stiffness_n_per_m,
            damping_ns_per_m,
            needed_ns_per_m,
            device_ns_per_m,
            rate_hz,
            is_limited,
        } = self;
        write!(
            f,
            "at {rate_hz} ticks a second the surface of {model} ({stiffness_n_per_m} N/m, {damping_ns_per_m} N s/m) is passive at a device of {needed_ns_per_m:.3} N s/m or more, and that of probe {probe} has {device_ns_per_m}; "
        )?;
        if self.left() > 0.0 {
            // Both rounded to the safe side.
            let stiffness = (2.0 * self.left() * rate_hz).floor();
            let rate = (0.5 * stiffness_n_per_m / self.left()).ceil();
            write!(
                f,
                "lower its stiffness_n_per_m to {stiffness}, or raise rate_hz to {rate}"
            )?;
        } else {
            write!(
                f,
                "lower its damping_ns_per_m below {device_ns_per_m}, and its stiffness_n_per_m"
            )?;
        }
        if *is_limited {
            write!(
                f,
                ": else the energy account takes of the force what is too much"
            )
        } else {
            write!(f, ": passivity = false leaves that without a limit")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{NoFiles, Overrides, parse};
    use std::path::Path;

    fn at(rate_hz: f64, surface: &str) -> Option<ActiveSurface> {
        let text = format!(
            "[loop]\nrate_hz = {rate_hz:?}\n[[object]]\nmodel = \"a.spm\"\nsize_m = 0.1\n{surface}\n[[probe]]\n"
        );
        let plan = parse(&text, "t", Path::new(""), &Overrides::default(), &NoFiles).unwrap();
        ActiveSurface::of(&plan)
    }

    #[test]
    fn the_default_scene_is_passive_from_1_khz_on() {
        for rate_hz in [1000.0, 2000.0, 4000.0] {
            assert_eq!(at(rate_hz, ""), None);
        }
        for (rate_hz, needed, stiffness) in [(500.0, 1.3, 500), (250.0, 2.1, 250)] {
            let found = at(rate_hz, "").unwrap();
            assert!((found.needed_ns_per_m - needed).abs() < 1e-9);
            let sentence = found.to_string();
            let remedy = format!("stiffness_n_per_m to {stiffness}, or raise rate_hz to 800");
            assert!(sentence.contains(&remedy), "{sentence}");
            // Whoever follows it is passive.
            let surface = format!("surface = {{ stiffness_n_per_m = {stiffness}.0 }}");
            assert_eq!(at(rate_hz, &surface), None);
        }
        assert_eq!(at(800.0, ""), None);
        assert!(at(799.0, "").is_some());
    }

    #[test]
    fn a_surface_that_damps_more_than_the_device_has_another_remedy() {
        let found = at(4000.0, "surface = { damping_ns_per_m = 1.5 }").unwrap();
        assert!(found.to_string().contains("damping_ns_per_m below 1"));
    }
}
