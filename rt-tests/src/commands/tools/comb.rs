//! A comb: slots of one width with walls between, as deep as three widths. A rod that is hardly
//! thinner than a slot touches both walls and the floor.

use crate::failure::{Chosen, Failure};
use spm::write_spm;
use spm_builder::{BuildOptions, NoProgress, SoupMesh, build_model};
use std::path::Path;

/// Slots, and their width, depth and length, millimetres. Walls are as wide as slots.
const SLOTS: u32 = 12;
const WIDTH: f64 = 1.0;
const DEPTH: f64 = 3.0;
const LENGTH: f64 = 24.0;
/// Largest side of a face, millimetres: a quarter of the width.
const SIDE: f64 = 0.25;

/// The longest side of the comb, metres.
pub const SIZE_M: f64 = 1e-3 * (2 * SLOTS + 1) as f64 * WIDTH;

/// The profile across the slots: position and height, millimetres.
fn profile() -> Vec<[f64; 2]> {
    let mut corners = vec![[0.0, 0.0]];
    for slot in 0..SLOTS {
        let left = f64::from(2 * slot + 1) * WIDTH;
        let right = left + WIDTH;
        corners.extend([[left, 0.0], [left, -DEPTH], [right, -DEPTH], [right, 0.0]]);
    }
    corners.push([f64::from(2 * SLOTS + 1) * WIDTH, 0.0]);
    let mut points = vec![corners[0]];
    for pair in corners.windows(2) {
        let [[x, z], [u, w]] = [pair[0], pair[1]];
        let parts = ((u - x).hypot(w - z) / SIDE).ceil();
        points.extend((1..=parts as u32).map(|part| {
            let share = f64::from(part) / parts;
            [x + (u - x) * share, z + (w - z) * share]
        }));
    }
    points
}

/// The comb's surface, open at its sides and below.
fn mesh() -> SoupMesh {
    let profile = profile();
    let rows = (LENGTH / SIDE).ceil() as u32;
    let across = profile.len() as u32;
    let mut mesh = SoupMesh::default();
    for row in 0..=rows {
        let y = LENGTH * f64::from(row) / f64::from(rows);
        mesh.positions
            .extend(profile.iter().map(|&[x, z]| [x, y, z]));
    }
    for (row, k) in (0..rows).flat_map(|row| (0..across - 1).map(move |k| (row, k))) {
        let a = row * across + k;
        let [b, c, d] = [a + 1, a + across + 1, a + across];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// Writes the comb as an SPM file.
///
/// # Errors
/// When it cannot be built or written.
pub fn write(path: &Path) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::Run(format!("the comb: {error}"));
    let parts =
        build_model(mesh(), &BuildOptions::default(), &NoProgress).map_err(|e| failed(&e))?;
    let mut bytes = Vec::new();
    write_spm(&parts, &mut bytes).map_err(|e| failed(&e))?;
    let wrong = |error: std::io::Error| Failure::write_at(Chosen::Temporary, path, &error);
    std::fs::write(path, bytes).map_err(wrong)
}
