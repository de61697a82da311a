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
    pub fn owed_ns(&self) -> u64 {
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
