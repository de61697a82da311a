//! Tuning constants of the station's shell: waiting times, sizes, samples.

/// The viewer of `serve --view`.
pub mod viewer {
    use std::time::Duration;

    /// Time that it has to end by itself when the service does.
    pub const ENDS: Duration = Duration::from_secs(2);
}

/// The topics of the station.
pub mod link {
    use protocol::{ANSWER_TIMEOUT_MS, HELLO_PERIOD_MS};
    use std::time::Duration;

    /// Time between two looks at the ports.
    pub const POLL: Duration = Duration::from_micros(200);
    /// Time between two heartbeats.
    pub const HELLO: Duration = Duration::from_millis(HELLO_PERIOD_MS);
    /// Time between two heartbeats while controllers without a session are heard: as often as
    /// those look for a station.
    pub const ANSWERED_HELLO: Duration = Duration::from_millis(10);
    /// Steps of a client's turn between two looks at the ports: tenths of a millisecond, unless
    /// they read a slow disk.
    pub const STEPS_A_TURN: u64 = 8;
    /// Chunks of files that a client gets between two looks at the ports: 80 MB/s.
    pub const FILE_CHUNKS_A_TURN: usize = 4;
    /// Time for which the topic of a client that asked for files stays open after the last of them.
    pub const FILES_ASKED: Duration = Duration::from_secs(10);
    /// Time after which a session that is being worked for is told something, microseconds: a part
    /// of what its client would wait.
    pub const TOLD_US: u32 = 1000 * ANSWER_TIMEOUT_MS as u32 / 4;
    /// Time between two clean-ups of dead nodes.
    pub const CLEANUP: Duration = Duration::from_secs(1);
    /// A client silent for so long, and for what its link adds, gives up its place where another
    /// waits for one: ten heartbeats.
    pub const MAKE_ROOM: Duration = Duration::from_millis(10 * HELLO_PERIOD_MS);
    /// A client silent for so long, and for what its link adds, is forgotten, and its topic closed.
    pub const FORGET: Duration = Duration::from_secs(10);
    /// Round trips that the link of a client adds to a silence: what is lost comes again after one
    /// and 200 ms, or after two more and 400 ms where that is lost too, and half a one later.
    pub const ROUND_TRIPS_OF_SILENCE: u32 = 4;
    /// Time between two statuses.
    pub const STATUS: Duration = Duration::from_secs(1);
    /// Time between two of them where they stay on the screen, unless the clients change.
    pub const STATUS_KEPT: Duration = Duration::from_secs(60);
    /// Time for which the topic of a client that was turned away stays open: it is repeated
    /// meanwhile.
    pub const TURNED_AWAY: Duration = Duration::from_secs(2);
    /// Time after which a topic of records that could not be opened is tried again: what made it
    /// fail may be over, as where another process was removing it.
    pub const REOPEN: Duration = Duration::from_millis(ANSWER_TIMEOUT_MS);
    /// Sentences about peers at the most: a noisy domain must not fill memory.
    pub const MAX_SAID: usize = 64;
    /// Time for which the end of the service waits until who tells has ended, and the viewer.
    pub const TOLD_ENDS: Duration = Duration::from_secs(3);
}

/// Opening and building models.
pub mod models {
    use std::time::Duration;

    /// Time between two looks for a request to stop while models are built.
    pub const STOP_POLL: Duration = Duration::from_millis(20);
    /// Time after which it is said that models are built, where no bar shows it.
    pub const TOLD_AFTER: Duration = Duration::from_secs(5);
    /// Stack of the thread that builds models, bytes: what a main thread usually has.
    pub const BUILD_STACK_BYTES: usize = 8 << 20;
    /// The largest file that is read into memory: 1 GiB, a model of twelve million faces.
    pub const MAX_READ_BYTES: u64 = 1 << 30;
    /// Characters of a mesh file's name that stand in that of its model: at four bytes each, and
    /// with 40 for the rest, they fit the 255 of a file's name.
    pub const NAME_CHARS: usize = 32;
}

/// `ve-station inspect`.
pub mod inspect {
    /// Mesh operations a tick in the figure for the greatest speed: K of the loop's default.
    pub const OPERATIONS_A_TICK: f64 = 96.0;
    /// Period of the tick in that figure, seconds.
    pub const PERIOD_S: f64 = 1e-3;
    /// Radius of the probe in that figure, metres.
    pub const PROBE_RADIUS_M: f64 = 1e-3;
    /// Radii of the probe that are refined around it at rest, and time of motion by which that is
    /// wider on either side, seconds: those of the controller.
    pub const RADII_AROUND: f64 = 1.5;
    pub const LEAD_S: f64 = 2e-3;
    /// Certified errors of the table, shares of the diagonal.
    pub const ERROR_SHARES: [f64; 6] = [0.1, 0.05, 0.02, 0.01, 0.005, 0.002];
    /// Faces whose areas are added up at the most: beyond, the answer is an estimate to about 0.3
    /// %, for a few milliseconds instead of seconds.
    pub const MAX_AREAS: u32 = 1 << 17;
    /// Regions of a level whose closures are counted, at the most.
    pub const SAMPLED_REGIONS: usize = 256;
    /// Cells along each side of the box, as in the thesis's example.
    pub const DIVISIONS: usize = 8;
}
