//! R: the certified error of a vertex, the distance to its farthest full-mesh descendant.
//!
//! The map that takes every full-mesh vertex to its active ancestor, linear on faces, is onto the
//! active mesh and moves no point farther than that. So the largest R of the corners of an active
//! face bounds the distance between the two surfaces there, both ways, for every front.

use super::descendants::Descendants;
use crate::history::History;
use glam::Vec3;
use rayon::prelude::*;

/// R of the vertices that the collapses of a history made, model units, exact in f64. (It is zero
/// for the full mesh's.)
///
/// Takes time in proportion to the sum of their depths, over all threads; memory: 16 B a
/// vertex.
pub fn descendant_radius(history: &History, descendants: &Descendants) -> Vec<f64> {
    let full = history.full_vertices;
    let mut laid_out = vec![[0.0; 3]; full as usize];
    for (leaf, position) in (0..full).zip(&history.positions) {
        laid_out[descendants.places(leaf).start as usize] = *position;
    }
    let at = |position: &[f32; 3]| Vec3::from_array(*position).as_dvec3();
    let made = &history.positions[full as usize..];
    made.par_iter()
        .enumerate()
        .map(|(k, position)| {
            let places = descendants.places(full + k as u32);
            let squared = laid_out[places.start as usize..places.end as usize]
                .iter()
                .map(|leaf| at(position).distance_squared(at(leaf)))
                .fold(0.0, f64::max);
            // Differences, squares and the root round, each by half a unit in the last place.
            squared.sqrt() * (1.0 + 4.0 * f64::EPSILON)
        })
        .collect()
}
