//! The proxy (god-object): where the probe would be if it could not enter the object.
//!
//! After Zilles and Salisbury 1995 and Ruspini et al. 1997, for a sphere, with three differences that the
//! facts of haptics ask for: every constraint in reach is obeyed within one tick (not one a tick), nothing
//! depends on an absolute length, and the motion is continuous: the sphere is swept to where it goes, so no
//! sheet is thin enough to be missed, at any speed, from either side.
//!
//! A step linearises the faces in reach to half-spaces, goes to the point of their intersection that is
//! closest to the device ([`projection`]), and sweeps the sphere there. Where the sweep meets a face that the
//! half-spaces did not know, the proxy stops at the touch and takes the step anew with that face among them.
//! Half-spaces act at the probe's radius, the sweep at a radius smaller by a skin: so a resting contact is
//! not a touch, and every crossing is.

mod constraints;
mod features;
pub mod projection;

pub use constraints::MAX_CONSTRAINTS;

use crate::contact::query::{
    MAX_FACES, NearFaces, Nearest, Surface, Work, closest_point, swept_sphere,
};
use crate::perception::StepLimit;
use constraints::Constraints;
use geometry::closest_point_on_triangle;
use glam::DVec3;
use projection::project;
use spm::{ActiveMesh, Handle, NONE, OperationFaces};

/// What the sweep's radius is smaller by, as a fraction of the probe's radius.
const SKIN: f64 = 1e-6;
/// What the ball of faces that a tick looks at holds beyond the probe's radius: so many times the device's
/// motion, and this fraction of the radius.
const AHEAD: f64 = 2.0;
const LOOK_AROUND: f64 = 0.02;
/// Motion, as a fraction of the radius, below which a tick is done.
const CONVERGED: f64 = 1e-7;
/// Ratio of two steps beyond which they are not taken for a geometric series.
const SERIES: f64 = 0.9;
/// Steps a tick at the most; what is left is done in the next tick, from a safe position.
const STEPS: usize = 8;
/// How far beyond a surface that has passed over it the proxy is put, as a fraction of the radius.
const BEYOND: f64 = 1e-3;

/// Faces that push at once at the most: as many as there are degrees of freedom.
pub const MAX_PUSHING: usize = 6;

/// The sphere that stays outside, in the model's frame and units.
#[derive(Debug, Clone)]
pub struct Proxy {
    radius: f64,
    position: DVec3,
    goal: DVec3,
    placed: bool,
    step_limit: StepLimit,
    /// Whether it is behind for that.
    is_behind: bool,
    constraints: Constraints,
    near: NearFaces,
}

/// What holds the proxy at the end of a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The face whose constraint pushes most.
    pub face: Handle,
    /// Its point closest to the proxy.
    pub point: DVec3,
    /// All faces that push: up to three of a ball, six of a tool; [`NONE`] where fewer do.
    pub faces: [Handle; MAX_PUSHING],
}

impl Contact {
    /// One face that pushes, at a point.
    #[must_use]
    pub fn at(face: Handle, point: DVec3) -> Self {
        let mut faces = [NONE; MAX_PUSHING];
        faces[0] = face;
        Self { face, point, faces }
    }
}

/// What a tick of the proxy gives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Advance {
    /// The contact, `None` in free space.
    pub contact: Option<Contact>,
    /// What it cost.
    pub work: Work,
    /// Constraints that did not fit.
    pub dropped: u32,
}

impl Proxy {
    /// A proxy of the given radius (model units, positive), not placed yet.
    #[must_use]
    pub fn new(radius: f64) -> Self {
        assert!(radius > 0.0, "a sphere has a positive radius");
        Self {
            radius,
            position: DVec3::ZERO,
            goal: DVec3::ZERO,
            placed: false,
            step_limit: StepLimit::FREE,
            is_behind: false,
            constraints: Constraints::new(),
            near: NearFaces::new(),
        }
    }

    /// Its position, model units; the device's own before it is placed.
    #[must_use]
    pub fn position(&self) -> DVec3 {
        self.position
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

    /// The most faces that were looked at, and half-spaces that held the proxy, in a step; and how many fit.
    #[must_use]
    pub fn high_water(&self) -> [(usize, usize); 2] {
        [
            (self.near.high_water(), MAX_FACES),
            (self.constraints.high_water(), MAX_CONSTRAINTS),
        ]
    }

    /// Puts it somewhere without a sweep, as at the first sample.
    pub fn place(&mut self, position: DVec3) {
        self.position = position;
        self.goal = position;
        self.placed = true;
    }

    /// Takes the proxy along where the split or collapse that was just performed has passed over its centre: to
    /// the surface as it is now, on the side where it was. The constraints of the tick do the rest.
    ///
    /// Operation by operation the volume between the surface before and after tells exactly whether it is
    /// passed; where the surface is at the end of a tick does not, since sheets may have moved past each other.
    pub fn carry(&mut self, mesh: &ActiveMesh, operation: &OperationFaces) {
        if !self.placed || !mesh.swept_over(operation, self.position) {
            return;
        }
        let faces = operation.deformed().iter();
        let nearest = faces
            .chain(operation.made_or_removed())
            .filter(|&&face| mesh.is_active(face))
            .map(|&face| closest_point_on_triangle(mesh.corners(face), self.position))
            .min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared));
        if let Some(nearest) = nearest {
            let through = (nearest.point - self.position).normalize_or_zero();
            self.position = nearest.point + through * (BEYOND * self.radius);
        }
    }

    /// The surface that it touches moves in this tick: beyond what keeps it outside and the device's own motion it goes
    /// no farther than `slide`, model units, until it has caught up.
    pub fn limit_step(&mut self, max_step: f64) {
        self.step_limit.tighten(max_step);
    }

    /// Whether it is behind since it was softened.
    #[must_use]
    pub fn is_behind(&self) -> bool {
        self.is_behind
    }

    /// One tick: as close to `goal` (the device, model units, finite) as the surface lets it.
    ///
    /// No further step is begun once `most_work` nodes were visited and faces tested; what is left is done in the
    /// next tick.
    pub fn advance(&mut self, surface: Surface<'_>, goal: DVec3, most_work: u32) -> Advance {
        let mut work = Work::default();
        if !self.placed {
            self.place(goal);
        }
        // Faces farther than the device moved in this tick can only matter through the sweep.
        let moved = self.goal.distance(goal);
        let reach = moved + 1e-3 * self.radius;
        self.goal = goal;
        let start = self.position;
        let most = self.step_limit.max_step() + moved;
        self.is_behind = false;
        // Splits and collapses may have changed any face since the last tick.
        self.near.invalidate();
        let skin_radius = self.radius * (1.0 - SKIN);
        let mut contact = None;
        let mut last_motion = None;
        let mut dropped = 0;
        let mut had_stopped = false;
        for _ in 0..STEPS {
            if work.nodes + work.faces > most_work {
                break;
            }
            let wanted = goal - self.position;
            let length = wanted.length();
            let reach = reach.min(length + 1e-3 * self.radius);
            self.collect_near(surface, reach, &mut work);
            let constraints = &mut self.constraints;
            work.add(constraints.linearise(&self.near, self.position, self.radius, reach));
            dropped = dropped.max(constraints.dropped());
            let step = project(wanted, self.constraints.planes());
            contact = self.strongest(step.active()).or(contact);
            let motion = self.lengthen(step.point, reach, &mut last_motion);
            let motion = self.restrain(start, motion, most);
            // Below the rounding of the coordinates there is nothing left to move.
            if motion.length() <= 4.0 * f64::EPSILON * (self.position.length() + length) {
                break;
            }
            // Where every face that the motion can reach was looked at, and all half-spaces are obeyed, only
            // the faces without one are left to be met.
            let known = step.complete
                && motion.length() <= reach
                && self.constraints.dropped() == 0
                && self.near.covers(self.position, self.radius + reach);
            let fraction = self.free_fraction(surface, motion, (known, skin_radius), &mut work);
            if fraction >= 1.0 && step.active().is_empty() && !self.is_behind {
                self.position = goal;
                break;
            }
            self.position += motion * fraction;
            // A face that the sweep has met may give way to the next step: only two stops end the tick.
            let stopped = motion.length() * fraction <= CONVERGED * self.radius;
            if stopped && (fraction >= 1.0 || had_stopped) {
                break;
            }
            had_stopped = stopped;
        }
        if self.position == goal {
            contact = None;
        }
        self.step_limit.end_tick(!self.is_behind);
        Advance {
            contact,
            work,
            dropped,
        }
    }

    /// Collects the faces near the proxy unless those within `reach` are known.
    fn collect_near(&mut self, surface: Surface<'_>, reach: f64, work: &mut Work) {
        let covers = self.near.covers(self.position, self.radius + reach);
        if !covers && !self.near.is_full_at(self.position) {
            let ball = self.radius + AHEAD * reach + LOOK_AROUND * self.radius;
            work.add(self.near.collect(surface, self.position, ball));
        }
    }

    /// The free share of a motion of the sphere of `radius`. `known`: only the faces without a
    /// half-space can stop it.
    fn free_fraction(
        &self,
        surface: Surface<'_>,
        motion: DVec3,
        (known, radius): (bool, f64),
        work: &mut Work,
    ) -> f64 {
        if known {
            let (free, cost) = self
                .constraints
                .free_fraction(self.position, motion, radius);
            work.add(cost);
            return free;
        }
        let (hit, cost) = if self.near.covers(self.position, motion.length() + radius) {
            self.near.sweep(self.position, motion, radius)
        } else {
            swept_sphere(surface, self.position, motion, radius)
        };
        work.add(cost);
        hit.map_or(1.0, |hit| hit.fraction)
    }

    /// A motion that leads no farther than `most` from where the tick began; but what the half-spaces need to be
    /// obeyed is done in full.
    fn restrain(&mut self, start: DVec3, motion: DVec3, most: f64) -> DVec3 {
        let behind = self.position - start;
        if (behind + motion).length() <= most {
            return motion;
        }
        self.is_behind = true;
        let out = project(DVec3::ZERO, self.constraints.planes()).point;
        // From there towards the whole motion: the half-spaces are convex, so all of that way obeys them.
        let (from, along) = (behind + out, motion - out);
        let (a, b) = (along.length_squared(), from.dot(along));
        let c = from.length_squared() - most * most;
        if c >= 0.0 || a == 0.0 {
            return out;
        }
        let root = (b * b - a * c).sqrt();
        // The positive solution of |from + t along| = most, without cancellation.
        let share = if b > 0.0 {
            -c / (b + root)
        } else {
            (root - b) / a
        };
        out + along * share.min(1.0)
    }

    /// The whole of a geometric series of steps at once (Aitken).
    ///
    /// Around an edge or a vertex the surface of the probe's centre is curved, and half-spaces lead along it
    /// in steps of a constant ratio, about depth / radius. Longer steps along the same half-spaces are as
    /// safe; those that would leave one are not taken.
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

    /// The closest face to the proxy if the ball of the last tick shows it, else by a search of the tree.
    pub fn nearest(
        &self,
        surface: Surface<'_>,
        hint: Option<Handle>,
        work: &mut Work,
    ) -> Option<Nearest> {
        let mut best: Option<Nearest> = None;
        let reach = self.near.margin(self.position);
        if reach > 0.0 {
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
        if best.is_none() {
            let (nearest, cost) = closest_point(surface, self.position, hint);
            work.add(cost);
            best = nearest;
        }
        best
    }

    /// The contact of the active planes, the one with the largest multiplier first; with none active, of a
    /// plane that is closer than the radius.
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
