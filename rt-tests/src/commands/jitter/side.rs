//! All blocks of one loop, added up.

use hdrhistogram::Histogram;
use hrtc::result::{Buckets, Finished, Misses};
use serde::Serialize;

/// Percentiles and maximum, microseconds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Tail {
    /// Median.
    pub p50: f64,
    /// 99 % are not above it.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// 99.99 %.
    pub p9999: f64,
    /// Largest.
    pub max: f64,
}

/// All blocks of one kind.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Side {
    /// Ticks run.
    pub ticks: u64,
    /// Periods skipped.
    pub missed: u64,
    /// Of these, by own processor time or own waiting.
    pub missed_own_cpu: u64,
    /// All by reason.
    pub misses: Misses,
    /// Wake-up after the deadline.
    pub wake_us: Tail,
    /// Thread CPU of the work.
    pub work_cpu_us: Tail,
    /// Wall time of the work.
    pub work_wall_us: Tail,
    /// Since the start of the tick before.
    pub period_us: Tail,
    /// Mean of the wait before a tick that was spun.
    pub spun_us_mean: f64,
    /// Page faults within ticks.
    pub page_faults: u64,
    /// Allocations and frees within ticks.
    pub allocations: u64,
    /// Voluntary context switches beyond the waits for the timer.
    pub extra_switches: u64,
    /// Largest deviation of a tick from t0 + k T, nanoseconds.
    pub drift_ns_max: u64,
    /// Periods that were neither run nor counted as skipped.
    pub unaccounted_periods: u64,
    /// Processor time that the hypervisor took during the blocks, kernel ticks of 10 ms.
    pub steal_ticks: u64,
}

impl Side {
    /// Share of the periods that were skipped; not a number without periods.
    #[must_use]
    pub fn missed_share(&self) -> f64 {
        self.missed as f64 / (self.missed + self.ticks) as f64
    }

    /// Share of the periods that were skipped by own processor time or own waiting.
    #[must_use]
    pub fn own_share(&self) -> f64 {
        self.missed_own_cpu as f64 / (self.missed + self.ticks) as f64
    }
}

/// All blocks of one kind while they are added up.
#[derive(Default)]
pub(super) struct Blocks {
    side: Side,
    spun_us_sum: f64,
    pub(super) wake: Buckets,
    pub(super) work_cpu: Buckets,
    work_wall: Buckets,
    period: Buckets,
}

impl Blocks {
    pub(super) fn add(&mut self, block: &Finished, steal: u64) {
        let r = &block.result;
        let side = &mut self.side;
        side.ticks += r.ticks;
        side.missed += r.missed;
        side.missed_own_cpu += r.missed_own_cpu;
        side.misses.add(&r.misses);
        side.page_faults += r.page_faults;
        side.allocations += r.allocations;
        side.extra_switches += r.extra_switches;
        side.drift_ns_max = side.drift_ns_max.max(r.drift_ns_max);
        side.unaccounted_periods += r.unaccounted_periods.unsigned_abs();
        side.steal_ticks += steal;
        self.spun_us_sum += r.spun_us_mean * r.ticks as f64;
        for (tail, max) in [
            (&mut side.wake_us, r.wake_us.max),
            (&mut side.work_cpu_us, r.work_us.max),
            (&mut side.work_wall_us, r.work_wall_us.max),
            (&mut side.period_us, r.period_us.max),
        ] {
            tail.max = tail.max.max(max);
        }
        let h = &block.histograms;
        self.wake.extend(&h.wake_ns);
        self.work_cpu.extend(&h.work_cpu_ns);
        self.work_wall.extend(&h.work_wall_ns);
        self.period.extend(&h.period_ns);
    }

    pub(super) fn finish(&self) -> Side {
        let mut side = self.side.clone();
        for (tail, buckets) in [
            (&mut side.wake_us, &self.wake),
            (&mut side.work_cpu_us, &self.work_cpu),
            (&mut side.work_wall_us, &self.work_wall),
            (&mut side.period_us, &self.period),
        ] {
            *tail = tail_of(buckets, tail.max);
        }
        side.spun_us_mean = self.spun_us_sum / side.ticks.max(1) as f64;
        side
    }
}

/// Percentiles of merged histograms (nanoseconds), in microseconds; the maximum is known exactly.
fn tail_of(buckets: &Buckets, max: f64) -> Tail {
    let Ok(mut histogram) = Histogram::<u64>::new_with_bounds(1, 1 << 32, 3) else {
        return Tail::default();
    };
    for &(value, count) in buckets {
        histogram.saturating_record_n(value, count);
    }
    if histogram.is_empty() {
        return Tail::default();
    }
    let quantile = |q: f64| (histogram.value_at_quantile(q) as f64 / 1e3).min(max);
    Tail {
        p50: quantile(0.5),
        p99: quantile(0.99),
        p999: quantile(0.999),
        p9999: quantile(0.9999),
        max,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_blocks_have_the_percentiles_of_all_their_ticks() {
        let first: Buckets = vec![(1_000, 98), (50_000, 2)];
        let second: Buckets = vec![(2_000, 99), (900_000, 1)];
        let all: Buckets = first.into_iter().chain(second).collect();
        let tail = tail_of(&all, 890.0);
        assert!((tail.p50 - 2.0).abs() < 0.01, "{tail:?}");
        assert!((tail.p99 - 50.0).abs() < 0.1, "{tail:?}");
        assert_eq!((tail.p9999, tail.max), (890.0, 890.0));
        assert_eq!(tail_of(&Vec::new(), 0.0), Tail::default());
    }

    #[test]
    fn a_fault_of_one_block_is_a_fault_of_all() {
        let mut blocks = Blocks::default();
        let mut odd = Finished::default();
        odd.result.ticks = 10;
        odd.result.extra_switches = 1;
        odd.result.drift_ns_max = 5;
        odd.result.spun_us_mean = 30.0;
        odd.result.unaccounted_periods = -2;
        let mut good = Finished::default();
        good.result.ticks = 20;
        good.result.unaccounted_periods = 2;
        for block in [&good, &odd, &good] {
            blocks.add(block, 0);
        }
        let side = blocks.finish();
        assert_eq!((side.extra_switches, side.drift_ns_max), (1, 5));
        assert_eq!((side.unaccounted_periods, side.spun_us_mean), (6, 6.0));
    }
}
