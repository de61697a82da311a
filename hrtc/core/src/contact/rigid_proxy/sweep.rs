//! The free share of a motion: no face of the tool comes nearer to the surface than a minimum
//! separation.
//!
//! Conservative advancement pair by pair (Mirtich 1996, Redon 2002). Along a fixed direction the
//! separation of a pair is at least the linear interpolation between start and end, less the
//! sagitta of the rotation. If that does not certify the whole motion, it certifies a part, after
//! which the closest points give a better direction. Every placement on the way is safe, so an
//! early stop is safe too.

use super::contacts::PASSED;
use super::neighbourhood::{Direction, NearPair, Neighbourhood, PLACED, apart, reach_along};
use super::shape::ToolShape;
use crate::contact::motion::{Placement, Twist};
use geometry::closest_points_of_triangles;
use glam::{DMat3, DVec3};

/// Parts per pair.
const PARTS: u32 = 16;
/// Share of the remaining motion below which a part along one direction is short, so that turning
/// directions are tried.
const SHORT: f64 = 0.25;
/// Trials of a part along turning directions.
const TRIES: u32 = 3;
/// Cost of a pair that is swept, and of each part of its motion or the closest points of two faces,
/// in node pairs (measured).
const SWEPT: u32 = 4;
pub(super) const PART: u32 = 18;
/// Reduction of a part against rounding.
const WITHIN: f64 = 1.0 - 1e-6;
/// Share of the minimum separation within which a pair counts as stopped.
const TOUCH: f64 = 0.05;

/// The part of the minimum separation that a pair keeps along its direction at least, if it is
/// nearer already: along a direction that has become a bad one it seems nearer than it is.
const KEPT: f64 = 0.25;

/// Share of the distance of the closest points by which their direction must separate the faces;
/// below, the direction is rounding.
const CLEAR: f64 = 0.99;

/// The result of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swept {
    /// Free share of the motion, 0 to 1.
    pub share: f64,
    /// The pair that stopped it.
    pub stop: Option<usize>,
    /// Cost, in node pairs.
    pub spent: u32,
    /// Whether every pair was swept. If not, the share is a safe lower bound.
    pub is_all: bool,
}

/// A pair that its direction does not separate on the whole motion.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Open {
    /// The share up to which it does.
    until: f64,
    /// Separation at the start.
    now: f64,
    pair: u32,
}

/// Upper bound of what a sweep costs before the first pair is swept, in node pairs.
pub fn least_cost(near: &Neighbourhood) -> u32 {
    near.vertex_count() / PLACED + PASSED * near.pairs.len() as u32
}

/// The free share of a motion of a placed neighbourhood. Pairs keep a distance of `min_separation`
/// (model units), or of half their distance if they are nearer already. If `most` node pairs are
/// spent, the remaining pairs are free as far as their separation tells.
///
/// The pair that seems to stop first is swept first; most others then need no sweep.
pub fn free_share(
    near: &mut Neighbourhood,
    open: &mut Vec<Open>,
    shape: &ToolShape,
    (start, motion): (&Placement, &Twist),
    min_separation: f64,
    most: u32,
) -> Swept {
    let mut swept = Swept {
        share: 1.0,
        stop: None,
        spent: near.vertex_count() / PLACED,
        is_all: true,
    };
    near.place_ends(shape, &start.moved(motion));
    let bends = Bends {
        sagitta: motion.sagitta(shape.radius),
        turn: motion.angular.length(),
        travel: motion.linear.length(),
        centre: start.centre,
    };
    let clear = near.gap_beyond(motion, start, min_separation);
    swept.spent += PASSED * bends.collect_open(near, open, shape, [clear, min_separation]);
    let mut sweep = Sweep {
        shape,
        start,
        motion,
        bends,
        min_separation,
        last_direction: DVec3::ZERO,
    };
    for &Open { until, now, pair } in open.iter() {
        if until >= swept.share {
            break;
        }
        let parts = most.saturating_sub(swept.spent + SWEPT) / PART;
        if parts == 0 {
            swept.is_all = false;
            let room = (now - min_separation).max(0.0) * WITHIN;
            let share = until.max(room / motion.farthest(shape.radius));
            if share < swept.share {
                swept.share = share;
                swept.stop = None;
            }
            continue;
        }
        sweep.advance_pair(near, pair as usize, parts, &mut swept);
    }
    swept
}

/// The sweep of all pairs along one motion.
struct Sweep<'a> {
    shape: &'a ToolShape,
    start: &'a Placement,
    motion: &'a Twist,
    bends: Bends,
    min_separation: f64,
    /// The separating direction found last.
    last_direction: DVec3,
}

impl Sweep<'_> {
    /// Shortens the free share by one pair, of whose motion at most so many parts are examined.
    fn advance_pair(
        &mut self,
        near: &mut Neighbourhood,
        k: usize,
        most_parts: u32,
        swept: &mut Swept,
    ) {
        let (shape, min_separation) = (self.shape, self.min_separation);
        let mut pair = near.pairs[k];
        let [corners, ends] = [
            near.corners(shape, pair.tool),
            near.end_corners(shape, pair.tool),
        ];
        let surface = near.faces[pair.surface as usize].corners;
        // Mostly the direction of this face or a neighbour separates, or one of the normals.
        let height = reach_along(self.last_direction, surface);
        let beside = Direction::Still {
            direction: self.last_direction,
            height,
        };
        let [over, under] = near.normals(shape, &pair, corners);
        swept.spent += SWEPT;
        if let Some(along) = [beside, over, under].into_iter().find(|&along| {
            pair.along = along;
            let ends = [corners, ends];
            let (_, until) = self
                .bends
                .clear_until(near, &pair, surface, ends, min_separation);
            until >= swept.share
        }) {
            near.pairs[k].along = along;
            return;
        }
        let mut pair_sweep = PairSweep {
            surface,
            end: (near.end_rotation(), ends),
            arms: shape.faces[pair.tool as usize]
                .vertices
                .map(|v| shape.points[v as usize]),
            start: self.start,
            motion: self.motion,
            sagitta: self.bends.sagitta,
            sagitta_from_tool: self.bends.seen_from_tool(surface),
            min_separation,
        };
        let (share, along, parts) = pair_sweep.until(swept.share, corners, most_parts);
        swept.spent += PART * parts;
        if let Some(along) = along {
            near.pairs[k].along = along;
            self.last_direction = near.direction(&near.pairs[k]);
        }
        if share < swept.share {
            // Pairs that are as near, as those under a flat face, end as far but for rounding.
            swept.share = share * WITHIN;
            swept.stop = Some(k);
        }
    }
}

/// Deviation of a motion from straight lines between its start and its end.
struct Bends {
    sagitta: f64,
    turn: f64,
    travel: f64,
    centre: DVec3,
}

impl Bends {
    /// Lists the pairs that their direction does not separate on the whole motion, the most urgent
    /// first. Pairs with a gap beyond `clear` are skipped; the number of the others.
    fn collect_open(
        &self,
        near: &Neighbourhood,
        open: &mut Vec<Open>,
        shape: &ToolShape,
        [clear, min_separation]: [f64; 2],
    ) -> u32 {
        open.clear();
        let mut looked_at = 0;
        for k in 0..near.pairs.len() {
            if near.is_beyond(k, clear) {
                continue;
            }
            looked_at += 1;
            let pair = near.pairs[k];
            let ends = [
                near.corners(shape, pair.tool),
                near.end_corners(shape, pair.tool),
            ];
            let surface = near.faces[pair.surface as usize].corners;
            let (now, until) = self.clear_until(near, &pair, surface, ends, min_separation);
            if until < 1.0 {
                let pair = k as u32;
                open.push(Open { until, now, pair });
            }
        }
        open.sort_unstable_by(|a, b| {
            let by_share = a.until.total_cmp(&b.until);
            by_share.then(a.pair.cmp(&b.pair))
        });
        looked_at
    }

    /// Bound of the deviation of the surface's corners from straight lines, in the tool's frame:
    /// [`Twist::sagitta`] plus the part of the turning frame.
    #[inline]
    fn seen_from_tool(&self, surface: [DVec3; 3]) -> f64 {
        let farthest = surface.iter().fold(0.0f64, |most, corner| {
            most.max(corner.distance_squared(self.centre))
        });
        0.125 * self.turn * (self.turn * (farthest.sqrt() + self.travel) + 2.0 * self.travel)
    }

    /// Separation of a pair along its direction, and the share of the motion up to which it stays
    /// above the minimum. On straight lines it is at least the interpolation between both ends.
    #[inline]
    fn clear_until(
        &self,
        near: &Neighbourhood,
        pair: &NearPair,
        surface: [DVec3; 3],
        [corners, ends]: [[DVec3; 3]; 2],
        min_separation: f64,
    ) -> (f64, f64) {
        let bend = match pair.along {
            Direction::Still { .. } => self.sagitta,
            Direction::Turning(_) => self.seen_from_tool(surface),
        };
        let [now, then] = [near.apart_now(pair, corners), near.apart_then(pair, ends)];
        let kept = min_separation.min((0.5 * now).max(KEPT * min_separation));
        let room = now - bend - kept;
        let until = if room < 0.0 {
            0.0
        } else if then - bend >= kept {
            1.0
        } else {
            room / (now - then) * WITHIN
        };
        (now, until)
    }
}

/// The axis of largest separation among a direction, the normals of two faces and the cross
/// products of their edges: one of these separates any two disjoint faces.
fn most_apart(direction: DVec3, surface: [DVec3; 3], tool: [DVec3; 3]) -> DVec3 {
    let edges = |[a, b, c]: [DVec3; 3]| [b - a, c - b, a - c];
    let (of_surface, of_tool) = (edges(surface), edges(tool));
    let normals = [of_surface, of_tool].map(|[u, v, _]| u.cross(v));
    let across = of_surface
        .iter()
        .flat_map(|u| of_tool.iter().map(|v| u.cross(*v)));
    let mut best = direction;
    let mut most = apart(best, reach_along(best, surface), tool);
    for axis in normals.into_iter().chain(across) {
        let Some(axis) = axis.try_normalize() else {
            continue;
        };
        for axis in [axis, -axis] {
            let now = apart(axis, reach_along(axis, surface), tool);
            if now > most {
                (best, most) = (axis, now);
            }
        }
    }
    best
}

/// The direction of largest separation of two faces, within rounding, and that separation; `None`
/// if they meet.
fn separating_direction(surface: [DVec3; 3], tool: [DVec3; 3]) -> Option<(DVec3, f64)> {
    let closest = closest_points_of_triangles(surface, tool);
    let [from, to] = closest.points;
    let direction = (to - from).try_normalize()?;
    let now = apart(direction, reach_along(direction, surface), tool);
    if now >= CLEAR * from.distance(to) {
        return Some((direction, now));
    }
    // So near that the direction between the points is rounding: an axis of the faces is better.
    let direction = most_apart(direction, surface, tool);
    Some((
        direction,
        apart(direction, reach_along(direction, surface), tool),
    ))
}

/// The sweep of one pair.
struct PairSweep<'a> {
    surface: [DVec3; 3],
    /// The tool's axes and the corners of its face at the end of the motion.
    end: (DMat3, [DVec3; 3]),
    /// Corners of the tool's face about its centre.
    arms: [DVec3; 3],
    start: &'a Placement,
    motion: &'a Twist,
    sagitta: f64,
    sagitta_from_tool: f64,
    min_separation: f64,
}

impl PairSweep<'_> {
    fn at(&self, share: f64) -> (DMat3, [DVec3; 3]) {
        if share == 1.0 {
            return self.end;
        }
        let at = self.start.moved(&self.motion.times(share));
        let rotation = at.rotation();
        (rotation, self.arms.map(|arm| at.centre + rotation * arm))
    }

    /// The free share up to `whole` as far as `most_parts` parts tell, at least 1, the direction
    /// at the start, and the parts examined.
    fn until(
        &mut self,
        whole: f64,
        corners: [DVec3; 3],
        most_parts: u32,
    ) -> (f64, Option<Direction>, u32) {
        let (mut share, mut corners, mut first) = (0.0, corners, None);
        let mut rotation = self.start.rotation();
        let mut parts = 0;
        while parts < PARTS.min(most_parts) {
            parts += 1;
            let Some((direction, now)) = separating_direction(self.surface, corners) else {
                return (share, first, parts);
            };
            let height = reach_along(direction, self.surface);
            if first.is_none() {
                self.min_separation = self.min_separation.min(0.5 * now);
            }
            let room = now - self.min_separation;
            if room <= TOUCH * self.min_separation {
                return (share, first, parts);
            }
            let left = whole - share;
            let back = rotation.transpose() * direction;
            let still = self.part(share, left, room, self.sagitta, |_, ends| {
                now - apart(direction, height, ends)
            });
            let mut part = still;
            let mut along = Direction::Still { direction, height };
            if still < left {
                let turning =
                    self.part(share, left, room, self.sagitta_from_tool, |turned, ends| {
                        let direction = turned * back;
                        now - apart(direction, reach_along(direction, self.surface), ends)
                    });
                if turning > still {
                    part = turning;
                    along = Direction::Turning(back);
                }
            }
            first = first.or(Some(along));
            if part < SHORT * left && parts + TRIES <= most_parts {
                // If a wide face rolls over a contact, a direction fixed to either body soon fails.
                let (most, tries) =
                    self.part_along_turning_direction(share, left, direction, now, corners);
                parts += tries;
                part = part.max(most);
            }
            share += part;
            if share >= whole {
                return (whole, first, parts);
            }
            (rotation, corners) = self.at(share);
        }
        (share, first, parts)
    }

    /// The free part after a share along directions that turn evenly from `direction`, with
    /// separation `now`, to the separating direction at the end of the part; 0 if none is found.
    /// And the number of trials.
    ///
    /// The product of an evenly turning direction and a straight motion is a parabola, below its
    /// chord by at most a quarter of the turn times the motion. Directions between two unit vectors
    /// are not longer than these.
    fn part_along_turning_direction(
        &self,
        share: f64,
        left: f64,
        direction: DVec3,
        now: f64,
        corners: [DVec3; 3],
    ) -> (f64, u32) {
        let mut span = left.min((0.5 * (now - self.min_separation) / self.sagitta).sqrt());
        for tries in 1..=TRIES {
            let (_, ends) = self.at(share + span);
            let mut shorter = 0.5;
            if let Some((there, then)) = separating_direction(self.surface, ends) {
                let turn = there - direction;
                let below = (0..3)
                    .map(|k| 0.25 * turn.dot(ends[k] - corners[k]).abs())
                    .fold(0.0, f64::max);
                let bend = below + self.sagitta * span * span;
                let room = now.min(then) - self.min_separation;
                if bend <= room {
                    return (span * WITHIN, tries);
                }
                // Both are quadratic in the part.
                shorter = (room.max(0.0) / bend).sqrt().clamp(0.25, 0.75);
            }
            span *= shorter;
        }
        (0.0, TRIES)
    }

    /// The free part after a share along one direction, at most `left`. `closer`: the loss of
    /// separation up to given corners of the tool.
    fn part(
        &self,
        share: f64,
        left: f64,
        room: f64,
        sagitta: f64,
        closer: impl Fn(DMat3, [DVec3; 3]) -> f64,
    ) -> f64 {
        // Short enough for the sagitta to take at most half of the room.
        let span = left.min((0.5 * room / sagitta).sqrt());
        let room = room - sagitta * span * span;
        let (rotation, ends) = self.at(share + span);
        let closer = closer(rotation, ends);
        if closer > room {
            span * (room / closer) * WITHIN
        } else {
            span
        }
    }
}
