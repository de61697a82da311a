//! The stability limits of the effects that may put out energy: of each, and of all that act at
//! once.

use crate::plan::{Effect, EffectPlan, ScenePlan, TrajectoryPlan};
use crate::source::{SceneError, Source};
use crate::typed::EffectTyped;
use toml::Spanned;

/// Limits of what the loop and its devices can render.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    pub(super) rate_hz: f64,
    pub(super) force_max_n: f64,
    pub(super) slew_n_per_s: f64,
    /// Mass of the lightest device.
    pub(super) mass_kg: f64,
    /// Damping of the least damped device.
    pub(super) damping_ns_per_m: f64,
    /// Speed of the fastest trajectory, m/s.
    pub(super) speed_m_per_s: f64,
}

/// Shares of the limits that an effect takes, 1 for all of them.
#[derive(Clone, Copy)]
struct Shares {
    stiffness: f64,
    damping: f64,
}

impl Shares {
    fn of(effect: &Effect, limits: &Limits) -> Self {
        // What has no stiffness takes nothing of a limit that is 0, on a device without damping.
        let share = |of: f64, limit: f64| if of == 0.0 { 0.0 } else { of / limit };
        let shares = |limits: Limits, stiffness: f64, damping: f64| Self {
            stiffness: share(stiffness, limits.stiffness(damping)),
            damping: share(damping, limits.damping()),
        };
        match effect {
            Effect::Spring(of) => shares(*limits, of.stiffness_n_per_m, of.damping_ns_per_m),
            Effect::Magnet(of) => shares(*limits, steepest(of.force_n, of.reach_m), 0.0),
            Effect::Inertia(of) => shares(
                limits.with_mass(of.mass_kg),
                of.stiffness_n_per_m,
                of.damping_ns_per_m,
            ),
            Effect::Viscosity { damping_ns_per_m } => shares(*limits, 0.0, *damping_ns_per_m),
            _ => shares(*limits, 0.0, 0.0),
        }
    }

    fn takes(&self, what: &str) -> bool {
        let share = if what == "damping" {
            self.damping
        } else {
            self.stiffness
        };
        share > 0.0
    }
}

/// Checks the effects of a probe near one surface: those that act at once take all of the
/// stability limits at the most. Since the limit of a stiffness is linear in its damping, the sum
/// of the shares bounds the sum of the stiffnesses by the sum of the dampings, whichever of the
/// effects are switched off.
///
/// A magnet of another surface nearby is not counted: the limits are half of what is stable.
pub(super) fn check(
    source: &Source,
    limits: &Limits,
    effects: &[(&Spanned<EffectTyped>, EffectPlan)],
) -> Result<(), SceneError> {
    for (entry, last) in effects.iter().rev() {
        // At the start of an effect the most of them act, or at that of another one.
        let acts =
            |of: &EffectPlan| of.from_s <= last.from_s && last.from_s < of.until_s + of.fade_s;
        let acting = || effects.iter().map(|(_, of)| of).filter(|of| acts(of));
        let sum = |share: fn(&Shares) -> f64| -> f64 {
            acting()
                .map(|of| share(&Shares::of(&of.effect, limits)))
                .sum()
        };
        let sums = [
            ("stiffness", sum(|of| of.stiffness)),
            ("damping", sum(|of| of.damping)),
        ];
        for (what, sum) in sums {
            // Each is within its own limit, so a single one is refused by that.
            if sum > 1.0 + ROUNDING && Shares::of(&last.effect, limits).takes(what) {
                let names: Vec<&str> = acting()
                    .filter(|of| Shares::of(&of.effect, limits).takes(what))
                    .map(|of| of.effect.name())
                    .collect();
                return Err(source.value(entry, &format!(
                    "{} together take {sum:.2} times the {what} that this loop holds stable on this device; lower one of them, or let them act at other times (from_s, until_s)",
                    names.join(", ")
                )));
            }
        }
    }
    Ok(())
}

/// Rounding of a sum of shares that is 1.
const ROUNDING: f64 = 1e-9;

/// Largest decrease of a magnet's force per metre, N/m; it acts like a stiffness.
pub(super) fn steepest(force_n: f64, reach_m: f64) -> f64 {
    4.0 * force_n / reach_m
}

impl Limits {
    pub(super) fn new(plan: &ScenePlan) -> Self {
        let devices = || plan.probes.iter().map(|probe| probe.device);
        let paths = plan.probes.iter().map(|probe| &probe.trajectory);
        Self {
            rate_hz: plan.loop_.rate_hz,
            force_max_n: plan.safety.force_max_n,
            slew_n_per_s: plan.safety.slew_n_per_s,
            mass_kg: devices().fold(f64::INFINITY, |min, device| min.min(device.mass_kg)),
            damping_ns_per_m: devices().fold(f64::INFINITY, |min, device| {
                min.min(device.damping_ns_per_m)
            }),
            speed_m_per_s: paths
                .map(TrajectoryPlan::greatest_speed_m_per_s)
                .fold(0.0, f64::max),
        }
    }

    /// With a mass that the device carries: the two oscillate against each other, and the lighter
    /// one sets the limits.
    pub(super) fn with_mass(&self, mass_kg: f64) -> Self {
        Self {
            mass_kg: self.mass_kg.min(mass_kg),
            ..*self
        }
    }

    /// Largest damping that the loop can render on a device, N s/m. In one tick it may take half of
    /// the speed of a mass, since speed is measured over the tick before.
    pub(super) fn damping(&self) -> f64 {
        0.5 * self.mass_kg * self.rate_hz
    }

    /// Largest stiffness that the loop can render with a damping, N/m.
    ///
    /// A sampled spring K and damper B on a device of damping b is stable up to K = 2 (b + B) / T
    /// (Gil 2004), where it oscillates for seconds. The limit is half of that, with half of B,
    /// which acts late, and at most a quarter of the mass's oscillation in a tick. `rt-tests
    /// stability fields` tests the limit.
    pub(super) fn stiffness(&self, damping: f64) -> f64 {
        let damped = (self.damping_ns_per_m + 0.5 * damping) * self.rate_hz;
        damped.min(0.25 * self.mass_kg * self.rate_hz * self.rate_hz)
    }
}
