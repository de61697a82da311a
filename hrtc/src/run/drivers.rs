//! The time that the drivers of the devices take of a tick.

use crate::tuning::{FAST_DRIVERS_NS, SLOW_DRIVERS_S};
use hrtc_core::governor::MeasuredTick;
use realtime::pacer::Worked;
use realtime::rights::{monotonic_ns, thread_cpu_ns};

/// Measures it. The processor's time is asked for only where they were slow of late, since to ask
/// takes a third of a microsecond, four times a tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drivers {
    /// Ticks for which they count as slow after one in which they were, and those left.
    slow_ticks: u32,
    left: u32,
    /// Of the present tick, by the clock, ns.
    wall_ns: u64,
    /// Of the processor, ns; 0 where it is not asked for.
    cpu_ns: u64,
}

impl Drivers {
    pub fn new(rate_hz: f64) -> Self {
        Self {
            slow_ticks: (SLOW_DRIVERS_S * rate_hz) as u32,
            left: 0,
            wall_ns: 0,
            cpu_ns: 0,
        }
    }

    pub fn begin_tick(&mut self) {
        self.left = if self.are_slow() {
            self.slow_ticks
        } else {
            self.left.saturating_sub(1)
        };
        (self.wall_ns, self.cpu_ns) = (0, 0);
    }

    /// Does what they do, and adds its time.
    pub fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let cpu_now = |asked: bool| if asked { thread_cpu_ns() } else { 0 };
        let asked = self.left > 0;
        let (wall, cpu) = (monotonic_ns(), cpu_now(asked));
        let done = work();
        self.cpu_ns += cpu_now(asked) - cpu;
        self.wall_ns += monotonic_ns() - wall;
        done
    }

    fn are_slow(&self) -> bool {
        self.wall_ns > FAST_DRIVERS_NS
    }

    /// What they took of the tick so far, ns; 0 where that is no more than what every tick does
    /// anyway, and in the first tick in which they are slow: it may have been interrupted.
    pub fn taken_ns(&self) -> u64 {
        let is_known = self.left > 0 && self.are_slow();
        if is_known { self.wall_ns } else { 0 }
    }

    /// What the tick took beside them, with the time of handing its record over. In the first tick
    /// in which they are slow it is not known how much of it was theirs: it counts as its own.
    pub fn beside(&self, worked: &Worked, record_ns: u32) -> MeasuredTick {
        let work_ns = u64::from(worked.cpu_ns).saturating_sub(self.cpu_ns) + u64::from(record_ns);
        let device_ns = self.taken_ns();
        let [work_ns, device_ns] =
            [work_ns, device_ns].map(|ns| u32::try_from(ns).unwrap_or(u32::MAX));
        MeasuredTick { work_ns, device_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const RATE_HZ: f64 = 1000.0;

    fn spin(ns: u64) {
        let until = thread_cpu_ns() + ns;
        while thread_cpu_ns() < until {
            std::hint::spin_loop();
        }
    }

    /// A tick whose drivers do one thing and whose core another, and what is told of it.
    fn tick(drivers: &mut Drivers, of_driver: impl FnOnce(), of_core: impl FnOnce()) -> [u64; 2] {
        let began = thread_cpu_ns();
        drivers.begin_tick();
        drivers.time(of_driver);
        of_core();
        let worked = Worked {
            cpu_ns: (thread_cpu_ns() - began) as u32,
            wall_ns: 0,
            page_faults: 0,
        };
        let measured = drivers.beside(&worked, 1000);
        [measured.work_ns, measured.device_ns].map(u64::from)
    }

    #[test]
    fn what_a_read_took_counts_where_the_drivers_were_slow_before() {
        let mut drivers = Drivers::new(RATE_HZ);
        for expected in [0, 2_000_000, 2_000_000] {
            drivers.begin_tick();
            assert_eq!(drivers.taken_ns(), 0, "nothing was read yet");
            drivers.time(|| spin(2_000_000));
            let taken = drivers.taken_ns();
            assert!(
                taken >= expected && (taken > 0) == (expected > 0),
                "{taken}"
            );
        }
    }

    #[test]
    fn drivers_that_work_or_wait_are_told_beside_the_work() {
        let mut drivers = Drivers::new(RATE_HZ);
        let [work, device] = tick(&mut drivers, || (), || spin(2_000_000));
        assert!(work >= 2_001_000 && device == 0, "{work} {device}");
        // The first slow tick is part of the work still.
        let [work, device] = tick(&mut drivers, || spin(2_000_000), || spin(1_000_000));
        assert!(work >= 3_001_000 && device == 0, "{work} {device}");
        let whole = thread_cpu_ns();
        let [work, device] = tick(&mut drivers, || spin(2_000_000), || spin(1_000_000));
        let whole = thread_cpu_ns() - whole;
        assert!(work >= 1_001_000 && device >= 2_000_000, "{work} {device}");
        assert!(work + 2_000_000 <= whole + 1_000, "{work} {whole}");
        // It reads at every other tick only.
        tick(&mut drivers, || (), || ());
        let [work, device] = tick(&mut drivers, || spin(2_000_000), || ());
        assert!(work < 2_000_000 && device >= 2_000_000, "{work} {device}");
        // One that waits takes of the period, and nothing off the work.
        let wait = || std::thread::sleep(Duration::from_millis(5));
        let [work, device] = tick(&mut drivers, wait, || spin(1_000_000));
        assert!(work >= 1_001_000 && device >= 5_000_000, "{work} {device}");
    }
}
