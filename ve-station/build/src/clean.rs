//! Cleaning: drops what is no surface, and counts each thing dropped.

use crate::error::BuildError;
use crate::mesh::SoupMesh;
use crate::t_junctions::{self, Places};
use crate::tuning::input::FAR_DIAGONALS;
use geometry::triangle_is_degenerate;
use glam::{DVec3, Vec3};
use mutants::{Mutant, is};
use rayon::prelude::*;
use spm::BuildSummary;

/// What is left of a soup.
#[derive(Debug, Clone, PartialEq)]
pub struct CleanMesh {
    /// Positions relative to `origin`, model units; finite. Vertices that no face uses are still
    /// there.
    pub positions: Vec<[f32; 3]>,
    /// Corners, counterclockwise; distinct, not on a line, no two faces alike.
    pub triangles: Vec<[u32; 3]>,
    /// What was subtracted from every position.
    pub origin: [f64; 3],
    /// For every vertex the first one of bit-equal position.
    pub same_position: Vec<u32>,
    /// What was read and dropped; the rest is filled in later.
    pub summary: BuildSummary,
}

/// Cleans a soup.
///
/// # Errors
/// When no triangle is left.
pub fn clean(soup: SoupMesh) -> Result<CleanMesh, BuildError> {
    let SoupMesh {
        positions: raw,
        mut triangles,
    } = soup;
    let mut summary = BuildSummary {
        read_vertices: raw.len() as u64,
        read_faces: triangles.len() as u64,
        ..BuildSummary::default()
    };

    let exists = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < raw.len());
    summary.out_of_range_faces = dropped(&mut triangles, exists);

    let origin = choose_origin(&raw, &triangles);
    let positions: Vec<[f32; 3]> = raw
        .iter()
        // Plus zero: the two zeros are one position.
        .map(|&p| ((DVec3::from_array(p) - origin).as_vec3() + Vec3::ZERO).to_array())
        .collect();
    drop(raw);

    let finite = |v: u32| positions[v as usize].iter().all(|x| x.is_finite());
    summary.not_finite_vertices =
        (0..positions.len() as u32).filter(|&v| !finite(v)).count() as u64;
    summary.not_finite_faces = dropped(&mut triangles, |t| t.iter().all(|&v| finite(v)));

    let at = |v: u32| Vec3::from_array(positions[v as usize]).as_dvec3();
    let is_flat: Vec<bool> = triangles
        .par_iter()
        .map(|&[a, b, c]| triangle_is_degenerate(at(a), at(b), at(c)))
        .collect();
    let mut flat = Vec::new();
    let mut is_flat = is_flat.into_iter();
    summary.zero_area_faces = dropped(&mut triangles, |&triangle| {
        let keep = is_flat.next() == Some(false);
        if !keep {
            flat.push(triangle);
        }
        keep
    });

    let same_position = group_by_position(&positions);
    let places = Places {
        positions: &positions,
        same_position: &same_position,
    };
    triangles = t_junctions::close(triangles, &flat, places);
    summary.duplicate_faces = drop_duplicates(&mut triangles, &same_position);

    let mut used = vec![false; positions.len()];
    for &v in triangles.as_flattened() {
        used[v as usize] = true;
    }
    summary.unreferenced_vertices = (0..positions.len() as u32)
        .filter(|&v| !used[v as usize] && finite(v))
        .count() as u64;

    if triangles.is_empty() {
        return Err(BuildError::Empty(why_empty(&summary)));
    }
    Ok(CleanMesh {
        positions,
        triangles,
        origin: origin.to_array(),
        same_position,
        summary,
    })
}

/// Keeps what `keep` says, and counts the rest.
fn dropped(triangles: &mut Vec<[u32; 3]>, keep: impl FnMut(&[u32; 3]) -> bool) -> u64 {
    let before = triangles.len();
    triangles.retain(keep);
    if is(Mutant::Rejects) {
        return 0;
    }
    (before - triangles.len()) as u64
}

/// Zero, or the centre of a model that lies far from its own origin.
fn choose_origin(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> DVec3 {
    far_origin(box_of_faces(positions, triangles))
}

/// The box of all triangles whose vertices exist; from infinity to its negative when there is none.
/// Those that are no faces, with all corners on a line or one beyond f32, tell nothing of where a
/// model lies.
pub(crate) fn box_of_faces<T: Copy + Into<f64> + Sync>(
    positions: &[[T; 3]],
    triangles: &[[u32; 3]],
) -> [DVec3; 2] {
    let place = |v: u32| DVec3::from_array(positions[v as usize].map(Into::into));
    let nowhere = || [DVec3::INFINITY, DVec3::NEG_INFINITY];
    let of_face = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(place);
        let (lower, upper) = (a.min(b).min(c), a.max(b).max(c));
        let size = lower.abs().max(upper.abs()).max_element();
        let is_finite = a.is_finite() && b.is_finite() && c.is_finite();
        let is_face = is_finite && size <= f64::from(f32::MAX) && !triangle_is_degenerate(a, b, c);
        is_face.then_some([lower, upper])
    };
    triangles
        .par_iter()
        .filter_map(of_face)
        .reduce(nowhere, |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Zero, or the centre of a box that lies far from the origin.
pub(crate) fn far_origin([lower, upper]: [DVec3; 2]) -> DVec3 {
    let centre = lower * 0.5 + upper * 0.5;
    if centre.is_finite() && centre.length() > FAR_DIAGONALS * (upper - lower).length() {
        centre
    } else {
        DVec3::ZERO
    }
}

/// For every vertex the first one of bit-equal position.
fn group_by_position(positions: &[[f32; 3]]) -> Vec<u32> {
    let mut order: Vec<([u32; 3], u32)> = positions
        .par_iter()
        .zip(0..positions.len() as u32)
        .map(|(position, vertex)| (position.map(f32::to_bits), vertex))
        .collect();
    order.par_sort_unstable();
    let mut same = vec![0; positions.len()];
    for group in order.chunk_by(|a, b| a.0 == b.0) {
        for &(_, vertex) in group {
            same[vertex as usize] = group[0].1;
        }
    }
    same
}

/// Drops second and later faces with the same corners (by position) in the same cyclic order.
/// Copies of opposite orientation are the two sides of a sheet and stay.
fn drop_duplicates(triangles: &mut Vec<[u32; 3]>, same_position: &[u32]) -> u64 {
    let mut keys: Vec<([u32; 3], u32)> = triangles
        .par_iter()
        .zip(0..triangles.len() as u32)
        .map(|(triangle, index)| {
            let mut corners = triangle.map(|v| same_position[v as usize]);
            let lowest = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
            corners.rotate_left(lowest);
            (corners, index)
        })
        .collect();
    keys.par_sort_unstable();
    let mut copies: Vec<u32> = keys
        .par_windows(2)
        .filter(|pair| pair[0].0 == pair[1].0)
        .map(|pair| pair[1].1)
        .collect();
    drop(keys);
    copies.sort_unstable();
    let mut copies = copies.into_iter().peekable();
    let mut index = 0;
    dropped(triangles, |_| {
        index += 1;
        copies.next_if_eq(&(index - 1)).is_none()
    })
}

/// What became of the triangles, in words.
fn why_empty(summary: &BuildSummary) -> String {
    if summary.read_faces == 0 {
        return "the file holds no face at all".to_string();
    }
    let reasons = [
        (
            summary.out_of_range_faces,
            "name a vertex that does not exist",
        ),
        (
            summary.not_finite_faces,
            "have a corner that is not a finite number",
        ),
        (summary.zero_area_faces, "have no area"),
    ];
    let parts: Vec<String> = reasons
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| format!("{count} {what}"))
        .collect();
    format!("of {} in the file {}", summary.read_faces, parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_face_does_not_tell_where_a_model_lies() {
        let far = [4e5, 5.6e6, 100.0];
        let corner = |x: f64, y: f64| [far[0] + x, far[1] + y, far[2]];
        let mut positions = vec![corner(0.0, 0.0), corner(200.0, 0.0), corner(0.0, 200.0)];
        positions.extend([[0.0; 3], [1e39, 0.0, 0.0], [f64::NAN; 3]]);
        positions.extend([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        let face = [0, 1, 2];
        let middle = DVec3::from_array(corner(100.0, 100.0));
        assert_eq!(choose_origin(&positions, &[face]), middle);
        for other in [[3, 3, 3], [0, 3, 0], [0, 4, 1], [0, 5, 1], [3, 6, 7]] {
            assert_eq!(
                choose_origin(&positions, &[other, face]),
                middle,
                "{other:?}"
            );
        }
        let [near, whole] = [[3, 1, 2], [0, 1, 3]].map(|other| choose_origin(&positions, &[other]));
        assert_eq!(
            [near, whole],
            [DVec3::ZERO; 2],
            "about as large as it is far"
        );
        assert_eq!(choose_origin(&positions, &[]), DVec3::ZERO);
    }
}
