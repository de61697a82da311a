//! Edges of a mesh where it is not one closed surface: cuts that the builder made, and boundaries.

use glam::DVec3;
use std::collections::BTreeMap;

/// An edge, and what it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seam {
    /// Its ends, as in the mesh.
    pub ends: [DVec3; 2],
    /// Whether the mesh has another edge at this place: the builder cut their faces apart, and on a
    /// coarse mesh a crack may open here. Else the surface ends.
    pub is_cut: bool,
}

/// Edges of one face only or with copies, and places where vertices were cut apart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Seams {
    /// The edges.
    pub edges: Vec<Seam>,
    /// Places of vertices that the mesh has several times.
    pub cut_vertices: Vec<DVec3>,
}

/// A place, as bits; 0 and -0 are one place.
type Place = [u64; 3];

fn place(point: DVec3) -> Place {
    (point + DVec3::ZERO).to_array().map(f64::to_bits)
}

impl Seams {
    /// The seams of a mesh of positions and of corners of faces.
    #[must_use]
    pub fn of(positions: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let mut copies: BTreeMap<Place, u32> = BTreeMap::new();
        for &position in positions {
            *copies.entry(place(position)).or_default() += 1;
        }
        let at = |vertex: u32| positions[vertex as usize];
        let is_copied = |vertex: u32| copies[&place(at(vertex))] > 1;
        let mut faces: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for &[a, b, c] in triangles {
            for [p, q] in [[a, b], [b, c], [c, a]] {
                *faces.entry([p.min(q), p.max(q)]).or_default() += 1;
            }
        }
        faces.retain(|edge, count| *count == 1 || edge.iter().all(|&end| is_copied(end)));
        let place_of = |edge: &[u32; 2]| {
            let mut places = edge.map(|end| place(at(end)));
            places.sort_unstable();
            places
        };
        let mut edges_at: BTreeMap<[Place; 2], u32> = BTreeMap::new();
        for edge in faces.keys() {
            *edges_at.entry(place_of(edge)).or_default() += 1;
        }
        let edges = faces.iter().filter_map(|(edge, count)| {
            let is_cut = edges_at[&place_of(edge)] > 1;
            let ends = edge.map(at);
            (is_cut || *count == 1).then_some(Seam { ends, is_cut })
        });
        let edges = edges.collect();
        let cut = copies.into_iter().filter(|(_, count)| *count > 1);
        let cut = cut.map(|(place, _)| DVec3::from_array(place.map(f64::from_bits)));
        Self {
            edges,
            cut_vertices: cut.collect(),
        }
    }

    /// Number of edges that were cut apart, every copy counted.
    #[must_use]
    pub fn cut_edges(&self) -> usize {
        self.edges.iter().filter(|seam| seam.is_cut).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cut_is_told_from_a_boundary() {
        // Three sheets meet at an edge; the builder keeps two of them together.
        let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z);
        let positions = [
            at(0.0, 0.0, 0.0),
            at(1.0, 0.0, 0.0),
            at(0.0, 1.0, 0.0),
            at(0.0, -1.0, 0.0),
            // Copies of the first two.
            at(0.0, 0.0, -0.0),
            at(1.0, 0.0, 0.0),
            at(0.0, 0.0, 1.0),
        ];
        let apart = [[0, 1, 2], [1, 0, 3], [4, 5, 6]];
        let seams = Seams::of(&positions, &apart);
        assert_eq!((seams.edges.len(), seams.cut_edges()), (6 + 2, 2));
        assert_eq!(seams.cut_vertices, [DVec3::ZERO, DVec3::X]);
        // One triangle alone has boundaries only.
        let seams = Seams::of(&positions[..3], &[[0, 1, 2]]);
        assert_eq!((seams.edges.len(), seams.cut_edges()), (3, 0));
        assert!(seams.cut_vertices.is_empty());
    }
}
