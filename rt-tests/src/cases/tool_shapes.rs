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

/// Sides of a thread's circles: a chord is within 0.01 mm of an arc of 5 mm.
const THREAD_SIDES: u32 = 64;

/// The surface of a thread around z, so many turns up from a height: a radius that swings by
/// `swing` once a turn and a `pitch`, in straight flanks. Crests and roots are edges, so that its
/// faces are within 0.01 mm of it; either end rises by a pitch around z.
fn thread(radius: f64, swing: f64, pitch: f64, (from, turns): (f64, u32)) -> SoupMesh {
    let place = |row: u32, side: u32| {
        let share = f64::from(side) / f64::from(THREAD_SIDES);
        let height = radius + if row.is_multiple_of(2) { -swing } else { swing };
        let z = from + pitch * (0.5 * f64::from(row) + share);
        (DVec2::from_angle(TAU * share) * height).extend(z)
    };
    let rows = 2 * turns;
    let mut mesh = SoupMesh::default();
    for row in 0..=rows {
        let places = (0..THREAD_SIDES).map(|side| place(row, side).to_array());
        mesh.positions.extend(places);
    }
    // Once around, a row goes on in the next but one.
    mesh.positions
        .extend([rows + 1, rows + 2].map(|row| place(row, 0).to_array()));
    for (row, side) in (0..rows).flat_map(|row| (0..THREAD_SIDES).map(move |side| (row, side))) {
        let [a, b, c, d] =
            [[0, 0], [0, 1], [1, 1], [1, 0]].map(|[up, on]| on_thread(rows, row + up, side + on));
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// Index of a point on a thread of so many rows.
fn on_thread(rows: u32, row: u32, side: u32) -> u32 {
    let [row, side] = [row + 2 * (side / THREAD_SIDES), side % THREAD_SIDES];
    if row > rows {
        (rows + 1) * THREAD_SIDES + row - rows - 1
    } else {
        row * THREAD_SIDES + side
    }
}

/// A threaded bore of so many turns whose upper end is between z = 0 and a pitch, seen from within.
pub fn nut(radius: f64, swing: f64, pitch: f64, turns: u32) -> SoupMesh {
    let mut mesh = thread(radius, swing, pitch, (-pitch * f64::from(turns), turns));
    for face in &mut mesh.triangles {
        face.swap(1, 2);
    }
    mesh
}

/// A screw of so many turns whose lower end is between z = 0 and a pitch, closed.
pub fn screw(radius: f64, swing: f64, pitch: f64, turns: u32) -> SoupMesh {
    let mut mesh = thread(radius, swing, pitch, (0.0, turns));
    let rows = 2 * turns;
    for (row, is_up) in [(0, false), (rows, true)] {
        let middle = mesh.positions.len() as u32;
        let height = pitch * (0.5 * f64::from(row) + 0.5);
        mesh.positions.push([0.0, 0.0, height]);
        // Around the end, and down the step to where that began.
        let around = (0..=THREAD_SIDES).map(|side| on_thread(rows, row, side));
        let step = [row + 1, row].map(|row| on_thread(rows, row, 0));
        let ring: Vec<u32> = around.chain(step).collect();
        mesh.triangles.extend(ring.windows(2).map(|of| match is_up {
            true => [middle, of[0], of[1]],
            false => [middle, of[1], of[0]],
        }));
    }
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
