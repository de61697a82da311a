//! Memory pressure: the reaction to a cache that is too small for what is wanted.
//!
//! First nothing is loaded ahead of need, then the coarser rings around the finest go, then the
//! finest ring itself comes coarser: each time where the step before was not enough.
//!
//! # When the contact comes coarser
//!
//! A cache that holds a region now and again leaves the contact at full resolution for a while and
//! at the base mesh for another. The next coarser ring is better where it has less error than that
//! on average. So with e the certified error of a contact, n the expected one of the next ring (e
//! is a bound, so that it may come coarser early), and m what was lost so far, in ticks of n,
//!
//! `m = min(max(m + e / n - 1, 0), MISSES_S)`
//!
//! and where a region finds no room the finest ring is raised if m is half of that or more. Where
//! the mean of e is above n, m gets there; where it is below, m returns to 0. A larger cache misses
//! less, so that the contact is no coarser in it on average. What is here but not refined yet waits
//! for time or for the probe: its error is that of its ring.
//!
//! A step back is a trial, which ends at the first region that finds no room once half of
//! `MISSES_S` is lost. Where one finds no room within `EARLY_S`, also if the trial goes on, the
//! wait for the next step back doubles, up to `MAX_WAIT_S`.

use super::lod_controller::MAX_RINGS;
use crate::horizons::PressureHorizons;
use crate::tuning::memory_pressure::STEPS_BEFORE_COARSER;

/// Steps by which less is asked for, while room or time are short. Back it goes one step at a time,
/// after a wait that doubles whenever the step back turned out to be too early.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Steps {
    horizons: PressureHorizons,
    count: u32,
    /// Tick of the last change.
    changed: u64,
    /// Tick of the last want.
    wanted: Option<u64>,
    /// Whether the last change was a step back.
    went_back: bool,
    /// Whether that turned out to be too early.
    was_early: bool,
    /// Ticks without want after which it goes back a step.
    wait_ticks: u64,
}

impl Steps {
    /// None is taken.
    #[must_use]
    pub fn new(horizons: PressureHorizons) -> Self {
        Self {
            horizons,
            count: 0,
            changed: 0,
            wanted: None,
            went_back: false,
            was_early: false,
            wait_ticks: horizons.wait,
        }
    }

    /// Steps taken now.
    #[must_use]
    pub fn count(&self) -> u32 {
        self.count
    }

    /// There was not enough. Whether another step may be taken: the one before must have had time
    /// to take effect.
    pub fn want(&mut self, tick: u64) -> bool {
        self.wanted = Some(tick);
        if self.count > 0 && !self.went_back && tick <= self.changed + self.horizons.settle {
            return false;
        }
        // Once for each step back: a want that is borne leaves it.
        let is_early = self.went_back && tick <= self.changed + self.horizons.early;
        if is_early && !self.was_early {
            self.was_early = true;
            self.wait_ticks = (2 * self.wait_ticks).min(self.horizons.max_wait);
        }
        true
    }

    /// Takes another step.
    pub fn step(&mut self, tick: u64) {
        self.count = (self.count + 1).min(MAX_STEPS);
        self.changed = tick;
        self.went_back = false;
    }

    /// Goes back a step when there was enough for long enough. `has_more`: there is more now than
    /// at any want since the first step; then it need only be seen what the step before does.
    pub fn recover(&mut self, tick: u64, has_more: bool) {
        let Some(wanted) = self.wanted else {
            return;
        };
        let since = wanted.max(self.changed);
        let wait = if has_more {
            self.horizons.settle
        } else {
            self.wait_ticks
        };
        if self.count > 0 && tick > since + wait {
            self.count -= 1;
            self.changed = tick;
            (self.went_back, self.was_early) = (true, false);
        } else if self.count == 0 && tick > since + self.horizons.early {
            self.wait_ticks = self.horizons.wait;
        }
    }
}

/// What is done without while the cache is too small for what is wanted.
///
/// See the module.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct MemoryPressure {
    steps: Steps,
    /// What the contacts lost of late, in [`PARTS`] of a tick at the error of the next ring.
    misses: u32,
}

/// Parts of a tick that are counted.
const PARTS: u32 = 16;

/// Most steps: these, then every ring.
const MAX_STEPS: u32 = STEPS_BEFORE_COARSER + MAX_RINGS as u32;

impl MemoryPressure {
    /// Nothing is done without.
    #[must_use]
    pub fn new(horizons: PressureHorizons) -> Self {
        Self {
            steps: Steps::new(horizons),
            misses: 0,
        }
    }

    /// The error that a contact has in a tick for want of room, in errors of the next coarser ring:
    /// 0 at full resolution, infinite where only a step can help.
    pub fn record_contact(&mut self, error: f64) {
        let lost = (error * f64::from(PARTS)) as u32;
        let misses = self.misses.saturating_add(lost).saturating_sub(PARTS);
        self.misses = misses.min(PARTS * self.steps.horizons.misses);
    }

    /// The cache could not hold what was to come.
    pub fn starve(&mut self, tick: u64) {
        if !self.steps.want(tick) {
            return;
        }
        // Where the contacts have less error than the next ring, that would only be coarser.
        let is_coarser = self.steps.count >= STEPS_BEFORE_COARSER;
        if is_coarser && self.misses < PARTS * self.steps.horizons.misses / 2 {
            return;
        }
        self.misses = 0;
        self.steps.step(tick);
    }

    /// More is in use than may be, and nothing goes that is not asked for.
    pub fn exceed(&mut self, tick: u64) {
        if self.steps.want(tick) {
            self.misses = 0;
            self.steps.step(tick);
        }
    }

    /// Goes back a step when there was room for long enough.
    pub fn recover(&mut self, tick: u64) {
        self.steps.recover(tick, false);
    }

    /// Steps taken now.
    #[must_use]
    pub fn steps(&self) -> u32 {
        self.steps.count
    }

    /// Whether regions may be loaded ahead of need.
    #[must_use]
    pub fn may_prefetch(&self) -> bool {
        self.steps.count == 0
    }

    /// Whether there is room for rings around the finest one.
    #[must_use]
    pub fn has_rings(&self) -> bool {
        self.steps.count < STEPS_BEFORE_COARSER
    }

    /// Rings by which the finest is raised.
    #[must_use]
    pub fn raised(&self) -> usize {
        self.steps.count.saturating_sub(STEPS_BEFORE_COARSER) as usize
    }

    /// Whether regions may be asked for at all.
    #[must_use]
    pub fn may_ask(&self, tick: u64) -> bool {
        let wanted = self.steps.wanted;
        wanted.is_none_or(|at| tick > at + self.steps.horizons.pause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::horizons::Horizons;

    fn kilohertz() -> (MemoryPressure, PressureHorizons) {
        let horizons = Horizons::new(1000.0).pressure;
        (MemoryPressure::new(horizons), horizons)
    }

    #[test]
    fn want_saves_step_by_step_and_plenty_goes_back() {
        let (mut economy, horizons) = kilohertz();
        assert!(economy.may_prefetch() && economy.has_rings() && economy.may_ask(0));
        let mut tick = 100;
        for steps in 1..=5 {
            (0..horizons.misses).for_each(|_| economy.record_contact(2.0));
            economy.starve(tick);
            economy.starve(tick + 1);
            assert_eq!(economy.steps(), steps, "a step takes time to work");
            assert!(!economy.may_ask(tick + 1));
            tick += horizons.settle + 1;
        }
        assert!(!economy.may_prefetch() && !economy.has_rings());
        assert_eq!(economy.raised(), 3);
        let mut changes = Vec::new();
        for later in tick..tick + 20_000 {
            let before = economy.steps();
            economy.recover(later);
            if economy.steps() < before {
                changes.push(later);
            }
        }
        assert_eq!(economy.steps(), 0);
        assert_eq!(changes.len(), 5);
        assert!(
            changes
                .windows(2)
                .all(|pair| pair[1] - pair[0] > horizons.wait)
        );
    }

    /// Misses of several sizes, each as often as gives this mean error.
    #[test]
    fn the_contact_comes_coarser_where_its_mean_error_is_above_that_of_the_next_ring() {
        for (mean, is_raised) in [(0.3, false), (0.8, false), (1.25, true), (4.0, true)] {
            for miss in [4.0, 8.0, 40.0] {
                let (mut economy, _) = kilohertz();
                let mut missed = 0.0;
                for tick in 0..20_000_u64 {
                    let is_miss = missed < tick as f64 * mean / miss;
                    missed += f64::from(u8::from(is_miss));
                    economy.record_contact(if is_miss { miss } else { 0.0 });
                    if tick % 70 == 0 && economy.steps() < 3 {
                        economy.starve(tick);
                    }
                }
                assert_eq!(economy.raised() > 0, is_raised, "{mean} by {miss}");
            }
        }
    }

    #[test]
    fn losses_are_bounded_and_full_resolution_pays_them_back() {
        let (mut economy, horizons) = kilohertz();
        for error in [f64::INFINITY, 1e30, 1.0] {
            economy.record_contact(error);
            assert_eq!(economy.misses, PARTS * horizons.misses);
        }
        (0..horizons.misses).for_each(|_| economy.record_contact(0.0));
        assert_eq!(economy.misses, 0);
    }

    #[test]
    fn where_there_is_more_than_at_any_want_steps_go_back_one_after_the_other() {
        let horizons = Horizons::new(1000.0).pressure;
        let mut steps = Steps::new(horizons);
        for k in 0..4 {
            assert!(steps.want(k * (horizons.settle + 1)));
            steps.step(k * (horizons.settle + 1));
        }
        let from = 3 * (horizons.settle + 1);
        let mut waits = Vec::new();
        let mut last = from;
        for tick in from..from + 10 * horizons.settle {
            let before = steps.count();
            steps.recover(tick, true);
            if steps.count() < before {
                waits.push(tick - last);
                last = tick;
            }
        }
        assert_eq!(waits, vec![horizons.settle + 1; 4]);
    }

    /// A block that comes in time for the contact now and again is no reason to wait for ever.
    #[test]
    fn wants_that_are_borne_after_one_step_back_double_the_wait_once() {
        let (mut economy, horizons) = kilohertz();
        let mut tick = 0;
        for _ in 0..STEPS_BEFORE_COARSER + 1 {
            (0..horizons.misses).for_each(|_| economy.record_contact(2.0));
            tick += horizons.settle + 1;
            economy.starve(tick);
        }
        (0..horizons.misses).for_each(|_| economy.record_contact(0.0));
        while economy.steps() > STEPS_BEFORE_COARSER {
            tick += 1;
            economy.recover(tick);
        }
        for _ in 0..4 {
            tick += 1;
            economy.starve(tick);
        }
        assert_eq!(economy.steps(), STEPS_BEFORE_COARSER);
        assert_eq!(economy.steps.wait_ticks, 2 * horizons.wait);
    }

    #[test]
    fn a_step_back_that_was_too_early_is_taken_later_the_next_time() {
        let (mut economy, horizons) = kilohertz();
        let (mut tick, mut waits) = (0, Vec::new());
        for _ in 0..6 {
            economy.starve(tick);
            let from = tick;
            while economy.steps() > 0 {
                tick += 1;
                economy.recover(tick);
            }
            waits.push(tick - from);
            tick += 10;
        }
        assert!(
            waits
                .windows(2)
                .all(|pair| pair[1] > pair[0] || pair[1] > horizons.max_wait)
        );
        assert!(waits.iter().all(|&wait| wait <= horizons.max_wait + 1));
    }
}
