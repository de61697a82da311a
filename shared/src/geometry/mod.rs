//! Geometry in the model's frame: f32 where stored, f64 where something is decided.

mod aabb;
mod pose;
mod predicates;
mod triangle;

pub use aabb::Aabb;
pub use pose::{Pose, Wrench};
pub use predicates::{side_of_plane, triangle_is_degenerate};
pub use triangle::{
    ClosestPoint, closest_point_on_segment, closest_point_on_triangle, solid_angle,
    triangle_overlaps_box,
};
