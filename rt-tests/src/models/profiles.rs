//! Meshes of a profile: drawn out along a line, or turned about an axis.

use spm_builder::SoupMesh;
use std::f64::consts::TAU;

/// Largest side of a face along the profile and along its way.
const SIDE: f64 = 1.0;

/// Points along a line of corners, no farther apart than [`SIDE`].
fn refined(corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = corners.first().copied().into_iter().collect();
    for pair in corners.windows(2) {
        let [[x, z], [u, w]] = [pair[0], pair[1]];
        let parts = ((u - x).hypot(w - z) / SIDE).ceil() as u32;
        points.extend((1..=parts).map(|part| {
            let share = f64::from(part) / f64::from(parts);
            [x + (u - x) * share, z + (w - z) * share]
        }));
    }
    points
}

/// Faces between the rows of a grid; each row has `across` vertices, and the last row of a closed
/// grid is followed by the first.
fn add_grid(mesh: &mut SoupMesh, rows: u32, across: u32, is_closed: bool) {
    let gaps = if is_closed { rows } else { rows - 1 };
    for (row, k) in (0..gaps).flat_map(|row| (0..across - 1).map(move |k| (row, k))) {
        let (a, d) = (row * across + k, (row + 1) % rows * across + k);
        mesh.triangles.extend([[a, a + 1, d + 1], [a, d + 1, d]]);
    }
}

/// A profile (x, z) of some length along y, its middle at y = 0. Its normals are on the left of the
/// profile: upwards where x grows.
#[must_use]
pub fn extruded(corners: &[[f64; 2]], length: f64) -> SoupMesh {
    let profile = refined(corners);
    let rows = (length / SIDE).ceil() as u32 + 1;
    let mut mesh = SoupMesh::default();
    for row in 0..rows {
        let y = length * (f64::from(row) / f64::from(rows - 1) - 0.5);
        let points = profile.iter().map(|&[x, z]| [x, y, z]);
        mesh.positions.extend(points);
    }
    add_grid(&mut mesh, rows, profile.len() as u32, false);
    mesh
}

/// A profile (radius, z) about the z axis, in so many segments. Its normals are on the left of the
/// profile: upwards where the radius grows, towards the axis where z does.
#[must_use]
pub fn revolved(corners: &[[f64; 2]], segments: u32) -> SoupMesh {
    let profile = refined(corners);
    let mut mesh = SoupMesh::default();
    for segment in 0..segments {
        let (sin, cos) = (TAU * f64::from(segment) / f64::from(segments)).sin_cos();
        let points = profile.iter().map(|&[r, z]| [r * cos, r * sin, z]);
        mesh.positions.extend(points);
    }
    add_grid(&mut mesh, segments, profile.len() as u32, true);
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Middle and normal of each face.
    fn faces(mesh: &SoupMesh) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
        mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize]));
            ((a + b + c) / 3.0, (b - a).cross(c - a).normalize())
        })
    }

    #[test]
    fn faces_are_seen_from_where_a_tool_is() {
        let slot = extruded(&[[-3.0, 0.0], [-1.0, 0.0], [-1.0, -2.0], [1.0, -2.0]], 4.0);
        for (middle, normal) in faces(&slot) {
            let is_wall = middle.z < 0.0 && middle.z > -2.0;
            let expected = if is_wall { DVec3::X } else { DVec3::Z };
            assert!(normal.distance(expected) < 1e-12, "{middle} {normal}");
        }
        let hole = revolved(&[[2.0, -5.0], [2.0, 0.0], [6.0, 0.0]], 32);
        for (middle, normal) in faces(&hole) {
            if middle.z < -1e-9 {
                let radial = middle.truncate().normalize();
                assert!(normal.truncate().dot(radial) < -0.99, "{middle} {normal}");
            } else {
                assert!(normal.z > 0.99, "{middle} {normal}");
            }
        }
    }
}
