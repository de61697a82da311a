//! State that the threads of a run share.

use super::watchdog::Lease;
use crate::result::SafetyEvents;
use crate::traffic::Traffic;
use hrtc_core::Fault;
use realtime::pacer::Wake;
use realtime::rights::MissingRight;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// Flags and rare values between the tick thread and the main thread. The tick writes atomics only;
/// it takes a lock before its first tick and after a fault has ended the force.
#[derive(Debug, Default)]
pub(super) struct Shared {
    /// Request of the main thread: ramp the force down and end.
    pub stop: AtomicBool,
    /// Request of the main thread: switch the devices off without a ramp and end.
    pub off: AtomicBool,
    /// The tick thread has ended, and its devices are off.
    pub ended: AtomicBool,
    /// Request of the main thread: the watchdog ends.
    pub unwatched: AtomicBool,
    /// Validity of the wrenches that stand.
    pub lease: Lease,
    /// Times that the watchdog saw a wrench expire.
    pub expiries: AtomicU64,
    /// Of these, those in which it brought devices to zero: some have a safe stop.
    pub watchdog_stops: AtomicU64,
    /// Ticks after which the force had to rise from zero again, since its wrench had expired.
    pub force_cuts: AtomicU64,
    /// Requests to the station that found the ring full.
    pub requests_lost: AtomicU64,
    /// Contact reports to the station that found the ring full.
    pub contacts_lost: AtomicU64,
    /// The tick thread has asked for its rights and ticks.
    pub ticking: AtomicBool,
    /// CLOCK_MONOTONIC of tick 0, ns; 0 before the first tick that ran.
    pub first_tick_ns: AtomicU64,
    /// Tick records that found the log full.
    pub log_dropped: AtomicU64,
    /// Incarnation of the station; 0 for none.
    pub station: Arc<AtomicU64>,
    /// Measured round-trip time of the link to it, microseconds; 0 for none.
    pub round_trip_us: Arc<AtomicU32>,
    /// What crosses the link, by kind.
    pub traffic: Arc<Traffic>,
    /// The fault that leaves the controller nothing to do.
    pub fault: Mutex<Option<Fault>>,
    /// Faults of objects, with their numbers, while the run goes on; room for all is made before
    /// the first tick, which only tries the lock.
    pub object_faults: Mutex<Vec<(usize, Fault)>>,
    /// Real-time rights that were refused.
    pub missing: Mutex<Vec<MissingRight>>,
}

impl Shared {
    /// Notes, of the first tick, when tick 0 began, or would have where periods were skipped before
    /// that one.
    pub fn note_first(&self, wake: &Wake, rate_hz: f64) {
        if self.first_tick_ns.load(Ordering::Relaxed) == 0 {
            let since_ns = (wake.tick as f64 * 1e9 / rate_hz) as u64;
            let start_ns = wake.start_ns.saturating_sub(since_ns);
            self.first_tick_ns.store(start_ns, Ordering::Relaxed);
        }
    }

    /// Notes rights that were refused.
    pub fn refused(&self, missing: impl IntoIterator<Item = MissingRight>) {
        let all = self.missing.lock();
        all.unwrap_or_else(|e| e.into_inner()).extend(missing);
    }

    /// Counts of what the chain of safety did.
    pub fn events(&self) -> SafetyEvents {
        let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        SafetyEvents {
            watchdog_stops: count(&self.watchdog_stops),
            force_cuts: count(&self.force_cuts),
            requests_lost: count(&self.requests_lost),
            contacts_lost: count(&self.contacts_lost),
            ..SafetyEvents::default()
        }
    }
}
