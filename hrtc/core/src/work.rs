//! The work that a tick may do: that of a tick of a millisecond in `tuning.rs`, in proportion to
//! the period. What a second costs is the same up to 2 kHz; beyond, a tick keeps the work of half a
//! millisecond, since what is decided in one tick has to be seen in one: with less no fold is ever
//! passed, and tools lag (`rt-tests stability --rate 4000`).

use crate::tuning::lod::{MAX_FORGOTTEN, MAX_UPKEEP, MIN_OPERATIONS};
use crate::tuning::streaming::{INGEST_PER_OPERATION, MIN_INGEST, MIN_UNITS, WAITING_CHUNKS};
use crate::tuning::tick::{PROXY_WORK, SEARCH_WORK};

/// Bounds of a tick's work, each that of the constant of its name, converted once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TickWork {
    /// Nodes visited and faces tested by the steps of all proxies.
    pub proxies: u32,
    /// The same for the searches beside the steps.
    pub searches: u32,
    /// Entries of closures, region tables and caches that are unloaded, forgotten or passed over.
    pub upkeep: u32,
    /// Of these at the most for places that have changed hands.
    pub forgotten: u32,
    /// Splits, and collapses, where nothing is urgent.
    pub min_operations: u32,
    /// Work units for received data while few chunks wait.
    min_ingest: u32,
}

impl TickWork {
    /// At a rate, ticks a second.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        let periods_ms = scene::work_ms(rate_hz);
        let a_tick = |of_ms: u32| (f64::from(of_ms) * periods_ms).round().max(1.0) as u32;
        Self {
            proxies: a_tick(PROXY_WORK),
            searches: a_tick(SEARCH_WORK),
            upkeep: a_tick(MAX_UPKEEP),
            forgotten: a_tick(MAX_FORGOTTEN),
            min_operations: a_tick(MIN_OPERATIONS),
            // With less no slot would ever be taken.
            min_ingest: a_tick(MIN_INGEST).max(MIN_UNITS),
        }
    }

    /// The most work of all queries of a tick.
    #[must_use]
    pub fn queries(&self) -> u32 {
        self.proxies + self.searches
    }

    /// The most work units for received data, where a tick may do so many splits and collapses.
    #[must_use]
    pub fn max_ingest(&self, operations: usize) -> u32 {
        (INGEST_PER_OPERATION * operations as u32).max(self.min_ingest)
    }

    /// The work units for received data in a tick with so many chunks that wait.
    #[must_use]
    pub fn ingest_for(&self, waiting: usize, operations: usize) -> u32 {
        let waiting = waiting.div_ceil(WAITING_CHUNKS) as u32;
        (self.min_ingest * waiting).clamp(self.min_ingest, self.max_ingest(operations))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_of_work_is_the_same_up_to_2_khz() {
        let kilohertz = TickWork::new(1e3);
        assert_eq!(kilohertz.queries(), PROXY_WORK + SEARCH_WORK);
        assert_eq!(kilohertz.ingest_for(0, 96), MIN_INGEST);
        for rate_hz in [4000.0, 10_000.0] {
            assert_eq!(TickWork::new(rate_hz), TickWork::new(2000.0));
        }
        for rate_hz in [100.0, 250.0, 500.0, 2000.0] {
            let here = TickWork::new(rate_hz);
            for (of, at_kilohertz) in [
                (here.proxies, kilohertz.proxies),
                (here.searches, kilohertz.searches),
                (here.upkeep, kilohertz.upkeep),
            ] {
                let a_second = f64::from(of) * rate_hz;
                let expected = f64::from(at_kilohertz) * 1e3;
                assert!((a_second / expected - 1.0).abs() < 5e-3, "{rate_hz}: {of}");
            }
            assert!(here.min_operations >= 1 && here.ingest_for(0, 1) >= MIN_UNITS);
        }
    }
}
