//! The closest features of two bodies within a margin: branch and bound over both trees, nearer pairs first.

use super::body::{Body, gap_squared};
use super::tree_pairs::{Ending, Held, PAIR_STACK, PairWork, opens_first};
use shared::ab_tree::Child;
use shared::geometry::{
    Aabb, ClosestPair, closest_points_of_triangles, least_distance_squared_of_triangles,
};
use shared::spm::Handle;

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

/// Two subtrees or faces and a bound from below on their squared distance.
#[derive(Clone, Copy)]
struct Entry {
    gap: f64,
    a: Child,
    b: Child,
    box_a: Aabb,
    box_b: Aabb,
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
    let mut try_faces = |x: Handle, y: Handle, bound: &mut f64, work: &mut PairWork| {
        work.faces += 1;
        let (corners_a, corners_b) = (*held_a.take(a, x), *held_b.take(b, y));
        if least_distance_squared_of_triangles(corners_a, corners_b) >= *bound {
            return;
        }
        let closest = closest_points_of_triangles(corners_a, corners_b);
        if closest.distance_squared < *bound {
            *bound = closest.distance_squared;
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
        try_faces(x, y, &mut bound, &mut work);
    }
    let (Some(root_a), Some(root_b)) = (a.root(), b.root()) else {
        return ClosestFeatures {
            nearest,
            at_least: margin,
            ending: Ending::Complete,
            work,
        };
    };
    let (box_a, box_b) = (a.root_box(), b.root_box());
    let roots = Entry {
        gap: gap_squared(&box_a, &box_b),
        a: root_a,
        b: root_b,
        box_a,
        box_b,
    };
    let mut stack = [roots; PAIR_STACK];
    let mut count = 1;
    let mut ending = Ending::Complete;
    while count > 0 {
        count -= 1;
        let entry = stack[count];
        if entry.gap >= bound {
            continue;
        }
        if let (Child::Face(x), Child::Face(y)) = (entry.a, entry.b) {
            try_faces(x, y, &mut bound, &mut work);
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
            [0, 1].map(|k| Entry {
                gap: gap_squared(&boxes[k], &entry.box_b),
                a: children[k],
                box_a: boxes[k],
                ..entry
            })
        } else if let Child::Node(node) = entry.b {
            let (children, boxes) = b.children(node);
            [0, 1].map(|k| Entry {
                gap: gap_squared(&entry.box_a, &boxes[k]),
                b: children[k],
                box_b: boxes[k],
                ..entry
            })
        } else {
            continue;
        };
        let near = usize::from(pairs[1].gap < pairs[0].gap);
        for pair in [pairs[1 - near], pairs[near]] {
            if pair.gap < bound {
                stack[count] = pair;
                count += 1;
            }
        }
    }
    // What is left open, and what was found; nothing else is nearer than the margin.
    let open = stack[..count]
        .iter()
        .fold(bound, |least, entry| least.min(entry.gap));
    ClosestFeatures {
        nearest,
        at_least: (open.sqrt() * (1.0 - f64::EPSILON)).min(margin),
        ending,
        work,
    }
}
