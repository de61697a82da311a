//! Poses and wrenches: every interface carries rotation and torque, also for sphere probes.

use glam::{DQuat, DVec3};

/// Position and orientation of a rigid frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// Position, metres.
    pub position: DVec3,
    /// Unit quaternion (glam keeps x, y, z, w).
    pub orientation: DQuat,
}

impl Pose {
    /// The frame of the world.
    pub const IDENTITY: Self = Self {
        position: DVec3::ZERO,
        orientation: DQuat::IDENTITY,
    };

    /// A pose with no rotation.
    #[must_use]
    pub const fn at(position: DVec3) -> Self {
        Self {
            position,
            orientation: DQuat::IDENTITY,
        }
    }

    /// A pose from a quaternion with w first, the order of files. This is the only conversion.
    ///
    /// `None` when a number is not finite or the quaternion has no direction.
    #[must_use]
    pub fn from_wxyz(position: [f64; 3], wxyz: [f64; 4]) -> Option<Self> {
        let [w, x, y, z] = wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        let pose = Self {
            position: DVec3::from_array(position),
            orientation: q / length,
        };
        (length.is_normal() && pose.is_finite()).then_some(pose)
    }

    /// The quaternion in a file's order, w first.
    #[must_use]
    pub fn wxyz(&self) -> [f64; 4] {
        let q = self.orientation;
        [q.w, q.x, q.y, q.z]
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.orientation.is_finite()
    }

    /// A point of this frame, in the parent's frame.
    #[must_use]
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.position + self.orientation * point
    }

    /// A point of the parent's frame, in this frame.
    #[must_use]
    pub fn inverse_transform_point(&self, point: DVec3) -> DVec3 {
        self.orientation.inverse() * (point - self.position)
    }
}

/// Force and torque at a pose's position, in the world's axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Wrench {
    /// Newtons.
    pub force: DVec3,
    /// Newton metres.
    pub torque: DVec3,
}

impl Wrench {
    /// No force, no torque.
    pub const ZERO: Self = Self {
        force: DVec3::ZERO,
        torque: DVec3::ZERO,
    };

    /// Its force alone.
    #[must_use]
    pub fn without_torque(self) -> Self {
        Self {
            torque: DVec3::ZERO,
            ..self
        }
    }

    /// Whether every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.force.is_finite() && self.torque.is_finite()
    }
}

impl std::ops::Add for Wrench {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            force: self.force + other.force,
            torque: self.torque + other.torque,
        }
    }
}

impl std::ops::Mul<f64> for Wrench {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self {
            force: self.force * factor,
            torque: self.torque * factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_order_is_w_first_and_comes_back() {
        let pose = Pose::from_wxyz([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 2.0]).unwrap();
        assert_eq!(pose.orientation, DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0));
        assert_eq!(pose.wxyz(), [0.0, 0.0, 0.0, 1.0]);
        let p = pose.transform_point(DVec3::X);
        assert!((p - DVec3::new(0.0, 2.0, 3.0)).length() < 1e-15);
        assert!((pose.inverse_transform_point(p) - DVec3::X).length() < 1e-15);
    }

    #[test]
    fn a_pose_without_direction_or_with_nan_is_refused() {
        assert!(Pose::from_wxyz([0.0; 3], [0.0; 4]).is_none());
        assert!(Pose::from_wxyz([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]).is_none());
        assert!(Pose::from_wxyz([0.0; 3], [f64::INFINITY, 0.0, 0.0, 0.0]).is_none());
    }
}
