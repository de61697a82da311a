//! Times of single pieces of work, of any length.

use realtime::rights::{monotonic_ns, thread_cpu_ns};

/// Two clocks: wall time has the time of other processes in it, processor time takes long to be
/// read, and now and then longer than it took when that was measured. So wall time counts, unless
/// processor time says that others ran meanwhile.
#[derive(Debug, Clone, Copy)]
pub struct Clocks {
    /// What reading both takes, nanoseconds of each.
    costs: Reading,
}

/// Readings of both clocks, or their differences, nanoseconds.
#[derive(Debug, Clone, Copy, Default)]
pub struct Reading {
    wall: u64,
    cpu: u64,
}

impl Default for Clocks {
    fn default() -> Self {
        Self::new()
    }
}

impl Clocks {
    /// Measures what reading the clocks takes.
    #[must_use]
    pub fn new() -> Self {
        let readings: Vec<Reading> = (0..1001).map(|_| Self::start().taken()).collect();
        let median = |of: fn(&Reading) -> u64| {
            let mut ns: Vec<u64> = readings.iter().map(of).collect();
            ns.sort_unstable();
            ns[ns.len() / 2]
        };
        Self {
            costs: Reading {
                wall: median(|of| of.wall),
                cpu: median(|of| of.cpu),
            },
        }
    }

    /// What reading the wall clock takes, nanoseconds: work that is shorter cannot be timed alone.
    #[must_use]
    pub fn cost_ns(self) -> u64 {
        self.costs.wall
    }

    /// A piece of work begins.
    #[must_use]
    pub fn start() -> Reading {
        let cpu = thread_cpu_ns();
        // Last, so that it is nearest to the work.
        let wall = monotonic_ns();
        Reading { wall, cpu }
    }

    /// Nanoseconds of the work since then.
    #[must_use]
    pub fn since(self, start: Reading) -> f64 {
        self.work(start.taken())
    }

    /// What of the differences of the clocks is the work.
    fn work(self, taken: Reading) -> f64 {
        let wall = taken.wall.saturating_sub(self.costs.wall);
        // Processor time is read around wall time: only where others ran is less of it.
        if taken.cpu >= taken.wall {
            return wall as f64;
        }
        let cpu = taken.cpu.saturating_sub(self.costs.cpu);
        wall.min(cpu) as f64
    }

    /// Nanoseconds of a piece of work, and its result.
    pub fn time<T>(self, work: impl FnOnce() -> T) -> (f64, T) {
        let start = Self::start();
        let result = work();
        (self.since(start), result)
    }
}

impl Reading {
    /// Until now.
    fn taken(self) -> Self {
        let wall = monotonic_ns() - self.wall;
        let cpu = thread_cpu_ns() - self.cpu;
        Self { wall, cpu }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::quantile::{quantile, sort};
    use realtime::rights::sleep_until_ns;

    /// The costs were measured while processor time took thrice as long to be read.
    #[test]
    fn a_slow_moment_of_the_calibration_is_not_taken_off_the_work() {
        let costs = Reading {
            wall: 25,
            cpu: 1500,
        };
        let clocks = Clocks { costs };
        let of = |wall, cpu| clocks.work(Reading { wall, cpu });
        assert_eq!(of(325, 800), 300.0);
        // Others ran for a millisecond.
        assert_eq!(of(1_002_025, 2300), 800.0);
        assert_eq!(of(10, 500), 0.0);
    }

    #[test]
    fn time_of_others_is_not_counted_and_work_is() {
        let clocks = Clocks::new();
        let (slept, ()) = clocks.time(|| sleep_until_ns(monotonic_ns() + 30_000_000));
        let (worked, ()) = clocks.time(|| {
            let until = thread_cpu_ns() + 30_000_000;
            while thread_cpu_ns() < until {}
        });
        assert!(worked >= 29e6 && slept < worked, "{slept} {worked}");
        let mut nothing: Vec<f64> = (0..1001).map(|_| clocks.time(|| ()).0).collect();
        sort(&mut nothing);
        // Half of them take less than the median that is taken off.
        let middle = quantile(&nothing, 0.25);
        assert!(middle <= clocks.cost_ns() as f64, "{middle}");
    }
}
