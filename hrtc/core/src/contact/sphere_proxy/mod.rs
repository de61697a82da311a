//! The proxy (god-object) of a sphere: the position that the probe would have if it could not enter
//! the object.
//!
//! After Zilles & Salisbury 1995 and Ruspini 1997, with three differences: every constraint in
//! reach is obeyed within one tick, no threshold is an absolute length, and the motion is
//! continuous. The sphere is swept, so no sheet is thin enough to be missed, at any speed, from
//! either side.
//!
//! A step linearises the faces in reach to half-spaces, projects the device's position onto their
//! intersection ([`projection`]) and sweeps the sphere there. If the sweep meets a face without a
//! half-space, the proxy stops at the contact and repeats the step with that face. Half-spaces act
//! at the probe's radius, the sweep at a radius smaller by a skin: so a resting contact does not
//! stop the sweep, and every crossing does.

mod constraints;
mod features;
pub mod projection;

pub use constraints::MAX_CONSTRAINTS;

use crate::contact::carried::carried;
use crate::contact::query::{
    Limit, MAX_FACES, NearFaces, Nearest, Surface, Work, closest_point_within, swept_sphere_budget,
};
use constraints::Constraints;
use glam::DVec3;
use mutants::{Mutant, is};
use projection::project;
use serde::{Deserialize, Serialize};
use spm::{ActiveMesh, Handle, NONE, OperationFaces};

/// Reduction of the sweep's radius, as a fraction of the probe's radius: more than the rounding of
/// coordinates on a model of 10 million radii, and what a ball that slides along one face may be
/// within the next.
const SKIN: f64 = 1e-8;
/// Margin of the collected ball beyond the probe's radius: a multiple of the device's motion, and a
/// fraction of the radius.
const AHEAD: f64 = 2.0;
const LOOK_AROUND: f64 = 0.02;
/// Motion at which a tick has converged, as a fraction of the radius: the same surface cut into
/// other faces gives the same force to this part of it (`rt-tests accuracy`).
const CONVERGED: f64 = 1e-9;
/// Largest ratio of two steps that counts as a geometric series.
const SERIES: f64 = 0.9;
/// How far a converged ball may be from where its steps lead, as a fraction of its radius: the rest
/// of a geometric series around an edge whose last step was short enough to end the tick.
const CONVERGED_WITHIN: f64 = CONVERGED / (1.0 - SERIES);
/// How far apart a ball may be that reaches the same place in two ways, as a fraction of its
/// radius: neither is farther from converged, and one may be within the next face by the skin.
pub const SAME_WITHIN: f64 = 2.0 * CONVERGED_WITHIN + SKIN;
/// Steps per tick; the next tick does the remaining work, from a safe position.
const STEPS: usize = 8;
/// Distance beyond a surface that has passed over the proxy, as a fraction of the radius.
const BEYOND: f64 = 1e-3;
/// Reach of a step's half-spaces beside its motion, as a fraction of the radius.
const MIN_REACH: f64 = 1e-3;

/// Halvings of the reach at the most: then it is small beside the part around the ball that is
/// always looked at ([`LOOK_AROUND`]), unless the device moves by five radii in a tick.
const MAX_HALVINGS: u32 = 8;
/// Work of a step for each face that it may hold: a quarter is left for going through them twice.
const WORK_PER_FACE: u32 = 8;
/// Faces that a step may hold at the least: as many as stop a ball.
const MIN_FACES: usize = 3;
/// Largest number of active faces: the degrees of freedom of a rigid tool.
pub const MAX_PUSHING: usize = 6;

/// The proxy of a sphere, in the frame and units of the model.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Proxy {
    radius: f64,
    position: DVec3,
    /// Where the steps of the tick lead: the position, or beyond it where they were cut short.
    settled: DVec3,
    goal: DVec3,
    placed: bool,
    /// Largest slide in a tick, beyond the device's motion and the correction of contacts.
    max_slide: f64,
    /// Whether that holds it back.
    is_behind: bool,
    /// How often the reach is halved: once more after a tick that had too little work to look
    /// around, once less after another, so that each tick sees all of a part and goes that far.
    halvings: u32,
    /// Motion of the device, in ticks that were cut short, that the proxy has not followed.
    missed_motion: f64,
    constraints: Constraints,
    near: NearFaces,
}

/// The contact at the end of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// The face with the largest multiplier.
    pub face: Handle,
    /// Its point closest to the proxy.
    pub point: DVec3,
    /// All active faces: up to three for a ball, six for a tool; then [`NONE`].
    pub faces: [Handle; MAX_PUSHING],
}

impl Contact {
    /// A contact with one face.
    #[must_use]
    pub fn at(face: Handle, point: DVec3) -> Self {
        let mut faces = [NONE; MAX_PUSHING];
        faces[0] = face;
        Self { face, point, faces }
    }
}

/// The result of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advance {
    /// The contact, `None` in free space.
    pub contact: Option<Contact>,
    /// Its cost.
    pub work: Work,
    /// Constraints beyond the capacity.
    pub dropped: u32,
    /// Whether a search was cut short by the budget: the proxy may have stopped before its way did.
    pub is_cut: bool,
}

/// What the steps of a tick cost, nodes and faces.
#[derive(Debug, Clone, Copy, Default)]
struct StepCosts {
    so_far: u32,
    costliest: u32,
}

impl StepCosts {
    /// Whether another step may begin where so much was spent, which goes twice through so many
    /// faces that are known; the first one always may.
    fn may_begin(&mut self, spent: u32, known: usize, limit: &mut Limit<'_>) -> bool {
        self.costliest = self.costliest.max(spent - self.so_far);
        self.so_far = spent;
        let cost = self.costliest.max(2 * known as u32);
        spent == 0 || (spent + cost <= limit.max_work() && !limit.is_out_of_time(spent))
    }
}

/// The share, at most 1, of a way `along` that stays within a distance of the origin; 0 where it
/// does not begin there.
fn share_within(distance: f64, from: DVec3, along: DVec3) -> f64 {
    let (a, b) = (along.length_squared(), from.dot(along));
    let c = from.length_squared() - distance * distance;
    if c >= 0.0 || a == 0.0 {
        return 0.0;
    }
    let root = (b * b - a * c).sqrt();
    // The positive solution of |from + t along| = distance, without cancellation.
    let share = if b > 0.0 {
        -c / (b + root)
    } else {
        (root - b) / a
    };
    share.min(1.0)
}

/// What a sweep may take after so much work: where there is no time left, nothing, and it goes as
/// far as all faces are known.
fn left_to_sweep(limit: &mut Limit<'_>, work: &Work) -> u32 {
    let done = work.nodes + work.faces;
    if limit.is_out_of_time(done) {
        0
    } else {
        limit.max_work().saturating_sub(done)
    }
}

impl Proxy {
    /// A proxy of the given radius (model units, positive), not placed yet.
    #[must_use]
    pub fn new(radius: f64) -> Self {
        assert!(radius > 0.0, "a sphere has a positive radius");
        Self {
            radius,
            position: DVec3::ZERO,
            settled: DVec3::ZERO,
            goal: DVec3::ZERO,
            placed: false,
            max_slide: f64::INFINITY,
            is_behind: false,
            halvings: 0,
            missed_motion: 0.0,
            constraints: Constraints::new(),
            near: NearFaces::new(),
        }
    }

    /// Its position, model units; the origin before it is placed.
    #[must_use]
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// Where the faces known in the last tick let it come, model units: its position, or beyond
    /// where the tick was cut short. A way that was only put off is not felt.
    #[must_use]
    pub fn settled(&self) -> DVec3 {
        self.settled
    }

    /// Its radius, model units.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Whether it has been placed.
    #[must_use]
    pub fn is_placed(&self) -> bool {
        self.placed
    }

    /// Largest number of faces and of half-spaces in a step, each with its capacity.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.near.high_water(), MAX_FACES),
            (self.constraints.high_water(), MAX_CONSTRAINTS),
        ]
    }

    /// Places the proxy without a sweep, as at the first sample.
    pub fn place(&mut self, position: DVec3) {
        self.position = position;
        self.settled = position;
        self.goal = position;
        self.placed = true;
        self.halvings = 0;
        self.missed_motion = 0.0;
    }

    /// Moves the proxy if the split or collapse that was just performed has passed over its centre:
    /// to the surface as it is now, on the side where it was. The constraints of the tick do the
    /// rest.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        if self.placed
            && let Some(there) = carried(mesh, operation, self.position, BEYOND * self.radius)
        {
            self.position = there;
        }
    }

    /// Limits the slide of each tick from now on: by so much, beyond the device's own motion, the
    /// deflection of the proxy from the device may change, beside the correction of contacts. Model
    /// units, infinite for no limit. Where the surface moves, or the device has passed a ridge
    /// behind which the nearest point is elsewhere, the proxy goes there over a few ticks, so that
    /// the force does not jump.
    pub fn limit_slide(&mut self, max_slide: f64) {
        self.max_slide = max_slide;
    }

    /// Whether that limit holds the proxy back.
    #[must_use]
    pub fn is_behind(&self) -> bool {
        self.is_behind
    }

    /// One tick: as close to `goal` (the device, model units, finite) as the surface allows.
    ///
    /// It takes no more nodes and faces than the limit says. A step looks around with three
    /// quarters of what is left, and goes as far as the rest shows the way to be free; none but the
    /// first begins unless there is as much left as the most costly one before took. The next tick
    /// does the remaining work.
    pub fn advance<'a>(
        &mut self,
        surface: Surface<'_>,
        goal: DVec3,
        limit: impl Into<Limit<'a>>,
    ) -> Advance {
        if !self.placed {
            self.place(goal);
        }
        let displacement = goal - self.goal;
        let moved = displacement.length() + self.missed_motion;
        self.goal = goal;
        let start = self.position;
        self.is_behind = false;
        // Splits and collapses may have changed any face since the last tick.
        self.near.invalidate();
        let motion = (moved, start + displacement);
        let mut advance = self.take_steps(surface, motion, limit.into());
        self.missed_motion = if advance.is_cut {
            (moved - start.distance(self.position)).max(0.0)
        } else {
            0.0
        };
        if self.position == goal {
            advance.contact = None;
        }
        advance
    }

    /// The steps of a tick in which the device moved so far. `unchanged`: where the proxy's
    /// deflection, and with it the force, would be as in the last tick.
    fn take_steps(
        &mut self,
        surface: Surface<'_>,
        (moved, unchanged): (f64, DVec3),
        mut limit: Limit<'_>,
    ) -> Advance {
        let (goal, mut work) = (self.goal, Work::default());
        // Faces farther than the motion of the device in this tick matter only to the sweep.
        let ahead = if is(Mutant::Sweep) { 0.0 } else { moved };
        let reach = ahead / f64::from(1u32 << self.halvings) + MIN_REACH * self.radius;
        let most = self.max_slide + moved;
        let skin_radius = self.radius * (1.0 - SKIN);
        let (mut contact, mut last_motion) = (None, None);
        let (mut dropped, mut had_stopped) = (0, false);
        let mut costs = StepCosts::default();
        let (mut is_cut, mut has_looked) = (false, true);
        for _ in 0..STEPS {
            if !costs.may_begin(work.nodes + work.faces, self.near.count(), &mut limit) {
                break;
            }
            let wanted = goal - self.position;
            let length = wanted.length();
            let reach = reach.min(length + MIN_REACH * self.radius);
            has_looked &= self.collect_near(surface, reach, &mut limit, &mut work);
            is_cut |= !has_looked;
            // Half of the skin: not a face at which the ball rests, but each that stops the sweep.
            let radii = [self.radius, 0.5 * (self.radius + skin_radius)];
            let (near, at) = (&self.near, self.position);
            work.add(self.constraints.linearise(near, at, radii, reach));
            dropped = dropped.max(self.constraints.dropped());
            let step = project(wanted, self.constraints.planes());
            contact = self.strongest(step.active()).or(contact);
            let motion = self.lengthen(step.point, reach, &mut last_motion);
            let motion = self.restrain(unchanged, motion, most);
            self.settled = self.position + motion;
            // Below the rounding error of the coordinates there is no motion left.
            if motion.length() <= self.rounding(length) {
                break;
            }
            let known = step.complete && motion.length() <= reach && self.knows_all(reach);
            let swept = (known, skin_radius, left_to_sweep(&mut limit, &work));
            let (fraction, is_whole) = self.free_fraction(surface, motion, swept, &mut work);
            is_cut |= !is_whole;
            self.settled = self.position + motion * if is_whole { fraction } else { 1.0 };
            if fraction >= 1.0 && step.active().is_empty() && !self.is_behind {
                self.position = goal;
                break;
            }
            self.position += motion * fraction;
            if is_cut {
                break;
            }
            // The next step may slide along a face that stopped the sweep: only two stops end the
            // tick.
            let stopped = motion.length() * fraction <= CONVERGED * self.radius;
            if stopped && (fraction >= 1.0 || had_stopped) {
                break;
            }
            had_stopped = stopped;
        }
        self.end_steps(has_looked, is_cut);
        Advance {
            contact,
            work,
            dropped,
            is_cut,
        }
    }

    /// Whether every face within reach is known and has its half-space, if it may stop the ball: a
    /// motion that obeys all of these is stopped by the faces without one alone.
    fn knows_all(&self, reach: f64) -> bool {
        let covers = self.near.covers(self.position, self.radius + reach);
        covers && self.constraints.dropped() == 0
    }

    /// The steps of a tick are done; whether it has seen all around, and was cut short.
    fn end_steps(&mut self, has_looked: bool, is_cut: bool) {
        self.halvings = if has_looked {
            self.halvings.saturating_sub(1)
        } else {
            (self.halvings + 1).min(MAX_HALVINGS)
        };
        if !is_cut {
            self.settled = self.position;
        }
    }

    /// Rounding error of the coordinates on a way of this length.
    fn rounding(&self, length: f64) -> f64 {
        if is(Mutant::ShortMotion) {
            return 1e-5;
        }
        4.0 * f64::EPSILON * (self.position.length() + length)
    }

    /// Collects the faces near the proxy unless those within `reach` are known, with three quarters
    /// of what the limit leaves. Whether they sufficed.
    fn collect_near(
        &mut self,
        surface: Surface<'_>,
        reach: f64,
        limit: &mut Limit<'_>,
        work: &mut Work,
    ) -> bool {
        let covers = self.near.covers(self.position, self.radius + reach);
        if covers || self.near.is_full_at(self.position) {
            return true;
        }
        let ball = self.radius + AHEAD * reach + LOOK_AROUND * self.radius;
        let done = work.nodes + work.faces;
        let max_work = limit.max_work().saturating_sub(done);
        let room = ((max_work / WORK_PER_FACE) as usize).clamp(MIN_FACES, MAX_FACES);
        let mut to_look = limit.part(done, max_work - max_work / 4);
        let of = (self.position, ball);
        let (is_all, cost) = self.near.collect(surface, of, room, &mut to_look);
        work.add(cost);
        is_all
    }

    /// The free share of a motion of the sphere of `radius`, and whether `max_work` sufficed to see
    /// all of it. `known`: only the faces without a half-space can stop it.
    fn free_fraction(
        &self,
        surface: Surface<'_>,
        motion: DVec3,
        (known, radius, max_work): (bool, f64, u32),
        work: &mut Work,
    ) -> (f64, bool) {
        if is(Mutant::Sweep) {
            return (1.0, true);
        }
        if known {
            let (free, cost) = self
                .constraints
                .free_fraction(self.position, motion, radius);
            work.add(cost);
            return (free, true);
        }
        let (covered, length) = (self.near.margin(self.position) - radius, motion.length());
        if covered < length {
            let max_work = max_work.saturating_sub(self.near.count() as u32);
            let of = (self.position, motion);
            let (hit, free, cost) = swept_sphere_budget(surface, of, radius, max_work);
            work.add(cost);
            if hit.is_some() || free == 1.0 || free * length >= covered {
                return (free, hit.is_some() || free == 1.0);
            }
        }
        // As far as all faces are known.
        let share = (covered / length).min(1.0);
        let (hit, cost) = self.near.sweep(self.position, motion * share, radius);
        work.add(cost);
        let free = share * hit.map_or(1.0, |hit| hit.fraction);
        (free, hit.is_some() || share == 1.0)
    }

    /// Limits a motion to `most` from a place, but obeys the half-spaces in full.
    fn restrain(&mut self, place: DVec3, motion: DVec3, most: f64) -> DVec3 {
        let from = self.position - place;
        if (from + motion).length() <= most {
            return motion;
        }
        self.is_behind = true;
        let out = project(DVec3::ZERO, self.constraints.planes()).point;
        // From there towards the whole motion: the half-spaces are convex, so all of it obeys them.
        let along = motion - out;
        out + along * share_within(most, from + out, along)
    }

    /// The limit of a geometric series of steps (Aitken's extrapolation).
    ///
    /// Around an edge or vertex the offset surface is curved, and half-spaces lead along it in
    /// steps of a constant ratio, about depth / radius. Longer steps along the same half-spaces are
    /// as safe; those that would leave one are not taken.
    fn lengthen(&self, step: DVec3, reach: f64, last: &mut Option<DVec3>) -> DVec3 {
        let previous = last.replace(step);
        let Some(previous) = previous else {
            return step;
        };
        let ratio = step.dot(previous) / previous.length_squared();
        if !(ratio > 0.0 && ratio < SERIES) {
            return step;
        }
        let whole = step / (1.0 - ratio);
        let planes = self.constraints.planes();
        let kept = planes
            .iter()
            .all(|plane| plane.normal.dot(whole) >= plane.offset.min(plane.normal.dot(step)));
        if kept && whole.length() <= reach {
            // The next step does not continue this series.
            *last = None;
            whole
        } else {
            step
        }
    }

    /// The face closest to the proxy, from the ball of the last tick if it shows it, else from the
    /// tree.
    pub fn nearest(
        &self,
        surface: Surface<'_>,
        hint: Option<Handle>,
        max_work: u32,
    ) -> (Option<Nearest>, Work, bool) {
        let mut work = Work::default();
        let mut best: Option<Nearest> = None;
        let reach = self.near.margin(self.position);
        // A face is left for the hint, which is tested always.
        if reach > 0.0 && (self.near.count() as u32) < max_work {
            let cost = self.near.within(self.position, reach, |near, closest| {
                let nearer =
                    |best: Nearest| closest.distance_squared < best.closest.distance_squared;
                if best.is_none_or(nearer) {
                    best = Some(Nearest {
                        face: near.face,
                        closest,
                    });
                }
            });
            work.add(cost);
        }
        if best.is_some() {
            return (best, work, true);
        }
        let max_work = max_work.saturating_sub(work.nodes + work.faces);
        let (nearest, cost, is_complete) =
            closest_point_within(surface, self.position, hint, max_work);
        work.add(cost);
        (nearest, work, is_complete)
    }

    /// The contact of the active half-spaces, with the largest multiplier; if none is active, of a
    /// half-space nearer than the radius.
    fn strongest(&self, active: &[(usize, f64)]) -> Option<Contact> {
        let mut faces = [NONE; MAX_PUSHING];
        let mut strongest: Option<(usize, f64)> = None;
        for (place, &(plane, multiplier)) in faces.iter_mut().zip(active) {
            *place = self.constraints.source(plane).0;
            if strongest.is_none_or(|(_, most)| multiplier > most) {
                strongest = Some((plane, multiplier));
            }
        }
        let plane = match strongest {
            Some((plane, _)) => plane,
            None => {
                let deepest = self.constraints.deepest()?;
                faces[0] = self.constraints.source(deepest).0;
                deepest
            }
        };
        let (face, point) = self.constraints.source(plane);
        Some(Contact { face, point, faces })
    }
}
