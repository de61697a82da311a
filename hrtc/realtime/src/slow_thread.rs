//! A thread whose work takes several times as long, for tests of a slower machine.

use crate::rights::thread_cpu_ns;

/// Makes each part of a thread's work take a number of times its own processor time.
#[derive(Debug)]
pub struct SlowThread {
    factor: f64,
    /// Processor time of the thread when the part began, ns; not read where nothing is slowed down.
    began_ns: u64,
}

impl SlowThread {
    /// A part of the work begins now; with a factor of at most 1 it takes as long as it does.
    #[must_use]
    pub fn begin(factor: f64) -> Self {
        let began_ns = if factor > 1.0 { thread_cpu_ns() } else { 0 };
        Self { factor, began_ns }
    }

    /// How much longer the part so far takes on the slower machine, ns: what is spun at its end.
    #[must_use]
    pub fn extra_ns(&self) -> u64 {
        if self.factor <= 1.0 {
            return 0;
        }
        let own = thread_cpu_ns() - self.began_ns;
        ((self.factor - 1.0) * own as f64) as u64
    }

    /// Spins until the part has taken so many times its own processor time; then the next begins.
    pub fn end_part(&mut self) {
        if self.factor <= 1.0 {
            return;
        }
        let own = thread_cpu_ns() - self.began_ns;
        let until = self.began_ns + (self.factor * own as f64) as u64;
        while thread_cpu_ns() < until {
            std::hint::spin_loop();
        }
        self.began_ns = thread_cpu_ns();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extra_time_is_what_the_end_of_a_part_spins() {
        let busy = |ns: u64| {
            let until = thread_cpu_ns() + ns;
            while thread_cpu_ns() < until {
                std::hint::spin_loop();
            }
        };
        assert_eq!(SlowThread::begin(1.0).extra_ns(), 0);
        let began = thread_cpu_ns();
        let mut slow = SlowThread::begin(4.0);
        busy(1_000_000);
        let extra = slow.extra_ns();
        assert!(extra >= 3_000_000, "{extra}");
        slow.end_part();
        assert!(thread_cpu_ns() - began >= 4_000_000);
        // The next part has nothing of the one before.
        assert!(slow.extra_ns() < extra);
    }
}
