//! Tuning constants of the core, a module a room. Times are in seconds, whatever the rate of the
//! scene; [`crate::horizons`] converts them once. What it calls work of a tick is that of a tick of
//! a millisecond; another one may do as much in proportion to its period ([`crate::work`]). Counts
//! of samples, and of what is looked at in a tick beside that work, are counts at every rate.
//! Numbers that belong to one algorithm, such as the rounding bound of a test, stand beside it; the
//! just noticeable differences are in [`crate::perception`].

/// The tick as a whole: reports and the budget of the proxies.
pub mod tick {
    /// Time between two contact reports of a probe to the station.
    pub const REPORT_S: f64 = 0.01;
    /// The same to a station on another machine: each is a packet of its own there, and the
    /// measured error and the view need no more.
    pub const FAR_REPORT_S: f64 = 0.1;
    /// Nodes visited and faces tested by the steps of all proxies in a tick that has time for them:
    /// those of a ball take half of a millisecond on the reference machine.
    pub const PROXY_WORK: u32 = 12_288;
    /// The same for the searches beside the steps: the nearest face of each pair, force shading,
    /// and where a probe may touch next. A search near a known face takes some tens.
    pub const SEARCH_WORK: u32 = 1024;
}

/// How much work a tick may do: see [`crate::governor`].
pub mod governor {
    /// Share of a period that a tick may spend by its costs. A twentieth is for the wake-up
    /// (`realtime::pacer`); the rest is for what costs do not tell, such as a cold cache: 99 of 100
    /// ticks of a tool take up to 1.4 times what they should (fit of its counts, dragon and bunny).
    pub const TIME_SHARE: f64 = 0.7;
    /// Where that falls to at the least. On a machine that is slowed down eight times
    /// (`rt-tests deadline --slow 8 --only dragon-tool`) a tool came to the dragon in every run
    /// with half of the period, with a third in half of them.
    pub const MIN_TIME_SHARE: f64 = 0.5;
    /// Share of a period that a tick takes where it is late: what is left is for the wake-up and
    /// for what is begun when the time is over.
    pub const LATE: f64 = 0.8;
    /// Part of the share that a late tick takes off, and the time in which two thirds of it come
    /// back: with one late tick a second, a thousandth of them, the share is at its middle.
    pub const LATE_CUT: f64 = 0.05;
    pub const SHARE_RETURN_S: f64 = 4.0;
    /// Shares of a period, counted from where it was planned to begin, after which no split,
    /// collapse, step of a geomorph or record, and no step or search of a proxy, begins any more:
    /// where a tick takes longer than its work should. Where reading the devices takes a part of
    /// the period they are later ([`crate::Timed::last_begin_after`]). What was begun ends, and
    /// limits, forces and their sending come after it. On a machine that is slowed down eight
    /// times (`rt-tests run --slow 8`, dragon with a tool, three alternations) steps until 0.4 and
    /// 0.5 miss no fewer periods.
    pub const LAST_REFINEMENT: f64 = 0.5;
    pub const LAST_STEP: f64 = 0.6;
    /// Time in which what the devices' drivers took falls to a third: some periods of a device of
    /// 100 Hz.
    pub const DRIVERS_FADE_S: f64 = 0.1;
    /// Weight of what is believed of the machine, in shares of what a tick may spend.
    pub const SHORT_SHARE: f64 = 0.25;
    /// Time in which what is believed falls to a third where the machine is fast again.
    pub const SLOWNESS_FADES_S: f64 = 0.3;
    /// Slownesses that are believed. At the least one a tick may spend seven eighths of its period;
    /// where a group's cost is wrong by a seventh, a tick of that work alone still ends in it.
    pub const SLOWNESS_RANGE: [f64; 2] = [0.8, 64.0];
    /// Part that contacts may keep of what is left of a tick beside what every tick does.
    pub const CONTACT_SHARE: f64 = 0.8;
    /// Time in which what is kept for contacts falls to a third: a stroke over a rough place.
    pub const CONTACT_FADES_S: f64 = 0.1;
    /// Time of ticks in which a contact is cut short after which less is asked for, where each
    /// other tick takes a tenth of one off: a rough place is passed over, a surface that is too
    /// fine is not. And how many ticks that are at the least: one alone may have been interrupted.
    pub const CUT_S: f64 = 0.003;
    pub const MIN_CUT: f64 = 2.0;
    pub const CUT_FADES: f64 = 0.1;
    /// The time of a tick over the most that one had in which a contact was cut, above which the
    /// machine is faster again. As wide as the dead zone of the operations.
    pub const MORE_TIME: f64 = 1.25;
    /// Time in which the operations that there is time for again come back by two thirds.
    pub const OPERATIONS_RETURN_S: f64 = 0.3;
    /// Faces whose change costs as much as an operation beside that of its faces.
    pub const OPERATION_FACES: u32 = 8;
    /// Closure entries that cost as much as a face.
    pub const ENTRIES_PER_FACE: u32 = 20;
    /// Units that half of the ticks of a touch take at most: a ball on the relief of 100 000 faces
    /// (`rt-tests accuracy`; 90 units when searches counted as many, here by what they cost), and
    /// the steps of a tool of 960 faces on a dragon (`rt-tests tools`).
    pub const USUAL_BALL_UNITS: f64 = 64.0;
    pub const USUAL_TOOL_UNITS: f64 = 200.0;
    /// Units that refinement leaves to each pair of a probe and an object. With as many of a ball,
    /// and with two thirds, it came along over coarse faces, with a third not; a tool takes more
    /// ticks. A proxy is sure of them where the time of the tick is over, too.
    pub const MIN_BALL_UNITS: f64 = 2.0 * USUAL_BALL_UNITS;
    pub const MIN_TOOL_UNITS: f64 = 0.25 * USUAL_TOOL_UNITS;
    /// Units that a pair keeps of these for the nearest face: the last one known and its
    /// neighbourhood.
    pub const MIN_SEARCH_UNITS: u32 = 8;
    /// Faces that a split or collapse changes on most meshes.
    pub const TYPICAL_FACES: u32 = 10;
    /// Faces that an operation may always change: there is time for one collapse in any tick.
    pub const LARGE_FACES: u32 = 2 * TYPICAL_FACES;
    /// Units of received data that a split needs: its record.
    pub const UNITS_PER_OPERATION: f64 = super::streaming::UNITS_PER_ITEM as f64;
    /// Part of a tick's time for refinement that received data may take, beside a question.
    pub const RECEIVED_SHARE: f64 = 0.5;
    /// Part that closure entries may take, and that what is not needed any more may.
    pub const ENTRIES_SHARE: f64 = 0.25;
    pub const UPKEEP_SHARE: f64 = 0.125;
}

/// The reactive policy ([`crate::policy::reactive`]), from thesis 4.1.2.
pub mod policy {
    /// Time of a frame: of a picture in an animation.
    pub const FRAME_S: f64 = 1.0 / 30.0;
    /// Steps from the base mesh to all splits: ALOD is one of them.
    pub const STEPS: f64 = 50.0;
    /// t: how much of its time a frame leaves where nothing changes.
    pub const DEAD_ZONE: f64 = 0.1;
}

/// Which objects are active.
pub mod active {
    /// Reach of a probe at rest, in its radii.
    pub const REACH_RADII: f64 = 10.0;
    /// Time of its motion by which the reach is longer: the base mesh arrives within a few
    /// milliseconds, the regions ahead of the contact within sixty.
    pub const REACH_S: f64 = 0.15;
    /// Time out of reach after which an object may lose its place, and a pair ends.
    pub const SLEEP_S: f64 = 0.1;
    /// An object takes the place of another in reach when it is nearer by this factor, so that two
    /// do not alternate.
    pub const NEARER: f64 = 2.0;
    /// Time of motion within which a probe could touch.
    pub const TOUCH_S: f64 = 0.002;
    /// Objects that are entered into the broad phase, or looked at for that, a tick at the most;
    /// and models that are looked at for one to be asked for.
    pub const PLACED_A_TICK: usize = 64;
}

/// The session with the station.
pub mod streaming {
    /// Work units for received data a tick while few chunks wait: a record or base item is 4,
    /// sixteen ids of a closure are 8, the head of a part 1.
    pub const MIN_INGEST: u32 = 80;
    /// Chunks that may wait at [`MIN_INGEST`]; for more the units grow in proportion, so that a
    /// burst takes few ticks.
    pub const WAITING_CHUNKS: usize = 2;
    /// Work units of an item.
    pub const UNITS_PER_ITEM: u32 = 4;
    /// Work units for each split that a tick may do: a few more records than splits.
    pub const INGEST_PER_OPERATION: u32 = 6;
    /// Ids of a closure that are taken in one go.
    pub const IDS_AT_ONCE: usize = 16;
    /// Time for which a record may wait for room before its region is given up.
    pub const MAX_ROOM_WAIT_S: f64 = 0.05;
    /// The credit is told without another reason when this share of it is consumed: one in so many.
    pub const CREDIT_STEP: u64 = 4;

    /// Share of a new round trip in the smoothed one, and of its deviation in the mean deviation
    /// (RFC 6298, 2.3).
    pub const ROUND_TRIP_SHARE: f64 = 1.0 / 8.0;
    pub const VARIATION_SHARE: f64 = 1.0 / 4.0;
    /// Mean deviations by which a timeout is longer than the round trip (RFC 6298, 2.3).
    pub const VARIATIONS: f64 = 4.0;
    /// Time of skipped periods in a row that counts as waited for an answer at the most: those of a
    /// machine that is too slow. In a longer stall nothing could be taken in, and the station may
    /// have stood still, too.
    pub const MAX_WAITED_S: f64 = 0.02;
    /// Silences for which a timeout is doubled at the most: from 200 ms to 1.6 s.
    pub const MAX_SILENCES: u32 = 3;
    /// The shortest round trip is that of the present and the last span of so many seconds.
    pub const MIN_SPAN_S: f64 = 5.0;
    /// Share of a new measurement in the rate.
    pub const RATE_SHARE: f64 = 1.0 / 16.0;
    /// Share of a chunk in the mean time that chunks wait on the link.
    pub const WAIT_SHARE: f64 = 1.0 / 4.0;
    /// Regions over which it is measured how many chunks a region takes.
    pub const REGIONS_KEPT: f64 = 64.0;
    /// Time for which what is under way may wait on the link beside two round trips.
    pub const QUEUE_S: f64 = 0.02;
    /// Chunks that may always be under way: one on the link while another is taken in.
    pub const MIN_WINDOW: u64 = 2;
    /// Silence after which what was asked of a station on another machine counts as lost at the
    /// least: half as long again as TCP waits before it repeats the last packet of an answer
    /// (`TCP_RTO_MIN` of Linux, 0.2 s).
    pub const FAR_TIMEOUT_S: f64 = 0.3;
    /// Chunks that may be under way at first from a station on another machine: what TCP sends at
    /// once, 10 segments of 1460 bytes (RFC 6928, 2), in chunks of 1.8 kB.
    pub const FIRST_WINDOW: u64 = 8;
    /// Silence after which the first question to a station on another machine counts as lost,
    /// before a round trip was measured, seconds (RFC 6298, 2.1).
    pub const FIRST_TIMEOUT_S: f64 = 1.0;
    /// Regions that may be outstanding, in what the link carries in two round trips.
    pub const QUEUED: f64 = 2.0;
    /// Of these, in the same measure, the ones that the station may be answering already.
    pub const IN_TRANSIT: f64 = 1.5;
    /// Answers of no use, with others outstanding in their place, from which on nothing is loaded
    /// ahead. Single ones come and go; many load the link with every record of their regions, and
    /// the answers that come later for it lose what they count on, too (measured at 220 ms: 373
    /// such answers, the contact full for 53 % of a tour; with this limit 25 and 94 %).
    pub const LOST_AT_ONCE: usize = 4;
    /// Share of the rate that requests may take.
    pub const REQUEST_SHARE: f64 = 0.25;
    /// Round trip and transfer that the prediction's own times include: the nearest of
    /// [`super::prediction::LOAD_AHEAD_S`].
    pub const INCLUDED_S: f64 = 0.03;
    /// Longest time by which prediction leads beyond that: a hand's course is not known for longer.
    pub const MAX_LEAD_S: f64 = 0.3;

    /// Work units that must remain to take a slot.
    pub const MIN_UNITS: u32 = 4 * UNITS_PER_ITEM;

    /// Requests of a session in a tick at the most.
    pub const REQUESTS_PER_TICK: usize = 4;
}

/// The cache.
pub mod cache {
    /// Time for which a refused region is not requested again.
    pub const REFUSED_S: f64 = 2.0;
    /// Places of the table that a tick searches for one whose refusal is that old.
    pub const REFUSED_WINDOW: usize = 4;
}

/// Refinement.
pub mod lod {
    /// Time for which a region stays wanted after its last prediction, so that a probe at a cell's
    /// wall does not make it flicker: four rounds of the predictor at 1 kHz.
    pub const HYSTERESIS_S: f64 = 0.04;
    /// Regions that may be wanted at once.
    pub const MAX_WANTED: usize = 512;
    /// Splits, and collapses, a tick where nothing is urgent.
    pub const MIN_OPERATIONS: u32 = 6;
    /// Time within which a backlog of collapses is worked off.
    pub const COLLAPSE_S: f64 = 0.048;
    /// Closure entries that change set for one work unit.
    pub const CHANGES_PER_UNIT: u32 = 4;
    /// Entries of closures, region tables and caches that a tick goes through at the most to
    /// unload, forget or pass over them: several cells, or a part of a whole model.
    pub const MAX_UPKEEP: u32 = 4096;
    /// Of these at the most for places that have changed hands, so that rooms in use get theirs.
    pub const MAX_FORGOTTEN: u32 = MAX_UPKEEP / 2;
    /// Such entries that a tick may go through on any machine: an eviction, and as much for places
    /// that have changed hands. With none an epoch that has ended would never be settled.
    pub const MIN_UPKEEP: u32 = 2 * ENTRIES_PER_EVICTION;
    /// Closure entries gone through a tick, for each operation allowed.
    pub const ENTRIES_PER_OPERATION: u32 = 24;
    /// Entries for upkeep that cost as much as the eviction of a record: its references and those
    /// of five others, and its id.
    pub const ENTRIES_PER_EVICTION: u32 = 64;
    /// Regions that one search for a region to release looks at.
    pub const RELEASE_WINDOW: usize = 64;
    /// Regions released a tick at the most, where nothing waits for their room.
    pub const RELEASES_PER_TICK: u32 = 4;
    /// One in so many of a tick's closure entries is for splits behind others that wait.
    pub const BEHIND_SHARE: u32 = 4;
    /// Closure entries that cost as much as finding that a split has to wait.
    pub const ENTRIES_PER_WAIT: u32 = 16;
    /// Faces around a split that has to wait that cost as much as one that a split changes: they
    /// are only gone around.
    pub const FACES_PER_WAIT: u32 = 4;
    /// Steps of geomorphing vertices that cost as much as a split or collapse.
    pub const STEPS_PER_OPERATION: u32 = 2;
    /// Share of a perception limit that geomorphs which finish in the tick of their start may use
    /// together. Where another geomorph moves under the probe they may use none.
    pub const IMMEDIATE_SHARE: f64 = 0.5;
}

/// Prediction of the regions that a probe will need.
pub mod prediction {
    /// Received chunks that wait for the tick, above which nothing is requested ahead of need.
    pub const MAX_WAITING: usize = 8;
    /// Time of motion, times [`RADII_AROUND`], within which a surface must be for a prediction to
    /// be moved onto it.
    pub const LANDING_S: f64 = 0.06;
    /// Share of a block of splits that is still asked for after each step of memory pressure.
    pub const BLOCK_SHARE: f64 = 0.75;

    /// Regions that may be kept to be requested in a tick, for each probe: the cells of six balls.
    pub const MAX_UNKNOWN: usize = 750;

    /// Times over which velocity and acceleration are estimated: an encoder's step is averaged, a
    /// turn is not. A hand that moves less than the probe's radius over the longer span is slow
    /// enough for that one, and there a single step of the encoder must not look like a motion.
    pub const SPANS_S: [f64; 2] = [0.004, 0.016];
    /// Time over which a hand's acceleration fades: what of it is left after it is a third. On a
    /// tour of a rough terrain at 1 m/s the point 25 ms ahead is then missed by 6 mm at median; by
    /// 10 mm straight on over the same span, by 13 mm over 16 ms.
    pub const FADING_S: f64 = 0.018;
    /// Time over which the speed is averaged that the lod goes by.
    pub const MEAN_S: f64 = 0.032;
    /// Time after which the largest speed counts a third: a hand that turns or begins to slide is
    /// soon as fast as it was.
    pub const RECENT_S: f64 = 1.0;
    /// Time that it takes to have a loaded cell refined.
    pub const REFINE_AROUND_S: f64 = 0.012;
    /// Time ahead at which the refined set looks.
    pub const REFINE_AHEAD_S: f64 = 0.02;
    /// Radii of the probe around its centre that are refined at rest.
    pub const RADII_AROUND: f64 = 1.5;
    /// Time of motion by which the refined strip is wider on either side.
    pub const LEAD_S: f64 = 0.002;
    /// Times ahead at which the loaded set looks: a round trip, the records and their splits.
    pub const LOAD_AHEAD_S: [f64; 3] = [0.03, 0.045, 0.06];
    /// Share of the lead over a far link with which the middle one of them looks ahead: what the
    /// farther ones missed in a turn of the hand still comes before it is touched.
    pub const HALFWAY: f64 = 0.5;
    /// Times ahead at which the coarser rings are refined, and loaded: they are what a turn of the
    /// hand lands on.
    pub const RING_AHEAD_S: [f64; 2] = [0.025, 0.06];
    /// Sideways error of a predicted point, as a share of its displacement, and as a share of what
    /// the present acceleration adds to it.
    pub const SPREAD: [f64; 2] = [0.05, 0.7];
    /// Time over a cell below which fewer neighbours are kept warm: they are gone before they
    /// could be used.
    pub const WARM_S: f64 = 0.05;
    /// Time after which a region away from the motion is thought to be reached at rest, for each
    /// cell of distance.
    pub const DRIFT_S: f64 = 0.2;
    /// Share of the speed with which the hand may come to a cell that does not lie ahead.
    pub const SIDEWAYS: f64 = 0.25;

    /// Parts that are looked at in a tick: so each comes again sooner than a region that was
    /// predicted once is let go of.
    pub const A_TICK: usize = 2;
}

/// Steps by which less is asked for while the cache is too small.
pub mod memory_pressure {
    /// Time for which a step may take effect before the next.
    pub const SETTLE_S: f64 = 0.06;
    /// Time without want before the first step back, and the longest wait.
    pub const WAIT_S: f64 = 1.0;
    pub const MAX_WAIT_S: f64 = 16.0;
    /// Time after a step back within which a want means that it was too early.
    pub const EARLY_S: f64 = 2.0;
    /// Steps before the finest ring is raised: no loading ahead, no coarser rings.
    pub const STEPS_BEFORE_COARSER: u32 = 2;
    /// What contacts may lose for want of room at the most, as time at the error of the next ring;
    /// with half of it the finest ring is raised.
    pub const MISSES_S: f64 = 0.256;
    /// Time without any question after the cache was found full.
    pub const PAUSE_S: f64 = 0.02;
}

/// Probes, and the work of their proxies.
pub mod probe {
    /// Time without an accepted sample after which the force ramps down, seconds.
    pub const MAX_SILENCE_S: f64 = 0.02;
    /// Time after which a refused tour is requested again, seconds.
    pub const TOUR_RETRY_S: f64 = 2.0;
    /// Share of the greatest speed that is left after a millisecond: a hand that stops may go on.
    pub const SPEED_LEFT_PER_MS: f64 = 0.97;
    /// Time for which samples elsewhere must be plausible after one another for a new place to be
    /// true, seconds, and their number at the least.
    pub const NEW_PLACE_S: f64 = 0.02;
    pub const MIN_NEW_PLACE_SAMPLES: u32 = 3;
    /// Time without an accepted sample by which the limits of motion widen at the most, where no
    /// period was skipped: in it a hand of [`haptic_device::MotionLimits::HAND`] may leave its
    /// course by 72 mm.
    pub const MAX_WIDENED_S: f64 = 0.008;
    /// Samples for which a speed must be kept up to count: one wild sample, there and back, is no
    /// motion.
    pub const KEPT_UP: usize = 3;

    /// Pairs of nodes of a tool and an object, or what costs as much, that a unit of work pays for:
    /// with all units of a tick it stays within a period of a millisecond (measured).
    pub const PAIRS_A_UNIT: u32 = 12;
    /// Work of a ball (nodes and faces), and of a tool (pairs of nodes), after which the time of
    /// the tick is asked about: a few microseconds on the reference machine, a hundred times what
    /// asking takes.
    pub const BALL_INTERVAL: u32 = 40;
    pub const TOOL_INTERVAL: u32 = 160;
}

/// The forces. The perception limits are in [`crate::perception`].
pub mod force {
    /// Longest window of the velocity estimate, seconds; and periods, which bound its cost: above
    /// 4 kHz the window is shorter.
    pub const VELOCITY_WINDOW_S: f64 = 0.016;
    pub const MAX_VELOCITY_PERIODS: usize = 64;

    /// Relative rounding error of the difference of two equal motions: 8 units in the last place.
    pub const MOTION_ROUNDING: f64 = 8.0 * f64::EPSILON;

    /// Time in which the excess energy of a contact that is over falls to a third, seconds. That is
    /// longer than a period of a buzz (above 30 Hz) and shorter than a lift.
    pub const EXCESS_FADES_S: f64 = 0.03;

    /// Time in which the unpaid part of a coupling falls to a third, seconds: it returns by 0.5 %
    /// of the force a millisecond, far below what is felt (7 %), and in a bounce (10 ms) by a
    /// twentieth.
    pub const UNPAID_RETURNS_S: f64 = 0.2;

    /// A force that is paid for in part returns to this times the part, while the device stays in
    /// a surface. A force of r times the part that is paid for leaves 1/r of that part when the
    /// device gives way: two thirds. With half as much again a force that is paid for to two thirds
    /// returns whole.
    pub const RETURNS_TO: f64 = 1.5;

    /// Imperceptible forces by which an unpaid force returns beyond what is paid for, while the
    /// device stays in a surface. A hand of 100 to 1000 N/m that rests there gives way to them, and
    /// they fade as it does, by 0.06 N in a tick at the most; from six on they are cut, by 0.3 N
    /// and more (model of the account at 1 and 4 kHz). With one, a hand that slides on waits twice
    /// as long for its force.
    pub const RETURNS_BEYOND: f64 = 3.0;

    /// Time in which a hand gives way to a surface that rises, seconds: twice a period of a hand of
    /// 200 N/m that holds a device of 0.1 kg (7 Hz, damped).
    pub const RAISED_FADES_S: f64 = 0.3;

    /// Most faces in the mean normals of force shading, of all contacts of a probe together: the
    /// nearest.
    pub const MAX_SHADING_FACES: usize = 256;

    /// Nodes and faces that a search of force shading visits at the most for each face that there
    /// is room for: four faces, and the nodes above them.
    pub const SHADING_VISITS: u32 = 8;
}

/// The bodies. None of these numbers changes a force by itself.
pub mod bodies {
    /// Most steps that make up for missed ticks. It bounds their work: after a longer stall a step
    /// is longer than a period.
    pub const MAX_STEP_PERIODS: u32 = 20;

    /// Steps of all bodies in a tick that makes up for missed ones, half of them under the load and
    /// half after it: one each where [`scene::MAX_MOVABLES`] are awake, a tenth of a millisecond by
    /// [`crate::governor::WorkCosts::body`]. What hands push has [`MAX_STEP_PERIODS`] beside them.
    pub const STEPS_A_TICK: usize = 2 * scene::MAX_MOVABLES;

    /// Most objects whose box is requested in one tick: half of [`scene::MAX_MOVABLES`].
    pub const MAX_EXTENTS_PER_TICK: usize = 64;

    /// Largest displacement of a body in one period, in longest sides of its box.
    pub const MAX_SIZES_PER_PERIOD: f64 = 0.1;

    /// Largest rotation of a body in one period, radians.
    pub const MAX_TURN_PER_PERIOD: f64 = 0.1;

    /// Largest speed of any point of the box of a still body, in longest sides of the box per
    /// second.
    pub const STILL_SIZES_PER_S: f64 = 1e-4;

    /// Time for which a body without load has to be still before it sleeps, seconds.
    pub const STILL_S: f64 = 0.5;

    /// Share of the displacement bound of a body that is left after a millisecond: half of it after
    /// 23 ms. Probes use the same decay.
    pub const DISPLACEMENT_LEFT_PER_MS: f64 = 0.97;

    /// Shortest side that a box counts with, as a fraction of its longest. Without it a flat or
    /// thin model would have a moment of inertia of 0 about some axis.
    pub const MIN_SIDE_RATIO: f64 = 1e-2;

    /// Decay rate of the speed where the scene gives no damping, 1/s: `v(t) = v(0) exp(-2 t)`, a
    /// third after half a second.
    pub const DEFAULT_DECAY_PER_S: f64 = 2.0;
}
