//! How deep a body is in the front.
//!
//! No library has the penetration depth of a mesh in a mesh (facts of collision). Two measures stand for it:
//!
//! - [`deepest_sample`]: the vertex of the body that lies deepest behind the front, its depth the distance to the
//!   front. Exact for the vertices; a face whose inside is pierced by a spike of the front, with all its vertices
//!   outside, is not seen by it;
//! - [`local_depth`]: over the pairs of faces that meet, how far the pair would have to be moved apart along one of
//!   its two normals. It sees that spike, but not how far a body is in whose surface no longer meets the front.

use super::tree_pairs::{Ending, FacePair, PAIR_STACK, PairWork, for_each_pair};
use super::{Body, Nearest, Surface, closest_point, signed_distance};
use ab_tree::Child;
use geometry::Aabb;
use glam::DVec3;
use spm::Handle;
use std::ops::ControlFlow;

/// A vertex of the body behind the front.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeepSample {
    /// Its distance to the front, positive.
    pub depth: f64,
    /// Where it is, in the front's frame.
    pub sample: DVec3,
    /// A face of the body that it is a corner of.
    pub face: Handle,
    /// The point of the front closest to it.
    pub nearest: Nearest,
}

/// The answer of [`deepest_sample`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeepestSample {
    /// The deepest found; `None` when none is behind the front.
    pub deepest: Option<DeepSample>,
    /// No vertex is deeper than this, whatever the ending.
    pub at_most: f64,
    /// Whether the deepest is the deepest of all.
    pub ending: Ending,
    /// What it cost: nodes of the front's tree in `node_pairs`.
    pub work: PairWork,
}

/// A subtree of the body and the greatest depth that a vertex in it can have.
#[derive(Clone, Copy)]
struct Entry {
    at_most: f64,
    child: Child,
}

/// The vertex of `body` (in the front's frame) deepest behind a closed front that does not cross itself; on another
/// one sides change from sheet to sheet ([`signed_distance`]), and a vertex found is behind the sheet nearest to it,
/// but a deeper one may be passed over.
///
/// The depth changes by no more than the way between two points, so the depth at the centre of a box plus half its
/// diagonal bounds every vertex in it: boxes that cannot hold a deeper one are passed over. `hint`, the face of the
/// last tick's answer, gives the first bound. `budget` is in nodes of the front's tree and is looked at before each point.
#[must_use]
pub fn deepest_sample<B: Body>(
    surface: Surface<'_>,
    body: &B,
    budget: u32,
    hint: Option<Handle>,
) -> DeepestSample {
    let mut search = Search {
        surface,
        work: PairWork::default(),
        on_front: None,
        deepest: None,
    };
    let mut ending = Ending::Complete;
    let Some(root) = body.root() else {
        return search.answer(0.0, ending);
    };
    if let Some(face) = hint
        && body.has(face)
    {
        search.try_corners(body, face, [true; 3]);
    }
    let mut stack = [Entry {
        at_most: f64::INFINITY,
        child: root,
    }; PAIR_STACK];
    let mut count = 1;
    while count > 0 {
        count -= 1;
        let Entry { at_most, child } = stack[count];
        if at_most <= search.depth() {
            continue;
        }
        if search.work.node_pairs >= budget {
            count += 1;
            let unvisited = count as u32;
            ending = Ending::OutOfBudget { unvisited };
            break;
        }
        match child {
            Child::Face(face) => search.try_corners(body, face, body.samples(face)),
            Child::Node(node) => {
                let (children, boxes) = body.children(node);
                // A subtree of a few faces holds about as many vertices: they are looked at themselves.
                let mut entries = [0, 1].map(|k| Entry {
                    at_most: if is_low(body, children[k]) {
                        at_most
                    } else {
                        search.bound(&boxes.get(k)).min(at_most)
                    },
                    child: children[k],
                });
                if entries[0].at_most > entries[1].at_most {
                    entries.swap(0, 1);
                }
                for entry in entries {
                    if entry.at_most > search.depth() {
                        stack[count] = entry;
                        count += 1;
                    }
                }
            }
        }
    }
    let open = stack[..count]
        .iter()
        .fold(search.depth(), |most, entry| most.max(entry.at_most));
    search.answer(open, ending)
}

/// Whether a child is a face or just above one.
fn is_low(body: &impl Body, child: Child) -> bool {
    let is_face = |child| matches!(child, Child::Face(_));
    match child {
        Child::Face(_) => true,
        Child::Node(node) => body.children(node).0.into_iter().any(is_face),
    }
}

struct Search<'a> {
    surface: Surface<'a>,
    work: PairWork,
    /// The face that was closest last: the next point's first bound.
    on_front: Option<Handle>,
    deepest: Option<DeepSample>,
}

impl Search<'_> {
    fn depth(&self) -> f64 {
        self.deepest.map_or(0.0, |deep| deep.depth)
    }

    fn answer(self, at_most: f64, ending: Ending) -> DeepestSample {
        DeepestSample {
            deepest: self.deepest,
            at_most,
            ending,
            work: self.work,
        }
    }

    /// Depth of a point, negative in front; `None` only for an empty front.
    fn depth_at(&mut self, point: DVec3) -> Option<(f64, Nearest)> {
        let (nearest, work) = closest_point(self.surface, point, self.on_front);
        self.work.node_pairs += work.nodes;
        self.work.faces += work.faces;
        let nearest = nearest?;
        self.on_front = Some(nearest.face);
        Some((-signed_distance(self.surface, point, &nearest), nearest))
    }

    /// No vertex in the box is deeper.
    fn bound(&mut self, aabb: &Aabb) -> f64 {
        self.work.boxes += 1;
        let centre = 0.5 * (aabb.lower.as_dvec3() + aabb.upper.as_dvec3());
        // A little for the rounding of both terms.
        let reach = 0.5 * aabb.diagonal() * (1.0 + 1e-12);
        self.depth_at(centre)
            .map_or(f64::NEG_INFINITY, |(depth, _)| {
                depth + reach + 1e-12 * depth.abs()
            })
    }

    fn try_corners(&mut self, body: &impl Body, face: Handle, samples: [bool; 3]) {
        let corners = body.corners(face);
        for k in 0..3 {
            if !samples[k] {
                continue;
            }
            if let Some((depth, nearest)) = self.depth_at(corners[k])
                && depth > self.depth()
            {
                self.deepest = Some(DeepSample {
                    depth,
                    sample: corners[k],
                    face,
                    nearest,
                });
            }
        }
    }
}

/// How far two faces that meet would have to be moved apart along one of their normals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalDepth {
    /// The way, at least 0.
    pub depth: f64,
    /// Unit direction in which the second body goes out of the first.
    pub direction: DVec3,
}

/// The local depth of two faces: the smaller of how far the second reaches behind the plane of the first, and the
/// first behind that of the second. `None` for two faces without area.
#[must_use]
pub fn local_depth_of_faces(a: [DVec3; 3], b: [DVec3; 3]) -> Option<LocalDepth> {
    let behind = |plane: [DVec3; 3], other: [DVec3; 3], out: f64| {
        let normal = (plane[1] - plane[0]).cross(plane[2] - plane[0]);
        let normal = normal.try_normalize()?;
        let depth = other
            .iter()
            .fold(0.0f64, |most, &p| most.max(-normal.dot(p - plane[0])));
        Some(LocalDepth {
            depth,
            direction: normal * out,
        })
    };
    match (behind(a, b, 1.0), behind(b, a, -1.0)) {
        (Some(of_a), Some(of_b)) if of_b.depth < of_a.depth => Some(of_b),
        (of_a, of_b) => of_a.or(of_b),
    }
}

/// The pair of faces with the greatest local depth among all that meet; `None` where the surfaces do not meet.
#[must_use]
pub fn local_depth<A: Body, B: Body>(
    a: &A,
    b: &B,
    budget: u32,
) -> (Option<(FacePair, LocalDepth)>, Ending, PairWork) {
    let mut deepest: Option<(FacePair, LocalDepth)> = None;
    let (ending, work) = for_each_pair(a, b, budget, |pair| {
        if let Some(depth) = local_depth_of_faces(a.corners(pair.a), b.corners(pair.b))
            && deepest.is_none_or(|(_, most)| depth.depth > most.depth)
        {
            deepest = Some((pair, depth));
        }
        ControlFlow::Continue(())
    });
    (deepest, ending, work)
}
