//! Shapes of known geometry, at any number of faces: ground truth, and something to touch at once.
//!
//! | shape | is |
//! |---|---|
//! | sphere | radius 1, rings of latitude; exactly 2050 vertices and 4096 faces at 4096 |
//! | torus | radii 1 and 0.4, about z |
//! | terrain | fractal land over a square of side 2, with a lake that is exactly flat |
//! | plate | a flat square of side 2, open |
//! | wedge | two planes that meet in a right angle along y, open |
//! | relief | a closed, rounded body with fine bumps; the model of the bundled scene |
//!
//! Terrain and relief depend on the seed; everything is the same bits on every machine.

mod noise;

use crate::mesh::SoupMesh;
use geometry::portable::sin_cos;
use glam::DVec3;
use noise::Noise;
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::str::FromStr;
use thiserror::Error;

/// What can be generated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// The unit sphere.
    Sphere,
    /// A torus.
    Torus,
    /// Fractal land with a lake.
    Terrain,
    /// A flat square.
    Plate,
    /// A right-angled ridge.
    Wedge,
    /// A closed organic body with fine relief.
    Relief,
}

impl Shape {
    /// All shapes, with their names.
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::Sphere, "sphere"),
        (Self::Torus, "torus"),
        (Self::Terrain, "terrain"),
        (Self::Plate, "plate"),
        (Self::Wedge, "wedge"),
        (Self::Relief, "relief"),
    ];
}

impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = Self::ALL.iter().find(|(shape, _)| shape == self);
        f.write_str(name.map_or("shape", |(_, name)| name))
    }
}

/// A name that is no shape.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("\"{0}\" is no shape: choose sphere, torus, terrain, plate, wedge or relief")]
pub struct UnknownShape(String);

impl FromStr for Shape {
    type Err = UnknownShape;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .iter()
            .find(|(_, known)| *known == name)
            .map(|&(shape, _)| shape)
            .ok_or_else(|| UnknownShape(name.to_string()))
    }
}

/// The fewest faces of a generated mesh.
pub const FEWEST_FACES: u32 = 64;
/// The most faces of a generated mesh.
pub const MAX_FACES: u32 = 1 << 26;

/// Generates a shape with about `faces` faces (clamped to what is possible); each shape rounds to
/// its pattern.
#[must_use]
pub fn generate(shape: Shape, faces: u32, seed: u64) -> SoupMesh {
    let faces = faces.clamp(FEWEST_FACES, MAX_FACES);
    match shape {
        Shape::Sphere => sphere(faces),
        Shape::Torus => torus(faces),
        Shape::Terrain => {
            let noise = Noise::new(seed);
            square(faces, |x, y| terrain_height(&noise, x, y))
        }
        Shape::Plate => square(faces, |_, _| 0.0),
        // An even number of cells a side, so that vertices lie on the ridge.
        Shape::Wedge => square(faces, |x, _| 1.0 - x.abs()),
        Shape::Relief => relief(faces, seed),
    }
}

/// The whole number nearest to a size, at least `least`.
fn whole(size: f64, least: u32) -> u32 {
    (size.round() as u32).max(least)
}

/// Poles and rings: 2 m r faces with m meridians and r rings.
fn sphere(faces: u32) -> SoupMesh {
    let meridians = whole(f64::from(faces).sqrt(), 4);
    let rings = whole(f64::from(faces) / f64::from(2 * meridians), 2);
    let mut mesh = SoupMesh::default();
    mesh.positions.push([0.0, 0.0, 1.0]);
    for ring in 1..=rings {
        let (radius, height) = sin_cos(PI * f64::from(ring) / f64::from(rings + 1));
        for k in 0..meridians {
            let (sine, cosine) = sin_cos(TAU * f64::from(k) / f64::from(meridians));
            mesh.positions
                .push([radius * cosine, radius * sine, height]);
        }
    }
    mesh.positions.push([0.0, 0.0, -1.0]);
    let at = |ring: u32, k: u32| 1 + (ring - 1) * meridians + k % meridians;
    let south = 1 + rings * meridians;
    for k in 0..meridians {
        mesh.triangles.push([0, at(1, k), at(1, k + 1)]);
        for ring in 1..rings {
            push_quad(
                &mut mesh,
                [
                    at(ring, k),
                    at(ring + 1, k),
                    at(ring + 1, k + 1),
                    at(ring, k + 1),
                ],
            );
        }
        mesh.triangles.push([at(rings, k), south, at(rings, k + 1)]);
    }
    mesh
}

fn torus(faces: u32) -> SoupMesh {
    let (major, minor) = (1.0, 0.4);
    let round = whole((f64::from(faces) / 2.0 / minor * major).sqrt(), 4);
    let through = whole(f64::from(faces) / f64::from(2 * round), 4);
    let mut mesh = SoupMesh::default();
    for k in 0..round {
        let (sine, cosine) = sin_cos(TAU * f64::from(k) / f64::from(round));
        for l in 0..through {
            let (up, out) = sin_cos(TAU * f64::from(l) / f64::from(through));
            let from_axis = major + minor * out;
            mesh.positions
                .push([from_axis * cosine, from_axis * sine, minor * up]);
        }
    }
    let at = |k: u32, l: u32| (k % round) * through + l % through;
    for k in 0..round {
        for l in 0..through {
            push_quad(
                &mut mesh,
                [at(k, l), at(k + 1, l), at(k + 1, l + 1), at(k, l + 1)],
            );
        }
    }
    mesh
}

/// A height over a square from -1 to 1, seen from above counterclockwise.
fn square(faces: u32, height: impl Fn(f64, f64) -> f64) -> SoupMesh {
    let cells = (whole((f64::from(faces) / 8.0).sqrt(), 2)) * 2;
    let mut mesh = SoupMesh::default();
    let along = |k: u32| 2.0 * f64::from(k) / f64::from(cells) - 1.0;
    for j in 0..=cells {
        for i in 0..=cells {
            let (x, y) = (along(i), along(j));
            mesh.positions.push([x, y, height(x, y)]);
        }
    }
    let at = |i: u32, j: u32| j * (cells + 1) + i;
    for j in 0..cells {
        for i in 0..cells {
            push_quad(
                &mut mesh,
                [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
            );
        }
    }
    mesh
}

fn push_quad(mesh: &mut SoupMesh, [a, b, c, d]: [u32; 4]) {
    mesh.triangles.extend([[a, b, c], [a, c, d]]);
}

fn terrain_height(noise: &Noise, x: f64, y: f64) -> f64 {
    let height = noise.fractal(DVec3::new(x, y, 0.0) * 1.5, 10, 0.5) * 0.6;
    // What lies below the water line is the lake: exactly flat.
    height.max(-0.08)
}

/// A cube whose sides are drawn out to a sphere, then displaced along the radius.
fn relief(faces: u32, seed: u64) -> SoupMesh {
    let cells = whole((f64::from(faces) / 12.0).sqrt(), 2);
    let noise = Noise::new(seed);
    let mut mesh = SoupMesh::default();
    // By lattice point of the cube: sides share their edges.
    let mut known: BTreeMap<[u32; 3], u32> = BTreeMap::new();
    for side in 0..6usize {
        let (axis, far) = (side / 2, side % 2 == 1);
        let mut vertex = |i: u32, j: u32, mesh: &mut SoupMesh| {
            let mut lattice = [0; 3];
            lattice[axis] = if far { cells } else { 0 };
            // The two other axes in the order that makes the far side counterclockwise from
            // outside.
            let (first, second) = if far { (i, j) } else { (j, i) };
            lattice[(axis + 1) % 3] = first;
            lattice[(axis + 2) % 3] = second;
            *known.entry(lattice).or_insert_with(|| {
                mesh.positions
                    .push(relief_point(&noise, lattice, cells).to_array());
                mesh.positions.len() as u32 - 1
            })
        };
        for j in 0..cells {
            for i in 0..cells {
                let quad = [
                    vertex(i, j, &mut mesh),
                    vertex(i + 1, j, &mut mesh),
                    vertex(i + 1, j + 1, &mut mesh),
                    vertex(i, j + 1, &mut mesh),
                ];
                push_quad(&mut mesh, quad);
            }
        }
    }
    mesh
}

fn relief_point(noise: &Noise, lattice: [u32; 3], cells: u32) -> DVec3 {
    // The tangent spreads the points evenly over the sphere.
    let on_cube = lattice.map(|k| {
        let x = 2.0 * f64::from(k) / f64::from(cells) - 1.0;
        let (sine, cosine) = sin_cos(x * PI / 4.0);
        sine / cosine
    });
    let direction = DVec3::from_array(on_cube).normalize();
    let body = 0.22 * noise.fractal(direction * 1.3, 3, 0.5);
    let bumps = 0.018 * noise.fractal(direction * 9.0 + DVec3::splat(20.0), 4, 0.55);
    direction * (1.0 + body + bumps)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_sphere_of_4096_faces_is_that_of_the_thesis() {
        let mesh = generate(Shape::Sphere, 4096, 0);
        assert_eq!(mesh.positions.len(), 2050);
        assert_eq!(mesh.triangles.len(), 4096);
    }

    #[test]
    fn every_shape_has_about_the_faces_asked_for_and_each_edge_is_used_once_in_each_direction() {
        for (shape, name) in Shape::ALL {
            assert_eq!(name.parse(), Ok(shape));
            for faces in [64, 1000, 20_000] {
                let mesh = generate(shape, faces, 3);
                let count = mesh.triangles.len() as f64;
                assert!(
                    (count / f64::from(faces) - 1.0).abs() < 0.3,
                    "{name} {faces} {count}"
                );
                let edges: Vec<(u32, u32)> = mesh
                    .triangles
                    .iter()
                    .flat_map(|t| [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])])
                    .collect();
                let once: BTreeSet<(u32, u32)> = edges.iter().copied().collect();
                assert_eq!(once.len(), edges.len(), "{name}");
                let closed = edges.iter().all(|&(a, b)| once.contains(&(b, a)));
                let open = matches!(shape, Shape::Terrain | Shape::Plate | Shape::Wedge);
                assert_eq!(closed, !open, "{name}");
            }
        }
    }

    #[test]
    fn closed_shapes_face_outwards() {
        for shape in [Shape::Sphere, Shape::Torus, Shape::Relief] {
            let mesh = generate(shape, 2000, 1);
            let p = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
            let volume: f64 = mesh
                .triangles
                .iter()
                .map(|t| p(t[0]).dot(p(t[1]).cross(p(t[2]))) / 6.0)
                .sum();
            assert!(volume > 1.0, "{shape}: {volume}");
        }
    }

    #[test]
    fn the_lake_is_flat_and_the_seed_decides() {
        let a = generate(Shape::Terrain, 5000, 1);
        let flat = a.positions.iter().filter(|p| p[2] == -0.08).count();
        assert!(flat > 50, "{flat}");
        assert_eq!(a, generate(Shape::Terrain, 5000, 1));
        assert_ne!(a, generate(Shape::Terrain, 5000, 2));
    }
}
