//! Sides of faces, grouped by the edges that they run along.

use spm::NONE;

/// A side of a face: face times three plus the corner that it starts from.
pub type Side = u32;

/// The side of the same face that starts where this one ends.
pub fn next_side(side: Side) -> Side {
    if side % 3 == 2 { side - 2 } else { side + 1 }
}

/// Sides grouped by the undirected edge that they run along: those of one edge lie together,
/// ascending, and all edges of one lower vertex. Memory: 4 B a side and 4 B a vertex.
pub struct Edges<'a> {
    corner_vertex: &'a [u32],
    sides: Vec<Side>,
}

impl<'a> Edges<'a> {
    /// The sides of faces whose corners have these vertices.
    pub fn new(corner_vertex: &'a [u32], sides: impl Iterator<Item = Side> + Clone) -> Self {
        let lower = |side: Side| {
            let ends = edge(corner_vertex, side);
            ends.0 as usize
        };
        let vertices = corner_vertex.iter().max().map_or(0, |&v| v as usize + 1);
        // Where the sides of each vertex start, moved on as they are put there.
        let mut place = vec![0u32; vertices + 1];
        for side in sides.clone() {
            place[lower(side) + 1] += 1;
        }
        for vertex in 0..vertices {
            place[vertex + 1] += place[vertex];
        }
        let mut sorted = vec![0; place[vertices] as usize];
        for side in sides {
            let at = &mut place[lower(side)];
            sorted[*at as usize] = side;
            *at += 1;
        }
        // Now each place is where the sides of the vertex end.
        let mut start = 0;
        for &end in &place[..vertices] {
            sorted[start as usize..end as usize]
                .sort_unstable_by_key(|&side| (edge(corner_vertex, side), side));
            start = end;
        }
        Self {
            corner_vertex,
            sides: sorted,
        }
    }

    /// The sides of each edge.
    pub fn groups(&self) -> impl Iterator<Item = &[Side]> {
        self.sides
            .chunk_by(|&x, &y| edge(self.corner_vertex, x) == edge(self.corner_vertex, y))
    }
}

/// The undirected edge of a side.
pub fn edge(corner_vertex: &[u32], side: Side) -> (u32, u32) {
    let a = corner_vertex[side as usize];
    let b = corner_vertex[next_side(side) as usize];
    (a.min(b), a.max(b))
}

/// The two sides of a group when they are exactly two and run in opposite directions.
pub fn manifold_pair(group: &[Side], corner_vertex: &[u32]) -> Option<(Side, Side)> {
    let &[first, second] = group else {
        return None;
    };
    let start = |side: Side| corner_vertex[side as usize];
    (start(first) != start(second)).then_some((first, second))
}

/// For every face those across the edges opposite its corners, [`NONE`] at a boundary; `None` when
/// an edge has more than two faces, or two that turn against each other. Memory: beside the result
/// that of [`Edges`].
pub fn neighbours(triangles: &[[u32; 3]]) -> Option<Vec<[u32; 3]>> {
    let corner_vertex = triangles.as_flattened();
    let mut neighbours = vec![[NONE; 3]; triangles.len()];
    for group in Edges::new(corner_vertex, 0..corner_vertex.len() as u32).groups() {
        if group.len() == 1 {
            continue;
        }
        let (first, second) = manifold_pair(group, corner_vertex)?;
        for (side, other) in [(first, second), (second, first)] {
            let opposite = next_side(next_side(side));
            neighbours[side as usize / 3][opposite as usize % 3] = other / 3;
        }
    }
    Some(neighbours)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_lie_across_the_edge_opposite_a_corner() {
        // Two faces at the edge of 1 and 2, and one beside the second.
        let mut faces = vec![[0, 1, 2], [3, 2, 1], [3, 4, 2]];
        let expected = [[1, NONE, NONE], [0, NONE, 2], [NONE, 1, NONE]];
        assert_eq!(neighbours(&faces), Some(expected.to_vec()));
        for third in [[1, 2, 5], [2, 1, 5]] {
            faces.push(third);
            assert_eq!(neighbours(&faces), None, "three faces at an edge");
            faces.pop();
        }
        assert_eq!(
            neighbours(&[[0, 1, 2], [0, 1, 3]]),
            None,
            "against each other"
        );
        assert_eq!(neighbours(&[]), Some(Vec::new()));
    }
}
