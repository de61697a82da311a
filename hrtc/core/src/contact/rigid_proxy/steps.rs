//! The steps of a tick: project, sweep, repeat until no motion remains or the budget is spent.

use super::look::LastStep;
use super::look_ahead_tube::LookAheadTube;
use super::mesh_change::MeshChange;
use super::neighbourhood::Updated;
use super::sweep::{Swept, free_share};
use super::{State, ToolAdvance, ToolProxy};
use crate::contact::motion::Twist;
use crate::contact::query::{Ending, Limit, Surface};

/// Separation that the sweep keeps, as a share of the contact offset.
const MIN_SEPARATION: f64 = 0.5;
/// Deviation from the expected path that needs no new search for contacts, as a fraction of the
/// radius of gyration.
const LOOK_AROUND: f64 = 2e-3;
/// Deviation from the expected path that the look-ahead tube allows, as a fraction of the radius of
/// gyration. Most of a collection's cost is the way through the trees, so a few more pairs are
/// cheap. By `rt-tests tools`, with 0.002 and a twentieth of the path the dragon (5 seeds of 12 s)
/// is behind in 1.8 % of the ticks, with 0.01 in 1.6 %, with 0.015 and 0.02 in 1.5 %; the comb
/// (2 seeds of 8 s) in 23, 25, and with 0.02 in 44 %. No more than the look-ahead, which shrinks
/// where the candidates are too many.
const SKIN: f64 = 0.01;
/// The same as a share of the path, where that is long.
const SKIN_SHARE: f64 = 0.05;
/// Length of the path for which a tick must know the candidates, in units of the device's motion.
/// By `rt-tests tools` (dragon, bunny) 2 costs 2 to 3 % less in the median tick than 1.5.
const AHEAD: f64 = 2.0;
/// The least part of a step that is made where the budget did not suffice to sweep all of it.
const MIN_PART: f64 = 0.1;
/// The part of the budget, one over this, for the pairs of changed faces in an update of the
/// candidates; beyond, they are collected again.
const UPDATE_SHARE: u32 = 8;
/// The same for going through their list, where steps are to follow.
const LIST_SHARE: u32 = 2;
/// Reach of the pairs, in units of the look-ahead, from which on a step that the surface's changes
/// have interrupted is no longer tried with them: what was collected for twice the look-ahead is
/// kept once.
const TOO_LONG: f64 = 5.0;
/// Collections per tick that fail for lack of room or budget.
const MAX_FAILURES: u32 = 3;
/// Motion at which a tick has converged, as a fraction of the radius of gyration.
const CONVERGED: f64 = 1e-6;
/// The same as a fraction of the device's motion; the next tick makes the remaining motion.
const LAG: f64 = 0.05;
/// Stops that are remembered: the last ones of the tick.
pub(super) const MAX_STOPS: usize = 12;

/// By what a step of a tool could trade accuracy for time. No key of a scene; `rt-tests accuracy`
/// compares them.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StepSettings {
    /// Steps per tick, at least 1; the next tick makes the remaining motion, from a safe placement.
    pub max_steps: u32,
    /// Least and largest contact offset, as fractions of the radius of gyration, above 0. Between
    /// them it is half a step of the encoder: the larger it is, the fewer steps end at an edge.
    pub contact_offset: [f64; 2],
}

impl StepSettings {
    /// What the controller uses. The budget ends a tick before so many steps, but where few faces
    /// are near and move: there each step is short and cheap, and twelve spent a fifth of it
    /// (`rt-tests stability station-restart-tool-small-lossy --rate 500`).
    pub const PRODUCT: Self = Self {
        max_steps: 32,
        // Half a step of 10 um, for a tool with a radius of gyration of 5 to 50 mm.
        contact_offset: [1e-4, 1e-3],
    };
}

/// The state of the steps of one tick.
pub(super) struct TickSteps<'a> {
    pub(super) surface: Surface<'a>,
    /// Motion of the device in this tick, model units.
    travelled: f64,
    pub(super) look_around: f64,
    /// Contact offset, model units.
    pub(super) offset: f64,
    pub(super) budget: u32,
    limit: Limit<'a>,
    has_collected: bool,
    failures: u32,
    needs_candidates: bool,
    /// Whether the first step is gone on with.
    pub(super) goes_on: bool,
    did_not_move: bool,
    pub(super) last: LastStep,
}

impl TickSteps<'_> {
    /// Whether further work of a cost may begin. The first collection of a tick always may, and the
    /// first step: after a collection while there is time, else in the next tick.
    fn may_go_on(&mut self, answer: &ToolAdvance, cost: u32) -> bool {
        let is_first = answer.steps == 0;
        let is_in_time =
            (is_first && !self.has_collected) || !self.limit.is_out_of_time(answer.spent);
        is_in_time && (is_first || answer.spent + cost <= self.budget)
    }
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
    /// The steps of a tick in which the device has moved by `travelled`.
    pub(super) fn take_steps<'a>(
        &mut self,
        surface: Surface<'a>,
        travelled: f64,
        limit: Limit<'a>,
        answer: &mut ToolAdvance,
    ) {
        let budget = limit.max_work();
        // The last tick may have collected without room for a moving surface.
        let offset = self.contact_offset();
        let is_for_less = self.has_unused_collection && self.near.tube.left() <= offset;
        let offset = if is_for_less {
            self.static_offset()
        } else {
            offset
        };
        let mut tick = TickSteps {
            surface,
            travelled,
            look_around: (LOOK_AROUND * self.shape.gyration).max(self.moving_offset),
            offset,
            budget,
            limit,
            has_collected: false,
            failures: 0,
            needs_candidates: true,
            goes_on: std::mem::take(&mut self.has_unfinished_step),
            did_not_move: false,
            last: LastStep::default(),
        };
        self.stops.clear();
        self.pace = self.pace.max(travelled.max(tick.look_around));
        let mut next = Next::Retry;
        while next == Next::Retry && answer.steps < self.settings.max_steps {
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
                next = if !tick.may_go_on(answer, self.step_cost) {
                    Next::End
                } else {
                    self.step(&mut tick, (&wanted, likely), answer)
                };
            }
        }
        let is_settled = next == Next::Settled;
        self.near.place(&self.shape, &self.at);
        answer.is_unsettled = !is_settled;
        if is_settled {
            answer.ending = Ending::Complete;
            self.pace = 0.0;
            self.device_travel = 0.0;
            self.coupling_target = self.at;
        } else if self.state == State::Stuck {
            answer.is_stuck = true;
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
        let needed = AHEAD * self.pace;
        let ahead = needed.min(self.look_ahead.length());
        let share = self.share_to(likely, ahead, tick.look_around);
        let path = likely.times(share.min(1.0));
        let covers =
            self.has_unused_collection || self.near.tube.covers(&self.at, &path, tick.offset);
        if !tick.did_not_move && covers {
            return Next::Step;
        }
        // The next tick goes on with what this one has no time for.
        if !tick.may_go_on(answer, 0) {
            return Next::End;
        }
        let is_first = answer.steps == 0;
        let is_new = !self.near.has_partial_collection();
        if is_new {
            // Since the proxy last reached the device, that has moved in earlier ticks, too.
            let is_lagging = self.device_travel > tick.travelled;
            let distances = [tick.look_around, needed];
            self.look_ahead.begin(is_lagging, distances);
        }
        let length = self.look_ahead.length();
        let share = self.share_to(likely, length, tick.look_around);
        let path = if share.is_finite() {
            likely.times(share)
        } else {
            *likely
        };
        // Before the first step, one that looks farther than needed leaves room for one that does
        // not. Later ones are gone on with in the next tick.
        let is_longer = is_first && is_new && length > needed;
        let left = tick.budget.saturating_sub(answer.spent);
        let most = if is_longer { left / 2 } else { left };
        // It numbers the pairs anew.
        tick.last = LastStep::default();
        if self.collect_candidates(tick, path, most, answer) {
            tick.has_collected = true;
            return Next::Step;
        }
        if !is_first {
            // What earlier steps of the tick reached stays.
            answer.ending = Ending::Complete;
        }
        tick.failures += 1;
        if is_longer && tick.failures < MAX_FAILURES {
            // It looked farther ahead than this tick needs. What it found near the beginning of its
            // path is near the shorter one, too.
            self.look_ahead.shorten_to(needed);
            let length = self.look_ahead.length();
            let shorter = self.share_to(likely, length, tick.look_around) / share;
            let left = tick.budget.saturating_sub(answer.spent);
            answer.spent += self.near.shorten_collection(&self.shape, shorter, left);
            answer.ending = Ending::Complete;
            return Next::Retry;
        }
        self.look_less_far(tick, answer)
    }

    /// What follows a collection that failed: it is unfinished, or the next is for a shorter path,
    /// or at last without room for what the surface may move in a tick: where that meets the tool,
    /// a depenetration puts it out. Else more faces are near than there is room for. No step is
    /// known to be safe then, so the tool is stuck: contacts that were known once would hold it for
    /// ever.
    fn look_less_far(&mut self, tick: &mut TickSteps<'_>, answer: &mut ToolAdvance) -> Next {
        if self.near.has_partial_collection() {
            return Next::End;
        }
        let is_last = self.look_ahead.is_shortest() || tick.failures + 1 == MAX_FAILURES;
        let at_rest = self.static_offset();
        if is_last && tick.offset > at_rest {
            tick.offset = at_rest;
            answer.ending = Ending::Complete;
            return Next::Retry;
        }
        if self.look_ahead.is_shortest() {
            self.state = State::Stuck;
            return Next::End;
        }
        self.look_ahead.shorten();
        if tick.failures == MAX_FAILURES {
            return Next::End;
        }
        answer.ending = Ending::Complete;
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
        let before = answer.spent;
        answer.steps += 1;
        let is_known = self.known_range(tick).is_some();
        let Some((likely, motion, most)) = self.find_contacts(tick, (wanted, likely), answer)
        else {
            self.look_ahead.note(answer.spent - before, 0.0);
            self.run_short(tick.budget, answer);
            return Next::End;
        };
        tick.goes_on = false;
        answer.dropped = answer.dropped.max(self.contacts.dropped());
        let whole = motion.farthest(radius);
        if whole <= 4.0 * f64::EPSILON * (self.at.centre.length() + length) {
            // A remainder within rounding is no contact.
            if answer.contact_count == 0 {
                self.at = self.goal;
            }
            return Next::Settled;
        }
        let covered = self.near.tube.covered_share(&self.at, &motion, offset);
        let share = covered.min(most / whole);
        let share = share.min(self.contacts.share_of_arcs(&motion, offset));
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
        let went_all = share == 1.0 && swept.share == 1.0;
        let free = answer.contact_count == 0 && went_all;
        let done = self.make_free_part(&step, &swept, is_known);
        if free {
            self.at = self.goal;
        }
        self.near.move_to(&self.at);
        self.remember_stop(swept.stop);
        tick.last.ended(swept.stop, done.farthest(radius));
        let cost = answer.spent - before;
        self.look_ahead.note(cost, done.farthest(radius));
        if !swept.is_all {
            self.run_short(tick.budget, answer);
            return Next::End;
        }
        self.step_cost = cost;
        self.has_unused_collection = false;
        tick.needs_candidates = covered < 1.0 && swept.share == 1.0;
        tick.did_not_move = done.farthest(radius) == 0.0;
        // If the contacts of the last step predicted this motion, those of this one predict rest.
        let unforeseen = motion.minus(&likely).farthest(radius);
        let settled = (CONVERGED * self.shape.gyration).max(LAG * tick.travelled);
        if free || (went_all && done.farthest(radius).min(unforeseen) <= settled) {
            return Next::Settled;
        }
        Next::Retry
    }

    /// Makes the part of a step that a sweep found free, and returns it. Where that is little the
    /// tool stays, so that the contacts and the directions that separate pairs stay as they are
    /// known, and the next tick goes on. If the sweep `had_all` of a tick's budget, since the
    /// contacts were known before, the step was too long.
    fn make_free_part(&mut self, step: &Twist, swept: &Swept, had_all: bool) -> Twist {
        let is_little = !swept.is_all && swept.share < MIN_PART;
        if is_little && !self.look_ahead.is_shortest() {
            if had_all {
                self.look_ahead.shorten();
            }
            return Twist::default();
        }
        let done = step.times(swept.share);
        self.at = self.at.moved(&done);
        done
    }

    /// A share of a motion, but all of the correction that the contact offset requires.
    fn shortened(&mut self, motion: &Twist, share: f64, offset: f64) -> Twist {
        if share < 1.0 {
            let step = self.allowed(&motion.times(share), offset, None);
            return step.times(self.near.tube.covered_share(&self.at, &step, offset));
        }
        *motion
    }

    fn remember_stop(&mut self, stop: Option<usize>) {
        if let Some(stop) = stop
            && !self.stops.contains(&stop)
        {
            if self.stops.len() == MAX_STOPS {
                self.stops.remove(0);
            }
            self.stops.push(stop);
        }
    }

    /// Updates the candidate pairs where the surface changed, also those of an unfinished
    /// collection; invalidates them if that fails. Returns the number of pairs before those of
    /// changed faces, where all of these are known.
    pub(super) fn update(
        &mut self,
        surface: Surface<'_>,
        mesh_change: &MeshChange,
        budget: u32,
        answer: &mut ToolAdvance,
    ) -> Option<usize> {
        if let Some(tried) = &mut self.escapes_tried {
            tried.begin_round();
        }
        let of_pairs = budget / UPDATE_SHARE;
        let of_list = if self.near.has_partial_collection() {
            budget - of_pairs
        } else {
            budget / LIST_SHARE
        };
        let most = [of_list, of_pairs];
        let changed = mesh_change.changed();
        let updated = changed.map_or(Updated::Unknown, |changed| {
            let (updated, work) = self.near.update(surface, &self.shape, changed, most);
            answer.work.add(work);
            answer.spent += work.cost();
            updated
        });
        self.stops.clear();
        if updated == Updated::Unknown {
            self.invalidate();
        } else if self.has_unfinished_step {
            self.restart_step();
        }
        // An unfinished collection, maybe around another placement, has placed what it needs.
        if updated != Updated::Unfinished {
            self.near.place(&self.shape, &self.at);
        }
        match updated {
            Updated::All(first_changed) => Some(first_changed),
            Updated::Unfinished | Updated::Unknown => None,
        }
    }

    /// The surface has changed amid a step: its search for contacts begins again, with the updated
    /// pairs. Where that recurs it might never end: the look-ahead shrinks, and pairs of a much
    /// longer one are dropped.
    fn restart_step(&mut self) {
        self.has_unfinished_step = false;
        self.look_ahead.shorten();
        let ahead = self.near.tube.reach() - self.contact_offset();
        if ahead > TOO_LONG * self.look_ahead.length() {
            self.near.invalidate();
            self.has_unused_collection = false;
        }
    }

    /// Invalidates the candidate pairs.
    pub(super) fn invalidate(&mut self) {
        let is_unused = self.has_unused_collection || self.has_unfinished_step;
        if self.near.has_partial_collection() || is_unused {
            // What takes several ticks might never end.
            self.look_ahead.shorten();
        }
        self.has_unfinished_step = false;
        self.near.invalidate();
        self.has_unused_collection = false;
    }

    /// The budget is spent before the end of a step: the next tick goes on with it. What earlier
    /// steps of the tick reached stays. If all of a budget does not suffice to pass through the
    /// candidates, they are too many: they are dropped, and the look-ahead shrinks.
    fn run_short(&mut self, budget: u32, answer: &mut ToolAdvance) {
        if answer.steps > 1 {
            return;
        }
        answer.ending = Ending::OutOfBudget { unvisited: 1 };
        self.has_unfinished_step = true;
        if self.least_cost_of_step() > budget {
            self.invalidate();
        }
    }

    /// The share of a path up to `ahead`, or to where its arcs deviate from it by `look_around`;
    /// not finite without a path.
    fn share_to(&self, path: &Twist, ahead: f64, look_around: f64) -> f64 {
        let radius = self.shape.radius;
        let round = (look_around / path.sagitta(radius)).sqrt();
        (ahead / path.farthest(radius)).min(round)
    }

    /// Collects the candidate pairs of a path. False if room or budget do not suffice; then nothing
    /// is known, or a part that the next tick completes.
    fn collect_candidates(
        &mut self,
        tick: &mut TickSteps<'_>,
        path: Twist,
        most: u32,
        answer: &mut ToolAdvance,
    ) -> bool {
        let (offset, radius) = (tick.offset, self.shape.radius);
        let length = path.farthest(radius);
        let skin = (SKIN * self.shape.gyration).min(self.look_ahead.length());
        let skin = skin.max(SKIN_SHARE * length);
        let tube = LookAheadTube::along(self.at, path, offset, skin, &self.shape);
        self.stops.clear();
        let limit = &mut tick.limit.part(answer.spent, most);
        let (ending, work) = self.near.collect(tick.surface, &self.shape, tube, limit);
        answer.work.add(work);
        answer.spent += work.cost();
        self.look_ahead.note(work.cost(), 0.0);
        self.has_unused_collection = false;
        if self.near.tube.left() <= offset {
            // The budget is spent, or too many faces are within the contact offset.
            answer.ending = match ending {
                Ending::Complete => Ending::Stopped { unvisited: 0 },
                other => other,
            };
            return false;
        }
        self.has_unused_collection = true;
        answer.ending = Ending::Complete;
        true
    }
}
