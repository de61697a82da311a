//! The period of a loop: absolute deadlines; skipped periods are counted and classed.
//!
//! The phase is kept: a skipped period is never caught up.

use crate::rights::{RunDelay, monotonic_ns, sleep_until_ns, thread_cpu_ns, thread_usage};

/// Reason of a missed period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MissClass {
    /// Not missed.
    #[default]
    None,
    /// The tick's own processor time exceeded the period.
    OwnCpu,
    /// The timer fired, but the kernel ran something else on the core.
    RunQueue,
    /// The timer itself fired late.
    LateTimer,
    /// Processor time was taken away during the work (hypervisor or kernel).
    Stolen,
    /// No measured reason.
    Unexplained,
}

/// Start of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wake {
    /// Index of the tick; skipped periods count.
    pub tick: u64,
    /// Start on CLOCK_MONOTONIC, ns.
    pub start_ns: u64,
    /// Periods skipped since the last tick.
    pub skipped: u32,
    /// Reason of the skipped periods.
    pub miss: MissClass,
    /// Delay after the deadline of the sleep, ns; includes whole periods lost.
    pub wake_ns: u32,
    /// Time since the start of the last tick, ns.
    pub period_ns: u32,
}

/// Cost of a tick's work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Worked {
    /// Processor time of the thread, ns.
    pub cpu_ns: u32,
    /// Wall time, ns.
    pub wall_ns: u32,
    /// Page faults of the thread.
    pub page_faults: u32,
}

/// Ticks of one thread. Make and use it on that thread.
#[derive(Debug)]
pub struct Pacer {
    /// Period, ns.
    period: u64,
    /// Part of the wait that is spun before a deadline, ns.
    spin: u64,
    /// Next deadline on CLOCK_MONOTONIC, ns.
    next: u64,
    /// Index of the next tick.
    tick: u64,
    /// Periods skipped since the last tick.
    skipped: u32,
    /// Reason of the skipped periods.
    miss: MissClass,
    /// Start of the last tick on CLOCK_MONOTONIC, ns.
    last_start: u64,
    /// Start of the work on CLOCK_MONOTONIC, ns.
    work_start: u64,
    /// Processor time of the thread at the start of the work, ns.
    work_cpu: u64,
    /// Page faults of the thread at the start of the work.
    work_faults: u64,
    /// `None` where the kernel keeps no run delay.
    run_delay: Option<RunDelay>,
}

fn narrow(ns: u64) -> u32 {
    u32::try_from(ns).unwrap_or(u32::MAX)
}

impl Pacer {
    /// Ticks at `rate_hz`, the first one ten periods from now. The last `spin_us` microseconds
    /// before a deadline are spun, not slept.
    #[must_use]
    pub fn new(rate_hz: f64, spin_us: u64) -> Self {
        let period = (1e9 / rate_hz).round() as u64;
        let next = monotonic_ns() + 10 * period;
        Self {
            period,
            spin: (spin_us * 1000).min(period),
            next,
            tick: 0,
            skipped: 0,
            miss: MissClass::None,
            last_start: next - period,
            work_start: 0,
            work_cpu: 0,
            work_faults: 0,
            run_delay: RunDelay::open().ok(),
        }
    }

    /// The period, ns.
    #[must_use]
    pub fn period_ns(&self) -> u64 {
        self.period
    }

    fn delay(&self) -> u64 {
        self.run_delay.as_ref().and_then(RunDelay::ns).unwrap_or(0)
    }

    /// Sleeps until the next deadline and begins the tick.
    pub fn wait(&mut self) -> Wake {
        let delay_before = self.delay();
        sleep_until_ns(self.next - self.spin);
        while monotonic_ns() < self.next {
            std::hint::spin_loop();
        }
        let start = monotonic_ns();
        let late = start - self.next;
        if late >= self.period {
            // Whole periods are gone.
            let lost = late / self.period;
            self.skip(lost);
            let queued = self.delay().saturating_sub(delay_before);
            self.miss = if queued >= late / 2 {
                MissClass::RunQueue
            } else {
                MissClass::LateTimer
            };
        }
        let wake = Wake {
            tick: self.tick,
            start_ns: start,
            skipped: self.skipped,
            miss: self.miss,
            wake_ns: narrow(late),
            period_ns: narrow(start - self.last_start),
        };
        (self.skipped, self.miss) = (0, MissClass::None);
        self.last_start = start;
        self.work_faults = thread_usage().page_faults;
        self.work_cpu = thread_cpu_ns();
        self.work_start = monotonic_ns();
        wake
    }

    /// Ends the tick's work; skips the periods that it has used up.
    pub fn done(&mut self) -> Worked {
        let now = monotonic_ns();
        let wall = now - self.work_start;
        let cpu = thread_cpu_ns() - self.work_cpu;
        let faults = thread_usage().page_faults - self.work_faults;
        self.tick += 1;
        self.next += self.period;
        let over = now.saturating_sub(self.next);
        if over > 0 {
            self.skip(over.div_ceil(self.period));
            self.miss = if cpu > self.period {
                MissClass::OwnCpu
            } else if wall > self.period {
                MissClass::Stolen
            } else {
                MissClass::Unexplained
            };
        }
        Worked {
            cpu_ns: narrow(cpu),
            wall_ns: narrow(wall),
            page_faults: narrow(faults),
        }
    }

    fn skip(&mut self, periods: u64) {
        self.skipped = self.skipped.saturating_add(narrow(periods));
        self.tick += periods;
        self.next += periods * self.period;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skipped_periods_are_counted_and_never_caught_up() {
        let mut pacer = Pacer::new(1000.0, 0);
        let start = pacer.next;
        let mut ticks = Vec::new();
        for k in 0..40 {
            let wake = pacer.wait();
            ticks.push(wake);
            if k % 8 == 3 {
                // Two and a half periods of work.
                let end = monotonic_ns() + 2_500_000;
                while monotonic_ns() < end {
                    std::hint::spin_loop();
                }
            }
            pacer.done();
        }
        for pair in ticks.windows(2) {
            assert_eq!(pair[1].tick, pair[0].tick + 1 + u64::from(pair[1].skipped));
        }
        assert!(ticks.iter().any(|wake| wake.skipped >= 2));
        // Tick k is due at t0 + k T after any number of skipped periods.
        assert_eq!(pacer.next, start + pacer.tick * pacer.period);
    }
}
