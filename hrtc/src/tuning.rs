//! Constants of the shell: sizes of rings and stacks, waiting times.

use protocol::HELLO_PERIOD_MS;
use std::time::Duration;

/// Chunks between link and tick: twice the credit window of the protocol, so that the link finds
/// room for everything that the station may send.
pub const INBOX_CAPACITY: usize = 64;
/// Tick records between tick and main thread: about a second at 1 kHz, a hundred times
/// [`DRAIN_PERIOD`]. Locked memory commits them all.
pub const LOG_CAPACITY: usize = 1024;
/// Requests, and contact reports, between tick and link: many times the few of one tick; the link
/// empties them every [`LINK_POLL_PERIOD`].
pub const OUT_CAPACITY: usize = 64;

/// Stack of the tick thread, bytes: three times the 128 KiB that it touches at start; a debug build
/// does not reuse slots of the stack. Locked memory commits it whole.
pub const TICK_STACK_BYTES: usize = if cfg!(debug_assertions) {
    4 << 20
} else {
    384 << 10
};
/// Stack of the link's thread, bytes: iceoryx2 puts samples of tens of KiB on it, and a debug build
/// keeps many copies of them. Locked memory commits it whole.
pub const LINK_STACK_BYTES: usize = if cfg!(debug_assertions) {
    2 << 20
} else {
    512 << 10
};

/// Time between two looks of the main thread at the log.
pub const DRAIN_PERIOD: Duration = Duration::from_millis(10);
/// Time between two status lines of a supervised run, ns: 5 a second.
pub const STATUS_PERIOD_NS: u64 = 200_000_000;
/// Silence after which a missing station is reported, ns: three times its usual start.
pub const STATION_ABSENT_NS: u64 = 1_500_000_000;
/// Length of a tour when the run has no end of its own, seconds.
pub const TOUR_SECONDS: f64 = 600.0;

/// Validity of a wrench command, ns. Longer than the stalls of a busy machine (tens of
/// milliseconds), shorter than the soft end of a force (0.2 s).
pub const COMMAND_VALIDITY_NS: u64 = 100_000_000;

/// Time between two looks of the link at its ports: well below a period of 1 ms.
pub const LINK_POLL_PERIOD: Duration = Duration::from_micros(150);
/// Time between two heartbeats.
pub const HELLO_PERIOD: Duration = Duration::from_millis(HELLO_PERIOD_MS);
/// Silence after which a station counts as absent: five heartbeats.
pub const STATION_TIMEOUT: Duration = Duration::from_millis(5 * HELLO_PERIOD_MS);
/// Time between two clean-ups of dead nodes.
pub const CLEANUP_PERIOD: Duration = Duration::from_secs(1);
/// Different sentences about peers that the link logs, at most.
pub const MAX_LOGGED_SENTENCES: usize = 64;

/// Longest head of a recording that is read, bytes: far above any scene.
pub const MAX_RECORDING_HEAD_BYTES: u64 = 16 << 20;
