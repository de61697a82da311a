//! Constants of the shell: sizes of rings and stacks, waiting times.

use haptic_device::COMMAND_VALIDITY_S;
use protocol::{HELLO_PERIOD_MS, MAX_CREDIT_CHUNKS};
use std::time::Duration;

/// Chunks between link and tick: the largest credit window of the protocol, so that the link finds
/// room for everything that the station may send.
pub const INBOX_CAPACITY: usize = MAX_CREDIT_CHUNKS as usize;
/// Tick records between tick and main thread at 1 kHz: those of half a second, fifty times
/// [`DRAIN_PERIOD`]. The main thread of a recorded run has the recorder's precedence
/// ([`RECORDER_NICE`]), since what finds no room here the recording lacks: beside a hundred busy
/// threads on its core it waits 0.3 s for its turn. Locked memory commits them all, 2 KiB each.
pub const LOG_CAPACITY: usize = 512;
/// The same at the most: at 4 kHz those of a quarter of a second.
pub const MAX_LOG_CAPACITY: usize = 1024;
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
/// keeps many copies of them.
pub const LINK_STACK_BYTES: usize = if cfg!(debug_assertions) {
    2 << 20
} else {
    512 << 10
};

/// Stack of the watchdog's thread, bytes: it holds a few words and what a driver's stop needs.
/// Locked memory commits it whole.
pub const WATCHDOG_STACK_BYTES: usize = 128 << 10;

/// Stack of a thread that hears requests to end, bytes: it sets flags only. Locked memory commits
/// it whole.
pub const SIGNALS_STACK_BYTES: usize = if cfg!(debug_assertions) {
    128 << 10
} else {
    32 << 10
};

/// Time between two looks of the main thread at the log, and of another at requests to end.
pub const DRAIN_PERIOD: Duration = Duration::from_millis(10);
/// Time between two status lines of a supervised run, ns: 5 a second.
pub const STATUS_PERIOD_NS: u64 = 200_000_000;
/// Silence after which a missing station is reported, ns: three times its usual start.
pub const STATION_ABSENT_NS: u64 = 1_500_000_000;
/// Shortest and longest run, seconds: a hundred ticks of 1 kHz, and the longest tour.
pub const RUN_SECONDS: std::ops::RangeInclusive<f64> = 0.1..=protocol::LONGEST_TOUR_S;
/// Length of the longest tour of a run that names none, seconds: a longer run leads the hand back
/// and forth along it. Locked memory holds its points, 12.5 KiB for each second.
pub const MAX_TOUR_SECONDS: f64 = 600.0;
/// The same of a run without an end of its own.
pub const TOUR_SECONDS: f64 = 60.0;

/// Validity of a wrench from its write, ns.
pub const COMMAND_VALIDITY_NS: u64 = (COMMAND_VALIDITY_S * 1e9) as u64;
/// Length of the ramp to zero after a panic, seconds: a third of the validity, so that the ramp
/// ends before the watchdog would, also after a stall of the same length. 8 N fall by 0.8 N a
/// millisecond, below the 2 N that the default slew limit of 2000 N/s allows.
pub const PANIC_RAMP_S: f64 = COMMAND_VALIDITY_S / 3.0;
/// Time of a tick up to which that of the drivers is part of what every tick takes anyway,
/// nanoseconds: a hundredth of the usual period, of which nearly a third is not planned for. Their
/// processor time is not asked for then.
pub const FAST_DRIVERS_NS: u64 = 10_000;
/// Time for which it is measured after a tick in which it was more, seconds: some periods of a
/// device of 100 Hz.
pub const SLOW_DRIVERS_S: f64 = 0.1;
/// Steps of that ramp at the least, where a period is as long as it: one to zero would be none.
pub const MIN_PANIC_STEPS: u32 = 2;
/// Time for which a second Ctrl-C waits for the tick thread to switch its devices off before the
/// process ends without it: 20 looks at the log.
pub const OFF_TIMEOUT: Duration = Duration::from_millis(200);
/// Time for which the end of a run waits for the thread of the link to close its ports.
pub const LINK_END_TIMEOUT: Duration = Duration::from_secs(2);

/// Time between two looks of the link at its ports: well below a period of 1 ms.
pub const LINK_POLL_PERIOD: Duration = Duration::from_micros(150);
/// Time between two heartbeats.
pub const HELLO_PERIOD: Duration = Duration::from_millis(HELLO_PERIOD_MS);
/// Time between two heartbeats while no station is heard: a link that comes up is noticed within a
/// small part of a round trip, and carries a few of them.
pub const SEARCH_PERIOD: Duration = Duration::from_millis(10);
/// Silence after which a station counts as absent, beside what its link adds: five heartbeats.
pub const STATION_TIMEOUT: Duration = Duration::from_millis(5 * HELLO_PERIOD_MS);
/// Round trips that a link adds: what is lost is sent again after one and 200 ms (RFC 6298 with
/// Linux's least), and after two more and 400 ms where that is lost too. With [`STATION_TIMEOUT`]
/// that bridges one loss over any link, and two in a row from 200 ms on.
pub const ROUND_TRIPS_OF_SILENCE: u32 = 4;
/// Time between two clean-ups of dead nodes.
pub const CLEANUP_PERIOD: Duration = Duration::from_secs(1);
/// Different sentences about peers that the link logs, at most.
pub const MAX_LOGGED_SENTENCES: usize = 64;

/// Time between two looks of a fetch at its ports.
pub const FETCH_POLL: Duration = Duration::from_micros(500);
/// How long a run without a scene of its own waits for a station: far longer than a link takes to
/// come up.
pub const FETCH_STATION: Duration = Duration::from_secs(30);
/// Silence after which a station counts as lost while its scene is fetched: three of the longest
/// times between two questions for the same.
pub const FETCH_SILENCE: Duration = Duration::from_secs(15);
/// Silence of the station whose scene is fetched after which another one is listened to: longer
/// than any that a link makes by losses, and a part of [`FETCH_SILENCE`].
pub const SOURCE_SILENCE: Duration = Duration::from_secs(3);
/// Time after which a fetch says how far it is, and between two such lines.
pub const FETCH_TOLD: Duration = Duration::from_secs(2);
/// How long a station of this version is waited for after one of another was heard: ten heartbeats.
pub const OTHER_VERSION_HEARD: Duration = Duration::from_millis(10 * HELLO_PERIOD_MS);

/// Tick records between main thread and recorder, 2 KiB each, which take memory only while they
/// wait: those of about four seconds at 1 kHz, of one at 4 kHz. Also the latter bridges every stall
/// of the recorder's thread but a lasting lack of processor time: a keyframe takes tenths of a
/// second, and beside a hundred busy threads on its core it waits 0.3 s for its turn, with slices
/// of 3 ms.
pub const RECORDED_TICKS: usize = 4096;
/// Chunks between link and recorder, 4 KiB each, which take memory only while they wait: those of
/// six seconds at any rate. A hundred objects under three probes give at most 344 a second
/// (`config/scenes/hundred-objects.toml`).
pub const RECORDED_CHUNKS: usize = 2048;
/// Requests, and contact reports, between tick and recorder: those of 1.7 seconds at any rate,
/// since three probes make at most 300 of each a second. Locked memory commits all of them,
/// together 0.3 MiB; what finds no room costs a mark in the recording, not its replay.
pub const RECORDED_OUTPUTS: usize = 512;
/// Nice value of the recorder's threads, and of the one that feeds them: the kernel weighs it 9548
/// against the 1024 of an ordinary thread, so that beside six busy ones on its core it has 61 % of
/// that core instead of 14 %.
pub const RECORDER_NICE: i32 = -10;
/// Stack of the recorder's thread, bytes: it ticks too.
pub const RECORDER_STACK_BYTES: usize = TICK_STACK_BYTES;
/// Stack for reading a keyframe, bytes: several times the 2 MiB that a debug build overflows.
pub const KEYFRAME_STACK_BYTES: usize = 16 << 20;
/// Stack of the thread that writes the recording's files, bytes: it looks through folders and hands
/// bytes to the system. Locked memory commits it whole.
pub const DISK_STACK_BYTES: usize = if cfg!(debug_assertions) {
    256 << 10
} else {
    64 << 10
};
/// Ticks between two messages of the slow channels for people: 100 a second at 1 kHz, more than a
/// plot shows.
pub const SHOWN_EVERY: u64 = 10;
/// Time after which a recording's frame goes to the disk, ns: a kill costs no more than that. rerun
/// makes one piece of each frame and channel: shorter ones slow it down.
pub const FRAME_NS: u64 = 50_000_000;
/// Bytes after which a frame ends before that: three times those of [`FRAME_NS`] at 1 kHz, a little
/// fewer than those at 4 kHz. The encoder keeps a buffer of this size.
pub const MAX_FRAME_BYTES: u64 = 256 << 10;
/// Bytes of a part of a keyframe, which a run never holds as a whole: a frame each, that the
/// encoder's buffer has room for.
pub const KEYFRAME_PART_BYTES: usize = 128 << 10;
/// Bytes of a keyframe that wait for the disk before its next part is made.
pub const KEYFRAME_QUEUE_BYTES: usize = 1 << 20;
/// Time from the beginning of a keyframe up to which its parts wait for the disk, unless a quarter
/// of [`RECORDED_TICKS`] waits for the recorder; then they wait in the queue as all else does. Half
/// of what [`RECORDED_TICKS`] bridge at 4 kHz.
pub const KEYFRAME_TIMEOUT: Duration = Duration::from_millis(500);
/// Bytes that wait for the disk at the most before those that come on top, the files of a scene for
/// example: at 1 kHz those of about eight seconds of a run, at 4 kHz those of two.
pub const RECORDING_QUEUE_BYTES: usize = 16 << 20;
/// Pieces that wait for the disk at the most: several times those of eight seconds at any rate, one
/// each [`FRAME_NS`], and more where files are short.
pub const RECORDING_JOBS: usize = 1024;
/// Time between two tries of a disk that refused, ns.
pub const RECORDING_RETRY_NS: u64 = 2_000_000_000;
/// How long the end of a run waits for the disk.
pub const RECORDING_TIMEOUT: Duration = Duration::from_secs(5);
/// Time before a fault that is kept in a file of its own, ns.
pub const BLACK_BOX_NS: u64 = 10_000_000_000;

/// Processor time for which the costs of the counted work are measured before the first tick, ns.
pub const CALIBRATION_NS: u64 = 50_000_000;
/// Wall time after which the measurement ends all the same, ns: where nine other programs share the
/// core, it has had its processor time.
pub const CALIBRATION_WALL_NS: u64 = 500_000_000;
/// Wall time of a tick that is measured, at the most, as a part of its processor time: what is more
/// was another program's, or another machine's on the same processor.
pub const CALIBRATION_OWN: f64 = 1.1;
/// Ticks of touch whose times are summed up to one measurement.
pub const CALIBRATION_BLOCK: usize = 16;
/// Bytes that are read between two of them: more than the second cache of a core holds.
pub const CALIBRATION_OTHERS_BYTES: usize = 4 << 20;
