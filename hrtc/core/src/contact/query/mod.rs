//! Distance and intersection queries on the active front.
//!
//! | query | answer |
//! |---|---|
//! | `closest_point` | the point of the front closest to a point |
//! | `faces_within` | all faces within a distance of a point |
//! | `near_faces` | the faces in a ball, collected once for several queries of a tick |
//! | `swept_sphere` | the first contact of a moving sphere |
//! | `tree_pairs` | the intersecting face pairs of two bodies (ACTIVE-INTERSECT) |
//!
//! All queries run in the frame and units of the model, allocate nothing and decide in f64.
//! A traversal stack of 32 entries suffices: the tree is at most 31 levels deep, and each level
//! leaves at most one entry on the stack.

mod body;
mod closest_point;
mod faces_within;
mod limit;
mod near_faces;
mod swept_sphere;
mod tree_pairs;

pub use body::{Body, Placed};
pub use closest_point::{Nearest, closest_point, closest_point_within};
pub use faces_within::{faces_within, faces_within_limited};
pub use limit::{Deadline, Limit};
pub use near_faces::{MAX_FACES, NearFace, NearFaces};
pub use swept_sphere::{SweepHit, swept_sphere, swept_sphere_budget};
pub use tree_pairs::{
    Ending, FacePair, PairWork, PairsFound, all_pairs, first_pair, for_each_pair,
};

use ab_tree::{AbTree, Child};
use geometry::closest_point_on_triangle;
use glam::DVec3;
use spm::ActiveMesh;

/// Capacity of a traversal's stack.
pub(crate) const STACK: usize = 32;

/// The queried surface: an active mesh and its tree.
#[derive(Debug, Clone, Copy)]
pub struct Surface<'a> {
    /// The mesh of the refined front.
    pub mesh: &'a ActiveMesh,
    /// Its AB-tree, refitted.
    pub tree: &'a AbTree,
}

/// Cost of a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Work {
    /// Nodes visited (N_bv of thesis 3.3.3 is twice this: a node holds two boxes).
    pub nodes: u32,
    /// Faces tested (N_p).
    pub faces: u32,
}

impl Work {
    /// Adds another query's cost.
    pub fn add(&mut self, other: Self) {
        self.nodes += other.nodes;
        self.faces += other.faces;
    }
}

/// The stack of a traversal: children to visit later, each with a key. The methods must be inlined:
/// calls cost a closest-point query an eighth.
struct Stack {
    entries: [(f32, Child); STACK],
    count: usize,
}

impl Stack {
    #[inline]
    fn new() -> Self {
        Self {
            entries: [(0.0, Child::Node(0)); STACK],
            count: 0,
        }
    }

    #[inline]
    fn push(&mut self, key: f32, child: Child) {
        self.entries[self.count] = (key, child);
        self.count += 1;
    }

    #[inline]
    fn pop(&mut self) -> Option<(f32, Child)> {
        self.count = self.count.checked_sub(1)?;
        Some(self.entries[self.count])
    }

    /// Lower bound of the squared distance of a point from all faces still to be visited: below
    /// `next`, and below what waits.
    fn distance_squared(&self, surface: Surface<'_>, next: Child, point: DVec3) -> f64 {
        let waiting = self.entries[..self.count].iter().map(|&(_, child)| child);
        let of_child = |child| match child {
            Child::Face(face) => {
                closest_point_on_triangle(surface.mesh.corners(face), point).distance_squared
            }
            Child::Node(id) => {
                let boxes = surface.tree.node(id).boxes();
                let [first, second] = [0, 1].map(|side| boxes.get(side).distance_squared(point));
                first.min(second)
            }
        };
        waiting
            .chain([next])
            .map(of_child)
            .fold(f64::INFINITY, f64::min)
    }

    /// The child to continue with; the second of two is pushed.
    #[inline]
    fn descend(&mut self, met: [bool; 2], [left, right]: [Child; 2]) -> Option<Child> {
        match met {
            [true, true] => {
                self.push(0.0, right);
                Some(left)
            }
            [true, false] => Some(left),
            [false, true] => Some(right),
            [false, false] => None,
        }
    }

    /// The child to continue with, the one with the smaller key; the other is pushed if it is met.
    #[inline]
    fn descend_nearer(
        &mut self,
        met: [bool; 2],
        keys: [f32; 2],
        children: [Child; 2],
    ) -> Option<Child> {
        if met == [true, true] {
            let nearer = usize::from(keys[1] < keys[0]);
            self.push(keys[1 - nearer], children[1 - nearer]);
            Some(children[nearer])
        } else {
            self.descend(met, children)
        }
    }
}
