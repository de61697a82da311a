//! Certified errors of active faces.

use super::super::certified::{Certified, rounded_up};
use super::super::error_code::ErrorScale;
use super::super::quarters::{QuarterTable, QuarteredFace};
use super::{ActiveMesh, Handle, Vertex};
use geometry::closest_point_on_triangle;
use glam::DVec3;

/// What is certified of the corners of a face where it would be at rest, and how far its corners
/// are from there at the most, model units.
struct AtRest {
    corners: [Certified; 3],
    displacement: f64,
}

impl AtRest {
    /// A bound of the face at rest, or of a part of it, where the face is now: none of its points
    /// is farther away than the corner that is farthest.
    fn here(&self, bound: f32) -> f32 {
        if self.displacement == 0.0 {
            return bound;
        }
        // Distances and the sum are rounded too.
        rounded_up((f64::from(bound) + self.displacement) * (1.0 + 4.0 * f64::EPSILON))
    }
}

impl ActiveMesh {
    /// Makes room for the quarters of so many faces; without it what is certified of a point is
    /// the certified error of its face.
    #[must_use]
    pub fn with_quarters(mut self, faces: usize) -> Self {
        self.quarters = QuarterTable::with_room(faces);
        self
    }

    /// Adds what is certified of the quarters of the next face of the model's table; false when
    /// there is no room for it, or it is not above the one before.
    #[must_use]
    pub fn add_quarters(&mut self, face: &QuarteredFace, scale: ErrorScale) -> bool {
        self.quarters.push(*face, scale)
    }

    /// Faces whose quarters have bounds here.
    #[must_use]
    pub fn quartered(&self) -> usize {
        self.quarters.len()
    }

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
        let close = |at: AtRest| at.here(Certified::close_of(at.corners));
        let bounds = self.at_rest(face).into_iter().flatten().map(close);
        bounds.fold(radius, f32::min)
    }

    /// How far the point of a face that is nearest to this one is from the full mesh, at the most;
    /// model units. It is the certified error of the face, or what is certified of the quarter, if
    /// that is less and the model has such a bound.
    #[must_use]
    pub fn certified_distance(&self, face: Handle, near: DVec3) -> f32 {
        let error = self.certified_error(face);
        if error == 0.0 {
            return 0.0;
        }
        let id = match self.creator_of_face(face) {
            None => face,
            Some(slot) => self.base_faces + 2 * self.id(slot) + (face - self.fl(slot)),
        };
        let at_point = |at: AtRest| {
            let weights = || closest_point_on_triangle(self.corners(face), near).weights;
            Some(at.here(self.quarters.at(id, at.corners, weights)?))
        };
        let bounds = self.at_rest(face).into_iter().flatten();
        bounds.filter_map(at_point).fold(error, f32::min)
    }

    /// Where a face would be at rest: where it is, or, with corners between two fronts {E > t}, in
    /// the finer and in the coarser one.
    ///
    /// Where two corners go to the same parent, the face begins as an edge of the coarser front,
    /// and has the bound of a face at that edge.
    fn at_rest(&self, face: Handle) -> [Option<AtRest>; 2] {
        let corners = self.faces[face as usize].corners;
        if !self.any_geomorphing(&[face]) {
            let corners = corners.map(|v| self.vertices[v as usize].certified);
            return [
                Some(AtRest {
                    corners,
                    displacement: 0.0,
                }),
                None,
            ];
        }
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
        let at = |ends: [Vertex; 3]| {
            let displacement = |(vertex, end): (Handle, Vertex)| {
                let (here, there) = (self.position(vertex), end.position);
                here.as_dvec3().distance(there.as_dvec3())
            };
            let [a, b, c] = corners;
            let displacements = [(a, ends[0]), (b, ends[1]), (c, ends[2])].map(displacement);
            Some(AtRest {
                corners: ends.map(|end| end.certified),
                displacement: displacements.into_iter().fold(0.0, f64::max),
            })
        };
        [
            at(ends.map(|(home, _)| home)),
            at(ends.map(|(_, parent)| parent)),
        ]
    }
}
