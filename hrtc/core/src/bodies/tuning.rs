//! Tuning constants of the bodies. None of them changes a force by itself.

/// Most periods that one step integrates after missed ticks, 20 ms at 1 kHz. It bounds the time of
/// a step; the motion of further missed periods is dropped.
pub const MAX_STEP_PERIODS: u64 = 20;

/// Most objects whose box is requested in one tick: half of [`scene::MAX_MOVABLES`].
pub const MAX_EXTENTS_PER_TICK: usize = 64;

/// Largest displacement of a body in one period, in longest sides of its box.
pub const MAX_SIZES_PER_PERIOD: f64 = 0.1;

/// Largest rotation of a body in one period, radians.
pub const MAX_TURN_PER_PERIOD: f64 = 0.1;

/// Largest speed of any point of the box of a still body, in longest sides of the box per second.
pub const STILL_SIZES_PER_S: f64 = 1e-4;

/// Time for which a body without load has to be still before it sleeps, seconds.
pub const STILL_S: f64 = 0.5;

/// Decay of the displacement bound of a body, per tick: half of it is left after 23 ticks. Probes
/// use the same decay.
pub const DISPLACEMENT_DECAY: f64 = 0.97;

/// Shortest side that a box counts with, as a fraction of its longest. Without it a flat or thin
/// model would have a moment of inertia of 0 about some axis.
pub const MIN_SIDE_RATIO: f64 = 1e-2;

/// Decay rate of the speed where the scene gives no damping, 1/s: `v(t) = v(0) exp(-2 t)`, a third
/// after half a second.
pub const DEFAULT_DECAY_PER_S: f64 = 2.0;
