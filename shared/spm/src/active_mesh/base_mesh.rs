//! The base mesh: its vertices and faces, as they arrive.

use super::{ActiveMesh, Certified, Face, Handle, NONE, Vertex, reach};
use glam::Vec3;

/// The neighbour links of the base faces that were set so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct BaseLinks {
    all: u32,
    /// Those that the neighbour has too.
    mutual: u32,
}

impl ActiveMesh {
    /// Sets a vertex of the base mesh; position in model units.
    pub fn set_base_vertex(&mut self, vertex: Handle, position: [f32; 3], certified: Certified) {
        assert!(vertex < self.base_vertices, "a base vertex out of range");
        reach(&mut self.vertices, vertex, Vertex::UNUSED);
        self.vertices[vertex as usize] = Vertex {
            position: Vec3::from_array(position),
            certified,
        };
    }

    /// Sets a face of the base mesh.
    ///
    /// # Errors
    /// `None` when a corner or neighbour is out of range; the mesh is unchanged then.
    pub fn set_base_face(
        &mut self,
        face: Handle,
        corners: [Handle; 3],
        neighbours: [Handle; 3],
    ) -> Option<()> {
        let [a, b, c] = corners;
        let in_range = face < self.base_faces
            && corners.iter().all(|&v| v < self.base_vertices)
            && neighbours
                .iter()
                .all(|&n| n == NONE || (n < self.base_faces && n != face))
            && a != b
            && b != c
            && c != a;
        if !in_range {
            return None;
        }
        reach(&mut self.faces, face, Face::UNUSED);
        let before = self.base_links_of(face);
        let place = &mut self.faces[face as usize];
        if *place == Face::UNUSED {
            self.active_faces += 1;
        }
        *place = Face {
            corners,
            neighbours,
        };
        let now = self.base_links_of(face);
        self.base_links.all = self.base_links.all - before.all + now.all;
        self.base_links.mutual = self.base_links.mutual - before.mutual + now.mutual;
        Some(())
    }

    /// The links of a base face, and those of its neighbours to it.
    fn base_links_of(&self, face: Handle) -> BaseLinks {
        let own = self.faces[face as usize];
        let mut links = BaseLinks::default();
        for k in 0..3 {
            let across = own.neighbours[k];
            if across == NONE {
                continue;
            }
            links.all += 1;
            // One that has not come yet has no links.
            let other = self.faces.get(across as usize);
            let other = other.unwrap_or(&Face::UNUSED);
            let is_mutual = (0..3).any(|j| {
                other.neighbours[j] == face
                    && other.corners[(j + 1) % 3] == own.corners[(k + 2) % 3]
                    && other.corners[(j + 2) % 3] == own.corners[(k + 1) % 3]
            });
            links.mutual += 2 * u32::from(is_mutual);
        }
        links
    }

    /// Whether the base mesh is complete and its neighbour links agree, before any operation.
    #[must_use]
    pub fn base_is_consistent(&self) -> bool {
        let BaseLinks { all, mutual } = self.base_links;
        self.active_faces == self.base_faces && mutual == all
    }
}
