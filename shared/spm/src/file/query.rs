//! Queries of the full mesh, answered from the map: no tree is built, only needed pages are read.

use super::layout::{FullFace, Section, box_depth, faces_below};
use super::{FileError, SpmFile};
use geometry::{Aabb, ClosestPoint, closest_point_on_triangle};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Largest number of waiting nodes of a search: one for each level, and one more.
const MAX_STACK: usize = 40;

impl<D: AsRef<[u8]>> SpmFile<D> {
    /// Position of a vertex by its id, model units.
    ///
    /// # Errors
    /// When there is no such vertex, or its block is damaged.
    pub fn vertex_position(&self, vertex: u32) -> Result<Vec3, FileError> {
        let sizes = self.model_header().sizes();
        let position = match sizes.creator_of_vertex(vertex) {
            None => {
                self.base_vertices()
                    .get(vertex as usize)
                    .ok_or(FileError::Inconsistent(Section::FullFaces))?
                    .position
            }
            Some(i) => {
                let record = self.record(i)?;
                if vertex == sizes.vt(i) {
                    record.pos_t
                } else {
                    record.pos_u
                }
            }
        };
        Ok(Vec3::from_array(position))
    }

    /// The face of the full mesh at a position in AB-tree order.
    ///
    /// # Errors
    /// When `position` is no position of a face, or its block is damaged.
    pub fn full_face(&self, position: u32) -> Result<FullFace, FileError> {
        let face: FullFace = self.item(Section::FullFaces, u64::from(position))?;
        let sizes = self.model_header().sizes();
        let within =
            |id: u32, base: u32| u64::from(id) < u64::from(base) + 2 * u64::from(sizes.vsps);
        let sound = face.corners.iter().all(|&v| within(v, sizes.base_vertices))
            && within(face.face, sizes.base_faces);
        if sound {
            Ok(face)
        } else {
            Err(FileError::Inconsistent(Section::FullFaces))
        }
    }

    /// Corners of the face of the full mesh at a position in AB-tree order, model units.
    ///
    /// # Errors
    /// When `position` is no position of a face, or a needed block is damaged.
    pub fn leaf_corners(&self, position: u32) -> Result<[DVec3; 3], FileError> {
        let [a, b, c] = self.full_face(position)?.corners;
        Ok([
            self.vertex_position(a)?.as_dvec3(),
            self.vertex_position(b)?.as_dvec3(),
            self.vertex_position(c)?.as_dvec3(),
        ])
    }

    /// Depth of the box tree. Its nodes are the heap indices from 1 to below 2^(depth + 1); those
    /// at this depth hold four to eight faces (or all, when the mesh has fewer).
    #[must_use]
    pub fn box_depth(&self) -> u32 {
        box_depth(self.model_header().faces)
    }

    /// The box of a node of the box tree.
    ///
    /// # Errors
    /// When there is no such node, or its block is damaged.
    pub fn node_box(&self, node: u32) -> Result<Aabb, FileError> {
        let found: Aabb = self.item(Section::Boxes, u64::from(node))?;
        if found.is_empty() {
            return Err(FileError::Inconsistent(Section::Boxes));
        }
        Ok(found)
    }

    /// Positions in AB-tree order of the faces below a node (a heap index, not 0).
    #[must_use]
    pub fn node_faces(&self, node: u32) -> Range<u32> {
        faces_below(node, self.model_header().faces)
    }

    /// The point of the full mesh closest to a point (model units, relative to the file's origin),
    /// and the position in AB-tree order of its face. Exact in f64.
    ///
    /// # Errors
    /// When the point is not finite, or a needed block is damaged.
    pub fn closest_point(&self, point: DVec3) -> Result<(u32, ClosestPoint), FileError> {
        let found = self.closest_point_within(point, &mut { u32::MAX })?;
        found.ok_or(FileError::Inconsistent(Section::FullFaces))
    }

    /// As [`SpmFile::closest_point`], but looks into so many boxes at the most, and counts them
    /// down; `None` when they do not suffice.
    ///
    /// # Errors
    /// When the point is not finite, or a needed block is damaged.
    pub fn closest_point_within(
        &self,
        point: DVec3,
        boxes: &mut u32,
    ) -> Result<Option<(u32, ClosestPoint)>, FileError> {
        if !point.is_finite() {
            return Err(FileError::Query);
        }
        let leaf_depth = self.box_depth();
        let mut best: Option<(u32, ClosestPoint)> = None;
        let mut stack = [(0u32, 0f64); MAX_STACK];
        stack[0] = (1, 0.0);
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (node, distance) = stack[waiting];
            if best.is_some_and(|(_, b)| distance >= b.distance_squared) {
                continue;
            }
            if *boxes == 0 {
                return Ok(None);
            }
            *boxes -= 1;
            if ab_tree::depth(node) == leaf_depth {
                for position in self.node_faces(node) {
                    let found = closest_point_on_triangle(self.leaf_corners(position)?, point);
                    if best.is_none_or(|(_, b)| found.distance_squared < b.distance_squared) {
                        best = Some((position, found));
                    }
                }
                continue;
            }
            let (mut near, mut far) = (2 * node, 2 * node + 1);
            let mut near_distance = self.node_box(near)?.distance_squared(point);
            let mut far_distance = self.node_box(far)?.distance_squared(point);
            if far_distance < near_distance {
                std::mem::swap(&mut near, &mut far);
                std::mem::swap(&mut near_distance, &mut far_distance);
            }
            stack[waiting] = (far, far_distance);
            stack[waiting + 1] = (near, near_distance);
            waiting += 2;
        }
        Ok(best)
    }
}
