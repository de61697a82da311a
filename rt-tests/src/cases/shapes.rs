//! Meshes with a known answer.

use glam::DVec3;
use spm_builder::SoupMesh;
use std::collections::BTreeMap;

/// Cells along a side of a patch.
const CELLS: u32 = 12;

/// A mesh made of patches that share the vertices where they meet.
#[derive(Debug, Default)]
struct Patches {
    mesh: SoupMesh,
    known: BTreeMap<[u64; 3], u32>,
}

impl Patches {
    fn vertex(&mut self, p: DVec3) -> u32 {
        // No negative zero, so that what is equal has equal bits.
        let p = p + DVec3::ZERO;
        let next = self.mesh.positions.len() as u32;
        let place = *self
            .known
            .entry(p.to_array().map(f64::to_bits))
            .or_insert(next);
        if place == next {
            self.mesh.positions.push(p.to_array());
        }
        place
    }

    /// The cells of a parallelogram; its normal is `along x across`.
    fn add(&mut self, origin: DVec3, along: DVec3, across: DVec3) {
        let point = |i: u32, j: u32| {
            let [s, t] = [i, j].map(|k| f64::from(k) / f64::from(CELLS));
            origin + along * s + across * t
        };
        for i in 0..CELLS {
            for j in 0..CELLS {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
                    .map(|(i, j)| self.vertex(point(i, j)));
                self.mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
}

/// A square of side 2 in z = 0, seen from above.
#[must_use]
pub fn plate() -> SoupMesh {
    let mut patches = Patches::default();
    let (side, origin) = (2.0, DVec3::new(-1.0, -1.0, 0.0));
    patches.add(origin, DVec3::X * side, DVec3::Y * side);
    patches.mesh
}

/// Two squares of side 2 back to back: the upper one in z = 0, the other `gap` below it, which may
/// be 0.
#[must_use]
pub fn sheets(gap: f64) -> SoupMesh {
    back_to_back(plate(), gap)
}

/// The height of a waved sheet over a place.
#[must_use]
pub fn wave(x: f64, y: f64) -> f64 {
    0.05 * (3.0 * x).sin() * (3.0 * y).cos()
}

/// The same of waves, with so many cells a side.
#[must_use]
pub fn waved_sheets(gap: f64, cells: u32) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    let along = |k: u32| 2.0 * f64::from(k) / f64::from(cells) - 1.0;
    for j in 0..=cells {
        for (x, y) in (0..=cells).map(|i| (along(i), along(j))) {
            mesh.positions.push([x, y, wave(x, y)]);
        }
    }
    for (i, j) in (0..cells).flat_map(|j| (0..cells).map(move |i| (i, j))) {
        let a = j * (cells + 1) + i;
        let [b, c, d] = [a + 1, a + cells + 2, a + cells + 1];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    back_to_back(mesh, gap)
}

/// A sheet, and the same turned over `gap` below it.
fn back_to_back(mut mesh: SoupMesh, gap: f64) -> SoupMesh {
    let below = mesh.clone();
    let first = mesh.positions.len() as u32;
    mesh.positions
        .extend(below.positions.iter().map(|&[x, y, z]| [x, y, z - gap]));
    mesh.triangles.extend(
        below
            .triangles
            .iter()
            .map(|&[a, b, c]| [a + first, c + first, b + first]),
    );
    mesh
}

/// Two planes that meet along y in the origin; `turn` is the angle between their normals, radians:
/// a ridge when positive, a valley when negative. Seen from above.
#[must_use]
pub fn roof(turn: f64) -> SoupMesh {
    let (sin, cos) = (0.5 * turn).sin_cos();
    let mut patches = Patches::default();
    let along = DVec3::Y * 2.0;
    let edge = DVec3::new(0.0, -1.0, 0.0);
    patches.add(edge, DVec3::new(cos, 0.0, -sin), along);
    patches.add(edge, along, DVec3::new(-cos, 0.0, -sin));
    patches.mesh
}

/// Three squares in the planes x = 0, y = 0 and z = 0 that meet in the origin, seen from within.
#[must_use]
pub fn corner() -> SoupMesh {
    let mut patches = Patches::default();
    let [x, y, z] = DVec3::AXES;
    patches.add(DVec3::ZERO, y, z);
    patches.add(DVec3::ZERO, z, x);
    patches.add(DVec3::ZERO, x, y);
    patches.mesh
}

/// What was put into a damaged mesh, by kind; of the other kinds nothing is dropped.
#[derive(Debug, Clone, Copy, Default)]
pub struct Damage {
    /// Faces without area.
    pub zero_area: u64,
    /// Faces that are there already.
    pub duplicates: u64,
    /// Faces with a corner that is no number.
    pub not_finite: u64,
}

/// A plate among everything that is wrong with meshes: faces without area, duplicates, slivers,
/// turned faces, a vertex that is no number, an edge of three faces, a crack.
#[must_use]
pub fn damaged_plate() -> (SoupMesh, Damage) {
    let mut mesh = plate();
    let mut damage = Damage::default();
    let faces = mesh.triangles.clone();
    for (k, &[a, b, c]) in faces.iter().enumerate() {
        match k % 12 {
            0 => {
                mesh.triangles.push([a, a, b]);
                damage.zero_area += 1;
            }
            1 => {
                mesh.triangles.push([a, b, c]);
                damage.duplicates += 1;
            }
            2 => mesh.triangles.push([a, c, b]),
            3 => mesh.triangles[k] = [a, c, b],
            4 => {
                // A sliver a millionth as high as it is long.
                let [p, q] = [a, b].map(|v| DVec3::from_array(mesh.positions[v as usize]));
                let beside = (p + q) * 0.5 - DVec3::Z * 1e-6 * p.distance(q);
                let v = mesh.positions.len() as u32;
                mesh.positions.push(beside.to_array());
                mesh.triangles.push([a, v, b]);
            }
            5 => {
                // A third face at an edge, down from it.
                let p = DVec3::from_array(mesh.positions[a as usize]);
                let v = mesh.positions.len() as u32;
                mesh.positions.push((p - DVec3::Z * 0.1).to_array());
                mesh.triangles.push([a, b, v]);
            }
            6 => {
                // A crack a hundred thousandth wide: this face has corners of its own.
                let v = mesh.positions.len() as u32;
                for corner in [a, b, c] {
                    let p = DVec3::from_array(mesh.positions[corner as usize]);
                    mesh.positions.push((p * (1.0 - 1e-5)).to_array());
                }
                mesh.triangles[k] = [v, v + 1, v + 2];
            }
            7 => {
                let v = mesh.positions.len() as u32;
                mesh.positions.push([f64::NAN, 0.0, 0.0]);
                mesh.triangles.push([a, b, v]);
                damage.not_finite += 1;
            }
            _ => {}
        }
    }
    (mesh, damage)
}

/// A pit of so many flat slopes around the origin, which rise by `steep`, seen from above.
#[must_use]
pub fn pit(slopes: u32, steep: f64) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    mesh.positions.push([0.0; 3]);
    for k in 0..slopes {
        let turn = std::f64::consts::TAU * f64::from(k) / f64::from(slopes);
        mesh.positions.push([turn.cos(), turn.sin(), steep]);
        mesh.triangles.push([0, 1 + k, 1 + (k + 1) % slopes]);
    }
    mesh
}
