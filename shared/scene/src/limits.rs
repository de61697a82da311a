//! Limits of a scene's numbers, and the defaults of numbers that more than one place needs.

use std::f64::consts::FRAC_PI_2;
use std::ops::RangeInclusive;

/// Lengths, metres: from below an atom to above the Earth, so no square overflows or vanishes.
pub(crate) const LENGTH_M: Range = Range::Within(MIN_LENGTH_M, MAX_LENGTH_M);
/// Shortest length, metres.
const MIN_LENGTH_M: f64 = 1e-9;
/// Longest length and farthest coordinate, metres.
pub(crate) const MAX_LENGTH_M: f64 = 1e7;
/// Largest coefficient in its own unit (N/m, N s/m, kg, N, N/s, s): far above any device.
pub(crate) const MAX_COEFFICIENT: f64 = 1e9;
/// A coefficient above 0.
pub(crate) const POSITIVE: Range = Range::Positive(MAX_COEFFICIENT);
/// A coefficient or none.
pub(crate) const NOT_NEGATIVE: Range = Range::NotNegative(MAX_COEFFICIENT);
/// Soft start and end, seconds. Without a ramp a force begins and ends by a jump: at least more
/// than the 4 ms in which the default slew limit of 2000 N/s lets the default 8 N rise.
pub(crate) const RAMP_S: Range = Range::Within(0.01, 60.0);
/// Ticks a second.
pub(crate) const RATE_HZ: Range = Range::Within(100.0, MAX_RATE_HZ);
/// Most ticks a second.
pub(crate) const MAX_RATE_HZ: f64 = 10_000.0;
/// Speed of a scripted path, m/s.
pub(crate) const SPEED_M_PER_S: Range = Range::Within(1e-6, 1e3);
/// Longest sides of its object that a tour goes in a second at the most: the station refuses faster
/// ones.
pub const MAX_TOUR_SIDES_PER_S: f64 = 20.0;

/// Step of an encoder, metres; 0 for none. The smallest is far below that of any encoder, so that a
/// place divided by it stays finite.
pub(crate) const ENCODER_M: Range = Range::ZeroOrWithin(1e-12, MAX_LENGTH_M);
/// Step of an encoder of a rotation, radians; 0 for none. Four steps a turn at the least.
pub(crate) const ENCODER_RAD: Range = Range::ZeroOrWithin(1e-12, MAX_ENCODER_RAD);
/// Largest step of an encoder of a rotation, radians.
pub(crate) const MAX_ENCODER_RAD: f64 = FRAC_PI_2;

/// Importance of an object: the greatest is a hundred times the least.
pub(crate) const IMPORTANCE: Range = Range::Within(0.1, 10.0);

/// Default cache, bytes.
pub(crate) const DEFAULT_CACHE_BYTES: usize = 16 << 20;
/// Default radius of a sphere probe, metres.
pub(crate) const DEFAULT_RADIUS_M: f64 = 0.001;

/// Faces of a tool: fewer enclose no body, more take too long to move in a tick.
pub(crate) const TOOL_FACES: RangeInclusive<i64> = 12..=4096;
/// Default faces of a tool.
pub(crate) const DEFAULT_TOOL_FACES: i64 = 960;
/// Faces of a generated object.
pub(crate) const GENERATED_FACES: RangeInclusive<i64> = 64..=1 << 26;

/// Largest rotation of a driven object in a tick, radians: the shortest arc between two poses
/// must be the rotation that was meant.
pub(crate) const MAX_TICK_ROTATION_RAD: f64 = 0.5;
/// Fewest ticks in a period of a driven object: as many samples a wave as a vibration has.
pub(crate) const MIN_PERIOD_TICKS: f64 = 4.0;

/// Largest coefficient of friction: rubber has 1 to 2. With more, the pull along the surface
/// exceeds the push of the surface so much that a corner of two faces traps the proxy.
pub(crate) const MAX_FRICTION: f64 = 3.0;
/// Standard gravity, m/s².
pub(crate) const GRAVITY_M_PER_S2: f64 = 9.80665;
/// Largest number of points of a spring's path.
pub(crate) const MAX_PATH_POINTS: usize = 4096;
/// Steepest slope of a texture (45 degrees).
pub(crate) const MAX_TEXTURE_SLOPE: f64 = 1.0;
/// Bytes of a recording's files together: four minutes of a run, at the 2 MB/s of one probe.
pub(crate) const DEFAULT_KEEP_BYTES: u64 = 512 << 20;
/// Least bytes of a recording's files together: four files with the state of a small cache each.
pub(crate) const MIN_KEEP_BYTES: u64 = 1 << 20;

/// A least number as a sentence names it: by 0.1 % more, which no rounding to four digits takes
/// away, so that what is named is let in.
pub(crate) fn rounded_up(least: f64) -> f64 {
    1.001 * least
}

/// Allowed values of a number.
pub(crate) trait Limit<T> {
    /// The number itself, or a sentence that names the key and the allowed values.
    fn check(self, key: &str, number: T) -> Result<T, String>;
}

impl Limit<i64> for RangeInclusive<i64> {
    fn check(self, key: &str, number: i64) -> Result<i64, String> {
        if self.contains(&number) {
            return Ok(number);
        }
        let (low, high) = (self.start(), self.end());
        Err(format!(
            "{key} is {number}; write a whole number from {low} to {high}"
        ))
    }
}

/// Allowed values of a fractional number.
#[derive(Clone, Copy)]
pub(crate) enum Range {
    /// Above 0, at most this.
    Positive(f64),
    /// From 0 to this.
    NotNegative(f64),
    /// From the first to the second.
    Within(f64, f64),
    /// 0 for none, or from the first to the second.
    ZeroOrWithin(f64, f64),
}

/// A number as people write it: not with hundreds of digits.
fn shown(number: f64) -> String {
    if number == 0.0 || (1e-6..1e12).contains(&number.abs()) {
        format!("{number}")
    } else {
        format!("{number:e}")
    }
}

impl Limit<f64> for Range {
    fn check(self, key: &str, number: f64) -> Result<f64, String> {
        let (fits, wanted) = match self {
            Self::Positive(max) => (
                number > 0.0 && number <= max,
                format!("a number above 0, at most {}", shown(max)),
            ),
            Self::NotNegative(max) => (
                (0.0..=max).contains(&number),
                format!("a number from 0 to {}", shown(max)),
            ),
            Self::Within(min, max) => (
                (min..=max).contains(&number),
                format!("a number from {} to {}", shown(min), shown(max)),
            ),
            Self::ZeroOrWithin(min, max) => (
                number == 0.0 || (min..=max).contains(&number),
                format!(
                    "0 for none, or a number from {} to {}",
                    shown(min),
                    shown(max)
                ),
            ),
        };
        if fits {
            Ok(number)
        } else {
            Err(format!("{key} is {}; write {wanted}", shown(number)))
        }
    }
}
