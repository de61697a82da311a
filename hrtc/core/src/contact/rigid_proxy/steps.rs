//! The steps of a tick: project, sweep, repeat until no motion remains or the budget is spent.

use super::contacts::{PLACED, ToolContact};
use super::look_ahead_tube::LookAheadTube;
use super::mesh_change::MeshChange;
use super::projection::{HalfSpace, project};
use super::sweep::{free_share, least_cost};
use super::{ToolAdvance, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use crate::contact::query::{Ending, Surface};
use geometry::closest_points_of_triangles;
use glam::DVec3;

/// Separation that the sweep keeps, as a share of the contact offset.
const MIN_SEPARATION: f64 = 0.5;
/// Deviation from the expected path that the look-ahead tube allows, beside a share of the path, as
/// a fraction of the radius of gyration.
const LOOK_AROUND: f64 = 2e-3;
/// That share of the path.
const SKIN_SHARE: f64 = 0.1;
/// Length of the path for which a tick must know the candidates, in units of the device's motion.
const AHEAD: f64 = 1.5;
/// Length of the path for which they are collected, in units of that: the device goes on. Longer
/// paths save collections and have more pairs; by `rt-tests tools` this takes least work, of 1 to 4
/// on a dragon and on a bunny.
const FARTHER: f64 = 2.0;
/// Length up to which a path is made longer, as a fraction of the radius of gyration: on longer
/// ones most of the cost is pairs, which grow with it.
const LONGEST: f64 = 0.1;
/// Range of the search for contacts, in units of the motion that the last contacts allow.
const BEYOND: f64 = 1.25;
/// Searches for contacts before a step; repeated if the contacts found redirect the motion.
const MAX_LOOKS: u32 = 3;
/// Distance behind the device from which the look-ahead grows in free air, in units of the
/// look-ahead.
const FAR_BEHIND: f64 = 8.0;
/// The part of the budget, one over this, after which a tick begins no further work once it has
/// collected candidates or taken a step. By `rt-tests tools`: a tool on a bunny is more than
/// 0.05 mm behind on 6 % of the ticks at 16 and 0.8 % at 8; at 4 the slowest ticks on a dragon take
/// half as much again.
const TICK_SHARE: u32 = 8;
/// The part of the budget, one over this, that a collection should cost. Where it costs more, the
/// look-ahead is shortened.
const COLLECTION_SHARE: u32 = 16;
/// The part of the budget, one over this, for an update of the candidates; beyond, they are
/// collected again.
const UPDATE_SHARE: u32 = 8;
/// Collections per tick; they cost most.
const MAX_COLLECTIONS: u32 = 2;
/// Collections per tick that fail for lack of room or budget.
const MAX_FAILURES: u32 = 3;
/// Motion at which a tick has converged, as a fraction of the radius of gyration.
const CONVERGED: f64 = 1e-6;
/// The same as a fraction of the device's motion; the next tick makes the remaining motion.
const LAG: f64 = 0.05;
/// Steps per tick; the next tick makes the remaining motion, from a safe placement.
const MAX_STEPS: usize = 6;
/// Pairs that stop a step and are remembered: one per step.
pub(super) const MAX_STOPS: usize = MAX_STEPS;
/// Cost of a contact in a projection, in node pairs (measured).
const PROJECTED: u32 = 1;
/// Growth of the look-ahead after a collection below its share of the budget.
const RECOVERY: f64 = 1.25;
/// Least scale of the look-ahead to which a costly collection within the budget reduces it.
const MODERATE: f64 = 1.0 / 3.0;
/// Least scale of the look-ahead: less hardly costs less.
const MIN_LOOK_AHEAD_SCALE: f64 = 1.0 / 16.0;

/// The state of the steps of one tick.
struct TickSteps<'a> {
    surface: Surface<'a>,
    /// The placement at which the tick began.
    start: Placement,
    /// Motion of the device in this tick, and the largest motion of the tool, model units.
    travelled: f64,
    farthest: f64,
    look_around: f64,
    /// Contact offset, model units.
    offset: f64,
    budget: u32,
    /// Cost beyond which no further work is begun.
    enough: u32,
    /// Whether the last tick took no step.
    skipped_step_before: bool,
    collections: u32,
    failures: u32,
    needs_candidates: bool,
    did_not_move: bool,
}

/// What follows a part of a tick.
#[derive(PartialEq)]
enum Next {
    Step,
    Retry,
    End,
    /// The tool is as close to the device as the contacts allow.
    Settled,
}

impl ToolProxy {
    /// The steps of a tick that began at `start`; depenetration may have moved the tool since.
    pub(super) fn take_steps(
        &mut self,
        surface: Surface<'_>,
        start: &Placement,
        travelled: f64,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let mut tick = TickSteps {
            surface,
            start: *start,
            travelled,
            farthest: travelled + self.step_limit.max_step(),
            look_around: (LOOK_AROUND * self.shape.gyration).max(self.moving_offset()),
            offset: self.contact_offset(),
            budget,
            enough: budget / TICK_SHARE,
            // A surface that changes in every tick invalidates the collection of the last one.
            skipped_step_before: std::mem::replace(&mut self.has_skipped_step, true),
            collections: 0,
            failures: 0,
            needs_candidates: true,
            did_not_move: false,
        };
        self.is_behind = false;
        self.stops.clear();
        self.peak_step = self.peak_step.max(travelled);
        let mut next = Next::Retry;
        while answer.steps == 0 || (answer.steps < MAX_STEPS as u32 && answer.spent <= tick.enough)
        {
            let wanted = self.at.to(&self.goal);
            self.contacts.carry(&self.at);
            // By the contacts of the last step.
            let likely = self.allowed(&wanted, tick.offset, None);
            next = if tick.needs_candidates {
                self.ensure_candidates(&mut tick, &likely, answer)
            } else {
                Next::Step
            };
            if next == Next::Step {
                answer.steps += 1;
                next = self.step(&mut tick, (&wanted, likely), answer);
            }
            if matches!(next, Next::End | Next::Settled) {
                break;
            }
        }
        let is_settled = next == Next::Settled;
        self.step_limit.end_tick(is_settled);
        self.near.place(&self.shape, &self.at);
        answer.is_unsettled = !is_settled;
        if is_settled {
            answer.ending = Ending::Complete;
            self.catch_up_factor = 1.0;
            self.peak_step = 0.0;
            self.device_travel = 0.0;
            self.coupling_target = self.at;
        } else {
            self.coupling_target = self.target_allowed_by_contacts(answer);
        }
    }

    /// Collects candidate pairs unless those known cover the expected path.
    fn ensure_candidates(
        &mut self,
        tick: &mut TickSteps<'_>,
        likely: &Twist,
        answer: &mut ToolAdvance,
    ) -> Next {
        let (travelled, look_around, enough) = (tick.travelled, tick.look_around, tick.enough);
        let ahead = AHEAD * self.catch_up_factor * self.peak_step.max(look_around);
        let share = self.share_to(likely, ahead, look_around);
        let path = likely.times(share.min(1.0));
        let is_cheap = self.last_cost <= tick.budget / COLLECTION_SHARE;
        let farther = if is_cheap { FARTHER } else { 1.0 };
        let farther = (farther * ahead).min(LONGEST * self.shape.gyration);
        let farther = self.extended(&path, farther, look_around);
        let covers =
            self.has_unused_collection || self.near.tube.covers(&self.at, &path, tick.offset);
        if !tick.did_not_move && covers {
            return Next::Step;
        }
        let is_too_much = answer.steps > 0 && answer.spent + self.last_cost > enough;
        if tick.collections == MAX_COLLECTIONS || is_too_much {
            return Next::End;
        }
        if self.collect_candidates(tick.surface, farther, look_around, tick.budget, answer) {
            tick.collections += 1;
            if answer.spent > enough && !tick.skipped_step_before {
                return Next::End;
            }
            return Next::Step;
        }
        tick.failures += 1;
        if self.near.has_partial_collection() {
            return Next::End;
        }
        let was_faster = self.peak_step > travelled;
        self.peak_step = travelled;
        if was_faster || self.catch_up_factor > 1.0 {
            // The collection looked farther ahead than this tick needs.
            answer.ending = Ending::Complete;
        }
        if self.catch_up_factor > 1.0 || (tick.collections == 0 && !was_faster) {
            self.shorten_look_ahead();
        }
        if tick.failures == MAX_FAILURES {
            return Next::End;
        }
        Next::Retry
    }

    /// One step: find the contacts, project the wanted motion onto them, sweep along it.
    fn step(
        &mut self,
        tick: &mut TickSteps<'_>,
        (wanted, likely): (&Twist, Twist),
        answer: &mut ToolAdvance,
    ) -> Next {
        let (radius, offset) = (self.shape.radius, tick.offset);
        let length = wanted.farthest(radius);
        self.has_skipped_step = false;
        let looked = self.look(tick, (wanted, likely), answer);
        let Some((likely, motion, most)) = looked else {
            self.run_short(tick.collections == 0, answer);
            return Next::End;
        };
        answer.dropped = answer.dropped.max(self.contacts.dropped());
        let whole = motion.farthest(radius);
        if whole <= 4.0 * f64::EPSILON * (self.at.centre.length() + length) {
            // A remainder within rounding is no contact.
            self.at = if answer.contact_count == 0 {
                self.goal
            } else {
                self.at
            };
            return Next::Settled;
        }
        let covered = self.near.tube.covered_share(&self.at, &motion, offset);
        let share = self.limited_share(tick, &motion, covered.min(most / whole));
        let step = self.shortened(&motion, share, offset);
        let swept = free_share(
            &mut self.near,
            &mut self.open,
            &self.shape,
            (&self.at, &step),
            MIN_SEPARATION * offset,
            tick.budget.saturating_sub(answer.spent),
        );
        answer.spent += swept.spent;
        let free_so_far = answer.contact_count == 0 && swept.share == 1.0;
        let free = free_so_far && share == 1.0;
        let done = step.times(swept.share);
        self.at = if free {
            self.goal
        } else {
            self.at.moved(&done)
        };
        self.near.spend(&self.at, &done, radius);
        self.remember_stop(swept.stop);
        if !swept.is_all {
            self.run_short(tick.collections == 0, answer);
            return Next::End;
        }
        self.has_unused_collection = false;
        tick.needs_candidates = covered < 1.0 && swept.share == 1.0;
        if tick.needs_candidates && free_so_far {
            self.look_farther(tick.travelled.max(tick.look_around), length);
        }
        tick.did_not_move = done.farthest(radius) == 0.0;
        let went_all = swept.share == 1.0 && share == 1.0;
        // If the contacts of the last step predicted this motion, those of this one predict rest.
        let unforeseen = motion.minus(&likely).farthest(radius);
        let settled = (CONVERGED * self.shape.gyration).max(LAG * tick.travelled);
        if free || (went_all && done.farthest(radius).min(unforeseen) <= settled) {
            return Next::Settled;
        }
        if self.is_behind {
            return Next::End;
        }
        Next::Retry
    }

    /// The share of a motion that the rotation limit of a step and the step limit of the tick
    /// leave: arcs must not deviate from the linearised contacts.
    fn limited_share(&mut self, tick: &TickSteps<'_>, motion: &Twist, share: f64) -> f64 {
        let radius = self.shape.radius;
        let whole = motion.farthest(radius);
        let mut share = share;
        if !self.near.is_empty() {
            let most_turn = (8.0 * tick.offset / radius).sqrt();
            share = share.min(most_turn / motion.angular.length());
        }
        let left = tick.farthest - tick.start.to(&self.at).farthest(radius);
        if whole * share > left {
            share = left.max(0.0) / whole;
            self.is_behind = true;
        }
        share
    }

    /// A share of a motion, but all of the correction that the contact offset requires.
    fn shortened(&mut self, motion: &Twist, share: f64, offset: f64) -> Twist {
        if share < 1.0 {
            let step = self.allowed(&motion.times(share), offset, None);
            return step.times(self.near.tube.covered_share(&self.at, &step, offset));
        }
        *motion
    }

    /// Doubles the look-ahead in free air if the device is far ahead, at `length`.
    fn look_farther(&mut self, per_tick: f64, length: f64) {
        if FAR_BEHIND * self.catch_up_factor * per_tick < length {
            self.catch_up_factor *= 2.0;
        }
    }

    fn remember_stop(&mut self, stop: Option<usize>) {
        if let Some(stop) = stop
            && self.stops.len() < MAX_STOPS
            && !self.stops.contains(&stop)
        {
            self.stops.push(stop);
        }
    }

    /// Searches contacts and projects the wanted motion onto them. Returns the motion expected
    /// before, the projected motion and the range of the search; `None` if the budget does not
    /// suffice.
    ///
    /// Features beyond the range of the step do not constrain it; the sweep stops at them. If the
    /// contacts found redirect the motion, the search is repeated along the new one. Otherwise each
    /// step would obey only what the previous one had not seen.
    fn look(
        &mut self,
        tick: &TickSteps<'_>,
        (wanted, mut likely): (&Twist, Twist),
        answer: &mut ToolAdvance,
    ) -> Option<(Twist, Twist, f64)> {
        let (radius, offset) = (self.shape.radius, tick.offset);
        let look_around = tick.look_around;
        self.near.place(&self.shape, &self.at);
        answer.spent += self.near.vertex_count() / PLACED;
        let budget = tick.budget.saturating_sub(least_cost(&self.near));
        let mut looks = 0;
        loop {
            looks += 1;
            let most = wanted.farthest(radius).min(self.near.tube.reach());
            let most = most.min(BEYOND * likely.farthest(radius) + look_around);
            let within = (BEYOND * most / likely.farthest(radius)).min(BEYOND);
            let there = self.at.moved(&likely.times(within));
            self.near.place_ends(&self.shape, &there);
            let (cost, is_all) = self.contacts.collect(
                &mut self.near,
                &self.shape,
                tick.surface,
                (&self.at, looks == 1),
                [offset + most.min(look_around), offset + most],
                budget.saturating_sub(answer.spent),
            );
            answer.spent += cost;
            if !is_all {
                return None;
            }
            if looks == 1 {
                self.add_stops(offset);
            }
            let motion = self.allowed(wanted, offset, Some(answer));
            answer.spent += PROJECTED * self.contacts.all().len() as u32;
            let begin = |motion: &Twist| motion.times((most / motion.farthest(radius)).min(1.0));
            let elsewhere = begin(&motion).minus(&begin(&likely)).farthest(radius);
            if looks == MAX_LOOKS || elsewhere <= look_around {
                return Some((likely, motion, most));
            }
            likely = motion;
        }
    }

    /// Updates the candidate pairs where the surface changed; invalidates them if that fails.
    pub(super) fn update(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) {
        let most = budget / UPDATE_SHARE;
        let is_updated = mesh_change.changed().is_some_and(|changed| {
            let (is_updated, work) = self.near.update(surface, &self.shape, changed, most);
            answer.work.add(work);
            answer.spent += work.cost();
            is_updated
        });
        self.stops.clear();
        if !is_updated {
            self.invalidate();
        }
        self.near.place(&self.shape, &self.at);
    }

    /// Invalidates the candidate pairs.
    pub(super) fn invalidate(&mut self) {
        if self.near.has_partial_collection() {
            // A collection over several ticks might never end.
            self.shorten_look_ahead();
        }
        self.near.invalidate();
        self.has_unused_collection = false;
    }

    /// Reduces the look-ahead of later collections.
    fn shorten_look_ahead(&mut self) {
        if self.catch_up_factor > 1.0 {
            self.catch_up_factor = (0.5 * self.catch_up_factor).max(1.0);
        } else {
            self.look_ahead_scale = (0.5 * self.look_ahead_scale).max(MIN_LOOK_AHEAD_SCALE);
        }
    }

    /// The budget is spent. If it was spent without a collection, the look-ahead shrinks.
    fn run_short(&mut self, had_it_all: bool, answer: &mut ToolAdvance) {
        answer.ending = Ending::OutOfBudget { unvisited: 1 };
        if had_it_all {
            self.shorten_look_ahead();
            self.invalidate();
        }
    }

    /// A path that goes on in the same way until `ahead`, within the same limits.
    fn extended(&self, path: &Twist, ahead: f64, look_around: f64) -> Twist {
        let longer = self.share_to(path, ahead, look_around).max(1.0);
        if longer.is_finite() {
            path.times(longer)
        } else {
            *path
        }
    }

    /// The share of a path up to `ahead`, or to where its arcs deviate from it by `look_around`, as
    /// far as costs allow; not finite without a path.
    fn share_to(&self, path: &Twist, ahead: f64, look_around: f64) -> f64 {
        let radius = self.shape.radius;
        let round = (look_around / path.sagitta(radius)).sqrt();
        (ahead / path.farthest(radius)).min(round) * self.look_ahead_scale
    }

    /// Collects the candidate pairs of a path. False if room or budget do not suffice; then nothing
    /// is known, or a part that the next tick completes.
    fn collect_candidates(
        &mut self,
        surface: Surface<'_>,
        path: Twist,
        look_around: f64,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let (offset, radius) = (self.contact_offset(), self.shape.radius);
        let skin = self.look_ahead_scale * look_around + SKIN_SHARE * path.farthest(radius);
        let tube = LookAheadTube::along(self.at, path, offset, skin, &self.shape);
        self.stops.clear();
        // The other half is for the step. If it does not suffice, the next tick takes the step.
        let most = budget.saturating_sub(answer.spent) / 2;
        let (ending, work) = self.near.collect(surface, &self.shape, tube, most);
        let cost = work.cost();
        answer.work.add(work);
        answer.spent += cost;
        self.has_unused_collection = false;
        if self.near.tube.left() <= offset {
            // The budget is spent, or too many faces are within the contact offset.
            answer.ending = match ending {
                Ending::Complete => Ending::Stopped { unvisited: 0 },
                other => other,
            };
            return false;
        }
        // Reduces the look-ahead if most of the cost was face pairs, which a shorter path saves.
        let enough = budget / COLLECTION_SHARE;
        if cost > enough && (cost > 2 * work.node_pairs || cost > 2 * enough) {
            self.look_ahead_scale =
                (self.look_ahead_scale / RECOVERY).max(self.look_ahead_scale.min(MODERATE));
        } else if cost < enough {
            self.look_ahead_scale = (RECOVERY * self.look_ahead_scale).min(1.0);
        }
        self.has_unused_collection = true;
        self.last_cost = cost;
        answer.ending = Ending::Complete;
        true
    }

    /// Adds the pairs that stopped a step of this tick as contacts while they are within the
    /// contact offset, local minimum or not: nothing else records them.
    pub(super) fn add_stops(&mut self, offset: f64) {
        for &k in &self.stops {
            let pair = &self.near.pairs[k];
            let face = &self.near.faces[pair.surface as usize];
            let corners = self.near.corners(&self.shape, pair.tool);
            let closest = closest_points_of_triangles(face.corners, corners);
            let [from, to] = closest.points;
            if let Some(normal) = (to - from).try_normalize()
                && closest.distance_squared <= offset * offset
            {
                let centre = self.at.centre;
                self.contacts
                    .add(ToolContact::between(face.face, [from, to], normal, centre));
            }
        }
    }

    /// Whether the target of the last tick, which the proxy had not reached, is behind a contact.
    fn is_late(&self, contact: &ToolContact, offset: f64) -> bool {
        self.assumed.is_some_and(|assumed| {
            let turn = assumed.rotation() * self.contacts.at().rotation().transpose();
            let tool = assumed.centre + turn * contact.arm;
            contact.normal.dot(tool - contact.point) < -offset
        })
    }

    /// The motion closest to the wanted one that the contacts allow. The active contacts go into
    /// the answer, the one that pushes most first.
    pub(super) fn allowed(
        &mut self,
        wanted: &Twist,
        offset: f64,
        answer: Option<&mut ToolAdvance>,
    ) -> Twist {
        let gyration = self.shape.gyration;
        let half_space = |contact: &ToolContact| {
            let [n, t] = [contact.normal, contact.arm.cross(contact.normal) / gyration];
            HalfSpace::new([n.x, n.y, n.z, t.x, t.y, t.z], offset - contact.gap)
        };
        self.half_spaces.clear();
        self.half_spaces
            .extend(self.contacts.all().iter().map(half_space));
        let (v, w) = (wanted.linear, wanted.angular * gyration);
        let goal = [v.x, v.y, v.z, w.x, w.y, w.z];
        let mut found = project(goal, &self.half_spaces);
        if !found.complete {
            // Squeezed between surfaces nearer than the contact offset: no motion is always
            // allowed.
            for half_space in &mut self.half_spaces {
                half_space.offset = half_space.offset.min(0.0);
            }
            found = project(goal, &self.half_spaces);
        }
        if let Some(answer) = answer {
            let active = found.active().iter();
            let is_late = |&&(k, _): &&(usize, f64)| self.is_late(&self.contacts.all()[k], offset);
            answer.late_contacts = active.filter(is_late).count() as u32;
            answer.contact_count = found.active().len();
            for (place, &(k, multiplier)) in answer.contacts.iter_mut().zip(found.active()) {
                *place = ToolContact {
                    multiplier,
                    ..self.contacts.all()[k]
                };
            }
            let active = found.active().iter().enumerate();
            // A half-space's normal begins with a unit vector, so the multipliers are forces.
            let strongest = active.max_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b));
            answer
                .contacts
                .swap(0, strongest.map_or(0, |(place, _)| place));
        }
        let [vx, vy, vz, wx, wy, wz] = found.point;
        Twist {
            linear: DVec3::new(vx, vy, vz),
            angular: DVec3::new(wx, wy, wz) / gyration,
        }
    }
}
