//! The steps of a tick: along what the contacts allow, as far as nothing passes, until there is nothing left to go.

use super::contacts::ToolContact;
use super::corridor::LookAheadTube;
use super::disturbance::Disturbance;
use super::motion::{Placement, Twist};
use super::projection::{HalfSpace, project};
use super::sweep::free_share;
use super::{ToolAdvance, ToolProxy};
use crate::contact::query::{Ending, Surface};
use geometry::closest_points_of_triangles;
use glam::DVec3;

/// Share of the rest distance that the sweep leaves.
const FLOOR: f64 = 0.5;
/// How far a step may stray from the way that it was expected to take, beyond a share of it, as a fraction of the radius of
/// gyration.
const LOOK_AROUND: f64 = 2e-3;
/// The share.
const STRAY: f64 = 0.1;
/// What is gathered ahead, in units of the device's motion, at the most.
const AHEAD: f64 = 1.5;
/// How far contacts are looked for, in units of the motion that those of the last step allow.
const BEYOND: f64 = 1.25;
/// Times that contacts are looked for before a step, at the most: again where those found lead it elsewhere.
const LOOKS: u32 = 3;
/// How far it must be behind to look farther ahead in free air, in units of what it would look ahead.
const FAR_BEHIND: f64 = 8.0;
/// Share of the budget beyond which a tick begins nothing more, once it has gathered or gone a step: what is left of the way
/// is gone in the next one.
const ENOUGH: u32 = 16;
/// Share of the budget that goes into renewing what is known: where that does not suffice it is gathered anew.
const RENEWED: u32 = 8;
/// Gatherings a tick at the most: they are what costs most.
const MAX_GATHERINGS: u32 = 2;
/// Gatherings of a tick that had no room, at the most.
const MAX_FAILURES: u32 = 3;
/// Motion, as a fraction of the radius of gyration, below which a tick is done.
const CONVERGED: f64 = 1e-6;
/// The same as a fraction of the device's motion in this tick: what is left is done in the next one.
const LAG: f64 = 0.05;
/// Steps a tick at the most; what is left is done in the next tick, from a safe place.
const STEPS: usize = 6;
/// Pairs that stop the steps of a tick and are remembered, at the most: one a step.
pub(super) const MAX_STOPS: usize = STEPS;
/// What a contact in a projection costs, in pairs of nodes (measured).
const PROJECTED: u32 = 8;
/// After a gathering that took clearly less than it may, the next one is larger by this factor.
const RECOVERY: f64 = 1.25;
/// Share of what is gathered ahead to which that is reduced where it costs much, though the budget has room.
const MODERATE: f64 = 1.0 / 3.0;
/// Share of what is gathered ahead that is always tried: less is hardly less work.
const MIN_THRIFT: f64 = 1.0 / 16.0;

impl ToolProxy {
    /// The steps of a tick; it began at `start`, from where the surface may have put it out.
    pub(super) fn follow(
        &mut self,
        surface: Surface<'_>,
        start: &Placement,
        travelled: f64,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let (radius, gyration, rest) = (self.shape.radius, self.shape.gyration, self.rest());
        let look_around = (LOOK_AROUND * gyration).max(self.cushion());
        let farthest = travelled + self.slide.most();
        self.is_behind = false;
        self.stops.clear();
        self.haste = self.haste.max(travelled);
        let enough = budget / ENOUGH;
        // Where the surface changes in every tick, what is gathered is not known any more in the next one.
        let has_waited = std::mem::replace(&mut self.has_waited, true);
        let (mut gatherings, mut failures) = (0, 0);
        let (mut is_held_up, mut is_settled) = (true, false);
        let mut went_nowhere = false;
        while answer.steps == 0 || (answer.steps < STEPS as u32 && answer.spent <= enough) {
            let wanted = self.at.to(&self.goal);
            let length = wanted.farthest(radius);
            if is_held_up {
                let ahead = AHEAD * self.pace * self.haste.max(look_around);
                let way = self.expected(&wanted, ahead, look_around);
                let covers = self.is_due || self.near.corridor.covers(&self.at, &way, rest);
                if went_nowhere || !covers {
                    let is_too_much = answer.steps > 0 && answer.spent + self.dearness > enough;
                    if gatherings == MAX_GATHERINGS || is_too_much {
                        break;
                    }
                    if !self.gather(surface, way, look_around, budget, answer) {
                        failures += 1;
                        if !self.near.has_begun() {
                            let is_hasty = self.haste > travelled;
                            self.haste = travelled;
                            if is_hasty || self.pace > 1.0 {
                                // It was more than due.
                                answer.ending = Ending::Complete;
                            }
                            if self.pace > 1.0 || (gatherings == 0 && !is_hasty) {
                                self.look_less();
                            }
                        }
                        if self.near.has_begun() || failures == MAX_FAILURES {
                            break;
                        }
                        continue;
                    }
                    gatherings += 1;
                    if answer.spent > enough && !has_waited {
                        break;
                    }
                }
            }
            answer.steps += 1;
            self.has_waited = false;
            self.near.place(&self.shape, &self.at);
            let looked = self.look(surface, (&wanted, look_around), budget, answer);
            let Some((likely, motion, most)) = looked else {
                self.run_short(gatherings == 0, answer);
                break;
            };
            answer.dropped = answer.dropped.max(self.contacts.dropped());
            let whole = motion.farthest(radius);
            if whole <= 4.0 * f64::EPSILON * (self.at.centre.length() + length) {
                if answer.contact_count == 0 {
                    // What rounding has left of the way is no contact.
                    self.at = self.goal;
                }
                is_settled = true;
                break;
            }
            // No farther than what was gathered, nor so far round that arcs stray from what the contacts allow.
            let covered = self.near.corridor.covered_share(&self.at, &motion, rest);
            let mut share = covered.min(most / whole);
            if !self.near.is_empty() {
                let most_turn = (8.0 * rest / radius).sqrt();
                share = share.min(most_turn / motion.angular.length());
            }
            let left = farthest - start.to(&self.at).farthest(radius);
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
            let swept = free_share(
                &mut self.near,
                &mut self.open,
                &self.shape,
                (&self.at, &step),
                FLOOR * rest,
                budget.saturating_sub(answer.spent),
            );
            answer.spent += swept.spent;
            // ContactForecast what holds it more is near than there is time to look at.
            let free_so_far = answer.contact_count == 0 && swept.share == 1.0;
            let free = free_so_far && share == 1.0;
            let done = step.times(swept.share);
            self.at = if free {
                self.goal
            } else {
                self.at.moved(&done)
            };
            self.near.spend(&self.at, &done, radius);
            if let Some(stop) = swept.stop
                && self.stops.len() < MAX_STOPS
                && !self.stops.contains(&stop)
            {
                self.stops.push(stop);
            }
            if !swept.is_all {
                self.run_short(gatherings == 0, answer);
                break;
            }
            self.is_due = false;
            is_held_up = covered < 1.0 && swept.share == 1.0;
            if is_held_up
                && free_so_far
                && FAR_BEHIND * self.pace * travelled.max(look_around) < length
            {
                self.pace *= 2.0;
            }
            let went = done.farthest(radius);
            went_nowhere = went == 0.0;
            let settled = (CONVERGED * gyration).max(LAG * travelled);
            let went_all = swept.share == 1.0 && share == 1.0;
            // Where the contacts of the last step foretold this one, those of this one foretell that nothing is left.
            let unforeseen = motion.minus(&likely).farthest(radius);
            if free || (went_all && went.min(unforeseen) <= settled) {
                is_settled = true;
                break;
            }
            if self.is_behind {
                break;
            }
        }
        self.slide.end_tick(is_settled);
        self.near.place(&self.shape, &self.at);
        answer.is_on_its_way = !is_settled;
        if is_settled {
            answer.ending = Ending::Complete;
            self.pace = 1.0;
            self.haste = 0.0;
            self.owed = 0.0;
            self.bound_for = self.at;
        } else {
            self.bound_for = self.where_contacts_allow(answer);
        }
    }

    /// Looks for contacts and projects the wanted motion onto what they allow: the motion that was likely before, what is
    /// allowed, and how far it was looked for. `None` where the budget does not suffice.
    ///
    /// What is farther than the step is likely to go has no say in where it leads; should it go farther, it stops. Where what
    /// is found leads it elsewhere, what is there is looked for too: else each step would obey what the last one did not see.
    fn look(
        &mut self,
        surface: Surface<'_>,
        (wanted, look_around): (&Twist, f64),
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<(Twist, Twist, f64)> {
        let (radius, rest) = (self.shape.radius, self.rest());
        self.contacts.carry(&self.at);
        let mut likely = self.allowed(wanted, rest, None);
        let mut looks = 0;
        loop {
            looks += 1;
            let most = wanted.farthest(radius).min(self.near.corridor.reach());
            let most = most.min(BEYOND * likely.farthest(radius) + look_around);
            let within = (BEYOND * most / likely.farthest(radius)).min(BEYOND);
            let there = self.at.moved(&likely.times(within));
            self.near.place_ends(&self.shape, &there);
            let (cost, is_all) = self.contacts.collect(
                &mut self.near,
                &self.shape,
                surface,
                (&self.at, looks == 1),
                [rest + most.min(look_around), rest + most],
                budget.saturating_sub(answer.spent),
            );
            answer.spent += cost;
            if !is_all {
                return None;
            }
            if looks == 1 {
                self.add_stops(rest);
            }
            let motion = self.allowed(wanted, rest, Some(answer));
            answer.spent += PROJECTED * self.contacts.all().len() as u32;
            let begin = |way: &Twist| way.times((most / way.farthest(radius)).min(1.0));
            let elsewhere = begin(&motion).minus(&begin(&likely)).farthest(radius);
            if looks == LOOKS || elsewhere <= look_around {
                return Some((likely, motion, most));
            }
            likely = motion;
        }
    }

    /// What is known of the surface near is renewed where it has changed, or forgotten where that does not do.
    pub(super) fn renew(
        &mut self,
        surface: Surface<'_>,
        disturbance: &Disturbance,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let most = budget / RENEWED;
        let is_renewed = disturbance.changed().is_some_and(|changed| {
            let (is_renewed, work) = self.near.renew(surface, &self.shape, changed, most);
            answer.work.add(work);
            answer.spent += work.cost();
            is_renewed
        });
        self.stops.clear();
        if !is_renewed {
            self.forget();
        }
        self.near.place(&self.shape, &self.at);
    }

    /// Nothing near is known any more.
    pub(super) fn forget(&mut self) {
        if self.near.has_begun() {
            // What takes several ticks may never come to its end.
            self.look_less();
        }
        self.near.forget();
        self.is_due = false;
    }

    /// From now on less is gathered at once.
    fn look_less(&mut self) {
        if self.pace > 1.0 {
            self.pace = (0.5 * self.pace).max(1.0);
        } else {
            self.thrift = (0.5 * self.thrift).max(MIN_THRIFT);
        }
    }

    /// The budget is spent. Where not even a tick that gathers nothing suffices, less is gathered from now on.
    fn run_short(&mut self, had_it_all: bool, answer: &mut ToolAdvance) {
        answer.ending = Ending::OutOfBudget { unvisited: 1 };
        if had_it_all {
            self.look_less();
            self.forget();
        }
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

    /// Gathers what comes near on a way; when the budget does not allow it nothing is known, and the next one is shorter.
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
        let corridor = LookAheadTube::along(self.at, way, rest, stray, &self.shape);
        self.stops.clear();
        // Where this leaves nothing for the step, that comes in the next tick, and so does what this does not suffice for.
        let most = budget.saturating_sub(answer.spent) / 2;
        let (ending, work) = self.near.gather(surface, &self.shape, corridor, most);
        let cost = work.cost();
        answer.work.add(work);
        answer.spent += cost;
        self.is_due = false;
        if self.near.corridor.left() <= rest {
            // Either the budget is spent, or more is within the rest distance than there is room for.
            answer.ending = match ending {
                Ending::Complete => Ending::Stopped { unvisited: 0 },
                other => other,
            };
            return false;
        }
        // Less is gathered where that helps, and that is where most of it went into pairs of faces.
        let enough = budget / ENOUGH;
        if cost > enough && (cost > 2 * work.node_pairs || cost > 2 * enough) {
            self.thrift = (self.thrift / RECOVERY).max(self.thrift.min(MODERATE));
        } else if cost < enough {
            self.thrift = (RECOVERY * self.thrift).min(1.0);
        }
        self.is_due = true;
        self.dearness = cost;
        answer.ending = Ending::Complete;
        true
    }

    /// What has stopped a step of this tick is a contact as long as it is no farther than the rest distance, a minimum
    /// or not: what is left of it is no other way known.
    pub(super) fn add_stops(&mut self, rest: f64) {
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
    }

    /// The motion closest to the wanted one that the contacts allow; those that push go into the answer.
    pub(super) fn allowed(
        &mut self,
        wanted: &Twist,
        rest: f64,
        answer: Option<&mut ToolAdvance>,
    ) -> Twist {
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
