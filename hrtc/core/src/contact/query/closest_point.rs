//! The closest point of the front to a point: depth first, the nearer child first.
//!
//! Faces are looked at four at a time, by bounds in f32 ([`FourDistances`]): one after the other,
//! mispredicted branches cost more than all the arithmetic. Only those that may be nearest, one or
//! two, are compared in f64.

use super::{STACK, Surface, Work};
use ab_tree::{Child, FACE_BIT, NodeId};
use geometry::{BoxBound, BoxQuery, ClosestPoint, FourDistances, closest_point_on_triangle};
use glam::DVec3;
use spm::Handle;

/// Faces that may be nearest, before they are compared: more than share a vertex in most meshes.
const CANDIDATES: usize = 8;

/// The result of [`closest_point`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// The face.
    pub face: Handle,
    /// The point on it.
    pub closest: ClosestPoint,
}

/// The closest point of the front, exact in f64; `None` only for an empty front. Of faces that are
/// equally near, as those around a vertex, it is the one whose leaf key is least.
///
/// `hint`, an active face, gives the first bound and changes nothing else: without it the loose
/// boxes of a coarse front's base faces cost up to 2.5 times as much (measured).
///
/// ```
/// use ab_tree::{AbTree, leaf_key};
/// use glam::DVec3;
/// use hrtc_core::contact::query::{Surface, closest_point};
/// use spm::{ActiveMesh, Certified, NONE};
///
/// let mut mesh = ActiveMesh::new(3, 1, 0);
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// for (vertex, corner) in (0u32..).zip(corners) {
///     mesh.set_base_vertex(vertex, corner, Certified::EXACT);
/// }
/// mesh.set_base_face(0, [0, 1, 2], [NONE; 3]).expect("the vertices are there");
/// let mut tree = AbTree::new(1);
/// tree.preconstruct(1);
/// tree.insert(0, leaf_key(0, 1));
/// tree.refit(|face| mesh.face_box(face));
///
/// let surface = Surface { mesh: &mesh, tree: &tree };
/// let (nearest, _) = closest_point(surface, DVec3::new(0.25, 0.25, 2.0), None);
/// let closest = nearest.expect("the front has a face").closest;
/// assert_eq!(closest.point, DVec3::new(0.25, 0.25, 0.0));
/// assert_eq!(closest.distance_squared, 4.0);
/// ```
#[must_use]
pub fn closest_point(
    surface: Surface<'_>,
    point: DVec3,
    hint: Option<Handle>,
) -> (Option<Nearest>, Work) {
    let (nearest, work, _) = closest_point_within(surface, point, hint, u32::MAX);
    (nearest, work)
}

/// The same, but beyond the hint no node or face is begun after `max_work` of them. Returns as well
/// whether the search is complete; else the point is the closest of what was searched.
#[must_use]
pub fn closest_point_within(
    surface: Surface<'_>,
    point: DVec3,
    hint: Option<Handle>,
    max_work: u32,
) -> (Option<Nearest>, Work, bool) {
    let mut search = Search::new(surface, point);
    let mut work = Work::default();
    let Some(root) = surface.tree.root() else {
        return (None, work, true);
    };
    let mut next = match root {
        Child::Node(id) => id,
        Child::Face(face) => face | FACE_BIT,
    };
    let skipped = match hint {
        Some(face) => {
            work.faces += 1;
            search.compare(face);
            search.order.is_nearer_first = false;
            face | FACE_BIT
        }
        None => u32::MAX,
    };
    let query = BoxQuery::point(point);
    // Copies for the nodes: read from beside what is written for each face, they would wait for it.
    let mut order = search.order;
    let mut stack = Waiting {
        squared: [0.0; STACK],
        children: [0; STACK],
        count: 0,
    };
    loop {
        if work.nodes + work.faces >= max_work {
            search.finish();
            return (search.best, work, false);
        }
        if next & FACE_BIT == 0 {
            work.nodes += 1;
            if let Some(child) = open(surface, next, &query, order, &mut stack) {
                next = child;
                continue;
            }
        } else if next != skipped {
            // The hint was tested first: its turn in the tree is skipped.
            work.faces += 1;
            search.push(next & !FACE_BIT);
            order = search.order;
        }
        // The bound may have decreased since.
        match stack.pop(order.bound) {
            Some(child) => next = child,
            None => {
                search.finish();
                return (search.best, work, true);
            }
        }
    }
}

/// Children to visit later, packed, with their squared distances. Two arrays: what is written in
/// two pieces and read in one waits for the write. The methods must be inlined: calls cost a query
/// an eighth.
struct Waiting {
    squared: [f32; STACK],
    children: [u32; STACK],
    count: usize,
}

impl Waiting {
    #[inline(always)]
    fn push(&mut self, squared: f32, child: u32) {
        self.squared[self.count] = squared;
        self.children[self.count] = child;
        self.count += 1;
    }

    /// The last one that is within a bound.
    #[inline(always)]
    fn pop(&mut self, bound: BoxBound) -> Option<u32> {
        loop {
            self.count = self.count.checked_sub(1)?;
            if bound.includes(self.squared[self.count]) {
                return Some(self.children[self.count]);
            }
        }
    }
}

/// How a search goes through the tree.
#[derive(Clone, Copy)]
struct Order {
    /// No box that is farther can hold the nearest face.
    bound: BoxBound,
    /// Whether the nearer of two children comes first: a bound that is not improved needs no order.
    is_nearer_first: bool,
}

/// The child to go on with: the nearer one, if it is within the bound.
///
/// Branches, not a selection of operands: consecutive queries take the same path, and a predicted
/// branch loads the next node before this one is decided.
#[inline(always)]
fn open(
    surface: Surface<'_>,
    id: NodeId,
    query: &BoxQuery,
    order: Order,
    stack: &mut Waiting,
) -> Option<u32> {
    let node = surface.tree.node(id);
    let within = node.boxes().within(query, order.bound);
    let [left, right] = node.packed_children();
    if within.first() {
        if within.second() {
            let [to_left, to_right] = within.squared();
            if !order.is_nearer_first || to_left <= to_right {
                stack.push(to_right, right);
                return Some(left);
            }
            stack.push(to_left, left);
            return Some(right);
        }
        return Some(left);
    }
    within.second().then_some(right)
}

/// The best face so far.
struct Search<'a> {
    surface: Surface<'a>,
    point: DVec3,
    best: Option<Nearest>,
    /// No face that is farther can be nearest.
    reach: f32,
    order: Order,
    /// Faces to look at.
    waiting: [Handle; 4],
    waiting_count: usize,
    /// Faces that may be nearest, with the distances that they are not nearer than.
    candidates: [(Handle, f32); CANDIDATES],
    candidate_count: usize,
}

impl<'a> Search<'a> {
    fn new(surface: Surface<'a>, point: DVec3) -> Self {
        Self {
            surface,
            point,
            best: None,
            reach: f32::INFINITY,
            order: Order {
                bound: BoxBound::NONE,
                is_nearer_first: true,
            },
            waiting: [0; 4],
            waiting_count: 0,
            candidates: [(0, 0.0); CANDIDATES],
            candidate_count: 0,
        }
    }

    /// A face to look at.
    #[inline(always)]
    fn push(&mut self, face: Handle) {
        self.waiting[self.waiting_count] = face;
        self.waiting_count += 1;
        if self.waiting_count == self.waiting.len() {
            self.look();
        }
    }

    /// Looks at the faces that wait.
    #[inline(never)]
    fn look(&mut self) {
        let count = self.waiting_count;
        if count == 0 {
            return;
        }
        let faces = [0, 1, 2, 3].map(|k| self.waiting[if k < count { k } else { 0 }]);
        let triangles = faces.map(|face| self.surface.mesh.triangle(face));
        let distances = FourDistances::new(triangles, self.point);
        let mut which = distances.within(self.reach) & ((1 << count) - 1);
        while which != 0 {
            let k = which.trailing_zeros() as usize;
            which &= which - 1;
            let [lower, upper] = distances.of(k);
            if upper < self.reach {
                self.order.is_nearer_first = true;
                self.set_reach(upper);
            }
            if self.candidate_count == CANDIDATES {
                self.compare_candidates();
            }
            self.candidates[self.candidate_count] = (faces[k], lower);
            self.candidate_count += 1;
        }
        self.waiting_count = 0;
    }

    #[inline(always)]
    fn set_reach(&mut self, reach: f32) {
        self.reach = reach;
        let reach = f64::from(reach);
        self.order.bound = BoxBound::squared(reach * reach);
    }

    /// Looks at all that is left.
    #[inline(always)]
    fn finish(&mut self) {
        self.look();
        self.compare_candidates();
    }

    #[inline(always)]
    fn compare_candidates(&mut self) {
        for k in 0..self.candidate_count {
            let (face, lower) = self.candidates[k];
            let is_beyond = lower > self.reach;
            if !is_beyond {
                self.compare(face);
            }
        }
        self.candidate_count = 0;
    }

    /// Compares a face with the best one, exactly.
    #[inline(never)]
    fn compare(&mut self, face: Handle) {
        let closest = closest_point_on_triangle(self.surface.mesh.corners(face), self.point);
        let is_nearer = match &self.best {
            None => true,
            Some(Nearest {
                face: other,
                closest: best,
            }) => {
                let leaf = |face| self.surface.tree.leaf_of(face);
                closest.distance_squared < best.distance_squared
                    || (closest.distance_squared == best.distance_squared
                        && leaf(face) < leaf(*other))
            }
        };
        if is_nearer {
            self.best = Some(Nearest { face, closest });
            let rounded = closest.distance_squared.sqrt() as f32;
            let reach = rounded * (1.0 + f32::EPSILON) + f32::MIN_POSITIVE;
            if reach < self.reach {
                self.set_reach(reach);
            }
        }
    }
}
