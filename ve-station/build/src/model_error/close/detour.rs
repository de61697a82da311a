//! The trace of an edge along which no plane leads from foot to foot, as from leg to leg: over the
//! sides that are nearest to it.
//!
//! Of all paths it is one whose farthest point is nearest to the edge, and of those one over few
//! sides.

use super::trace::{Crossing, Edge, Traces};
use spm::NONE;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// Thirds that are cut off a side, so that its nearest point lies in the thousandth that is left.
const CUTS: u32 = 17;

/// A path to a face: largest squared distance from the edge, as ordered bits, sides crossed, face.
type Path = (u64, u32, u32);

/// By face: the best path to it, and the side of the face before that leads to it.
type Paths = BTreeMap<u32, (Path, (u32, usize))>;

impl Traces<'_> {
    /// Adds the crossings of the path and returns its largest squared distance from the edge.
    /// `None` where the feet are too far apart, or all paths stray farther than `limit`, squared.
    pub fn detour(&self, edge: &Edge<'_>, limit: f64, out: &mut Vec<Crossing>) -> Option<f64> {
        let [from, to] = edge.feet.map(|foot| foot.face);
        let start = edge.foot_distance_squared();
        let mut waiting = BinaryHeap::from([Reverse((start.to_bits(), 0, from))]);
        let mut best = Paths::from([(from, ((start.to_bits(), 0, from), (NONE, 0)))]);
        for _ in 0..self.most_steps(edge) {
            let Reverse((most, steps, face)) = waiting.pop()?;
            if face == to {
                self.follow_back(&best, to, out);
                return Some(f64::from_bits(most));
            }
            if best[&face].0 != (most, steps, face) {
                continue;
            }
            for (side, &next) in self.full.neighbours()[face as usize].iter().enumerate() {
                let known = best.get(&next).map(|known| known.0);
                let is_better = |path: Path| known.is_none_or(|known| path < known);
                if next == NONE || !is_better((most, steps + 1, next)) {
                    continue;
                }
                let away = self.side_distance_squared(edge, face, side);
                if away > limit || away.is_nan() {
                    continue;
                }
                // The bits of numbers that are not negative are in their order.
                let path = (most.max(away.to_bits()), steps + 1, next);
                if is_better(path) {
                    best.insert(next, (path, (face, side)));
                    waiting.push(Reverse(path));
                }
            }
        }
        None
    }

    /// The squared distance of a point of a side that is near the edge.
    fn side_distance_squared(&self, edge: &Edge<'_>, face: u32, side: usize) -> f64 {
        let corners = self.full.corners(face);
        let [a, b] = [1, 2].map(|k| corners[(side + k) % 3]);
        let away = |share: f64| edge.distance_squared(a + (b - a) * share);
        // The distance from the edge is a convex function.
        let (mut from, mut to) = (0.0, 1.0);
        for _ in 0..CUTS {
            let third = (to - from) / 3.0;
            if away(from + third) <= away(to - third) {
                to -= third;
            } else {
                from += third;
            }
        }
        away((from + to) * 0.5)
    }

    fn follow_back(&self, best: &Paths, to: u32, out: &mut Vec<Crossing>) {
        let first = out.len();
        let mut face = to;
        while let Some(&(_, (before, side))) = best.get(&face).filter(|of| of.1.0 != NONE) {
            let corners = self.full.triangles()[before as usize];
            // What the side leads to is on the left of the path.
            out.push((corners[(side + 2) % 3], corners[(side + 1) % 3]));
            face = before;
        }
        out[first..].reverse();
    }
}
