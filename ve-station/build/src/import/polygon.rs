//! Polygons into triangles: a fan where the first corner sees all others, else ears are cut off.

use crate::tuning::input::{MAX_CORNERS, MAX_FOLDED};
use robust::{Coord, orient2d};

/// A polygon has so many corners and is no fan.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct TooManyCorners(pub usize);

/// The corners of the triangles of a polygon, as places in it: two fewer than it has corners.
///
/// `None` when nothing better than the fan round the first corner is known: no area, not finite. A
/// polygon that is not flat is cut as its shadow along its mean normal is.
///
/// # Errors
/// When it has too many corners and is no fan.
pub(super) fn triangulate(points: &[[f64; 3]]) -> Result<Option<Vec<[usize; 3]>>, TooManyCorners> {
    let Some(flat) = shadow(points) else {
        return Ok(None);
    };
    let turn = |k: usize| orient2d(flat[0], flat[k - 1], flat[k]);
    let fan = 2..flat.len();
    if fan.clone().all(|k| turn(k) > 0.0) {
        return Ok(None);
    }
    if flat.len() <= MAX_CORNERS {
        return Ok(Some(cut_ears(&flat)));
    }
    // The corners of a large disk are rounded.
    let folded: f64 = fan.clone().map(|k| (-turn(k)).max(0.0)).sum();
    if folded <= MAX_FOLDED * fan.map(turn).sum::<f64>() {
        return Ok(None);
    }
    Err(TooManyCorners(flat.len()))
}

/// The polygon seen along the axis nearest to its normal, so that it turns counterclockwise.
fn shadow(points: &[[f64; 3]]) -> Option<Vec<Coord<f64>>> {
    let first = points[0];
    let from_first = |k: usize| {
        let p = points[k % points.len()];
        [p[0] - first[0], p[1] - first[1], p[2] - first[2]]
    };
    // Newell's normal: twice the area of each shadow.
    let mut normal = [0.0; 3];
    for k in 0..points.len() {
        let (p, q) = (from_first(k), from_first(k + 1));
        for (axis, along) in normal.iter_mut().enumerate() {
            let (y, z) = ((axis + 1) % 3, (axis + 2) % 3);
            *along += p[y] * q[z] - p[z] * q[y];
        }
    }
    let largest = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs()))?;
    if !normal.iter().all(|x| x.is_finite()) || normal[largest] == 0.0 {
        return None;
    }
    let (mut x, mut y) = ((largest + 1) % 3, (largest + 2) % 3);
    if normal[largest] < 0.0 {
        (x, y) = (y, x);
    }
    Some(points.iter().map(|p| Coord { x: p[x], y: p[y] }).collect())
}

/// How much is asked of an ear, in the order in which it is given up.
#[derive(Clone, Copy, PartialEq)]
enum Ear {
    /// It has area, and no other corner lies in or on it.
    Clean,
    /// It has area: the polygon crosses itself.
    Area,
    /// Anything: what is left lies on a line or turns the other way.
    Any,
}

/// Meisters' two ears, with exact signs. By hand: the crate `earcut` leaves out corners that lie on
/// a line. Here ears without area are left for last: a triangle that is dropped for having none
/// would leave a corner in the middle of its neighbour's edge.
fn cut_ears(flat: &[Coord<f64>]) -> Vec<[usize; 3]> {
    let count = flat.len();
    let mut next: Vec<usize> = (1..=count).map(|k| k % count).collect();
    let mut previous: Vec<usize> = (0..count).map(|k| (k + count - 1) % count).collect();
    let mut triangles = Vec::with_capacity(count - 2);
    let (mut at, mut since, mut wanted) = (0, 0, Ear::Clean);
    // Corners that may be looked at, to see whether they lie in an ear. A polygon that does not
    // cross itself takes about half the square; a hostile one gets a plain fan in the end.
    let mut budget = 4 * count * count;
    while triangles.len() + 2 < count {
        let left = count - triangles.len();
        let (before, after) = (previous[at], next[at]);
        let is_ear = match wanted {
            Ear::Any => true,
            Ear::Area => orient2d(flat[before], flat[at], flat[after]) > 0.0,
            Ear::Clean => budget == 0 || is_clean(flat, &next, [before, at, after], &mut budget),
        };
        if is_ear {
            triangles.push([before, at, after]);
            next[before] = after;
            previous[after] = before;
            // The corners beside the cut come next, this one and then `after`: in a thin band no
            // others are ears, and whoever goes on at `after` walks round the whole band.
            (at, since, wanted) = (before, 0, Ear::Clean);
        } else {
            since += 1;
            at = after;
            if since == left {
                since = 0;
                wanted = if wanted == Ear::Clean {
                    Ear::Area
                } else {
                    Ear::Any
                };
            }
        }
    }
    triangles
}

/// Whether the ear at `at` has area and nothing of the polygon in it. Corners at the very place of
/// one of the ear's do not count: a hole is joined to the outline by an edge that is walked twice.
/// Every corner that is looked at is taken off the budget.
fn is_clean(
    flat: &[Coord<f64>],
    next: &[usize],
    [before, at, after]: [usize; 3],
    budget: &mut usize,
) -> bool {
    let [a, b, c] = [before, at, after].map(|k| flat[k]);
    *budget = budget.saturating_sub(1);
    if orient2d(a, b, c) <= 0.0 {
        return false;
    }
    let mut other = next[after];
    while other != before {
        *budget = budget.saturating_sub(1);
        let p = flat[other];
        let in_box = p.x >= a.x.min(b.x).min(c.x)
            && p.x <= a.x.max(b.x).max(c.x)
            && p.y >= a.y.min(b.y).min(c.y)
            && p.y <= a.y.max(b.y).max(c.y);
        if in_box
            && p != a
            && p != b
            && p != c
            && orient2d(a, b, p) >= 0.0
            && orient2d(b, c, p) >= 0.0
            && orient2d(c, a, p) >= 0.0
        {
            return false;
        }
        other = next[other];
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(points: &[[f64; 3]], [a, b, c]: [usize; 3]) -> f64 {
        let [a, b, c] = [a, b, c].map(|k| points[k]);
        0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    }

    /// A line and, back again, the same line a little farther out.
    fn band(shape: &str, corners: usize) -> Vec<[f64; 3]> {
        let half = corners / 2;
        let at = |k: usize, out: f64| match shape {
            "zigzag" => [k as f64, 5.0 * (k % 2) as f64 + 0.3 * out, 0.0],
            "corrugated" => [k as f64, 5.0 * (k / 2 % 2) as f64 + 0.3 * out, 0.0],
            _ => {
                let (sin, cos) = (0.3 + 5.6 * k as f64 / half as f64).sin_cos();
                let radius = 1.0 + 0.03 * out;
                [radius * cos, radius * sin, 0.0]
            }
        };
        let inner = (0..half).map(|k| at(k, 0.0));
        inner.chain((0..half).rev().map(|k| at(k, 1.0))).collect()
    }

    #[test]
    fn a_thin_band_is_cut_without_overlap() {
        for shape in ["zigzag", "corrugated", "C"] {
            for (corners, start) in [(120, 0), (120, 40), (250, 0), (1000, 0), (1000, 333)] {
                let mut points = band(shape, corners);
                points.rotate_left(start);
                let triangles = triangulate(&points).unwrap().unwrap();
                assert_eq!(triangles.len(), corners - 2);
                let fan = (1..corners - 1).map(|k| area(&points, [0, k, k + 1]));
                let whole = fan.sum::<f64>().abs();
                let sum: f64 = triangles.iter().map(|&t| area(&points, t).abs()).sum();
                assert!(
                    (sum - whole).abs() < 1e-9 * whole,
                    "{shape} of {corners}: {sum} for {whole}"
                );
            }
        }
    }

    #[test]
    fn a_polygon_of_too_many_corners_is_refused_unless_it_is_a_fan_but_for_rounding() {
        let error = triangulate(&band("zigzag", MAX_CORNERS + 2)).unwrap_err();
        assert_eq!(error, TooManyCorners(MAX_CORNERS + 2));
        assert!(triangulate(&band("zigzag", 2000)).unwrap().is_some());
        // A disk in a text of five digits.
        let disk: Vec<[f64; 3]> = (0..10_000)
            .map(|k| {
                let (sin, cos) = (f64::from(k) / 10_000.0 * std::f64::consts::TAU).sin_cos();
                [cos, sin, 0.0].map(|x| (x * 1e5).round() / 1e5)
            })
            .collect();
        assert_eq!(triangulate(&disk).unwrap(), None);
    }

    proptest! {
        /// Star-shaped polygons, from every first corner, tilted: all triangles turn alike and add
        /// up.
        #[test]
        fn a_simple_polygon_is_cut_without_overlap(
            radii in prop::collection::vec(0.1..1.0f64, 4..40), start in 0usize..40, down: bool,
        ) {
            let count = radii.len();
            let mut points: Vec<[f64; 3]> = radii.iter().enumerate().map(|(k, radius)| {
                let angle = k as f64 / count as f64 * std::f64::consts::TAU;
                [radius * angle.cos(), radius * angle.sin(), 0.3 * radius * angle.cos()]
            }).collect();
            points.rotate_left(start % count);
            if down {
                points.reverse();
            }
            let fan = || (2..count).map(|k| [0, k - 1, k]).collect();
            let triangles = triangulate(&points).unwrap().unwrap_or_else(fan);
            prop_assert_eq!(triangles.len(), count - 2);
            let whole: f64 = (1..count - 1).map(|k| area(&points, [0, k, k + 1])).sum();
            let mut sum = 0.0;
            for &triangle in &triangles {
                let one = area(&points, triangle);
                prop_assert!(one * whole > 0.0, "{one} {whole}");
                sum += one;
            }
            prop_assert!((sum - whole).abs() < 1e-9);
        }

        #[test]
        fn any_polygon_ends_in_two_triangles_fewer_than_corners(
            points in prop::collection::vec(
                prop::array::uniform3((-2i8..3).prop_map(f64::from)),
                4..30,
            ),
        ) {
            if let Some(triangles) = triangulate(&points).unwrap() {
                prop_assert_eq!(triangles.len(), points.len() - 2);
                prop_assert!(triangles.as_flattened().iter().all(|&k| k < points.len()));
            }
        }
    }

    #[test]
    fn a_corner_in_the_middle_of_a_side_stays_a_corner() {
        // A fan round the first corner would give it a triangle without area.
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
        let triangles = triangulate(&points).unwrap().unwrap();
        assert!(
            triangles.iter().all(|&t| area(&points, t) > 0.0),
            "{triangles:?}"
        );
    }

    #[test]
    fn a_hole_joined_by_an_edge_walked_twice_stays_open() {
        let square = |r: f64| [[-r, -r, 0.0], [r, -r, 0.0], [r, r, 0.0], [-r, r, 0.0]];
        let (outer, inner) = (square(2.0), square(1.0));
        let mut points = vec![outer[0], outer[1], outer[2], outer[3], outer[0]];
        points.extend([inner[0], inner[3], inner[2], inner[1], inner[0]]);
        let triangles = triangulate(&points).unwrap().unwrap();
        let sum: f64 = triangles.iter().map(|&t| area(&points, t)).sum();
        assert!((sum - 12.0).abs() < 1e-12);
        assert!(triangles.iter().all(|&t| area(&points, t) >= 0.0));
    }
}
