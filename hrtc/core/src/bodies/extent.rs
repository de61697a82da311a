//! Size and inertia of a model's box.

use glam::DVec3;
use spm::ModelHeader;

/// The thinnest that a side counts as, as a share of the longest: a sheet, too, resists being turned in its plane.
const MIN_THICKNESS: f64 = 1e-2;

/// The box of a model, in the axes of the object's pose, seen from its position, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Its middle.
    pub middle: DVec3,
    /// Its sides.
    pub sides: DVec3,
}

impl Extent {
    /// Of a model at its scale; `None` when it has no extent.
    #[must_use]
    pub fn new(header: &ModelHeader, metres_per_unit: f64) -> Option<Self> {
        let [lower, upper] = [header.lower, header.upper].map(DVec3::from_array);
        let sides = (upper - lower) * metres_per_unit;
        let extent = Self {
            middle: (lower + upper) * (0.5 * metres_per_unit),
            sides: sides.max(DVec3::splat(MIN_THICKNESS * sides.max_element())),
        };
        let sound = extent.middle.is_finite() && extent.sides.is_finite() && extent.size() > 0.0;
        sound.then_some(extent)
    }

    /// Its longest side.
    #[must_use]
    pub fn size(&self) -> f64 {
        self.sides.max_element()
    }

    /// From its middle to a corner.
    #[must_use]
    pub fn radius(&self) -> f64 {
        0.5 * self.sides.length()
    }

    /// Moments of inertia of a solid box of a mass about its middle, along its axes, kg m².
    #[must_use]
    pub fn moments(&self, mass_kg: f64) -> DVec3 {
        let square = self.sides * self.sides;
        (DVec3::splat(square.element_sum()) - square) * (mass_kg / 12.0)
    }
}
