//! The intersecting face pairs of two bodies, by simultaneous descent of both trees
//! (ACTIVE-INTERSECT, thesis 3.3.2).
//!
//! Overlap of boxes decides the descent, [`triangle_pair`] decides intersection, exactly. Of two
//! nodes the larger is opened: opening both at once would leave the faces of a small tool against
//! all levels of a large front.

use super::body::Body;
use ab_tree::{Child, NodeId};
use geometry::{BoxQuery, Facet, TrianglePair, triangle_pair};
use spm::{Handle, NONE};
use std::ops::ControlFlow;

/// Capacity of a pair traversal: each level of either tree, at most 31, leaves at most one entry.
const PAIR_STACK: usize = 72;

/// Two faces that intersect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FacePair {
    /// The face of the first body.
    pub a: Handle,
    /// The face of the second body.
    pub b: Handle,
    /// Their intersection, in the query's frame.
    pub meeting: TrianglePair,
}

impl FacePair {
    /// No pair: the content of an unused output.
    pub const NONE: Self = Self {
        a: NONE,
        b: NONE,
        meeting: TrianglePair::Disjoint,
    };
}

/// The end of a pair query.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// Everything was examined.
    Complete,
    /// The visitor stopped, or the output was full.
    Stopped {
        /// Pairs of nodes and faces not visited; each stands for all below it.
        unvisited: u32,
    },
    /// The budget was spent.
    OutOfBudget {
        /// Pairs of nodes and faces not visited; each stands for all below it.
        unvisited: u32,
    },
}

impl Ending {
    /// Whether the answer is complete.
    #[must_use]
    pub fn is_complete(self) -> bool {
        self == Self::Complete
    }
}

/// Cost of a pair query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct PairWork {
    /// Pairs of nodes, or of a node and a face, visited: what the budget counts.
    pub node_pairs: u32,
    /// Pairs of boxes tested (N_bv of thesis 3.3.3).
    pub boxes: u32,
    /// Pairs of faces tested (N_p).
    pub faces: u32,
}

/// Cost of a face pair, in node pairs (measured).
const FACE_PAIR: u32 = 4;

impl PairWork {
    /// The cost in node pairs.
    #[must_use]
    pub fn cost(self) -> u32 {
        self.node_pairs + FACE_PAIR * self.faces
    }

    /// Adds another query's cost.
    pub fn add(&mut self, other: Self) {
        self.node_pairs += other.node_pairs;
        self.boxes += other.boxes;
        self.faces += other.faces;
    }
}

/// The last face read, for a run of pairs with it.
struct CachedFace<T> {
    face: Handle,
    value: Option<T>,
}

impl<T> CachedFace<T> {
    fn new() -> Self {
        Self {
            face: NONE,
            value: None,
        }
    }

    #[inline]
    fn take(&mut self, face: Handle, read: impl FnOnce() -> T) -> &T {
        if self.face != face {
            self.face = face;
            self.value = None;
        }
        self.value.get_or_insert_with(read)
    }
}

/// Two subtrees or faces with overlapping boxes.
#[derive(Clone, Copy)]
struct Entry {
    a: Child,
    b: Child,
    box_a: BoxQuery,
    box_b: BoxQuery,
}

/// Calls `visit` with every intersecting face pair, until it breaks or `budget` node pairs were
/// visited.
pub fn for_each_pair<A: Body, B: Body>(
    a: &A,
    b: &B,
    budget: u32,
    mut visit: impl FnMut(FacePair) -> ControlFlow<()>,
) -> (Ending, PairWork) {
    let mut work = PairWork::default();
    let (Some(root_a), Some(root_b)) = (a.root(), b.root()) else {
        return (Ending::Complete, work);
    };
    let roots = Entry {
        a: root_a,
        b: root_b,
        box_a: BoxQuery::around(&a.root_box()),
        box_b: BoxQuery::around(&b.root_box()),
    };
    let mut stack = [roots; PAIR_STACK];
    let mut count = 1;
    let (mut cached_a, mut cached_b) = (CachedFace::new(), CachedFace::new());
    while count > 0 {
        count -= 1;
        let entry = stack[count];
        if let (Child::Face(x), Child::Face(y)) = (entry.a, entry.b) {
            work.faces += 1;
            let facet_a = cached_a.take(x, || Facet::new(a.corners(x)));
            let meeting = facet_a.pair_with(cached_b.take(y, || Facet::new(b.corners(y))));
            let pair = FacePair {
                a: x,
                b: y,
                meeting,
            };
            if meeting.meets() && visit(pair).is_break() {
                let unvisited = count as u32;
                return (Ending::Stopped { unvisited }, work);
            }
            continue;
        }
        if work.node_pairs == budget {
            let unvisited = count as u32 + 1;
            return (Ending::OutOfBudget { unvisited }, work);
        }
        work.node_pairs += 1;
        work.boxes += 2;
        for child in entry.open(a, b).into_iter().flatten() {
            stack[count] = child;
            count += 1;
        }
    }
    (Ending::Complete, work)
}

impl Entry {
    /// Opens the larger of two nodes: the pairs whose boxes overlap, in the order of the stack.
    #[inline]
    fn open<A: Body, B: Body>(self, a: &A, b: &B) -> [Option<Self>; 2] {
        let order = [1, 0];
        if let Some(node) = opens_first(self.a, self.b, &self.box_a, &self.box_b) {
            let (children, boxes) = a.children(node);
            let (met, queries) = (boxes.overlap(&self.box_b), boxes.queries());
            order.map(|k| {
                met[k].then_some(Self {
                    a: children[k],
                    box_a: queries[k],
                    ..self
                })
            })
        } else if let Child::Node(node) = self.b {
            let (children, boxes) = b.children(node);
            let (met, queries) = (boxes.overlap(&self.box_a), boxes.queries());
            order.map(|k| {
                met[k].then_some(Self {
                    b: children[k],
                    box_b: queries[k],
                    ..self
                })
            })
        } else {
            [None; 2]
        }
    }
}

/// The node of the first body, if that is to be opened. The larger of two nodes is opened: its
/// halves miss more of the other.
#[inline]
fn opens_first(a: Child, b: Child, box_a: &BoxQuery, box_b: &BoxQuery) -> Option<NodeId> {
    match (a, b) {
        (Child::Node(node), Child::Face(_)) => Some(node),
        (Child::Node(node), Child::Node(_)) if box_a.size() >= box_b.size() => Some(node),
        _ => None,
    }
}

/// The result of [`all_pairs`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PairsFound {
    /// Pairs written to the output.
    pub count: usize,
    /// Whether that is all.
    pub ending: Ending,
    /// Its cost.
    pub work: PairWork,
}

/// Writes all intersecting face pairs to `out`, in tree order. The ending tells if there were more
/// than fit or if the budget was spent.
pub fn all_pairs<A: Body, B: Body>(a: &A, b: &B, budget: u32, out: &mut [FacePair]) -> PairsFound {
    let mut count = 0;
    let (ending, work) = for_each_pair(a, b, budget, |pair| match out.get_mut(count) {
        Some(place) => {
            *place = pair;
            count += 1;
            ControlFlow::Continue(())
        }
        None => ControlFlow::Break(()),
    });
    PairsFound {
        count,
        ending,
        work,
    }
}

/// Any intersecting face pair: that of the last tick (`hint`) if it still intersects, else the
/// first found.
///
/// `None` with a complete ending means that the surfaces do not intersect; one may still be inside
/// the other.
#[must_use]
pub fn first_pair<A: Body, B: Body>(
    a: &A,
    b: &B,
    budget: u32,
    hint: Option<(Handle, Handle)>,
) -> (Option<FacePair>, Ending, PairWork) {
    if let Some((x, y)) = hint
        && a.has(x)
        && b.has(y)
    {
        let meeting = triangle_pair(a.corners(x), b.corners(y));
        if meeting.meets() {
            let work = PairWork {
                faces: 1,
                ..PairWork::default()
            };
            let pair = FacePair {
                a: x,
                b: y,
                meeting,
            };
            return (Some(pair), Ending::Complete, work);
        }
    }
    let mut found = None;
    let (ending, work) = for_each_pair(a, b, budget, |pair| {
        found = Some(pair);
        ControlFlow::Break(())
    });
    let ending = if found.is_some() {
        Ending::Complete
    } else {
        ending
    };
    (found, ending, work)
}
