//! How wide a crack may open along a cut.
//!
//! The copies of a cut vertex are one place in the full mesh. On a coarser front each is where its
//! active ancestor is, at most R of that away: each lip of a crack is within the certified error of
//! the seam, and the two lips are no farther apart than the sum for both.

use crate::history::History;
use crate::manifold::ManifoldMesh;
use glam::Vec3;

/// The widest gap between two copies of a vertex on any front, or more: model units, zero where all
/// are locked.
///
/// Takes time in proportion to the sum of the depths of the copies.
pub fn widest_crack(mesh: &ManifoldMesh, history: &History) -> f64 {
    if mesh.copies == mesh.locked {
        return 0.0;
    }
    let mut parent = vec![u32::MAX; history.positions.len()];
    for (collapse, made) in history.collapses.iter().zip(history.full_vertices..) {
        parent[collapse.vt as usize] = made;
        parent[collapse.vu as usize] = made;
    }
    let at = |vertex: u32| Vec3::from_array(history.positions[vertex as usize]).as_dvec3();
    // How far a copy comes from its place on any front.
    let displacement_of = |leaf: u32| {
        let ancestors = std::iter::successors(Some(leaf), |&v| {
            Some(parent[v as usize]).filter(|&above| above != u32::MAX)
        });
        ancestors
            .map(|v| at(v).distance(at(leaf)))
            .fold(0.0, f64::max)
    };
    let mut copies: Vec<([u32; 3], u32)> = (0u32..)
        .zip(&mesh.copies)
        .filter(|(_, copy)| **copy)
        .map(|(vertex, _)| (mesh.positions[vertex as usize].map(f32::to_bits), vertex))
        .collect();
    copies.sort_unstable();
    let mut widest = 0.0f64;
    for group in copies.chunk_by(|a, b| a.0 == b.0) {
        let (mut first, mut second) = (0.0f64, 0.0f64);
        for &(_, vertex) in group {
            let displacement = displacement_of(vertex);
            second = second.max(displacement.min(first));
            first = first.max(displacement);
        }
        widest = widest.max(first + second);
    }
    // Roots and the sum round.
    widest * (1.0 + 8.0 * f64::EPSILON)
}
