//! The intersecting face pairs of two bodies, by simultaneous descent of both trees
//! (ACTIVE-INTERSECT, thesis 3.3.2).
//!
//! Overlap of boxes decides the descent, [`triangle_pair`] decides intersection, exactly. Of two
//! nodes the larger is opened: opening both at once would leave the faces of a small tool against
//! all levels of a large front.

use super::body::Body;
use ab_tree::{Child, FACE_BIT};
use geometry::{BoxQuery, Facet, TrianglePair, triangle_pair};
use glam::DVec3;
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

impl PairWork {
    /// Cost of a face pair, in node pairs (measured).
    pub const FACE_PAIR: u32 = 4;

    /// The cost in node pairs.
    #[must_use]
    pub fn cost(self) -> u32 {
        self.node_pairs + Self::FACE_PAIR * self.faces
    }

    /// Adds another query's cost.
    pub fn add(&mut self, other: Self) {
        self.node_pairs += other.node_pairs;
        self.boxes += other.boxes;
        self.faces += other.faces;
    }
}

/// Facets that are kept.
const FACETS: usize = 32;

/// Facets of faces met before: a face is met several times in a row, and again soon.
struct FacetCache {
    faces: [Handle; FACETS],
    facets: [Facet; FACETS],
}

impl FacetCache {
    fn new() -> Self {
        Self {
            faces: [NONE; FACETS],
            facets: [Facet::NOWHERE; FACETS],
        }
    }

    #[inline(always)]
    fn take(&mut self, face: Handle, corners: impl FnOnce() -> [DVec3; 3]) -> &Facet {
        let place = face as usize % FACETS;
        if self.faces[place] != face {
            self.faces[place] = face;
            self.facets[place] = Facet::new(corners());
        }
        &self.facets[place]
    }
}

/// Two subtrees or faces with overlapping boxes, packed: the number of a node, or a face and
/// [`FACE_BIT`].
#[derive(Clone, Copy)]
struct Entry {
    of: [u32; 2],
    boxes: [BoxQuery; 2],
}

/// Pairs to visit later.
struct Waiting {
    entries: [Entry; PAIR_STACK],
    count: usize,
}

fn packed(child: Child) -> u32 {
    match child {
        Child::Node(id) => id,
        Child::Face(face) => face | FACE_BIT,
    }
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
    let mut entry = Entry {
        of: [packed(root_a), packed(root_b)],
        boxes: [a.root_box(), b.root_box()].map(|aabb| BoxQuery::around(&aabb)),
    };
    let mut waiting = Waiting {
        entries: [entry; PAIR_STACK],
        count: 0,
    };
    let (mut facets_a, mut facets_b) = (FacetCache::new(), FacetCache::new());
    loop {
        let [of_a, of_b] = entry.of;
        if of_a & of_b & FACE_BIT != 0 {
            let (x, y) = (of_a & !FACE_BIT, of_b & !FACE_BIT);
            work.faces += 1;
            let facet = facets_a.take(x, || a.corners(x));
            let meeting = facet.pair_with(facets_b.take(y, || b.corners(y)));
            let pair = FacePair {
                a: x,
                b: y,
                meeting,
            };
            if meeting.meets() && visit(pair).is_break() {
                let unvisited = waiting.count as u32;
                return (Ending::Stopped { unvisited }, work);
            }
        } else {
            if work.node_pairs == budget {
                let unvisited = waiting.count as u32 + 1;
                return (Ending::OutOfBudget { unvisited }, work);
            }
            work.node_pairs += 1;
            work.boxes += 2;
            let goes_on = if entry.opens_first() {
                entry.open::<0, A>(a, &mut waiting)
            } else {
                entry.open::<1, B>(b, &mut waiting)
            };
            if goes_on {
                continue;
            }
        }
        if waiting.count == 0 {
            return (Ending::Complete, work);
        }
        waiting.count -= 1;
        entry = waiting.entries[waiting.count];
    }
}

impl Entry {
    /// The node that is to be opened: the larger of two, since its halves miss more of the other.
    #[inline(always)]
    fn opens_first(&self) -> bool {
        let [a, b] = self.of;
        b & FACE_BIT != 0 || (a & FACE_BIT == 0 && self.boxes[0].size() >= self.boxes[1].size())
    }

    /// The same with a child of one side.
    #[inline(always)]
    fn with<const SIDE: usize>(&self, child: Child, aabb: BoxQuery) -> Self {
        let mut with = *self;
        (with.of[SIDE], with.boxes[SIDE]) = (packed(child), aabb);
        with
    }

    /// Opens the node of one side and goes on to the first pair whose boxes overlap, if there is
    /// one; the second waits.
    #[inline(always)]
    fn open<const SIDE: usize, X: Body>(&mut self, body: &X, waiting: &mut Waiting) -> bool {
        let (children, boxes) = body.children(self.of[SIDE]);
        let child = |k: usize| self.with::<SIDE>(children[k], boxes.query(k));
        *self = match boxes.overlap(&self.boxes[1 - SIDE]) {
            [true, second] => {
                if second {
                    waiting.entries[waiting.count] = child(1);
                    waiting.count += 1;
                }
                child(0)
            }
            [false, true] => child(1),
            [false, false] => return false,
        };
        true
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
