//! Size and inertia of a model's box.

use crate::tuning::bodies::MIN_SIDE_RATIO;
use glam::DVec3;
use spm::ModelHeader;

/// Bounding box of a model in the axes of its object, relative to the object's position, metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Extent {
    /// Middle of the box.
    pub middle: DVec3,
    /// Lengths of its sides, none below 1 % of the longest.
    pub sides: DVec3,
}

impl Extent {
    /// Box of a model at a scale; `None` for a model without a finite, positive extent.
    #[must_use]
    pub fn new(header: &ModelHeader, metres_per_unit: f64) -> Option<Self> {
        let [lower, upper] = [header.lower, header.upper].map(DVec3::from_array);
        let sides = (upper - lower) * metres_per_unit;
        let extent = Self {
            middle: (lower + upper) * (0.5 * metres_per_unit),
            sides: sides.max(DVec3::splat(MIN_SIDE_RATIO * sides.max_element())),
        };
        let sound = extent.middle.is_finite() && extent.sides.is_finite() && extent.size() > 0.0;
        sound.then_some(extent)
    }

    /// Longest side, metres.
    #[must_use]
    pub fn size(&self) -> f64 {
        self.sides.max_element()
    }

    /// Distance from its middle to a corner, metres.
    #[must_use]
    pub fn radius(&self) -> f64 {
        0.5 * self.sides.length()
    }

    /// Moments of inertia of a solid box about its middle, along its axes, kg m²:
    /// `m (b² + c²) / 12` along side a.
    #[must_use]
    pub fn moments(&self, mass_kg: f64) -> DVec3 {
        let square = self.sides * self.sides;
        (DVec3::splat(square.element_sum()) - square) * (mass_kg / 12.0)
    }
}
