//! A face of the surface that has candidate pairs, and what of it may be a contact.

use super::super::shape::is_flat;
use glam::DVec3;
use spm::{ActiveMesh, Handle, NONE};

/// Largest number of faces around a corner that are examined.
pub const MAX_AROUND: usize = 128;

/// A face of the surface.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct SurfaceFace {
    pub face: Handle,
    pub vertices: [Handle; 3],
    pub corners: [DVec3; 3],
    /// Unit normal; zero without area.
    pub normal: DVec3,
    /// The neighbour's corner beyond the edge opposite each corner; at a boundary a corner of the
    /// edge.
    pub beyond: [DVec3; 3],
    /// The edges that this face owns.
    pub owns_edge: [bool; 3],
    /// Those of them that are not within a plane.
    pub asks_edge: [bool; 3],
    /// The corners that this face owns.
    pub owns: [bool; 3],
    /// Whether one of them is not within a plane, once that was asked.
    asks_corner: Option<bool>,
    /// The first of its pairs, and their number: mostly one after another.
    pub first_pair: u32,
    pub pairs: u32,
    /// Certified error when it was listed, model units.
    pub certified: f32,
}

/// Unit normal of a face; zero without area.
pub fn normal_of([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

impl SurfaceFace {
    pub fn of(mesh: &ActiveMesh, face: Handle) -> Self {
        let corners = mesh.corners(face);
        let links = mesh.face(face);
        let mut made = Self {
            face,
            vertices: links.corners,
            corners,
            normal: normal_of(corners),
            // Nothing equals it.
            beyond: [DVec3::NAN; 3],
            owns_edge: [true; 3],
            asks_edge: [true; 3],
            owns: [false; 3],
            asks_corner: None,
            first_pair: 0,
            pairs: 0,
            certified: mesh.certified_error(face),
        };
        made.look_around(mesh);
        made
    }

    /// Notes what is beyond its edges: neighbours may have changed where the face has not.
    pub fn look_around(&mut self, mesh: &ActiveMesh) {
        let (corners, links) = (self.corners, mesh.face(self.face));
        for k in 0..3 {
            let on_edge = [links.corners[(k + 1) % 3], links.corners[(k + 2) % 3]];
            let across = links.neighbours[k];
            let mut beyond = corners[(k + 1) % 3];
            let mut owns_edge = true;
            if across != NONE {
                let others = mesh.face(across).corners;
                if let Some(&vertex) = others.iter().find(|v| !on_edge.contains(v)) {
                    beyond = mesh.position(vertex).as_dvec3();
                }
                owns_edge = self.face < across;
            }
            if beyond != self.beyond[k] || owns_edge != self.owns_edge[k] {
                (self.beyond[k], self.owns_edge[k]) = (beyond, owns_edge);
                self.asks_edge[k] = owns_edge && (across == NONE || !is_flat(corners, beyond));
            }
        }
    }

    /// The same face where the list of faces has changed, and maybe the surface around it.
    pub fn relisted(self, owns: [bool; 3]) -> Self {
        Self {
            owns,
            asks_corner: None,
            pairs: 0,
            ..self
        }
    }

    /// Whether a corner that this face owns is not within a plane, and whether that was asked for
    /// the first time.
    pub fn asks_corner(&mut self, mesh: &ActiveMesh) -> (bool, bool) {
        if self.owns == [false; 3] {
            return (false, false);
        }
        if let Some(asks) = self.asks_corner {
            return (asks, false);
        }
        let asks = (0..3).any(|k| self.owns[k] && !self.is_within_plane(mesh, k));
        self.asks_corner = Some(asks);
        (asks, true)
    }

    /// Whether all faces around a corner are in one plane: then what touches it touches a boundary
    /// of the plane, too, or with a corner of its own.
    fn is_within_plane(&self, mesh: &ActiveMesh, corner: usize) -> bool {
        let vertex = self.vertices[corner];
        let (mut face, mut index) = (self.face, corner);
        for _ in 0..MAX_AROUND {
            let links = mesh.face(face);
            let next = links.neighbours[(index + 1) % 3];
            if next == NONE {
                return false;
            }
            let on_edge = [vertex, links.corners[(index + 2) % 3]];
            let others = mesh.face(next).corners;
            let beyond = others.iter().find(|v| !on_edge.contains(v));
            let there = others.iter().position(|&v| v == vertex);
            let (Some(&beyond), Some(there)) = (beyond, there) else {
                return false;
            };
            if !is_flat(mesh.corners(face), mesh.position(beyond).as_dvec3()) {
                return false;
            }
            if next == self.face {
                return true;
            }
            (face, index) = (next, there);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spm::Certified;

    const SIDES: u32 = 6;

    /// Faces around vertex 0, which is at a height, so many of them.
    fn fan(height: f32, faces: u32) -> ActiveMesh {
        let mut mesh = ActiveMesh::new(SIDES + 1, SIDES, 0);
        mesh.set_base_vertex(0, [0.25, 0.25, height], Certified::EXACT);
        let outer = [[2, 0], [1, 2], [-1, 2], [-2, 0], [-1, -2], [1, -2]];
        for (vertex, [x, y]) in (1..).zip(outer) {
            mesh.set_base_vertex(vertex, [x as f32, y as f32, 0.0], Certified::EXACT);
        }
        let around = |face: u32| {
            let is_there = faces == SIDES || face < faces;
            if is_there { face % SIDES } else { NONE }
        };
        for face in 0..faces {
            let corners = [0, 1 + face, 1 + (face + 1) % SIDES];
            let before = face.checked_sub(1).unwrap_or(around(SIDES - 1));
            let neighbours = [NONE, around(face + 1), before];
            mesh.set_base_face(face, corners, neighbours)
                .expect("all are there");
        }
        mesh
    }

    /// A corner amid a plane asks nothing; one that is above it, or at a boundary, does.
    #[test]
    fn only_a_corner_within_a_plane_asks_nothing() {
        for (height, faces, asks) in [(0.0, SIDES, false), (0.1, SIDES, true), (0.0, 4, true)] {
            let mesh = fan(height, faces);
            let mut face = SurfaceFace::of(&mesh, 1).relisted([true, false, false]);
            assert_eq!(face.asks_corner(&mesh), (asks, true), "{height} {faces}");
            assert_eq!(face.asks_corner(&mesh), (asks, false));
            let mut other = face.relisted([false; 3]);
            assert_eq!(other.asks_corner(&mesh), (false, false));
        }
    }
}
