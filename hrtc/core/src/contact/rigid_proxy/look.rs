//! What a step obeys: contacts, found anew or carried along, and the motion that they allow.

use super::contacts::{LOOK, PASSED, ToolContact};
use super::neighbourhood::PLACED;
use super::projection::{HalfSpace, project};
use super::steps::TickSteps;
use super::sweep::{PART, least_cost};
use super::{ToolAdvance, ToolProxy};
use crate::contact::motion::{Placement, Twist};
use geometry::closest_points_of_triangles;
use glam::DVec3;

/// Range of the search for contacts, in units of the motion that the last contacts allow.
const BEYOND: f64 = 1.25;
/// Searches for contacts before a step; repeated if the contacts found redirect the motion.
const MAX_LOOKS: u32 = 3;
/// Cost of a contact in a projection, in node pairs (measured).
const PROJECTED: u32 = 1;
/// Motion since a search up to which a step that was stopped needs no other, as a share of its
/// range.
const NEAR_BY: f64 = 0.1;
/// Range of a step without a search, in units of the motion of the one before: a sweep that is
/// stopped early had better been short. On the dragon and the comb of `rt-tests tools`, by a copy
/// of its measure, 3 is no better.
const FARTHER: f64 = 8.0;

/// The last step of a tick, and the last search for contacts. Model units.
#[derive(Default)]
pub(super) struct LastStep {
    /// The pair that stopped it.
    stop: Option<usize>,
    /// Its motion.
    moved: f64,
    /// Range of the search, and the motion since.
    searched: f64,
    moved_since: f64,
}

impl LastStep {
    /// The range of a step for which the contacts found last suffice, with the pair that stopped
    /// the last step; `None` if there is no such pair or the tool has moved too far.
    pub(super) fn carried_range(&self) -> Option<f64> {
        let is_near = self.moved_since <= NEAR_BY * self.searched;
        (self.stop.is_some() && is_near)
            .then(|| (self.searched - self.moved_since).min(FARTHER * self.moved))
    }

    /// A step has ended, at a pair or not.
    pub(super) fn ended(&mut self, stop: Option<usize>, moved: f64) {
        (self.stop, self.moved) = (stop, moved);
        self.moved_since += moved;
    }
}

impl ToolProxy {
    /// The budget, in node pairs, with which a step comes to its end over some ticks: the search
    /// for contacts may take several, the sweep goes through all pairs in one.
    pub(super) fn least_cost_of_step(&self) -> u32 {
        let contacts = self.contacts.found().len() as u32 + 1;
        let search = self.near.vertex_count() / PLACED + PASSED + 2 * LOOK;
        let reuse = PART + PROJECTED * contacts;
        self.near.vertex_count() / PLACED + search.max(reuse) + least_cost(&self.near)
    }

    /// The contacts of a step, as [`ToolProxy::look`] returns them: those that are known where they
    /// suffice.
    pub(super) fn find_contacts(
        &mut self,
        tick: &mut TickSteps<'_>,
        (wanted, likely): (&Twist, Twist),
        answer: &mut ToolAdvance,
    ) -> Option<(Twist, Twist, f64)> {
        match self.known_range(tick).or(tick.last.carried_range()) {
            Some(range) => self.reuse(tick, (wanted, likely), range, answer),
            None => self.look(tick, (wanted, likely), answer),
        }
    }

    /// The range for which the last tick found the contacts of this one's first step, if that is
    /// gone on with.
    pub(super) fn known_range(&self, tick: &TickSteps<'_>) -> Option<f64> {
        let search = self.contacts.search_of(&self.near, &self.at)?;
        let is_known = tick.goes_on && search.next.is_none();
        is_known.then_some(search.limit - tick.offset)
    }

    /// How far a step may go, model units: its candidates were collected for that, or for more if
    /// the look-ahead has become shorter since.
    fn farthest_step(&self, tick: &TickSteps<'_>) -> f64 {
        let ahead = self.look_ahead.length().min(self.near.tube.reach());
        ahead.max(tick.look_around)
    }

    /// The same as [`ToolProxy::look`] within a range, where the last step was stopped soon after a
    /// search, or is gone on with: the contacts are carried along, and the pair that stopped it is
    /// one more.
    fn reuse(
        &mut self,
        tick: &TickSteps<'_>,
        (wanted, likely): (&Twist, Twist),
        range: f64,
        answer: &mut ToolAdvance,
    ) -> Option<(Twist, Twist, f64)> {
        let contacts = self.contacts.all().len() as u32 + 1;
        let cost = self.near.vertex_count() / PLACED + PART + PROJECTED * contacts;
        if answer.spent + cost + least_cost(&self.near) > tick.budget {
            return None;
        }
        self.near.place(&self.shape, &self.at);
        if let Some(stop) = tick.last.stop {
            self.add_stop(stop, tick.offset);
        }
        answer.spent += cost;
        let motion = self.allowed(wanted, tick.offset, Some(answer));
        let most = range.max(tick.look_around).min(self.farthest_step(tick));
        let most = most.min(wanted.farthest(self.shape.radius));
        Some((likely, motion, most))
    }

    /// Searches contacts and projects the wanted motion onto them. Returns the motion expected
    /// before, the projected motion and the range of the search; `None` if the budget does not
    /// suffice.
    ///
    /// Features beyond the range of the step do not constrain it; the sweep stops at them. If the
    /// contacts found redirect the motion, the search is repeated along the new one. Otherwise each
    /// step would obey only what the previous one had not seen. Where the budget does not suffice
    /// for the first search, the next tick goes on with it; a repetition ends there.
    fn look(
        &mut self,
        tick: &mut TickSteps<'_>,
        (wanted, mut likely): (&Twist, Twist),
        answer: &mut ToolAdvance,
    ) -> Option<(Twist, Twist, f64)> {
        let (radius, offset) = (self.shape.radius, tick.offset);
        let look_around = tick.look_around;
        // What the sweep costs in any case is kept for it.
        let budget = tick.budget.saturating_sub(least_cost(&self.near));
        let placed = self.near.vertex_count() / PLACED;
        if answer.spent + 2 * placed > budget {
            return None;
        }
        self.near.place(&self.shape, &self.at);
        answer.spent += placed;
        let mut looks = 0;
        loop {
            looks += 1;
            let most = wanted.farthest(radius).min(self.farthest_step(tick));
            let most = most.min(BEYOND * likely.farthest(radius) + look_around);
            // A search that the last tick began goes on as far as that was to go.
            let search = self.contacts.search_of(&self.near, &self.at);
            let unfinished = search.filter(|search| search.next.is_some());
            let most = unfinished.map_or(most, |search| most.min(search.limit - offset).max(0.0));
            let within = (BEYOND * most / likely.farthest(radius)).min(BEYOND);
            let there = self.at.moved(&likely.times(within));
            self.near.place_ends(&self.shape, &there);
            let near_by = offset + most.min(look_around);
            let clear = self
                .near
                .gap_beyond(&likely.times(within), &self.at, near_by);
            let (cost, is_all) = self.contacts.collect(
                &mut self.near,
                &self.shape,
                tick.surface,
                (&self.at, looks == 1),
                [near_by, offset + most, clear],
                budget.saturating_sub(answer.spent),
            );
            answer.spent += cost;
            if !is_all && looks == 1 {
                return None;
            }
            if looks == 1 {
                let of_stops = PART * self.stops.len() as u32;
                if answer.spent + of_stops > budget {
                    return None;
                }
                self.add_stops(offset);
                answer.spent += of_stops;
            }
            let projected = PROJECTED * self.contacts.all().len() as u32;
            if answer.spent + projected > budget {
                return None;
            }
            let motion = self.allowed(wanted, offset, Some(answer));
            answer.spent += projected;
            let begin = |motion: &Twist| motion.times((most / motion.farthest(radius)).min(1.0));
            let elsewhere = begin(&motion).minus(&begin(&likely)).farthest(radius);
            if !is_all || looks == MAX_LOOKS || elsewhere <= look_around {
                (tick.last.searched, tick.last.moved_since) = (most, 0.0);
                return Some((likely, motion, most));
            }
            likely = motion;
        }
    }

    /// Adds the pairs that stopped a step of this tick as contacts while they are within the
    /// contact offset, local minimum or not: nothing else records them.
    pub(super) fn add_stops(&mut self, offset: f64) {
        for k in 0..self.stops.len() {
            self.add_stop(self.stops[k], offset);
        }
    }

    fn add_stop(&mut self, stop: usize, offset: f64) {
        let pair = &self.near.pairs[stop];
        let face = &self.near.faces[pair.surface as usize];
        let corners = self.near.corners(&self.shape, pair.tool);
        let closest = closest_points_of_triangles(face.corners, corners);
        let [from, to] = closest.points;
        if let Some(normal) = (to - from).try_normalize()
            && closest.distance_squared <= offset * offset
        {
            let centre = self.at.centre;
            let contact = ToolContact::between(face, [from, to], normal, centre);
            // A search that goes on has it from the tick before.
            if !self.contacts.found().contains(&contact) {
                self.contacts.add(contact);
            }
        }
    }

    /// Whether the way from the proxy to the estimate of the last tick, if there was one, led
    /// through a contact. If the proxy was behind the contact's plane then, too, it has come around
    /// a ridge since.
    fn is_late(&self, contact: &ToolContact, offset: f64) -> bool {
        self.assumed.is_some_and(|of| {
            let arm = self.contacts.at().rotation().transpose() * contact.arm;
            let is_behind = |at: &Placement| {
                let tool = at.centre + at.rotation() * arm;
                contact.normal.dot(tool - contact.point) < -offset
            };
            is_behind(&of.target) && !is_behind(&of.proxy)
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
            // What an earlier step of the tick told stays told.
            let late = active.filter(is_late).count() as u32;
            answer.late_contacts = answer.late_contacts.max(late);
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
