//! A probe's tool against the full mesh, by a look at all pairs of faces: independent of the
//! search trees that the runs test.

use super::library::Version;
use super::scenes::SIZE_M;
use geometry::triangle_pair;
use glam::{DQuat, DVec3};
use hrtc_core::contact::tool::ToolMesh;
use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use scene::ProbeShape;

/// The faces of a probe's tool.
#[derive(Debug)]
pub struct StandingTool {
    /// About the device's position, metres.
    faces: Vec<[DVec3; 3]>,
    /// Depth of the tip below the device's position, metres.
    tip_m: f64,
}

impl StandingTool {
    /// Of a probe; `None` for a ball.
    #[must_use]
    pub fn of_shape(shape: &ProbeShape) -> Option<Self> {
        let mesh = ToolMesh::of_shape(shape)?;
        let corners = |of: &[u32; 3]| of.map(|corner| mesh.positions[corner as usize]);
        Some(Self {
            faces: mesh.triangles.iter().map(corners).collect(),
            tip_m: shape.tip_m(),
        })
    }

    /// Whether a face of it meets one of the full mesh while it stands over a point (stored
    /// coordinates) along the unit normal there, its tip at this height, metres.
    #[must_use]
    pub fn meets(&self, version: &Version, [point, normal]: [DVec3; 2], height_m: f64) -> bool {
        let units_per_metre = 1.0 / metres_per_unit(version);
        let turn = DQuat::from_rotation_arc(DVec3::Z, normal);
        let foot = point + normal * ((self.tip_m + height_m) * units_per_metre);
        let place = |corner: DVec3| foot + turn * corner * units_per_metre;
        let faces: Vec<[DVec3; 3]> = self.faces.iter().map(|of| of.map(place)).collect();
        let box_of = |points: &[DVec3]| Aabb::from_points(points.iter().copied());
        let all = box_of(faces.as_flattened());
        version.full.triangles().iter().any(|&surface| {
            let near = box_of(&surface);
            all.intersects(&near)
                && faces.iter().any(|&face| {
                    box_of(&face).intersects(&near) && triangle_pair(surface, face).meets()
                })
        })
    }
}

/// Metres in a unit of a model's stored coordinates.
#[must_use]
pub fn metres_per_unit(version: &Version) -> f64 {
    let header = version.model.file.model_header();
    let [lower, upper] = [header.lower, header.upper].map(DVec3::from_array);
    SIZE_M / (upper - lower).max_element()
}
