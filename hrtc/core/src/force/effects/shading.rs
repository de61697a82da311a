//! Force shading: a smooth force direction over edges (Morgenbesser 1996), which hides the facets
//! of a mesh.
//!
//! The direction is a weighted mean of the normals of the faces within the radius r. The weight of
//! a face is the product of three terms, each continuous in the place of the proxy:
//!
//! - its area, at most that of the disc of radius r;
//! - `(1 - a² / r²)²`, with a the distance from the contact aside;
//! - the cosine between its normal and the direction to the proxy.
//!
//! A second round takes out the faces that turn from the mean by `max_turn / 2` or more, so sharper
//! edges stay sharp. All lengths are those of the object, so the result hardly depends on the level
//! of detail.
//!
//! A tool has no middle to see the faces from, and its contact point lies in them. A ball of radius
//! r that rests there, where the tool is pushed most, takes its place. A tool that touches
//! elsewhere too has a force of its own direction: it turns as that ball's would, by at most
//! `max_turn`. So it is not turned between two slopes, each of them smooth.
//!
//! A proxy deep below a ridge passes it in a few ticks, that of a tool in one. The direction
//! therefore turns by at most `max_turn` over a displacement r of the probe.

use super::{ContactSample, Rendered};
use crate::contact::query::{Work, faces_within};
use crate::tuning::force::MAX_SHADING_FACES;
use glam::{DQuat, DVec3};
use scene::ShadingPlan;

/// Shading of one surface for one probe.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Shading {
    plan: ShadingPlan,
    /// Direction of the last tick, unit vector in the object's axes; `None` before a contact.
    direction: Option<DVec3>,
}

impl Shading {
    /// Shading before any contact.
    #[must_use]
    pub fn new(plan: ShadingPlan) -> Self {
        Self {
            plan,
            direction: None,
        }
    }

    /// Ends the contact.
    pub fn reset(&mut self) {
        self.direction = None;
    }

    /// Turns the passive force; `amount` from 0 (not at all) to 1. The result is the work of the
    /// search.
    pub fn turn(&mut self, at: &ContactSample<'_>, amount: f64, out: &mut Rendered) -> Work {
        let size = out.passive.force.length();
        if !(size > 0.0 && size.is_finite()) {
            return Work::default();
        }
        let normal = out.passive.force / size;
        let radius = self.plan.radius_m / at.metres_per_unit;
        let disc = std::f64::consts::PI * radius * radius;
        let point = at.point / at.metres_per_unit;
        let pushed = at.pushed.unwrap_or(normal);
        let centre = at.middle.map_or(point + pushed * radius, |middle| {
            middle / at.metres_per_unit
        });
        let off = centre.distance(point);
        let mut weighed = [DVec3::ZERO; MAX_SHADING_FACES];
        let mut count = 0;
        let within = off.hypot(radius);
        let work = faces_within(at.surface, centre, within, |face, closest| {
            let [a, b, c] = at.surface.mesh.corners(face);
            let cross = (b - a).cross(c - a);
            let out = (centre - closest.point).normalize_or(pushed);
            // Negative for a proxy behind the face, which pushes against its own normal.
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
        let mean = mean.normalize_or(pushed);
        let sharp = (0.5 * self.plan.max_turn).cos();
        let kept: DVec3 = weighed
            .iter()
            .map(|face| {
                let alike = face.normalize_or_zero().dot(mean);
                *face * ((alike - sharp) / (1.0 - sharp)).max(0.0)
            })
            .sum();
        // At a sharp edge no face remains, and the force keeps its own direction.
        let smooth = kept.normalize_or(pushed);
        let wanted = match at.pushed {
            None => smooth,
            Some(pushed) => DQuat::from_rotation_arc(pushed, smooth) * normal,
        };
        let moved = at.velocity.length() * at.clock.period_s / self.plan.radius_m;
        let is_smooth = kept != DVec3::ZERO;
        let shaded = match self.direction {
            Some(last) if is_smooth => turned_to(last, wanted, moved * self.plan.max_turn),
            _ => wanted,
        };
        let shaded = match at.middle {
            Some(_) => shaded,
            None => turned_to(normal, shaded, self.plan.max_turn),
        };
        self.direction = Some(shaded);
        let shaded = normal.lerp(shaded, amount).normalize_or(normal);
        out.add_passive((shaded - normal) * size, at.arm);
        work
    }
}

/// A unit vector, turned towards another by at most an angle, radians.
fn turned_to(from: DVec3, to: DVec3, most: f64) -> DVec3 {
    let angle = from.angle_between(to);
    if angle <= most {
        return to;
    }
    let aside = (to - from * from.dot(to)).normalize_or_zero();
    (from * most.cos() + aside * most.sin()).normalize_or(to)
}
