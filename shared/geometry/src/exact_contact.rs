//! Contact of points, segments and triangles that share a plane or a line: exact, slow and rare.
//!
//! Within a plane one axis is dropped, so signs are those of `orient2d` on stored coordinates.

use super::TrianglePair;
use super::predicates::{side_of_plane, triangle_is_degenerate};
use glam::{DVec2, DVec3};
use robust::{Coord, orient2d};
use std::cmp::Ordering::{Equal, Greater, Less};

/// The ends of an intersection; equal for a point.
pub(super) type Ends = [DVec3; 2];

/// Twice the signed area of a triangle of the plane; the sign is exact.
fn orientation(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let coord = |p: DVec2| Coord { x: p.x, y: p.y };
    orient2d(coord(a), coord(b), coord(c))
}

/// Projection of a plane along one axis.
#[derive(Clone, Copy)]
struct View {
    axis: usize,
}

impl View {
    /// The projection in which a triangle is largest; `None` for one without area.
    fn of(t: [DVec3; 3]) -> Option<Self> {
        let normal = (t[1] - t[0]).cross(t[2] - t[0]).abs();
        let largest = if normal.x >= normal.y && normal.x >= normal.z {
            0
        } else if normal.y >= normal.z {
            1
        } else {
            2
        };
        [largest, (largest + 1) % 3, (largest + 2) % 3]
            .into_iter()
            .map(|axis| Self { axis })
            .find(|view| view.orientation(t[0], t[1], t[2]) != 0.0)
    }

    fn at(self, p: DVec3) -> DVec2 {
        match self.axis {
            0 => DVec2::new(p.y, p.z),
            1 => DVec2::new(p.z, p.x),
            _ => DVec2::new(p.x, p.y),
        }
    }

    fn orientation(self, a: DVec3, b: DVec3, c: DVec3) -> f64 {
        orientation(self.at(a), self.at(b), self.at(c))
    }
}

/// The corners of the intersection of two convex figures of a plane: corners of one in the other,
/// and crossings of edges. Their selection is exact, so none is lost to rounding; only the
/// crossings are rounded.
struct Shared {
    corners: [DVec3; 15],
    count: usize,
}

impl Shared {
    /// Intersection of two figures, each a point, a segment or a triangle in the plane of the view.
    fn new(view: View, a: &[DVec3], b: &[DVec3]) -> Self {
        let mut shared = Self {
            corners: [DVec3::ZERO; 15],
            count: 0,
        };
        for (one, other) in [(a, b), (b, a)] {
            for &corner in one {
                if contains_point(view, other, corner) {
                    shared.push(corner);
                }
            }
        }
        for [p, q] in edges(a) {
            for [r, s] in edges(b) {
                let (of_p, of_q) = (view.orientation(r, s, p), view.orientation(r, s, q));
                let (of_r, of_s) = (view.orientation(p, q, r), view.orientation(p, q, s));
                let opposite = |x: f64, y: f64| (x < 0.0 && y > 0.0) || (x > 0.0 && y < 0.0);
                if opposite(of_p, of_q) && opposite(of_r, of_s) {
                    shared.push(p.lerp(q, of_p / (of_p - of_q)));
                }
            }
        }
        shared
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    fn centre(&self) -> DVec3 {
        let sum: DVec3 = self.corners[..self.count].iter().sum();
        sum / self.count as f64
    }

    /// The two corners farthest from each other; `None` for an empty intersection.
    fn ends(&self) -> Option<Ends> {
        let corners = &self.corners[..self.count];
        let mut ends = [*corners.first()?; 2];
        for (k, &far) in corners.iter().enumerate() {
            for &near in &corners[..k] {
                if near.distance_squared(far) > ends[0].distance_squared(ends[1]) {
                    ends = [near, far];
                }
            }
        }
        Some(ends)
    }
}

/// The edges of a triangle, the one of a segment, none of a point.
fn edges(figure: &[DVec3]) -> impl Iterator<Item = Ends> + '_ {
    let count = if figure.len() == 3 {
        3
    } else {
        figure.len() / 2
    };
    (0..count).map(|k| [figure[k], figure[(k + 1) % figure.len()]])
}

/// Whether a closed figure contains a point of its plane.
fn contains_point(view: View, figure: &[DVec3], x: DVec3) -> bool {
    match *figure {
        [a, b, c] => {
            let inside = view.orientation(a, b, c).signum();
            edges(figure).all(|[p, q]| view.orientation(p, q, x) * inside >= 0.0)
        }
        [a, b] => {
            let (first, last) = (earlier(a, b), later(a, b));
            view.orientation(a, b, x) == 0.0 && !before(x, first) && !before(last, x)
        }
        _ => figure.contains(&x),
    }
}

/// Whether two triangles of one plane overlap in an area: no edge of one has the whole other beyond
/// it.
fn overlap(view: View, a: [DVec3; 3], b: [DVec3; 3]) -> bool {
    [(a, b), (b, a)].iter().all(|(one, other)| {
        let inside = view.orientation(one[0], one[1], one[2]).signum();
        edges(one).all(|[p, q]| {
            other
                .iter()
                .any(|&x| view.orientation(p, q, x) * inside > 0.0)
        })
    })
}

/// Two triangles of one plane, both with an area.
pub(super) fn coplanar_contact(a: [DVec3; 3], b: [DVec3; 3]) -> TrianglePair {
    let Some(view) = View::of(a) else {
        return TrianglePair::Disjoint;
    };
    let shared = Shared::new(view, &a, &b);
    match shared.ends() {
        None => TrianglePair::Disjoint,
        Some(_) if overlap(view, a, b) => TrianglePair::Coplanar {
            centre: shared.centre(),
        },
        Some([from, to]) => TrianglePair::Boundary { from, to },
    }
}

/// Intersection of a point or a segment with a triangle with an area, in its plane.
pub(super) fn contact_in_plane(part: &[DVec3], whole: [DVec3; 3]) -> Option<Ends> {
    Shared::new(View::of(whole)?, part, &whole).ends()
}

/// Intersection of a segment with a triangle with an area.
pub(super) fn contact_of_segment(p: DVec3, q: DVec3, t: [DVec3; 3]) -> Option<Ends> {
    let side = |x: DVec3| side_of_plane(t[0], t[1], t[2], x);
    match (side(p), side(q)) {
        (Equal, Equal) => contact_in_plane(&[p, q], t),
        (Equal, _) => contact_in_plane(&[p], t),
        (_, Equal) => contact_in_plane(&[q], t),
        (of_p, of_q) if of_p == of_q => None,
        _ => {
            let around = [0, 1, 2].map(|k| side_of_plane(p, q, t[k], t[(k + 1) % 3]));
            if around.contains(&Greater) && around.contains(&Less) {
                return None;
            }
            let normal = (t[1] - t[0]).cross(t[2] - t[0]);
            let near = normal.dot(p - t[0]).abs();
            let sum = near + normal.dot(q - t[0]).abs();
            let at = p.lerp(q, if sum > 0.0 { near / sum } else { 0.5 });
            Some([at, at])
        }
    }
}

/// Order along any line: by x, then y, then z.
fn before(a: DVec3, b: DVec3) -> bool {
    (a.x, a.y, a.z) < (b.x, b.y, b.z)
}

fn earlier(a: DVec3, b: DVec3) -> DVec3 {
    if before(b, a) { b } else { a }
}

fn later(a: DVec3, b: DVec3) -> DVec3 {
    if before(a, b) { b } else { a }
}

/// The ends of a triangle without area.
fn ends_of(t: [DVec3; 3]) -> Ends {
    [
        earlier(earlier(t[0], t[1]), t[2]),
        later(later(t[0], t[1]), t[2]),
    ]
}

/// Intersection of two segments; each may be a point, its ends are in order.
fn contact_of_segments([p, q]: Ends, [r, s]: Ends) -> Option<Ends> {
    let on_line = |x: DVec3, [a, b]: Ends| triangle_is_degenerate(a, b, x);
    let all_on_one_line = if p == q {
        on_line(p, [r, s])
    } else {
        on_line(r, [p, q]) && on_line(s, [p, q])
    };
    if all_on_one_line {
        let (from, to) = (later(p, r), earlier(q, s));
        return (!before(to, from)).then_some([from, to]);
    }
    // A point off the other's line meets nothing; two segments meet only within a plane.
    if p == q || r == s || side_of_plane(p, q, r, s) != Equal {
        return None;
    }
    let view = View::of([p, q, r]).or_else(|| View::of([p, q, s]))?;
    Shared::new(view, &[p, q], &[r, s]).ends()
}

/// Two triangles of which at least one has no area.
pub(super) fn contact_of_degenerate(a: [DVec3; 3], b: [DVec3; 3]) -> Option<Ends> {
    let flat = |t: [DVec3; 3]| triangle_is_degenerate(t[0], t[1], t[2]);
    let (ends_a, ends_b) = (ends_of(a), ends_of(b));
    match (flat(a), flat(b)) {
        (true, true) => contact_of_segments(ends_a, ends_b),
        (true, false) => contact_of_segment(ends_a[0], ends_a[1], b),
        (false, true) => contact_of_segment(ends_b[0], ends_b[1], a),
        (false, false) => None,
    }
}
