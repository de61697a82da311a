//! A ball that rolls over a mesh, and the free lines around it; what takes many searches is made
//! one at a time.

use super::Draw;
use crate::tuning::tour::{
    JUMP_RADII, JUMP_STEPS, MAX_LINE_STEPS, MAX_TURNS, OVERHANG_COSINE, TURN_LENGTH_RADII,
    TURNED_OVER_COSINE,
};
use geometry::portable::about;
use glam::DVec3;
use spm::{FileError, SpmFile};
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
    /// Cosine between the normal and that of the face, whatever its winding: 1 on a face, 0 where
    /// the ball hangs over a rim.
    pub upright: f64,
}

/// The ball, and the box of the mesh.
#[derive(Debug)]
pub struct Ball {
    /// Its radius.
    pub radius: f64,
    /// How far it is moved at once; less than the radius, so that it does not get through a wall.
    pub step: f64,
    /// Smallest corner of the mesh's box.
    pub lower: DVec3,
    /// Largest corner of the mesh's box.
    pub upper: DVec3,
}

impl Ball {
    /// The ball moved from a point straight to the closest face (or out to its radius above it):
    /// its normal is the way back. `None` when the point lies on the mesh.
    pub fn touch<D: AsRef<[u8]>>(
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
}

/// A search along a straight line: whether a ball of half the radius gets to its end, or out of the
/// mesh's box before.
#[derive(Debug)]
pub struct Line {
    from: DVec3,
    direction: DVec3,
    length: f64,
    /// How far it is clear.
    at: f64,
    /// Steps that are left.
    left: usize,
}

impl Line {
    /// From `from` along `direction` (unit length) out of the mesh's box.
    pub fn out_of_box(ball: &Ball, from: DVec3, direction: DVec3) -> Self {
        // Beyond this it has left the box in any case.
        let far = (ball.upper - ball.lower).length() + 4.0 * ball.radius;
        Self::new(from, direction, far)
    }

    /// Straight from `from` to `to`.
    pub fn between(from: DVec3, to: DVec3) -> Self {
        let displacement = to - from;
        let length = displacement.length();
        Self::new(from, displacement.normalize_or(DVec3::Z), length)
    }

    fn new(from: DVec3, direction: DVec3, length: f64) -> Self {
        Self {
            from,
            direction,
            length,
            at: 0.0,
            left: MAX_LINE_STEPS,
        }
    }

    /// One search further; whether the line is clear, once that is known.
    pub fn step<D: AsRef<[u8]>>(
        &mut self,
        ball: &Ball,
        file: &SpmFile<D>,
    ) -> Result<Option<bool>, FileError> {
        if self.left == 0 {
            return Ok(Some(false));
        }
        self.left -= 1;
        let margin = 0.5 * ball.radius;
        let point = self.from + self.direction * self.at.min(self.length);
        let outside = (point.cmpgt(ball.upper + margin) & self.direction.cmpge(DVec3::ZERO))
            | (point.cmplt(ball.lower - margin) & self.direction.cmple(DVec3::ZERO));
        if outside.any() {
            return Ok(Some(true));
        }
        let (_, closest) = file.closest_point(point)?;
        let distance = closest.distance_squared.sqrt();
        if distance < margin {
            return Ok(Some(false));
        }
        if self.at >= self.length {
            return Ok(Some(true));
        }
        self.at += (distance - margin).max(0.2 * margin);
        Ok(None)
    }
}

/// A ball that rolls from a contact; it may end early in a place that it cannot leave.
#[derive(Debug)]
pub struct Slide {
    /// The contacts so far, the first one included.
    path: Vec<Contact>,
    heading: DVec3,
    curvature: f64,
    wanted_curvature: f64,
    /// Turns in a row, and steps since the last one.
    turns: u32,
    since_turn: u32,
    /// Steps to make.
    steps: usize,
    /// Steps within which the normal must not turn over.
    lookback: usize,
    /// Tries that are left: turning back at a rim shortens the path, so they are bounded too.
    left: usize,
}

impl Slide {
    /// From a contact, for a length (of the centre's way).
    pub fn new(ball: &Ball, start: Contact, length: f64, draw: &mut Draw) -> Self {
        let steps = (length / ball.step).ceil().min(1e6) as usize;
        Self {
            path: vec![start],
            heading: tangent(draw.direction(), start.normal),
            curvature: 0.0,
            wanted_curvature: 0.0,
            turns: 0,
            since_turn: 0,
            steps,
            lookback: (TURN_LENGTH_RADII * ball.radius / ball.step).ceil() as usize,
            left: 2 * steps,
        }
    }

    /// The contacts.
    pub fn into_path(self) -> Vec<Contact> {
        self.path
    }

    /// One search further; whether it goes on.
    pub fn step<D: AsRef<[u8]>>(
        &mut self,
        ball: &Ball,
        file: &SpmFile<D>,
        draw: &mut Draw,
    ) -> bool {
        let over = self.left == 0 || self.path.len() > self.steps || self.turns > MAX_TURNS;
        let Some(&here) = self.path.last().filter(|_| !over) else {
            return false;
        };
        self.left -= 1;
        let size = (ball.upper - ball.lower).max_element();
        if draw.unit() * 0.1 * size < ball.step {
            self.wanted_curvature = draw.between(-6.0, 6.0) / size;
        }
        self.curvature += (self.wanted_curvature - self.curvature) * 0.05;
        let bend = about(here.normal, self.curvature * ball.step);
        self.heading = tangent(bend * self.heading, here.normal);
        // Where the file is damaged the surface ends, as at a rim.
        let next = ball
            .touch(file, here.centre + self.heading * ball.step)
            .unwrap_or(None);
        let farthest = (JUMP_STEPS * ball.step).max(JUMP_RADII * ball.radius);
        let jumped = next.is_none_or(|n| n.surface.distance(here.surface) > farthest);
        let back = self.path.len().saturating_sub(self.lookback);
        let turned_over = next.is_some_and(|n| {
            n.upright < OVERHANG_COSINE
                || self.path[back..]
                    .iter()
                    .any(|p| p.normal.dot(n.normal) < TURNED_OVER_COSINE)
        });
        if turned_over {
            self.path.truncate(back.max(1));
        }
        if jumped || turned_over {
            self.turn_back(ball, here, draw);
        } else {
            self.path.extend(next);
            self.since_turn += 1;
            if self.since_turn > 20 {
                self.turns = 0;
            }
        }
        true
    }

    /// Back to where it came from, give or take a quarter turn.
    fn turn_back(&mut self, ball: &Ball, here: Contact, draw: &mut Draw) {
        let there = self.path.last().copied().unwrap_or(here);
        let forth = here.centre - there.centre;
        let forth = if forth.length() > ball.step {
            forth
        } else {
            self.heading
        };
        let turn = about(there.normal, PI + draw.between(-0.25, 0.25) * TAU);
        self.heading = turn * tangent(forth, there.normal);
        self.turns += 1;
        self.since_turn = 0;
    }
}

/// The part of a direction along the surface, unit length.
fn tangent(direction: DVec3, normal: DVec3) -> DVec3 {
    direction
        .reject_from_normalized(normal)
        .try_normalize()
        .unwrap_or_else(|| normal.any_orthonormal_vector())
}
