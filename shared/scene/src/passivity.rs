//! Whether the surfaces of a scene are passive at the rate of its loop.
//!
//! A wall of stiffness K and damping B that is sampled every T and held in between is passive at a
//! device of damping b if `b >= K T / 2 + B` (Colgate 1994).

use crate::limits::MAX_RATE_HZ;
use crate::plan::{Effect, ModelSource, ScenePlan, SurfacePlan};
use std::fmt;

/// A surface that the device of a probe does not make passive: of all that which needs most. The
/// boundary of the workspace is a surface without damping.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveSurface {
    /// Name of the object's model; `None` for the boundary of the workspace.
    pub model: Option<String>,
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
    /// Whether that is assumed, of a custom device.
    pub is_assumed: bool,
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
        let (probe, least) = probes.min_by(|(_, a), (_, b)| {
            a.device
                .damping_ns_per_m
                .total_cmp(&b.device.damping_ns_per_m)
        })?;
        let device_ns_per_m = least.device.damping_ns_per_m;
        let needed = |surface: &SurfacePlan| {
            0.5 * surface.stiffness_n_per_m / rate_hz + surface.damping_ns_per_m
        };
        let (model, most) =
            surfaces(plan).max_by(|(_, a), (_, b)| needed(a).total_cmp(&needed(b)))?;
        let needed_ns_per_m = needed(&most);
        (needed_ns_per_m > device_ns_per_m * (1.0 + ROUNDING)).then(|| Self {
            model: model.map(ModelSource::name),
            probe,
            stiffness_n_per_m: most.stiffness_n_per_m,
            damping_ns_per_m: most.damping_ns_per_m,
            needed_ns_per_m,
            device_ns_per_m,
            is_assumed: least.custom_device.is_some(),
            rate_hz,
            is_limited: plan.safety.passivity,
        })
    }

    /// What makes it passive, of what a scene may say.
    fn remedy(&self) -> String {
        // What of the device's damping the surface's own leaves.
        let left = self.device_ns_per_m - self.damping_ns_per_m;
        // Both rounded to the safe side.
        let stiffness = |damping: f64| (2.0 * damping * self.rate_hz).floor();
        let (softer, faster) = (
            stiffness(left),
            (0.5 * self.stiffness_n_per_m / left).ceil(),
        );
        match (softer >= 1.0, left > 0.0 && faster <= MAX_RATE_HZ) {
            (true, true) => {
                format!("lower its stiffness_n_per_m to {softer}, or raise rate_hz to {faster}")
            }
            (true, false) => format!("lower its stiffness_n_per_m to {softer}"),
            (false, true) => format!("raise rate_hz to {faster}"),
            (false, false) if stiffness(self.device_ns_per_m) >= 1.0 => format!(
                "lower its damping_ns_per_m well below {}, and its stiffness_n_per_m",
                self.device_ns_per_m
            ),
            (false, false) => "take a device with more damping".to_string(),
        }
    }
}

/// The surfaces of a scene, each with its object's model.
fn surfaces(plan: &ScenePlan) -> impl Iterator<Item = (Option<&ModelSource>, SurfacePlan)> {
    let boundaries = plan.effects.iter().filter_map(|of| match &of.effect {
        Effect::Boundary(of) => Some(SurfacePlan {
            stiffness_n_per_m: of.stiffness_n_per_m,
            damping_ns_per_m: 0.0,
        }),
        _ => None,
    });
    let objects = plan.objects.iter();
    boundaries
        .map(|surface| (None, surface))
        .chain(objects.map(|of| (Some(&of.model), of.surface)))
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
            is_assumed,
            rate_hz,
            is_limited,
        } = self;
        write!(f, "at {rate_hz} ticks a second ")?;
        match model {
            Some(model) => write!(f, "the surface of {model}")?,
            None => write!(f, "the boundary of the workspace")?,
        }
        let has = if *is_assumed {
            "is assumed to have"
        } else {
            "has"
        };
        write!(
            f,
            " ({stiffness_n_per_m} N/m, {damping_ns_per_m} N s/m) is passive at a device of {needed_ns_per_m:.3} N s/m or more, and that of probe {probe} {has} {device_ns_per_m}; {}",
            self.remedy()
        )?;
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
        of_scene(rate_hz, "", surface, "")
    }

    fn of_scene(rate_hz: f64, effect: &str, surface: &str, device: &str) -> Option<ActiveSurface> {
        let text = format!(
            "effects = [{effect}]\n[loop]\nrate_hz = {rate_hz:?}\n[[object]]\nmodel = \"a.spm\"\nsize_m = 0.1\n{surface}\n[[probe]]\n{device}\n"
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
        assert!(
            found
                .to_string()
                .contains("damping_ns_per_m well below 1, and")
        );
    }

    #[test]
    fn what_a_scene_may_not_say_is_no_remedy() {
        let damped = |damping: f64| {
            format!("device = {{ simulated = {{ damping_ns_per_m = {damping:?} }} }}")
        };
        let undamped = "surface = { damping_ns_per_m = 0.0 }";
        let stiff = "surface = { stiffness_n_per_m = 1e6 }";
        for (surface, device, remedy) in [
            // Passive at a million ticks a second.
            (stiff, damped(1.0), "; lower its stiffness_n_per_m to 1000:"),
            // Passive at 0.2 N/m.
            (undamped, damped(1e-4), "; take a device with more damping:"),
            (undamped, damped(0.0), "; take a device with more damping:"),
            ("", damped(0.0), "; take a device with more damping:"),
            // Of the device's damping next to nothing is left.
            (
                "surface = { damping_ns_per_m = 0.9999 }",
                damped(1.0),
                "; lower its damping_ns_per_m well below 1, and its stiffness_n_per_m:",
            ),
        ] {
            let found = of_scene(1000.0, "", surface, &device).unwrap().to_string();
            assert!(found.contains(remedy), "{found}");
        }
    }

    #[test]
    fn the_boundary_of_the_workspace_is_a_surface_without_damping() {
        let boundary = |stiffness: f64| {
            let boundary = format!(
                "{{ boundary = {{ ball = {{ radius_m = 1.0 }}, stiffness_n_per_m = {stiffness:?} }} }}"
            );
            of_scene(1000.0, &boundary, "", "")
        };
        assert_eq!(boundary(2000.0), None);
        let found = boundary(5000.0).unwrap().to_string();
        for part in [
            "the boundary of the workspace (5000 N/m, 0 N s/m)",
            "stiffness_n_per_m to 2000, or raise rate_hz to 2500",
        ] {
            assert!(found.contains(part), "{found}");
        }
    }

    #[test]
    fn the_damping_of_a_custom_device_is_assumed() {
        let custom = "device = { custom = { name = \"arm\" } }";
        let found = of_scene(500.0, "", "", custom).unwrap().to_string();
        assert!(found.contains("probe 0 is assumed to have 1;"), "{found}");
        let simulated = at(500.0, "").unwrap().to_string();
        assert!(simulated.contains("probe 0 has 1;"), "{simulated}");
    }
}
