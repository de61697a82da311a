//! A box beside a slanting segment: the box of such a segment holds far more than the segment meets, so what is normal to
//! the segment and to an edge of the box is asked, too.

use glam::DVec3;

/// Relative rounding of places, and of a separating plane's two sides, generously.
pub(super) const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// How far a box is from a segment along `way` x X, `way` x Y and `way` x Z, times the lengths of these; 0 where that is not
/// beyond rounding. `between` leads from a point of the segment's line to the centre of the box, `half` from there to its
/// upper corner.
#[inline]
pub(super) fn gaps_beside(between: DVec3, half: DVec3, way: DVec3) -> DVec3 {
    let (along, apart) = (way.abs(), between.abs());
    let gap = |one: usize, other: usize| {
        let product = between[one] * way[other] - between[other] * way[one];
        let most = half[one] * along[other] + half[other] * along[one];
        let rounding = apart[one] * along[other] + apart[other] * along[one];
        (product.abs() - most - ROUNDING * (most + rounding)).max(0.0)
    };
    DVec3::new(gap(1, 2), gap(2, 0), gap(0, 1))
}
