//! Stitching and cutting: a 2-manifold of the same geometry.
//!
//! Two corners become one vertex when their faces meet in an edge that exactly these two faces have, in
//! opposite directions: first by vertex number, then, for rims left over, by position (seams of vertices
//! that a file stores twice). Everything else is cut: at a bow-tie, at an edge of three faces, the fans
//! get vertices of their own. Copies of a cut vertex are locked, so that no coarser mesh opens a crack there.

use super::CleanMesh;
use shared::spm::BuildSummary;

/// A mesh in which every edge has one or two faces, two in opposite directions, and every vertex one fan.
#[derive(Debug, Clone, PartialEq)]
pub struct ManifoldMesh {
    /// Positions, model units less the origin; every vertex is used.
    pub positions: Vec<[f32; 3]>,
    /// Corners, counterclockwise.
    pub triangles: Vec<[u32; 3]>,
    /// For every vertex whether it must stay where it is on every front.
    pub locked: Vec<bool>,
    /// The summary of the cleaning, with what was done here.
    pub summary: BuildSummary,
}

/// A side of a face: face times three plus the corner that it starts from.
type Side = u32;

fn next_side(side: Side) -> Side {
    if side % 3 == 2 { side - 2 } else { side + 1 }
}

/// Sides grouped by the undirected edge that they run along: `(edge, side)`, sorted.
struct Edges(Vec<(u64, Side)>);

impl Edges {
    fn new(corner_vertex: &[u32], sides: impl Iterator<Item = Side>) -> Self {
        let mut all: Vec<(u64, Side)> = sides
            .map(|side| {
                let a = corner_vertex[side as usize];
                let b = corner_vertex[next_side(side) as usize];
                (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), side)
            })
            .collect();
        all.sort_unstable();
        Self(all)
    }

    fn groups(&self) -> impl Iterator<Item = &[(u64, Side)]> {
        self.0.chunk_by(|x, y| x.0 == y.0)
    }
}

/// The two sides of a group when they are exactly two and run in opposite directions.
fn manifold_pair(group: &[(u64, Side)], corner_vertex: &[u32]) -> Option<(Side, Side)> {
    let &[(_, first), (_, second)] = group else {
        return None;
    };
    let start = |side: Side| corner_vertex[side as usize];
    (start(first) != start(second)).then_some((first, second))
}

/// Root of a corner's class, halving paths.
fn root(parent: &mut [u32], mut corner: u32) -> u32 {
    while parent[corner as usize] != corner {
        let above = parent[parent[corner as usize] as usize];
        parent[corner as usize] = above;
        corner = above;
    }
    corner
}

/// Classes of corners joined across the pairs, `alone` corners kept out: for every corner its class,
/// numbered in order of first use, and how many there are.
fn classes(pairs: &[(Side, Side)], alone: &[bool]) -> (Vec<u32>, u32) {
    let corners = alone.len();
    let mut parent: Vec<u32> = (0..corners as u32).collect();
    let mut join = |a: u32, b: u32| {
        if !alone[a as usize] && !alone[b as usize] {
            let (a, b) = (root(&mut parent, a), root(&mut parent, b));
            // The lower one is the root, so that the result does not depend on the order of pairs.
            parent[a.max(b) as usize] = a.min(b);
        }
    };
    for &(first, second) in pairs {
        join(first, next_side(second));
        join(next_side(first), second);
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

/// Stitches and cuts; geometry and faces stay what they are.
#[must_use]
pub fn cut_to_manifold(mesh: &CleanMesh) -> ManifoldMesh {
    let by_number: &[u32] = mesh.triangles.as_flattened();
    let sides = by_number.len() as u32;
    let mut pairs = Vec::with_capacity(by_number.len() / 2);
    let mut rim = Vec::new();
    for group in Edges::new(by_number, 0..sides).groups() {
        match manifold_pair(group, by_number) {
            Some(pair) => pairs.push(pair),
            None if group.len() == 1 => rim.push(group[0].1),
            None => {}
        }
    }
    let by_position: Vec<u32> = by_number
        .iter()
        .map(|&v| mesh.same_position[v as usize])
        .collect();
    let seams = Edges::new(&by_position, rim.into_iter());
    pairs.extend(
        seams
            .groups()
            .filter_map(|g| manifold_pair(g, &by_position)),
    );

    // Fans may still meet: an edge cut between two fans that close again round both of its ends. Then
    // a corner of each of its faces is set apart, until every edge is manifold.
    let mut alone = vec![false; by_number.len()];
    let (class, vertices, rims) = loop {
        let (class, vertices) = classes(&pairs, &alone);
        let edges = Edges::new(&class, 0..sides);
        let mut again = false;
        let mut rims = Vec::new();
        for group in edges.groups() {
            if group.len() == 1 {
                rims.push(group[0].1);
            } else if manifold_pair(group, &class).is_none() {
                let (edge, _) = group[0];
                for &(_, side) in group {
                    let at_lower = u64::from(class[side as usize]) == edge >> 32;
                    let corner = if at_lower { side } else { next_side(side) };
                    alone[corner as usize] = true;
                }
                again = true;
            }
        }
        if !again {
            break (class, vertices, rims);
        }
    };
    finish(mesh, &class, vertices, &rims)
}

/// The mesh over the classes, and which of them are locked.
fn finish(mesh: &CleanMesh, class: &[u32], vertices: u32, rims: &[Side]) -> ManifoldMesh {
    let by_number: &[u32] = mesh.triangles.as_flattened();
    let mut number_and_class: Vec<(u32, u32)> = by_number
        .iter()
        .zip(class)
        .map(|(&number, &class)| (number, class))
        .collect();
    number_and_class.sort_unstable();
    number_and_class.dedup();

    let mut positions = vec![[0.0; 3]; vertices as usize];
    for &(number, class) in &number_and_class {
        positions[class as usize] = mesh.positions[number as usize];
    }
    let mut locked = vec![false; vertices as usize];
    let mut numbers = 0;
    for copies in number_and_class.chunk_by(|a, b| a.0 == b.0) {
        numbers += 1;
        for &(_, class) in copies {
            locked[class as usize] |= copies.len() > 1;
        }
    }
    lock_touching_rims(mesh, class, rims, &mut locked);

    let pairs = number_and_class.len() as u64;
    let summary = BuildSummary {
        vertices: vertices.into(),
        stitched_vertices: pairs - u64::from(vertices),
        cut_vertices: pairs - numbers,
        locked_vertices: locked.iter().filter(|&&l| l).count() as u64,
        ..mesh.summary
    };
    ManifoldMesh {
        positions,
        triangles: class.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        locked,
        summary,
    }
}

/// Locks every rim vertex whose position another vertex of a rim has too: a seam that could not be stitched.
fn lock_touching_rims(mesh: &CleanMesh, class: &[u32], rims: &[Side], locked: &mut [bool]) {
    let mut position_and_class: Vec<(u32, u32)> = rims
        .iter()
        .flat_map(|&side| [side, next_side(side)])
        .map(|corner| {
            let number = mesh.triangles.as_flattened()[corner as usize];
            (mesh.same_position[number as usize], class[corner as usize])
        })
        .collect();
    position_and_class.sort_unstable();
    position_and_class.dedup();
    for copies in position_and_class.chunk_by(|a, b| a.0 == b.0) {
        for &(_, class) in copies {
            locked[class as usize] |= copies.len() > 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SoupMesh, clean};
    use super::*;
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

    proptest! {
        #[test]
        fn any_soup_becomes_a_manifold_of_the_same_geometry(
            faces in prop::collection::vec(prop::array::uniform3(0u32..9), 1..60),
        ) {
            let positions: Vec<[f64; 3]> = (0..9)
                .map(|k| [f64::from(k), f64::from(k * k), f64::from(k * k * k % 7)])
                .collect();
            if let Ok(cleaned) = clean(SoupMesh { positions, triangles: faces }) {
                let mesh = cut_to_manifold(&cleaned);
                assert_manifold(&mesh);
                let before = cleaned.triangles.iter().map(|t| t.map(|v| cleaned.positions[v as usize]));
                let after = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize]));
                prop_assert!(before.eq(after));
                let copies = mesh.positions.iter().zip(&mesh.locked).filter(|(p, _)| {
                    mesh.positions.iter().filter(|q| q == p).count() > 1
                });
                for (_, &locked) in copies {
                    prop_assert!(locked);
                }
            }
        }
    }
}
