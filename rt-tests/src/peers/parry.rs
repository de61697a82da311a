//! The triangle mesh of parry (dimforge/parry), in single and in double precision.

pub use double::ParryF64;
pub use single::ParryF32;

use glam::DVec3;
use shared::geometry::{Aabb, Similarity};

/// A triangle mesh of parry: what both precisions are asked.
pub trait Mesh {
    /// Distance from a point to the mesh.
    fn distance(&self, point: DVec3) -> f64;
    /// Bytes on the heap.
    fn bytes(&self) -> usize;
    /// Takes new boxes of some faces in and refits those above; the length of the whole box's diagonal.
    fn update(&mut self, faces: &[u32], boxes: &[Aabb]) -> f64;
    /// Takes a tool up: its corners and faces in its own frame.
    fn take_tool(&mut self, positions: &[DVec3], faces: &[[u32; 3]]);
    /// Moves the tool, refits its boxes, and visits the pairs of a face of the mesh and one of the tool of which
    /// parry says that they intersect: pairs of leaves of both trees, then GJK.
    fn tool_pairs(&mut self, to_query: &Similarity, visit: &mut dyn FnMut(u32, u32));
}

macro_rules! precision {
    ($name:ident, $parry:ident, $what:literal) => {
        #[doc = $what]
        pub struct $name {
            mesh: $parry::shape::TriMesh,
            /// A copy of its tree, to be updated.
            tree: $parry::partitioning::Bvh,
            /// Faces of the last update, whose marks the next one takes back.
            changed: Vec<u32>,
            tool: $parry::partitioning::Bvh,
            tool_positions: Vec<DVec3>,
            tool_faces: Vec<[u32; 3]>,
            tool_moved: Vec<$parry::math::Vector>,
        }

        impl $name {
            /// Over faces by their corners' places in `positions`.
            ///
            /// # Errors
            /// What parry says.
            pub fn new(positions: &[DVec3], faces: &[[u32; 3]]) -> Result<Self, String> {
                let positions = positions.iter().map(|&p| vector(p)).collect();
                let mesh = $parry::shape::TriMesh::new(positions, faces.to_vec())
                    .map_err(|error| error.to_string())?;
                let tree = mesh.bvh().clone();
                Ok(Self {
                    mesh,
                    tree,
                    changed: Vec::with_capacity(64),
                    tool: $parry::partitioning::Bvh::new(),
                    tool_positions: Vec::new(),
                    tool_faces: Vec::new(),
                    tool_moved: Vec::new(),
                })
            }
        }

        fn around(
            positions: &[$parry::math::Vector],
            face: &[u32; 3],
        ) -> $parry::bounding_volume::Aabb {
            let [a, b, c] = face.map(|v| positions[v as usize]);
            $parry::bounding_volume::Aabb::new(a.min(b).min(c), a.max(b).max(c))
        }

        impl Mesh for $name {
            #[inline]
            fn distance(&self, point: DVec3) -> f64 {
                use $parry::query::PointQuery;
                let point = vector(point);
                let found = self.mesh.project_local_point(point, false);
                f64::from((found.point - point).length())
            }

            fn take_tool(&mut self, positions: &[DVec3], faces: &[[u32; 3]]) {
                self.tool_positions = positions.to_vec();
                self.tool_moved = positions.iter().map(|&p| vector(p)).collect();
                self.tool_faces = faces.to_vec();
                let boxes: Vec<_> = faces
                    .iter()
                    .map(|face| around(&self.tool_moved, face))
                    .collect();
                let strategy = $parry::partitioning::BvhBuildStrategy::default();
                self.tool = $parry::partitioning::Bvh::from_leaves(strategy, &boxes);
            }

            fn tool_pairs(&mut self, to_query: &Similarity, visit: &mut dyn FnMut(u32, u32)) {
                for (moved, &position) in self.tool_moved.iter_mut().zip(&self.tool_positions) {
                    *moved = vector(to_query.point(position));
                }
                for (k, face) in (0u32..).zip(&self.tool_faces) {
                    let aabb = around(&self.tool_moved, face);
                    self.tool.insert_or_update_partially(aabb, k, 0.0);
                }
                self.tool.refit_without_opt();
                let here = $parry::math::Pose::IDENTITY;
                let pairs = self
                    .mesh
                    .bvh()
                    .leaf_pairs(&self.tool, |a, b| a.intersects(b));
                for (face, of_tool) in pairs {
                    let corners =
                        self.tool_faces[of_tool as usize].map(|v| self.tool_moved[v as usize]);
                    let [a, b, c] = corners;
                    let other = $parry::shape::Triangle::new(a, b, c);
                    let own = self.mesh.triangle(face);
                    // GJK itself: the dispatcher before it would bring every shape's code along.
                    if $parry::query::details::intersection_test_support_map_support_map(
                        &here, &own, &other,
                    ) {
                        visit(face, of_tool);
                    }
                }
            }

            fn bytes(&self) -> usize {
                self.mesh.heap_memory_size()
            }

            fn update(&mut self, faces: &[u32], boxes: &[Aabb]) -> f64 {
                for (&face, aabb) in faces.iter().zip(boxes) {
                    let [lower, upper] = [aabb.lower, aabb.upper].map(|p| vector(p.as_dvec3()));
                    let aabb = $parry::bounding_volume::Aabb::new(lower, upper);
                    self.tree.insert_or_update_partially(aabb, face, 0.0);
                }
                self.tree.refit_partial(&self.changed, faces);
                self.changed.clear();
                self.changed.extend_from_slice(faces);
                f64::from(self.tree.root_aabb().extents().length())
            }
        }
    };
}

/// Single precision.
mod single {
    use super::Mesh;
    use glam::DVec3;
    use shared::geometry::{Aabb, Similarity};

    fn vector(point: DVec3) -> parry3d::math::Vector {
        point.as_vec3()
    }

    precision!(ParryF32, parry3d, "The mesh in single precision.");
}

/// Double precision.
mod double {
    use super::Mesh;
    use glam::DVec3;
    use shared::geometry::{Aabb, Similarity};

    fn vector(point: DVec3) -> parry3d_f64::math::Vector {
        point
    }

    precision!(ParryF64, parry3d_f64, "The mesh in double precision.");
}
