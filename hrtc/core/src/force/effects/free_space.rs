//! What a surface does to a probe that does not touch it.

use super::{Clock, SurfaceEffect, SurfaceEffects};
use geometry::Wrench;
use glam::DVec3;

/// The space between a probe and a surface, in the object's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Distance of the surface from that of the probe, metres; 0 where they touch.
    pub width_m: f64,
    /// Unit vector from the probe to the surface; zero without a direction.
    pub towards: DVec3,
    /// Nearest point of the probe from its position, metres; zero for a ball.
    pub arm: DVec3,
}

impl SurfaceEffects {
    /// Distance up to which the surface pulls a probe in a tick, metres; 0 where it does not.
    #[must_use]
    pub fn reach_m(&self, clock: Clock) -> f64 {
        let reaches = self
            .listed
            .iter()
            .filter_map(|listed| match &listed.effect {
                SurfaceEffect::Magnet(magnet) => {
                    (listed.switch.amount(clock) > 0.0).then(|| magnet.reach_m())
                }
                _ => None,
            });
        reaches.fold(0.0, f64::max)
    }

    /// Wrench on a probe without contact, newtons and newton metres about its position. `gap`:
    /// `None` where it is unknown or beyond the reach. It resets the effects of a contact.
    pub fn render_near(&mut self, clock: Clock, gap: Option<&Gap>) -> Wrench {
        let mut wrench = Wrench::ZERO;
        self.contacts.reset();
        for listed in &mut self.listed {
            match &mut listed.effect {
                SurfaceEffect::Friction(friction) => friction.reset(),
                SurfaceEffect::Shading(shading) => shading.reset(),
                _ => {}
            }
            if !matches!(listed.effect, SurfaceEffect::Magnet(_)) {
                continue;
            }
            if let Some((SurfaceEffect::Magnet(magnet), amount)) = listed.called(clock)
                && let Some(gap) = gap
            {
                let force = magnet.pull(gap.width_m, gap.towards) * amount;
                wrench.force += force;
                wrench.torque += gap.arm.cross(force);
            }
        }
        wrench
    }
}
