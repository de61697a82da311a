//! Where a picture is seen from.

use glam::DVec3;

/// Distance of the eye, in half widths of what is seen: so far that lengths in the picture hardly
/// change with depth, near enough that depth is seen.
pub(crate) const EYE_DISTANCE: f64 = 8.0;

/// Room around what is to be seen, as a multiple of its size.
const ROOM: f64 = 1.06;

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

    /// Looks from a direction so that all points are seen in a picture whose width is so many times
    /// its height, with a little room around them.
    #[must_use]
    pub fn around(
        points: impl IntoIterator<Item = DVec3>,
        eye: DVec3,
        up: DVec3,
        aspect: f64,
    ) -> Self {
        let mut camera = Self::new(DVec3::ZERO, eye, up, 1.0);
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for point in points {
            let along = DVec3::from_array(camera.axes.map(|axis| axis.dot(point)));
            (low, high) = (low.min(along), high.max(along));
        }
        let half = 0.5 * (high - low);
        if half.is_finite() {
            let middle = low + half;
            camera.target = (0..3).map(|k| camera.axes[k] * middle[k]).sum();
            // What is nearer looks larger.
            let near = half.z / EYE_DISTANCE;
            camera.half_width = ROOM * (half.x.max(half.y * aspect) + near);
        }
        camera
    }

    /// The point that it looks at.
    #[must_use]
    pub fn target(&self) -> DVec3 {
        self.target
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

    /// A vector in the picture's plane: so far to the right and down.
    pub(crate) fn along(&self, right: f64, down: f64) -> DVec3 {
        right * self.axes[0] + down * self.axes[1]
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

    #[test]
    fn all_of_a_box_is_seen_around_it() {
        let corners =
            (0..8).map(|k| DVec3::new(f64::from(k & 1), f64::from(k & 2), f64::from(k & 4)));
        for eye in [DVec3::X, DVec3::ONE, DVec3::new(-1.0, 0.3, 0.1)] {
            let camera = Camera::around(corners.clone(), eye, DVec3::Z, 2.0);
            let pixels = corners.clone().map(|p| camera.pixel(p, 200, 100).unwrap());
            let pixels: Vec<(f64, f64)> = pixels.collect();
            for (x, y) in &pixels {
                assert!(
                    (0.0..200.0).contains(x) && (0.0..100.0).contains(y),
                    "{pixels:?}"
                );
            }
            let is_far = |&(x, y): &(f64, f64)| (x - 100.0).abs() > 70.0 || (y - 50.0).abs() > 35.0;
            assert!(
                pixels.iter().any(is_far),
                "it fills the picture: {pixels:?}"
            );
        }
    }
}
