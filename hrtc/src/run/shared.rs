//! State that the threads of a run share.

use hrtc_core::Fault;
use realtime::rights::MissingRight;
use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex};

/// Flags and rare values between the tick thread and the main thread. The tick writes atomics only;
/// it takes a lock before its first tick and after a fault has ended the force.
#[derive(Debug, Default)]
pub(super) struct Shared {
    /// Request of the main thread: ramp the force down and end.
    pub stop: AtomicBool,
    /// The tick thread has ended.
    pub ended: AtomicBool,
    /// The tick thread has asked for its rights and ticks.
    pub ticking: AtomicBool,
    /// CLOCK_MONOTONIC of the first tick, ns; 0 before it.
    pub first_tick_ns: AtomicU64,
    /// Tick records that found the log full.
    pub log_dropped: AtomicU64,
    /// Incarnation of the station; 0 for none.
    pub station: Arc<AtomicU64>,
    /// The fault that leaves the controller nothing to do.
    pub fault: Mutex<Option<Fault>>,
    /// Faults of objects, with their numbers, while the run goes on; room for all is made before
    /// the first tick, which only tries the lock.
    pub object_faults: Mutex<Vec<(usize, Fault)>>,
    /// Real-time rights that were refused.
    pub missing: Mutex<Vec<MissingRight>>,
}
