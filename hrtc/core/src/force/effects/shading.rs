//! Force shading: the force turns from face to face as if edges were rounded (Morgenbesser and Srinivasan 1996), which
//! hides the facets of a mesh.
//!
//! The direction is the mean of the normals of the faces around the proxy. A face counts by its area, as far as it may
//! lie in the disc of the radius r; by (1 - a²/r²)², where a is how far aside of the contact it lies; and by how much it
//! faces the proxy. All three change continuously with the proxy's place, so the direction does. Faces that are turned
//! from the mean by half of `max_turn` or more are left out in a second round: so sharper edges stay sharp. It depends
//! on lengths of the object, not on faces: it feels alike at any level of detail.
//!
//! A proxy that is held deep below a ridge comes round it in one tick. So the direction follows no faster than the device
//! moves: by `max_turn` on a way of r.

use super::{ContactSample, Rendered};
use crate::contact::query::{Work, faces_within};
use glam::DVec3;
use scene::ShadingPlan;

/// Faces that count at the most; the search comes to the nearer part of the tree first.
const MAX_FACES: usize = 256;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct Shading {
    plan: ShadingPlan,
    /// The direction of the last tick.
    direction: Option<DVec3>,
}

impl Shading {
    /// Over a radius.
    #[must_use]
    pub fn new(plan: ShadingPlan) -> Self {
        Self {
            plan,
            direction: None,
        }
    }

    /// The surface is not touched any more.
    pub fn reset(&mut self) {
        self.direction = None;
    }

    /// Turns what resists. What it cost.
    pub fn turn(&mut self, at: &ContactSample<'_>, amount: f64, out: &mut Rendered) -> Work {
        let size = out.passive.force.length();
        if !(size > 0.0 && size.is_finite()) {
            return Work::default();
        }
        let normal = out.passive.force / size;
        let radius = self.plan.radius_m / at.metres_per_unit;
        let disc = std::f64::consts::PI * radius * radius;
        // Of a ball its middle, of a tool where it touches: both move without a jump.
        let centre = at.middle / at.metres_per_unit;
        let off = centre.distance(at.point / at.metres_per_unit);
        let mut weighed = [DVec3::ZERO; MAX_FACES];
        let mut count = 0;
        let within = off.hypot(radius);
        let work = faces_within(at.surface, centre, within, |face, closest| {
            let [a, b, c] = at.surface.mesh.corners(face);
            let cross = (b - a).cross(c - a);
            let out = (centre - closest.point).normalize_or(normal);
            // Negative on the other side of the front, where the face pushes against its own normal.
            let faces = cross.normalize_or_zero().dot(out);
            let aside = (closest.distance_squared - off * off).max(0.0) / (radius * radius);
            let near = (1.0 - aside).max(0.0);
            let weight = (0.5 * cross.length()).min(disc) * near * near * faces;
            if let Some(place) = weighed.get_mut(count) {
                *place = cross.normalize_or_zero() * weight;
                count += 1;
                within
            } else {
                0.0
            }
        });
        let weighed = &weighed[..count];
        let mean: DVec3 = weighed.iter().sum();
        let mean = mean.normalize_or(normal);
        let sharp = (0.5 * self.plan.max_turn).cos();
        let kept: DVec3 = weighed
            .iter()
            .map(|face| {
                let alike = face.normalize_or_zero().dot(mean);
                *face * ((alike - sharp) / (1.0 - sharp)).max(0.0)
            })
            .sum();
        // Over a sharp edge nothing is left: the force is the surface's own.
        let wanted = kept.normalize_or(normal);
        let moved = at.velocity.length() * at.clock.period_s / self.plan.radius_m;
        let is_smooth = kept != DVec3::ZERO;
        let shaded = match self.direction {
            Some(last) if is_smooth => turned_to(last, wanted, moved * self.plan.max_turn),
            _ => wanted,
        };
        self.direction = Some(shaded);
        let shaded = normal.lerp(shaded, amount).normalize_or(normal);
        out.add_passive((shaded - normal) * size, at.arm);
        work
    }
}

/// A unit vector turned towards another one, by an angle at the most.
fn turned_to(from: DVec3, to: DVec3, most: f64) -> DVec3 {
    let angle = from.angle_between(to);
    if angle <= most {
        return to;
    }
    let aside = (to - from * from.dot(to)).normalize_or_zero();
    (from * most.cos() + aside * most.sin()).normalize_or(to)
}
