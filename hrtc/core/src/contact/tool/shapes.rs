//! Tool meshes of simple shape: closed, along z, centred at the origin.

use super::ToolMesh;
use geometry::portable::{ln, sin_cos};
use glam::DVec3;
use scene::ProbeShape;
use std::f64::consts::{FRAC_PI_2, TAU};

impl ToolMesh {
    /// The mesh of a probe's shape about the device's position, metres; `None` for a ball, which
    /// needs none.
    #[must_use]
    pub fn of_shape(shape: &ProbeShape) -> Option<Self> {
        let (mut mesh, up) = match *shape {
            ProbeShape::Sphere { .. } => return None,
            ProbeShape::Capsule {
                radius_m,
                length_m,
                faces,
            } => {
                // Two faces per piece; about twice as many pieces around as a cap has rings.
                let around = ((f64::from(faces) / 2.0).sqrt() as usize).max(3);
                let circles = (faces as usize / (2 * around)).max(2) & !1;
                let mesh = capsule_mesh(radius_m, length_m, around, circles);
                (mesh, 0.5 * length_m - radius_m)
            }
            ProbeShape::Cylinder {
                radius_m,
                length_m,
                faces,
            } => {
                let mesh = cylinder_mesh(radius_m, length_m, faces as usize);
                (mesh, 0.5 * length_m)
            }
            ProbeShape::Mesh(ref mesh) => {
                let (positions, triangles) = (mesh.positions.clone(), mesh.triangles.clone());
                return Some(Self {
                    positions,
                    triangles,
                });
            }
        };
        for position in &mut mesh.positions {
            position.z += up;
        }
        Some(mesh)
    }
}

/// A point of the circle of `radius` at height `z`, `k` of `around`.
fn on_circle(radius: f64, z: f64, k: usize, around: usize) -> DVec3 {
    let (sin, cos) = sin_cos(TAU * k as f64 / around as f64);
    DVec3::new(radius * cos, radius * sin, z)
}

/// Rings of `around` vertices from low to high, closed by a vertex at either end.
fn rings(low: DVec3, circles: &[(f64, f64)], high: DVec3, around: usize) -> ToolMesh {
    let mut positions = vec![low];
    for &(radius, z) in circles {
        positions.extend((0..around).map(|k| on_circle(radius, z, k, around)));
    }
    positions.push(high);
    let at = |ring: usize, k: usize| (1 + ring * around + k % around) as u32;
    let last = (positions.len() - 1) as u32;
    let mut triangles = Vec::with_capacity(2 * around * circles.len());
    for k in 0..around {
        triangles.push([0, at(0, k + 1), at(0, k)]);
        for ring in 1..circles.len() {
            let (a, b) = (at(ring - 1, k), at(ring - 1, k + 1));
            let (c, d) = (at(ring, k), at(ring, k + 1));
            triangles.push([a, b, d]);
            triangles.push([a, d, c]);
        }
        let top = circles.len() - 1;
        triangles.push([last, at(top, k), at(top, k + 1)]);
    }
    ToolMesh {
        positions,
        triangles,
    }
}

/// A capsule of 2 x `around` x `circles` faces, `length` from end to end; at least 3 around and 2
/// rings, an even number, half for each cap.
#[must_use]
pub fn capsule_mesh(radius: f64, length: f64, around: usize, circles: usize) -> ToolMesh {
    let (around, a_cap) = (around.max(3), circles.div_ceil(2).max(1));
    let centre = 0.5 * length - radius;
    let angle = |k: usize| FRAC_PI_2 * k as f64 / a_cap as f64;
    let upper = (0..a_cap).map(|k| {
        let (sin, cos) = sin_cos(angle(k));
        (radius * cos, centre + radius * sin)
    });
    let lower = upper.clone().rev().map(|(r, z)| (r, -z));
    let circles: Vec<(f64, f64)> = lower.chain(upper).collect();
    let end = DVec3::Z * (0.5 * length);
    rings(-end, &circles, end, around)
}

/// A cylinder of at most `faces` faces, at least 12, with near-square pieces (the cylinder probe,
/// thesis 5.8).
#[must_use]
pub fn cylinder_mesh(radius: f64, length: f64, faces: usize) -> ToolMesh {
    // `around` times (bands + 1) pairs of faces: the two fans are one pair each.
    let pairs = (faces / 2).max(6);
    let shape = |around: usize| {
        let bands = pairs / around - 1;
        let lost = pairs - around * (bands + 1);
        let (width, height) = (TAU * radius / around as f64, length / bands as f64);
        let elongation = ln(width / height).abs();
        // A loss of a tenth of the faces weighs as much as pieces twice as long as wide.
        (bands, elongation + 7.0 * lost as f64 / pairs as f64)
    };
    let mut best = (3, shape(3));
    for around in 4..=pairs / 2 {
        let candidate = shape(around);
        if candidate.1 < best.1.1 {
            best = (around, candidate);
        }
    }
    let (around, (bands, _)) = best;
    let circles: Vec<(f64, f64)> = (0..=bands)
        .map(|k| (radius, length * (k as f64 / bands as f64 - 0.5)))
        .collect();
    let end = DVec3::Z * (0.5 * length);
    rings(-end, &circles, end, around)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    fn volume(mesh: &ToolMesh) -> f64 {
        let corners = |t: &[u32; 3]| t.map(|v| mesh.positions[v as usize]);
        let signed = |t: &[u32; 3]| {
            let [a, b, c] = corners(t);
            a.dot(b.cross(c)) / 6.0
        };
        mesh.triangles.iter().map(signed).sum()
    }

    /// Every edge is present once in each direction.
    fn assert_closed(mesh: &ToolMesh) {
        let mut edges = BTreeSet::new();
        for t in &mesh.triangles {
            for k in 0..3 {
                assert!(
                    edges.insert((t[k], t[(k + 1) % 3])),
                    "an edge is there twice"
                );
            }
        }
        assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
    }

    #[test]
    fn capsules_are_closed_and_of_the_right_size() {
        for (around, circles) in [(12, 10), (24, 20), (3, 2)] {
            let mesh = capsule_mesh(0.015, 0.1, around, circles);
            assert_eq!(mesh.triangles.len(), 2 * around * circles);
            assert_closed(&mesh);
        }
        let exact = TAU * (0.5 * 0.07 * 0.015f64.powi(2) + 2.0 / 3.0 * 0.015f64.powi(3));
        let found = volume(&capsule_mesh(0.015, 0.1, 200, 100));
        assert!((found / exact - 1.0).abs() < 1e-3, "{found} {exact}");
    }

    #[test]
    fn cylinders_have_nearly_the_faces_asked_for() {
        for faces in [12, 100, 240, 960, 961, 5000] {
            let mesh = cylinder_mesh(1.0, 6.0, faces);
            assert!(mesh.triangles.len() <= faces);
            assert!(
                mesh.triangles.len() * 10 >= faces * 9,
                "{}",
                mesh.triangles.len()
            );
            assert_closed(&mesh);
        }
        let found = volume(&cylinder_mesh(1.0, 6.0, 5000));
        let exact = 0.5 * TAU * 6.0;
        assert!((found / exact - 1.0).abs() < 1e-2, "{found} {exact}");
    }
}
