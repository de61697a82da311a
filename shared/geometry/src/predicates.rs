//! Exact signs of side and shape (Shewchuk 1997, crate `robust`).

use glam::DVec3;
use robust::{Coord, Coord3D, orient2d, orient3d};
use std::cmp::Ordering;

fn coord3(p: DVec3) -> Coord3D<f64> {
    Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    }
}

/// Side of `point` with respect to the plane through a counterclockwise triangle:
/// `Greater` on the side the normal points to, `Equal` exactly on the plane.
#[must_use]
pub fn side_of_plane(a: DVec3, b: DVec3, c: DVec3, point: DVec3) -> Ordering {
    // Shewchuk's orient3d is positive when the point lies below a counterclockwise triangle.
    let sign = -orient3d(coord3(a), coord3(b), coord3(c), coord3(point));
    sign.partial_cmp(&0.0).unwrap_or(Ordering::Equal)
}

/// Whether three points are exactly on one line: their projections on all three axis planes are.
#[must_use]
pub fn triangle_is_degenerate(a: DVec3, b: DVec3, c: DVec3) -> bool {
    let flat = |x: fn(DVec3) -> f64, y: fn(DVec3) -> f64| {
        let p = |v: DVec3| Coord { x: x(v), y: y(v) };
        orient2d(p(a), p(b), p(c)) == 0.0
    };
    flat(|v| v.x, |v| v.y) && flat(|v| v.y, |v| v.z) && flat(|v| v.z, |v| v.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_side_is_exact_next_to_the_plane() {
        let (a, b, c) = (DVec3::ZERO, DVec3::X, DVec3::Y);
        assert_eq!(side_of_plane(a, b, c, DVec3::Z), Ordering::Greater);
        assert_eq!(
            side_of_plane(a, b, c, DVec3::new(0.3, 0.3, -f64::MIN_POSITIVE)),
            Ordering::Less
        );
        assert_eq!(
            side_of_plane(a, b, c, DVec3::new(7.0, -3.0, 0.0)),
            Ordering::Equal
        );
    }

    #[test]
    fn a_line_of_points_is_degenerate_and_a_sliver_is_not() {
        let d = DVec3::new(1.0, 2.0, 3.0);
        assert!(triangle_is_degenerate(DVec3::ZERO, d, d * 2.0));
        assert!(!triangle_is_degenerate(
            DVec3::ZERO,
            d,
            d * 2.0 + DVec3::new(0.0, 0.0, 1e-15)
        ));
    }
}
