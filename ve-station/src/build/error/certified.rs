//! R: the certified error of a vertex, the distance to its farthest full-mesh descendant.
//!
//! The map that takes every full-mesh vertex to its active ancestor, linear on faces, is onto the active
//! mesh and moves no point farther than that. So the largest R of the corners of an active face bounds
//! the distance between the two surfaces there, both ways, for every front.

use crate::build::simplify::History;
use glam::Vec3;

/// R of every vertex of a history, model units, exact in f64; zero for those of the full mesh.
///
/// Takes time in proportion to the sum of the depths of all full-mesh vertices.
pub fn descendant_radius(history: &History) -> Vec<f64> {
    let mut parent = vec![u32::MAX; history.positions.len()];
    for (collapse, made) in history.collapses.iter().zip(history.full_vertices..) {
        parent[collapse.vt as usize] = made;
        parent[collapse.vu as usize] = made;
    }
    let at = |vertex: u32| Vec3::from_array(history.positions[vertex as usize]).as_dvec3();
    let mut squared = vec![0.0f64; history.positions.len()];
    for leaf in 0..history.full_vertices {
        let mut ancestor = parent[leaf as usize];
        while ancestor != u32::MAX {
            let farthest = &mut squared[ancestor as usize];
            *farthest = farthest.max(at(ancestor).distance_squared(at(leaf)));
            ancestor = parent[ancestor as usize];
        }
    }
    // Differences, squares and the root round, each by half a unit in the last place.
    squared
        .into_iter()
        .map(|s| s.sqrt() * (1.0 + 4.0 * f64::EPSILON))
        .collect()
}
