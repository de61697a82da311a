//! Which regions the probe will need (thesis 5.6.2, 5.7.2): neighbours of the contact cells, linear
//! and quadratic extrapolation of the motion, its landing on the surface, and the distance before
//! contact.
//!
//! Each source is a ball; the regions whose cells it meets are predicted, each with the tick at
//! which the contact may be there. The *refined* set is to be performed by then, the *loaded* set
//! to be in the cache. In every tick of a millisecond one ball of the finest ring and one of a
//! coarser ring are looked at, so that a tick costs little (under a probe wider than cells one at
//! each face that holds it); after [`TURNS`] of them the finest ring has been looked at all around.

use super::cells::{Motion, ticks_to_leave, ticks_until, visit_ball};
use crate::cache::RegionKey;
use crate::contact::sphere_proxy::MAX_PUSHING;
use crate::horizons::{Horizons, PredictionHorizons};
use crate::lod::lod_controller::{LodController, MAX_RINGS, Ring};
use crate::tuning::prediction::{
    HALFWAY, LOAD_AHEAD_S, RADII_AROUND, REFINE_AHEAD_S, RING_AHEAD_S, SPREAD,
};
use geometry::portable::exp;
use glam::DVec3;
use spm::RegionId;

/// Turns of a round: in each one source of the finest ring is looked at.
pub const TURNS: usize = 10;
/// Looks, one in each tick of a millisecond, after which every source of every ring was looked at.
pub const ALL_TURNS: u64 = {
    let coarser = RING_ROUND.len() * (MAX_RINGS - 1);
    if coarser > TURNS {
        coarser as u64
    } else {
        TURNS as u64
    }
};

/// A predicted region.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Predicted {
    /// The region.
    pub key: RegionKey,
    /// Ticks from now until the contact may be in its cell: what is due first comes first.
    pub ticks: f64,
    /// Ticks from now until the contact has left its cell, if the motion goes on like this: what
    /// comes later comes in vain.
    pub leaves: f64,
    /// Whether it is to be performed, not only loaded.
    pub refine: bool,
}

impl Predicted {
    fn new(
        (ring, id): (&Ring, RegionId),
        motion: (Motion, DVec3),
        horizons: &PredictionHorizons,
        refine: bool,
    ) -> Self {
        let ticks = ticks_until(&ring.grid, id, motion, horizons);
        Self {
            key: RegionKey::new(id, ring.tolerance),
            ticks,
            leaves: ticks_to_leave(&ring.grid, id, motion).max(ticks),
            refine,
        }
    }
}

/// How the motion goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Course {
    /// Straight on.
    Linear,
    /// Along a parabola.
    Quadratic,
    /// Along a parabola whose bend fades: a hand does not accelerate in one direction for long.
    Fading,
}

/// Sources of the balls: each can be left out, to measure its benefit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Sources {
    /// Cells around those of the contact.
    pub neighbours: bool,
    /// What lies ahead.
    pub course: Option<Course>,
    /// What lies ahead is moved onto the front as far as it is known: a coarse ring is the map for
    /// a fine one.
    pub landing: bool,
}

impl Sources {
    /// All of them.
    pub const ALL: Self = Self {
        neighbours: true,
        course: Some(Course::Fading),
        landing: true,
    };
}

/// Where a turn looks.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Look {
    Here,
    Around,
    /// So many seconds, and so large a share of the lead.
    Ahead(f64, f64),
}

/// The turns of the finest ring; what is to be refined takes every other one.
const ROUND: [(Look, bool); TURNS] = [
    (Look::Here, true),
    (Look::Around, false),
    (Look::Ahead(REFINE_AHEAD_S, 0.0), true),
    (Look::Ahead(LOAD_AHEAD_S[0], 1.0), false),
    (Look::Here, true),
    (Look::Ahead(LOAD_AHEAD_S[1], HALFWAY), false),
    (Look::Ahead(REFINE_AHEAD_S, 0.0), true),
    (Look::Ahead(LOAD_AHEAD_S[0], 1.0), false),
    (Look::Here, true),
    (Look::Ahead(LOAD_AHEAD_S[2], 1.0), false),
];

/// Radius of a look at the most, in cells.
const MAX_CELLS: f64 = 2.0;
/// The same of a look around, which comes once in a round: of a hand at 0.1 m/s and a station
/// 200 ms away, 24 mm, in cells of 8 mm (a bunny of 70 thousand faces, 0.15 m).
const MAX_CELLS_AROUND: f64 = 3.0;

/// The turns of each coarser ring.
const RING_ROUND: [(Look, bool); 3] = [
    (Look::Here, true),
    (Look::Ahead(RING_AHEAD_S[0], 0.0), true),
    (Look::Ahead(RING_AHEAD_S[1], 1.0), false),
];

/// The predictor: a short history of the device.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Predictor {
    /// The last positions, the newest first: twice the longer span, and one.
    history: Vec<DVec3>,
    known: usize,
    /// Periods that were skipped since the newest position.
    skipped: u64,
    /// One of the spans.
    span: usize,
    rate_hz: f64,
    horizons: PredictionHorizons,
    /// Average speed, model units a tick.
    mean_speed: f64,
    /// Largest speed of late, model units a tick; it fades.
    recent_speed: f64,
    /// Ticks by which the loaded set looks farther ahead.
    lead: f64,
    sources: Sources,
    /// Next source of the finest ring.
    turn: usize,
    /// Next source of the coarser rings.
    ring_turn: usize,
    /// What lies ahead in the coming turns, moved onto the front.
    landed: [Option<DVec3>; TURNS],
    /// Places of the surface that a ball touches; told before every prediction, so no state.
    #[serde(skip)]
    touched: [Option<DVec3>; MAX_PUSHING],
}

impl Predictor {
    /// No history.
    #[must_use]
    pub fn new(horizons: &Horizons) -> Self {
        let Horizons {
            rate_hz,
            prediction,
            ..
        } = *horizons;
        let longest = prediction.spans[1];
        Self {
            history: vec![DVec3::ZERO; 2 * longest + 1],
            known: 0,
            skipped: 0,
            span: longest,
            rate_hz,
            horizons: prediction,
            mean_speed: 0.0,
            recent_speed: 0.0,
            lead: 0.0,
            sources: Sources::ALL,
            turn: 0,
            ring_turn: 0,
            landed: [None; TURNS],
            touched: [None; MAX_PUSHING],
        }
    }

    /// Forgets what it saw: another probe comes, or the same from elsewhere.
    pub fn reset(&mut self) {
        self.history.fill(DVec3::ZERO);
        self.known = 0;
        self.skipped = 0;
        self.span = self.horizons.spans[1];
        self.mean_speed = 0.0;
        self.recent_speed = 0.0;
        self.turn = 0;
        self.ring_turn = 0;
        self.landed = [None; TURNS];
    }

    /// Predicts from these sources from now on.
    pub fn set_sources(&mut self, sources: Sources) {
        self.sources = sources;
    }

    /// By how many ticks the loaded set is to look farther ahead from now on.
    pub fn set_lead(&mut self, ticks: f64) {
        self.lead = ticks;
    }

    /// Tells where the surface holds a ball, or the place nearest to it, model units, from the
    /// first of the list on: under a ball wider than cells the surface is refined there from now
    /// on. Without any it is around the centre, as under every other probe.
    pub fn set_touched(&mut self, places: [Option<DVec3>; MAX_PUSHING]) {
        self.touched = places;
    }

    /// By how many ticks the loaded set looks farther ahead.
    #[must_use]
    pub fn lead(&self) -> f64 {
        self.lead
    }

    /// Ticks that a look goes ahead.
    fn ticks_ahead(&self, seconds: f64, share: f64) -> f64 {
        seconds * self.rate_hz + share * self.lead
    }

    /// Velocity and acceleration of the device now, model units per tick and per tick squared.
    #[must_use]
    pub fn motion(&self) -> (DVec3, DVec3) {
        if self.known < self.history.len() {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let span = self.span as f64;
        let [now, middle, old] = [0, 1, 2].map(|k| self.history[k * self.span]);
        let acceleration = (now - 2.0 * middle + old) / (span * span);
        let velocity = (now - middle) / span;
        (velocity, acceleration)
    }

    /// The average speed, model units a tick.
    #[must_use]
    pub fn mean_speed(&self) -> f64 {
        self.mean_speed
    }

    /// The points ahead that the next tick looks at in the finest ring, by turn, as far as they may
    /// be moved onto the front; what they are then is told with
    /// [`Predictor::project_onto_front`].
    #[must_use]
    pub fn ahead(&self, position: DVec3) -> [Option<DVec3>; TURNS] {
        let mut points = [None; TURNS];
        if !self.sources.landing || self.motion().0 == DVec3::ZERO {
            return points;
        }
        for look in 0..self.horizons.looks.min(TURNS) {
            let turn = (self.turn + look) % TURNS;
            let (look, _) = ROUND[turn];
            if matches!(look, Look::Ahead(..)) {
                points[turn] = self.extrapolated(position, look);
            }
        }
        points
    }

    /// What the points of [`Predictor::ahead`] are on the front.
    pub fn project_onto_front(&mut self, points: [Option<DVec3>; TURNS]) {
        self.landed = points;
    }

    /// Where a look goes; `None` when its source is left out.
    fn extrapolated(&self, position: DVec3, look: Look) -> Option<DVec3> {
        let (velocity, acceleration) = self.motion();
        match look {
            Look::Here => Some(position),
            Look::Around => self.sources.neighbours.then_some(position),
            Look::Ahead(seconds, share) => {
                let ticks = self.ticks_ahead(seconds, share);
                let fading = self.horizons.fading;
                let bend = match self.sources.course? {
                    Course::Linear => return Some(position + velocity * ticks),
                    Course::Quadratic => 0.5 * ticks * ticks,
                    Course::Fading => {
                        let left = exp(-ticks / fading);
                        fading * (ticks - fading * (1.0 - left))
                    }
                };
                // The difference over a span is the velocity in its middle.
                let velocity = velocity + acceleration * (0.5 * self.span as f64);
                Some(position + velocity * ticks + acceleration * bend)
            }
        }
    }

    /// By how much a point so many ticks ahead may be missed.
    fn spread(&self, ticks: f64) -> f64 {
        let (velocity, acceleration) = self.motion();
        let displacement = velocity.length() * ticks;
        let bend = 0.5 * acceleration.length() * ticks * ticks;
        SPREAD[0] * displacement + (SPREAD[1] * bend).min(0.5 * displacement)
    }

    /// Periods were skipped since the last prediction.
    pub fn skip_periods(&mut self, periods: u64) {
        self.skipped = self.skipped.saturating_add(periods);
    }

    /// Adds the newest position; the motion of skipped periods was even.
    fn add(&mut self, device: DVec3) {
        let periods = self.skipped.saturating_add(1);
        self.skipped = 0;
        let before = self.history[0];
        let last = self.history.len() - 1;
        let added = periods.min(last as u64) as usize;
        self.history.copy_within(..=last - added, added);
        self.history[0] = device;
        if self.known > 0 && added > 1 {
            let back = (before - device) / periods as f64;
            for (k, place) in self.history[..added].iter_mut().enumerate().skip(1) {
                *place = device + back * k as f64;
            }
        }
        let known = if self.known > 0 { added } else { 1 };
        self.known = (self.known + known).min(self.history.len());
    }

    /// Takes the device's position, and visits the regions of the next sources of all `rings`.
    pub fn predict(
        &mut self,
        lod: &LodController,
        rings: bool,
        device: DVec3,
        motion: Motion,
        mut visit: impl FnMut(Predicted),
    ) {
        self.add(device);
        let spans = self.horizons.spans;
        let slow = device.distance(self.history[spans[1]]) < motion.radius;
        self.span = spans[usize::from(slow)];
        let speed = self.motion().0.length();
        self.mean_speed += (speed - self.mean_speed) / self.horizons.mean;
        let faded = self.recent_speed * (1.0 - 1.0 / self.horizons.recent);
        self.recent_speed = speed.max(faded);
        for _ in 0..self.horizons.looks {
            self.turn(lod, (rings, motion), &mut visit);
        }
    }

    fn turn(&mut self, lod: &LodController, of: (bool, Motion), visit: &mut impl FnMut(Predicted)) {
        let (rings, motion) = of;
        let finest = lod.finest();
        let finest_ring = &lod.rings()[finest];
        let (look, refine) = ROUND[self.turn];
        let landed = self.landed[self.turn].take();
        self.turn = (self.turn + 1) % TURNS;
        self.look([finest_ring; 2], look, refine, landed, motion, visit);
        let coarser = lod.rings().len() - finest - 1;
        if rings && coarser > 0 {
            self.ring_turn = (self.ring_turn + 1) % (coarser * RING_ROUND.len());
            let ring = &lod.rings()[finest + 1 + self.ring_turn % coarser];
            let (look, refine) = RING_ROUND[self.ring_turn / coarser];
            self.look([ring, finest_ring], look, refine, None, motion, visit);
        }
    }

    /// Visits the regions of a ring in one ball.
    fn look(
        &self,
        [ring, finest]: [&Ring; 2],
        look: Look,
        refine: bool,
        landed: Option<DVec3>,
        motion: Motion,
        visit: &mut impl FnMut(Predicted),
    ) {
        let (velocity, _) = self.motion();
        let speed = velocity.length();
        let grid = &ring.grid;
        // Distance before contact: what is surely out of reach is not asked for.
        let farthest = self.ticks_ahead(LOAD_AHEAD_S[2], 1.0);
        let reach = motion.radius + grid.cell + speed * farthest + self.spread(farthest);
        if motion.clearance > reach {
            return;
        }
        let Some(centre) = self.extrapolated(motion.position, look) else {
            return;
        };
        let centre = landed.unwrap_or(centre);
        let around = RADII_AROUND * motion.radius;
        let radius = match look {
            Look::Around => {
                let warm = (grid.cell / speed / self.horizons.warm).min(1.0);
                // What the link takes a lead to bring is there for a hand that turns.
                let turned = self.recent_speed * self.lead;
                motion.radius + (grid.cell * warm).max(turned)
            }
            Look::Here => around + self.spread(self.horizons.refine_around),
            Look::Ahead(seconds, share) if refine => {
                around + self.spread(self.ticks_ahead(seconds, share))
            }
            // In cells of the finest ring: a coarser one needs no more room around what lies ahead.
            Look::Ahead(seconds, share) => {
                around + 0.25 * finest.grid.cell + self.spread(self.ticks_ahead(seconds, share))
            }
        };
        let max_cells = match look {
            Look::Around => MAX_CELLS_AROUND,
            Look::Here | Look::Ahead(..) => MAX_CELLS,
        };
        let mut visit_around = |centre: DVec3, radius: f64| {
            visit_ball(grid, centre, (radius, max_cells), |id| {
                visit(Predicted::new(
                    (ring, id),
                    (motion, velocity),
                    &self.horizons,
                    refine,
                ));
            });
        };
        // From the centre of so wide a ball the look would end before it came to the surface.
        let is_wide = look == Look::Here && around > MAX_CELLS * grid.cell;
        if !is_wide || self.touched[0].is_none() {
            visit_around(centre, radius);
            return;
        }
        for &place in self.touched.iter().flatten() {
            let left = radius - place.distance(motion.position);
            if left > 0.0 {
                visit_around(place, left);
            }
        }
    }
}

/// Visits the regions around a place where another part of the probe may touch next, and around
/// where that goes: of the finest ring, and of the coarser ones with `rings`, where the front is
/// coarse still. `velocity`: of that part, model units a tick.
pub fn predict_forecast(
    lod: &LodController,
    rings: bool,
    (place, velocity): (Motion, DVec3),
    horizons: &PredictionHorizons,
    mut visit: impl FnMut(Predicted),
) {
    let finest = lod.finest();
    let last = if rings { lod.rings().len() } else { finest + 1 };
    for ring in &lod.rings()[finest..last] {
        for ticks in [0.0, horizons.refine_ahead] {
            let displacement = velocity * ticks;
            let radius = RADII_AROUND * place.radius + SPREAD[0] * displacement.length();
            let ball = (radius, MAX_CELLS);
            visit_ball(&ring.grid, place.position + displacement, ball, |id| {
                visit(Predicted::new(
                    (ring, id),
                    (place, velocity),
                    horizons,
                    true,
                ));
            });
        }
    }
}

#[cfg(test)]
mod tests;
