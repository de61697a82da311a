//! The closest point of the front to a point: depth first, the nearer child first.

use super::{Stack, Surface, Work};
use ab_tree::{Child, NodeId};
use geometry::{BoxBound, BoxQuery, ClosestPoint, closest_point_on_triangle};
use glam::DVec3;
use spm::Handle;

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
/// use spm::{ActiveMesh, NONE};
///
/// let mut mesh = ActiveMesh::new(3, 1, 0);
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// for (vertex, corner) in (0u32..).zip(corners) {
///     mesh.set_base_vertex(vertex, corner, 0.0);
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
    let mut search = Search {
        surface,
        point,
        best: None,
        bound: f64::INFINITY,
        box_bound: BoxBound::NONE,
        work: Work::default(),
    };
    let query = BoxQuery::point(point);
    let mut stack = Stack::new();
    let mut next = surface.tree.root();
    if let (Some(face), Some(_)) = (hint, next) {
        search.try_face(face);
    }
    loop {
        if search.work.nodes + search.work.faces >= max_work && next.is_some() {
            return (search.best, search.work, false);
        }
        match next {
            Some(Child::Node(id)) => {
                next = search.open(id, &query, &mut stack);
                if next.is_some() {
                    continue;
                }
            }
            Some(Child::Face(face)) => {
                // The hint was tested first: its turn in the tree is skipped.
                if hint != Some(face) {
                    search.try_face(face);
                }
            }
            None => break,
        }
        // The bound may have decreased since.
        next = loop {
            match stack.pop() {
                Some((squared, child)) if search.box_bound.includes(squared) => break Some(child),
                Some(_) => {}
                None => break None,
            }
        };
    }
    (search.best, search.work, true)
}

/// The best face so far.
struct Search<'a> {
    surface: Surface<'a>,
    point: DVec3,
    best: Option<Nearest>,
    /// Squared distance to it.
    bound: f64,
    /// The same bound for boxes.
    box_bound: BoxBound,
    work: Work,
}

impl Search<'_> {
    /// The child to go on with: the nearer one, if it is within the bound.
    ///
    /// Branches, not a selection of operands: consecutive queries take the same path, and a
    /// predicted branch loads the next node before this one is decided.
    #[inline]
    fn open(&mut self, id: NodeId, query: &BoxQuery, stack: &mut Stack) -> Option<Child> {
        self.work.nodes += 1;
        let node = self.surface.tree.node(id);
        let within = node.boxes().within(query, self.box_bound);
        let [left, right] = node.children();
        if within.first() {
            if within.second() {
                let [to_left, to_right] = within.squared();
                if to_left <= to_right {
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

    #[inline]
    fn try_face(&mut self, face: Handle) {
        self.work.faces += 1;
        let closest = closest_point_on_triangle(self.surface.mesh.corners(face), self.point);
        if closest.distance_squared < self.bound || self.is_first_of_equals(face, &closest) {
            self.bound = closest.distance_squared;
            self.box_bound = BoxBound::squared(self.bound);
            self.best = Some(Nearest { face, closest });
        }
    }

    /// Whether a face is as near as the best one and has a smaller leaf key.
    #[inline]
    fn is_first_of_equals(&self, face: Handle, closest: &ClosestPoint) -> bool {
        let leaf = |face| self.surface.tree.leaf_of(face);
        closest.distance_squared == self.bound
            && self.best.is_some_and(|best| leaf(face) < leaf(best.face))
    }
}
