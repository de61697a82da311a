//! Faces beside a triangle without area take its vertices in, so that it can be dropped.
//!
//! A triangle whose corners lie on one line joins the long edge of one face to the two short edges
//! of others. Without it the middle corner would lie on an edge that does not end there: a
//! T-junction, where a coarser mesh opens a crack that nobody knows of. So that edge is split at
//! the corner, which leaves the surface what it is: the corner is exactly on it.
//!
//! Triangles without area that share an edge lie on one line. Each face on an edge of one of them
//! is split at all of their corners that lie inside that edge.

use crate::classes::{join, root};

/// An edge between two groups of vertices of one position, lower one first.
type Edge = (u32, u32);

/// What decides where a vertex lies.
#[derive(Clone, Copy)]
pub struct Places<'a> {
    /// Positions, finite for all vertices of triangles.
    pub positions: &'a [[f32; 3]],
    /// For every vertex the first one of the same position.
    pub same_position: &'a [u32],
}

impl Places<'_> {
    fn edge(&self, a: u32, b: u32) -> Edge {
        let [a, b] = [a, b].map(|v| self.same_position[v as usize]);
        (a.min(b), a.max(b))
    }

    fn edges(&self, [a, b, c]: [u32; 3]) -> [Edge; 3] {
        [self.edge(a, b), self.edge(b, c), self.edge(c, a)]
    }
}

/// Corners of flat triangles that share edges, in their order along the line.
struct Line {
    axis: usize,
    vertices: Vec<u32>,
}

/// The lines of all flat triangles.
struct Lines<'a> {
    places: Places<'a>,
    lines: Vec<Line>,
    /// Their edges, sorted, with the index of the line.
    edges: Vec<(Edge, usize)>,
}

impl<'a> Lines<'a> {
    fn new(flat: &[[u32; 3]], places: Places<'a>) -> Self {
        // One with two corners in one place is an edge: nothing lies inside.
        let flat: Vec<[u32; 3]> = flat
            .iter()
            .map(|t| t.map(|v| places.same_position[v as usize]))
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect();
        let mut sides: Vec<(Edge, u32)> = flat
            .iter()
            .zip(0..)
            .flat_map(|(&triangle, index)| places.edges(triangle).map(|edge| (edge, index)))
            .collect();
        sides.sort_unstable();
        let mut parent: Vec<u32> = (0..flat.len() as u32).collect();
        for same in sides.chunk_by(|a, b| a.0 == b.0) {
            for &(_, index) in same {
                join(&mut parent, same[0].1, index);
            }
        }
        let mut line_of = vec![usize::MAX; flat.len()];
        let mut lines: Vec<Line> = Vec::new();
        for (index, triangle) in flat.iter().enumerate() {
            let first = root(&mut parent, index as u32) as usize;
            if first == index {
                line_of[index] = lines.len();
                lines.push(Line::along(*triangle, places.positions));
            }
            line_of[index] = line_of[first];
            lines[line_of[first]].vertices.extend(triangle);
        }
        for line in &mut lines {
            line.sort(places.positions);
        }
        sides.dedup_by_key(|side| side.0);
        let edges = sides.into_iter();
        Self {
            places,
            lines,
            edges: edges
                .map(|(edge, of)| (edge, line_of[of as usize]))
                .collect(),
        }
    }

    /// The corners inside an edge of a flat triangle, along its line, and whether that leads from
    /// `b` to `a`.
    fn between(&self, a: u32, b: u32) -> (&[u32], bool) {
        let edge = self.places.edge(a, b);
        let Ok(at) = self.edges.binary_search_by_key(&edge, |of| of.0) else {
            return (&[], false);
        };
        let Line { axis, vertices } = &self.lines[self.edges[at].1];
        let along = |v: u32| self.places.positions[v as usize][*axis];
        let rank = |v: u32| vertices.partition_point(|&of| along(of) < along(v));
        let (first, last) = (rank(a), rank(b));
        if first < last {
            (&vertices[first + 1..last], false)
        } else {
            (&vertices[last + 1..first], true)
        }
    }

    /// Puts a face in as it is, or the faces that take its place, of which `room` more may be made.
    fn put(&self, face: [u32; 3], room: &mut usize, out: &mut Vec<[u32; 3]>) {
        let mut left = vec![face];
        while let Some(face) = left.pop() {
            let side = (0..3).find_map(|k| {
                let (inside, is_reversed) = self.between(face[k], face[(k + 1) % 3]);
                let is_used = !inside.is_empty() && inside.len() <= *room;
                // Copied only then: a line may have many faces, and each of them much of it inside.
                is_used.then(|| {
                    let mut inside = inside.to_vec();
                    if is_reversed {
                        inside.reverse();
                    }
                    (k, inside)
                })
            });
            let Some((k, inside)) = side else {
                out.push(face);
                continue;
            };
            *room -= inside.len();
            let [mut start, end, third] = [0, 1, 2].map(|of| face[(k + of) % 3]);
            for corner in inside.into_iter().chain([end]) {
                left.push([start, corner, third]);
                start = corner;
            }
        }
    }
}

impl Line {
    /// The line of a flat triangle, still without vertices.
    fn along(triangle: [u32; 3], positions: &[[f32; 3]]) -> Self {
        let extent = |axis: usize| {
            let [a, b, c] = triangle.map(|v| positions[v as usize][axis]);
            a.max(b).max(c) - a.min(b).min(c)
        };
        let longest = (0..3).max_by(|&a, &b| extent(a).total_cmp(&extent(b)));
        Self {
            axis: longest.unwrap_or(0),
            vertices: Vec::new(),
        }
    }

    fn sort(&mut self, positions: &[[f32; 3]]) {
        let along = |v: u32| positions[v as usize][self.axis];
        self.vertices
            .sort_unstable_by(|&a, &b| along(a).total_cmp(&along(b)).then(a.cmp(&b)));
        self.vertices.dedup();
    }
}

/// Splits the faces beside `flat` triangles at the corners of those.
///
/// At most one face is added for each that there is: only noise, whose edges have many faces each,
/// would need more.
pub fn close(triangles: Vec<[u32; 3]>, flat: &[[u32; 3]], places: Places<'_>) -> Vec<[u32; 3]> {
    let lines = Lines::new(flat, places);
    if lines.lines.is_empty() {
        return triangles;
    }
    let mut room = triangles.len();
    let mut out = Vec::with_capacity(triangles.len());
    for face in triangles {
        lines.put(face, &mut room, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use crate::clean::clean;
    use crate::generate::{Shape, generate};
    use crate::manifold::cut_to_manifold;
    use crate::mesh::SoupMesh;
    use proptest::prelude::*;

    /// A closed surface whose coordinates have some bits to spare, so that eighths of an edge are
    /// exact.
    fn closed() -> SoupMesh {
        let mut mesh = generate(Shape::Sphere, 120, 1);
        for position in &mut mesh.positions {
            *position = position.map(|x| (x * 256.0).round() / 256.0);
        }
        mesh
    }

    /// Faces without a neighbour at one of their edges, by the positions of its ends.
    fn open_edges(mesh: &SoupMesh) -> usize {
        let manifold = cut_to_manifold(&clean(mesh.clone()).unwrap());
        assert_eq!(manifold.summary.cut_vertices, 0);
        assert_eq!(manifold.summary.locked_vertices, 0);
        let mut edges: Vec<(u32, u32)> = manifold
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
            .map(|(a, b)| (a.min(b), a.max(b)))
            .collect();
        edges.sort_unstable();
        edges
            .chunk_by(|a, b| a == b)
            .filter(|e| e.len() != 2)
            .count()
    }

    /// Puts flat triangles between the two faces of an edge: a fan, or one after the other, in
    /// either direction.
    fn insert_flat(mesh: &mut SoupMesh, face: usize, eighths: &[u32], order: u32) {
        let [a, b, c] = mesh.triangles[face];
        let at = |v: u32| mesh.positions[v as usize];
        let (from, to) = (at(a), at(b));
        let first = mesh.positions.len() as u32;
        for &k in eighths {
            let share = f64::from(k) / 8.0;
            let inside = std::array::from_fn(|x| from[x] + share * (to[x] - from[x]));
            mesh.positions.push(inside);
        }
        let mut chain = vec![a];
        chain.extend(first..mesh.positions.len() as u32);
        chain.push(b);
        let pieces = chain.windows(2).map(|pair| [pair[0], pair[1], c]);
        let pieces: Vec<[u32; 3]> = pieces.collect();
        mesh.triangles[face] = pieces[0];
        mesh.triangles.extend(&pieces[1..]);
        // The polygon of the chain, cut into triangles: ears from either end.
        let mut turn = order;
        while chain.len() > 2 {
            let ear = (turn as usize % (chain.len() - 2)) + 1;
            turn = turn.wrapping_mul(5).wrapping_add(3);
            mesh.triangles
                .push([chain[ear - 1], chain[ear + 1], chain[ear]]);
            chain.remove(ear);
        }
    }

    proptest! {
        #[test]
        fn a_closed_surface_stays_closed_without_its_flat_triangles(
            wounds in prop::collection::vec(
                (any::<prop::sample::Index>(), 1u32..255, any::<u32>()),
                1..12,
            ),
        ) {
            let mut mesh = closed();
            prop_assert_eq!(open_edges(&mesh), 0);
            for (face, eighths, order) in wounds {
                // A face that is flat itself, or was split already, has no exact eighths.
                let face = face.index(60);
                let inside: Vec<u32> = (1..8).filter(|k| eighths >> k & 1 == 1).collect();
                if mesh.triangles[face].iter().all(|&v| v < 62) && !inside.is_empty() {
                    insert_flat(&mut mesh, face, &inside, order);
                }
            }
            let cleaned = clean(mesh.clone()).unwrap();
            let dropped = cleaned.summary.zero_area_faces;
            prop_assert_eq!(open_edges(&mesh), 0);
            // A face for each that was dropped: the surface has the vertices that it had.
            prop_assert_eq!(cleaned.triangles.len(), mesh.triangles.len());
            prop_assert!(dropped > 0 || mesh.triangles.len() == closed().triangles.len());
        }
    }

    #[test]
    fn two_flat_triangles_back_to_back_are_closed_too() {
        // A square of two triangles; on its diagonal one flat triangle each way.
        let at = |x: f64, y: f64| [x, y, 0.0];
        let mesh = SoupMesh {
            positions: vec![
                at(0.0, 0.0),
                at(4.0, 0.0),
                at(4.0, 4.0),
                at(0.0, 4.0),
                at(1.0, 1.0),
                at(3.0, 3.0),
            ],
            triangles: vec![
                [0, 1, 4],
                [4, 1, 2],
                [2, 3, 5],
                [5, 3, 0],
                [0, 4, 2],
                [2, 5, 0],
            ],
        };
        assert_eq!(open_edges(&mesh), 4);
        let cleaned = clean(mesh).unwrap();
        assert_eq!(cleaned.summary.zero_area_faces, 2);
        assert_eq!(cleaned.triangles.len(), 6);
    }

    #[test]
    fn noise_of_flat_triangles_does_not_fill_the_memory() {
        // A thousand flat triangles and a thousand faces on one edge: a million splits.
        let mut mesh = SoupMesh {
            positions: vec![[0.0; 3], [4096.0, 0.0, 0.0]],
            triangles: Vec::new(),
        };
        for k in 1..=1000 {
            let corner = mesh.positions.len() as u32;
            mesh.positions.push([f64::from(k), 0.0, 0.0]);
            mesh.positions.push([0.0, f64::from(k), 1.0]);
            mesh.triangles.extend([[0, 1, corner], [0, 1, corner + 1]]);
        }
        let cleaned = clean(mesh).unwrap();
        assert!(cleaned.triangles.len() <= 2000);
    }
}
