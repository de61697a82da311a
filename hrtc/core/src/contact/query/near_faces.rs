//! The faces near a point, gathered once a tick: what the steps of the proxy then look at instead of the tree.
//!
//! Each face keeps its corners in f64 and its distance from the centre of the ball. A point moves away from
//! a face by no more than it moves at all, so `distance at the centre - moved` bounds the distance from
//! below, and most faces are passed over without a look at their corners.

use super::swept_sphere::first_contact;
use super::{Surface, SweepHit, Work, faces_within};
use geometry::{ClosestPoint, closest_point_on_triangle};
use glam::DVec3;
use spm::{Handle, NONE};

/// Faces that a ball may hold; a ball with more is shrunk.
pub const MAX_FACES: usize = 192;

/// Share of a full ball's radius within which a point has not moved.
const STAYED: f64 = 0.25;

/// A face of the ball.
#[derive(Debug, Clone, Copy)]
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
    /// No face.
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

/// A ball and all faces that meet it.
#[derive(Debug, Clone)]
pub struct NearFaces {
    centre: DVec3,
    radius: f64,
    faces: [NearFace; MAX_FACES],
    count: usize,
    high_water: usize,
}

impl NearFaces {
    /// A ball of nothing.
    #[must_use]
    pub fn new() -> Self {
        Self {
            centre: DVec3::ZERO,
            radius: 0.0,
            faces: [NearFace::NONE; MAX_FACES],
            count: 0,
            high_water: 0,
        }
    }

    /// The most faces that it ever held.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Gathers all faces within `radius` of `centre`. Where there are too many the ball shrinks to what
    /// it holds, so that its statement stays true.
    pub fn collect(&mut self, surface: Surface<'_>, centre: DVec3, radius: f64) -> Work {
        self.centre = centre;
        self.radius = radius;
        self.count = 0;
        let work = faces_within(surface, centre, radius, |face, closest| {
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
            if self.count < MAX_FACES {
                self.faces[self.count] = near;
                self.count += 1;
                if self.count == MAX_FACES {
                    for k in (0..MAX_FACES / 2).rev() {
                        self.sift_down(k);
                    }
                }
                return self.radius;
            }
            // Full: the farthest goes, and the ball ends short of it.
            let farthest = self.faces[0].distance;
            self.radius = self.radius.min(farthest.max(distance));
            if distance < farthest {
                self.faces[0] = near;
                self.sift_down(0);
            }
            self.radius
        });
        self.high_water = self.high_water.max(self.count);
        work
    }

    /// Of a full ball: restores the order of a heap, the farthest first, below a place whose face was changed.
    fn sift_down(&mut self, mut place: usize) {
        loop {
            let child = 2 * place + 1;
            if child >= MAX_FACES {
                return;
            }
            let distance = |k: usize| self.faces[k].distance;
            let right_is_farther = child + 1 < MAX_FACES && distance(child + 1) > distance(child);
            let farther = child + usize::from(right_is_farther);
            if distance(farther) <= distance(place) {
                return;
            }
            self.faces.swap(place, farther);
            place = farther;
        }
    }

    /// Empties the ball: it covers nothing until it is gathered anew.
    pub fn invalidate(&mut self) {
        self.radius = f64::NEG_INFINITY;
        self.count = 0;
    }

    /// Whether more faces are around `point` than fit, so that a ball gathered there would tell hardly more.
    #[must_use]
    pub fn is_full_at(&self, point: DVec3) -> bool {
        self.count == MAX_FACES && point.distance(self.centre) < STAYED * self.radius
    }

    /// The radius around `point` within which all faces are among these; negative for none.
    #[must_use]
    pub fn margin(&self, point: DVec3) -> f64 {
        self.radius - point.distance(self.centre)
    }

    /// Whether every face that meets the ball of `radius` around `point` is among these.
    #[must_use]
    pub fn covers(&self, point: DVec3, radius: f64) -> bool {
        radius <= self.margin(point)
    }

    /// Calls `visit` with every face within `distance` of `point`; the ball around it must be covered.
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

    /// The first touch of a sphere; as [`super::swept_sphere`], over a path that must be covered.
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
