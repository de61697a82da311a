//! The watchdog: zero force when the tick does not write any more.
//!
//! Every tick renews a [`Lease`] before it writes its wrenches; a lease lasts as long as these are
//! valid. The watchdog's thread sleeps until the lease that it saw would end. If it was not renewed
//! by then, it claims the lease, brings the devices to zero through their [`SafeStop`] handles and
//! counts the event. A tick that comes back finds its lease lost: it writes zero, and the force
//! rises from zero along the ramp. Claim and renewal exchange one atomic value. The tick looks
//! before each write and after the last: where one took so long that the lease has ended, it writes
//! no more force, and ends what came late.

use super::shared::Shared;
use crate::tuning::{COMMAND_VALIDITY_NS, WATCHDOG_STACK_BYTES};
use haptic_device::SafeStop;
use realtime::rights::{monotonic_ns, set_fifo};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// No wrench was written yet.
const FREE: u64 = 0;
/// The watchdog has brought the devices to zero.
const STOPPED: u64 = 1;
/// The watchdog is bringing the devices to zero.
const STOPPING: u64 = u64::MAX;

/// Time until which the standing wrenches are valid, CLOCK_MONOTONIC, ns; or one of the constants.
#[derive(Debug, Default)]
pub(super) struct Lease(AtomicU64);

impl Lease {
    /// For the tick, before it writes: stands until `until_ns`. False when the last one has run
    /// out: the devices are at zero then, or on the way, and get zero in this tick.
    pub fn extend(&self, now_ns: u64, until_ns: u64) -> bool {
        let held = self.0.load(Ordering::Acquire);
        if held == STOPPING {
            return false;
        }
        let extended = self
            .0
            .compare_exchange(held, until_ns, Ordering::AcqRel, Ordering::Acquire)
            .is_ok();
        extended && held != STOPPED && (held == FREE || now_ns < held)
    }

    /// For the tick, before it computes: whether the standing wrenches have expired, so that the
    /// devices are at zero or on the way.
    pub fn has_run_out(&self, now_ns: u64) -> bool {
        match self.0.load(Ordering::Acquire) {
            FREE => false,
            STOPPED | STOPPING => true,
            until_ns => until_ns <= now_ns,
        }
    }

    /// For the tick's end: no wrench stands.
    pub fn release(&self) {
        self.0.store(FREE, Ordering::Release);
    }

    /// For the watchdog: calls `stop` when the lease has run out. Time until the lease that it saw
    /// ends, ns; `None` when none stands, and whether it stopped.
    fn look(&self, now_ns: u64, stop: impl FnOnce()) -> Look {
        let held = self.0.load(Ordering::Acquire);
        if matches!(held, FREE | STOPPED | STOPPING) {
            return Look::None;
        }
        if now_ns < held {
            return Look::Stands(held - now_ns);
        }
        let claim = self
            .0
            .compare_exchange(held, STOPPING, Ordering::AcqRel, Ordering::Acquire);
        if claim.is_err() {
            return Look::Renewed;
        }
        stop();
        self.0.store(STOPPED, Ordering::Release);
        Look::Stopped
    }
}

/// What the watchdog saw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Look {
    /// No lease.
    None,
    /// A lease with so many nanoseconds left.
    Stands(u64),
    /// It was renewed in the last moment.
    Renewed,
    /// It had run out; the devices are at zero.
    Stopped,
}

/// The running watchdog. Dropping it ends it.
#[derive(Debug)]
pub(super) struct Watchdog {
    shared: Arc<Shared>,
    /// Devices that it can stop.
    stops: usize,
    thread: Option<JoinHandle<()>>,
}

impl Watchdog {
    /// Starts the thread, one priority above the tick's where that is granted, on any core: a tick
    /// that never ends its work must not keep it away.
    pub fn spawn(
        stops: Vec<Box<dyn SafeStop>>,
        shared: Arc<Shared>,
        priority: i32,
    ) -> std::io::Result<Self> {
        let watched = Arc::clone(&shared);
        let count = stops.len();
        let thread = thread::Builder::new()
            .name("hrtc-watchdog".to_owned())
            .stack_size(WATCHDOG_STACK_BYTES)
            .spawn(move || {
                // The tick reports a refused priority.
                let _ = set_fifo(priority + 1).or_else(|_| set_fifo(priority));
                watch(&stops, &watched);
            })?;
        Ok(Self {
            shared,
            stops: count,
            thread: Some(thread),
        })
    }

    /// What ends the force of so many devices where the tick does not write, in words.
    pub fn what_ends_a_force(&self, devices: usize) -> &'static str {
        match self.stops {
            0 => "the devices have no safe stop and end a force as its validity ends",
            all if all >= devices => "the watchdog brought the devices to zero",
            _ => {
                "the watchdog brought the devices with a safe stop to zero, and the others end a force as its validity ends"
            }
        }
    }

    /// Wakes it: an end or a request to switch off is seen at once.
    pub fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.shared.unwatched.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn watch(stops: &[Box<dyn SafeStop>], shared: &Shared) {
    while !shared.unwatched.load(Ordering::Acquire) {
        if shared.off.load(Ordering::Acquire) {
            stop_all(stops);
        }
        let look = shared.lease.look(monotonic_ns(), || stop_all(stops));
        if look == Look::Stopped {
            shared.expiries.fetch_add(1, Ordering::Relaxed);
            // Without a safe stop only the end of its validity ends a force.
            let has_stopped = u64::from(!stops.is_empty());
            shared
                .watchdog_stops
                .fetch_add(has_stopped, Ordering::Relaxed);
        }
        let rest_ns = match look {
            Look::Stands(left) => left,
            Look::Renewed => continue,
            Look::None | Look::Stopped => COMMAND_VALIDITY_NS,
        };
        thread::park_timeout(Duration::from_nanos(rest_ns));
    }
}

/// A driver that panics keeps no other from its stop.
fn stop_all(stops: &[Box<dyn SafeStop>]) {
    for stop in stops {
        let _ = catch_unwind(AssertUnwindSafe(|| stop.stop()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Validity of the tests, in virtual ns.
    const VALID: u64 = 30;

    fn no_stop() {
        panic!("the lease stands");
    }

    #[test]
    fn a_tick_that_writes_in_time_is_never_stopped() {
        let lease = Lease::default();
        assert_eq!(lease.look(0, no_stop), Look::None, "nothing was written");
        for now in (10..10_000).step_by(VALID as usize - 1) {
            assert!(lease.extend(now, now + VALID));
            assert_eq!(
                lease.look(now + VALID - 1, no_stop),
                Look::Stands(1),
                "at {now}"
            );
        }
        lease.release();
        assert_eq!(lease.look(u64::MAX, no_stop), Look::None);
    }

    #[test]
    fn a_tick_that_stalls_is_stopped_once_and_its_first_wrench_is_zero() {
        let lease = Lease::default();
        assert!(lease.extend(10, 10 + VALID));
        let mut stops = 0;
        assert_eq!(lease.look(10 + VALID, || stops += 1), Look::Stopped);
        assert_eq!(lease.look(50 + VALID, || stops += 1), Look::None);
        assert_eq!(stops, 1);
        assert!(lease.has_run_out(100));
        assert!(!lease.extend(100, 100 + VALID), "zero first");
        assert!(!lease.has_run_out(101));
        assert!(lease.extend(101, 101 + VALID), "then the ramp");
    }

    #[test]
    fn a_late_tick_writes_zero_also_before_the_watchdog_saw_it() {
        let lease = Lease::default();
        assert!(lease.extend(10, 10 + VALID));
        assert!(!lease.extend(10 + VALID, 10 + 2 * VALID));
        assert_eq!(
            lease.look(10 + VALID, no_stop),
            Look::Stands(VALID),
            "the lease is the tick's again"
        );
        assert!(lease.extend(11 + VALID, 11 + 2 * VALID));
    }

    #[test]
    fn a_tick_that_comes_back_during_the_stop_waits_for_its_end() {
        let lease = Lease::default();
        assert!(lease.extend(10, 10 + VALID));
        let look = lease.look(10 + VALID, || {
            assert!(!lease.extend(50, 50 + VALID));
            assert!(!lease.extend(51, 51 + VALID));
        });
        assert_eq!(look, Look::Stopped);
        assert!(!lease.extend(52, 52 + VALID), "the stop may have come last");
        assert!(lease.extend(53, 53 + VALID));
    }
}
