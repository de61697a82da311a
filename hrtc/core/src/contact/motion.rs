//! Rigid placements and motions of a tool about its centre.

use geometry::portable::{rotation, rotation_vector};
use glam::{DMat3, DQuat, DVec3};

/// A translation of the centre and a rotation about it: a screw in exponential coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Twist {
    /// Displacement of the centre, model units.
    pub linear: DVec3,
    /// Rotation vector in the model's axes, rad.
    pub angular: DVec3,
}

impl Twist {
    /// A share of it.
    #[must_use]
    pub fn times(self, share: f64) -> Self {
        Self {
            linear: self.linear * share,
            angular: self.angular * share,
        }
    }

    /// The composition, for small motions.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            linear: self.linear + other.linear,
            angular: self.angular + other.angular,
        }
    }

    /// The difference.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Self {
        Self {
            linear: self.linear - other.linear,
            angular: self.angular - other.angular,
        }
    }

    /// Bound of the displacement of points within `radius` of the centre.
    #[must_use]
    pub fn farthest(&self, radius: f64) -> f64 {
        self.linear.length() + self.angular.length() * radius
    }

    /// Bound of the deviation of points within `radius` of the centre from the straight line
    /// between start and end.
    #[must_use]
    pub fn sagitta(&self, radius: f64) -> f64 {
        0.125 * radius * self.angular.length_squared()
    }
}

/// Placement of a tool: its centre and its axes in the model.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Placement {
    /// Centre, model units.
    pub centre: DVec3,
    /// Unit quaternion.
    pub orientation: DQuat,
}

impl Placement {
    /// The origin of the model.
    pub(crate) const NOWHERE: Self = Self {
        centre: DVec3::ZERO,
        orientation: DQuat::IDENTITY,
    };

    /// The motion to another placement, by the shorter rotation.
    #[must_use]
    pub fn to(&self, there: &Self) -> Twist {
        Twist {
            linear: there.centre - self.centre,
            angular: rotation_vector(there.orientation * self.orientation.conjugate()),
        }
    }

    /// The placement after a motion.
    #[must_use]
    pub fn moved(&self, twist: &Twist) -> Self {
        Self {
            centre: self.centre + twist.linear,
            orientation: (rotation(twist.angular) * self.orientation).normalize(),
        }
    }

    /// The axes as a matrix.
    #[must_use]
    pub fn rotation(&self) -> DMat3 {
        DMat3::from_quat(self.orientation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn the_motion_there_leads_there(
            a in vector(), b in vector(), turn in vector(), motion in vector(), exponent in -12..1i32,
        ) {
            let here = Placement { centre: a, orientation: DQuat::from_scaled_axis(turn) };
            let twist = Twist { linear: b, angular: motion * 10f64.powi(exponent) };
            let found = here.to(&here.moved(&twist));
            prop_assert!(found.linear.distance(twist.linear) < 1e-15);
            // Quaternions of unit length are good to their rounding.
            prop_assert!(found.angular.distance(twist.angular) < 2e-15);
        }

        #[test]
        fn no_point_leaves_its_chord_by_more_than_the_sagitta(
            linear in vector(), angular in vector(), arm in vector(), share in 0.0..1.0f64,
        ) {
            let twist = Twist { linear, angular };
            let start = Placement { centre: DVec3::ZERO, orientation: DQuat::IDENTITY };
            let at = |t: f64| {
                let place = start.moved(&twist.times(t));
                place.centre + place.rotation() * arm
            };
            let chord = at(0.0).lerp(at(1.0), share);
            prop_assert!(at(share).distance(chord) <= twist.sagitta(arm.length()) + 1e-14);
            prop_assert!(at(share).distance(at(0.0)) <= twist.farthest(arm.length()) + 1e-14);
        }
    }
}
