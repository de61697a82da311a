//! Remaining work of a tick, in units; all active objects draw on it in turn.

/// Remaining work of a tick.
#[derive(Debug, Clone, Copy)]
pub struct Budget {
    /// Work units for received data.
    pub ingest: u32,
    /// Splits and collapses.
    pub operations: u32,
    /// Closure entries to go through for refinement.
    pub entries: u32,
    /// Entries of closures, region tables and caches to go through for what is not needed any more
    /// or is here already.
    pub upkeep: u32,
}
