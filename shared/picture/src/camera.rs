//! Where a picture is seen from.

use glam::DVec3;

/// Distance of the eye, in half widths of what is seen: so far that lengths in the picture hardly
/// change with depth, near enough that depth is seen.
pub(crate) const EYE_DISTANCE: f64 = 8.0;

/// An eye that looks at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    target: DVec3,
    /// Right, down and away from the eye: the axes of the view.
    axes: [DVec3; 3],
    half_width: f64,
}

impl Camera {
    /// Looks at a point from a direction: `eye` points from there to the eye, `up` is as upright in
    /// the picture as it can be. `half_width`: half of what is seen beside the point, from the left
    /// to the right, in the unit of the points.
    #[must_use]
    pub fn new(target: DVec3, eye: DVec3, up: DVec3, half_width: f64) -> Self {
        let away = -eye.normalize_or(DVec3::Z);
        let right = away.cross(up).normalize_or(away.any_orthonormal_vector());
        Self {
            target,
            axes: [right, away.cross(right), away],
            half_width,
        }
    }

    /// Half of what is seen beside the target, in the unit of the points.
    #[must_use]
    pub fn half_width(&self) -> f64 {
        self.half_width
    }

    /// The direction from the target to the eye.
    #[must_use]
    pub fn eye(&self) -> DVec3 {
        -self.axes[2]
    }

    /// A point as the view sees it: right, down and away from the eye, in half widths.
    pub(crate) fn view(&self, point: DVec3) -> DVec3 {
        let offset = (point - self.target) / self.half_width;
        let along = |axis: usize| self.axes[axis].dot(offset);
        DVec3::new(along(0), along(1), along(2) + EYE_DISTANCE)
    }

    /// Where a point is in a picture of so many pixels: from the left, from above; `None` behind
    /// the eye.
    #[must_use]
    pub fn pixel(&self, point: DVec3, width: u32, height: u32) -> Option<(f64, f64)> {
        let view = self.view(point);
        let half = 0.5 * f64::from(width);
        let scale = half * EYE_DISTANCE / view.z;
        let place = (
            half + scale * view.x,
            0.5 * f64::from(height) + scale * view.y,
        );
        (view.z > 0.0).then_some(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_in_the_middle_and_up_is_up() {
        let camera = Camera::new(DVec3::ONE, DVec3::X, DVec3::Z, 2.0);
        assert_eq!(camera.pixel(DVec3::ONE, 200, 100), Some((100.0, 50.0)));
        let above = camera.pixel(DVec3::ONE + DVec3::Z, 200, 100);
        assert_eq!(above, Some((100.0, 0.0)));
        // Seen against x, y goes to the right.
        let right = camera.pixel(DVec3::ONE + 2.0 * DVec3::Y, 200, 100);
        assert_eq!(right, Some((200.0, 50.0)));
        assert_eq!(camera.pixel(DVec3::X * 100.0, 200, 100), None);
    }
}
