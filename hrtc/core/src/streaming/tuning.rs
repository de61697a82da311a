//! Tuning constants of the session. Times are in ticks of 1 ms unless the scene sets another rate.

/// Work units for received data a tick while few chunks wait: a record or base item is 4, sixteen
/// ids of a closure are 8, the head of a part 1.
pub const MIN_INGEST: u32 = 80;
/// Chunks that may wait at [`MIN_INGEST`]; for more the units grow in proportion, so that a burst
/// takes few ticks.
pub const WAITING_CHUNKS: usize = 2;
/// Work units of an item.
pub const UNITS_PER_ITEM: u32 = 4;
/// Work units for each split that a tick may do: a few more records than splits.
pub const INGEST_PER_OPERATION: u32 = 6;
/// Ids of a closure that are taken in one go.
pub const IDS_AT_ONCE: usize = 16;
/// Ticks for which a record may wait for room before its region is given up.
pub const MAX_WAIT_TICKS: u32 = 50;
/// The credit is told without another reason when this share of it is consumed: one in so many.
pub const CREDIT_STEP: u64 = 4;

/// The most work units for received data a tick.
#[must_use]
pub fn max_ingest(operations: usize) -> u32 {
    (INGEST_PER_OPERATION * operations as u32).max(MIN_INGEST)
}

/// The work units for received data in a tick with so many chunks that wait.
#[must_use]
pub fn ingest_for(waiting: usize, operations: usize) -> u32 {
    let waiting = waiting.div_ceil(WAITING_CHUNKS) as u32;
    (MIN_INGEST * waiting).clamp(MIN_INGEST, max_ingest(operations))
}
