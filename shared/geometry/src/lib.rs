//! Geometry in the model's frame: f32 for storage, f64 for decisions.
//!
//! | module | content |
//! |---|---|
//! | `pose` | poses and wrenches |
//! | `similarity` | frames with a scale |
//! | `aabb`, `box_pair` | axis-aligned boxes, rounded outwards |
//! | `triangle` | closest point on a triangle, overlap with a box |
//! | `four_triangles` | bounds of the distances of four triangles |
//! | `segment`, `triangle_distance` | closest points of segments and triangles |
//! | `triangle_pair`, `exact_contact` | exact intersection of two triangles |
//! | `predicates` | exact signs |
//! | [`portable`] | rotations, sines, powers: the same bits on every machine |
//!
//! ```
//! use geometry::closest_point_on_triangle;
//! use glam::DVec3;
//!
//! let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
//! let closest = closest_point_on_triangle(corners, DVec3::new(0.25, 0.25, 2.0));
//! assert_eq!(closest.point, DVec3::new(0.25, 0.25, 0.0));
//! assert_eq!(closest.distance_squared, 4.0);
//! assert_eq!(closest.weights, [0.5, 0.25, 0.25]);
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod aabb;
mod box_pair;
mod exact_contact;
mod four_triangles;
pub mod portable;
mod pose;
mod predicates;
mod segment;
mod similarity;
mod triangle;
mod triangle_distance;
mod triangle_pair;

pub use aabb::Aabb;
pub use box_pair::{BoxBound, BoxPair, BoxQuery, Within};
pub use four_triangles::FourDistances;
pub use pose::{Pose, Wrench};
pub use predicates::{side_of_plane, triangle_is_degenerate};
pub use segment::{
    ClosestPair, closest_points_of_segment_and_triangle, closest_points_of_segments,
};
pub use similarity::{Similarity, widened};
pub use triangle::{
    ClosestPoint, closest_point_on_segment, closest_point_on_triangle, solid_angle,
    triangle_overlaps_box,
};
pub use triangle_distance::closest_points_of_triangles;
pub use triangle_pair::{Facet, TrianglePair, triangle_pair};
