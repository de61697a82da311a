//! Dry friction: a spring along the surface that depends on displacement, not on velocity
//! (Hayward 2000). A sticking contact does not creep, and the noise of a velocity does not make a
//! sliding one chatter.
//!
//! The deflection `z` points along the surface from the contact to its anchor. With μ the
//! coefficient of friction, F the force of the surface and K its stiffness:
//!
//! - Sticking: `z` changes by the motion of the proxy, while `|z| <= μ_static F / K`.
//! - Sliding: `|z|` stays at `μ_dynamic F / K`, until the motion makes it less.
//!
//! The force is `K z`. A period of hold puts out energy as with any sampled spring (Colgate 1994),
//! so friction has an energy account of its own, and no closed path gains energy.

use super::{ContactSample, Rendered};
use crate::force::passivity::EnergyAccount;
use geometry::Pose;
use glam::DVec3;
use scene::FrictionPlan;

/// Friction of one surface on one probe.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Friction {
    plan: FrictionPlan,
    anchor: Option<Anchor>,
    /// `None` without an energy limit.
    account: Option<EnergyAccount>,
}

#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Anchor {
    /// Pose of the proxy in the last tick.
    proxy: Pose,
    /// `z`, metres, object's axes.
    deflection: DVec3,
    /// Whether it slid in the last tick.
    slides: bool,
}

impl Friction {
    /// Friction before any contact. `account`: an empty one of the device; `None` without an energy
    /// limit.
    #[must_use]
    pub fn new(plan: FrictionPlan, account: Option<EnergyAccount>) -> Self {
        Self {
            plan,
            anchor: None,
            account,
        }
    }

    /// Ends the contact.
    pub fn reset(&mut self) {
        if self.anchor.take().is_some()
            && let Some(account) = &mut self.account
        {
            *account = account.restarted();
        }
    }

    /// Adds the friction to the passive wrench, scaled by `amount` (0 to 1).
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
        // Place of the contact's material point of the proxy one tick ago.
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
            account.moved_to(&Pose::at(at.device), [1; 2], [0.0; 2]);
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
