//! Dry friction: a spring to where the surface was last held, as long as it is within the cone of friction (Hayward
//! and Armstrong 2000: displacement, not velocity, so that what sticks does not creep and what slides does not chatter
//! with the noise of a speed).
//!
//! `z` leads from the proxy to where it is held, along the surface. While it sticks, `z` is exactly what the proxy has
//! moved since; beyond `static` times the surface's force over its stiffness it slides, and `z` is dragged along at
//! `dynamic` times that, until it is less by itself.
//!
//! Within the cone it is a spring beside that of the surface, along the surface; the hold of a period leaks its energy
//! too, and it has an account of its own for that: so no closed path gains by it.

use super::{ContactSample, Rendered};
use crate::force::passivity::EnergyAccount;
use geometry::Pose;
use glam::DVec3;
use scene::FrictionPlan;

/// See the module.
#[derive(Debug, Clone)]
pub struct Friction {
    plan: FrictionPlan,
    anchor: Option<Anchor>,
    /// None where the scene wants no limit.
    account: Option<EnergyAccount>,
}

#[derive(Debug, Clone, Copy)]
struct Anchor {
    /// The proxy in the last tick.
    proxy: Pose,
    /// `z`, metres.
    deflection: DVec3,
    slides: bool,
}

impl Friction {
    /// Of a surface that is not touched yet. `encoder_m`: step of the device's encoder, metres; `None` where the scene
    /// wants no limit of energy.
    #[must_use]
    pub fn new(plan: FrictionPlan, encoder_m: Option<f64>) -> Self {
        Self {
            plan,
            anchor: None,
            account: encoder_m.map(EnergyAccount::new),
        }
    }

    /// The surface is not touched any more.
    pub fn reset(&mut self) {
        if self.anchor.take().is_some()
            && let Some(account) = &mut self.account
        {
            *account = account.restarted();
        }
    }

    /// Adds the force along the surface.
    pub fn render(&mut self, at: &ContactSample<'_>, amount: f64, out: &mut Rendered) {
        let size = out.passive.force.length();
        if !(size > 0.0 && size.is_finite()) {
            self.reset();
            return;
        }
        let normal = out.passive.force / size;
        let before = self.anchor.unwrap_or(Anchor {
            proxy: at.proxy,
            deflection: DVec3::ZERO,
            slides: false,
        });
        // The point of the proxy that touches now was there a tick ago.
        let was = before
            .proxy
            .transform_point(at.proxy.inverse_transform_point(at.point));
        let deflection = before.deflection - (at.point - was);
        let deflection = deflection - normal * normal.dot(deflection);
        let length = deflection.length();
        let most = |coefficient: f64| coefficient * size / at.stiffness_n_per_m;
        let holds = if before.slides {
            self.plan.dynamic
        } else {
            self.plan.static_
        };
        let slides = length > most(holds);
        let deflection = if slides {
            deflection * (most(self.plan.dynamic) / length)
        } else {
            deflection
        };
        self.anchor = Some(Anchor {
            proxy: at.proxy,
            deflection,
            slides,
        });
        let stiffness_n_per_m = at.stiffness_n_per_m * amount;
        let stored_j = 0.5 * stiffness_n_per_m * deflection.length_squared();
        let mut force = deflection * stiffness_n_per_m;
        if let Some(account) = &mut self.account {
            account.moved_to(&Pose::at(at.device), [0.0; 2]);
            account.dissipate_beyond(stored_j);
            let next = account.next();
            let deflection = deflection - (next - normal * normal.dot(next));
            let stored_j = 0.5 * stiffness_n_per_m * deflection.length_squared();
            force *= account.share_of_spring(force, stored_j);
            account.set_force(force);
        }
        out.add_passive(force, at.arm);
        out.spring.stored_j += stored_j;
    }
}
