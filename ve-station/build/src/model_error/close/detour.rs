//! The trace of an edge along which no plane leads from foot to foot, as from leg to leg: over the
//! sides that are nearest to it.
//!
//! Of all paths it is one whose farthest point is nearest to the edge, and of those one over few
//! sides.

use super::trace::{Edge, Paths, Traces};
use geometry::closest_points_of_segments;
use glam::DVec3;
use spm::NONE;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// A path to a face: largest squared distance from the edge, as ordered bits, sides crossed, face.
type Path = (u64, u32, u32);

/// By face: the best path to it, and the side of the face before that leads to it.
type Best = BTreeMap<u32, (Path, (u32, usize))>;

impl Traces<'_> {
    /// Adds the path and returns its largest squared distance from the edge. `None` where the feet
    /// are too far apart, or all paths stray farther than `limit`, squared.
    pub fn detour(&self, edge: &Edge<'_>, limit: f64, out: &mut Paths) -> Option<f64> {
        let [from, to] = edge.feet.map(|foot| foot.face);
        let start = edge.foot_distance_squared();
        let mut waiting = BinaryHeap::from([Reverse((start.to_bits(), 0, from))]);
        let mut best = Best::from([(from, ((start.to_bits(), 0, from), (NONE, 0)))]);
        for _ in 0..self.most_steps(edge) {
            let Reverse((most, steps, face)) = waiting.pop()?;
            if face == to {
                self.follow_back(edge, &best, out);
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
                let away = edge.distance_squared(self.nearest_on_side(edge, face, side));
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

    /// The point of a side that is nearest to the edge.
    fn nearest_on_side(&self, edge: &Edge<'_>, face: u32, side: usize) -> DVec3 {
        let corners = self.full.corners(face);
        let ends = [1, 2].map(|k| corners[(side + k) % 3]);
        closest_points_of_segments(ends, edge.at).points[0]
    }

    fn follow_back(&self, edge: &Edge<'_>, best: &Best, out: &mut Paths) {
        let [from, to] = edge.feet;
        let first = out.mark();
        out.arrive(to.point);
        let mut face = to.face;
        while let Some(&(_, (before, side))) = best.get(&face).filter(|of| of.1.0 != NONE) {
            let corners = self.full.triangles()[before as usize];
            // What the side leads to is on the left of the path.
            let crossing = (corners[(side + 2) % 3], corners[(side + 1) % 3]);
            out.crossings.push(crossing);
            out.go_on(self.nearest_on_side(edge, before, side), face);
            face = before;
        }
        out.go_on(from.point, from.face);
        out.crossings[first[0]..].reverse();
        out.corners[first[1]..].reverse();
    }
}
