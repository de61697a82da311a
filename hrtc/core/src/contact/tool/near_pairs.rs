//! The face pairs of the front and a moving tool within a margin: the candidates that remain valid
//! while the tool deviates by less than the margin.
//!
//! Only the front's tree is descended. The traversal carries down the blocks of the tool that may
//! be near; a face of the front then tests the remaining boxes of the tool, eight at once. All
//! tests are in the tool's axes, where its boxes are constant and long faces along the tool have
//! slim boxes.

use super::block_tree::{BlockSet, Blocks, BoxWithin, Distance, MAX_BLOCKS, Slab};
use crate::contact::query::{Body, Ending, Limit, PairWork, STACK, Surface};
use ab_tree::{Child, NodeId};
use geometry::{Aabb, BoxPair};
use glam::{DMat3, DVec3, Mat3A, Vec3A, Vec4, Vec4Swizzles};
use mutants::{Mutant, is};
use spm::{Handle, NONE};
use std::ops::ControlFlow;

/// The front's motion relative to the tool, first and last placement. In f32 relative to a point of
/// the path, so that rounding is small compared with the distances.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub(crate) struct RelativePath {
    origin: DVec3,
    /// The same, exact in f32.
    rounded: Vec3A,
    /// From the body's axes to the tool's.
    back: [Mat3A; 2],
    /// Largest absolute values of both.
    absolute: Mat3A,
    /// Position of the origin relative to the tool, and a bound of its coordinates.
    there: [Vec3A; 2],
    size: f32,
}

/// A box relative to the tool, and a bound of the coordinates from which it was computed.
#[derive(Clone, Copy)]
struct BoxSeen {
    corners: [Vec3A; 2],
    size: f32,
}

impl RelativePath {
    /// From the centres of the tool and its rotations to the body's axes.
    pub(crate) fn new(centre: [DVec3; 2], rotation: [DMat3; 2]) -> Self {
        let back = rotation.map(|r| r.transpose());
        let column = |k: usize| back[0].col(k).abs().max(back[1].col(k).abs());
        let rounded = centre[0].as_vec3a();
        let origin = rounded.as_dvec3();
        let there = [0, 1].map(|k| (back[k] * (origin - centre[k])).as_vec3a());
        let mat = |m: DMat3| {
            Mat3A::from_cols(
                m.x_axis.as_vec3a(),
                m.y_axis.as_vec3a(),
                m.z_axis.as_vec3a(),
            )
        };
        Self {
            origin,
            rounded,
            back: back.map(mat),
            absolute: mat(DMat3::from_cols(column(0), column(1), column(2))),
            there,
            size: there[0].abs().max(there[1].abs()).max_element(),
        }
    }

    /// First and last position of a point.
    #[inline]
    fn point(&self, point: DVec3) -> [Vec3A; 2] {
        let arm = (point - self.origin).as_vec3a();
        [0, 1].map(|k| self.there[k] + self.back[k] * arm)
    }

    /// The box that bounds a box at first, last and on straight lines between.
    #[inline]
    fn around(&self, aabb: &Aabb) -> BoxSeen {
        let (low, high) = (
            Vec3A::from(aabb.lower) - self.rounded,
            Vec3A::from(aabb.upper) - self.rounded,
        );
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let [first, last] = [0, 1].map(|k| self.there[k] + self.back[k] * middle);
        let reach = self.absolute * half;
        BoxSeen {
            corners: [first.min(last) - reach, first.max(last) + reach],
            size: self.size + low.abs().max(high.abs()).max_element(),
        }
    }

    /// Whether a face of the tool may come within a distance of a box.
    pub(crate) fn any(&self, tool: &Blocks, aabb: &Aabb, distance: f64) -> bool {
        let BoxSeen { corners, size } = self.around(aabb);
        tool.any(&BoxWithin::new(corners, size, &Distance::new(distance)))
    }
}

/// A [`RelativePath`] for two boxes at once: a vector has both boxes at the first placement, then
/// both at the last. Gives the same bits as [`RelativePath::around`].
struct PathOfBoth {
    rounded: [Vec4; 3],
    /// Rows of the matrices.
    back: [[Vec4; 3]; 3],
    absolute: [[Vec4; 3]; 3],
    there: [Vec4; 3],
    size: f32,
}

impl PathOfBoth {
    fn new(path: &RelativePath) -> Self {
        let lanes = |[a, b]: [f32; 2]| Vec4::new(a, a, b, b);
        let rows = |m: [&Mat3A; 2]| {
            let [a, b] = m.map(Mat3A::to_cols_array_2d);
            [0, 1, 2].map(|i| [0, 1, 2].map(|j| lanes([a[j][i], b[j][i]])))
        };
        let [first, last] = &path.back;
        Self {
            rounded: path.rounded.to_array().map(Vec4::splat),
            back: rows([first, last]),
            absolute: rows([&path.absolute; 2]),
            there: [0, 1, 2].map(|i| lanes(path.there.map(|p| p[i]))),
            size: path.size,
        }
    }

    /// The boxes that bound both boxes of a pair at first, last and on straight lines between, and
    /// a distance.
    #[inline]
    fn around(&self, boxes: &BoxPair, distance: &Distance) -> [BoxWithin; 2] {
        let [a, b] = [boxes.get(0), boxes.get(1)];
        let [x, y, z] = [0, 1, 2].map(|k| {
            let lower = Vec4::new(a.lower[k], b.lower[k], a.lower[k], b.lower[k]);
            let upper = Vec4::new(a.upper[k], b.upper[k], a.upper[k], b.upper[k]);
            let (low, high) = (lower - self.rounded[k], upper - self.rounded[k]);
            let farthest = low.abs().max(high.abs());
            (0.5 * (low + high), 0.5 * (high - low), farthest)
        });
        // In the order of glam's matrix product: another one rounds differently.
        let times = |[a, b, c]: [Vec4; 3], [p, q, r]: [Vec4; 3]| (a * p + b * q) + c * r;
        let (middle, half) = ([x.0, y.0, z.0], [x.1, y.1, z.1]);
        let (mut lower, mut upper) = ([Vec4::ZERO; 3], [Vec4::ZERO; 3]);
        for i in 0..3 {
            let first = self.there[i] + times(self.back[i], middle);
            let last = first.zwxy();
            let reach = times(self.absolute[i], half);
            lower[i] = first.min(last) - reach;
            upper[i] = first.max(last) + reach;
        }
        let size = self.size + x.2.max(y.2).max(z.2);
        BoxWithin::both([lower, upper], size, distance)
    }
}

/// A subtree or face of the front, and the blocks of the tool that may be near: so many from a
/// place in the pool on.
#[derive(Clone, Copy)]
struct Entry {
    child: Child,
    first: u32,
    len: u32,
}

/// Capacity of the pool: the sets of a full stack, and one that is tried.
const POOL: usize = MAX_BLOCKS * (STACK + 1);

/// Cost of a face beside its blocks and pairs, in blocks (measured).
const FACE: u32 = 4;

/// A unit direction at any length; zero if it underflows in f32.
#[inline]
fn unit(direction: Vec3A) -> Vec3A {
    let most = direction.abs().max_element();
    if most.is_normal() {
        (direction / most).normalize()
    } else {
        Vec3A::ZERO
    }
}

/// The slabs of a face on its path: across it, and across its longest edge in its plane. The box of
/// a long oblique face is much larger than its neighbourhood. `size` bounds the coordinates
/// involved.
#[inline]
fn slabs([[a, b, c], ends]: [[Vec3A; 3]; 2], distance: &Distance, size: f32) -> [Slab; 2] {
    let longer = |l: Vec3A, e: Vec3A| {
        if e.length_squared() > l.length_squared() {
            e
        } else {
            l
        }
    };
    let longest = longer(longer(b - a, c - b), a - c);
    let normal = unit((b - a).cross(c - a));
    let across = unit(normal.cross(longest));
    let points = [a, b, c, ends[0], ends[1], ends[2]];
    [normal, across].map(|direction| Slab::new(direction, points, distance, size))
}

/// The point at which a search continues: everything before it in tree order was examined. It
/// remains valid while the tree changes, except for the changes themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Resume {
    leaf: u32,
    /// The face at that leaf if part of it was examined, and the place in the tool's tree at which
    /// it continues.
    face: Handle,
    place: u32,
}

impl Resume {
    /// The start of the tree.
    pub(crate) const START: Self = Self::at(1);

    /// The first leaf below a key; keys of any depth are compared from their first bit.
    const fn at(key: u32) -> Self {
        Self {
            leaf: key << key.leading_zeros(),
            face: NONE,
            place: 0,
        }
    }

    /// If this is in the middle of a face, which has changed, it is before that from now on.
    pub(crate) fn begin_again(&mut self, face: Handle) {
        if self.face == face {
            (self.face, self.place) = (NONE, 0);
        }
    }

    /// Whether this is beyond a face of the surface: the search does not come to it any more.
    pub(crate) fn is_beyond(self, surface: &Surface<'_>, face: Handle) -> bool {
        self.is_after(surface.tree.leaf_of(face))
    }

    /// Whether all leaves below a key are before this point.
    fn is_after(self, key: u32) -> bool {
        let free = key.leading_zeros();
        let last = u64::from(key) << free | ((1 << free) - 1);
        last < u64::from(self.leaf)
    }
}

/// Calls `visit` with the tool's faces of a set that may come within a distance of a face, from a
/// place in the tool's tree on, until it returns false; adds the blocks tested, and what each face
/// costs, to `cost`. If that would exceed `most`, returns the place at which to continue.
#[inline]
fn for_each_near_face(
    tool: &Blocks,
    path: &RelativePath,
    corners: [DVec3; 3],
    (set, distance, from): (&[u32], Distance, u32),
    cost: &mut u32,
    limits: [u32; 2],
    visit: impl FnMut(u32) -> bool,
) -> Option<u32> {
    let [[a, p], [b, q], [c, r]] = corners.map(|p| path.point(p));
    let lower = a.min(b).min(c).min(p.min(q).min(r));
    let upper = a.max(b).max(c).max(p.max(q).max(r));
    let size = path.size + lower.abs().max(upper.abs()).max_element();
    let near = BoxWithin::new([lower, upper], size, &distance);
    let slabs = || slabs([[a, b, c], [p, q, r]], &distance, size + tool.extent());
    tool.faces(&near, (set, slabs), from, cost, limits, visit)
}

/// Calls `visit` with the tool's faces that may come within a distance of a face, until it returns
/// false or the cost would exceed `most` blocks; a face visited costs `of_face` of them. Returns
/// the cost, and whether it stayed within that.
pub(crate) fn for_each_face_near(
    tool: &Blocks,
    path: &RelativePath,
    corners: [DVec3; 3],
    distance: f64,
    [most, of_face]: [u32; 2],
    visit: impl FnMut(u32) -> bool,
) -> (u32, bool) {
    let (mut cost, limits) = (FACE, [most, of_face]);
    if cost > most {
        return (0, false);
    }
    let (whole, count) = tool.whole();
    let near = (&whole[..count], Distance::new(distance), 0);
    let next = for_each_near_face(tool, path, corners, near, &mut cost, limits, visit);
    (cost, next.is_none())
}

/// Calls `visit` with every face pair that comes within `margin` (units of the surface's frame)
/// while the surface's points move on straight lines relative to the tool, and with some that are
/// slightly farther, face by face of the surface from `resume` on.
///
/// `visit` breaks, or returns the margin from then on (not negative), so that a full list continues
/// with a smaller one. The search ends before its [`PairWork::cost`] exceeds the limit and returns
/// where to continue, so that no pair is visited twice.
pub(crate) fn for_each_near_pair(
    surface: &Surface<'_>,
    tool: &Blocks,
    path: &RelativePath,
    margin: f64,
    resume: Resume,
    limit: &mut Limit<'_>,
    mut visit: impl FnMut(Handle, Handle) -> ControlFlow<(), f64>,
) -> (Ending, PairWork, Resume) {
    let Some(root) = surface.tree.root() else {
        return (Ending::Complete, PairWork::default(), resume);
    };
    let budget = limit.max_work();
    let (whole, count) = tool.whole();
    let mut pool = [0; POOL];
    pool[..MAX_BLOCKS].copy_from_slice(&whole);
    let root = Entry {
        child: root,
        first: 0,
        len: count as u32,
    };
    let mut search = NearPairSearch {
        surface,
        tool,
        path,
        of_both: PathOfBoth::new(path),
        resume,
        margin,
        distance: Distance::new(margin),
        work: PairWork::default(),
        pool,
        stack: [root; STACK],
        count: 1,
    };
    while search.count > 0 {
        let entry = search.stack[search.count - 1];
        let left = budget.saturating_sub(search.work.cost());
        if search.min_cost(&entry) > left || limit.is_reached(search.work.cost()) {
            let unvisited = search.count as u32;
            let Resume { leaf, .. } = Resume::at(search.key_of(entry.child));
            // Not before where it went on: that was examined.
            let next = Resume {
                leaf: leaf.max(search.resume.leaf),
                ..search.resume
            };
            return (Ending::OutOfBudget { unvisited }, search.work, next);
        }
        search.count -= 1;
        match entry.child {
            Child::Node(node) => search.open(node, entry),
            Child::Face(face) => {
                let ending = search.visit_face(face, entry, left, &mut visit);
                if let Some((ending, next)) = ending {
                    return (ending, search.work, next);
                }
            }
        }
    }
    (Ending::Complete, search.work, resume)
}

/// The state of [`for_each_near_pair`].
struct NearPairSearch<'a> {
    surface: &'a Surface<'a>,
    tool: &'a Blocks,
    path: &'a RelativePath,
    of_both: PathOfBoth,
    resume: Resume,
    /// Units of the surface's frame; `distance` is the same, rounded up.
    margin: f64,
    distance: Distance,
    work: PairWork,
    /// The sets of the entries, in their order.
    pool: [u32; POOL],
    stack: [Entry; STACK],
    count: usize,
}

impl NearPairSearch<'_> {
    fn key_of(&self, child: Child) -> u32 {
        match child {
            Child::Node(node) => self.surface.tree.node(node).key(),
            Child::Face(face) => self.surface.tree.leaf_of(face),
        }
    }

    /// Least cost of an entry, in blocks.
    #[inline]
    fn min_cost(&self, entry: &Entry) -> u32 {
        match entry.child {
            Child::Node(_) => 2 * entry.len,
            Child::Face(_) => FACE + entry.len,
        }
    }

    /// Pushes the children of a node, the last entry, that blocks of the tool may be near. Their
    /// sets overwrite its own.
    #[inline]
    fn open(&mut self, node: NodeId, Entry { first, len, .. }: Entry) {
        let (children, boxes) = self.surface.children(node);
        let within = self.of_both.around(&boxes, &self.distance);
        let (mut first, mut set) = (first as usize, BlockSet::default());
        let near = &mut set[..len as usize];
        near.copy_from_slice(&self.pool[first..first + len as usize]);
        let mut looks = 0;
        for side in [1, 0] {
            let child = children[side];
            if self.resume != Resume::START && self.resume.is_after(self.key_of(child)) {
                continue;
            }
            let found = &mut self.pool[first..first + MAX_BLOCKS];
            let len = self.tool.within(&within[side], near, found, &mut looks);
            if len > 0 {
                self.stack[self.count] = Entry {
                    child,
                    first: first as u32,
                    len: len as u32,
                };
                self.count += 1;
                first += len;
            }
        }
        self.work.node_pairs += looks;
        self.work.boxes += 8 * looks;
    }

    /// Visits the faces of the tool near a face of the surface, at a cost of what is `left` at the
    /// most, [`Self::min_cost`] at the least. The ending if the search ends here, and where to
    /// continue.
    #[inline]
    fn visit_face(
        &mut self,
        face: Handle,
        Entry { first, len, .. }: Entry,
        left: u32,
        visit: &mut impl FnMut(Handle, Handle) -> ControlFlow<(), f64>,
    ) -> Option<(Ending, Resume)> {
        if is(Mutant::ToolPairs) && !face.is_multiple_of(64) {
            return None;
        }
        let mut is_stopped = false;
        let (mut cost, before) = (FACE, self.work.faces);
        let limits = [left, PairWork::FACE_PAIR];
        let corners = self.surface.corners(face);
        let from = if self.resume.face == face {
            self.resume.place
        } else {
            0
        };
        let set = &self.pool[first as usize..(first + len) as usize];
        let near = (set, self.distance, from);
        let (tool, path) = (self.tool, self.path);
        let place = for_each_near_face(tool, path, corners, near, &mut cost, limits, |tool_face| {
            self.work.faces += 1;
            match visit(face, tool_face) {
                ControlFlow::Continue(wanted) => {
                    if wanted != self.margin {
                        self.margin = wanted;
                        self.distance = Distance::new(wanted);
                    }
                }
                ControlFlow::Break(()) => is_stopped = true,
            }
            !is_stopped
        });
        let looks = cost - PairWork::FACE_PAIR * (self.work.faces - before);
        self.work.node_pairs += looks;
        self.work.boxes += 8 * looks;
        let Resume { leaf, .. } = Resume::at(self.surface.tree.leaf_of(face));
        let unvisited = self.count as u32;
        match place {
            _ if is_stopped => Some((Ending::Stopped { unvisited }, self.resume)),
            Some(place) => {
                let unvisited = unvisited + 1;
                let next = Resume { leaf, face, place };
                Some((Ending::OutOfBudget { unvisited }, next))
            }
            None => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ab_tree::{AbTree, leaf_key};
    use glam::{EulerRot, Vec3};
    use spm::{ActiveMesh, Certified};

    const FACES: u32 = 64;

    /// A surface of equal faces under a tool of 64 near ones, and a search of it from a point on
    /// with a budget: how many pairs it visits, and where to go on.
    fn with_search(
        faces: u32,
        check: impl FnOnce(&Surface<'_>, &dyn Fn(Resume, u32) -> (u32, Resume)),
    ) {
        let mut mesh = ActiveMesh::new(3, faces, 0);
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        for (vertex, corner) in (0u32..).zip(corners) {
            mesh.set_base_vertex(vertex, corner, Certified::EXACT);
        }
        let mut tree = AbTree::new(faces);
        tree.preconstruct(faces);
        for face in 0..faces {
            mesh.set_base_face(face, [0, 1, 2], [NONE; 3])
                .expect("the vertices are there");
            tree.insert(face, leaf_key(face, faces));
        }
        tree.refit(|face| mesh.face_box(face));
        let surface = Surface {
            mesh: &mesh,
            tree: &tree,
        };
        let mut tool = Blocks::new((0..FACES).collect());
        let own = corners.map(|corner| Vec3A::from(corner).as_dvec3() * 0.1);
        tool.refit(|_| own);
        let path = RelativePath::new([DVec3::ZERO; 2], [DMat3::IDENTITY; 2]);
        check(&surface, &|resume, budget| {
            let (mut visited, mut limit) = (0, Limit::from(budget));
            let (_, _, next) =
                for_each_near_pair(&surface, &tool, &path, 0.1, resume, &mut limit, |_, _| {
                    visited += 1;
                    ControlFlow::Continue(0.1)
                });
            (visited, next)
        });
    }

    /// Two boxes at once are the same bits as one by one, for any numbers.
    #[test]
    fn two_boxes_at_once_are_as_one_by_one() {
        let turns = [0.3, -1.1].map(|turn| DMat3::from_euler(EulerRot::XYZ, turn, 0.7, 2.0 * turn));
        let centres = [DVec3::new(0.1, -20.3, 3.7), DVec3::new(0.2, -20.1, 3.3)];
        let path = RelativePath::new(centres, turns);
        let (of_both, distance) = (PathOfBoth::new(&path), Distance::new(0.3));
        let numbers = [
            0.1,
            -2.3,
            f32::MAX,
            1e-39,
            31.7,
            f32::NAN,
            -7.7,
            f32::INFINITY,
        ];
        for k in 0u32..10_000 {
            let number = |n: u32| {
                let random = (k * 12 + n).wrapping_mul(0x9E37_79B9);
                if k.is_multiple_of(2) {
                    (random >> 8) as f32 * 1e-5 - 80.0
                } else {
                    numbers[random as usize >> 29]
                }
            };
            let corner = |n: u32| Vec3::new(number(n), number(n + 1), number(n + 2));
            let boxes = [0, 6].map(|n| Aabb {
                lower: corner(n),
                upper: corner(n + 3),
            });
            let both = of_both.around(&BoxPair::new(boxes), &distance);
            let each = boxes.map(|aabb| {
                let BoxSeen { corners, size } = path.around(&aabb);
                BoxWithin::new(corners, size, &distance)
            });
            // As text, since NaN is not equal to itself.
            assert_eq!(format!("{both:?}"), format!("{each:?}"), "{boxes:?}");
        }
    }

    /// A search that ends amid a face goes on there, or examines all of it where it has changed.
    #[test]
    fn a_face_that_has_changed_is_examined_anew() {
        with_search(1, |surface, search| {
            let (first, mut amid) = search(Resume::START, 100);
            assert!(first > 0 && first < FACES, "{first}");
            assert_eq!(search(amid, u32::MAX).0, FACES - first);
            assert!(!amid.is_beyond(surface, 0));
            amid.begin_again(1);
            assert_eq!(search(amid, u32::MAX).0, FACES - first);
            amid.begin_again(0);
            assert_eq!(search(amid, u32::MAX).0, FACES);
        });
    }

    /// A search that goes on and is interrupted before it is back at its place visits nothing
    /// twice.
    #[test]
    fn what_was_visited_before_an_interruption_is_not_visited_again() {
        with_search(2, |_, search| {
            let seconds = FACES + 1..2 * FACES;
            let stops = |budget: &u32| seconds.contains(&search(Resume::START, *budget).0);
            let budget = (1..10_000).find(stops).expect("amid the second face");
            let (first, there) = search(Resume::START, budget);
            let (none, again) = search(there, 1);
            assert_eq!((none, again), (0, there));
            assert_eq!(search(again, u32::MAX).0, 2 * FACES - first);
        });
    }
}
