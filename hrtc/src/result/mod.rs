//! What a run leaves behind, as numbers: the result fields of `--json`, the series behind the
//! plots, the histograms behind the percentiles, and the lines of the supervised mode.
//!
//! The log thread pushes every [`crate::tick_record::TickRecord`] into an [`Accumulator`]; all its
//! tables have a fixed size, so a run of any length needs the same memory (fifteen histograms of
//! 0.2 to 0.3 MB).

use hrtc_core::Capacity;
use hrtc_core::bodies::MovedObject;
use realtime::pacer::MissClass;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

mod accumulate;
mod series;

pub use accumulate::Accumulator;
pub use series::{SERIES_BUCKETS, SeriesBucket};

/// Median, upper percentiles and maximum of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spread {
    /// Median.
    pub p50: f64,
    /// 99 % are not above it.
    pub p99: f64,
    /// 99.9 % are not above it.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

/// Median, 99 % and maximum of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ShortSpread {
    /// Median.
    pub p50: f64,
    /// 99 % are not above it.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

/// Median and maximum of a quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MedianMax {
    /// Median.
    pub p50: f64,
    /// Largest.
    pub max: f64,
}

/// The cache over a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CacheResult {
    /// Its limit, bytes.
    pub bytes: u64,
    /// Most bytes in use at once.
    pub high_water_bytes: u64,
    /// Most VSPs loaded at once.
    pub vsps: u64,
    /// Records evicted.
    pub evicted: u64,
}

/// What one probe felt over a run.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ProbeResult {
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, coarser than asked for.
    pub coarser_ticks: u64,
    /// Force over its ticks in contact, newtons.
    pub force_n: ShortSpread,
    /// Largest certified error at its contact, metres.
    pub certified_error_m_max: f64,
    /// Deepest the device was behind the proxy, metres.
    pub depth_m_max: f64,
    /// Ticks whose force was clamped.
    pub clamped_ticks: u64,
    /// Device samples rejected.
    pub rejected_samples: u64,
    /// Energy that the rendering put out, joules.
    pub energy_j: f64,
}

/// Skipped periods by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Misses {
    /// The tick's own processor time exceeded the period.
    pub own_cpu: u64,
    /// The timer fired, the kernel ran something else.
    pub run_queue: u64,
    /// The timer itself was late.
    pub late_timer: u64,
    /// Processor time was taken away during the work.
    pub stolen: u64,
    /// None of these.
    pub unexplained: u64,
}

impl Misses {
    /// All of them.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.own_cpu + self.run_queue + self.late_timer + self.stolen + self.unexplained
    }

    /// Adds another run's.
    pub fn add(&mut self, other: &Self) {
        self.own_cpu += other.own_cpu;
        self.run_queue += other.run_queue;
        self.late_timer += other.late_timer;
        self.stolen += other.stolen;
        self.unexplained += other.unexplained;
    }

    fn count(&mut self, class: MissClass, periods: u64) {
        *match class {
            MissClass::OwnCpu => &mut self.own_cpu,
            MissClass::RunQueue => &mut self.run_queue,
            MissClass::LateTimer => &mut self.late_timer,
            MissClass::Stolen => &mut self.stolen,
            MissClass::None | MissClass::Unexplained => &mut self.unexplained,
        } += periods;
    }
}

/// The result fields of a run. Every number is finite; what did not happen is 0.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RunResult {
    /// Name of the scene.
    pub scene: String,
    /// Name of the first object's model.
    pub model: String,
    /// Faces of its full mesh.
    pub faces: u64,
    /// Length of the run, seconds: periods from the first tick to the last, skipped ones too.
    pub seconds: f64,
    /// Seed of the tour; 0 for a trajectory from a file.
    pub seed: u64,
    /// Ticks run.
    pub ticks: u64,
    /// Periods skipped.
    pub missed: u64,
    /// Of these, because a tick's own processor time exceeded the period.
    pub missed_own_cpu: u64,
    /// All of them by reason.
    pub misses: Misses,
    /// From the start of one tick to the next, microseconds.
    pub period_us: Spread,
    /// Wake-up after the deadline, microseconds.
    pub wake_us: Spread,
    /// Work of a tick, thread CPU, microseconds.
    pub work_us: Spread,
    /// The same as wall time.
    pub work_wall_us: Spread,
    /// Wall time by stage, microseconds.
    pub stage_us: BTreeMap<String, Spread>,
    /// Ticks in contact, of any probe.
    pub contact_ticks: u64,
    /// Of these, those in which every probe that touched did so at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, without a certified bound.
    pub contact_unbounded_ticks: u64,
    /// Expected error asked for at the contact, metres.
    pub tolerance_m: f64,
    /// Ticks in contact that were coarser than asked for: for want of time, of room, or of
    /// prediction.
    pub coarser_ticks: u64,
    /// Finest expected error that was asked for while in contact, metres: more than `tolerance_m`
    /// where the dial was turned back for want of time or room.
    pub finest_tolerance_m: ShortSpread,
    /// Expected error of the front at the contact, metres; the certified one where not even the
    /// coarsest ring was there.
    pub expected_error_m: ShortSpread,
    /// Greatest speed at full resolution as the controller reckons it, m/s; 0 without a model.
    pub greatest_speed_m_per_s: f64,
    /// Expected errors of the rings around the contact, metres, finest first.
    pub rings_m: Vec<f64>,
    /// Active faces, over the ticks with a model.
    pub refined_faces: MedianMax,
    /// Certified error at the contact, metres.
    pub certified_error_m: ShortSpread,
    /// Measured error at the contact, metres, over the measurements that arrived.
    pub measured_error_m: ShortSpread,
    /// How many arrived.
    pub measured_errors: u64,
    /// What each probe felt.
    pub probes: Vec<ProbeResult>,
    /// Objects of the scene.
    pub objects: u64,
    /// Objects that may be awake at once.
    pub active_objects_max: u64,
    /// Objects that were awake.
    pub awake: MedianMax,
    /// Ticks in which an object moved, or might have: one that moves and did not sleep.
    pub moving_ticks: u64,
    /// Where each object that moved came to.
    pub moved: Vec<MovedObject>,
    /// Ticks in which a probe could have touched an object that was not awake.
    pub inactive_object_ticks: u64,
    /// Ticks in which the budget of a tool's proxy was spent and left something to the next one.
    pub unfinished_ticks: u64,
    /// Ticks that a tool's proxy ended early though its budget had room: the rest of its way was
    /// gone in the next ones.
    pub early_ticks: u64,
    /// What the objects that are not awake cost a tick, microseconds of wall time: the stage of the
    /// broad phase.
    pub idle_us: Spread,
    /// Force of each probe over its ticks in contact, newtons.
    pub force_n: ShortSpread,
    /// Largest change of the force between two ticks, newtons.
    pub force_step_n_max: f64,
    /// Deepest the device was behind the proxy, metres.
    pub depth_m_max: f64,
    /// Ticks whose force was clamped.
    pub clamped_ticks: u64,
    /// Device samples rejected.
    pub rejected_samples: u64,
    /// Energy that the rendering put out, joules, but for its work over the motion of objects that
    /// move; above 0 it pushed energy in.
    pub energy_j: f64,
    /// Records received.
    pub vsps_received: u64,
    /// Splits performed.
    pub vsplits: u64,
    /// Collapses performed.
    pub ecols: u64,
    /// Ticks in which vertices were on their way, since a probe feels them.
    pub geomorph_ticks: u64,
    /// The most vertices that were on their way at once.
    pub geomorphs_max: u64,
    /// Splits that a probe would feel and that waited for room to fly, each counted in every tick
    /// in which it was tried.
    pub postponed: u64,
    /// Splits that waited since they would turn a face over where a probe is or may come, counted
    /// likewise.
    pub refused_folds: u64,
    /// Regions subscribed.
    pub regions_subscribed: u64,
    /// Epochs that ended, each with regions declared and asked for anew.
    pub resubscribed: u64,
    /// Regions asked for again, with every record.
    pub resent: u64,
    /// Bytes received.
    pub bytes_received: u64,
    /// Bytes received up to the first contact.
    pub bytes_to_first_touch: u64,
    /// Bytes that the whole mesh of every model would have been.
    pub bytes_full_mesh: u64,
    /// The cache.
    pub cache: CacheResult,
    /// Everything that was sized at start, with the most that was in it.
    pub capacities: Vec<Capacity>,
    /// Resident memory of the controller's process, bytes.
    pub hrtc_rss_bytes: u64,
    /// From the start of both processes to the first tick that could answer a touch, milliseconds;
    /// 0 if none could.
    pub first_force_ready_ms: f64,
    /// Work units of the worst tick.
    pub operations_max: u64,
    /// Work units that a tick may spend.
    pub operations_budget: u64,
    /// Page faults within ticks.
    pub page_faults: u64,
    /// Allocations and frees within ticks.
    pub allocations: u64,
    /// Hash over every tick's outputs, folded to 53 bits: the whole numbers that every JSON reader
    /// keeps.
    pub replay_hash: u64,
}

/// What the shell knows of a run beside its ticks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunMeta {
    /// Name of the scene.
    pub scene: String,
    /// Name of the first object's model.
    pub model: String,
    /// Faces of its full mesh; 0 when it never came.
    pub faces: u64,
    /// Seed of the tour, 0 for none.
    pub seed: u64,
    /// Limit of the cache, bytes.
    pub cache_bytes: u64,
    /// Bytes of the whole meshes: base mesh and records of every model.
    pub bytes_full_mesh: u64,
    /// Objects of the scene.
    pub objects: u64,
    /// Objects that may be awake at once.
    pub active_objects_max: u64,
    /// Resident memory of this process, bytes.
    pub rss_bytes: u64,
    /// From the start of both processes (of this one, when it runs alone) to tick 0, milliseconds.
    pub start_to_first_tick_ms: f64,
    /// Work units that a tick may spend.
    pub operations_budget: u64,
    /// Which real-time rights were asked for and obtained.
    pub rights: Vec<Right>,
}

/// One real-time right.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Right {
    /// What it is, such as `SCHED_FIFO 80`.
    pub name: String,
    /// Whether it was obtained.
    pub obtained: bool,
    /// Why not, or more about it.
    pub detail: String,
}

/// A histogram as value and count of its non-empty buckets, ascending.
pub type Buckets = Vec<(u64, u64)>;

/// Histograms of the timing, nanoseconds.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Histograms {
    /// Wake-up after the deadline.
    pub wake_ns: Buckets,
    /// Thread CPU of the work.
    pub work_cpu_ns: Buckets,
    /// Wall time of the work.
    pub work_wall_ns: Buckets,
    /// Since the start of the tick before.
    pub period_ns: Buckets,
}

/// A finished run: the last line of the supervised mode.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Finished {
    /// The result fields.
    pub result: RunResult,
    /// The run over time, at most [`SERIES_BUCKETS`] pieces.
    pub series: Vec<SeriesBucket>,
    /// The timing.
    pub histograms: Histograms,
    /// Real-time rights.
    pub rights: Vec<Right>,
}

/// How a run stands, for the live line.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// Since the first tick.
    pub seconds: f64,
    /// Ticks run.
    pub ticks: u64,
    /// Whether a probe touches.
    pub contact: bool,
    /// Probes that touch.
    pub touching: u64,
    /// Objects that are awake.
    pub awake: u64,
    /// Ticks in contact so far.
    pub contact_ticks: u64,
    /// Largest force of a probe, newtons.
    pub force_n: f64,
    /// Certified error at the contact, metres.
    pub certified_error_m: f64,
    /// Newest measured error, metres; negative before the first.
    pub measured_error_m: f64,
    /// Finest expected error that is asked for now, metres.
    pub finest_tolerance_m: f64,
    /// Active faces.
    pub refined_faces: u64,
    /// Cache in use, bytes.
    pub cache_bytes: u64,
    /// VSPs loaded.
    pub vsps: u64,
    /// Periods skipped so far.
    pub missed: u64,
    /// Whether the station is there.
    pub station: bool,
    /// Whether a touch could be answered.
    pub ready: bool,
}

/// One line of `hrtc run --supervised`: `{"status":{...}}` about five times a second, in the end
/// `{"result":{...},"series":[...],"histograms":{...},"rights":[...]}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SupervisedLine {
    /// How the run stands.
    Status {
        /// The status.
        status: Status,
    },
    /// The run is over.
    Finished(Box<Finished>),
}

#[cfg(test)]
mod tests;
