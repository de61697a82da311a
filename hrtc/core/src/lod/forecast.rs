//! Where a tool may touch next, away from where it touches now: the prediction follows the contact,
//! but in a cavity, or as the tool turns, another part of it comes to the surface, which is to be
//! refined by then.

use super::cells::Motion;
use crate::budget::QueryBudget;
use crate::contact::query::{Surface, closest_point_within};
use crate::contact::rigid_proxy::MAX_BALLS;
use crate::costs::QueryWork;
use crate::probe::proxy_kind::ProxyKind;
use crate::tuning::prediction::{A_TICK, RADII_AROUND};
use geometry::Pose;
use glam::DVec3;
use spm::{Handle, NONE};

/// A place where a part of a tool may touch next.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Near {
    /// On the part, model units: between there and what is known of the surface the full mesh may
    /// be.
    pub place: Motion,
    /// Whether the front is coarse there.
    pub is_coarse: bool,
    /// Of the part, model units a tick.
    pub velocity: DVec3,
}

/// Result of the last look at a part.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Seen {
    /// The face nearest to it; none when it was not looked at yet.
    face: Handle,
    /// Where its middle was, and when, in periods of the forecast.
    centre: DVec3,
    at: u64,
    /// Where its middle was when its distance was measured.
    measured: DVec3,
    /// Lower bound of its distance from the full mesh; negative where they may have met.
    clearance: f64,
}

impl Seen {
    const NOTHING: Self = Self {
        face: NONE,
        centre: DVec3::ZERO,
        at: 0,
        measured: DVec3::ZERO,
        clearance: 0.0,
    };

    fn is_new(&self) -> bool {
        self.face == NONE
    }

    /// Its middle is here after so many periods. Its velocity since the last time, model units a
    /// tick.
    fn go_to(&mut self, centre: DVec3, periods: u64) -> DVec3 {
        let displacement = if self.is_new() {
            DVec3::ZERO
        } else {
            centre - self.centre
        };
        let since = periods.saturating_sub(self.at).max(1);
        (self.centre, self.at) = (centre, periods);
        displacement / since as f64
    }
}

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct ContactForecast {
    seen: [Seen; MAX_BALLS],
    next: usize,
    /// Periods so far, skipped ones too.
    periods: u64,
    found: [Option<Near>; A_TICK],
    /// Ticks ahead at which the refined set looks.
    refine_ahead: f64,
}

impl ContactForecast {
    /// Nothing seen yet. `refine_ahead`: ticks ahead at which the refined set looks.
    pub fn new(refine_ahead: f64) -> Self {
        Self {
            seen: [Seen::NOTHING; MAX_BALLS],
            next: 0,
            periods: 0,
            found: [None; A_TICK],
            refine_ahead,
        }
    }

    /// Forgets what it saw.
    pub fn reset(&mut self) {
        *self = Self::new(self.refine_ahead);
    }

    /// Periods were skipped since the last look.
    pub fn skip_periods(&mut self, periods: u64) {
        self.periods = self.periods.saturating_add(periods);
    }

    /// What was found near in the last tick.
    pub fn found(&self) -> impl Iterator<Item = Near> + use<> {
        self.found.into_iter().flatten()
    }

    /// Looks for the surface near the next parts of a tool; a ball has no parts but itself.
    /// `patch`: radius of what a tip touches at once, model units. A part for which the budget does
    /// not suffice waits for its next turn.
    pub fn look(
        &mut self,
        surface: Surface<'_>,
        (proxy, goal, patch): (&ProxyKind, &Pose, f64),
        budget: &mut QueryBudget,
    ) {
        self.found = [None; A_TICK];
        self.periods = self.periods.saturating_add(1);
        let ProxyKind::Tool(_) = proxy else {
            return;
        };
        for found in &mut self.found {
            let k = self.next;
            self.next = (k + 1) % MAX_BALLS;
            let Some(part) = proxy.parts(goal).nth(k) else {
                continue;
            };
            let seen = &mut self.seen[k];
            let velocity = seen.go_to(part.centre, self.periods);
            let reach = (RADII_AROUND - 1.0) * patch + velocity.length() * self.refine_ahead;
            if seen.clearance - part.centre.distance(seen.measured) > reach {
                continue;
            }
            let hint =
                Some(seen.face).filter(|&face| !seen.is_new() && surface.mesh.is_active(face));
            let most = budget.for_look_ahead();
            if most == 0 {
                continue;
            }
            let (nearest, work, is_complete) =
                closest_point_within(surface, part.centre, hint, most);
            budget.charge(QueryWork::Search, work);
            let Some(nearest) = nearest.filter(|_| is_complete) else {
                continue;
            };
            // What is coarse may come out by as much as it is coarse.
            let coarse = f64::from(surface.mesh.face_radius(nearest.face));
            let distance = nearest.closest.distance_squared.sqrt();
            let clearance = distance - part.radius - coarse;
            *seen = Seen {
                face: nearest.face,
                centre: part.centre,
                at: self.periods,
                measured: part.centre,
                clearance,
            };
            if clearance <= reach {
                let share = (part.radius / distance).min(1.0);
                let place = Motion {
                    position: part.centre.lerp(nearest.closest.point, share),
                    radius: patch,
                    clearance,
                };
                *found = Some(Near {
                    place,
                    is_coarse: coarse > 0.0,
                    velocity,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stall of 300 periods, at 0.1 mm in a period.
    #[test]
    fn the_velocity_of_a_part_is_that_of_the_hand_after_a_stall() {
        let step = DVec3::new(1e-4, 0.0, -5e-5);
        let mut seen = Seen::NOTHING;
        assert_eq!(seen.go_to(step * 8.0, 8), DVec3::ZERO);
        seen.face = 0;
        for periods in [16, 24, 332, 340] {
            let velocity = seen.go_to(step * periods as f64, periods);
            assert!(velocity.distance(step) < 1e-12, "{periods}: {velocity}");
        }
        let mut forecast = ContactForecast::new(8.0);
        forecast.skip_periods(300);
        assert_eq!(forecast.periods, 300);
        forecast.reset();
        assert_eq!(forecast.periods, 0);
    }
}
