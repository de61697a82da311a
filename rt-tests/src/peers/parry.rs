//! The triangle mesh of parry (dimforge/parry), in single and in double precision.

pub use double::ParryF64;
pub use single::ParryF32;

use glam::DVec3;
use shared::geometry::Aabb;

/// A triangle mesh of parry: what both precisions are asked.
pub trait Mesh {
    /// Distance from a point to the mesh.
    fn distance(&self, point: DVec3) -> f64;
    /// Bytes on the heap.
    fn bytes(&self) -> usize;
    /// Takes new boxes of some faces in and refits those above; the length of the whole box's diagonal.
    fn update(&mut self, faces: &[u32], boxes: &[Aabb]) -> f64;
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
                })
            }
        }

        impl Mesh for $name {
            #[inline]
            fn distance(&self, point: DVec3) -> f64 {
                use $parry::query::PointQuery;
                let point = vector(point);
                let found = self.mesh.project_local_point(point, false);
                f64::from((found.point - point).length())
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
    use shared::geometry::Aabb;

    fn vector(point: DVec3) -> parry3d::math::Vector {
        point.as_vec3()
    }

    precision!(ParryF32, parry3d, "The mesh in single precision.");
}

/// Double precision.
mod double {
    use super::Mesh;
    use glam::DVec3;
    use shared::geometry::Aabb;

    fn vector(point: DVec3) -> parry3d_f64::math::Vector {
        point
    }

    precision!(ParryF64, parry3d_f64, "The mesh in double precision.");
}
