//! Tools, and what they go into, metres.

use glam::{DVec2, DVec3};
use scene::{ProbeShape, ToolMeshPlan};
use spm_builder::SoupMesh;
use std::f64::consts::TAU;

/// Rows of faces along a wall.
const ROWS: u32 = 4;

/// A circle of so many sides, counterclockwise.
pub fn circle(radius: f64, sides: u32) -> Vec<DVec2> {
    let turn = |k: u32| TAU * f64::from(k) / f64::from(sides);
    (0..sides)
        .map(|k| DVec2::from_angle(turn(k)) * radius)
        .collect()
}

/// A rectangle, counterclockwise.
pub fn rectangle(half: DVec2) -> Vec<DVec2> {
    let signs = [[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
    signs.map(|s| half * DVec2::from_array(s)).to_vec()
}

/// Rows of points around the z axis, joined by faces; seen from outside the axis.
fn tube(rows: &[Vec<DVec3>]) -> SoupMesh {
    let mut mesh = SoupMesh::default();
    let around = rows[0].len() as u32;
    mesh.positions
        .extend(rows.iter().flatten().map(|p| p.to_array()));
    for row in 0..rows.len() as u32 - 1 {
        for k in 0..around {
            let [a, b] = [k, (k + 1) % around].map(|k| row * around + k);
            let [c, d] = [b + around, a + around];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Closes a tube at its last row, seen along z where `up`, else against it.
fn close(mesh: &mut SoupMesh, first: u32, around: u32, up: bool) {
    let sum: DVec3 = (first..first + around)
        .map(|k| DVec3::from_array(mesh.positions[k as usize]))
        .sum();
    let middle = mesh.positions.len() as u32;
    mesh.positions.push((sum / f64::from(around)).to_array());
    for k in 0..around {
        let [a, b] = [first + k, first + (k + 1) % around];
        mesh.triangles
            .push(if up { [middle, a, b] } else { [middle, b, a] });
    }
}

/// A block with a hole of this outline and depth in its upper side, z = 0, and a floor; four times
/// as wide.
pub fn hole(outline: &[DVec2], depth: f64) -> SoupMesh {
    let around = outline.len() as u32;
    let row = |scale: f64, z: f64| outline.iter().map(|p| (*p * scale).extend(z)).collect();
    let mut rows: Vec<Vec<DVec3>> = vec![row(4.0, 0.0), row(2.0, 0.0)];
    rows.extend((0..=ROWS).map(|k| row(1.0, -depth * f64::from(k) / f64::from(ROWS))));
    let mut mesh = tube(&rows);
    let last = (rows.len() as u32 - 1) * around;
    close(&mut mesh, last, around, true);
    mesh
}

/// A prism of this outline that stands on z = 0.
pub fn prism(outline: &[DVec2], length: f64) -> SoupMesh {
    let around = outline.len() as u32;
    let row = |z: f64| outline.iter().map(|p| p.extend(z)).collect();
    let rows: Vec<Vec<DVec3>> = (0..=ROWS)
        .map(|k| row(length * f64::from(k) / f64::from(ROWS)))
        .collect();
    let mut mesh = tube(&rows);
    close(&mut mesh, 0, around, false);
    close(&mut mesh, ROWS * around, around, true);
    mesh
}

/// The surface of a thread around z, from one height to another: a radius that swings by `swing`
/// once a turn and a `pitch`.
fn thread(radius: f64, swing: f64, pitch: f64, [from, to]: [f64; 2]) -> Vec<Vec<DVec3>> {
    const AROUND: u32 = 48;
    let rows = (8.0 * (to - from) / pitch).ceil() as u32;
    let row = |k: u32| {
        let z = from + (to - from) * f64::from(k) / f64::from(rows);
        (0..AROUND)
            .map(|j| {
                let share = f64::from(j) / f64::from(AROUND);
                let phase = (z / pitch - share).rem_euclid(1.0);
                // A triangle: up and down again.
                let height = radius + swing * (4.0 * (phase - 0.5).abs() - 1.0);
                (DVec2::from_angle(TAU * share) * height).extend(z)
            })
            .collect()
    };
    (0..=rows).map(row).collect()
}

/// A threaded bore from z = -depth to 0, seen from within.
pub fn nut(radius: f64, swing: f64, pitch: f64, depth: f64) -> SoupMesh {
    let mut mesh = tube(&thread(radius, swing, pitch, [-depth, 0.0]));
    for face in &mut mesh.triangles {
        face.swap(1, 2);
    }
    mesh
}

/// A screw that stands on z = 0, closed.
pub fn screw(radius: f64, swing: f64, pitch: f64, length: f64) -> SoupMesh {
    let rows = thread(radius, swing, pitch, [0.0, length]);
    let around = rows[0].len() as u32;
    let mut mesh = tube(&rows);
    close(&mut mesh, 0, around, false);
    close(&mut mesh, (rows.len() as u32 - 1) * around, around, true);
    mesh
}

/// A groove along y whose sides meet in the origin under this angle, radians; seen from above.
pub fn groove(angle: f64, depth: f64, length: f64) -> SoupMesh {
    const CELLS: u32 = 12;
    let width = depth * (0.5 * angle).tan();
    let mut mesh = SoupMesh::default();
    for k in 0..=CELLS {
        let y = length * (f64::from(k) / f64::from(CELLS) - 0.5);
        let across = [[-width, depth], [0.0, 0.0], [width, depth]];
        mesh.positions.extend(across.map(|[x, z]| [x, y, z]));
    }
    for k in 0..CELLS {
        for side in 0..2 {
            let a = 3 * k + side;
            mesh.triangles
                .extend([[a, a + 1, a + 4], [a, a + 4, a + 3]]);
        }
    }
    mesh
}

/// The longest side of a mesh's box.
pub fn longest_side(mesh: &SoupMesh) -> f64 {
    let bounds = mesh
        .positions
        .iter()
        .map(|&p| DVec3::from_array(p))
        .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| {
            [low.min(p), high.max(p)]
        });
    (bounds[1] - bounds[0]).max_element()
}

/// A mesh as a probe.
pub fn tool(mesh: &SoupMesh) -> ProbeShape {
    ProbeShape::Mesh(ToolMeshPlan {
        file: "case".to_string(),
        positions: mesh
            .positions
            .iter()
            .map(|&p| DVec3::from_array(p))
            .collect(),
        triangles: mesh.triangles.clone(),
    })
}
