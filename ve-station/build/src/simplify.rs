//! Simplification: edge collapses by quadric error, in independent-set rounds.
//!
//! A round sorts the edges by cost and goes through the cheapest half, collapsing each whose
//! one-ring no collapse of the round has touched. (The middle of a large fan may have been touched:
//! it is no end of a collapse, and those of its rim share no face. Else a round would collapse one
//! edge of a rim of thousands.) Greedy order instead makes dependency chains of
//! thousands on flat parts; rounds keep them at about two dozen, and what would make too long a
//! chain does not collapse.
//!
//! Memory: 24 B a face (corners, neighbours; 12 B more while these are found), 140 B a vertex
//! (positions, quadric, flags), 8 B an edge of the round, all in flat vectors.

mod quadric;
mod topology;

use crate::history::{Collapse, FanFace, History, LeftFace, MAX_FACES_ROUND_A_VERTEX, Made, Round};
use crate::manifold::ManifoldMesh;
use crate::model_error::{
    Descendants, ExpectedErrors, Fronts, LargeFace, Patches, candidates, close_bounds,
    descendant_radius, quarter_bounds,
};
use crate::progress::Progress;
use crate::tuning::simplify::{
    BOUNDARY_WEIGHT, CHAIN_A_HALVING, FACES_A_TASK, LENGTH_COST, MIN_AREA_SHARE, MIN_TURN_COSINE,
    SHORTEST_LIMIT_OF_CHAINS,
};
use geometry::portable::log2;
use glam::{DVec3, Vec3};
use quadric::Quadric;
use rayon::prelude::*;
use spm::{ErrorScale, NONE};
use topology::{Collapsible, Topology};

/// The longest chain that a mesh may get.
fn limit_of_chains(vertices: usize, target: u32) -> u8 {
    // A base mesh has rather more than half as many vertices as faces.
    let left = (0.6 * f64::from(target)).max(1.0);
    let halvings = log2(vertices as f64 / left);
    (CHAIN_A_HALVING * halvings).max(SHORTEST_LIMIT_OF_CHAINS) as u8
}

/// Simplifies until at most `target` faces are left or no legal collapse is, and samples the
/// expected errors of one round while the next is made; then the certified errors follow.
#[must_use]
pub fn simplify(
    mesh: &ManifoldMesh,
    target: u32,
    scale: ErrorScale,
    progress: &dyn Progress,
) -> History {
    let faces = mesh.triangles.len() as u64;
    progress.phase("simplifying", faces.saturating_sub(target.into()));
    let mut work = Work::new(mesh, target);
    let neighbours = work.topology.neighbours.clone();
    let mut errors = ExpectedErrors::new(&mesh.positions, &mesh.triangles, neighbours, scale);
    let mut history = History {
        full_vertices: mesh.positions.len() as u32,
        positions: mesh.positions.clone(),
        collapses: Vec::new(),
        expected: Vec::new(),
        radius: Vec::new(),
        close: Vec::new(),
        base: Vec::new(),
        quarters: Vec::new(),
    };
    let mut whole = false;
    let mut made = Round::default();
    while work.topology.alive > target {
        let (next, ()) = rayon::join(|| work.round(target, whole), || errors.sample(&made));
        made = next;
        history
            .collapses
            .extend(made.made.iter().map(|m| m.collapse));
        history.positions.extend(made.made.iter().map(|m| m.point));
        progress.done(faces - u64::from(work.topology.alive));
        let done = made.made.len() as u64;
        // Few in the cheapest half: the rest may have some. None at all: nothing is legal any more.
        if done == 0 && whole {
            break;
        }
        whole = done * 50 < u64::from(work.topology.alive);
    }
    errors.sample(&made);
    let (expected, full) = errors.finish();
    history.expected = expected;
    history.base = (0..mesh.triangles.len() as u32)
        .filter(|&face| work.topology.is_alive(face))
        .map(|face| LeftFace {
            face,
            corners: work.topology.corners[face as usize].map(|slot| work.id[slot as usize]),
            neighbours: work.topology.neighbours[face as usize],
        })
        .collect();
    drop(work);
    progress.phase("bounding errors", history.full_vertices.into());
    let descendants = Descendants::new(&history);
    history.radius = descendant_radius(&history, &descendants);
    let fronts = Fronts::new(&history);
    let patches = Patches::new(&history, &full, (&descendants, &fronts));
    let candidates = candidates(&patches, scale);
    let large: Vec<LargeFace> = candidates.iter().map(|of| of.large).collect();
    let (close, parts) = close_bounds(&patches, &large, progress);
    let quarters = quarter_bounds(&patches, &close, &candidates, &parts);
    (history.close, history.quarters) = (close, quarters);
    history
}

/// The state. Live vertices are *slots*, the numbers of the full mesh's vertices: the vertex that a
/// collapse makes takes over the slot of vt.
struct Work<'a> {
    topology: Topology,
    /// Faces that were left when the round began.
    left: Vec<u32>,
    locked: &'a [bool],
    /// Centre and size of the frame in which quadrics are summed.
    centre: DVec3,
    inverse_diagonal: f64,
    /// By slot: stored position.
    position: Vec<[f32; 3]>,
    /// By slot: the same in the frame of the quadrics.
    scaled: Vec<DVec3>,
    quadric: Vec<Quadric>,
    /// By slot: id in the history.
    id: Vec<u32>,
    /// By slot: the last round that touched it.
    touched: Vec<u32>,
    round: u32,
    /// By slot: length of the longest chain that ends with the collapse that made it.
    chain: Vec<u8>,
    /// By face: the same of the collapses that remove a face next to it.
    adjacent_chain: Vec<u8>,
    longest_chain: u8,
    /// Id that the next collapse makes.
    next_id: u32,
    /// What the round has done so far.
    made: Round,
    /// Faces gone round for edges that were tried.
    #[cfg(test)]
    gone_round: u64,
    /// Reused: faces round the two ends, and their neighbours.
    fans: [Vec<u32>; 2],
    rings: [Vec<u32>; 2],
}

/// An edge of a round: its cost as f32, of which not being negative makes the bits ascend, then the
/// face that it is a side of, then which side: the one from corner k to k + 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate(u64);

impl Candidate {
    fn new(cost: f64, face: u32, corner: usize) -> Self {
        let cost = (cost as f32).to_bits();
        Self(u64::from(cost) << 32 | u64::from(face) << 2 | corner as u64)
    }

    fn face(self) -> u32 {
        self.0 as u32 >> 2
    }

    fn corner(self) -> usize {
        self.0 as usize & 3
    }
}

impl<'a> Work<'a> {
    fn new(mesh: &'a ManifoldMesh, target: u32) -> Self {
        let at = |p: &[f32; 3]| Vec3::from_array(*p).as_dvec3();
        let mut lower = DVec3::INFINITY;
        let mut upper = DVec3::NEG_INFINITY;
        for p in &mesh.positions {
            lower = lower.min(at(p));
            upper = upper.max(at(p));
        }
        let centre = (lower + upper) * 0.5;
        let inverse_diagonal = 1.0 / (upper - lower).length();
        let scaled: Vec<DVec3> = mesh
            .positions
            .iter()
            .map(|p| (at(p) - centre) * inverse_diagonal)
            .collect();
        let topology = Topology::new(&mesh.triangles, mesh.positions.len());
        let quadric = initial_quadrics(&topology, &scaled);
        Self {
            left: (0..mesh.triangles.len() as u32).collect(),
            locked: &mesh.locked,
            centre,
            inverse_diagonal,
            position: mesh.positions.clone(),
            quadric,
            id: (0..mesh.positions.len() as u32).collect(),
            touched: vec![0; mesh.positions.len()],
            round: 0,
            chain: vec![0; mesh.positions.len()],
            adjacent_chain: vec![0; mesh.triangles.len()],
            longest_chain: limit_of_chains(mesh.positions.len(), target),
            next_id: mesh.positions.len() as u32,
            made: Round::default(),
            #[cfg(test)]
            gone_round: 0,
            fans: [Vec::new(), Vec::new()],
            rings: [Vec::new(), Vec::new()],
            scaled,
            topology,
        }
    }

    /// One round; what it collapsed.
    fn round(&mut self, target: u32, whole: bool) -> Round {
        self.round += 1;
        let mut candidates = self.candidates();
        if !whole && candidates.len() > 1 {
            let half = candidates.len() / 2;
            candidates.select_nth_unstable(half);
            candidates.truncate(half);
        }
        candidates.par_sort_unstable();
        for candidate in candidates {
            if self.topology.alive <= target {
                break;
            }
            self.try_collapse(candidate);
        }
        let mut round = std::mem::take(&mut self.made);
        round.made.par_sort_unstable_by_key(|made| made.collapse.fl);
        for made in &round.made {
            self.id[made.slot as usize] = self.next_id;
            self.next_id += 1;
        }
        round
    }

    /// Every edge that may move, once.
    fn candidates(&mut self) -> Vec<Candidate> {
        let topology = &self.topology;
        self.left.retain(|&face| topology.is_alive(face));
        let work = &*self;
        let chunks = work.left.par_chunks(FACES_A_TASK);
        chunks.flat_map_iter(|faces| work.edges_of(faces)).collect()
    }

    /// The edges of faces that may move; those between two faces are the lower one's.
    fn edges_of(&self, faces: &[u32]) -> Vec<Candidate> {
        let mut edges = Vec::with_capacity(faces.len() * 3 / 2);
        for &face in faces {
            for corner in 0..3 {
                let (a, b, other) = self.topology.side(face, corner);
                let own = other == NONE || face < other;
                if own && !self.locked[a as usize] && !self.locked[b as usize] {
                    edges.push(Candidate::new(self.placement(a, b).1, face, corner));
                }
            }
        }
        edges
    }

    /// Where an edge goes and what that costs, in the frame of the quadrics.
    fn placement(&self, a: u32, b: u32) -> (DVec3, f64) {
        let (p, q) = (self.scaled[a as usize], self.scaled[b as usize]);
        let sum = self.quadric[a as usize] + self.quadric[b as usize];
        let middle = (p + q) * 0.5;
        let length_squared = p.distance_squared(q);
        let best_of = |points: [DVec3; 3]| {
            let mut best = (points[0], sum.at(points[0]));
            for point in &points[1..] {
                let cost = sum.at(*point);
                if cost < best.1 {
                    best = (*point, cost);
                }
            }
            best
        };
        let optimal = sum
            .minimum()
            .filter(|x| x.distance_squared(middle) <= 9.0 * length_squared)
            .map(|x| (x, sum.at(x)));
        let (point, cost) = optimal.unwrap_or_else(|| best_of([middle, p, q]));
        // A quadric is not negative; its sum in floating point may be, by rounding.
        (point, cost.max(0.0) + LENGTH_COST * length_squared)
    }

    /// Collapses an edge if nothing near was touched in this round and nothing forbids it.
    fn try_collapse(&mut self, candidate: Candidate) {
        let (face, corner) = (candidate.face(), candidate.corner());
        // Touched corners mean that the face may be gone or another one by now.
        let (a, b, _) = self.topology.side(face, corner);
        if !self.topology.is_alive(face) || self.is_touched(a) || self.is_touched(b) {
            return;
        }
        let Self {
            topology,
            fans,
            rings,
            ..
        } = self;
        fans.iter_mut().for_each(Vec::clear);
        let edge = topology.collapsible(face, corner, fans, rings);
        #[cfg(test)]
        {
            self.gone_round += self.fans.iter().map(|fan| fan.len() as u64).sum::<u64>();
        }
        let Some(edge) = edge else {
            return;
        };
        let touched = self
            .rings
            .iter()
            .flatten()
            .any(|&slot| self.is_touched(slot) && !self.topology.has_large_fan(slot));
        let fits = self.result_fan(&edge) <= MAX_FACES_ROUND_A_VERTEX
            && self.chain_of(&edge) <= self.longest_chain;
        if touched || !fits {
            return;
        }
        let (point, _) = self.placement(edge.vt, edge.vu);
        let stored = (self.centre + point / self.inverse_diagonal).as_vec3() + Vec3::ZERO;
        if !stored.is_finite() || self.turns_a_face(&edge, stored.as_dvec3()) {
            return;
        }
        self.collapse(&edge, stored);
    }

    fn is_touched(&self, slot: u32) -> bool {
        self.touched[slot as usize] == self.round
    }

    /// Length of the longest chain that ends with this collapse.
    fn chain_of(&self, edge: &Collapsible) -> u8 {
        let removed = [edge.fl, edge.fr].into_iter().filter(|&f| f != NONE);
        let of_faces = removed.map(|face| self.adjacent_chain[face as usize]);
        let of_vertices = [edge.vt, edge.vu].map(|slot| self.chain[slot as usize]);
        of_faces.chain(of_vertices).fold(0, u8::max) + 1
    }

    /// Faces round the vertex that the collapse would make.
    fn result_fan(&self, edge: &Collapsible) -> usize {
        let gone = if edge.fr == NONE { 2 } else { 4 };
        self.fans[0].len() + self.fans[1].len() - gone
    }

    /// Whether a face that stays would turn over, or lose its area.
    fn turns_a_face(&self, edge: &Collapsible, point: DVec3) -> bool {
        let at = |slot: u32| Vec3::from_array(self.position[slot as usize]).as_dvec3();
        let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a) * self.inverse_diagonal.powi(2);
        self.fans.iter().flatten().any(|&face| {
            if face == edge.fl || face == edge.fr {
                return false;
            }
            let corners = self.topology.corners[face as usize];
            let before = normal(corners.map(at));
            let after = normal(corners.map(|slot| {
                if slot == edge.vt || slot == edge.vu {
                    point
                } else {
                    at(slot)
                }
            }));
            let (old, new) = (before.length(), after.length());
            // Written so that a comparison with NaN rejects.
            let keeps =
                before.dot(after) >= MIN_TURN_COSINE * old * new && new > MIN_AREA_SHARE * old;
            !keeps
        })
    }

    fn collapse(&mut self, edge: &Collapsible, stored: Vec3) {
        let collapse = Collapse {
            vt: self.id[edge.vt as usize],
            vu: self.id[edge.vu as usize],
            fl: edge.fl,
            fr: edge.fr,
            fn_: edge.fn_,
        };
        let chain = self.chain_of(edge);
        self.chain[edge.vt as usize] = chain;
        for face in edge.fn_.into_iter().filter(|&f| f != NONE) {
            let adjacent = &mut self.adjacent_chain[face as usize];
            *adjacent = chain.max(*adjacent);
        }
        self.topology.collapse(edge, &self.fans[1]);
        let slot = edge.vt as usize;
        self.quadric[slot] = self.quadric[slot] + self.quadric[edge.vu as usize];
        self.position[slot] = stored.to_array();
        self.scaled[slot] = (stored.as_dvec3() - self.centre) * self.inverse_diagonal;
        let first = self.made.fans.len() as u32;
        self.record_fan(edge);
        self.made.made.push(Made {
            collapse,
            point: stored.to_array(),
            slot: edge.vt,
            fan: first..self.made.fans.len() as u32,
        });
        for &touched in self.rings.iter().flatten().chain(&[edge.vt, edge.vu]) {
            self.touched[touched as usize] = self.round;
        }
    }
}

impl Work<'_> {
    /// Notes the faces round the vertex just made.
    fn record_fan(&mut self, edge: &Collapsible) {
        for &face in self.fans.iter().flatten() {
            if face == edge.fl || face == edge.fr {
                continue;
            }
            let corners = self.topology.corners[face as usize];
            let Some(k) = corners.iter().position(|&slot| slot == edge.vt) else {
                continue;
            };
            let at = |k: usize| self.position[corners[k % 3] as usize];
            self.made.fans.push(FanFace {
                face,
                from: at(k + 1),
                to: at(k + 2),
                is_last: self.topology.neighbours[face as usize][(k + 1) % 3] == NONE,
            });
        }
    }
}

/// Planes of the faces, weighted by area, and planes through boundaries, square to their faces.
fn initial_quadrics(topology: &Topology, scaled: &[DVec3]) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::default(); scaled.len()];
    for face in 0..topology.corners.len() as u32 {
        let corners = topology.corners[face as usize];
        let [a, b, c] = corners.map(|slot| scaled[slot as usize]);
        let doubled = (b - a).cross(c - a);
        let area = 0.5 * doubled.length();
        let Some(normal) = doubled.try_normalize() else {
            continue;
        };
        let plane = Quadric::of_plane(normal, a, area);
        for slot in corners {
            quadrics[slot as usize] = quadrics[slot as usize] + plane;
        }
        for corner in 0..3 {
            let (start, end, other) = topology.side(face, corner);
            let along = scaled[end as usize] - scaled[start as usize];
            if other == NONE
                && let Some(outwards) = along.cross(normal).try_normalize()
            {
                let weight = BOUNDARY_WEIGHT * along.length_squared();
                let plane = Quadric::of_plane(outwards, scaled[start as usize], weight);
                for slot in [start, end] {
                    quadrics[slot as usize] = quadrics[slot as usize] + plane;
                }
            }
        }
    }
    quadrics
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clean::clean;
    use crate::generate::{Shape, generate};
    use crate::manifold::cut_to_manifold;
    use crate::mesh::SoupMesh;
    use crate::order;

    #[test]
    fn no_chain_grows_beyond_its_limit() {
        let soup = generate(Shape::Plate, 5000, 0);
        let mesh = order::in_tree_order(cut_to_manifold(&clean(soup).unwrap()));
        let mut work = Work::new(&mesh, 2);
        work.longest_chain = 9;
        let mut collapses = 0;
        loop {
            let round = work.round(2, true);
            if round.made.is_empty() {
                break;
            }
            collapses += round.made.len();
        }
        // Eight splits of a vertex make far fewer than all of them.
        assert_eq!(work.chain.iter().max(), Some(&9));
        assert!(collapses > 1000 && work.topology.alive > 20);
    }

    /// A disc of so many triangles round one vertex, raised to a cone.
    fn cone(ring: u32) -> ManifoldMesh {
        let mut soup = SoupMesh {
            positions: vec![[0.0, 0.0, 0.3]],
            triangles: Vec::new(),
        };
        for k in 0..ring {
            let angle = std::f64::consts::TAU * f64::from(k) / f64::from(ring);
            soup.positions.push([angle.cos(), angle.sin(), 0.0]);
            soup.triangles.push([0, 1 + k, 1 + (k + 1) % ring]);
        }
        order::in_tree_order(cut_to_manifold(&clean(soup).unwrap()))
    }

    #[test]
    fn what_a_round_looks_at_grows_with_the_faces_and_not_with_the_square_of_a_fan() {
        let look = |ring: u32| {
            let mesh = cone(ring);
            let mut work = Work::new(&mesh, 50);
            while work.topology.alive > 50 && !work.round(50, true).made.is_empty() {}
            assert!(work.topology.alive < ring / 4, "{ring}: it gets coarser");
            work.gone_round
        };
        let looks = [500, 1000, 2000, 4000].map(look);
        for pair in looks.windows(2) {
            assert!(
                pair[1] < 3 * pair[0],
                "{looks:?} for 500, twice that, and so on"
            );
        }
    }

    #[test]
    fn the_limit_of_chains_is_four_a_halving_beyond_a_million_faces() {
        for faces in [1e6, 1e7, 1e8] {
            let vertices = faces / 2.0;
            let limit = f64::from(limit_of_chains(vertices as usize, 700));
            let left: f64 = 0.6 * 700.0;
            assert!(limit <= 4.0 * (vertices / left).log2() && limit >= 40.0);
        }
        assert_eq!(limit_of_chains(50_000, 700), 40);
    }
}
