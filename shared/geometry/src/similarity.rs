//! Frames with a scale: from an object's units to the world, and from one object to another.

use super::{Aabb, Pose};
use glam::{DMat3, DVec3, Vec3A};

/// Rotation, uniform scale and translation, from one frame to another.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Similarity {
    /// Rotation times scale.
    linear: DMat3,
    scale: f64,
    translation: DVec3,
}

impl Similarity {
    /// The identity.
    pub const IDENTITY: Self = Self {
        linear: DMat3::IDENTITY,
        scale: 1.0,
        translation: DVec3::ZERO,
    };

    /// From a model's frame to the world's: metres per unit of the model, then the pose.
    ///
    /// `None` when a number is not finite, the scale is not positive or the orientation has no
    /// direction.
    #[must_use]
    pub fn new(pose: Pose, metres_per_unit: f64) -> Option<Self> {
        let length = pose.orientation.length();
        let usable = pose.is_finite()
            && length.is_normal()
            && metres_per_unit.is_normal()
            && metres_per_unit > 0.0;
        let rotation = DMat3::from_quat(pose.orientation.normalize());
        let similarity = Self {
            linear: rotation * metres_per_unit,
            scale: metres_per_unit,
            translation: pose.position,
        };
        (usable && similarity.is_finite()).then_some(similarity)
    }

    /// From the frame of `b` to the frame of `a`, both given in the world. Their positions are
    /// subtracted first, so objects far from the world's origin lose no precision.
    #[must_use]
    pub fn relative(a: &Self, b: &Self) -> Option<Self> {
        let back = a.linear.transpose() * (1.0 / (a.scale * a.scale));
        let similarity = Self {
            linear: back * b.linear,
            scale: b.scale / a.scale,
            translation: back * (b.translation - a.translation),
        };
        (similarity.is_finite() && similarity.scale > 0.0).then_some(similarity)
    }

    fn is_finite(&self) -> bool {
        self.linear.is_finite() && self.translation.is_finite() && self.scale.is_finite()
    }

    /// Length of a unit of the inner frame in units of the outer one.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// A point in the outer frame.
    #[inline]
    #[must_use]
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.linear * point + self.translation
    }

    /// A direction and length in the outer frame.
    #[inline]
    #[must_use]
    pub fn vector(&self, vector: DVec3) -> DVec3 {
        self.linear * vector
    }

    /// A box of the outer frame around a box, rounded outwards: it contains [`Similarity::point`]
    /// of every point.
    #[inline]
    #[must_use]
    pub fn box_around(&self, aabb: &Aabb) -> Aabb {
        let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
        let (centre, half) = (0.5 * (lower + upper), 0.5 * (upper - lower));
        let about = self.linear * centre;
        let absolute = self.linear.abs();
        let extent = absolute * half;
        // Rounding of three products and a translation, for a point and for the centre.
        let size = absolute * centre.abs() + extent + self.translation.abs();
        let half = extent + 16.0 * f64::EPSILON * size;
        let centre = about + self.translation;
        widened((centre - half).as_vec3a(), (centre + half).as_vec3a())
    }
}

/// The box of corners that were rounded to f32, widened by twice that rounding, so that it contains
/// the f64 corners.
#[inline]
#[must_use]
pub fn widened(lower: Vec3A, upper: Vec3A) -> Aabb {
    // The smallest normal number covers the rounding of subnormal ones.
    let rounding = |p: Vec3A| p.abs() * f32::EPSILON + f32::MIN_POSITIVE;
    Aabb {
        lower: (lower - rounding(lower)).into(),
        upper: (upper + rounding(upper)).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    fn similarity() -> impl Strategy<Value = Similarity> {
        let turn = prop::array::uniform4(-1.0..1.0f64);
        (vector(), turn, -6..6i32, 0..7i32).prop_filter_map(
            "the quaternion has a direction",
            |(position, turn, exponent, offset)| {
                let pose = Pose {
                    position: position * 10f64.powi(offset),
                    orientation: DQuat::from_array(turn).normalize(),
                };
                Similarity::new(pose, 10f64.powi(exponent))
            },
        )
    }

    proptest! {
        /// A box goes to a box around everything in it, and not to a much larger one.
        #[test]
        fn a_box_holds_its_points(
            s in similarity(), a in vector(), b in vector(),
            inside in prop::array::uniform3(0.0..=1.0f64),
        ) {
            let (a, b) = (a.as_vec3(), b.as_vec3());
            let aabb = Aabb { lower: a.min(b), upper: a.max(b) };
            let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
            let moved = s.box_around(&aabb);
            let corner = |k: u32| {
                let side = |axis: u32| f64::from(k >> axis & 1);
                lower + (upper - lower) * DVec3::new(side(0), side(1), side(2))
            };
            let within = s.point(lower + (upper - lower) * DVec3::from_array(inside));
            for p in (0..8).map(|k| s.point(corner(k))).chain([within]) {
                prop_assert!(moved.lower.as_dvec3().cmple(p).all());
                prop_assert!(moved.upper.as_dvec3().cmpge(p).all());
            }
            let size = aabb.diagonal() * s.scale();
            let rounding = 1e-6 * (s.translation.length() + 2.0 * s.scale());
            prop_assert!(moved.diagonal() <= 3f64.sqrt() * size + rounding);
        }

        #[test]
        fn the_relative_frame_is_there_and_back(
            a in similarity(), b in similarity(), p in vector(),
        ) {
            let relative = Similarity::relative(&a, &b).unwrap();
            let (direct, there) = (b.point(p), a.point(relative.point(p)));
            let offsets = a.translation.length() + b.translation.length();
            let size = 1e-12 * (direct.length() + offsets + 1.0);
            prop_assert!(direct.distance(there) <= size);
        }
    }

    #[test]
    fn impossible_frames_are_refused() {
        let good = Pose::at(DVec3::X);
        let with = |position, orientation| Pose {
            position,
            orientation,
        };
        assert!(Similarity::new(good, 1.0).is_some());
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
            assert!(Similarity::new(good, scale).is_none(), "{scale}");
        }
        let turn = DQuat::IDENTITY;
        let lost = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        assert!(Similarity::new(with(DVec3::NAN, turn), 1.0).is_none());
        assert!(Similarity::new(with(DVec3::INFINITY, turn), 1.0).is_none());
        assert!(Similarity::new(with(DVec3::ZERO, lost), 1.0).is_none());
    }

    #[test]
    fn a_widened_box_contains_the_rounded_point() {
        for x in [0.1f64, -0.1, 1e-46, -1e-46, 1e-40, 1e38, -1e38, 0.5, 0.0] {
            let near = DVec3::splat(x).as_vec3a();
            let aabb = widened(near, near);
            assert!(
                f64::from(aabb.lower.x) <= x && f64::from(aabb.upper.x) >= x,
                "{x}"
            );
            assert!(aabb.diagonal() <= 1e-6 * x.abs() + 1e-37, "{x}");
        }
    }
}
