//! Which regions the probe will need (thesis 5.6.2, 5.7.2): neighbours of the contact cells, linear and
//! quadratic extrapolation of the motion, and the distance before contact.
//!
//! Each source is a ball; the regions whose cells it meets are predicted. The *refined* set is to be at
//! full resolution now, the *loaded* set is to be in the cache before it is needed.

use glam::{DVec3, UVec3};
use shared::spm::{RegionGrid, RegionId};

/// Ticks over which velocity and acceleration are estimated: long enough for an encoder's step.
const SPAN: usize = 16;
/// Ticks ahead at which the refined set looks, and for which it is wide enough in every direction.
const REFINE_AHEAD: f64 = 25.0;
const REFINE_AROUND: f64 = 8.0;
/// Ticks ahead at which the loaded set looks: a round trip, the records and their splits.
const LOAD_AHEAD: [f64; 2] = [60.0, 120.0];
/// Turns of a round: in each tick one source is looked at.
pub const TURNS: usize = 10;

/// A predicted region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// Which one.
    pub id: RegionId,
    /// Distance from the probe to its cell, model units: what is nearer comes first.
    pub distance: f64,
    /// Whether it is to be at full resolution, not only loaded.
    pub refine: bool,
}

/// What the prediction starts from; model frame and units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// The probe's centre (the proxy, in contact).
    pub position: DVec3,
    /// Radius of the probe.
    pub radius: f64,
    /// Surely no surface is nearer to the centre than this.
    pub clearance: f64,
}

/// The predictor: a short history of the device.
#[derive(Debug, Clone)]
pub struct Predictor {
    history: [DVec3; 2 * SPAN + 1],
    known: usize,
    /// Which source is next.
    turn: usize,
}

impl Predictor {
    /// No history.
    #[must_use]
    pub fn new() -> Self {
        Self {
            history: [DVec3::ZERO; 2 * SPAN + 1],
            known: 0,
            turn: 0,
        }
    }

    /// Velocity and acceleration of the device, model units per tick and per tick squared.
    #[must_use]
    pub fn motion(&self) -> (DVec3, DVec3) {
        if self.known <= 2 * SPAN {
            return (DVec3::ZERO, DVec3::ZERO);
        }
        let span = SPAN as f64;
        let [now, middle, old] = [self.history[0], self.history[SPAN], self.history[2 * SPAN]];
        let velocity = (now - middle) / span;
        let acceleration = (now - 2.0 * middle + old) / (span * span);
        (velocity, acceleration)
    }

    /// Takes the device's position of this tick and visits the regions of one source, so that a tick costs
    /// little; every [`TURNS`] ticks all have been looked at.
    pub fn predict(
        &mut self,
        grid: &RegionGrid,
        device: DVec3,
        motion: Motion,
        mut visit: impl FnMut(Predicted),
    ) {
        self.history.copy_within(0..2 * SPAN, 1);
        self.history[0] = device;
        self.known = (self.known + 1).min(2 * SPAN + 1);
        let (velocity, acceleration) = self.motion();
        let speed = velocity.length();
        let linear = |ticks: f64| motion.position + velocity * ticks;
        let quadratic = |ticks: f64| linear(ticks) + acceleration * (0.5 * ticks * ticks);
        // Distance before contact: what is surely out of reach is not asked for.
        let farthest = LOAD_AHEAD[1];
        let curve = 0.5 * acceleration.length() * farthest;
        let reach = motion.radius + grid.cell + (speed + curve) * farthest;
        if motion.clearance > reach {
            return;
        }
        let mut ball = |centre: DVec3, radius: f64, refine: bool| {
            visit_ball(grid, centre, radius, |id| {
                let distance = grid.distance_squared(id, motion.position).sqrt();
                visit(Predicted {
                    id,
                    distance,
                    refine,
                });
            });
        };
        let around = 1.5 * motion.radius + speed * REFINE_AROUND;
        let ahead = |ticks: f64| 1.5 * motion.radius + 0.25 * (grid.cell + speed * ticks);
        // What is to be refined takes every other turn: it is looked at most often.
        match self.turn {
            0 | 4 | 8 => ball(motion.position, around, true),
            2 | 6 => ball(linear(REFINE_AHEAD), around, true),
            // Neighbours of the contact cells, kept warm.
            1 => ball(motion.position, motion.radius + grid.cell, false),
            3 => ball(linear(LOAD_AHEAD[0]), ahead(LOAD_AHEAD[0]), false),
            5 => ball(quadratic(LOAD_AHEAD[0]), ahead(LOAD_AHEAD[0]), false),
            7 => ball(linear(LOAD_AHEAD[1]), ahead(LOAD_AHEAD[1]), false),
            _ => ball(quadratic(LOAD_AHEAD[1]), ahead(LOAD_AHEAD[1]), false),
        }
        self.turn = (self.turn + 1) % TURNS;
    }
}

/// Visits the regions whose cells meet a ball. A ball of many cells is cut down: no unbounded loop,
/// whatever the speed.
fn visit_ball(grid: &RegionGrid, centre: DVec3, radius: f64, mut visit: impl FnMut(RegionId)) {
    let radius = radius.min(2.0 * grid.cell);
    let Some((low, high)) = grid.cell_range(centre - radius, centre + radius) else {
        return;
    };
    for z in low.z..=high.z {
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let id = RegionId::of_cell(UVec3::new(x, y, z));
                if grid.distance_squared(id, centre) <= radius * radius {
                    visit(id);
                }
            }
        }
    }
}

impl Default for Predictor {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> RegionGrid {
        RegionGrid::new(DVec3::ZERO, DVec3::ONE, 16).unwrap()
    }

    fn still(position: DVec3, clearance: f64) -> Motion {
        Motion {
            position,
            radius: 0.01,
            clearance,
        }
    }

    /// Everything predicted over one round of turns, by region; true where it is to be refined.
    fn round(
        predictor: &mut Predictor,
        device: DVec3,
        velocity: DVec3,
        clearance: f64,
    ) -> std::collections::BTreeMap<u32, bool> {
        let mut all = std::collections::BTreeMap::new();
        for k in 0..TURNS {
            let position = device + velocity * k as f64;
            predictor.predict(&grid(), position, still(position, clearance), |p| {
                *all.entry(p.id.0).or_default() |= p.refine;
            });
        }
        all
    }

    #[test]
    fn a_resting_contact_refines_its_cell_and_loads_its_neighbours() {
        let centre = DVec3::splat(8.5 / 16.0);
        let all = round(&mut Predictor::new(), centre, DVec3::ZERO, 0.0);
        let own = grid().region_of_point(centre);
        assert_eq!(all.get(&own.0), Some(&true));
        assert_eq!(all.len(), 27);
        assert_eq!(all.values().filter(|&&refine| refine).count(), 1);
    }

    #[test]
    fn motion_loads_what_lies_ahead() {
        let mut predictor = Predictor::new();
        let velocity = DVec3::new(1e-3, 0.0, 0.0);
        let mut position = DVec3::splat(0.3);
        for _ in 0..20 {
            round(&mut predictor, position, velocity, 0.0);
            position += velocity * TURNS as f64;
        }
        let all = round(&mut predictor, position, velocity, 0.0);
        let ahead = grid().region_of_point(position + velocity * 120.0);
        assert!(all.contains_key(&ahead.0));
        let behind = grid().region_of_point(position - velocity * 200.0);
        assert!(!all.contains_key(&behind.0));
    }

    #[test]
    fn far_from_any_surface_nothing_is_predicted() {
        let centre = DVec3::splat(0.5);
        assert!(round(&mut Predictor::new(), centre, DVec3::ZERO, 0.3).is_empty());
    }

    #[test]
    fn any_speed_visits_a_bounded_number_of_regions() {
        let mut predictor = Predictor::new();
        for k in 0..200 {
            let p = DVec3::splat(if k % 2 == 0 { -1e6 } else { 1e6 });
            let mut count = 0;
            predictor.predict(&grid(), p, still(DVec3::splat(0.5), 0.0), |_| count += 1);
            assert!(count <= 125);
        }
    }
}
