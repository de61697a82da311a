//! The closest features of two bodies within a margin: branch and bound over both trees, nearer pairs first.

use super::body::Body;
use super::tree_pairs::{Ending, Held, PAIR_STACK, PairWork, opens_first};
use ab_tree::Child;
use geometry::{
    BoxQuery, ClosestPair, closest_points_of_triangles, least_distance_squared_of_triangles,
};
use glam::DVec3;
use spm::Handle;

/// The closest points of two bodies and the faces that they lie on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// The face of the first body.
    pub a: Handle,
    /// The face of the second body.
    pub b: Handle,
    /// A point on each; distance 0 exactly where the faces meet.
    pub closest: ClosestPair,
}

/// The answer of [`closest_features`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestFeatures {
    /// The closest found within the margin.
    pub nearest: Option<Features>,
    /// The surfaces are nowhere nearer than this, whatever the ending; units of the query's frame.
    pub at_least: f64,
    /// Whether the nearest is the nearest of all.
    pub ending: Ending,
    /// What it cost.
    pub work: PairWork,
}

/// The way from the first body's closest point to the second's: faces that are as far apart along it are not nearer.
/// Any direction bounds the distance; this one is mostly the best.
#[derive(Clone, Copy)]
struct Way {
    /// Unit length, or zero for none.
    direction: DVec3,
    absolute: DVec3,
}

impl Way {
    const NONE: Self = Self {
        direction: DVec3::ZERO,
        absolute: DVec3::ZERO,
    };

    fn between([from, to]: [DVec3; 2]) -> Self {
        let direction = (to - from).normalize_or_zero();
        Self {
            direction,
            absolute: direction.abs(),
        }
    }

    /// Squared gap of two triangles along the way, at most what it is in truth; 0 where they overlap along it.
    #[inline]
    fn gap_squared_of_triangles(&self, a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
        let offsets = [a[1], a[2], b[0], b[1], b[2]].map(|p| p - a[0]);
        let [a1, a2, b0, b1, b2] = offsets.map(|p| self.direction.dot(p));
        let reach = offsets
            .iter()
            .fold(DVec3::ZERO, |most, p| most.max(p.abs()));
        self.gap(
            b0.min(b1).min(b2) - a1.max(a2).max(0.0),
            self.absolute.dot(reach) + self.absolute.dot(a[0].abs()),
        )
    }

    /// Less the rounding of numbers of a size, and of the direction's own length.
    #[inline]
    fn gap(&self, gap: f64, size: f64) -> f64 {
        let gap = (gap - 16.0 * f64::EPSILON * size).max(0.0) * (1.0 - 4.0 * f64::EPSILON);
        gap * gap
    }
}

/// Two subtrees or faces and a bound from below on their squared distance.
#[derive(Clone, Copy)]
struct Entry {
    gap: f32,
    a: Child,
    b: Child,
    box_a: BoxQuery,
    box_b: BoxQuery,
}

/// The closest features of two bodies, if they are within `margin` (units of the query's frame; not a number
/// counts as 0).
///
/// `hint`, the faces of the last tick's answer, gives the first bound. When `budget` pairs of nodes were visited
/// the ending says so and `at_least` still bounds the distance from below. One body inside the other is not seen:
/// this is the distance of surfaces.
#[must_use]
pub fn closest_features<A: Body, B: Body>(
    a: &A,
    b: &B,
    margin: f64,
    budget: u32,
    hint: Option<(Handle, Handle)>,
) -> ClosestFeatures {
    let margin = margin.max(0.0);
    // What is exactly at the margin is within it.
    let mut bound = (margin * margin).next_up();
    let mut nearest: Option<Features> = None;
    let mut work = PairWork::default();
    let (mut held_a, mut held_b) = (Held::new(), Held::new());
    let mut way = Way::NONE;
    let mut try_faces = |x: Handle, y: Handle, bound: &mut f64, way: &mut Way| {
        let corners_a = *held_a.take(x, || a.corners(x));
        let corners_b = *held_b.take(y, || b.corners(y));
        if way.gap_squared_of_triangles(&corners_a, &corners_b) >= *bound
            || least_distance_squared_of_triangles(corners_a, corners_b) >= *bound
        {
            return;
        }
        let closest = closest_points_of_triangles(corners_a, corners_b);
        if closest.distance_squared < *bound {
            *bound = closest.distance_squared;
            *way = Way::between(closest.points);
            nearest = Some(Features {
                a: x,
                b: y,
                closest,
            });
        }
    };
    if let Some((x, y)) = hint
        && a.has(x)
        && b.has(y)
    {
        work.faces += 1;
        try_faces(x, y, &mut bound, &mut way);
    }
    let (Some(root_a), Some(root_b)) = (a.root(), b.root()) else {
        return ClosestFeatures {
            nearest,
            at_least: margin,
            ending: Ending::Complete,
            work,
        };
    };
    let roots = Entry {
        gap: 0.0,
        a: root_a,
        b: root_b,
        box_a: BoxQuery::around(&a.root_box()),
        box_b: BoxQuery::around(&b.root_box()),
    };
    let mut stack = [roots; PAIR_STACK];
    let mut count = 1;
    let mut ending = Ending::Complete;
    while count > 0 {
        count -= 1;
        let entry = stack[count];
        // The bound may have come down since.
        if f64::from(entry.gap) >= bound {
            continue;
        }
        if let (Child::Face(x), Child::Face(y)) = (entry.a, entry.b) {
            work.faces += 1;
            try_faces(x, y, &mut bound, &mut way);
            continue;
        }
        if work.node_pairs == budget {
            count += 1;
            let unvisited = count as u32;
            ending = Ending::OutOfBudget { unvisited };
            break;
        }
        work.node_pairs += 1;
        work.boxes += 2;
        let pairs = if let Some(node) = opens_first(entry.a, entry.b, &entry.box_a, &entry.box_b) {
            let (children, boxes) = a.children(node);
            let (gaps, queries) = (boxes.distances_squared(&entry.box_b), boxes.queries());
            [0, 1].map(|k| Entry {
                gap: gaps[k],
                a: children[k],
                box_a: queries[k],
                ..entry
            })
        } else if let Child::Node(node) = entry.b {
            let (children, boxes) = b.children(node);
            let (gaps, queries) = (boxes.distances_squared(&entry.box_a), boxes.queries());
            [0, 1].map(|k| Entry {
                gap: gaps[k],
                b: children[k],
                box_b: queries[k],
                ..entry
            })
        } else {
            continue;
        };
        let near = usize::from(pairs[1].gap < pairs[0].gap);
        for pair in [pairs[1 - near], pairs[near]] {
            if f64::from(pair.gap) < bound {
                stack[count] = pair;
                count += 1;
            }
        }
    }
    // What is left open, and what was found; nothing else is nearer than the margin.
    let open = stack[..count]
        .iter()
        .fold(bound, |least, entry| least.min(f64::from(entry.gap)));
    ClosestFeatures {
        nearest,
        at_least: (open.sqrt() * (1.0 - f64::EPSILON)).min(margin),
        ending,
        work,
    }
}
