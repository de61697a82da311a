//! Meshes that are hard on a deadline: vertices with thousands of faces, and thin teeth.

use spm_builder::SoupMesh;
use std::f64::consts::{PI, TAU};

/// A unit sphere of meridians and parallels; each pole is a vertex with a face for each meridian.
#[must_use]
pub fn uv_sphere(meridians: u32, parallels: u32) -> SoupMesh {
    let ring = |row: u32| {
        let polar = PI * f64::from(row) / f64::from(parallels + 1);
        (polar.sin(), polar.cos())
    };
    let rings: Vec<(f64, f64)> = (1..=parallels).map(ring).collect();
    capped(&rings, meridians, [1.0, -1.0])
}

/// A cylinder of radius 1 and height 2 whose caps are fans around their middles.
#[must_use]
pub fn cylinder(segments: u32, rows: u32) -> SoupMesh {
    let height = |row: u32| 1.0 - 2.0 * f64::from(row) / f64::from(rows - 1);
    let rings: Vec<(f64, f64)> = (0..rows).map(|row| (1.0, height(row))).collect();
    capped(&rings, segments, [1.0, -1.0])
}

/// Rings (radius, z) from above to below, closed by fans around two points on the axis.
fn capped(rings: &[(f64, f64)], segments: u32, ends: [f64; 2]) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    for &(radius, z) in rings {
        mesh.positions.extend((0..segments).map(|k| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(segments)).sin_cos();
            [radius * cos, radius * sin, z]
        }));
    }
    let rows = rings.len() as u32;
    let [top, bottom] = [rows * segments, rows * segments + 1];
    mesh.positions.extend(ends.map(|z| [0.0, 0.0, z]));
    for k in 0..segments {
        let next = (k + 1) % segments;
        mesh.triangles.push([top, k, next]);
        let last = (rows - 1) * segments;
        mesh.triangles.push([bottom, last + next, last + k]);
        for row in 0..rows - 1 {
            let (a, b) = (row * segments + k, row * segments + next);
            let (c, d) = (a + segments, b + segments);
            mesh.triangles.extend([[a, c, d], [a, d, b]]);
        }
    }
    mesh
}

/// A spur gear of outer radius 1: its teeth are trapezoids, its flanks and faces fine grids.
#[must_use]
pub fn spur_gear(teeth: u32) -> SoupMesh {
    // Across a pitch: root, flank, tip, flank; as shares of the pitch.
    const CORNERS: [(f64, f64); 4] = [(0.0, 0.88), (0.3, 0.88), (0.42, 1.0), (0.88, 1.0)];
    const PARTS: u32 = 8;
    let pitch = TAU / f64::from(teeth);
    let mut outline = Vec::new();
    for tooth in 0..teeth {
        for (k, &(from, inner)) in CORNERS.iter().enumerate() {
            let (to, outer) = CORNERS.get(k + 1).copied().unwrap_or((1.0, CORNERS[0].1));
            outline.extend((0..PARTS).map(|part| {
                let share = f64::from(part) / f64::from(PARTS);
                let angle = pitch * (f64::from(tooth) + from + (to - from) * share);
                let radius = inner + (outer - inner) * share;
                [radius * angle.cos(), radius * angle.sin()]
            }));
        }
    }
    drawn_out(&outline, 0.3, 16)
}

/// A closed outline around the origin, drawn out along z, its two sides rings down to the middle.
fn drawn_out(outline: &[[f64; 2]], thickness: f64, rows: u32) -> SoupMesh {
    // Rings of (share of the outline, z): in along the top, down, out along the bottom.
    let inner = |k: u32| 0.05 + 0.95 * f64::from(k) / f64::from(rows);
    let top = (1..rows).map(|k| (inner(k), 0.5 * thickness));
    let side = (0..=rows).map(|k| (1.0, thickness * (0.5 - f64::from(k) / f64::from(rows))));
    let bottom = (1..rows).rev().map(|k| (inner(k), -0.5 * thickness));
    let rings: Vec<(f64, f64)> = top.chain(side).chain(bottom).collect();
    let segments = outline.len() as u32;
    let mut mesh = capped(&rings, segments, [0.5 * thickness, -0.5 * thickness]);
    for (ring, &(share, _)) in rings.iter().enumerate() {
        for (k, &[x, y]) in outline.iter().enumerate() {
            let place = &mut mesh.positions[ring * outline.len() + k];
            (place[0], place[1]) = (share * x, share * y);
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn volume(mesh: &SoupMesh) -> f64 {
        let place = |v: u32| DVec3::from_array(mesh.positions[v as usize]);
        let six = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(place);
            a.dot(b.cross(c))
        });
        six.sum::<f64>() / 6.0
    }

    #[test]
    fn the_shapes_are_closed_face_outwards_and_have_their_large_fans() {
        let sphere = uv_sphere(1000, 38);
        assert!(
            (volume(&sphere) - 4.0 / 3.0 * PI).abs() < 0.02,
            "{}",
            volume(&sphere)
        );
        assert_eq!(sphere.triangles.len(), 76_000);
        let cylinder = cylinder(3000, 4);
        assert!((volume(&cylinder) - 2.0 * PI).abs() < 1e-3);
        let gear = spur_gear(40);
        let disc = PI * 0.3;
        let filled = volume(&gear) / disc;
        assert!((0.75..1.0).contains(&filled), "{filled}");
        for mesh in [&sphere, &cylinder, &gear] {
            let mut degree = vec![0u32; mesh.positions.len()];
            let mut edges = std::collections::BTreeMap::new();
            for t in &mesh.triangles {
                for k in 0..3 {
                    degree[t[k] as usize] += 1;
                    *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
                }
            }
            assert!(degree.iter().max().unwrap() >= &1000);
            // Each edge once in either direction: closed and oriented.
            for (&(a, b), &count) in &edges {
                assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)));
            }
        }
    }
}
