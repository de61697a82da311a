//! Tuning constants of the forces. The perception limits are in [`crate::perception`].

/// Longest window of the velocity estimate, periods: 16 ms at 1 kHz.
pub const MAX_VELOCITY_PERIODS: usize = 16;

/// Relative rounding error of the difference of two equal motions: 8 units in the last place.
pub const MOTION_ROUNDING: f64 = 8.0 * f64::EPSILON;

/// Most faces in the mean normal of force shading. The search visits the nearer part of the tree
/// first.
pub const MAX_SHADING_FACES: usize = 256;

/// Most segments of its path that a spring passes in one tick.
pub const MAX_PATH_STEPS: usize = 16;
