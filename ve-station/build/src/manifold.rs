//! Stitching and cutting: a 2-manifold of the same geometry.
//!
//! Two corners become one vertex when their faces meet in an edge that exactly these two faces
//! have, in opposite directions: first by vertex number, then, for boundaries left over, by
//! position (seams of vertices that a file stores twice). Where more than two faces meet in an
//! edge, by number or by position, those of opposite directions that go on most nearly straight are
//! taken for one surface, as of two sheets that cross, or of the two sides of one. Everything else
//! is cut: at a bow-tie, at an edge of three faces, the fans get vertices of their own. Copies of a
//! cut vertex are locked, so that no coarser mesh opens a crack there, unless there are thousands
//! (see `locks`). Those that are not locked collapse like others, and the widest crack is reported
//! (see `cracks`).

use crate::classes::{join, root};
use crate::clean::CleanMesh;
use crate::edges::{Edges, Side, edge, manifold_pair, next_side};
use crate::locks;
use crate::tuning::input::MAX_MATCHED;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use spm::BuildSummary;

/// A mesh in which every edge has one or two faces, two in opposite directions, and every vertex
/// one fan.
#[derive(Debug, Clone, PartialEq)]
pub struct ManifoldMesh {
    /// Positions, model units less the origin; every vertex is used.
    pub positions: Vec<[f32; 3]>,
    /// Corners, counterclockwise.
    pub triangles: Vec<[u32; 3]>,
    /// For every vertex whether it is one of several copies of a cut vertex, of boundaries that
    /// touch, or of surfaces that meet in an edge.
    pub copies: Vec<bool>,
    /// For every vertex whether it must stay where it is on every front.
    pub locked: Vec<bool>,
    /// The summary of the cleaning, with what was done here.
    pub summary: BuildSummary,
}

impl ManifoldMesh {
    /// Corners of a triangle, model units.
    pub(crate) fn corners(&self, triangle: &[u32; 3]) -> [DVec3; 3] {
        triangle.map(|v| Vec3::from_array(self.positions[v as usize]).as_dvec3())
    }
}

/// The pairs of sides in which surfaces go on across an edge of more than two faces: best first,
/// the straightest. Faces with the same third corner are two sides of a sheet, not neighbours.
fn straightest_pairs(
    group: &[Side],
    corner_vertex: &[u32],
    corner_position: impl Fn(Side) -> DVec3,
) -> Vec<(Side, Side)> {
    if group.len() < 3 || group.len() > MAX_MATCHED {
        return Vec::new();
    }
    // Across the edge, into the face, as a unit vector.
    let inwards = |side: Side| {
        let (start, end) = (corner_position(side), corner_position(next_side(side)));
        let to_third = corner_position(next_side(next_side(side))) - start;
        to_third.reject_from(end - start).normalize_or_zero()
    };
    let third = |side: Side| corner_vertex[next_side(next_side(side)) as usize];
    let is_up = |side: Side| corner_vertex[side as usize] < corner_vertex[next_side(side) as usize];
    let mut candidates = Vec::new();
    for &up in group.iter().filter(|&&side| is_up(side)) {
        for &down in group.iter().filter(|&&side| !is_up(side)) {
            if third(up) != third(down) {
                candidates.push((inwards(up).dot(inwards(down)), up, down));
            }
        }
    }
    candidates.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut pairs: Vec<(Side, Side)> = Vec::new();
    for (_, up, down) in candidates {
        if pairs.iter().all(|&(a, b)| a != up && b != down) {
            pairs.push((up, down));
        }
    }
    pairs
}

/// Classes of corners joined across the pairs, `alone` corners kept out: for every corner its
/// class, numbered in order of first use, and how many there are. A pair with such a corner is an
/// edge no longer, so its other end is not joined across it either: the vertex there would have two
/// fans.
fn classes(pairs: &[(Side, Side)], alone: &[bool]) -> (Vec<u32>, u32) {
    let corners = alone.len();
    let mut parent: Vec<u32> = (0..corners as u32).collect();
    for &(first, second) in pairs {
        let corners = [first, next_side(first), second, next_side(second)];
        if !corners.iter().any(|&corner| alone[corner as usize]) {
            join(&mut parent, first, next_side(second));
            join(&mut parent, next_side(first), second);
        }
    }
    let mut class = vec![0; corners];
    let mut count = 0;
    for corner in 0..corners as u32 {
        let top = root(&mut parent, corner);
        class[corner as usize] = if top == corner {
            count += 1;
            count - 1
        } else {
            class[top as usize]
        };
    }
    (class, count)
}

/// Joins boundaries by position. Gives the sides at edges where several surfaces meet: the vertices
/// there are copies of one, whether a surface ends there or goes on.
fn join_seams(
    by_position: &[u32],
    boundary: &[Side],
    corner_position: impl Fn(Side) -> DVec3,
    pairs: &mut Vec<(Side, Side)>,
) -> Vec<Side> {
    let mut crossings = Vec::new();
    for group in Edges::new(by_position, boundary.iter().copied()).groups() {
        if let Some(pair) = manifold_pair(group, by_position) {
            pairs.push(pair);
            continue;
        }
        let straight = straightest_pairs(group, by_position, &corner_position);
        if !straight.is_empty() {
            crossings.extend_from_slice(group);
        }
        pairs.extend(straight);
    }
    crossings
}

/// Stitches and cuts; geometry and faces stay what they are.
#[must_use]
pub fn cut_to_manifold(mesh: &CleanMesh) -> ManifoldMesh {
    let by_number: &[u32] = mesh.triangles.as_flattened();
    let sides = by_number.len() as u32;
    let mut pairs = Vec::with_capacity(by_number.len() / 2);
    let mut boundary = Vec::new();
    let at = |corner: Side| {
        let number = by_number[corner as usize];
        Vec3::from_array(mesh.positions[number as usize]).as_dvec3()
    };
    for group in Edges::new(by_number, 0..sides).groups() {
        match manifold_pair(group, by_number) {
            Some(pair) => pairs.push(pair),
            None if group.len() == 1 => boundary.push(group[0]),
            None => pairs.extend(straightest_pairs(group, by_number, at)),
        }
    }
    let by_position: Vec<u32> = by_number
        .iter()
        .map(|&v| mesh.same_position[v as usize])
        .collect();
    let crossings = join_seams(&by_position, &boundary, at, &mut pairs);
    drop((by_position, boundary));

    // Fans may still meet: an edge cut between two fans that close again round both of its ends.
    // Then a corner of each of its faces is set apart, until every edge is manifold.
    let mut alone = vec![false; by_number.len()];
    let (class, vertices, mut boundaries) = loop {
        let (class, vertices) = classes(&pairs, &alone);
        let edges = Edges::new(&class, 0..sides);
        let mut again = false;
        let mut boundaries = Vec::new();
        for group in edges.groups() {
            if group.len() == 1 {
                boundaries.push(group[0]);
            } else if manifold_pair(group, &class).is_none() {
                let (lower, _) = edge(&class, group[0]);
                for &side in group {
                    let at_lower = class[side as usize] == lower;
                    let corner = if at_lower { side } else { next_side(side) };
                    alone[corner as usize] = true;
                }
                again = true;
            }
        }
        if !again {
            break (class, vertices, boundaries);
        }
    };
    drop((pairs, alone));
    boundaries.extend(crossings);
    finish(mesh, class, vertices, &boundaries)
}

/// The mesh over the classes, and which of them are copies; where surfaces may touch is known from
/// sides.
fn finish(mesh: &CleanMesh, class: Vec<u32>, vertices: u32, touching: &[Side]) -> ManifoldMesh {
    let by_number: &[u32] = mesh.triangles.as_flattened();
    let number_and_class = numbers_of_classes(by_number, &class, vertices);
    let mut positions = vec![[0.0; 3]; vertices as usize];
    for &(number, class) in &number_and_class {
        positions[class as usize] = mesh.positions[number as usize];
    }
    let mut copies = vec![false; vertices as usize];
    let mut numbers = 0;
    for same in number_and_class.chunk_by(|a, b| a.0 == b.0) {
        numbers += 1;
        for &(_, class) in same {
            copies[class as usize] |= same.len() > 1;
        }
    }
    mark_touching(mesh, &class, touching, &mut copies);

    let pairs = number_and_class.len() as u64;
    let locked = locks::of_copies(&copies, &positions);
    let summary = BuildSummary {
        vertices: vertices.into(),
        stitched_vertices: pairs - u64::from(vertices),
        cut_vertices: pairs - numbers,
        locked_vertices: locked.iter().filter(|&&l| l).count() as u64,
        ..mesh.summary
    };
    ManifoldMesh {
        positions,
        triangles: class.as_chunks::<3>().0.to_vec(),
        copies,
        locked,
        summary,
    }
}

/// Every pair of a vertex number of the file and a class that has a corner of it, once, sorted.
/// Hardly a class has corners of two numbers, so those are set apart.
fn numbers_of_classes(by_number: &[u32], class: &[u32], vertices: u32) -> Vec<(u32, u32)> {
    let mut first = vec![u32::MAX; vertices as usize];
    let mut others = Vec::new();
    for (&number, &class) in by_number.iter().zip(class) {
        let first = &mut first[class as usize];
        if *first == u32::MAX {
            *first = number;
        } else if *first != number {
            others.push((number, class));
        }
    }
    others.sort_unstable();
    others.dedup();
    let mut all: Vec<(u32, u32)> = first.into_iter().zip(0..).chain(others).collect();
    all.par_sort_unstable();
    all
}

/// Marks every vertex of these sides whose position another vertex of them has too: a seam that
/// could not be stitched, or surfaces that meet.
fn mark_touching(mesh: &CleanMesh, class: &[u32], touching: &[Side], copies: &mut [bool]) {
    let mut position_and_class: Vec<(u32, u32)> = touching
        .iter()
        .flat_map(|&side| [side, next_side(side)])
        .map(|corner| {
            let number = mesh.triangles.as_flattened()[corner as usize];
            (mesh.same_position[number as usize], class[corner as usize])
        })
        .collect();
    position_and_class.sort_unstable();
    position_and_class.dedup();
    for same in position_and_class.chunk_by(|a, b| a.0 == b.0) {
        for &(_, class) in same {
            copies[class as usize] |= same.len() > 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::clean;
    use crate::mesh::SoupMesh;
    use proptest::prelude::*;

    fn cut(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> ManifoldMesh {
        cut_to_manifold(
            &clean(SoupMesh {
                positions,
                triangles,
            })
            .unwrap(),
        )
    }

    /// The same faces with vertices of their own, as with flat shading.
    fn apart(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let corners = faces.as_flattened().iter();
        let own = corners.map(|&v| positions[v as usize]).collect();
        let numbers = (0..faces.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]);
        (own, numbers.collect())
    }

    /// Every edge one face, or two in opposite directions; every vertex one fan.
    fn assert_manifold(mesh: &ManifoldMesh) {
        let corners: &[u32] = mesh.triangles.as_flattened();
        let edges = Edges::new(corners, 0..corners.len() as u32);
        let mut pairs = Vec::new();
        for group in edges.groups() {
            let pair = manifold_pair(group, corners);
            assert!(group.len() == 1 || pair.is_some(), "{group:?}");
            pairs.extend(pair);
        }
        let (class, count) = classes(&pairs, &vec![false; corners.len()]);
        assert_eq!(
            count as usize,
            mesh.positions.len(),
            "a vertex with two fans"
        );
        for (a, &x) in class.iter().enumerate() {
            assert_eq!(
                corners[a],
                corners[class.iter().position(|&y| y == x).unwrap()]
            );
        }
    }

    /// Whether faces that lie at one edge have its ends in common, or copies of them.
    fn ends_are_shared_or_copies(cleaned: &CleanMesh, mesh: &ManifoldMesh) -> bool {
        let numbers = cleaned.triangles.as_flattened().iter();
        let place: Vec<u32> = numbers
            .map(|&v| cleaned.same_position[v as usize])
            .collect();
        let vertices: &[u32] = mesh.triangles.as_flattened();
        let edges = Edges::new(&place, 0..place.len() as u32);
        edges.groups().all(|group| {
            let ends = group.iter().flat_map(|&side| [side, next_side(side)]);
            let mut ends: Vec<(u32, u32)> = ends
                .map(|corner| (place[corner as usize], vertices[corner as usize]))
                .collect();
            ends.sort_unstable();
            ends.dedup();
            ends.chunk_by(|a, b| a.0 == b.0)
                .all(|same| same.len() == 1 || same.iter().all(|&(_, v)| mesh.copies[v as usize]))
        })
    }

    #[test]
    fn a_bow_tie_becomes_two_locked_vertices() {
        let mesh = cut(
            vec![
                [0.0; 3],
                [1.0, 0.0, 0.0],
                [1.0, 1.0, 0.0],
                [-1.0, 0.0, 0.0],
                [-1.0, -1.0, 0.0],
            ],
            vec![[0, 1, 2], [0, 3, 4]],
        );
        assert_manifold(&mesh);
        assert_eq!(mesh.positions.len(), 6);
        assert_eq!(mesh.summary.cut_vertices, 1);
        assert_eq!(mesh.summary.locked_vertices, 2);
    }

    #[test]
    fn vertices_stored_twice_along_a_seam_are_stitched() {
        let mesh = cut(
            vec![
                [0.0; 3],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [1.0, 0.0, 0.0],
                [1.0, 1.0, 0.0],
                [-0.0, 1.0, 0.0],
            ],
            vec![[0, 1, 2], [3, 4, 5]],
        );
        assert_manifold(&mesh);
        assert_eq!(mesh.positions.len(), 4);
        assert_eq!(mesh.summary.stitched_vertices, 2);
        assert_eq!(mesh.summary.locked_vertices, 0);
    }

    #[test]
    fn a_moebius_band_is_cut_until_it_has_two_sides() {
        let vertices: Vec<[f64; 3]> = (0..10)
            .map(|k| {
                let (turn, side) = (f64::from(k / 2) * 1.2566, f64::from(k % 2) - 0.5);
                let radius = 2.0 + side * (turn / 2.0).cos();
                [
                    radius * turn.cos(),
                    radius * turn.sin(),
                    side * (turn / 2.0).sin(),
                ]
            })
            .collect();
        let mut faces = Vec::new();
        for k in 0..5u32 {
            let (a, b) = (2 * k, 2 * k + 1);
            let (c, d) = if k == 4 {
                (1, 0)
            } else {
                (2 * k + 2, 2 * k + 3)
            };
            faces.extend([[a, c, b], [b, c, d]]);
        }
        let mesh = cut(vertices, faces);
        assert_manifold(&mesh);
        assert_eq!(mesh.triangles.len(), 10);
    }

    #[test]
    fn sheets_that_cross_and_two_sides_of_a_sheet_stay_whole() {
        // Four quarter planes round an edge along z, oriented as two planes.
        let mesh = cut(
            vec![
                [0.0; 3],
                [0.0, 0.0, 1.0],
                [1.0, 0.0, 0.0],
                [-1.0, 0.1, 0.0],
                [0.0, 1.0, 0.0],
                [0.1, -1.0, 0.0],
            ],
            vec![[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]],
        );
        assert_manifold(&mesh);
        assert_eq!(mesh.positions.len(), 8);
        assert_eq!(mesh.summary.cut_vertices, 2);
        // Both sides of a fan of six: a pillow.
        let boundary = (0..6).map(|k| f64::from(k) * 1.047);
        let mut positions = vec![[0.0; 3]];
        positions.extend(boundary.map(|angle| [angle.cos(), angle.sin(), 0.0]));
        let front: Vec<[u32; 3]> = (0..6).map(|k| [0, 1 + k, 1 + (k + 1) % 6]).collect();
        let back = front.iter().map(|t| [t[0], t[2], t[1]]);
        let mesh = cut(positions, front.iter().copied().chain(back).collect());
        assert_manifold(&mesh);
        assert_eq!(mesh.positions.len(), 8);
        assert_eq!(mesh.summary.cut_vertices, 1);
    }

    /// At the corners of the sheet two faces share two edges, and all four round the diagonal both
    /// its ends.
    #[test]
    fn a_sheet_with_two_sides_is_cut_at_its_corners_only() {
        let at = |i: u32, j: u32| 10 * j + i;
        let mut positions = Vec::new();
        let mut faces = Vec::new();
        for j in 0..10 {
            for i in 0..10 {
                positions.push([f64::from(i), f64::from(j), 0.0]);
                if i < 9 && j < 9 {
                    let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                    faces.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        let back: Vec<[u32; 3]> = faces.iter().map(|t| [t[0], t[2], t[1]]).collect();
        faces.extend(back);
        let (own, numbers) = apart(&positions, &faces);
        let mesh = cut(positions, faces);
        assert_manifold(&mesh);
        // An inner vertex has a copy for each side; a pillow of 162 faces a side has few more.
        assert!(
            mesh.positions.len() < 100 + 64 + 40,
            "{}",
            mesh.positions.len()
        );
        // Faces with vertices of their own are joined to the very same surface.
        let joined = cut(own, numbers);
        assert_manifold(&joined);
        assert_eq!(joined.positions.len(), mesh.positions.len());
        assert_eq!(joined.triangles, mesh.triangles);
        assert_eq!(joined.copies, mesh.copies);
    }

    #[test]
    fn of_three_faces_with_their_own_vertices_at_an_edge_two_are_joined_and_all_ends_locked() {
        let positions = [
            [0.0; 3],
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 0.0],
            [-1.0, 0.1, 0.0],
            [0.0, 1.0, 0.0],
        ];
        let (own, numbers) = apart(&positions, &[[0, 1, 2], [1, 0, 3], [0, 1, 4]]);
        let mesh = cut(own, numbers);
        assert_manifold(&mesh);
        assert_eq!(mesh.positions.len(), 7);
        assert_eq!(mesh.summary.stitched_vertices, 2);
        assert_eq!(mesh.summary.locked_vertices, 4);
    }

    proptest! {
        #[test]
        fn any_soup_becomes_a_manifold_of_the_same_geometry(
            faces in prop::collection::vec(prop::array::uniform3(0u32..9), 1..60),
            own: bool,
        ) {
            let positions: Vec<[f64; 3]> = (0..9)
                .map(|k| [f64::from(k), f64::from(k * k), f64::from(k * k * k % 7)])
                .collect();
            let (positions, triangles) =
                if own { apart(&positions, &faces) } else { (positions, faces) };
            if let Ok(cleaned) = clean(SoupMesh { positions, triangles }) {
                let mesh = cut_to_manifold(&cleaned);
                assert_manifold(&mesh);
                let position = |v: u32| cleaned.positions[v as usize];
                let before = cleaned.triangles.iter().map(|t| t.map(position));
                let after = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]));
                prop_assert!(before.eq(after));
                let copies = mesh.positions.iter().zip(&mesh.copies).filter(|(p, _)| {
                    mesh.positions.iter().filter(|q| q == p).count() > 1
                });
                // Closed surfaces with their own vertices may touch at one of these.
                for (_, &copy) in copies.filter(|_| !own) {
                    prop_assert!(copy);
                }
                prop_assert!(ends_are_shared_or_copies(&cleaned, &mesh));
                prop_assert_eq!(&mesh.copies, &mesh.locked);
            }
        }
    }
}
