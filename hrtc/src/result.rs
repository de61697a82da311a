//! What a run leaves behind, as numbers: the result fields of `--json`, the series behind the plots, the
//! histograms behind the percentiles, and the lines of the supervised mode.
//!
//! The log thread pushes every [`TickRecord`] into an [`Accumulator`]; all its tables have a fixed size, so a
//! run of any length needs the same memory (thirteen histograms of 0.2 to 0.3 MB).

use crate::tick_record::{MissClass, STAGES, TickRecord};
use glam::DVec3;
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

mod series;

use series::Series;
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
    /// Ticks in contact.
    pub contact_ticks: u64,
    /// Of these, at full resolution.
    pub contact_full_ticks: u64,
    /// Of these, without a certified bound.
    pub contact_unbounded_ticks: u64,
    /// Active faces, over the ticks with a model.
    pub refined_faces: MedianMax,
    /// Certified error at the contact, metres.
    pub certified_error_m: ShortSpread,
    /// Measured error at the contact, metres, over the measurements that arrived.
    pub measured_error_m: ShortSpread,
    /// How many arrived.
    pub measured_errors: u64,
    /// Force over the ticks in contact, newtons.
    pub force_n: ShortSpread,
    /// Largest change of the force between two ticks, newtons.
    pub force_step_n_max: f64,
    /// Deepest the device was behind the proxy, metres.
    pub depth_m_max: f64,
    /// Ticks whose force was clamped.
    pub clamped_ticks: u64,
    /// Device samples rejected.
    pub rejected_samples: u64,
    /// Energy that the rendering put out, joules; above 0 it pushed energy in.
    pub energy_j: f64,
    /// Records received.
    pub vsps_received: u64,
    /// Splits performed.
    pub vsplits: u64,
    /// Collapses performed.
    pub ecols: u64,
    /// Regions subscribed.
    pub regions_subscribed: u64,
    /// Regions asked again.
    pub resubscribed: u64,
    /// Bytes received.
    pub bytes_received: u64,
    /// Bytes received up to the first contact.
    pub bytes_to_first_touch: u64,
    /// Bytes that the whole mesh would have been.
    pub bytes_full_mesh: u64,
    /// The cache.
    pub cache: CacheResult,
    /// Resident memory of the controller's process, bytes.
    pub hrtc_rss_bytes: u64,
    /// From the start of both processes to the first tick that could answer a touch, milliseconds; 0 if none could.
    pub first_force_ready_ms: f64,
    /// Work units of the worst tick.
    pub operations_max: u64,
    /// Work units that a tick may spend.
    pub operations_budget: u64,
    /// Page faults within ticks.
    pub page_faults: u64,
    /// Allocations and frees within ticks.
    pub allocations: u64,
    /// Hash over every tick's outputs, folded to 53 bits: the whole numbers that every JSON reader keeps.
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
    /// Bytes of the whole mesh: base mesh and records.
    pub bytes_full_mesh: u64,
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
    /// Whether the probe touches.
    pub contact: bool,
    /// Ticks in contact so far.
    pub contact_ticks: u64,
    /// Force, newtons.
    pub force_n: f64,
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

/// A histogram with a fixed range, three significant digits and an exact maximum.
struct Fixed {
    histogram: Histogram<u64>,
    /// Histogram counts a unit of the quantity.
    scale: f64,
    max: f64,
}

impl Fixed {
    /// For a quantity counted in steps of 1 / `scale`, up to 2^`bits` steps.
    fn new(scale: f64, bits: u32) -> Option<Self> {
        Histogram::new_with_bounds(1, 1 << bits, 3)
            .ok()
            .map(|histogram| Self {
                histogram,
                scale,
                max: 0.0,
            })
    }

    fn push(&mut self, value: f64) {
        let value = if value.is_finite() {
            value.max(0.0)
        } else {
            0.0
        };
        self.max = self.max.max(value);
        // `as` saturates; so does the histogram at its upper bound.
        self.histogram
            .saturating_record((value * self.scale).round() as u64);
    }

    fn quantile(&self, q: f64) -> f64 {
        if self.histogram.is_empty() {
            return 0.0;
        }
        (self.histogram.value_at_quantile(q) as f64 / self.scale).min(self.max)
    }

    fn spread(&self) -> Spread {
        Spread {
            p50: self.quantile(0.5),
            p99: self.quantile(0.99),
            p999: self.quantile(0.999),
            max: self.max,
        }
    }

    fn short(&self) -> ShortSpread {
        let Spread { p50, p99, max, .. } = self.spread();
        ShortSpread { p50, p99, max }
    }

    fn buckets(&self) -> Buckets {
        self.histogram
            .iter_recorded()
            .map(|step| (step.value_iterated_to(), step.count_at_value()))
            .collect()
    }
}

/// Timings arrive in nanoseconds and leave in microseconds.
const NANOSECONDS_IN_US: f64 = 1e3;

/// Adds up the ticks of a run.
pub struct Accumulator {
    period_ns: u64,
    result: RunResult,
    series: Series,
    first_tick: Option<u64>,
    last_tick: u64,
    last_force: DVec3,
    ready_tick: Option<u64>,
    status: Status,
    wake: Fixed,
    work_cpu: Fixed,
    work_wall: Fixed,
    period: Fixed,
    stages: Vec<Fixed>,
    faces: Fixed,
    certified: Fixed,
    measured: Fixed,
    force: Fixed,
}

impl Accumulator {
    /// Tables for a run with this period, nanoseconds; `None` when they cannot be made.
    #[must_use]
    pub fn new(period_ns: u64) -> Option<Self> {
        let timing = || Fixed::new(NANOSECONDS_IN_US, 32);
        let picometres = || Fixed::new(1e12, 50);
        let micronewtons = || Fixed::new(1e6, 40);
        Some(Self {
            period_ns,
            result: RunResult::default(),
            series: Series::new(),
            first_tick: None,
            last_tick: 0,
            last_force: DVec3::ZERO,
            ready_tick: None,
            status: Status::default(),
            wake: timing()?,
            work_cpu: timing()?,
            work_wall: timing()?,
            period: timing()?,
            stages: STAGES.iter().map(|_| timing()).collect::<Option<_>>()?,
            faces: Fixed::new(1.0, 32)?,
            certified: picometres()?,
            measured: picometres()?,
            force: micronewtons()?,
        })
    }

    /// Counts one tick; ticks come in order.
    pub fn push(&mut self, record: &TickRecord) {
        self.push_timing(record);
        let core = &record.core;
        let seconds = self.seconds();
        let result = &mut self.result;
        let force = record.wrench.force;
        let step = (force - self.last_force).length();
        if step.is_finite() {
            result.force_step_n_max = result.force_step_n_max.max(step);
        }
        self.last_force = force;
        if core.ready {
            self.ready_tick.get_or_insert(record.tick);
            self.faces.push(f64::from(core.active_faces));
        }
        if core.contact {
            if result.contact_ticks == 0 {
                result.bytes_to_first_touch = core.bytes_received;
            }
            result.contact_ticks += 1;
            result.contact_full_ticks += u64::from(core.contact_full);
            result.contact_unbounded_ticks += u64::from(!core.contact_bounded);
            if core.contact_bounded {
                self.certified.push(core.certified_error_m);
            }
            self.force.push(force.length());
            if core.depth_m.is_finite() {
                result.depth_m_max = result.depth_m_max.max(core.depth_m);
            }
        }
        if core.measured_error_m >= 0.0 {
            result.measured_errors += 1;
            self.measured.push(core.measured_error_m);
        }
        result.clamped_ticks += u64::from(core.clamped);
        result.rejected_samples += u64::from(core.rejected_sample);
        result.energy_j = core.energy_j;
        result.vsplits += u64::from(core.vsplits);
        result.ecols += u64::from(core.ecols);
        result.operations_max = result.operations_max.max(u64::from(core.work_units));
        // Totals of the core: the largest, so that a core that starts anew does not take them back.
        result.vsps_received = result.vsps_received.max(core.vsps_received);
        result.bytes_received = result.bytes_received.max(core.bytes_received);
        result.regions_subscribed = result.regions_subscribed.max(core.regions_subscribed);
        result.resubscribed = result.resubscribed.max(core.resubscribed);
        let cache = &mut result.cache;
        cache.evicted = cache.evicted.max(core.evicted);
        cache.high_water_bytes = cache.high_water_bytes.max(core.cache_bytes);
        cache.vsps = cache.vsps.max(u64::from(core.vsps_loaded));
        result.replay_hash = (core.replay_hash ^ (core.replay_hash >> 53)) & ((1 << 53) - 1);
        self.status = Status {
            seconds,
            ticks: result.ticks,
            contact: core.contact,
            contact_ticks: result.contact_ticks,
            force_n: finite(force.length()),
            refined_faces: u64::from(core.active_faces),
            cache_bytes: core.cache_bytes,
            vsps: u64::from(core.vsps_loaded),
            missed: result.missed,
            station: record.station != 0,
            ready: core.ready,
        };
        self.series.push(record.tick, SeriesBucket::of(record));
    }

    fn push_timing(&mut self, record: &TickRecord) {
        let result = &mut self.result;
        result.ticks += 1;
        let skipped = u64::from(record.skipped);
        result.missed += skipped;
        result.misses.count(record.miss, skipped);
        result.page_faults += u64::from(record.page_faults);
        result.allocations += u64::from(record.allocations);
        if self.first_tick.is_none() {
            self.first_tick = Some(record.tick);
        } else {
            // The first tick has none before it.
            push_ns(&mut self.period, record.period_ns);
        }
        self.last_tick = record.tick;
        push_ns(&mut self.wake, record.wake_ns);
        push_ns(&mut self.work_cpu, record.work_cpu_ns);
        push_ns(&mut self.work_wall, record.work_wall_ns);
        for (stage, &ns) in self.stages.iter_mut().zip(&record.stage_ns) {
            push_ns(stage, ns);
        }
    }

    /// How the run stands.
    #[must_use]
    pub fn status(&self) -> Status {
        self.status
    }

    /// Seconds from the first tick to the end of the last.
    fn seconds(&self) -> f64 {
        let periods = self
            .first_tick
            .map_or(0, |first| self.last_tick.saturating_sub(first) + 1);
        self.period_s() * periods as f64
    }

    fn period_s(&self) -> f64 {
        self.period_ns as f64 * 1e-9
    }

    /// Ends the run.
    #[must_use]
    pub fn finish(self, meta: RunMeta) -> Finished {
        let seconds = self.seconds();
        let period_s = self.period_s();
        let series = self.series.finish(period_s);
        let ready_ms = self.ready_tick.map_or(0.0, |tick| {
            meta.start_to_first_tick_ms + tick as f64 * period_s * 1e3
        });
        let stage_us = STAGES
            .iter()
            .zip(&self.stages)
            .map(|(name, stage)| ((*name).to_string(), stage.spread()))
            .collect();
        let faces = self.faces.spread();
        let result = RunResult {
            scene: meta.scene,
            model: meta.model,
            faces: meta.faces,
            seconds: finite(seconds),
            seed: meta.seed,
            missed_own_cpu: self.result.misses.own_cpu,
            period_us: self.period.spread(),
            wake_us: self.wake.spread(),
            work_us: self.work_cpu.spread(),
            work_wall_us: self.work_wall.spread(),
            stage_us,
            refined_faces: MedianMax {
                p50: faces.p50,
                max: faces.max,
            },
            certified_error_m: self.certified.short(),
            measured_error_m: self.measured.short(),
            force_n: self.force.short(),
            energy_j: finite(self.result.energy_j),
            bytes_full_mesh: meta.bytes_full_mesh,
            cache: CacheResult {
                bytes: meta.cache_bytes,
                ..self.result.cache
            },
            hrtc_rss_bytes: meta.rss_bytes,
            first_force_ready_ms: finite(ready_ms),
            operations_budget: meta.operations_budget,
            ..self.result
        };
        Finished {
            result,
            series,
            histograms: Histograms {
                wake_ns: self.wake.buckets(),
                work_cpu_ns: self.work_cpu.buckets(),
                work_wall_ns: self.work_wall.buckets(),
                period_ns: self.period.buckets(),
            },
            rights: meta.rights,
        }
    }
}

fn push_ns(table: &mut Fixed, ns: u32) {
    table.push(f64::from(ns) / NANOSECONDS_IN_US);
}

/// JSON has no NaN: what is not finite counts as 0.
fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

#[cfg(test)]
mod tests;
