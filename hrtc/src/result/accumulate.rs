//! Accumulation of a run's ticks in tables of bounded size.

use super::fixed::Fixed;
use super::governor::GovernorStats;
use super::series::Series;
use super::{
    CacheResult, Finished, Histograms, MAX_STATIONS, ProbeResult, RunMeta, RunResult, SeriesBucket,
    StationHeard, Status, folded, last_or_nan,
};
use crate::tick_record::{STAGES, TickRecord};
use glam::DVec3;
use hrtc_core::record::{CoreRecord, ProbeRecord, max_or_nan};
use scene::MAX_PROBES;

/// Timings arrive in nanoseconds and leave in microseconds.
const NANOSECONDS_IN_US: f64 = 1e3;

/// Adds up the ticks of a run.
pub struct Accumulator {
    /// Period of the loop, ns.
    period_ns: u64,
    result: RunResult,
    series: Series,
    first_tick: Option<u64>,
    last_tick: u64,
    /// The tick that comes next when no period is skipped and no record lost.
    next_tick: u64,
    /// t0: where tick 0 was planned by the first record, CLOCK_MONOTONIC, ns.
    phase_ns: u64,
    /// Spun so far, ns.
    spun_ns: u64,
    /// Page faults within the last tick.
    last_page_faults: u32,
    /// Force of each probe in the last tick, newtons.
    last_forces: [DVec3; MAX_PROBES],
    /// First tick that could render a contact.
    ready_tick: Option<u64>,
    /// First tick in contact.
    touch_tick: Option<u64>,
    /// First tick in contact at full resolution.
    full_tick: Option<u64>,
    /// Incarnation of the station in the last tick; 0 for none.
    last_station: u64,
    /// Exchanges begun anew until then.
    last_resubscribed: u64,
    /// First tick of each station, and the first in which it was synchronised.
    stations: Vec<(u64, Option<u64>)>,
    status: Status,
    // Microseconds.
    wake: Fixed,
    work_cpu: Fixed,
    work_wall: Fixed,
    period: Fixed,
    stages: Vec<Fixed>,
    record: Fixed,
    /// Active faces.
    faces: Fixed,
    // Errors at the contact, metres.
    certified: Fixed,
    finest: Fixed,
    expected: Fixed,
    measured: Fixed,
    /// Share of the wanted force.
    withheld: Fixed,
    /// Active objects.
    awake: Fixed,
    /// Force of each probe, newtons.
    forces: Vec<Fixed>,
    governor: GovernorStats,
}

impl Accumulator {
    /// Tables for a run with this period, nanoseconds, and so many probes.
    #[must_use]
    pub fn new(period_ns: u64, probes: usize) -> Self {
        let timing = || Fixed::new(NANOSECONDS_IN_US, 32);
        let picometres = || Fixed::new(1e12, 50);
        let micronewtons = || Fixed::new(1e6, 40);
        Self {
            period_ns,
            result: RunResult {
                probes: vec![ProbeResult::default(); probes],
                ..RunResult::default()
            },
            series: Series::new(),
            first_tick: None,
            last_page_faults: 0,
            last_tick: 0,
            next_tick: 0,
            phase_ns: 0,
            spun_ns: 0,
            last_forces: [DVec3::ZERO; MAX_PROBES],
            ready_tick: None,
            touch_tick: None,
            full_tick: None,
            last_station: 0,
            last_resubscribed: 0,
            stations: Vec::with_capacity(MAX_STATIONS),
            status: Status {
                measured_error_m: -1.0,
                ..Status::default()
            },
            wake: timing(),
            governor: GovernorStats::new(),
            work_cpu: timing(),
            work_wall: timing(),
            period: timing(),
            stages: STAGES.iter().map(|_| timing()).collect(),
            record: timing(),
            faces: Fixed::new(1.0, 32),
            certified: picometres(),
            finest: picometres(),
            expected: picometres(),
            measured: picometres(),
            withheld: Fixed::new(1e6, 20),
            awake: Fixed::new(1.0, 5),
            forces: (0..probes).map(|_| micronewtons()).collect(),
        }
    }

    /// Counts one tick; ticks come in order.
    pub fn push(&mut self, record: &TickRecord) {
        // The force of a tick whose record is missing is not known: there is no step over it.
        let follows = record.tick == self.next_tick + u64::from(record.skipped);
        self.next_tick = record.tick + 1;
        self.push_timing(record);
        self.push_probes(record, follows);
        self.push_contact(&record.core);
        self.push_refinement(record);
        self.push_totals(&record.core);
        self.push_station(record);
        self.status = self.status_at(record);
        self.series.push(record.tick, SeriesBucket::of(record));
    }

    /// Forces and counts of each probe; `follows`: whether the tick before was counted.
    fn push_probes(&mut self, record: &TickRecord, follows: bool) {
        let core = &record.core;
        let periods = 1.0 + f64::from(record.skipped);
        let result = &mut self.result;
        for (k, probe) in result.probes.iter_mut().enumerate() {
            let force = record.wrenches[k].force;
            if record.rises_again || record.force_cut {
                // The device was at zero before this wrench, or went there by itself.
                let lost = std::mem::take(&mut self.last_forces[k]).length();
                result.force_cut_n_max = max_or_nan(result.force_cut_n_max, lost);
            } else if !follows {
                self.last_forces[k] = force;
            }
            let step = (force - self.last_forces[k]).length();
            result.force_step_n_max = max_or_nan(result.force_step_n_max, step);
            let per_period = &mut result.force_step_per_period_n_max;
            *per_period = max_or_nan(*per_period, step / periods);
            self.last_forces[k] = force;
            let torque = record.wrenches[k].torque.length();
            result.torque_nm_max = max_or_nan(result.torque_nm_max, torque);
            if core.probes[k].contact {
                self.forces[k].push(force.length());
            }
            probe.add(&core.probes[k]);
            result.rejected_samples += u64::from(core.probes[k].rejected_sample);
        }
    }

    /// Accuracy of the contact, and the measured error.
    fn push_contact(&mut self, core: &CoreRecord) {
        let result = &mut self.result;
        if core.contact {
            if result.contact_ticks == 0 {
                result.bytes_to_first_touch = core.bytes_received;
            }
            result.contact_ticks += 1;
            self.touch_tick.get_or_insert(self.last_tick);
            result.contact_full_ticks += u64::from(core.contact_full);
            if core.contact_full {
                self.full_tick.get_or_insert(self.last_tick);
            }
            result.contact_unbounded_ticks += u64::from(!core.contact_bounded);
            if core.contact_bounded {
                self.certified.push(core.certified_error_m);
            }
            result.coarser_ticks += u64::from(!core.contact_asked);
            self.finest.push(core.finest_tolerance_m);
            // Where even the coarsest ring is not loaded, the bound stands for it; a contact
            // without one is counted above, and has no number.
            if core.contact_tolerance_m < 0.0 {
                if core.contact_bounded {
                    self.expected.push(core.certified_error_m);
                }
            } else {
                self.expected.push(core.contact_tolerance_m);
            }
            result.depth_m_max = max_or_nan(result.depth_m_max, core.depth_m);
            // The soft end of a run withholds all of it, as it should.
            if !core.stopping {
                self.withheld.push(core.force_withheld);
            }
        }
        // Negative: none arrived.
        if core.measured_error_m >= 0.0 || core.measured_error_m.is_nan() {
            result.measured_errors += 1;
            self.measured.push(core.measured_error_m);
        }
    }

    /// Objects, the active mesh and the work of a tick.
    fn push_refinement(&mut self, record: &TickRecord) {
        let core = &record.core;
        let result = &mut self.result;
        result.moving_ticks += u64::from(core.moving > 0);
        result.inactive_object_ticks += u64::from(core.unserved > 0);
        self.governor.push(core, record.time);
        result.unfinished_ticks += u64::from(core.unfinished > 0);
        result.early_ticks += u64::from(core.early > 0);
        result.late_contacts += u64::from(core.late_contacts);
        result.stuck_ticks += u64::from(core.stuck > 0);
        if core.ready {
            self.awake.push(f64::from(core.active_objects));
            self.ready_tick.get_or_insert(self.last_tick);
            self.faces.push(f64::from(core.active_faces));
        }
        result.clamped_ticks += u64::from(core.clamped);
        result.energy_j = last_or_nan(result.energy_j, core.energy_j);
        result.energy_j_max = max_or_nan(result.energy_j_max, core.energy_j);
        result.vsplits += u64::from(core.vsplits);
        result.ecols += u64::from(core.ecols);
        result.geomorph_ticks += u64::from(core.geomorphing > 0);
        result.geomorphs_max = result.geomorphs_max.max(u64::from(core.geomorphing));
        result.deferred += u64::from(core.deferred);
        result.rejected_folds += u64::from(core.rejected_folds);
        result.operations_max = result.operations_max.max(u64::from(core.work_units));
        result.query_work_max = result.query_work_max.max(u64::from(core.query_work));
    }

    /// Totals of the core: the largest values, so that a restart of the core does not lower them.
    fn push_totals(&mut self, core: &CoreRecord) {
        let result = &mut self.result;
        result.vsps_received = result.vsps_received.max(core.vsps_received);
        result.bytes_received = result.bytes_received.max(core.bytes_received);
        result.regions_subscribed = result.regions_subscribed.max(core.regions_subscribed);
        result.resubscribed = result.resubscribed.max(core.resubscribed);
        result.resent = result.resent.max(core.resent);
        result.round_trip_ms = times_or_none(1e3, core.round_trip_s);
        result.link_mbit_per_s = times_or_none(8e-6, core.link_bytes_per_s);
        let cache = &mut result.cache;
        cache.evicted = cache.evicted.max(core.evicted);
        let limit = core.cache_limit_bytes;
        cache.least_limit_bytes = match cache.least_limit_bytes {
            0 => limit,
            least => least.min(limit),
        };
        cache.over_limit_ticks += u64::from(core.cache_bytes > limit);
        cache.high_water_bytes = cache.high_water_bytes.max(core.cache_bytes);
        cache.vsps = cache.vsps.max(u64::from(core.vsps_loaded));
        result.replay_hash = folded(core.replay_hash);
    }

    /// Stations that come and go, and exchanges with one that begin anew: what is lost in an outage
    /// too short to miss the station is seen by that.
    fn push_station(&mut self, record: &TickRecord) {
        let is_anew = record.core.resubscribed > self.last_resubscribed;
        let came = record.station != 0 && (record.station != self.last_station || is_anew);
        self.last_resubscribed = record.core.resubscribed;
        if came && self.stations.len() < MAX_STATIONS {
            self.stations.push((record.tick, None));
        }
        self.last_station = record.station;
        let last = self.stations.last_mut();
        if let Some((_, synchronised @ None)) = last
            && record.station != 0
            && record.core.synchronised
        {
            *synchronised = Some(record.tick);
        }
    }

    fn status_at(&self, record: &TickRecord) -> Status {
        let core = &record.core;
        let result = &self.result;
        Status {
            seconds: self.seconds(),
            ticks: result.ticks,
            contact: core.contact,
            in_contact: core.probes.iter().filter(|probe| probe.contact).count() as u64,
            awake: u64::from(core.active_objects),
            contact_ticks: result.contact_ticks,
            force_n: record.largest_force(),
            certified_error_m: core.certified_error_m,
            measured_error_m: if core.measured_error_m < 0.0 {
                self.status.measured_error_m
            } else {
                core.measured_error_m
            },
            finest_tolerance_m: core.finest_tolerance_m,
            refined_faces: u64::from(core.active_faces),
            cache_bytes: core.cache_bytes,
            vsps: u64::from(core.vsps_loaded),
            missed: result.missed,
            station: record.station != 0,
            ready: core.ready,
        }
    }

    fn push_timing(&mut self, record: &TickRecord) {
        let result = &mut self.result;
        result.ticks += 1;
        result.missed += u64::from(record.skipped);
        for miss in record.misses {
            result.misses.count(miss.class, u64::from(miss.periods));
        }
        result.page_faults += u64::from(record.page_faults);
        // A tick that used up its period is told with the next one.
        if record.misses[0].class.is_ours() {
            result.page_faults_missed += u64::from(self.last_page_faults);
        }
        self.last_page_faults = record.page_faults;
        result.allocations += u64::from(record.allocations);
        result.extra_switches += u64::from(record.extra_switches);
        if self.first_tick.is_none() {
            self.first_tick = Some(record.tick);
            self.phase_ns = record
                .planned_ns
                .wrapping_sub(self.planned_periods_ns(record));
        } else {
            // The first tick has none before it.
            push_ns(&mut self.period, record.period_ns);
            push_ns(&mut self.record, record.record_ns);
        }
        let drift = self.drift_ns(record);
        let result = &mut self.result;
        result.drift_ns_max = result.drift_ns_max.max(drift);
        result.unaccounted_periods = record.tick as i64 + 1 - (result.ticks + result.missed) as i64;
        self.last_tick = record.tick;
        self.spun_ns += u64::from(record.spun_ns);
        push_ns(&mut self.wake, record.wake_ns);
        push_ns(&mut self.work_cpu, record.work_cpu_ns);
        push_ns(&mut self.work_wall, record.work_wall_ns);
        for (stage, &ns) in self.stages.iter_mut().zip(&record.stage_ns) {
            push_ns(stage, ns);
        }
    }

    /// From t0 to the planned wake-up before a tick, ns: the sleep may have lost periods.
    fn planned_periods_ns(&self, record: &TickRecord) -> u64 {
        let lost = u64::from(record.misses[1].periods);
        record.tick.saturating_sub(lost) * self.period_ns
    }

    /// Deviation of a tick from t0 + k T, ns: of its planned wake-up, and of its start where that
    /// is not in its own period. t0 is that of the first tick.
    fn drift_ns(&self, record: &TickRecord) -> u64 {
        let planned = self.phase_ns.wrapping_add(self.planned_periods_ns(record));
        let due = self.phase_ns.wrapping_add(record.tick * self.period_ns);
        let early = due.saturating_sub(record.start_ns);
        let last = due.saturating_add(self.period_ns.saturating_sub(1));
        let late = record.start_ns.saturating_sub(last);
        planned.abs_diff(record.planned_ns).max(early).max(late)
    }

    /// State of the run after the last tick.
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

    /// Names of the figures of which a value was not finite.
    fn non_finite(&self) -> Vec<String> {
        let result = &self.result;
        let per_period = result.force_step_per_period_n_max;
        let tables = [
            ("certified_error_m", &self.certified),
            ("finest_tolerance_m", &self.finest),
            ("expected_error_m", &self.expected),
            ("measured_error_m", &self.measured),
            ("force_withheld", &self.withheld),
        ];
        let tables = tables.map(|(name, of)| (name.to_string(), of.is_finite));
        let forces = (
            "force_n".to_string(),
            self.forces.iter().all(|of| of.is_finite),
        );
        let numbers = [
            ("force_step_n_max", result.force_step_n_max),
            ("force_step_per_period_n_max", per_period),
            ("force_cut_n_max", result.force_cut_n_max),
            ("torque_nm_max", result.torque_nm_max),
            ("depth_m_max", result.depth_m_max),
            ("energy_j", result.energy_j),
            ("energy_j_max", result.energy_j_max),
        ];
        let numbers = numbers.map(|(name, of)| (name.to_string(), of.is_finite()));
        let probes = result.probes.iter().zip(&self.forces).enumerate();
        let probes = probes.flat_map(|(k, (probe, force))| {
            let of_probe = [
                ("force_n", force.is_finite),
                ("energy_j", probe.energy_j.is_finite()),
                (
                    "certified_error_m_max",
                    probe.certified_error_m_max.is_finite(),
                ),
                ("depth_m_max", probe.depth_m_max.is_finite()),
            ];
            of_probe.map(|(name, is_finite)| (format!("probes/{k}/{name}"), is_finite))
        });
        let all = tables
            .into_iter()
            .chain([forces])
            .chain(numbers)
            .chain(probes);
        all.filter(|(_, is_finite)| !is_finite)
            .map(|(name, _)| name)
            .collect()
    }

    /// Stations with their times; `ms_at`: the time of a tick.
    fn stations_heard(&self, ms_at: impl Fn(u64) -> f64) -> Vec<StationHeard> {
        let heard = |&(first, synchronised): &(u64, Option<u64>)| StationHeard {
            heard_ms: ms_at(first),
            synchronised_ms: synchronised.map_or(-1.0, &ms_at),
        };
        self.stations.iter().map(heard).collect()
    }

    /// What came first; `ms_at`: the time of a tick.
    fn time_firsts(&mut self, ms_at: impl Fn(u64) -> f64) {
        let or_zero = |tick: Option<u64>| tick.map_or(0.0, &ms_at);
        let to_full = self.full_tick.zip(self.touch_tick);
        let to_full_ms = to_full.map(|(full, touch)| ms_at(full) - ms_at(touch));
        let result = &mut self.result;
        result.first_heard_ms = or_zero(self.stations.first().map(|of| of.0));
        result.first_force_ready_ms = or_zero(self.ready_tick);
        result.first_touch_ms = or_zero(self.touch_tick);
        result.first_full_ms = to_full_ms.unwrap_or(-1.0);
    }

    fn histograms(&self) -> Histograms {
        Histograms {
            wake_ns: self.wake.buckets(),
            work_cpu_ns: self.work_cpu.buckets(),
            work_wall_ns: self.work_wall.buckets(),
            period_ns: self.period.buckets(),
        }
    }

    /// The figures of the whole run.
    #[must_use]
    pub fn finish(mut self, meta: RunMeta) -> Finished {
        let non_finite = self.non_finite();
        let seconds = self.seconds();
        let period_s = self.period_s();
        let ms_at = |tick: u64| meta.start_to_first_tick_ms + tick as f64 * period_s * 1e3;
        self.time_firsts(ms_at);
        let stations = self.stations_heard(ms_at);
        let histograms = self.histograms();
        let series = self.series.finish(period_s);
        let named = |(name, stage): (&&str, &Fixed)| ((*name).to_string(), stage.spread());
        let stage_us = STAGES.iter().zip(&self.stages).map(named).collect();
        let (refined_faces, awake) = (self.faces.median_max(), self.awake.median_max());
        let broad_phase = self.stages.last().map(Fixed::spread).unwrap_or_default();
        for (probe, force) in self.result.probes.iter_mut().zip(&self.forces) {
            probe.force_n = force.short();
        }
        let force = self.forces.into_iter().reduce(Fixed::together);
        let result = RunResult {
            scene: meta.scene,
            model: meta.model,
            faces: meta.faces,
            seconds,
            seed: meta.seed,
            missed_own_cpu: self.result.misses.ours(),
            period_us: self.period.spread(),
            spun_us_mean: self.spun_ns as f64
                / (NANOSECONDS_IN_US * self.result.ticks.max(1) as f64),
            wake_us: self.wake.spread(),
            work_us: self.work_cpu.spread(),
            work_wall_us: self.work_wall.spread(),
            stage_us,
            record_us: self.record.spread(),
            refined_faces,
            certified_error_m: self.certified.short(),
            measured_error_m: self.measured.short(),
            finest_tolerance_m: self.finest.short(),
            expected_error_m: self.expected.short(),
            force_withheld: self.withheld.short(),
            objects: meta.objects,
            active_objects_max: meta.active_objects_max,
            awake,
            idle_us: broad_phase,
            force_n: force.as_ref().map(Fixed::short).unwrap_or_default(),
            bytes_full_mesh: meta.bytes_full_mesh,
            cache: CacheResult {
                bytes: meta.cache_bytes,
                ..self.result.cache
            },
            hrtc_rss_bytes: meta.rss_bytes.peak,
            hrtc_rss_parts: meta.rss_bytes.parts,
            slow: meta.slow,
            operations_budget: meta.operations_budget,
            query_work_budget: meta.query_work_budget,
            safety: meta.safety,
            governor: self.governor.result(&meta.costs, self.period_ns),
            non_finite,
            ..self.result
        };
        Finished {
            result,
            series,
            histograms,
            rights: meta.rights,
            stations,
        }
    }
}

impl ProbeResult {
    /// Counts one tick of the probe.
    fn add(&mut self, record: &ProbeRecord) {
        self.clamped_ticks += u64::from(record.clamped);
        self.rejected_samples += u64::from(record.rejected_sample);
        self.energy_j = last_or_nan(self.energy_j, record.energy_j);
        if record.contact {
            self.contact_ticks += 1;
            self.contact_full_ticks += u64::from(record.contact_full);
            self.coarser_ticks += u64::from(!record.contact_asked);
            if record.contact_bounded {
                let certified = record.certified_error_m;
                self.certified_error_m_max = max_or_nan(self.certified_error_m_max, certified);
            }
            self.depth_m_max = max_or_nan(self.depth_m_max, record.depth_m);
        }
    }
}

/// A quantity in another unit; -1 for none, which is negative in any.
fn times_or_none(factor: f64, value: f64) -> f64 {
    if value < 0.0 { -1.0 } else { factor * value }
}

fn push_ns(table: &mut Fixed, ns: u32) {
    table.push(f64::from(ns) / NANOSECONDS_IN_US);
}
