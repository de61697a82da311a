//! Figures of a run: the result fields of `--json`, the series behind the plots, the histograms
//! behind the percentiles, and the lines of the supervised mode.
//!
//! The main thread pushes every [`crate::tick_record::TickRecord`] into an [`Accumulator`]. Its
//! tables have a bounded size (histograms of 4 KiB for each octave that was met; where each met all
//! of its range 2.1 MB together, and 0.13 MB for each probe), so a run of any length needs no more
//! memory.

use crate::traffic::LinkBytes;
use hrtc_core::Capacity;
use hrtc_core::bodies::MovedObject;
use hrtc_core::governor::WorkCosts;
use realtime::pacer::MissClass;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;
use std::collections::BTreeMap;

mod accumulate;
mod fixed;
mod governor;
mod resident;
mod series;
mod words;

pub use accumulate::Accumulator;
pub use governor::{GovernorResult, MedianMin};
pub use resident::{ResidentBytes, ResidentParts};
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
    /// Bytes reserved at the start: the limit unless the scene lowers it.
    pub bytes: u64,
    /// The lowest limit, bytes.
    pub least_limit_bytes: u64,
    /// Ticks that began with more in use than the limit, which was lowered.
    pub over_limit_ticks: u64,
    /// Largest number of bytes in use at once.
    pub high_water_bytes: u64,
    /// Largest number of VSPs loaded at once.
    pub vsps: u64,
    /// Records evicted.
    pub evicted: u64,
}

/// Contact of one probe over a run.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ProbeResult {
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, coarser than asked for.
    pub coarser_ticks: u64,
    /// Force over its ticks in contact, newtons.
    pub force_n: ShortSpread,
    /// Largest certified error at its contact, metres; over the contacts that have one.
    pub certified_error_m_max: f64,
    /// Largest depth of the device behind the proxy, metres.
    pub depth_m_max: f64,
    /// Ticks whose force was clamped.
    pub clamped_ticks: u64,
    /// Device samples rejected.
    pub rejected_samples: u64,
    /// Energy of the rendering, joules; above 0 it gave energy to the device.
    pub energy_j: f64,
}

/// Skipped periods by reason; see [`MissClass`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Misses {
    /// The tick's own processor time did not fit into the period.
    pub own_cpu: u64,
    /// The tick's own waiting, for a lock for example, did not fit into the period.
    pub own_wait: u64,
    /// The thread was ready, but the kernel ran something else on the core.
    pub run_queue: u64,
    /// The timer itself was late.
    pub late_timer: u64,
    /// The process was stopped.
    pub stopped: u64,
    /// Processor time was taken away during the work.
    pub stolen: u64,
    /// No measured reason.
    pub unexplained: u64,
}

impl Misses {
    /// Skipped periods that are our own fault.
    #[must_use]
    pub fn ours(&self) -> u64 {
        self.own_cpu + self.own_wait
    }

    /// Skipped periods for any reason.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.ours()
            + self.run_queue
            + self.late_timer
            + self.stopped
            + self.stolen
            + self.unexplained
    }

    /// Adds the misses of another run.
    pub fn add(&mut self, other: &Self) {
        self.own_cpu += other.own_cpu;
        self.own_wait += other.own_wait;
        self.run_queue += other.run_queue;
        self.late_timer += other.late_timer;
        self.stopped += other.stopped;
        self.stolen += other.stolen;
        self.unexplained += other.unexplained;
    }

    fn count(&mut self, class: MissClass, periods: u64) {
        *match class {
            MissClass::OwnCpu => &mut self.own_cpu,
            MissClass::OwnWait => &mut self.own_wait,
            MissClass::RunQueue => &mut self.run_queue,
            MissClass::LateTimer => &mut self.late_timer,
            MissClass::Stopped => &mut self.stopped,
            MissClass::Stolen => &mut self.stolen,
            MissClass::None | MissClass::Unexplained => &mut self.unexplained,
        } += periods;
    }
}

/// The newest value; not a number once one was none.
fn last_or_nan(before: f64, value: f64) -> f64 {
    if before.is_nan() || !value.is_finite() {
        f64::NAN
    } else {
        value
    }
}

/// What the chain of safety did in a run; all 0 in a sound one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct SafetyEvents {
    /// Times that the watchdog brought the devices to zero, since the tick wrote no wrench for
    /// longer than one is valid.
    pub watchdog_stops: u64,
    /// Ticks after which the force had to rise from zero again, since its wrench had expired.
    pub force_cuts: u64,
    /// Panics of the tick: 0, or 1 in its last one.
    pub tick_panics: u64,
    /// Whether the recording lacks what it should have: 0 or 1.
    pub recording_errors: u64,
    /// Requests to the station that found their ring full; the next epoch asks again.
    pub requests_lost: u64,
    /// Contact reports to the station that found their ring full.
    pub contacts_lost: u64,
}

/// The result fields of a run. A quantity without a measurement is 0; one of which a value was not
/// finite is left out of the JSON and named in `non_finite`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(remote = "Self", default)]
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
    /// Of these, our own: a tick's own time, its waiting included, did not fit into the period.
    pub missed_own_cpu: u64,
    /// Skipped periods by reason.
    pub misses: Misses,
    /// Time from the start of one tick to the next, microseconds.
    pub period_us: Spread,
    /// Delay of the wake-up after the deadline, microseconds.
    pub wake_us: Spread,
    /// Mean of the part of the wait before a tick that was spun instead of slept, microseconds.
    pub spun_us_mean: f64,
    /// Voluntary context switches of the tick's thread beyond its waits for the timer.
    pub extra_switches: u64,
    /// The largest deviation of a tick from t0 + k T, ns: of its planned wake-up, or of its start
    /// from its own period.
    pub drift_ns_max: u64,
    /// Periods up to the last tick that were neither run nor counted as skipped: lost records.
    pub unaccounted_periods: i64,
    /// Processor time of a tick's work, microseconds.
    pub work_us: Spread,
    /// Wall time of a tick's work, microseconds.
    pub work_wall_us: Spread,
    /// Wall time by stage, microseconds.
    pub stage_us: BTreeMap<String, Spread>,
    /// Wall time in which a tick hands its record to log and recorder, microseconds.
    pub record_us: Spread,
    /// Ticks in contact, of any probe.
    pub contact_ticks: u64,
    /// Of these, with every probe in contact at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, without a certified bound.
    pub contact_unbounded_ticks: u64,
    /// Expected error asked for at the contact, metres.
    pub tolerance_m: f64,
    /// Ticks in contact that were coarser than asked for, for lack of time, of room or of
    /// prediction.
    pub coarser_ticks: u64,
    /// Finest expected error that was asked for in contact, metres: more than `tolerance_m` where
    /// the LOD controller chose a coarser level for lack of time or room.
    pub finest_tolerance_m: ShortSpread,
    /// Expected error of the front at the contact, metres; the certified error, if there is one,
    /// where even the coarsest ring was not loaded.
    pub expected_error_m: ShortSpread,
    /// Largest speed at full resolution by the estimate of the controller, m/s; 0 without a model.
    pub greatest_speed_m_per_s: f64,
    /// Expected errors of the rings around the contact, metres, finest first.
    pub rings_m: Vec<f64>,
    /// Active faces, over the ticks with a model.
    pub refined_faces: MedianMax,
    /// Certified error at the contact, metres.
    pub certified_error_m: ShortSpread,
    /// Measured error at the contact, metres.
    pub measured_error_m: ShortSpread,
    /// Number of measured errors that arrived.
    pub measured_errors: u64,
    /// Contact of each probe.
    pub probes: Vec<ProbeResult>,
    /// Objects of the scene.
    pub objects: u64,
    /// Faults at the end of the run, one sentence each: number in the scene, counted from 0, and
    /// model of the object, and why it was not touched or not refined, or its probe not led.
    pub faults: Vec<String>,
    /// Limit of objects that are active at once.
    pub active_objects_max: u64,
    /// Active objects.
    pub awake: MedianMax,
    /// Ticks with a movable object that was not asleep.
    pub moving_ticks: u64,
    /// Final pose of each object that moved.
    pub moved: Vec<MovedObject>,
    /// Ticks in which a probe could have been in contact with an inactive object.
    pub inactive_object_ticks: u64,
    /// Ticks in which a proxy used its budget up and left work to the next tick.
    pub unfinished_ticks: u64,
    /// Ticks in which a tool's proxy ended its step early within its budget. The next ticks
    /// complete the displacement.
    pub early_ticks: u64,
    /// Distance from the surface at which a tool's contacts act, metres: it feels thicker by that.
    /// 0 for a ball.
    pub contact_offset_m: f64,
    /// How many times as long the work of a tick was made to take (`--slow`); 1 for a real run.
    pub slow: f64,
    /// Contacts of a tool found after the step that they should have stopped.
    pub late_contacts: u64,
    /// Ticks with a tool that the surface has moved into or over and that knows no way out.
    pub stuck_ticks: u64,
    /// Cost of the inactive objects in a tick, microseconds of wall time: the broad phase.
    pub idle_us: Spread,
    /// Force of each probe over its ticks in contact, newtons.
    pub force_n: ShortSpread,
    /// Share of the wanted force of a contact that was not rendered, over the ticks in contact but
    /// for the soft end of a run: not paid for where a contact is found late, or withheld by energy
    /// account or limits.
    #[serde(default)]
    pub force_withheld: ShortSpread,
    /// Most force that was allowed, newtons: by the scene, the strongest device, the command line.
    pub force_limit_n: f64,
    /// Largest change of the force between two ticks, newtons.
    pub force_step_n_max: f64,
    /// The same over the periods between the two, newtons a period: after skipped ones the hand has
    /// moved on for longer.
    pub force_step_per_period_n_max: f64,
    /// Largest force that a device lost by itself, since it had expired, newtons: no step of the
    /// loop, which comes back from zero.
    #[serde(default)]
    pub force_cut_n_max: f64,
    /// Largest torque of a probe, newton metres.
    pub torque_nm_max: f64,
    /// Largest depth of the device behind the proxy, metres.
    pub depth_m_max: f64,
    /// Ticks whose force was clamped.
    pub clamped_ticks: u64,
    /// Device samples rejected.
    pub rejected_samples: u64,
    /// Energy of the rendering, joules, without its work over the motion of movable objects; above
    /// 0 it gave energy to the devices.
    pub energy_j: f64,
    /// Its largest value after a tick, joules.
    pub energy_j_max: f64,
    /// Names of the quantities of which a value was not finite: a defect, and the run has failed.
    pub non_finite: Vec<String>,
    /// Records received.
    pub vsps_received: u64,
    /// Splits performed.
    pub vsplits: u64,
    /// Collapses performed.
    pub ecols: u64,
    /// Ticks with geomorphing vertices.
    pub geomorph_ticks: u64,
    /// Largest number of vertices that were geomorphing at once.
    pub geomorphs_max: u64,
    /// Perceptible splits that waited for room to geomorph, each counted in every tick in which it
    /// was tried.
    pub deferred: u64,
    /// Splits rejected since they would turn a face over near a probe, counted likewise.
    pub rejected_folds: u64,
    /// Regions subscribed.
    pub regions_subscribed: u64,
    /// Epochs that ended. Each end declares the regions again and asks for them again.
    pub resubscribed: u64,
    /// Regions asked for again, with every record.
    pub resent: u64,
    /// Smoothed time from a question to the station to its answer, at the end, milliseconds; -1
    /// without one.
    pub round_trip_ms: f64,
    /// Rate of the link while it was the limit, at the end, megabits of messages a second, as they
    /// travel; -1 where it never was.
    pub link_mbit_per_s: f64,
    /// Bytes received.
    pub bytes_received: u64,
    /// Bytes received up to the first contact.
    pub bytes_to_first_touch: u64,
    /// Bytes that crossed the link, by kind: as they travelled, where `bytes_received` counts whole
    /// chunks.
    pub link_bytes: LinkBytes,
    /// Bytes of the whole meshes of all models.
    pub bytes_full_mesh: u64,
    /// The cache.
    pub cache: CacheResult,
    /// Capacity of everything that was sized at start, with its highest fill.
    pub capacities: Vec<Capacity>,
    /// The most memory of the controller's process that was ever resident, bytes.
    pub hrtc_rss_bytes: u64,
    /// What was resident at the end of the run.
    pub hrtc_rss_parts: ResidentParts,
    /// Time from the start of both processes to the first tick that knew of a station, by its
    /// heartbeat, milliseconds; 0 without one.
    pub first_heard_ms: f64,
    /// The same to the first tick that could render a contact.
    pub first_force_ready_ms: f64,
    /// The same to the first tick in contact.
    pub first_touch_ms: f64,
    /// Time from the first tick in contact to the first in contact at full resolution,
    /// milliseconds; 0 when they are the same, negative without one.
    pub first_full_ms: f64,
    /// Largest number of work units in a tick.
    pub operations_max: u64,
    /// Limit of the work units in a tick.
    pub operations_budget: u64,
    /// Largest work of the queries in a tick, nodes visited and faces tested.
    pub query_work_max: u64,
    /// Limit of that work.
    pub query_work_budget: u64,
    /// What the governor gave to the ticks.
    pub governor: GovernorResult,
    /// Page faults within ticks.
    pub page_faults: u64,
    /// Of these, in ticks that used up their period by their own work.
    pub page_faults_missed: u64,
    /// Allocations and frees within ticks.
    pub allocations: u64,
    /// What the chain of safety did.
    pub safety: SafetyEvents,
    /// Hash over every tick's outputs, folded to 53 bits: integers that every JSON reader keeps.
    pub replay_hash: u64,
    /// Hash over the splits that the fronts hold at the end, folded likewise.
    pub front_hash: u64,
}

impl Serialize for RunResult {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.non_finite.is_empty() {
            return Self::serialize(self, serializer);
        }
        let value = Self::serialize(self, serde_json::value::Serializer);
        let mut value = value.map_err(S::Error::custom)?;
        for name in &self.non_finite {
            let (parent, field) = name.rsplit_once('/').unwrap_or(("", name));
            let parent = if parent.is_empty() {
                Some(&mut value)
            } else {
                value.pointer_mut(&format!("/{parent}"))
            };
            parent
                .and_then(Value::as_object_mut)
                .map(|fields| fields.remove(field));
        }
        value.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for RunResult {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Self::deserialize(deserializer)
    }
}

/// Figures of a run beside its ticks.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunMeta {
    /// Name of the scene.
    pub scene: String,
    /// Name of the first object's model.
    pub model: String,
    /// Faces of its full mesh; 0 when the model did not arrive.
    pub faces: u64,
    /// Seed of the tour, 0 for none.
    pub seed: u64,
    /// Limit of the cache, bytes.
    pub cache_bytes: u64,
    /// Bytes of the whole meshes: base mesh and records of every model.
    pub bytes_full_mesh: u64,
    /// Objects of the scene.
    pub objects: u64,
    /// Limit of objects that are active at once.
    pub active_objects_max: u64,
    /// Resident memory of this process.
    pub rss_bytes: ResidentBytes,
    /// Time from the start of both processes to tick 0, milliseconds; from the start of this one
    /// when it runs alone.
    pub start_to_first_tick_ms: f64,
    /// How many times as long the work of a tick was made to take.
    pub slow: f64,
    /// Limit of the work units in a tick.
    pub operations_budget: u64,
    /// Limit of the work of the queries in a tick.
    pub query_work_budget: u64,
    /// Costs of the counted work on this machine.
    pub costs: WorkCosts,
    /// What the chain of safety did.
    pub safety: SafetyEvents,
    /// Real-time rights that were asked for.
    pub rights: Vec<Right>,
}

/// One real-time right.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Right {
    /// Name, such as `SCHED_FIFO 80`.
    pub name: String,
    /// Whether it was obtained.
    pub obtained: bool,
    /// Reason of a refusal; empty when obtained.
    pub detail: String,
}

/// A histogram as value and count of its non-empty buckets, ascending.
pub type Buckets = Vec<(u64, u64)>;

/// Histograms of the timing, nanoseconds.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Histograms {
    /// Delay of the wake-up after the deadline.
    pub wake_ns: Buckets,
    /// Processor time of the work.
    pub work_cpu_ns: Buckets,
    /// Wall time of the work.
    pub work_wall_ns: Buckets,
    /// Time from the start of one tick to the next.
    pub period_ns: Buckets,
}

/// Largest number of stations that a result lists.
pub const MAX_STATIONS: usize = 256;

/// A station that came, or came back, in a run. Times are milliseconds since the start of both
/// processes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct StationHeard {
    /// Time of the first tick that knew of it.
    pub heard_ms: f64,
    /// Time of the first tick in which it knew what is held and owed no answer; negative without
    /// one.
    pub synchronised_ms: f64,
}

/// A hash in 53 bits: an integer that every JSON reader keeps.
pub(crate) fn folded(hash: u64) -> u64 {
    (hash ^ (hash >> 53)) & ((1 << 53) - 1)
}

/// A finished run: the last line of the supervised mode.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Finished {
    /// The result fields.
    pub result: RunResult,
    /// The run over time, at most [`SERIES_BUCKETS`] pieces.
    pub series: Vec<SeriesBucket>,
    /// Timing.
    pub histograms: Histograms,
    /// Real-time rights.
    pub rights: Vec<Right>,
    /// The first [`MAX_STATIONS`] stations that were heard.
    pub stations: Vec<StationHeard>,
}

/// State of a run, for the live line.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Status {
    /// Time since the first tick, seconds.
    pub seconds: f64,
    /// Ticks run.
    pub ticks: u64,
    /// Whether a probe is in contact.
    pub contact: bool,
    /// Number of probes in contact.
    pub in_contact: u64,
    /// Active objects.
    pub awake: u64,
    /// Ticks in contact so far.
    pub contact_ticks: u64,
    /// Largest force of a probe, newtons.
    #[serde(with = "words")]
    pub force_n: f64,
    /// Certified error at the contact, metres.
    #[serde(with = "words")]
    pub certified_error_m: f64,
    /// Newest measured error, metres; negative before the first.
    #[serde(with = "words")]
    pub measured_error_m: f64,
    /// Finest expected error that is asked for now, metres.
    #[serde(with = "words")]
    pub finest_tolerance_m: f64,
    /// Active faces.
    pub refined_faces: u64,
    /// Cache in use, bytes.
    pub cache_bytes: u64,
    /// VSPs loaded.
    pub vsps: u64,
    /// Periods skipped so far.
    pub missed: u64,
    /// Whether a station is heard.
    pub station: bool,
    /// Whether a contact could be rendered.
    pub ready: bool,
}

/// One line of `hrtc run --supervised`: `{"status":{...}}` about five times a second, in the end
/// `{"result":{...},"series":[...],"histograms":{...},"rights":[...]}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum SupervisedLine {
    /// State of the run.
    Status {
        /// The status.
        status: Status,
    },
    /// The run is over.
    Finished(Box<Finished>),
}

#[cfg(test)]
mod tests;
