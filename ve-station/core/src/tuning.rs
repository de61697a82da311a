//! Tuning constants of the station's core, a module a room: each with its unit and why it has its
//! value.

/// Tours over a model.
pub mod tour {
    /// The ball is moved at once by the way between two points, but by no more than this share of
    /// its radius: moved by the whole radius it could get through the surface.
    pub const MAX_MOVED_RADII: f64 = 0.75;
    /// Touches given up for damage of the file before the tour is refused.
    pub const MAX_DAMAGED: u32 = 1024;
    /// Steps of a search along a line before it counts as blocked.
    pub const MAX_LINE_STEPS: usize = 4000;
    /// Turns in a row before a slide gives up.
    pub const MAX_TURNS: u32 = 16;
    /// A contact that moves by more steps than this, and ...
    pub const JUMP_STEPS: f64 = 3.0;
    /// ... by more radii of the ball than this, went to another sheet. In a concave edge the ball
    /// touches both faces at once, up to two radii apart, however slowly it rolls. Below half a
    /// radius a step no contact moves so far without its normal turning over.
    pub const JUMP_RADII: f64 = 2.0;
    /// A contact less upright than this hangs over a rim: about 80 degrees.
    pub const OVERHANG_COSINE: f64 = 0.17;
    /// The normal turned over, when its cosine with an earlier one is below this ...
    pub const TURNED_OVER_COSINE: f64 = -0.2;
    /// ... and the centre moved less than so many radii since.
    pub const TURN_LENGTH_RADII: f64 = 2.2;
    /// Places looked at for the next touch before one far away is taken.
    pub const NEAR_TRIES: usize = 24;
    /// Faces drawn for the first touch, of which one is kept in proportion to its area.
    pub const AREA_DRAWS: usize = 64;
    /// Directions up that are tried from a contact: its normal, the hint, and some nearby.
    pub const MAX_DIRECTIONS: u32 = 8;
    /// Points of a tour that are kept: 8 MiB, eleven minutes. Of a longer one those handed out are
    /// forgotten.
    pub const MAX_KEPT_POINTS: usize = 1 << 17;
}

/// What sessions may ask for, and the steps of an answer.
pub mod service {
    use protocol::{CHUNK_SLOTS, CREDIT_CHUNKS};

    /// Questions of one session that may wait for an answer: a controller has as many open as
    /// chunks may be under way, so this is thirty-two times that. A flood looks through no more for
    /// each.
    pub const MAX_JOBS: usize = 32 * CREDIT_CHUNKS as usize;
    /// Regions that a session may hold: many times what the region table of a controller has room
    /// for.
    pub const MAX_HELD: usize = 1 << 16;
    /// Incarnations of a client that are known to be replaced: more than restart while a station
    /// stands still, whose queues hold the requests of all of them.
    pub const MAX_FORMER: usize = 8;
    /// Reports of contacts that wait to be measured; more replace the oldest.
    pub const MAX_CONTACTS: usize = 64;
    /// Measured errors that fit into a chunk, and that wait for credit at the most; more replace
    /// the oldest.
    pub const MAX_MEASURED: usize = 2 * CHUNK_SLOTS;
    /// So many measured errors are sent at once ...
    pub const MEASURED_BATCH: usize = 16;
    /// ... or whatever has waited for such a time, microseconds.
    pub const MEASURED_US: u32 = 50_000;
    /// Where a session may have fewer chunks than this under way they wait until a chunk is full,
    /// or are those of so many microseconds. A quarter of those of a local link: four objects there
    /// share them without that. Five compact chunks of them a second are 5 % of a line of 0.25
    /// Mbit/s.
    pub const MEASURED_CREDIT: u64 = CREDIT_CHUNKS / 4;
    pub const MAX_MEASURED_US: u32 = 4 * MEASURED_US;
    /// Where a session may have fewer chunks than this under way, one in so many of them at the
    /// most is of a tour. Half of those of a local link: two objects there share them without that.
    /// A third is more than the quarter of which a controller tells the credit again.
    pub const MANY_CREDIT: u64 = CREDIT_CHUNKS / 2;
    pub const TOUR_SHARE: u64 = 3;
    /// Chunks of a tour that may always be under way: one on the line while the credit for the
    /// other comes back. At 0.25 Mbit/s and 100 ms they fill 85 % of the line, of 80 ms each.
    pub const MIN_TOUR_CREDIT: u64 = 2;
    /// Boxes and leaves that a contact may be searched in. (A contact lies within the certified
    /// error of the mesh, where a search looks at a few dozen; from the middle of a sphere it would
    /// look at all.)
    pub const MAX_VISITS: u32 = 4096;
    /// Of them, so many are a step.
    pub const VISITS_A_STEP: u32 = 64;
    /// VSPs without a record that one chunk passes over, in a tenth of a millisecond.
    pub const MAX_PASSED: usize = 1 << 16;
    /// VSPs that a step of a search looks at, or takes over.
    pub const SEARCHED_A_STEP: u32 = 64;
    /// Sentences kept until the shell takes them, and refusals worded at the most.
    pub const MAX_NOTES: usize = 256;
    /// Values of a page: two to four KiB.
    pub const PAGE: usize = 512;
}
