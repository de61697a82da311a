//! R: the certified error of a vertex, the distance to its farthest full-mesh descendant.
//!
//! The map that takes every full-mesh vertex to its active ancestor, linear on faces, is onto the
//! active mesh and moves no point farther than that. So the largest R of the corners of an active
//! face bounds the distance between the two surfaces there, both ways, for every front.

use crate::history::History;
use glam::Vec3;
use rayon::prelude::*;

/// Parent of a vertex that the base mesh has.
const ROOT: u32 = u32::MAX;

/// R of the vertices that the collapses of a history made, model units, exact in f64. (It is zero
/// for the full mesh's.)
///
/// The vertices of the full mesh are laid out such that the descendants of every vertex lie side by
/// side. Takes time in proportion to the sum of their depths, over all threads; memory: 16 B a
/// vertex.
pub fn descendant_radius(history: &History) -> Vec<f64> {
    let full = history.full_vertices as usize;
    let made = &history.positions[full..];
    let leaves = |count: &[u32], vertex: u32| match (vertex as usize).checked_sub(full) {
        Some(made) => count[made],
        None => 1,
    };
    let mut count: Vec<u32> = Vec::with_capacity(made.len());
    for collapse in &history.collapses {
        count.push(leaves(&count, collapse.vt) + leaves(&count, collapse.vu));
    }
    // First descendant of each vertex, from the base mesh down: parents come after their children.
    let mut first = vec![ROOT; history.positions.len()];
    let mut end = 0;
    for (k, collapse) in history.collapses.iter().enumerate().rev() {
        let made = full + k;
        if first[made] == ROOT {
            first[made] = end;
            end += count[k];
        }
        first[collapse.vt as usize] = first[made];
        first[collapse.vu as usize] = first[made] + leaves(&count, collapse.vt);
    }
    let mut laid_out = vec![[0.0; 3]; end as usize];
    for (&place, position) in first[..full].iter().zip(&history.positions) {
        if place != ROOT {
            laid_out[place as usize] = *position;
        }
    }
    let at = |position: &[f32; 3]| Vec3::from_array(*position).as_dvec3();
    made.par_iter()
        .zip(&first[full..])
        .zip(&count)
        .map(|((position, &first), &count)| {
            let descendants = &laid_out[first as usize..(first + count) as usize];
            let squared = descendants
                .iter()
                .map(|leaf| at(position).distance_squared(at(leaf)))
                .fold(0.0, f64::max);
            // Differences, squares and the root round, each by half a unit in the last place.
            squared.sqrt() * (1.0 + 4.0 * f64::EPSILON)
        })
        .collect()
}
