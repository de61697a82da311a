//! A segment against the front: the closest point, and all faces within a distance.

use super::slanting::{ROUNDING, gaps_beside};
use super::{Ending, STACK, Surface, Work};
use ab_tree::Child;
use geometry::{Aabb, ClosestPair, closest_points_of_segment_and_triangle};
use glam::DVec3;
use spm::{Handle, NONE};
use std::ops::ControlFlow;

/// The face closest to a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestToSegment {
    /// The face.
    pub face: Handle,
    /// A point of the segment and one of the face; distance 0 exactly where the segment meets the front.
    pub closest: ClosestPair,
}

/// The answer of [`closest_to_segment`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestToSegment {
    /// The closest found; `None` for an empty front or a spent budget.
    pub nearest: Option<NearestToSegment>,
    /// No face is nearer than this, whatever the ending.
    pub at_least: f64,
    /// Whether the nearest is the nearest of all.
    pub ending: Ending,
    /// What it cost.
    pub work: Work,
}

/// Bounds from below the distance of boxes to a segment: along the axes, and along the three directions that are
/// normal to the segment and an edge of the box. The box of a slanting segment alone holds far more than the segment.
struct Reach {
    start: DVec3,
    low: DVec3,
    high: DVec3,
    way: DVec3,
    /// One over the squared lengths of way x X, way x Y, way x Z; 0 for none.
    inverse: DVec3,
}

impl Reach {
    fn new([start, end]: [DVec3; 2]) -> Self {
        let way = end - start;
        let square = way * way;
        let lengths = DVec3::new(
            square.y + square.z,
            square.z + square.x,
            square.x + square.y,
        );
        let inverse = |x: f64| if x > 0.0 { 1.0 / x } else { 0.0 };
        Self {
            start,
            low: start.min(end),
            high: start.max(end),
            way,
            inverse: DVec3::new(inverse(lengths.x), inverse(lengths.y), inverse(lengths.z)),
        }
    }

    fn distance_squared(&self, aabb: &Aabb) -> f64 {
        let (lower, upper) = (aabb.lower.as_dvec3(), aabb.upper.as_dvec3());
        let gap = (lower - self.high).max(self.low - upper).max(DVec3::ZERO);
        let half = 0.5 * (upper - lower);
        let between = 0.5 * (lower + upper) - self.start;
        let beside = gaps_beside(between, half, self.way);
        let bound = gap
            .length_squared()
            .max((beside * beside * self.inverse).max_element());
        bound * (1.0 - ROUNDING)
    }
}

/// The point of the front closest to a segment (model frame and units), depth first, the nearer child first.
///
/// `hint`, a face of the last tick's answer, gives the first bound. When `budget` nodes were visited the ending says so
/// and `at_least` still bounds the distance from below. A segment that is not finite has no closest point.
#[must_use]
pub fn closest_to_segment(
    surface: Surface<'_>,
    segment: [DVec3; 2],
    budget: u32,
    hint: Option<Handle>,
) -> ClosestToSegment {
    let mut work = Work::default();
    let mut nearest: Option<NearestToSegment> = None;
    if !segment.iter().all(|end| end.is_finite()) {
        return ClosestToSegment {
            nearest,
            at_least: 0.0,
            ending: Ending::Complete,
            work,
        };
    }
    let mut bound = f64::INFINITY;
    let mut try_face = |face: Handle, bound: &mut f64, work: &mut Work| {
        work.faces += 1;
        let corners = surface.mesh.corners(face);
        let closest = closest_points_of_segment_and_triangle(segment, corners);
        if closest.distance_squared < *bound {
            *bound = closest.distance_squared;
            nearest = Some(NearestToSegment { face, closest });
        }
    };
    if let Some(face) = hint
        && face != NONE
        && surface.mesh.is_active(face)
    {
        try_face(face, &mut bound, &mut work);
    }
    let reach = Reach::new(segment);
    let mut stack = [(0.0, Child::Node(0)); STACK];
    let mut count = 0;
    if let Some(root) = surface.tree.root() {
        stack[0] = (reach.distance_squared(surface.tree.root_box()), root);
        count = 1;
    }
    let mut ending = Ending::Complete;
    while count > 0 {
        count -= 1;
        let (distance, child) = stack[count];
        if distance >= bound {
            continue;
        }
        match child {
            Child::Face(face) => {
                if hint != Some(face) {
                    try_face(face, &mut bound, &mut work);
                }
            }
            Child::Node(_) if work.nodes == budget => {
                count += 1;
                let unvisited = count as u32;
                ending = Ending::OutOfBudget { unvisited };
                break;
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let children = node.children();
                let distances = [0, 1].map(|k| reach.distance_squared(&node.boxes().get(k)));
                let near = usize::from(distances[1] < distances[0]);
                for side in [1 - near, near] {
                    if distances[side] < bound {
                        stack[count] = (distances[side], children[side]);
                        count += 1;
                    }
                }
            }
        }
    }
    let open = stack[..count]
        .iter()
        .fold(bound, |least, &(distance, _)| least.min(distance));
    ClosestToSegment {
        nearest,
        at_least: open.sqrt() * (1.0 - f64::EPSILON),
        ending,
        work,
    }
}

/// Calls `visit` with every face whose distance to a segment is at most `distance`, until it breaks or `budget` nodes
/// were visited. No face is near a segment or at a distance that is no number, or at a negative one.
pub fn faces_near_segment(
    surface: Surface<'_>,
    segment: [DVec3; 2],
    distance: f64,
    budget: u32,
    mut visit: impl FnMut(NearestToSegment) -> ControlFlow<()>,
) -> (Ending, Work) {
    let mut work = Work::default();
    let bound = distance * distance;
    let reach = Reach::new(segment);
    let mut stack = [Child::Node(0); STACK];
    let mut count = 0;
    let is_segment = segment.iter().all(|end| end.is_finite());
    if let Some(root) = surface.tree.root()
        && is_segment
        && distance >= 0.0
    {
        stack[0] = root;
        count = 1;
    }
    while count > 0 {
        count -= 1;
        match stack[count] {
            Child::Face(face) => {
                work.faces += 1;
                let corners = surface.mesh.corners(face);
                let closest = closest_points_of_segment_and_triangle(segment, corners);
                if closest.distance_squared <= bound
                    && visit(NearestToSegment { face, closest }).is_break()
                {
                    let unvisited = count as u32;
                    return (Ending::Stopped { unvisited }, work);
                }
            }
            Child::Node(_) if work.nodes == budget => {
                let unvisited = count as u32 + 1;
                return (Ending::OutOfBudget { unvisited }, work);
            }
            Child::Node(id) => {
                work.nodes += 1;
                let node = surface.tree.node(id);
                let children = node.children();
                for side in [1, 0] {
                    if reach.distance_squared(&node.boxes().get(side)) <= bound {
                        stack[count] = children[side];
                        count += 1;
                    }
                }
            }
        }
    }
    (Ending::Complete, work)
}
