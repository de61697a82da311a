//! Geometry in the model's frame: f32 where stored, f64 where something is decided.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod aabb;
mod box_pair;
mod exact_contact;
mod pose;
mod predicates;
mod segment;
mod similarity;
mod triangle;
mod triangle_distance;
mod triangle_pair;

pub use aabb::Aabb;
pub use box_pair::{BoxBound, BoxPair, BoxQuery, Within};
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
pub use triangle_distance::{
    capsule_triangle_distance, closest_points_of_triangles, least_distance_squared_of_triangles,
};
pub use triangle_pair::{Facet, TrianglePair, triangle_pair};
