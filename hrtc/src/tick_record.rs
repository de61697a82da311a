//! What one tick leaves behind: plain numbers, pushed into a ring and worded by another thread.

use shared::geometry::{Pose, Wrench};

/// Why a period was missed (facts of real time: "misses in classes").
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MissClass {
    /// Not missed.
    #[default]
    None,
    /// The tick's own processor time exceeded the period.
    OwnCpu,
    /// The timer fired, but the kernel ran something else on the core.
    RunQueue,
    /// The timer itself fired late.
    LateTimer,
    /// Processor time was taken away during the work (hypervisor or kernel).
    Stolen,
    /// None of these explains it.
    Unexplained,
}

/// Stages of a tick, in order, as indices of [`TickRecord::stage_ns`].
pub const STAGES: [&str; 5] = ["inbox", "refine", "refit", "query", "force"];

/// What the pure core reports of one tick. Counters are of this tick unless called total.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CoreRecord {
    /// Whether the probe touches.
    pub contact: bool,
    /// Whether every face that holds the probe is a face of the full mesh.
    pub contact_full: bool,
    /// Whether the contact has a certified bound.
    pub contact_bounded: bool,
    /// Whether the contact is as accurate as was asked for.
    pub contact_asked: bool,
    /// Expected error of the front at the contact, metres: 0 at full resolution, negative where not even the
    /// coarsest ring is done there.
    pub contact_tolerance_m: f64,
    /// The finest expected error that is asked for now, metres: what was asked for, or coarser for want of time
    /// or room.
    pub finest_tolerance_m: f64,
    /// Certified error at the contact, metres.
    pub certified_error_m: f64,
    /// Penetration of the device behind the proxy, metres.
    pub depth_m: f64,
    /// Faces of the active front.
    pub active_faces: u32,
    /// Splits performed.
    pub vsplits: u32,
    /// Collapses performed.
    pub ecols: u32,
    /// Operations of the tick in work units (splits, collapses, nodes, records) for the budget.
    pub work_units: u32,
    /// Nodes visited and faces tested by the queries.
    pub query_work: u32,
    /// Records received, total.
    pub vsps_received: u64,
    /// Bytes received (chunks), total.
    pub bytes_received: u64,
    /// Regions subscribed, total.
    pub regions_subscribed: u64,
    /// Epochs ended, so that regions were declared and asked for anew, total.
    pub resubscribed: u64,
    /// Regions asked for again, with every record, since their answer counted on records that were gone, total.
    pub resent: u64,
    /// Records evicted, total.
    pub evicted: u64,
    /// VSPs loaded now.
    pub vsps_loaded: u32,
    /// Cache bytes in use now.
    pub cache_bytes: u64,
    /// Whether the force was clamped.
    pub clamped: bool,
    /// Whether the sample was rejected.
    pub rejected_sample: bool,
    /// Energy put out by the rendering, joules, total; above 0 means it pushed energy in.
    pub energy_j: f64,
    /// Whether the model is there, so that a touch could be answered.
    pub ready: bool,
    /// Newest measured error, metres, and its tick; negative when none arrived this tick.
    pub measured_error_m: f64,
    /// Whether the force was asked to ramp down.
    pub stopping: bool,
    /// Hash over every tick's outputs so far.
    pub replay_hash: u64,
}

/// What the log thread gets of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickRecord {
    /// Index of the tick; counts skipped periods too.
    pub tick: u64,
    /// Periods skipped just before this tick.
    pub skipped: u32,
    /// Why.
    pub miss: MissClass,
    /// Wake-up after the deadline, ns.
    pub wake_ns: u32,
    /// Since the start of the tick before, ns.
    pub period_ns: u32,
    /// Thread CPU of the work, ns.
    pub work_cpu_ns: u32,
    /// Wall time of the work, ns.
    pub work_wall_ns: u32,
    /// Wall time of each of [`STAGES`], ns.
    pub stage_ns: [u32; 5],
    /// Page faults of the thread during the tick.
    pub page_faults: u32,
    /// Allocations and frees of the thread during the tick.
    pub allocations: u32,
    /// Chunks that had arrived when the tick looked, since the start: with the chunks themselves, the
    /// recorded arrivals.
    pub chunks_arrived: u64,
    /// Incarnation of the station as this tick saw it; 0 for none.
    pub station: u64,
    /// The device's pose; `None` when it gave none.
    pub sample: Option<Pose>,
    /// The wrench written.
    pub wrench: Wrench,
    /// The core's own record.
    pub core: CoreRecord,
}
