//! A tool: a rigid mesh under a moving pose, for a probe with a shape.
//!
//! Its tree is the complete binary tree over its faces (median splits, the first half rounded up,
//! as the AB-tree), parents before children. A pose moves the vertices and refits the boxes in one
//! pass from the last node to the first. The boxes are tight in the other body's frame, so that a
//! test of two boxes needs no transform.
//!
//! | module | content |
//! |---|---|
//! | `shapes` | tool meshes of simple shape |
//! | `block_tree` | eight-wide boxes of the tool's faces in its own axes |
//! | `block_order` | the order of the faces in them |
//! | `near_pairs` | face pairs of the front and a moving tool within a margin |

mod block_order;
mod block_tree;
mod near_pairs;
mod shapes;

pub(crate) use block_tree::Blocks;
pub(crate) use near_pairs::{RelativePath, Resume, for_each_face_near, for_each_near_pair};
pub use shapes::{capsule_mesh, cylinder_mesh};

use crate::contact::query::Body;
use ab_tree::{Child, NodeId};
use block_order::{FaceBox, block_order};
use geometry::{Aabb, BoxPair, Similarity};
use glam::{DVec3, Vec3A};
use spm::Handle;
use thiserror::Error;

/// Positions, in units of the tool's file, and faces with corners counterclockwise from outside.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ToolMesh {
    /// Vertices.
    pub positions: Vec<DVec3>,
    /// Faces, indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

/// Reason why a mesh cannot be a tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ToolError {
    /// No faces.
    #[error("the tool has no faces")]
    Empty,
    /// More faces than the limit.
    #[error("the tool has {0} faces; the limit is {limit}", limit = Tool::MAX_FACES)]
    TooMany(usize),
    /// A face names a missing vertex.
    #[error("face {0} of the tool names a vertex that is not there")]
    NoSuchVertex(usize),
    /// A coordinate is not finite in f32.
    #[error("vertex {0} of the tool is not finite")]
    NotFinite(usize),
}

/// A vertex in the query's frame.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Moved {
    position: DVec3,
    /// The same, rounded to f32.
    near: Vec3A,
}

/// A node: 64 bytes, boxes in the query's frame.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct ToolNode {
    boxes: BoxPair,
    children: [Child; 2],
}

/// A mesh that moves as a whole. Nothing allocates after [`Tool::new`].
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Tool {
    local_vertices: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    /// The corners of each face that stand for their vertex: each vertex once.
    samples: Vec<[bool; 3]>,
    nodes: Vec<ToolNode>,
    /// The children of each node, indices of `boxes`.
    below: Vec<[u32; 2]>,
    moved: Vec<Moved>,
    /// Boxes in the query's frame, each on both sides of its pair: those of nodes, then those of
    /// faces.
    boxes: Vec<BoxPair>,
    to_query: Similarity,
}

impl Tool {
    /// Largest number of faces.
    pub const MAX_FACES: usize = 1 << 20;

    /// A tool in its own frame.
    ///
    /// # Errors
    /// If the mesh has no faces, too many faces, a coordinate that is not finite in f32, or a
    /// missing vertex.
    pub fn new(mesh: &ToolMesh) -> Result<Self, ToolError> {
        let count = mesh.triangles.len();
        if count == 0 {
            return Err(ToolError::Empty);
        }
        if count > Self::MAX_FACES {
            return Err(ToolError::TooMany(count));
        }
        let limit = DVec3::splat(f64::from(f32::MAX));
        let good = |p: &DVec3| p.abs().cmple(limit).all();
        if let Some(vertex) = mesh.positions.iter().position(|p| !good(p)) {
            return Err(ToolError::NotFinite(vertex));
        }
        let there = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < mesh.positions.len());
        if let Some(face) = mesh.triangles.iter().position(|t| !there(t)) {
            return Err(ToolError::NoSuchVertex(face));
        }
        let nodes = tree_over(mesh);
        let place = |child: Child| match child {
            Child::Node(node) => node,
            Child::Face(face) => nodes.len() as u32 + face,
        };
        let below = nodes.iter().map(|n| n.children.map(place)).collect();
        let boxes = vec![BoxPair::EMPTY; nodes.len() + count];
        let mut seen = vec![false; mesh.positions.len()];
        let samples = mesh
            .triangles
            .iter()
            .map(|t| t.map(|v| !std::mem::replace(&mut seen[v as usize], true)))
            .collect();
        let nowhere = Moved {
            position: DVec3::ZERO,
            near: Vec3A::ZERO,
        };
        let mut tool = Self {
            local_vertices: mesh.positions.clone(),
            faces: mesh.triangles.clone(),
            samples,
            nodes,
            below,
            boxes,
            moved: vec![nowhere; mesh.positions.len()],
            to_query: Similarity::IDENTITY,
        };
        tool.place(&Similarity::IDENTITY);
        Ok(tool)
    }

    /// Moves the tool. `to_query`: from its own frame to the other body's.
    pub fn place(&mut self, to_query: &Similarity) {
        self.to_query = *to_query;
        for (moved, &local) in self.moved.iter_mut().zip(&self.local_vertices) {
            let position = to_query.point(local);
            *moved = Moved {
                position,
                near: position.as_vec3a(),
            };
        }
        self.refit();
    }

    /// The faces in the order of their blocks.
    pub(crate) fn order(&self) -> Vec<u32> {
        let corners = |face: &[u32; 3]| face.map(|v| self.local_vertices[v as usize]);
        let boxes: Vec<_> = self.faces.iter().map(|f| FaceBox::of(corners(f))).collect();
        block_order(&boxes)
    }

    fn refit(&mut self) {
        // Two loops without a branch: the boxes of faces, then those of nodes, children before
        // parents.
        let (of_nodes, of_faces) = self.boxes.split_at_mut(self.nodes.len());
        for (aabb, face) in of_faces.iter_mut().zip(&self.faces) {
            let [a, b, c] = face.map(|v| self.moved[v as usize].near);
            *aabb = BoxPair::twice_widened(a.min(b).min(c), a.max(b).max(c));
        }
        let first_face = of_nodes.len();
        for k in (0..first_face).rev() {
            let [left, right] = self.below[k].map(|place| &self.boxes[place as usize]);
            let boxes = BoxPair::mixed(left, right);
            self.nodes[k].boxes = boxes;
            self.boxes[k] = boxes.joined();
        }
    }

    /// From its own frame to the query's, as placed last.
    #[must_use]
    pub fn to_query(&self) -> &Similarity {
        &self.to_query
    }

    /// Vertices in its own frame.
    #[must_use]
    pub fn local_vertices(&self) -> &[DVec3] {
        &self.local_vertices
    }

    /// Number of faces.
    #[must_use]
    pub fn faces(&self) -> u32 {
        self.faces.len() as u32
    }

    /// Vertices in the query's frame.
    pub fn vertices(&self) -> impl ExactSizeIterator<Item = DVec3> + '_ {
        self.moved.iter().map(|moved| moved.position)
    }

    /// The corners of a face that stand for their vertex, so that each vertex is visited once.
    #[must_use]
    pub fn samples(&self, face: Handle) -> [bool; 3] {
        self.samples[face as usize]
    }

    /// Corners of a face, indices of vertices.
    #[must_use]
    pub fn triangle(&self, face: Handle) -> [u32; 3] {
        self.faces[face as usize]
    }
}

impl Body for Tool {
    #[inline]
    fn root(&self) -> Option<Child> {
        // A tool of one face has no node.
        Some(if self.nodes.is_empty() {
            Child::Face(0)
        } else {
            Child::Node(0)
        })
    }

    fn root_box(&self) -> Aabb {
        self.boxes[0].get(0)
    }

    #[inline]
    fn children(&self, node: NodeId) -> ([Child; 2], BoxPair) {
        let node = &self.nodes[node as usize];
        (node.children, node.boxes)
    }

    #[inline]
    fn corners(&self, face: Handle) -> [DVec3; 3] {
        self.faces[face as usize].map(|v| self.moved[v as usize].position)
    }

    fn has(&self, face: Handle) -> bool {
        (face as usize) < self.faces.len()
    }
}

/// Median splits along the longest axis of the centroids' box, parents first; ties go by number.
fn tree_over(mesh: &ToolMesh) -> Vec<ToolNode> {
    let centroid = |face: u32| -> DVec3 {
        let corners = mesh.triangles[face as usize].map(|v| mesh.positions[v as usize]);
        corners.iter().sum()
    };
    let mut order: Vec<(DVec3, u32)> = (0..mesh.triangles.len() as u32)
        .map(|face| (centroid(face), face))
        .collect();
    let mut nodes: Vec<ToolNode> = Vec::with_capacity(order.len() - 1);
    // A range of faces, with the node and the side that refer to it.
    let mut waiting = vec![(0..order.len(), None)];
    while let Some((range, place)) = waiting.pop() {
        let child = if range.len() == 1 {
            Child::Face(order[range.start].1)
        } else {
            let id = nodes.len();
            nodes.push(ToolNode {
                boxes: BoxPair::EMPTY,
                children: [Child::Face(0); 2],
            });
            let half = range.len().div_ceil(2);
            let set = &mut order[range.clone()];
            let bounds = set.iter().map(|&(c, _)| c);
            let low = bounds.clone().fold(DVec3::INFINITY, DVec3::min);
            let sides = bounds.fold(DVec3::NEG_INFINITY, DVec3::max) - low;
            let axis = sides.max_position();
            set.select_nth_unstable_by(half, |(a, f), (b, g)| {
                a[axis].total_cmp(&b[axis]).then(f.cmp(g))
            });
            let middle = range.start + half;
            waiting.push((middle..range.end, Some((id, 1))));
            waiting.push((range.start..middle, Some((id, 0))));
            Child::Node(id as NodeId)
        };
        if let Some((parent, side)) = place {
            let parent: &mut ToolNode = &mut nodes[parent];
            parent.children[side] = child;
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use glam::DQuat;

    fn tool() -> Tool {
        Tool::new(&capsule_mesh(0.5, 3.0, 12, 10)).expect("a capsule is a tool")
    }

    #[test]
    fn every_pose_leaves_every_corner_in_every_box_above_it() {
        let mut tool = tool();
        for k in 0..20 {
            let angle = f64::from(k);
            let pose = Pose {
                position: DVec3::new(angle, 1e6 * angle, -1.0),
                orientation: DQuat::from_rotation_x(angle) * DQuat::from_rotation_z(0.3 * angle),
            };
            let s = Similarity::new(pose, 10f64.powi(k % 7 - 3)).expect("a good pose");
            tool.place(&s);
            let mut faces = 0;
            let mut stack = vec![(tool.root().expect("a root"), vec![tool.root_box()])];
            while let Some((child, above)) = stack.pop() {
                match child {
                    Child::Face(face) => {
                        faces += 1;
                        for corner in tool.corners(face) {
                            assert!(above.iter().all(|b| b.lower.as_dvec3().cmple(corner).all()
                                && b.upper.as_dvec3().cmpge(corner).all()));
                        }
                    }
                    Child::Node(id) => {
                        let (children, boxes) = tool.children(id);
                        for side in [0, 1] {
                            let mut above = above.clone();
                            above.push(boxes.get(side));
                            stack.push((children[side], above));
                        }
                    }
                }
            }
            assert_eq!(faces, tool.faces());
            for (moved, local) in tool.vertices().zip(&tool.local_vertices) {
                assert_eq!(moved, s.point(*local));
            }
        }
    }

    #[test]
    fn each_vertex_is_one_sample() {
        let tool = tool();
        let count: usize = (0..tool.faces())
            .map(|f| tool.samples(f).iter().filter(|&&s| s).count())
            .sum();
        assert_eq!(count, tool.local_vertices.len());
    }

    #[test]
    fn what_is_no_tool_is_refused() {
        let mesh = |positions: &[DVec3], triangles: &[[u32; 3]]| ToolMesh {
            positions: positions.to_vec(),
            triangles: triangles.to_vec(),
        };
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let refused = |m: &ToolMesh| Tool::new(m).expect_err("it is no tool");
        assert_eq!(refused(&mesh(&corners, &[])), ToolError::Empty);
        let beyond = mesh(&corners, &[[0, 1, 2], [0, 1, 3]]);
        assert_eq!(refused(&beyond), ToolError::NoSuchVertex(1));
        for bad in [f64::NAN, f64::INFINITY, 1e39] {
            let lost = [DVec3::ZERO, DVec3::X, DVec3::splat(bad)];
            assert_eq!(refused(&mesh(&lost, &[[0, 1, 2]])), ToolError::NotFinite(2));
        }
        let one = Tool::new(&mesh(&corners, &[[0, 1, 2]])).expect("one face is a tool");
        assert_eq!(one.root(), Some(Child::Face(0)));
    }
}
