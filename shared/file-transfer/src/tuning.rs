//! Sizes and times of the transfer.

use protocol::{ANSWER_TIMEOUT_MS, CREDIT_CHUNKS};
use std::time::Duration;

/// Chunks of a file that are under way to a client at the most: the credit window, half of a
/// subscriber's queue.
pub const MAX_OUTSTANDING: u64 = CREDIT_CHUNKS;
/// Chunks of a question at the most: a quarter of the window, so that the link is busy while the
/// next question is under way.
pub const CHUNKS_A_QUESTION: u64 = MAX_OUTSTANDING / 4;
/// Questions of a client that wait at the station; one more replaces the oldest. All that a window
/// holds, and as many that were asked again.
pub const MAX_QUESTIONS: usize = 2 * (MAX_OUTSTANDING / CHUNKS_A_QUESTION) as usize;
/// Silence after which what is under way counts as lost, before a round trip was measured.
pub const FIRST_TIMEOUT: Duration = Duration::from_secs(1);
/// The least such silence: a station that is busy needs it.
pub const MIN_TIMEOUT: Duration = Duration::from_millis(ANSWER_TIMEOUT_MS);
/// The longest, after silences in a row that double it.
pub const MAX_TIMEOUT: Duration = Duration::from_secs(4);
/// Share of a new round trip in the smoothed one, and of its deviation in the mean deviation
/// (RFC 6298: 1/8 and 1/4).
pub const ROUND_TRIP_SHARE: f64 = 1.0 / 8.0;
/// See [`ROUND_TRIP_SHARE`].
pub const VARIATION_SHARE: f64 = 1.0 / 4.0;
/// Mean deviations beyond the smoothed round trip in the timeout (RFC 6298).
pub const VARIATIONS: f64 = 4.0;
/// Times that a whole file whose hash is wrong is asked for.
pub const MAX_DAMAGED: u32 = 3;
