//! A point that a moving surface takes along.

use geometry::closest_point_on_triangle;
use glam::DVec3;
use spm::{ActiveMesh, OperationFaces};

/// Where a point goes if the split, collapse or step that was just performed has passed over it: to
/// the surface as it is now, and `beyond` on the side where it was. `None` if it has not.
///
/// Per operation the volume between the surface before and after tells exactly whether it has
/// passed. The surface at the end of a tick does not, since sheets may have moved past each other.
pub fn carried(
    mesh: &ActiveMesh,
    operation: &OperationFaces,
    point: DVec3,
    beyond: f64,
) -> Option<DVec3> {
    if !mesh.swept_over(operation, point) {
        return None;
    }
    let faces = operation.deformed().iter();
    let nearest = faces
        .chain(operation.made_or_removed())
        .filter(|&&face| mesh.is_active(face))
        .map(|&face| closest_point_on_triangle(mesh.corners(face), point))
        .min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared))?;
    let through = (nearest.point - point).normalize_or_zero();
    Some(nearest.point + through * beyond)
}
