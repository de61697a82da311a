//! The pairs of faces of two bodies whose boxes are within a margin of each other: what a tool is held against for as
//! long as it moves less than that.

use super::Body;
use super::tree_pairs::{Ending, PAIR_STACK, PairWork, opens_first};
use glam::DVec3;
use shared::ab_tree::Child;
use shared::geometry::{Aabb, BoxBound, BoxQuery};
use shared::spm::{Handle, NONE};
use std::ops::ControlFlow;

/// Two subtrees or faces whose boxes were found to be near.
#[derive(Clone, Copy)]
struct Entry {
    a: Child,
    b: Child,
    box_a: BoxQuery,
    box_b: BoxQuery,
}

/// The slabs of a face along its way: across it, and across its longest edge in its plane. A box around a long face that lies askew
/// holds far more than the face is near.
struct Slabs {
    face: Handle,
    /// Direction, its absolute value, and the range of the face along it.
    slabs: [(DVec3, DVec3, f64, f64); 2],
}

impl Slabs {
    fn new() -> Self {
        Self {
            face: NONE,
            slabs: [(DVec3::ZERO, DVec3::ZERO, 0.0, 0.0); 2],
        }
    }

    fn take(&mut self, body: &impl Body, face: Handle) {
        if self.face == face {
            return;
        }
        self.face = face;
        let (corners, ends) = (body.corners(face), body.ends(face));
        let [a, b, c] = corners;
        let longest = [b - a, c - b, a - c].into_iter().fold(DVec3::ZERO, |l, e| {
            if e.length_squared() > l.length_squared() {
                e
            } else {
                l
            }
        });
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let across = normal.cross(longest).normalize_or_zero();
        self.slabs = [normal, across].map(|direction| {
            let [p, q, r] = corners.map(|corner| direction.dot(corner));
            let [s, t, u] = ends.map(|corner| direction.dot(corner));
            let low = p.min(q).min(r).min(s).min(t).min(u);
            let high = p.max(q).max(r).max(s).max(t).max(u);
            (direction, direction.abs(), low, high)
        });
    }

    /// Whether a box is farther than a margin from one of them, beyond rounding.
    fn miss(&self, aabb: &Aabb, margin: f64) -> bool {
        let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
        let (centre, half) = (0.5 * (lower + upper), 0.5 * (upper - lower));
        self.slabs.iter().any(|(direction, absolute, low, high)| {
            let at = direction.dot(centre);
            let rounding = ROUNDING * absolute.dot(centre.abs() + half);
            let reach = absolute.dot(half) + margin + rounding;
            at - reach > *high || at + reach < *low
        })
    }
}

/// Relative rounding of a place along a direction and of the direction's length, generously.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Calls `visit` with every pair of faces within `margin` (units of the query's frame), and some that are not much farther,
/// in tree order. The faces of `b` are taken at every place of their straight way from [`Body::corners`] to [`Body::ends`].
///
/// `visit` breaks, or returns the margin from then on (not negative), so that whoever has no room left goes on with a
/// smaller one. It ends when `budget` pairs of nodes were visited.
pub fn for_each_near_pair<A: Body, B: Body>(
    a: &A,
    b: &B,
    margin: f64,
    budget: u32,
    mut visit: impl FnMut(Handle, Handle) -> ControlFlow<(), f64>,
) -> (Ending, PairWork) {
    let mut work = PairWork::default();
    let (Some(root_a), Some(root_b)) = (a.root(), b.root()) else {
        return (Ending::Complete, work);
    };
    let mut margin = margin;
    let mut bound = BoxBound::squared(margin * margin);
    let roots = Entry {
        a: root_a,
        b: root_b,
        box_a: BoxQuery::around(&a.root_box()),
        box_b: BoxQuery::around(&b.root_box()),
    };
    let mut stack = [roots; PAIR_STACK];
    let mut count = 1;
    let mut slabs = Slabs::new();
    while count > 0 {
        count -= 1;
        let entry = stack[count];
        if let (Child::Face(x), Child::Face(y)) = (entry.a, entry.b) {
            work.faces += 1;
            let ControlFlow::Continue(wanted) = visit(x, y) else {
                let unvisited = count as u32;
                return (Ending::Stopped { unvisited }, work);
            };
            if wanted != margin {
                margin = wanted;
                bound = BoxBound::squared(margin * margin);
            }
            continue;
        }
        if work.node_pairs == budget {
            let unvisited = count as u32 + 1;
            return (Ending::OutOfBudget { unvisited }, work);
        }
        work.node_pairs += 1;
        work.boxes += 2;
        let (near, pairs) =
            if let Some(node) = opens_first(entry.a, entry.b, &entry.box_a, &entry.box_b) {
                let (children, boxes) = a.children(node);
                let queries = boxes.queries();
                let within = boxes.within(&entry.box_b, bound);
                let mut near = [within.first(), within.second()];
                if let Child::Face(face) = entry.b
                    && near != [false; 2]
                {
                    slabs.take(b, face);
                    for k in [0, 1] {
                        near[k] = near[k] && !slabs.miss(&boxes.get(k), margin);
                    }
                }
                let pair = |k: usize| Entry {
                    a: children[k],
                    box_a: queries[k],
                    ..entry
                };
                (near, [pair(0), pair(1)])
            } else if let Child::Node(node) = entry.b {
                let (children, boxes) = b.children(node);
                let queries = boxes.queries();
                let pair = |k: usize| Entry {
                    b: children[k],
                    box_b: queries[k],
                    ..entry
                };
                let within = boxes.within(&entry.box_a, bound);
                ([within.first(), within.second()], [pair(0), pair(1)])
            } else {
                continue;
            };
        if near[1] {
            stack[count] = pairs[1];
            count += 1;
        }
        if near[0] {
            stack[count] = pairs[0];
            count += 1;
        }
    }
    (Ending::Complete, work)
}
