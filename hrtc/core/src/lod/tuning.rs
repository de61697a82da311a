//! Tuning constants of refinement. Times are in ticks of 1 ms unless the scene sets another rate.

/// Ticks for which a region stays wanted after its last prediction, so that a probe at a cell's
/// wall does not make it flicker: four rounds of the predictor.
pub const HYSTERESIS_TICKS: u64 = 40;
/// Regions that may be wanted at once.
pub const MAX_WANTED: usize = 512;
/// Splits, and collapses, a tick where nothing is urgent.
pub const MIN_OPERATIONS: u32 = 6;
/// Ticks within which a backlog of collapses is worked off.
pub const COLLAPSE_TICKS: u32 = 48;
/// Closure entries that change set for one work unit.
pub const CHANGES_PER_UNIT: u32 = 4;
/// Closure entries unloaded a tick at the most: several cells, or a part of a whole model.
pub const MAX_UNLOADS: u32 = 4096;
/// Closure entries gone through a tick, for each operation allowed.
pub const ENTRIES_PER_OPERATION: u32 = 24;
/// Regions that one search for a region to release looks at.
pub const RELEASE_WINDOW: usize = 64;
/// Regions released a tick at the most, where nothing waits for their room.
pub const RELEASES_PER_TICK: u32 = 4;
/// One in so many of a tick's closure entries is for splits behind others that wait.
pub const BEHIND_SHARE: u32 = 4;
/// Closure entries that cost as much as finding that a split has to wait.
pub const ENTRIES_PER_WAIT: u32 = 16;
/// Steps of geomorphing vertices that cost as much as a split or collapse.
pub const STEPS_PER_OPERATION: u32 = 2;
/// Share of a perception limit that geomorphs which finish in the tick of their start may use
/// together. Where another geomorph moves under the probe they may use none.
pub const IMMEDIATE_SHARE: f64 = 0.5;
