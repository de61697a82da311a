//! The parts of a coarse face: how far their points are from the full mesh.
//!
//! Each point of a face T is met by the map that takes the patch to the nearest points of T, or by
//! a line that connects a point of a trace there with its edge (see [`super`]). It is no farther
//! from the full mesh than what is taken to it. So the bound of a part of T is the largest distance
//! of
//!
//! - the pieces of the patch that may be taken to it. The distance from T is a convex function, and
//!   the distance from T in its plane is one too: what lies beside T is taken no farther aside than
//!   the corner of its piece that lies farthest beside it. A triangle above T is cut at the lines
//!   between parts, and the distance of a cut corner is no more than what its ends give there.
//! - the lines that may meet it. All of a line is as near to the edge's point as the trace's point
//!   is, seen in T's plane.

use super::patch::Search;
use super::plane::{Plane, Seen};
use super::{Patch, Patches, Traced};
use crate::tuning::quarters::DEPTH;
use geometry::closest_point_on_segment;
use glam::DVec3;
use spm::NONE;

/// Parts along a side of a face.
const PARTS_A_SIDE: usize = 1 << DEPTH;
/// The least parts of a face.
const PARTS: usize = PARTS_A_SIDE * PARTS_A_SIDE;
/// The most corners of a triangle that is cut at three lines.
const MAX_CORNERS: usize = 6;

/// Bounds of the least parts of a face, model units, in the order of the quarters that hold them.
#[derive(Debug, Clone)]
pub struct PartBounds([f64; PARTS]);

impl PartBounds {
    /// The bounds of the quarters of a part, by depth and place among the parts of that depth.
    pub fn quarters(&self, depth: u32, place: usize) -> [f64; 4] {
        let count = PARTS >> (2 * (depth + 1));
        [0, 1, 2, 3].map(|quarter| {
            let first = (4 * place + quarter) * count;
            self.0[first..first + count]
                .iter()
                .copied()
                .fold(0.0, f64::max)
        })
    }
}

/// Room for searches of parts. Memory: 4 B a vertex, 4 B a face.
pub struct PartSearch {
    /// By face: the last search that found it.
    found: Vec<u32>,
    number: u32,
    faces: Vec<u32>,
    /// By vertex: its place among those inside.
    place: Vec<u32>,
    /// Parts of traces: face, and the ends of the path in it.
    paths: Vec<(u32, [Seen; 2])>,
    /// Places on the grid, by which corner comes first in the file.
    orders: [[usize; PARTS]; 3],
}

impl PartSearch {
    fn begin(&mut self) {
        self.faces.clear();
        self.paths.clear();
        if self.number == u32::MAX {
            self.found.fill(0);
            self.number = 0;
        }
        self.number += 1;
    }

    fn find(&mut self, face: u32) {
        if std::mem::replace(&mut self.found[face as usize], self.number) != self.number {
            self.faces.push(face);
        }
    }
}

impl Patches<'_> {
    /// Room for searches of parts.
    pub fn part_search(&self) -> PartSearch {
        PartSearch {
            found: vec![0; self.full().triangles().len()],
            number: 0,
            faces: Vec::new(),
            place: vec![0; self.history.full_vertices as usize],
            paths: Vec::new(),
            orders: [0, 1, 2].map(order),
        }
    }

    /// Bounds of the parts of a face whose patch was found last, in the order that begins with its
    /// corner `first`; `None` for a face without area.
    pub(super) fn parts(
        &self,
        (corners, first): ([u32; 3], usize),
        patch: &Patch,
        (traced, search): (&Traced, &Search),
        room: &mut PartSearch,
    ) -> Option<PartBounds> {
        if patch.plane.is_sliver() {
            return None;
        }
        let mut parts = Parts::new(&patch.plane);
        for (k, corner) in corners.into_iter().enumerate() {
            parts.add_foot(k, self.feet[corner as usize].point);
        }
        room.begin();
        for (k, trace) in patch.edges.iter().enumerate() {
            let mut before: Option<(Seen, Line, u32)> = None;
            for &(corner, face) in traced.corners(trace) {
                let (seen, line) = (patch.plane.see(corner), parts.line(k, corner));
                if let Some((from, first, face)) = before {
                    parts.add_lines(k, [first, line]);
                    room.paths.push((face, [from, seen]));
                }
                before = Some((seen, line, face));
            }
        }
        room.paths.sort_by_key(|path| path.0);
        self.add_pieces(search, room, &mut parts)?;
        Some(PartBounds(
            room.orders[first].map(|place| patch.plane.rounded_up(parts.bounds[place])),
        ))
    }

    /// Adds the pieces: what the traces leave of faces that they lie in, and the faces inside.
    fn add_pieces(
        &self,
        search: &Search,
        room: &mut PartSearch,
        parts: &mut Parts<'_>,
    ) -> Option<()> {
        for k in 0..room.paths.len() {
            room.find(room.paths[k].0);
        }
        for (place, &(vertex, _)) in (0..).zip(search.inside()) {
            room.place[vertex as usize] = place;
        }
        let mut next = 0;
        while let Some(&face) = room.faces.get(next) {
            next += 1;
            let corners = self.full().triangles()[face as usize];
            let inside = corners.map(|v| search.holds(v));
            let first = room.paths.partition_point(|path| path.0 < face);
            let paths = room.paths[first..].iter().take_while(|path| path.0 == face);
            let own = (0..3).filter(|&k| inside[k]);
            let own = own.map(|k| search.inside()[room.place[corners[k] as usize] as usize].1);
            let is_crossed = room.paths.get(first).is_some_and(|path| path.0 == face);
            if !(is_crossed || inside == [true; 3]) {
                return None;
            }
            parts.add_piece(own.chain(paths.flat_map(|path| path.1)));
            for beside in self.full().neighbours()[face as usize] {
                let is_inside = |&v: &u32| search.holds(v);
                if beside != NONE
                    && self.full().triangles()[beside as usize]
                        .iter()
                        .any(is_inside)
                {
                    room.find(beside);
                }
            }
        }
        Some(())
    }
}

/// A point of a trace seen from its edge.
#[derive(Debug, Clone, Copy)]
struct Line {
    /// Where on the edge the nearest point is, from its start to its end.
    share: f64,
    /// How far that is, and how far seen along the normal of the face.
    away: f64,
    beside: f64,
}

/// A face with bounds of its least parts.
struct Parts<'a> {
    plane: &'a Plane,
    /// By place on the grid.
    bounds: [f64; 2 * PARTS],
}

impl<'a> Parts<'a> {
    fn new(plane: &'a Plane) -> Self {
        Self {
            plane,
            bounds: [0.0; 2 * PARTS],
        }
    }

    /// Adds the line from a foot to its corner.
    fn add_foot(&mut self, corner: usize, foot: DVec3) {
        let at = self.plane.corners()[corner];
        let mut weights = [0.0; 3];
        weights[corner] = 1.0;
        let beside = self.plane.in_plane(foot - at);
        self.raise([weights; 2], beside, foot.distance(at));
    }

    /// A point of the trace of the edge that begins at a corner.
    fn line(&self, corner: usize, point: DVec3) -> Line {
        let [from, to] = [0, 1].map(|k| self.plane.corners()[(corner + k) % 3]);
        let share = closest_point_on_segment(from, to, point);
        let off = point - (from + (to - from) * share);
        Line {
            share,
            away: off.length(),
            beside: self.plane.in_plane(off),
        }
    }

    /// Adds the lines from a path to the edge that begins at a corner.
    fn add_lines(&mut self, corner: usize, path: [Line; 2]) {
        let weights = path.map(|line| {
            let mut weights = [0.0; 3];
            weights[corner] = 1.0 - line.share;
            weights[(corner + 1) % 3] = line.share;
            weights
        });
        let [beside, away] = [path.map(|line| line.beside), path.map(|line| line.away)];
        self.raise(weights, beside[0].max(beside[1]), away[0].max(away[1]));
    }

    /// Adds what is within the convex hull of some points.
    fn add_piece(&mut self, points: impl Iterator<Item = Seen>) {
        let mut seen = [None; 3];
        let (mut count, mut beside, mut away) = (0, 0.0_f64, 0.0_f64);
        let mut ends = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for found in points {
            if let Some(place) = seen.get_mut(count) {
                *place = Some(found);
            }
            count += 1;
            beside = beside.max(found.beside);
            away = away.max(found.away);
            let [low, high] = &mut ends;
            for (k, weight) in found.weights.into_iter().enumerate() {
                low[k] = low[k].min(weight);
                high[k] = high[k].max(weight);
            }
        }
        match seen {
            [Some(a), Some(b), Some(c)] if count == 3 && beside == 0.0 => {
                self.raise_below([a, b, c], ends);
            }
            _ => self.raise(ends, beside, away),
        }
    }

    /// Raises the bounds of parts that may hold points with weights between two, or beside those.
    fn raise(&mut self, ends: [[f64; 3]; 2], beside: f64, away: f64) {
        let mut wider = [[0.0; 3]; 2];
        for k in 0..3 {
            let more = self.plane.weight_of(k, beside) + self.plane.slack(k);
            let [one, other] = [ends[0][k], ends[1][k]];
            wider[0][k] = one.min(other) - more;
            wider[1][k] = one.max(other) + more;
        }
        for_each_part(wider, |place, _, _| {
            self.bounds[place] = self.bounds[place].max(away);
        });
    }

    /// Raises the bounds of parts below a triangle.
    fn raise_below(&mut self, triangle: [Seen; 3], ends: [[f64; 3]; 2]) {
        let most = triangle[0].away.max(triangle[1].away).max(triangle[2].away);
        let slack = [0, 1, 2].map(|k| self.plane.slack(k));
        let [low, high] = ends;
        let around = [
            [0, 1, 2].map(|k| low[k] - slack[k]),
            [0, 1, 2].map(|k| high[k] + slack[k]),
        ];
        let bounds = &mut self.bounds;
        for_each_part(around, |place, steps, is_upright| {
            if most <= bounds[place] {
                return;
            }
            let mut cut = Cut::of(triangle);
            for k in 0..3 {
                let sign = if is_upright { 1.0 } else { -1.0 };
                let line = steps[k] + if is_upright { 0.0 } else { 1.0 };
                let line = line / PARTS_A_SIDE as f64 - sign * slack[k];
                cut.keep(|weights| sign * (weights[k] - line));
            }
            bounds[place] = bounds[place].max(cut.most());
        });
    }
}

/// A part of a triangle: weights of its corners, and bounds of their distances.
struct Cut {
    corners: [([f64; 3], f64); MAX_CORNERS],
    count: usize,
}

impl Cut {
    fn of(triangle: [Seen; 3]) -> Self {
        let mut corners = [([0.0; 3], 0.0); MAX_CORNERS];
        for (corner, seen) in corners.iter_mut().zip(triangle) {
            *corner = (seen.weights, seen.away);
        }
        Self { corners, count: 3 }
    }

    /// Keeps what is on one side of a line.
    #[inline]
    fn keep(&mut self, height: impl Fn(&[f64; 3]) -> f64) {
        let mut heights = [0.0; MAX_CORNERS];
        let mut is_all = true;
        for (found, corner) in heights.iter_mut().zip(&self.corners[..self.count]) {
            *found = height(&corner.0);
            is_all &= *found >= 0.0;
        }
        if is_all {
            return;
        }
        let old = self.corners;
        let count = std::mem::take(&mut self.count);
        for k in 0..count {
            let next = if k + 1 == count { 0 } else { k + 1 };
            let (from, to) = (heights[k], heights[next]);
            if from >= 0.0 {
                self.push(old[k]);
            }
            if (from < 0.0) != (to < 0.0) {
                let share = from / (from - to);
                let between = |a: f64, b: f64| a + (b - a) * share;
                let [a, b, c] = old[k].0;
                let [p, q, r] = old[next].0;
                let weights = [between(a, p), between(b, q), between(c, r)];
                self.push((weights, between(old[k].1, old[next].1)));
            }
        }
    }

    fn push(&mut self, corner: ([f64; 3], f64)) {
        // A convex figure meets a line twice.
        if let Some(place) = self.corners.get_mut(self.count) {
            *place = corner;
            self.count += 1;
        }
    }

    fn most(&self) -> f64 {
        let corners = self.corners[..self.count].iter();
        corners.map(|corner| corner.1).fold(0.0, f64::max)
    }
}

/// Visits the least parts that meet a box of weights: the place on the grid, the steps of the three
/// weights, and whether it lies as the face does.
fn for_each_part([low, high]: [[f64; 3]; 2], mut visit: impl FnMut(usize, [f64; 3], bool)) {
    let side = PARTS_A_SIDE as f64;
    // What is below the first part is cut off to it.
    let step = |weight: f64| ((weight * side) as usize).min(PARTS_A_SIDE - 1);
    for i in step(low[0])..=step(high[0]) {
        for j in step(low[1])..=step(high[1]) {
            for is_upright in [true, false] {
                // The steps of one that lies as the face does add up to one more.
                let steps = PARTS_A_SIDE - 1 - usize::from(!is_upright);
                let Some(k) = steps.checked_sub(i + j) else {
                    continue;
                };
                let (from, to) = (k as f64 / side, (k + 1) as f64 / side);
                if low[2] <= to && high[2] >= from {
                    visit(
                        place_of(i, j, is_upright),
                        [i, j, k].map(|step| step as f64),
                        is_upright,
                    );
                }
            }
        }
    }
}

fn place_of(i: usize, j: usize, is_upright: bool) -> usize {
    2 * (i * PARTS_A_SIDE + j) + usize::from(is_upright)
}

/// The places on the grid of the least parts, in the order of the quarters that hold them, of a
/// face whose corner `first` comes first.
fn order(first: usize) -> [usize; PARTS] {
    let mut corners = [DVec3::X, DVec3::Y, DVec3::Z];
    corners.rotate_left(first);
    let mut parts = vec![corners];
    for _ in 0..DEPTH {
        parts = parts.into_iter().flat_map(quarters).collect();
    }
    let mut order = [0; PARTS];
    for (place, [a, b, c]) in order.iter_mut().zip(parts) {
        let middle = (a + b + c) * (PARTS_A_SIDE as f64 / 3.0);
        let [i, j, k] = middle.to_array().map(|weight| weight as usize);
        *place = place_of(i, j, i + j + k + 1 == PARTS_A_SIDE);
    }
    order
}

/// The quarters of a triangle, in the order of [`spm::QuarterCodes`].
fn quarters([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    let [ab, bc, ca] = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
    [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn weights() -> impl Strategy<Value = [f64; 3]> {
        (0.0..1.0f64, 0.0..1.0f64).prop_map(|(s, t)| {
            let (s, t) = if s + t > 1.0 {
                (1.0 - s, 1.0 - t)
            } else {
                (s, t)
            };
            [1.0 - s - t, s, t]
        })
    }

    /// The place among the least parts of the one that holds a point, quarter by quarter.
    fn part_of(point: [f64; 3], first: usize) -> usize {
        let mut corners = [DVec3::X, DVec3::Y, DVec3::Z];
        corners.rotate_left(first);
        let point = DVec3::from_array(point);
        (0..DEPTH).fold(0, |place, _| {
            // Of a triangle in the plane x + y + z = 1.
            let holds = |[a, b, c]: [DVec3; 3]| {
                let side = |p: DVec3, q: DVec3| (q - p).cross(point - p).dot(DVec3::ONE);
                side(a, b).min(side(b, c)).min(side(c, a))
            };
            let cut = quarters(corners);
            let by_depth = |a: &usize, b: &usize| holds(cut[*a]).total_cmp(&holds(cut[*b]));
            let quarter = (0..4).max_by(by_depth).expect("four");
            corners = cut[quarter];
            4 * place + quarter
        })
    }

    proptest! {
        #[test]
        fn what_is_said_of_a_point_is_said_of_the_part_that_holds_it(
            point in weights(), first in 0..3usize,
        ) {
            let plane = Plane::new([DVec3::X, DVec3::Y, DVec3::ZERO], 1e-15);
            let mut parts = Parts::new(&plane);
            parts.raise([point; 2], 0.0, 3.0);
            let place = part_of(point, first);
            prop_assert_eq!(parts.bounds[order(first)[place]], 3.0);
            let bounds = PartBounds(order(first).map(|at| parts.bounds[at]));
            prop_assert_eq!(bounds.quarters(DEPTH - 1, place / 4)[place % 4], 3.0);
            prop_assert_eq!(bounds.quarters(0, 0)[place >> (2 * (DEPTH - 1))], 3.0);
            prop_assert!(parts.bounds.iter().filter(|&&bound| bound > 0.0).count() <= 6);
        }

        /// Under a triangle each part has the largest distance of the points above it, and no more
        /// than the largest of all.
        #[test]
        fn a_triangle_above_a_face_is_cut_at_its_parts(
            triangle in prop::array::uniform3((weights(), 0.0..1.0f64)), point in weights(),
        ) {
            let plane = Plane::new([DVec3::X, DVec3::Y, DVec3::ZERO], 1e-15);
            let mut parts = Parts::new(&plane);
            let piece = triangle.map(|(weights, away)| Seen { weights, away, beside: 0.0 });
            parts.add_piece(piece.into_iter());
            let mix = |of: &dyn Fn(&Seen) -> f64| -> f64 {
                piece.iter().zip(point).map(|(seen, weight)| of(seen) * weight).sum()
            };
            let at = [0, 1, 2].map(|k| mix(&|seen| seen.weights[k]));
            let bound = parts.bounds[order(0)[part_of(at, 0)]];
            prop_assert!(bound >= mix(&|seen| seen.away) - 1e-12);
            let most = piece.iter().map(|seen| seen.away).fold(0.0, f64::max);
            prop_assert!(parts.bounds.iter().all(|&bound| bound <= most));
        }
    }
}
