//! How much of a motion is free: no face of the tool may come nearer to one of the surface than a floor.
//!
//! Conservative advancement pair by pair (Mirtich 1996; Redon et al. 2002): along a fixed direction a pair stays apart
//! at least as on the straight line between start and end, less the sagitta of the rotation. Where that does not
//! suffice for the whole motion it does for a part, after which the closest points give a better direction. Every
//! place along the way is safe, so that to stop early is safe too.

use super::motion::{Placement, Twist};
use super::neighbourhood::{Direction, Neighbourhood, apart, reach_along};
use super::shape::ToolShape;
use glam::{DMat3, DVec3};
use shared::geometry::closest_points_of_triangles;

/// Parts of a motion that a pair is followed through, at the most.
const PARTS: usize = 16;
/// What a part is shortened by, so that rounding does not make it too long.
const WITHIN: f64 = 1.0 - 1e-6;
/// Share of the floor within which a pair counts as stopped.
const TOUCH: f64 = 0.05;

/// How a sweep ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swept {
    /// Share of the motion that is free, 0..1.
    pub share: f64,
    /// The pair that stopped it.
    pub stop: Option<usize>,
    /// Pairs followed by their closest points.
    pub followed: u32,
}

/// The free share of a motion of a placed neighbourhood. Pairs keep at least `floor` (model units) apart; those that
/// are nearer already, at least half of what they are.
pub fn free_share(
    near: &mut Neighbourhood,
    shape: &ToolShape,
    start: &Placement,
    motion: &Twist,
    floor: f64,
) -> Swept {
    let mut swept = Swept {
        share: 1.0,
        stop: None,
        followed: 0,
    };
    near.place_ends(shape, &start.moved(motion));
    let turn = motion.angular.length();
    let sagitta = motion.sagitta(shape.radius);
    let way = motion.farthest(shape.radius);
    for k in 0..near.pairs.len() {
        if near.is_known_beyond(k, way + floor) {
            continue;
        }
        let pair = near.pairs[k];
        let (corners, ends) = (
            near.corners(shape, pair.tool),
            near.end_corners(shape, pair.tool),
        );
        let surface = near.faces[pair.surface as usize].corners;
        let now = near.apart_now(&pair, corners);
        let then = near.apart_then(&pair, ends);
        let bend = match pair.along {
            Direction::Still { .. } => sagitta,
            Direction::Turning(_) => sagitta_from_tool(surface, start.centre, motion, turn),
        };
        if now.min(then) - bend >= floor {
            continue;
        }
        swept.followed += 1;
        let mut follow = Follow {
            surface,
            arms: shape.faces[pair.tool as usize]
                .vertices
                .map(|v| shape.points[v as usize]),
            start,
            motion,
            sagitta,
            sagitta_from_tool: sagitta_from_tool(surface, start.centre, motion, turn),
            floor,
        };
        let (share, along) = follow.until(swept.share, corners);
        if let Some(along) = along {
            near.pairs[k].along = along;
        }
        if share < swept.share {
            swept.share = share;
            swept.stop = Some(k);
        }
    }
    swept
}

/// No corner of the surface, seen from the tool, leaves the straight line between start and end by more: the bound of
/// [`Twist::sagitta`] with what a turning frame adds.
fn sagitta_from_tool(surface: [DVec3; 3], centre: DVec3, motion: &Twist, turn: f64) -> f64 {
    let way = motion.linear.length();
    let farthest = surface.iter().fold(0.0f64, |most, corner| {
        most.max(corner.distance_squared(centre))
    });
    0.125 * turn * (turn * (farthest.sqrt() + way) + 2.0 * way)
}

/// One pair along a motion.
struct Follow<'a> {
    surface: [DVec3; 3],
    /// Corners of the tool's face about its centre.
    arms: [DVec3; 3],
    start: &'a Placement,
    motion: &'a Twist,
    sagitta: f64,
    sagitta_from_tool: f64,
    floor: f64,
}

impl Follow<'_> {
    fn at(&self, share: f64) -> (DMat3, [DVec3; 3]) {
        let at = self.start.moved(&self.motion.times(share));
        let rotation = at.rotation();
        (rotation, self.arms.map(|arm| at.centre + rotation * arm))
    }

    /// How far the pair is free up to a share, and its direction at the start.
    fn until(&mut self, whole: f64, corners: [DVec3; 3]) -> (f64, Option<Direction>) {
        let (mut share, mut corners, mut first) = (0.0, corners, None);
        let mut rotation = self.start.rotation();
        for _ in 0..PARTS {
            let closest = closest_points_of_triangles(self.surface, corners);
            let [from, to] = closest.points;
            let Some(direction) = (to - from).try_normalize() else {
                return (share, first);
            };
            let height = reach_along(direction, self.surface);
            let now = apart(direction, height, corners);
            if first.is_none() {
                self.floor = self.floor.min(0.5 * now);
            }
            let room = now - self.floor;
            if room <= TOUCH * self.floor {
                return (share, first);
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
            share += part;
            if share >= whole {
                return (whole, first);
            }
            (rotation, corners) = self.at(share);
        }
        (share, first)
    }

    /// How far on from a share a pair with some room is free along one direction, `left` at the most. `closer` tells by how
    /// much it comes nearer up to where the tool's face is given.
    fn part(
        &self,
        share: f64,
        left: f64,
        room: f64,
        sagitta: f64,
        closer: impl Fn(DMat3, [DVec3; 3]) -> f64,
    ) -> f64 {
        // So short that the sagitta takes half of the room at most.
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
