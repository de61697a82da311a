//! Dry friction: a spring to where the surface was last held, as long as it is within the cone of friction (Hayward
//! and Armstrong 2000: displacement, not velocity, so that what sticks does not creep and what slides does not chatter
//! with the noise of a speed).
//!
//! `z` leads from the proxy to where it is held, along the surface. While it sticks, `z` is exactly what the proxy has
//! moved since; beyond `static` times the surface's force over its stiffness it slides, and `z` is dragged along at
//! `dynamic` times that, until it is less by itself.

use super::{Rendered, Touching};
use glam::DVec3;
use shared::geometry::Pose;
use shared::scene::FrictionPlan;

/// See the module.
#[derive(Debug, Clone)]
pub struct Friction {
    plan: FrictionPlan,
    held: Option<Held>,
}

#[derive(Debug, Clone, Copy)]
struct Held {
    /// The proxy in the last tick.
    proxy: Pose,
    /// `z`, metres.
    stretch: DVec3,
    slides: bool,
}

impl Friction {
    /// Of a surface that is not touched yet.
    #[must_use]
    pub fn new(plan: FrictionPlan) -> Self {
        Self { plan, held: None }
    }

    /// The surface is not touched any more.
    pub fn let_go(&mut self) {
        self.held = None;
    }

    /// Adds the force along the surface.
    pub fn resist(&mut self, at: &Touching<'_>, amount: f64, out: &mut Rendered) {
        let size = out.resists.force.length();
        if !(size > 0.0 && size.is_finite()) {
            self.held = None;
            return;
        }
        let normal = out.resists.force / size;
        let before = self.held.unwrap_or(Held {
            proxy: at.proxy,
            stretch: DVec3::ZERO,
            slides: false,
        });
        // The point of the proxy that touches now was there a tick ago.
        let was = before
            .proxy
            .transform_point(at.proxy.inverse_transform_point(at.point));
        let stretch = before.stretch - (at.point - was);
        let stretch = stretch - normal * normal.dot(stretch);
        let length = stretch.length();
        let most = |coefficient: f64| coefficient * size / at.stiffness_n_per_m;
        let holds = if before.slides {
            self.plan.dynamic
        } else {
            self.plan.static_
        };
        let slides = length > most(holds);
        let stretch = if slides {
            stretch * (most(self.plan.dynamic) / length)
        } else {
            stretch
        };
        self.held = Some(Held {
            proxy: at.proxy,
            stretch,
            slides,
        });
        out.resist(stretch * (at.stiffness_n_per_m * amount), at.arm);
        out.spring.stored_j += 0.5 * at.stiffness_n_per_m * amount * stretch.length_squared();
    }
}
