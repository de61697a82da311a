//! Certified errors of active faces.

use super::super::certified::{Certified, rounded_up};
use super::{ActiveMesh, Handle, Vertex};
use geometry::closest_point_on_triangle;
use glam::DVec3;

impl ActiveMesh {
    /// The largest R of a face's corners, model units: its certified error in any front; 0 on faces
    /// of the full mesh.
    #[inline]
    #[must_use]
    pub fn face_radius(&self, face: Handle) -> f32 {
        let [a, b, c] = self.faces[face as usize].corners;
        self.radius(a).max(self.radius(b)).max(self.radius(c))
    }

    /// Certified error of a face, model units; 0 on faces of the full mesh. It is the largest R of
    /// its corners, or what the builder certifies of a face of a front {E > t}, if that is less and
    /// the face is one.
    #[must_use]
    pub fn certified_error(&self, face: Handle) -> f32 {
        let radius = self.face_radius(face);
        if radius == 0.0 {
            return 0.0;
        }
        let corners = self.faces[face as usize].corners;
        let close = if self.any_geomorphing(&[face]) {
            self.close_while_moving(corners)
        } else {
            Certified::close_of(corners.map(|v| self.vertices[v as usize].certified))
        };
        radius.min(close)
    }

    /// How far the point of a face that is nearest to this one is from the full mesh, at the most;
    /// model units. It is the certified error of the face, or what is certified of the quarter, if
    /// that is less and the face is as in the base mesh.
    #[must_use]
    pub fn certified_distance(&self, face: Handle, near: DVec3) -> f32 {
        let error = self.certified_error(face);
        let corners = self.faces[face as usize].corners;
        let is_of_base = face < self.base_faces && corners.iter().all(|&v| v < self.base_vertices);
        let quarters = self.quarters.get(face as usize).filter(|_| is_of_base);
        quarters.map_or(error, |quarters| {
            let weights = closest_point_on_triangle(self.corners(face), near).weights;
            error.min(quarters.at(weights))
        })
    }

    /// The certified error of a face with corners between two fronts {E > t}: that of the finer
    /// one, or of the coarser one, with the way from there.
    ///
    /// Where two corners go to the same parent, the face begins as an edge of the coarser front,
    /// and has the bound of a face at that edge.
    fn close_while_moving(&self, corners: [Handle; 3]) -> f32 {
        let parent_of = |vertex: Handle| {
            let creator = self.creator_of_vertex(vertex);
            let parent = creator.map(|slot| self.links[slot as usize].vs);
            self.vertices[parent.unwrap_or(vertex) as usize]
        };
        let of = |vertex: Handle| match self.geomorph_of(vertex) {
            Some(index) => (self.geomorphs[index].home(), parent_of(vertex)),
            None => {
                let stays = self.vertices[vertex as usize];
                (stays, stays)
            }
        };
        let ends = corners.map(of);
        let bound = |ends: [Vertex; 3]| {
            let displacement = |(vertex, end): (Handle, Vertex)| {
                let (here, there) = (self.position(vertex), end.position);
                here.as_dvec3().distance(there.as_dvec3())
            };
            let [a, b, c] = corners;
            let displacements = [(a, ends[0]), (b, ends[1]), (c, ends[2])].map(displacement);
            let farthest = displacements.into_iter().fold(0.0, f64::max);
            let close = Certified::close_of(ends.map(|end| end.certified));
            // Distances and the sum are rounded too.
            rounded_up((f64::from(close) + farthest) * (1.0 + 4.0 * f64::EPSILON))
        };
        bound(ends.map(|(home, _)| home)).min(bound(ends.map(|(_, parent)| parent)))
    }
}
