//! The faces near a point, collected once per tick. The steps of the proxy examine them instead of
//! the tree.
//!
//! Each face keeps its corners in f64 and its distance from the centre of the ball. The distance
//! changes by at most the motion of the point, so `distance at the centre - motion` is a lower
//! bound, and most faces are skipped without a look at their corners.

use super::swept_sphere::first_contact;
use super::{Limit, Surface, SweepHit, Work, faces_within_limited};
use geometry::{ClosestPoint, closest_point_on_triangle};
use glam::DVec3;
use spm::{Handle, NONE};

/// Capacity for faces; a ball with more shrinks.
pub const MAX_FACES: usize = 192;

/// Share of a full ball's radius within which a collection around another point is not worth its
/// cost.
const STAYED: f64 = 0.25;

/// A face of the ball.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct NearFace {
    /// The face.
    pub face: Handle,
    /// Its vertices.
    pub vertices: [Handle; 3],
    /// Their positions.
    pub corners: [DVec3; 3],
    /// Distance from the centre of the ball.
    distance: f64,
}

impl NearFace {
    /// An empty entry.
    pub const NONE: Self = Self {
        face: NONE,
        vertices: [NONE; 3],
        corners: [DVec3::ZERO; 3],
        distance: 0.0,
    };

    /// First parameter below `limit` at which a moving sphere touches this face.
    #[must_use]
    pub fn first_contact(
        &self,
        start: DVec3,
        motion: DVec3,
        radius: f64,
        limit: f64,
    ) -> Option<f64> {
        first_contact(self.corners, start, motion, radius, limit)
    }
}

/// A ball and all faces that intersect it.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct NearFaces {
    centre: DVec3,
    radius: f64,
    #[serde(with = "serde_big_array::BigArray")]
    faces: [NearFace; MAX_FACES],
    count: usize,
    /// Faces that there was room for.
    room: usize,
    high_water: usize,
}

impl NearFaces {
    /// An empty ball.
    #[must_use]
    pub fn new() -> Self {
        Self {
            centre: DVec3::ZERO,
            radius: 0.0,
            faces: [NearFace::NONE; MAX_FACES],
            count: 0,
            room: MAX_FACES,
            high_water: 0,
        }
    }

    /// Largest number of faces so far.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Number of faces it holds.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Collects all faces within `radius` of `centre`. If there are more than `room`, 1 to
    /// [`MAX_FACES`], the ball shrinks to those it holds; if the limit is reached, to where all
    /// were visited: that is returned as false.
    pub fn collect(
        &mut self,
        surface: Surface<'_>,
        (centre, radius): (DVec3, f64),
        room: usize,
        limit: &mut Limit<'_>,
    ) -> (bool, Work) {
        assert!((1..=MAX_FACES).contains(&room), "room for a face");
        self.centre = centre;
        self.radius = radius;
        self.count = 0;
        self.room = room;
        let (unvisited, work) =
            faces_within_limited(surface, centre, radius, limit, |face, closest| {
                let distance = closest.distance_squared.sqrt();
                if distance >= self.radius && self.radius < radius {
                    return self.radius;
                }
                let near = NearFace {
                    face,
                    vertices: surface.mesh.face(face).corners,
                    corners: surface.mesh.corners(face),
                    distance,
                };
                if self.count < room {
                    self.faces[self.count] = near;
                    self.count += 1;
                    if self.count == room {
                        for k in (0..room / 2).rev() {
                            self.sift_down(k);
                        }
                    }
                    return self.radius;
                }
                // Full: the farthest face is dropped, and the ball ends before it.
                let farthest = self.faces[0].distance;
                self.radius = self.radius.min(farthest.max(distance));
                if distance < farthest {
                    self.faces[0] = near;
                    self.sift_down(0);
                }
                self.radius
            });
        self.radius = self.radius.min(unvisited);
        self.high_water = self.high_water.max(self.count);
        (unvisited.is_infinite(), work)
    }

    /// Restores the heap order of a full ball, farthest first, below a changed entry.
    fn sift_down(&mut self, mut place: usize) {
        loop {
            let child = 2 * place + 1;
            if child >= self.room {
                return;
            }
            let distance = |k: usize| self.faces[k].distance;
            let right_is_farther = child + 1 < self.room && distance(child + 1) > distance(child);
            let farther = child + usize::from(right_is_farther);
            if distance(farther) <= distance(place) {
                return;
            }
            self.faces.swap(place, farther);
            place = farther;
        }
    }

    /// Invalidates the ball: it covers nothing until the next collection.
    pub fn invalidate(&mut self) {
        self.radius = f64::NEG_INFINITY;
        self.count = 0;
    }

    /// Whether the ball is full and `point` near its centre: a new collection would hardly add
    /// anything.
    #[must_use]
    pub fn is_full_at(&self, point: DVec3) -> bool {
        self.count == self.room && point.distance(self.centre) < STAYED * self.radius
    }

    /// The radius around `point` within which all faces are known; negative for none.
    #[must_use]
    pub fn margin(&self, point: DVec3) -> f64 {
        self.radius - point.distance(self.centre)
    }

    /// Whether every face that intersects the ball of `radius` around `point` is known.
    #[must_use]
    pub fn covers(&self, point: DVec3, radius: f64) -> bool {
        radius <= self.margin(point)
    }

    /// Calls `visit` with every face within `distance` of `point`; that ball must be covered.
    pub fn within(
        &self,
        point: DVec3,
        distance: f64,
        mut visit: impl FnMut(&NearFace, ClosestPoint),
    ) -> Work {
        let moved = point.distance(self.centre);
        let mut work = Work::default();
        for near in &self.faces[..self.count] {
            if near.distance > moved + distance {
                continue;
            }
            work.faces += 1;
            let closest = closest_point_on_triangle(near.corners, point);
            if closest.distance_squared <= distance * distance {
                visit(near, closest);
            }
        }
        work
    }

    /// First contact of a moving sphere, as [`super::swept_sphere`]; the path must be covered.
    #[must_use]
    pub fn sweep(&self, start: DVec3, motion: DVec3, radius: f64) -> (Option<SweepHit>, Work) {
        let moved = start.distance(self.centre) + motion.length();
        let mut work = Work::default();
        let mut best: Option<SweepHit> = None;
        let mut fraction = 1.0;
        for near in &self.faces[..self.count] {
            if near.distance > moved + radius {
                continue;
            }
            work.faces += 1;
            if let Some(t) = first_contact(near.corners, start, motion, radius, fraction) {
                fraction = t;
                best = Some(SweepHit {
                    fraction: t,
                    face: near.face,
                });
            }
        }
        (best, work)
    }
}

impl Default for NearFaces {
    fn default() -> Self {
        Self::new()
    }
}
