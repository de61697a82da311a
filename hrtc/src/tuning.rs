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

/// Stack of the watchdog's thread, bytes: it holds a few words and what a driver's stop needs.
/// Locked memory commits it whole.
pub const WATCHDOG_STACK_BYTES: usize = 128 << 10;

/// Stack of the thread that hears signals, bytes: it sets flags only.
pub const SIGNALS_STACK_BYTES: usize = 128 << 10;

/// Time between two looks of the main thread at the log.
pub const DRAIN_PERIOD: Duration = Duration::from_millis(10);
/// Time between two status lines of a supervised run, ns: 5 a second.
pub const STATUS_PERIOD_NS: u64 = 200_000_000;
/// Silence after which a missing station is reported, ns: three times its usual start.
pub const STATION_ABSENT_NS: u64 = 1_500_000_000;
/// Length of a tour when the run has no end of its own, seconds.
pub const TOUR_SECONDS: f64 = 600.0;

/// Validity of a wrench, periods of the loop from its write: 30 ms at 1 kHz. Longer than the
/// stalls measured on a busy virtual machine (8, 18, 28 periods); a hand moves a few millimetres
/// in it.
pub const COMMAND_VALIDITY_PERIODS: u64 = 30;
/// Length of the ramp to zero after a panic, periods: a third of the validity, so that the ramp
/// ends before the watchdog would, also after a stall of the same length. 8 N fall by 0.8 N a step,
/// below the 2 N that the default slew limit of 2000 N/s allows.
pub const PANIC_RAMP_PERIODS: u32 = (COMMAND_VALIDITY_PERIODS / 3) as u32;
/// Time for which a second signal waits for the tick thread to switch its devices off before the
/// process ends without it: 20 looks at the log.
pub const OFF_TIMEOUT: Duration = Duration::from_millis(200);
/// Time for which the end of a run waits for the thread of the link to close its ports.
pub const LINK_END_TIMEOUT: Duration = Duration::from_secs(2);
/// Chunks between link and recording: eight times the credit window of the protocol, about 1 MiB.
/// Locked memory commits them all.
pub const CHUNK_LOG_CAPACITY: usize = 256;

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
