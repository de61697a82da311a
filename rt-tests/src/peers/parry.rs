//! The triangle mesh of parry (dimforge/parry), in single and in double precision.

pub use double::ParryF64;
pub use single::ParryF32;

use geometry::Pose;
use glam::{DVec3, Vec3};

/// How parry is told where the tool is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ToolPose {
    /// By the pose, which every box and face of the tool is moved by as it is met. It is what parry
    /// does itself where it asks for pairs of leaves (`intersect_meshes`, at version 0.31 the only
    /// place), and what every query of its that takes two shapes does: a shape is not changed by a
    /// pose.
    Given,
    /// The tool is made anew at its pose, its tree refitted: what a user may do who knows that few
    /// poses are far apart and that all pairs are asked for.
    Moved,
}

/// A triangle mesh of parry: what both precisions are asked.
pub trait Mesh {
    /// The closest point of the mesh.
    fn closest_point(&self, point: DVec3) -> DVec3;
    /// Distance from a point to the mesh.
    fn distance(&self, point: DVec3) -> f64;
    /// Bytes on the heap.
    fn bytes(&self) -> usize;
    /// The same, told which face the last answer lay on: parry has no hint, but a largest distance,
    /// that of this face.
    fn distance_with_memory(&self, point: DVec3, last: &mut Option<u32>) -> f64;
    /// Moves some faces away from where they are by so much, takes their boxes in and refits those
    /// above; the length of the whole box's diagonal.
    fn update(&mut self, faces: &[u32], by: Vec3) -> f64;
    /// Takes a tool up: its corners and faces in its own frame.
    fn take_tool(&mut self, positions: &[DVec3], faces: &[[u32; 3]]);
    /// Visits the pairs of a face of the mesh and one of the tool of which parry says that they
    /// intersect: pairs of leaves of both trees, then GJK.
    fn tool_pairs(&mut self, pose: &Pose, how: ToolPose, visit: &mut dyn FnMut(u32, u32));
}

macro_rules! precision {
    ($name:ident, $parry:ident, $what:literal) => {
        #[doc = $what]
        pub struct $name {
            mesh: $parry::shape::TriMesh,
            /// A copy of its tree, to be updated.
            tree: $parry::partitioning::Bvh,
            tool: Tool,
            /// Nanoseconds that parry took to make the mesh with its tree.
            pub build_ns: f64,
        }

        /// A tool in its own frame, and as it was moved last.
        #[derive(Default)]
        struct Tool {
            tree: $parry::partitioning::Bvh,
            positions: Vec<$parry::math::Vector>,
            faces: Vec<[u32; 3]>,
            moved_tree: $parry::partitioning::Bvh,
            moved: Vec<$parry::math::Vector>,
        }

        impl Tool {
            /// Its vertices are moved, its boxes refitted.
            fn move_to(&mut self, pose: &$parry::math::Pose) {
                for (moved, &position) in self.moved.iter_mut().zip(&self.positions) {
                    *moved = pose.transform_point(position);
                }
                for (k, face) in (0u32..).zip(&self.faces) {
                    let aabb = around(&self.moved, face);
                    self.moved_tree.insert_or_update_partially(aabb, k, 0.0);
                }
                self.moved_tree.refit_without_opt();
            }
        }

        fn triangle(
            positions: &[$parry::math::Vector],
            face: &[u32; 3],
        ) -> $parry::shape::Triangle {
            let [a, b, c] = face.map(|v| positions[v as usize]);
            $parry::shape::Triangle::new(a, b, c)
        }

        impl $name {
            /// Over faces by their corners' places in `positions`.
            ///
            /// # Errors
            /// What parry says.
            pub fn new(positions: &[DVec3], faces: &[[u32; 3]]) -> Result<Self, String> {
                let positions = positions.iter().map(|&p| vector(p)).collect();
                let faces = faces.to_vec();
                let start = std::time::Instant::now();
                let mesh = $parry::shape::TriMesh::new(positions, faces);
                let build_ns = start.elapsed().as_nanos() as f64;
                let mesh = mesh.map_err(|error| error.to_string())?;
                let tree = mesh.bvh().clone();
                Ok(Self {
                    mesh,
                    tree,
                    tool: Tool::default(),
                    build_ns,
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
            fn closest_point(&self, point: DVec3) -> DVec3 {
                use $parry::query::PointQuery;
                let found = self.mesh.project_local_point(vector(point), false).point;
                [found.x, found.y, found.z].map(f64::from).into()
            }

            #[inline]
            fn distance(&self, point: DVec3) -> f64 {
                use $parry::query::PointQuery;
                let point = vector(point);
                let found = self.mesh.project_local_point(point, false);
                f64::from((found.point - point).length())
            }

            #[inline]
            fn distance_with_memory(&self, point: DVec3, last: &mut Option<u32>) -> f64 {
                use $parry::query::{PointQuery, PointQueryWithLocation};
                let point = vector(point);
                let known = last.map(|face| {
                    let triangle = self.mesh.triangle(face);
                    triangle.distance_to_local_point(point, false)
                });
                let most = known.unwrap_or($parry::math::Real::MAX);
                let found = self
                    .mesh
                    .project_local_point_and_get_location_with_max_dist(point, false, most);
                let Some((found, (face, _))) = found else {
                    // Nothing is nearer than the face of the last answer.
                    return known.map_or(f64::NAN, f64::from);
                };
                *last = Some(face);
                f64::from((found.point - point).length())
            }

            fn take_tool(&mut self, positions: &[DVec3], faces: &[[u32; 3]]) {
                let positions: Vec<_> = positions.iter().map(|&p| vector(p)).collect();
                let boxes: Vec<_> = faces.iter().map(|face| around(&positions, face)).collect();
                let strategy = $parry::partitioning::BvhBuildStrategy::default();
                let tree = $parry::partitioning::Bvh::from_leaves(strategy, &boxes);
                self.tool = Tool {
                    moved_tree: tree.clone(),
                    tree,
                    moved: positions.clone(),
                    positions,
                    faces: faces.to_vec(),
                };
            }

            fn tool_pairs(&mut self, pose: &Pose, how: ToolPose, visit: &mut dyn FnMut(u32, u32)) {
                // GJK itself: the dispatcher before it would bring every shape's code along.
                use $parry::query::details::intersection_test_support_map_support_map as meet;
                let to_mesh = pose_of(pose);
                let tree = self.mesh.bvh();
                if how == ToolPose::Moved {
                    self.tool.move_to(&to_mesh);
                    let tool = &self.tool;
                    let here = $parry::math::Pose::IDENTITY;
                    for (face, of_tool) in tree.leaf_pairs(&tool.moved_tree, |a, b| a.intersects(b))
                    {
                        let other = triangle(&tool.moved, &tool.faces[of_tool as usize]);
                        if meet(&here, &self.mesh.triangle(face), &other) {
                            visit(face, of_tool);
                        }
                    }
                    return;
                }
                let tool = &self.tool;
                let overlap = |a: &Node, b: &Node| {
                    use $parry::bounding_volume::BoundingVolume;
                    a.aabb().intersects(&b.aabb().transform_by(&to_mesh))
                };
                for (face, of_tool) in tree.leaf_pairs(&tool.tree, overlap) {
                    let other = triangle(&tool.positions, &tool.faces[of_tool as usize]);
                    if meet(&to_mesh, &self.mesh.triangle(face), &other) {
                        visit(face, of_tool);
                    }
                }
            }

            fn bytes(&self) -> usize {
                self.mesh.heap_memory_size()
            }

            fn update(&mut self, faces: &[u32], by: Vec3) -> f64 {
                let by = vector(by.as_dvec3());
                for &face in faces {
                    let corners = &self.mesh.indices()[face as usize];
                    let aabb = around(self.mesh.vertices(), corners).translated(by);
                    self.tree.insert_or_update_partially(aabb, face, 0.0);
                }
                // No leaf is marked as changed, so none of the update before is to be taken back.
                self.tree.refit_partial(&[], faces);
                f64::from(self.tree.root_aabb().extents().length())
            }
        }
    };
}

/// Single precision.
mod single {
    use super::{Mesh, ToolPose};
    use geometry::Pose;
    use glam::{DVec3, Vec3};
    use parry3d::partitioning::BvhNode as Node;

    fn vector(point: DVec3) -> parry3d::math::Vector {
        point.as_vec3()
    }

    fn pose_of(pose: &Pose) -> parry3d::math::Pose {
        parry3d::math::Pose::from_parts(vector(pose.position), pose.orientation.as_quat())
    }

    precision!(ParryF32, parry3d, "The mesh in single precision.");
}

/// Double precision.
mod double {
    use super::{Mesh, ToolPose};
    use geometry::Pose;
    use glam::{DVec3, Vec3};
    use parry3d_f64::partitioning::BvhNode as Node;

    fn vector(point: DVec3) -> parry3d_f64::math::Vector {
        point
    }

    fn pose_of(pose: &Pose) -> parry3d_f64::math::Pose {
        parry3d_f64::math::Pose::from_parts(pose.position, pose.orientation)
    }

    precision!(ParryF64, parry3d_f64, "The mesh in double precision.");
}
