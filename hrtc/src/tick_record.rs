//! Record of one tick: plain numbers that the tick pushes into a ring for the log thread.

use crate::time_answers::TimeAnswers;
use geometry::Wrench;
use haptic_device::Sample;
use hrtc_core::ProbeContact;
use hrtc_core::governor::MeasuredTick;
use hrtc_core::record::{CoreRecord, max_or_nan};
use realtime::pacer::Miss;
use scene::MAX_PROBES;
use serde::{Deserialize, Serialize};

/// Stages of a tick, as indices of [`TickRecord::stage_ns`].
pub const STAGES: [&str; 6] = ["inbox", "refine", "refit", "query", "force", "broad_phase"];

/// Record of one tick: all its inputs but the chunks, all its outputs but requests and reports, and
/// its times.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TickRecord {
    /// Index of the tick; counts skipped periods too.
    pub tick: u64,
    /// Deadline of the sleep before it on CLOCK_MONOTONIC, ns; see [`Wake::planned_ns`].
    ///
    /// [`Wake::planned_ns`]: realtime::pacer::Wake::planned_ns
    pub planned_ns: u64,
    /// Start on CLOCK_MONOTONIC, ns.
    pub start_ns: u64,
    /// Periods skipped just before this tick.
    pub skipped: u32,
    /// Reasons of the skipped periods.
    pub misses: [Miss; 2],
    /// Delay of the wake-up after the deadline, ns.
    pub wake_ns: u32,
    /// Time since the start of the last tick, ns.
    pub period_ns: u32,
    /// Part of the wait before the tick that was spun, ns.
    pub spun_ns: u32,
    /// Voluntary context switches since the wake-up before, without that of the sleep.
    pub extra_switches: u32,
    /// Processor time of the work, ns.
    pub work_cpu_ns: u32,
    /// Wall time of the work, ns.
    pub work_wall_ns: u32,
    /// Wall time of each of [`STAGES`], ns.
    pub stage_ns: [u32; STAGES.len()],
    /// Wall time in which the tick before handed over its record, requests and reports, ns.
    pub record_ns: u32,
    /// Page faults of the thread during the tick.
    pub page_faults: u32,
    /// Allocations and frees of the thread during the tick.
    pub allocations: u32,
    /// Chunks that had arrived at the start of the tick, since the start of the run. A recording
    /// replays arrivals by this number.
    pub chunks_arrived: u64,
    /// Incarnation of the station as this tick saw it; 0 for none.
    pub station: u64,
    /// Sample of each device; `None` when it gave none.
    pub samples: [Option<Sample>; MAX_PROBES],
    /// Whether the wrenches are zero instead of the core's, since those before had expired.
    pub force_cut: bool,
    /// Whether those of the tick before were: the core's force rises from zero again.
    pub rises_again: bool,
    /// What the tick before took, as the core was told; `None` for the first.
    pub measured: Option<MeasuredTick>,
    /// What the core was told of the time of this tick.
    pub time: TimeAnswers,
    /// Bytes of the cache that may be in use from this tick on, where that changes.
    pub cache_limit: Option<u64>,
    /// Wrench written to each device, newtons and newton metres.
    pub wrenches: [Wrench; MAX_PROBES],
    /// Contact of each probe; `None` in free space.
    pub contacts: [Option<ProbeContact>; MAX_PROBES],
    /// Chunks that the tick was done with.
    pub chunks_consumed: u32,
    /// Requests that the tick made.
    pub requests: u32,
    /// Contact reports that the tick made.
    pub reports: u32,
    /// The core's own record.
    pub core: CoreRecord,
}

impl TickRecord {
    /// The largest force of a probe, newtons; not a number where one of them is none.
    #[must_use]
    pub fn largest_force(&self) -> f64 {
        let forces = self.wrenches.iter().map(|wrench| wrench.force.length());
        forces.fold(0.0, max_or_nan)
    }
}
