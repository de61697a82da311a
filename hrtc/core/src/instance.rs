//! Objects of the scene, and their frames: between the world and the stored coordinates of an
//! object's model.

use geometry::Pose;
use glam::DVec3;
use scene::{ModelScale, SurfacePlan};
use spm::ModelHeader;

/// An object of the scene, without its model's name.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct ObjectInstance {
    /// Object of the scene.
    pub object: u32,
    /// Index of its model in the base mesh store.
    pub model: usize,
    /// Hash of the model's name in the scene.
    pub name: u64,
    /// Its pose in this tick.
    pub pose: Pose,
    /// Its pose in the tick before, if that was another.
    pub before: Option<Pose>,
    /// Metres a model unit, or the size that the longest side shall have.
    pub scale: ModelScale,
    /// Stiffness, damping and friction.
    pub surface: SurfacePlan,
    /// Share of the importance of the scene's most important object, up to 1.
    pub importance: f64,
}

/// A pose in the world as it is in the axes of an object at a pose of its own, metres.
#[must_use]
pub fn in_axes_of(object: &Pose, world: Pose) -> Pose {
    Pose {
        position: object.inverse_transform_point(world.position),
        orientation: object.orientation.conjugate() * world.orientation,
    }
}

/// The frame of an object: between the world and the model's stored coordinates.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ModelFrame {
    /// Pose of the model's own frame in the world.
    pub pose: Pose,
    /// Metres a model unit.
    pub metres_per_unit: f64,
    /// Origin of the stored coordinates, model units.
    pub origin: DVec3,
}

impl ModelFrame {
    /// The frame of an object of this pose and size.
    #[must_use]
    pub fn new(pose: Pose, scale: ModelScale, header: &ModelHeader) -> Self {
        let sides = DVec3::from_array(header.upper) - DVec3::from_array(header.lower);
        Self {
            pose,
            metres_per_unit: scale.metres_per_unit(sides.max_element()),
            origin: DVec3::from_array(header.origin),
        }
    }

    /// A point of the world in stored coordinates.
    #[must_use]
    pub fn to_model(&self, world: DVec3) -> DVec3 {
        self.pose.inverse_transform_point(world) / self.metres_per_unit - self.origin
    }

    /// A pose in the world, metres, in stored coordinates.
    #[must_use]
    pub fn pose_to_model(&self, world: Pose) -> Pose {
        self.object_to_model(in_axes_of(&self.pose, world))
    }

    /// A pose in the object's axes, metres (as `in_axes_of` gives it), in stored coordinates.
    #[must_use]
    pub fn object_to_model(&self, pose: Pose) -> Pose {
        Pose {
            position: pose.position / self.metres_per_unit - self.origin,
            ..pose
        }
    }

    /// A pose in stored coordinates in the object's axes, metres: the inverse of
    /// [`Self::object_to_model`].
    #[must_use]
    pub fn model_to_object(&self, pose: Pose) -> Pose {
        Pose {
            position: (pose.position + self.origin) * self.metres_per_unit,
            ..pose
        }
    }

    /// A point in stored coordinates in the world.
    #[must_use]
    pub fn to_world(&self, model: DVec3) -> DVec3 {
        self.pose
            .transform_point((model + self.origin) * self.metres_per_unit)
    }

    /// A direction or displacement in model units as metres of the world.
    #[must_use]
    pub fn vector_to_world(&self, model: DVec3) -> DVec3 {
        self.pose.orientation * (model * self.metres_per_unit)
    }

    /// The box in the world, metres, of a box in stored coordinates.
    #[must_use]
    pub fn box_to_world(&self, lower: DVec3, upper: DVec3) -> (DVec3, DVec3) {
        let corners = [lower, upper];
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for k in 0..8 {
            let pick = |axis: usize| corners[k >> axis & 1][axis];
            let world = self.to_world(DVec3::new(pick(0), pick(1), pick(2)));
            low = low.min(world);
            high = high.max(world);
        }
        (low, high)
    }
}
