//! Distances to the full mesh, from a face that is near.
//!
//! A search first walks over the surface towards the point, from neighbour to neighbour: where the
//! surface is smooth that ends at the nearest face in two or three steps. Then it makes sure, in a
//! heap of boxes over the faces (they lie in AB-tree order, so it needs no links): from the box of
//! the face that was found up to the root, looking into every sibling that is nearer than what it
//! has. Exact, but for a point that more than [`MAX_FACES`] faces might be near to, as above the
//! slivers round the tip of a cone: their boxes all hold it. Then it is an upper bound.
//!
//! Memory: 12 B a face (neighbours), 24 B a box, one box for one to two faces.

use super::triangle::Triangle;
use crate::tuning::error::{MAX_FACES, MAX_STEPS};
use geometry::Aabb;
use glam::{DVec3, Vec3};
use spm::NONE;

/// The full mesh with boxes over it.
pub struct FullSurface<'a> {
    positions: &'a [[f32; 3]],
    triangles: &'a [[u32; 3]],
    /// Across the edge opposite each corner.
    neighbours: Vec<[u32; 3]>,
    /// In heap order from 1; slot 0 is unused.
    boxes: Vec<Aabb>,
    /// Boxes of the lowest level, a power of two.
    lowest: u32,
    /// First face of each box of the lowest level, and the number of faces.
    first: Vec<u32>,
}

/// How far a point is from the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Squared distance, model units.
    pub distance_squared: f64,
    /// The face that is so near.
    pub face: u32,
    /// Faces looked at for it after the walk.
    looked_at: u32,
}

impl Found {
    /// Whether the search may end: it is near enough, or enough was looked at.
    fn suffices(&self, enough: f64) -> bool {
        self.distance_squared <= enough || self.looked_at >= MAX_FACES
    }
}

impl<'a> FullSurface<'a> {
    /// Faces must be in AB-tree order.
    pub fn new(
        positions: &'a [[f32; 3]],
        triangles: &'a [[u32; 3]],
        neighbours: Vec<[u32; 3]>,
    ) -> Self {
        let faces = triangles.len() as u32;
        let lowest = 1 << (faces / 2).max(1).ilog2();
        let mut first = vec![0, faces];
        // Halving with the larger half left, level by level.
        while first.len() <= lowest as usize {
            first = first
                .windows(2)
                .flat_map(|w| [w[0], w[0] + (w[1] - w[0]).div_ceil(2)])
                .chain([faces])
                .collect();
        }
        let mut surface = Self {
            positions,
            triangles,
            neighbours,
            boxes: vec![Aabb::EMPTY; 2 * lowest as usize],
            lowest,
            first,
        };
        for node in (1..2 * lowest).rev() {
            let bounds = if node >= lowest {
                surface
                    .faces_of(node)
                    .flat_map(|face| triangles[face as usize])
                    .map(|v| Vec3::from_array(positions[v as usize]))
                    .fold(Aabb::EMPTY, |b, p| b.union(Aabb { lower: p, upper: p }))
            } else {
                surface.boxes[2 * node as usize].union(surface.boxes[2 * node as usize + 1])
            };
            surface.boxes[node as usize] = bounds;
        }
        surface
    }

    /// Corners of each face.
    pub fn triangles(&self) -> &'a [[u32; 3]] {
        self.triangles
    }

    /// The faces across the edge opposite each corner of each face.
    pub fn neighbours(&self) -> &[[u32; 3]] {
        &self.neighbours
    }

    /// Where the corners of a face are.
    pub fn corners(&self, face: u32) -> [DVec3; 3] {
        self.triangles[face as usize].map(|v| self.position(v))
    }

    /// Position of a vertex.
    pub fn position(&self, vertex: u32) -> DVec3 {
        Vec3::from_array(self.positions[vertex as usize]).as_dvec3()
    }

    /// Squared distance of a point from the surface, or the first one found that is at most
    /// `enough`; the nearer `hint` is, the faster.
    pub fn nearest(&self, point: DVec3, hint: u32, enough: f64) -> Found {
        let mut found = self.walk(point, hint, enough);
        if found.distance_squared <= enough {
            return found;
        }
        let mut node = self.lowest_box_of(found.face);
        self.look_into(point, node, enough, &mut found);
        while node > 1 && !found.suffices(enough) {
            if self.box_distance_squared(node ^ 1, point) < found.distance_squared {
                self.look_into(point, node ^ 1, enough, &mut found);
            }
            node /= 2;
        }
        found
    }

    /// The nearest face met on a walk from neighbour to neighbour, each beyond the side that the
    /// point is farthest beyond.
    fn walk(&self, point: DVec3, from: u32, enough: f64) -> Found {
        let mut found = Found {
            distance_squared: f64::INFINITY,
            face: from,
            looked_at: 0,
        };
        let (mut face, mut before) = (from, NONE);
        for _ in 0..MAX_STEPS {
            let corners = self.triangles[face as usize].map(|v| self.position(v));
            let here = Triangle::new(corners).distance(point);
            if here.squared < found.distance_squared {
                found.distance_squared = here.squared;
                found.face = face;
            }
            if here.is_above() || here.squared <= enough {
                break;
            }
            let next = self.neighbours[face as usize][here.beyond];
            if next == NONE || next == before {
                break;
            }
            (before, face) = (face, next);
        }
        found
    }

    fn look_at(&self, point: DVec3, face: u32, found: &mut Found) {
        found.looked_at += 1;
        let corners = self.triangles[face as usize].map(|v| self.position(v));
        let lower = corners[0].min(corners[1]).min(corners[2]);
        let upper = corners[0].max(corners[1]).max(corners[2]);
        if gap_squared(lower, upper, point) >= found.distance_squared {
            return;
        }
        let distance_squared = Triangle::new(corners).distance(point).squared;
        if distance_squared < found.distance_squared {
            found.distance_squared = distance_squared;
            found.face = face;
        }
    }

    /// Searches below a box, the nearer child first.
    fn look_into(&self, point: DVec3, top: u32, enough: f64, found: &mut Found) {
        // One box a level waits, at most.
        let mut waiting = [(0u32, 0.0f64); 32];
        let mut count = 0;
        let mut node = top;
        loop {
            while node < self.lowest {
                let [left, right] =
                    [2 * node, 2 * node + 1].map(|n| (n, self.box_distance_squared(n, point)));
                let (near, far) = if left.1 <= right.1 {
                    (left, right)
                } else {
                    (right, left)
                };
                if far.1 < found.distance_squared {
                    waiting[count] = far;
                    count += 1;
                }
                if near.1 >= found.distance_squared {
                    node = 0;
                    break;
                }
                node = near.0;
            }
            if node != 0 {
                for face in self.faces_of(node) {
                    self.look_at(point, face, found);
                    if found.suffices(enough) {
                        return;
                    }
                }
            }
            loop {
                if count == 0 || found.suffices(enough) {
                    return;
                }
                count -= 1;
                if waiting[count].1 < found.distance_squared {
                    node = waiting[count].0;
                    break;
                }
            }
        }
    }

    fn faces_of(&self, node: u32) -> std::ops::Range<u32> {
        let place = (node - self.lowest) as usize;
        self.first[place]..self.first[place + 1]
    }

    fn lowest_box_of(&self, face: u32) -> u32 {
        // Boxes of a level hold the same number of faces but for one: the guess is off by few.
        let faces = self.triangles.len() as u64;
        let mut place = (u64::from(face) * u64::from(self.lowest) / faces) as usize;
        while self.first[place] > face {
            place -= 1;
        }
        while self.first[place + 1] <= face {
            place += 1;
        }
        self.lowest + place as u32
    }

    fn box_distance_squared(&self, node: u32, point: DVec3) -> f64 {
        let Aabb { lower, upper } = self.boxes[node as usize];
        gap_squared(lower.as_dvec3(), upper.as_dvec3(), point)
    }
}

/// Squared distance of a point from a box.
#[inline]
fn gap_squared(lower: DVec3, upper: DVec3, point: DVec3) -> f64 {
    let gap = |low: f64, high: f64, at: f64| {
        let beyond = if low - at > at - high {
            low - at
        } else {
            at - high
        };
        if beyond > 0.0 { beyond * beyond } else { 0.0 }
    };
    gap(lower.x, upper.x, point.x) + gap(lower.y, upper.y, point.y) + gap(lower.z, upper.z, point.z)
}
