//! Paths over a surface, straight as a hand draws them: from point to point along the tangent
//! plane.

use crate::models::surface::{Near, Surface, unit};
use glam::DVec3;
use rand::Rng;

/// Contact points on the full mesh, one behind the other.
///
/// `step` is the distance between neighbours. At a rim, and where the surface folds so sharply that
/// the way is lost, the path turns to another direction.
pub fn path(full: &Surface, step: f64, count: u32, random: &mut impl Rng) -> Vec<Near> {
    let start = full.spread(1, random);
    let (triangle, point) = start
        .first()
        .copied()
        .unwrap_or((0, full.triangles()[0][0]));
    let mut at = Near {
        triangle,
        distance: 0.0,
        point,
    };
    let mut heading = direction(random);
    let mut found = Vec::with_capacity(count as usize);
    for _ in 0..count {
        found.push(at);
        let [a, b, c] = full.triangles()[at.triangle as usize];
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let along = (heading - normal * heading.dot(normal)).normalize_or_zero();
        if along == DVec3::ZERO {
            heading = direction(random);
            continue;
        }
        let next = full.nearest(at.point + along * step, at.triangle);
        let moved = next.point - at.point;
        // A rim, or a crease, holds it.
        heading = if moved.length() < 0.3 * step {
            direction(random)
        } else {
            along
        };
        at = next;
    }
    found
}

fn direction(random: &mut impl Rng) -> DVec3 {
    loop {
        let p = DVec3::new(unit(random), unit(random), unit(random)) * 2.0 - 1.0;
        if (0.01..=1.0).contains(&p.length_squared()) {
            return p.normalize();
        }
    }
}
