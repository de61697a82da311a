//! Force shading: the force turns from face to face as if edges were rounded (Morgenbesser and Srinivasan 1996), which
//! hides the facets of a mesh.
//!
//! The direction is the mean of the normals of the faces around the contact: each counts by its area, as far as it may
//! lie in the ball, times (1 - d²/r²)² for its distance d, and less the more it is turned from the force, down to
//! nothing at `max_turn`: sharper edges stay sharp. All three are continuous, so the force is. It depends on lengths of
//! the object, not on faces: it feels alike at any level of detail.

use super::{Rendered, Touching};
use crate::query::{Work, faces_within};
use glam::DVec3;
use shared::scene::ShadingPlan;

/// Nodes and faces that are looked at, at the most, before what was seen must do.
const MOST_WORK: u32 = 512;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Shading {
    plan: ShadingPlan,
}

impl Shading {
    /// Over a radius.
    #[must_use]
    pub fn new(plan: ShadingPlan) -> Self {
        Self { plan }
    }

    /// Turns what resists. What it cost.
    pub fn turn(&self, at: &Touching<'_>, amount: f64, out: &mut Rendered) -> Work {
        let size = out.resists.force.length();
        if !(size > 0.0 && size.is_finite()) {
            return Work::default();
        }
        let normal = out.resists.force / size;
        let radius = self.plan.radius_m / at.metres_per_unit;
        let sharp = self.plan.max_turn.cos();
        let disc = std::f64::consts::PI * radius * radius;
        let mut sum = DVec3::ZERO;
        let mut seen = 0;
        let centre = at.point / at.metres_per_unit;
        let work = faces_within(at.surface, centre, radius, |face, closest| {
            let [a, b, c] = at.surface.mesh.corners(face);
            let cross = (b - a).cross(c - a);
            let length = cross.length();
            // On the other side of the front the force turns against the face's own normal.
            let facing = if length > 0.0 {
                cross.dot(normal) / length
            } else {
                0.0
            };
            let alike = ((facing.abs() - sharp) / (1.0 - sharp)).max(0.0);
            let near = (1.0 - closest.distance_squared / (radius * radius)).max(0.0);
            let weight = (0.5 * length).min(disc) * near * near * alike;
            if weight > 0.0 {
                sum += cross * (facing.signum() * weight / length);
            }
            seen += 1;
            // The nearest come first, as a rule: in a dense mesh a smaller ball does.
            if seen > MOST_WORK { 0.0 } else { radius }
        });
        if let Some(shaded) = sum.try_normalize() {
            let shaded = (normal.lerp(shaded, amount)).normalize_or(normal);
            let turned = (shaded - normal) * size;
            out.resist(turned, at.arm);
        }
        work
    }
}
