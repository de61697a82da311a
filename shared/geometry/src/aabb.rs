//! Axis-aligned boxes: f32, and rounded outwards whenever they come from f64.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// An axis-aligned box in the model's frame and units. An empty box has `lower > upper`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Aabb {
    /// Smallest corner.
    pub lower: Vec3,
    /// Largest corner.
    pub upper: Vec3,
}

impl Aabb {
    /// The box of nothing: it overlaps nothing and is neutral under [`Aabb::union`].
    pub const EMPTY: Self = Self {
        lower: Vec3::splat(f32::INFINITY),
        upper: Vec3::splat(f32::NEG_INFINITY),
    };

    /// The box of three stored corners, exact because they are f32.
    #[inline]
    #[must_use]
    pub fn of_triangle(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        Self {
            lower: a.min(b).min(c),
            upper: a.max(b).max(c),
        }
    }

    /// The box of any number of stored points.
    #[must_use]
    pub fn of_points(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self {
            lower: b.lower.min(p),
            upper: b.upper.max(p),
        })
    }

    /// The smallest box around both (Property 1 of thesis 3.3.1).
    #[inline]
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self {
            lower: self.lower.min(other.lower),
            upper: self.upper.max(other.upper),
        }
    }

    /// Whether the box holds no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !self.lower.cmple(self.upper).all()
    }

    /// Squared distance from a point, in f64, so rounding never hides a nearer face.
    #[inline]
    #[must_use]
    pub fn distance_squared(&self, point: DVec3) -> f64 {
        let lower = self.lower.as_dvec3();
        let upper = self.upper.as_dvec3();
        (lower - point)
            .max(point - upper)
            .max(DVec3::ZERO)
            .length_squared()
    }

    /// Length of the diagonal.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        (self.upper.as_dvec3() - self.lower.as_dvec3()).length()
    }

    /// Longest side.
    #[must_use]
    pub fn longest_side(&self) -> f64 {
        (self.upper.as_dvec3() - self.lower.as_dvec3()).max_element()
    }
}
