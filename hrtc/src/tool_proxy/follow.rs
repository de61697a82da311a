//! The steps of a tick: along what the contacts allow, as far as nothing passes, until there is nothing left to go.

use super::contacts::ToolContact;
use super::corridor::Corridor;
use super::motion::Twist;
use super::projection::{HalfSpace, project};
use super::sweep::free_share;
use super::{ToolAdvance, ToolProxy};
use crate::query::{Ending, Surface};
use glam::DVec3;
use shared::geometry::{Similarity, closest_points_of_triangles};

/// Share of the rest distance that the sweep leaves.
const FLOOR: f64 = 0.5;
/// How far a step may stray from the way that it was expected to take, beyond a share of it, as a fraction of the radius of
/// gyration.
const LOOK_AROUND: f64 = 2e-3;
/// The share.
const STRAY: f64 = 0.25;
/// What is gathered ahead, in units of the device's motion, at the most.
const AHEAD: f64 = 1.5;
/// Gatherings a tick at the most: they are what costs most.
const MOST_GATHERINGS: u32 = 2;
/// Pairs of nodes that the first one may have cost for another to follow in the same tick: where much is near, what is left
/// of the way is gone in the next one.
const MOST_BEFORE_ANOTHER: u32 = 3000;
/// Motion, as a fraction of the radius of gyration, below which a tick is done.
const CONVERGED: f64 = 1e-6;
/// The same as a fraction of the device's motion in this tick: what is left is done in the next one.
const LAG: f64 = 0.05;
/// Steps a tick at the most; what is left is done in the next tick, from a safe place.
const STEPS: usize = 6;
/// Pairs that stop the steps of a tick and are remembered, at the most: one a step.
pub(super) const MOST_STOPS: usize = STEPS;
/// Pairs of faces looked at by the steps of a tick, beyond which no further step is begun.
const MOST_LOOKS: u32 = 8192;

impl ToolProxy {
    /// The steps of a tick.
    pub(super) fn follow(
        &mut self,
        surface: Surface<'_>,
        travelled: f64,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let (radius, gyration, rest) = (self.shape.radius, self.shape.gyration, self.rest());
        let look_around = (LOOK_AROUND * gyration).max(self.cushion());
        let (start, most) = (self.at, travelled + self.slide);
        self.is_behind = false;
        self.stops.clear();
        let (mut looks, mut gatherings, mut is_held_up) = (0, 0, true);
        while answer.steps < STEPS as u32 && looks < MOST_LOOKS {
            let wanted = self.at.to(&self.goal);
            let length = wanted.farthest(radius);
            if is_held_up {
                let ahead = AHEAD * travelled.max(look_around);
                let way = self.expected(&wanted, ahead, look_around);
                if !self.near.corridor.covers(&self.at, &way, rest) {
                    let has_cost_much = answer.work.node_pairs > MOST_BEFORE_ANOTHER;
                    if gatherings == MOST_GATHERINGS
                        || (gatherings > 0 && has_cost_much)
                        || !self.gather(surface, way, look_around, budget, answer)
                    {
                        break;
                    }
                    gatherings += 1;
                }
            }
            answer.steps += 1;
            self.near.place(&self.shape, &self.at);
            let limit = rest + length.min(self.near.corridor.reach());
            looks += self
                .contacts
                .collect(&mut self.near, &self.shape, surface, &self.at, limit);
            looks += self.add_stops(rest);
            answer.dropped = answer.dropped.max(self.contacts.dropped());
            let motion = self.allowed(&wanted, rest, Some(answer));
            let whole = motion.farthest(radius);
            if whole <= 4.0 * f64::EPSILON * (self.at.centre.length() + length) {
                break;
            }
            // No farther than what was gathered, nor so far round that arcs stray from what the contacts allow.
            let covered = self.near.corridor.covered_share(&self.at, &motion, rest);
            let mut share = covered;
            if !self.near.is_empty() {
                let most_turn = (8.0 * rest / radius).sqrt();
                share = share.min(most_turn / motion.angular.length());
            }
            let left = most - start.to(&self.at).farthest(radius);
            if whole * share > left {
                share = left.max(0.0) / whole;
                self.is_behind = true;
            }
            let mut step = motion;
            if share < 1.0 {
                // A part of the way, but all of what the rest distance asks for.
                step = self.allowed(&motion.times(share), rest, None);
                step = step.times(self.near.corridor.covered_share(&self.at, &step, rest));
            }
            let swept = free_share(&mut self.near, &self.shape, &self.at, &step, FLOOR * rest);
            looks += swept.followed;
            let free = answer.contact_count == 0 && share == 1.0 && swept.share == 1.0;
            let done = step.times(swept.share);
            self.at = if free {
                self.goal
            } else {
                self.at.moved(&done)
            };
            self.near.spend(&self.at, &done, radius);
            if let Some(stop) = swept.stop
                && self.stops.len() < MOST_STOPS
                && !self.stops.contains(&stop)
            {
                self.stops.push(stop);
            }
            is_held_up = covered < 1.0 && swept.share == 1.0;
            let went = done.farthest(radius);
            let settled = (CONVERGED * gyration).max(LAG * travelled);
            if free || (swept.share == 1.0 && share == 1.0 && went <= settled) || self.is_behind {
                break;
            }
        }
        if !std::mem::take(&mut self.is_softened) && !self.is_behind {
            self.slide = f64::INFINITY;
        }
        answer.work.faces += looks;
        self.near.place(&self.shape, &self.at);
    }

    /// The way that a step will take as far as the contacts of the last one tell, no farther than is looked ahead, nor so
    /// far round that arcs stray from it by more than is looked around.
    fn expected(&mut self, wanted: &Twist, ahead: f64, look_around: f64) -> Twist {
        self.contacts.carry(&self.at);
        let way = self.allowed(wanted, self.rest(), None);
        let radius = self.shape.radius;
        let round = (look_around / way.sagitta(radius)).sqrt();
        let share = (ahead / way.farthest(radius)).min(round) * self.thrift;
        way.times(share.min(1.0))
    }

    /// Gathers what comes near on a way; when the budget does not allow it nothing is known, and the next tick tries a
    /// shorter one.
    fn gather(
        &mut self,
        surface: Surface<'_>,
        way: Twist,
        look_around: f64,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let (rest, radius) = (self.rest(), self.shape.radius);
        let stray = self.thrift * look_around + STRAY * way.farthest(radius);
        let corridor = Corridor::along(self.at, way, rest, stray, &self.shape);
        let places = corridor
            .ends()
            .map(|at| Similarity::new(self.pose_at(&at), self.scale));
        if let [Some(from), Some(to)] = places {
            self.tool.place_along(&from, &to);
        }
        self.stops.clear();
        let left = budget.saturating_sub(answer.work.node_pairs);
        let (ending, work) = self
            .near
            .gather(surface, &self.tool, &self.shape, corridor, left);
        answer.work.add(work);
        if self.near.corridor.left() <= rest {
            // Either the budget is spent, or more is within the rest distance than there is room for.
            answer.ending = match ending {
                Ending::Complete => Ending::Stopped { unvisited: 0 },
                other => other,
            };
            self.thrift *= 0.5;
            return false;
        }
        self.thrift = (2.0 * self.thrift).min(1.0);
        true
    }

    /// What has stopped a step of this tick is a contact as long as it is no farther than the rest distance, a minimum
    /// or not: what is left of it is no other way known. How many were looked at.
    fn add_stops(&mut self, rest: f64) -> u32 {
        for &k in &self.stops {
            let pair = &self.near.pairs[k];
            let face = &self.near.faces[pair.surface as usize];
            let corners = self.near.corners(&self.shape, pair.tool);
            let closest = closest_points_of_triangles(face.corners, corners);
            let [from, to] = closest.points;
            if let Some(normal) = (to - from).try_normalize()
                && closest.distance_squared <= rest * rest
            {
                let centre = self.at.centre;
                self.contacts
                    .add(ToolContact::between(face.face, [from, to], normal, centre));
            }
        }
        self.stops.len() as u32
    }

    /// The motion closest to the wanted one that the contacts allow; those that push go into the answer.
    fn allowed(&mut self, wanted: &Twist, rest: f64, answer: Option<&mut ToolAdvance>) -> Twist {
        let gyration = self.shape.gyration;
        let half_space = |contact: &ToolContact| {
            let [n, t] = [contact.normal, contact.arm.cross(contact.normal) / gyration];
            HalfSpace {
                row: [n.x, n.y, n.z, t.x, t.y, t.z],
                offset: rest - contact.gap,
            }
        };
        self.half_spaces.clear();
        self.half_spaces
            .extend(self.contacts.all().iter().map(half_space));
        let (v, w) = (wanted.linear, wanted.angular * gyration);
        let goal = [v.x, v.y, v.z, w.x, w.y, w.z];
        let mut found = project(goal, &self.half_spaces);
        if !found.complete {
            // Squeezed between surfaces nearer than the rest distance: to stay is always allowed.
            for half_space in &mut self.half_spaces {
                half_space.offset = half_space.offset.min(0.0);
            }
            found = project(goal, &self.half_spaces);
        }
        if let Some(answer) = answer {
            answer.contact_count = found.active().len();
            for (place, &(k, _)) in answer.contacts.iter_mut().zip(found.active()) {
                *place = self.contacts.all()[k];
            }
        }
        let [vx, vy, vz, wx, wy, wz] = found.point;
        Twist {
            linear: DVec3::new(vx, vy, vz),
            angular: DVec3::new(wx, wy, wz) / gyration,
        }
    }
}
