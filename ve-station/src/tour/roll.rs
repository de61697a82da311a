//! A ball that rolls over a mesh, and the free lines around it.

use super::Draw;
use glam::{DQuat, DVec3};
use shared::spm::{FileError, SpmFile};
use std::f64::consts::{PI, TAU};

/// Where the ball touches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Closest point of the mesh.
    pub surface: DVec3,
    /// From there to the ball's centre, unit length: outwards.
    pub normal: DVec3,
    /// The ball's centre.
    pub centre: DVec3,
    /// Cosine between the normal and that of the face, whatever its winding: 1 on a face, 0 where the ball
    /// hangs over a rim.
    pub upright: f64,
}

/// The ball, and the box of the mesh.
#[derive(Debug)]
pub struct Ball {
    /// Its radius.
    pub radius: f64,
    /// How far it is moved at once.
    pub step: f64,
    /// Smallest corner of the mesh's box.
    pub lower: DVec3,
    /// Largest corner of the mesh's box.
    pub upper: DVec3,
}

/// Steps of a search along a line before it counts as blocked.
const MOST_LINE_STEPS: usize = 4000;
/// Turns in a row before a slide gives up.
const MOST_TURNS: u32 = 16;
/// A contact that moves by more steps than this went to another sheet.
const JUMP: f64 = 3.0;
/// A contact less upright than this hangs over a rim: about 80 degrees.
const OVERHANG: f64 = 0.17;
/// The normal turned over, when its cosine with an earlier one is below this ...
const TURNED_OVER: f64 = -0.2;
/// ... and the centre moved less than so many radii since.
const TURN_LENGTH: f64 = 2.2;

impl Ball {
    /// The contact below a point, moved from the point straight to the closest face; with it the way
    /// back. `None` when the point lies on the mesh.
    pub fn drop_from<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        from: DVec3,
    ) -> Result<Option<(Contact, DVec3)>, FileError> {
        Ok(self.touch(file, from)?.map(|c| (c, c.normal)))
    }

    /// The ball moved from `from` onto (or out to) its radius above the closest point.
    fn touch<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        from: DVec3,
    ) -> Result<Option<Contact>, FileError> {
        let (face, closest) = file.closest_point(from)?;
        let away = from - closest.point;
        let distance = away.length();
        if distance < 1e-3 * self.radius {
            return Ok(None);
        }
        let normal = away / distance;
        let [a, b, c] = file.leaf_corners(face)?;
        let of_face = (b - a).cross(c - a).normalize_or(normal);
        Ok(Some(Contact {
            surface: closest.point,
            normal,
            centre: closest.point + normal * self.radius,
            upright: normal.dot(of_face).abs(),
        }))
    }

    /// Whether a ball of half the radius gets from `from` along `way` out of the mesh's box.
    pub fn escapes<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        from: DVec3,
        way: DVec3,
    ) -> Result<bool, FileError> {
        // Beyond this it has left the box in any case.
        let far = (self.upper - self.lower).length() + 4.0 * self.radius;
        self.is_clear(file, from, way, far)
    }

    /// Whether a ball of half the radius gets straight from `from` to `to`.
    pub fn segment_is_clear<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        from: DVec3,
        to: DVec3,
    ) -> Result<bool, FileError> {
        let way = to - from;
        let length = way.length();
        self.is_clear(file, from, way.normalize_or(DVec3::Z), length)
    }

    fn is_clear<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        from: DVec3,
        way: DVec3,
        length: f64,
    ) -> Result<bool, FileError> {
        let margin = 0.5 * self.radius;
        let mut at = 0.0f64;
        for _ in 0..MOST_LINE_STEPS {
            let point = from + way * at.min(length);
            let outside = (point.cmpgt(self.upper + margin) & way.cmpge(DVec3::ZERO))
                | (point.cmplt(self.lower - margin) & way.cmple(DVec3::ZERO));
            if outside.any() {
                return Ok(true);
            }
            let (_, closest) = file.closest_point(point)?;
            let distance = closest.distance_squared.sqrt();
            if distance < margin {
                return Ok(false);
            }
            if at >= length {
                return Ok(true);
            }
            at += (distance - margin).max(0.2 * margin);
        }
        Ok(false)
    }

    /// Rolls for a length (of the centre's way) from a contact; the contacts, the first one included.
    ///
    /// Ends early in a place that it cannot leave.
    pub fn slide<D: AsRef<[u8]>>(
        &self,
        file: &SpmFile<D>,
        start: Contact,
        length: f64,
        draw: &mut Draw,
    ) -> Vec<Contact> {
        let steps = (length / self.step).ceil().min(1e6) as usize;
        let lookback = (TURN_LENGTH * self.radius / self.step).ceil() as usize;
        let size = (self.upper - self.lower).max_element();
        let mut path = vec![start];
        let mut heading = tangent(draw.direction(), start.normal);
        let (mut curvature, mut wanted_curvature) = (0.0, 0.0);
        let (mut turns, mut since_turn) = (0, 0u32);
        // Turning back at a rim shortens the path: the tries are bounded too.
        for _ in 0..2 * steps {
            let Some(&here) = path.last() else { break };
            if path.len() > steps || turns > MOST_TURNS {
                break;
            }
            if draw.unit() * 0.1 * size < self.step {
                wanted_curvature = draw.between(-6.0, 6.0) / size;
            }
            curvature += (wanted_curvature - curvature) * 0.05;
            let bend = DQuat::from_axis_angle(here.normal, curvature * self.step);
            heading = tangent(bend * heading, here.normal);
            // Where the file is damaged the surface ends, as at a rim.
            let next = self
                .touch(file, here.centre + heading * self.step)
                .unwrap_or(None);
            let jumped = next.is_none_or(|n| n.surface.distance(here.surface) > JUMP * self.step);
            let back = path.len().saturating_sub(lookback);
            let over = next.is_some_and(|n| {
                n.upright < OVERHANG
                    || path[back..]
                        .iter()
                        .any(|p| p.normal.dot(n.normal) < TURNED_OVER)
            });
            if jumped || over {
                if over {
                    path.truncate(back.max(1));
                }
                // Back to where it came from, give or take a quarter turn.
                let there = path.last().copied().unwrap_or(here);
                let forth = here.centre - there.centre;
                let forth = if forth.length() > self.step {
                    forth
                } else {
                    heading
                };
                let turn =
                    DQuat::from_axis_angle(there.normal, PI + draw.between(-0.25, 0.25) * TAU);
                heading = turn * tangent(forth, there.normal);
                turns += 1;
                since_turn = 0;
                continue;
            }
            since_turn += 1;
            if since_turn > 20 {
                turns = 0;
            }
            path.extend(next);
        }
        path
    }
}

/// The part of a direction along the surface, unit length.
fn tangent(direction: DVec3, normal: DVec3) -> DVec3 {
    direction
        .reject_from_normalized(normal)
        .try_normalize()
        .unwrap_or_else(|| normal.any_orthonormal_vector())
}
