//! The period of a loop: absolute deadlines; skipped periods are counted and classed.
//!
//! The phase is kept: a skipped period is never caught up.

use crate::rights::{
    RunDelay, ThreadUsage, monotonic_ns, sleep_until_ns, thread_cpu_ns, thread_usage,
};

/// Part of a period, 1/20, that a tick leaves to an ordinary wake-up: 50 us at 1 kHz, the 99th
/// percentile of a bare loop on the machine of the measurements. A tick whose own time needs more
/// than the rest does not fit into its period on any machine.
const WAKE_PART: u64 = 20;

/// Reason of a missed period. A miss is ours ([`MissClass::OwnCpu`], [`MissClass::OwnWait`]) when
/// the tick's own time, from its wake-up to the end of all its work and with every wait in it, does
/// not fit into the period beside an ordinary wake-up. Otherwise it has the class of the largest
/// part of the time that was taken from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum MissClass {
    /// Not missed.
    #[default]
    None,
    /// The tick's own processor time did not fit into the period.
    OwnCpu,
    /// The tick waited in its work (a lock, a blocking call) for longer than it computed, and both
    /// together did not fit into the period. A process stopped in the middle of a tick's work
    /// counts as such too: the kernel's counters do not tell the two apart.
    OwnWait,
    /// The thread was ready, but the kernel ran something else on the core.
    RunQueue,
    /// The timer itself fired late.
    LateTimer,
    /// The process was stopped while it slept (SIGSTOP, a debugger).
    Stopped,
    /// Processor time was taken away while the thread was on the core (hypervisor).
    Stolen,
    /// No measured reason.
    Unexplained,
}

impl MissClass {
    /// Whether the tick itself is the reason.
    #[must_use]
    pub fn is_ours(self) -> bool {
        matches!(self, Self::OwnCpu | Self::OwnWait)
    }
}

/// Periods missed for one reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct Miss {
    /// The reason.
    pub class: MissClass,
    /// Periods.
    pub periods: u32,
}

/// Start of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wake {
    /// Index of the tick; skipped periods count.
    pub tick: u64,
    /// Deadline of the sleep before it on CLOCK_MONOTONIC, ns: tick k is planned for t0 + k T, less
    /// the periods that the sleep then lost.
    pub planned_ns: u64,
    /// Start on CLOCK_MONOTONIC, ns.
    pub start_ns: u64,
    /// Periods skipped since the last tick.
    pub skipped: u32,
    /// Reasons of the skipped periods: those that the last tick's work used up, then those that the
    /// sleep after it lost.
    pub misses: [Miss; 2],
    /// Delay after the deadline of the sleep, ns; includes whole periods lost.
    pub wake_ns: u32,
    /// Time since the start of the last tick, ns.
    pub period_ns: u32,
    /// Part of the wait that was spun instead of slept, ns.
    pub spun_ns: u32,
    /// Voluntary context switches since the last wake-up, without the one of a sleep: of the last
    /// tick's work (a lock, a blocking call), and of a sleep that was interrupted.
    pub extra_switches: u32,
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

/// Counters of the thread at a moment.
#[derive(Debug, Clone, Copy, Default)]
struct Moment {
    /// CLOCK_MONOTONIC, ns.
    ns: u64,
    /// Processor time of the thread, ns.
    cpu_ns: u64,
    usage: ThreadUsage,
}

impl Moment {
    fn now() -> Self {
        Self {
            usage: thread_usage(),
            cpu_ns: thread_cpu_ns(),
            ns: monotonic_ns(),
        }
    }
}

/// Measures of a tick that has used up its period, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Overrun {
    period: u64,
    /// Delay of the wake-up.
    late: u64,
    /// From the wake-up to the end of all work.
    wall: u64,
    cpu: u64,
    /// Ready without running, in the sleep before the tick and in its work.
    delay: u64,
    /// Whether the thread gave the processor up by itself in its work.
    waited: bool,
}

impl Overrun {
    fn class(self) -> MissClass {
        // The delay of the wake-up is in `late` too.
        let delay_in_work = self.delay.saturating_sub(self.late);
        let lost = self.wall.saturating_sub(self.cpu + delay_in_work);
        // Without a switch of its own the thread was on the core, or thought so.
        let (waited, stolen) = if self.waited { (lost, 0) } else { (0, lost) };
        if self.cpu + waited + self.period / WAKE_PART > self.period {
            return if self.cpu >= waited {
                MissClass::OwnCpu
            } else {
                MissClass::OwnWait
            };
        }
        let timer = self.late.saturating_sub(self.delay);
        let parts = [
            (self.delay, MissClass::RunQueue),
            (timer, MissClass::LateTimer),
            (stolen, MissClass::Stolen),
            (waited, MissClass::OwnWait),
        ];
        let largest = parts.into_iter().max_by_key(|(ns, _)| *ns);
        largest.map_or(MissClass::Unexplained, |(ns, class)| {
            if ns == 0 {
                MissClass::Unexplained
            } else {
                class
            }
        })
    }
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
    /// Start of the last tick on CLOCK_MONOTONIC, ns.
    last_start: u64,
    /// Start of the last tick's work; `None` before the first tick.
    work: Option<Moment>,
    /// Delay of the last tick's wake-up within its period, ns.
    late: u64,
    /// Run delay at the end of the tick before the last or, if the sleep then lost whole periods,
    /// at the wake-up, ns.
    delay_before: u64,
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
            last_start: next - period,
            work: None,
            late: 0,
            delay_before: 0,
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

    /// Ends the last tick with all its work, also what came after [`Self::done`]; sleeps until the
    /// next deadline and begins the tick.
    pub fn wait(&mut self) -> Wake {
        let slept_from = Moment::now();
        let delay = self.delay();
        let in_work = self.end_work(&slept_from, delay);
        self.delay_before = delay;
        let planned = self.next;
        let (start, spun) = self.sleep();
        let usage = thread_usage();
        let late = start - planned;
        let switches = usage.voluntary_switches - slept_from.usage.voluntary_switches;
        let in_sleep = self.end_sleep(late, switches);
        self.late = late % self.period;
        let before = self.work.map_or(slept_from.usage, |work| work.usage);
        let in_work_switches = slept_from.usage.voluntary_switches - before.voluntary_switches;
        let wake = Wake {
            tick: self.tick,
            planned_ns: planned,
            start_ns: start,
            skipped: in_work.periods.saturating_add(in_sleep.periods),
            misses: [in_work, in_sleep],
            wake_ns: narrow(late),
            period_ns: narrow(start - self.last_start),
            spun_ns: narrow(spun),
            extra_switches: narrow(in_work_switches + switches.saturating_sub(1)),
        };
        self.last_start = start;
        self.work = Some(Moment {
            ns: start,
            cpu_ns: thread_cpu_ns(),
            usage,
        });
        wake
    }

    /// Sleeps until the next deadline and spins the last part; its end, and for how long it spun,
    /// ns.
    fn sleep(&self) -> (u64, u64) {
        sleep_until_ns(self.next - self.spin);
        let slept_until = monotonic_ns();
        let mut now = slept_until;
        while now < self.next {
            std::hint::spin_loop();
            now = monotonic_ns();
        }
        (now, now - slept_until)
    }

    /// The tick's work so far. It ends with the next [`Self::wait`].
    pub fn done(&mut self) -> Worked {
        let now = Moment::now();
        let start = self.work.unwrap_or(now);
        Worked {
            cpu_ns: narrow(now.cpu_ns - start.cpu_ns),
            wall_ns: narrow(now.ns - start.ns),
            page_faults: narrow(now.usage.page_faults - start.usage.page_faults),
        }
    }

    /// Skips the periods that the last tick has used up. `delay`: the run delay so far, ns.
    fn end_work(&mut self, end: &Moment, delay: u64) -> Miss {
        let Some(work) = self.work else {
            return Miss::default();
        };
        self.tick += 1;
        self.next += self.period;
        let over = end.ns.saturating_sub(self.next);
        if over == 0 {
            return Miss::default();
        }
        let overrun = Overrun {
            period: self.period,
            late: self.late,
            wall: end.ns - work.ns,
            cpu: end.cpu_ns - work.cpu_ns,
            delay: delay.saturating_sub(self.delay_before),
            waited: end.usage.voluntary_switches > work.usage.voluntary_switches,
        };
        self.skip(over.div_ceil(self.period), overrun.class())
    }

    /// Skips the periods that a sleep has lost, which ended late by so many nanoseconds and took so
    /// many switches by the thread itself.
    fn end_sleep(&mut self, late: u64, switches: u64) -> Miss {
        if late < self.period {
            return Miss::default();
        }
        let delay = self.delay();
        let queued = delay.saturating_sub(self.delay_before);
        self.delay_before = delay;
        // The sleep is one switch; a stopped thread makes another when it stops.
        let class = if queued >= late / 2 {
            MissClass::RunQueue
        } else if switches > 1 {
            MissClass::Stopped
        } else {
            MissClass::LateTimer
        };
        self.skip(late / self.period, class)
    }

    fn skip(&mut self, periods: u64, class: MissClass) -> Miss {
        self.tick += periods;
        self.next += periods * self.period;
        Miss {
            class,
            periods: narrow(periods),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An overrun of a period of 1 ms; times in microseconds.
    fn class(late: u64, wall: u64, cpu: u64, delay: u64, waited: bool) -> MissClass {
        let overrun = Overrun {
            period: 1_000_000,
            late: late * 1000,
            wall: wall * 1000,
            cpu: cpu * 1000,
            delay: delay * 1000,
            waited,
        };
        overrun.class()
    }

    #[test]
    fn a_miss_is_ours_when_our_own_time_does_not_fit_the_period() {
        assert_eq!(class(5, 2500, 2500, 0, false), MissClass::OwnCpu);
        assert_eq!(class(13, 990, 990, 0, false), MissClass::OwnCpu, "an edge");
        assert_eq!(class(5, 2000, 100, 0, true), MissClass::OwnWait);
        assert_eq!(class(5, 1000, 600, 0, true), MissClass::OwnCpu, "half each");
        // The machine took more, but ours alone did not fit either.
        assert_eq!(class(5, 9000, 1200, 7800, false), MissClass::OwnCpu);
    }

    #[test]
    fn a_miss_that_is_not_ours_has_the_class_of_the_largest_part_taken() {
        assert_eq!(class(5, 1500, 300, 1200, false), MissClass::RunQueue);
        assert_eq!(class(900, 300, 300, 890, false), MissClass::RunQueue);
        assert_eq!(class(900, 300, 300, 5, false), MissClass::LateTimer);
        assert_eq!(class(5, 1500, 300, 0, false), MissClass::Stolen);
        assert_eq!(class(70, 945, 940, 0, false), MissClass::LateTimer);
    }

    #[test]
    fn a_busy_tick_stays_ours_when_the_sleep_after_it_is_late_too() {
        const US: u64 = 1000;
        let due = 1_000_000 * US;
        let work = Moment {
            ns: due + 5 * US,
            ..Moment::default()
        };
        let mut pacer = Pacer {
            period: 1000 * US,
            spin: 0,
            next: due,
            tick: 7,
            last_start: work.ns,
            work: Some(work),
            late: 5 * US,
            delay_before: 0,
            run_delay: None,
        };
        // It computes for two periods and a half.
        let end = Moment {
            ns: work.ns + 2500 * US,
            cpu_ns: 2500 * US,
            ..work
        };
        let in_work = pacer.end_work(&end, 0);
        let in_sleep = pacer.end_sleep(3200 * US, 1);
        let miss = |class, periods| Miss { class, periods };
        assert_eq!(in_work, miss(MissClass::OwnCpu, 2));
        assert_eq!(in_sleep, miss(MissClass::LateTimer, 3));
        // Each lost period is skipped once.
        assert_eq!(pacer.tick, 7 + 1 + 2 + 3);
        assert_eq!(pacer.next, due + 6 * pacer.period);
    }

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
        for wake in &ticks {
            let lost = u64::from(wake.misses[1].periods);
            assert_eq!(wake.planned_ns, start + (wake.tick - lost) * pacer.period);
            let due = start + wake.tick * pacer.period;
            assert!((due..due + pacer.period).contains(&wake.start_ns));
        }
    }

    #[test]
    fn a_wait_in_a_ticks_work_is_a_switch_too_many_and_a_spun_wait_is_none() {
        for spin_us in [0, 400] {
            let mut pacer = Pacer::new(1000.0, spin_us);
            for k in 0..20 {
                let wake = pacer.wait();
                assert_eq!(
                    wake.extra_switches,
                    u32::from(k == 11),
                    "tick {k}: {wake:?}"
                );
                assert!(spin_us > 0 || wake.spun_ns == 0, "{wake:?}");
                assert!(u64::from(wake.spun_ns) <= spin_us * 1000 + u64::from(wake.wake_ns));
                let switches = || thread_usage().voluntary_switches;
                let before = switches();
                while k == 10 && switches() == before {
                    sleep_until_ns(monotonic_ns() + 100_000);
                }
                pacer.done();
            }
        }
    }
}
