//! Triangles, and balls, tubes and arrows made of them.

use crate::color::Color;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Corners around a tube, an arrow or a ball.
const AROUND: usize = 16;
/// Circles of a ball between its poles.
const CIRCLES: usize = 9;
/// Length and radius of an arrow's head, in radii of its shaft.
const HEAD_LENGTH: f64 = 5.0;
const HEAD_RADIUS: f64 = 2.5;

/// A triangle, seen from both sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Its corners.
    pub corners: [DVec3; 3],
    /// Normals at its corners, of any length but 0.
    pub normals: [DVec3; 3],
    /// Its colour in full light.
    pub color: Color,
    /// How dark its edges are drawn: 0 not at all, 1 black.
    pub edges: f64,
}

/// Where what is added belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Layer {
    #[default]
    Opaque,
    Marks,
    Signs,
}

/// All that a picture shows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solids {
    /// What hides what lies behind it.
    pub(crate) opaque: Vec<Triangle>,
    /// What shines through what hides it.
    pub(crate) marks: Vec<Triangle>,
    /// What is before everything else.
    pub(crate) signs: Vec<Triangle>,
    layer: Layer,
}

impl Solids {
    /// From now on what is added shines through what hides it: paths, probes.
    pub fn begin_marks(&mut self) {
        self.layer = Layer::Marks;
    }

    /// From now on what is added is hidden by nothing that was added before: arrows.
    pub fn begin_signs(&mut self) {
        self.layer = Layer::Signs;
    }

    /// Adds a triangle.
    pub fn add(&mut self, triangle: Triangle) {
        let triangles = match self.layer {
            Layer::Opaque => &mut self.opaque,
            Layer::Marks => &mut self.marks,
            Layer::Signs => &mut self.signs,
        };
        triangles.push(triangle);
    }

    /// Adds a flat triangle; one without an area is left out.
    pub fn face(&mut self, corners: [DVec3; 3], color: Color, edges: f64) {
        let [a, b, c] = corners;
        if let Some(normal) = (b - a).cross(c - a).try_normalize() {
            self.add(Triangle {
                corners,
                normals: [normal; 3],
                color,
                edges,
            });
        }
    }

    /// Adds a ball.
    pub fn ball(&mut self, center: DVec3, radius: f64, color: Color) {
        let normal = |ring: usize, k: usize| {
            let (polar, around) = (angle(ring, CIRCLES + 1, PI), angle(k, AROUND, TAU));
            let (up, out) = (polar.cos(), polar.sin());
            DVec3::new(out * around.cos(), out * around.sin(), up)
        };
        for ring in 0..=CIRCLES {
            for k in 0..AROUND {
                let corners = [(ring, k), (ring + 1, k), (ring + 1, k + 1), (ring, k + 1)];
                let normals = corners.map(|(ring, k)| normal(ring, k));
                self.quad(normals.map(|n| center + radius * n), normals, color);
            }
        }
    }

    /// Adds a tube without ends from a point to another.
    pub fn tube(&mut self, from: DVec3, to: DVec3, radius: f64, color: Color) {
        let along = (to - from).normalize_or_zero();
        self.cone([from, to], along, [radius; 2], color);
    }

    /// Adds an arrow from a point by a vector; the radius is that of its shaft, if its head has
    /// room.
    pub fn arrow(&mut self, from: DVec3, by: DVec3, radius: f64, color: Color) {
        let Some(along) = by.try_normalize() else {
            return;
        };
        let head = (HEAD_LENGTH * radius).min(by.length());
        let neck = from + along * (by.length() - head);
        // A short arrow is a smaller head, not a flat one.
        let radius = head / HEAD_LENGTH;
        let wide = HEAD_RADIUS * radius;
        self.cone([from, neck], along, [radius; 2], color);
        self.cone([neck; 2], along, [radius, wide], color);
        self.cone([neck, from + by], along, [wide, 0.0], color);
    }

    /// Adds the side of a cone with a radius at each end, along a direction of length 1; where both
    /// ends are one point, a disc.
    fn cone(&mut self, [from, to]: [DVec3; 2], along: DVec3, radii: [f64; 2], color: Color) {
        let side = along.any_orthonormal_vector();
        let across = along.cross(side);
        let around = |k: usize| {
            let (sin, cos) = angle(k, AROUND, TAU).sin_cos();
            cos * side + sin * across
        };
        for k in 0..AROUND {
            let out = [around(k), around(k + 1)];
            let corners = [
                from + radii[0] * out[0],
                from + radii[0] * out[1],
                to + radii[1] * out[1],
                to + radii[1] * out[0],
            ];
            let normals = if from == to {
                [along; 4]
            } else {
                [out[0], out[1], out[1], out[0]]
            };
            self.quad(corners, normals, color);
        }
    }

    fn quad(&mut self, p: [DVec3; 4], n: [DVec3; 4], color: Color) {
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            self.add(Triangle {
                corners: [p[a], p[b], p[c]],
                normals: [n[a], n[b], n[c]],
                color,
                edges: 0.0,
            });
        }
    }
}

/// The angle of a step of so many.
fn angle(step: usize, steps: usize, whole: f64) -> f64 {
    whole * step as f64 / steps as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arrow_ends_where_it_points() {
        let mut solids = Solids::default();
        solids.arrow(DVec3::ZERO, DVec3::X, 0.01, [0; 3]);
        let corners = solids.opaque.iter().flat_map(|of| of.corners);
        let farthest = corners.fold(0.0, |far: f64, p| far.max(p.x));
        assert_eq!(farthest, 1.0);
        solids.arrow(DVec3::ZERO, DVec3::ZERO, 0.01, [0; 3]);
        assert_eq!(solids.opaque.len(), 3 * 2 * AROUND, "none without a length");
    }

    /// All but one half of each quad at the tip, whose corners meet there.
    #[test]
    fn every_face_of_an_arrow_has_an_area() {
        const RADIUS: f64 = 0.01;
        let mut solids = Solids::default();
        solids.arrow(DVec3::Y, DVec3::new(1.0, 2.0, -0.5), RADIUS, [0; 3]);
        let areas = solids.opaque.iter().map(|of| {
            let [a, b, c] = of.corners;
            0.5 * (b - a).cross(c - a).length()
        });
        let seen = areas.filter(|&area| area > 0.1 * RADIUS * RADIUS);
        assert_eq!(seen.count() + AROUND, solids.opaque.len());
    }

    #[test]
    fn marks_are_kept_apart() {
        let mut solids = Solids::default();
        solids.face([DVec3::ZERO, DVec3::X, DVec3::Y], [0; 3], 0.0);
        solids.face([DVec3::ZERO, DVec3::X, DVec3::X], [0; 3], 0.0);
        solids.begin_marks();
        solids.ball(DVec3::ZERO, 1.0, [0; 3]);
        assert_eq!(solids.opaque.len(), 1, "the other has no area");
        assert!(solids.marks.iter().all(|of| {
            let lengths = of.corners.map(DVec3::length);
            lengths.iter().all(|length| (length - 1.0).abs() < 1e-12)
        }));
    }
}
