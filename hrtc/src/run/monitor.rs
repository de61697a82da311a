//! The main thread of a run: drains the log, reports what happens, prints the result.

use super::outcome::{self, RunError, rights};
use super::shared::Shared;
use super::tick_thread::TickThreadEnd;
use super::{OpenRecording, Output, RunArgs};
use crate::result::{Accumulator, Finished, RunMeta, SupervisedLine};
use crate::tick_record::TickRecord;
use crate::tuning::{DRAIN_PERIOD, STATION_ABSENT_NS, STATUS_PERIOD_NS};
use hrtc_core::Fault;
use hrtc_core::contact::sphere_proxy::MAX_CONSTRAINTS;
use realtime::rights::monotonic_ns;
use rtrb::Consumer;
use scene::{ScenePlan, TrajectoryPlan};
use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// The main thread's view of a run.
pub(super) struct Monitor<'a> {
    pub args: &'a RunArgs,
    /// The plan, with the limits of the devices in it.
    pub plan: &'a ScenePlan,
    pub shared: &'a Shared,
    /// Protocol version of a foreign peer; 0 when none was heard.
    pub other_version: &'a AtomicU32,
    /// Start of both processes on CLOCK_MONOTONIC, ns.
    pub started_ns: u64,
}

/// Messages that were printed already.
#[derive(Default)]
struct Printed {
    rights: bool,
    station_found: bool,
    station_absent: bool,
    other_version: u32,
    /// Faults of objects.
    faults: Vec<(usize, Fault)>,
}

impl Monitor<'_> {
    /// Drains the log until the tick has ended.
    pub fn drain(
        &self,
        mut log: Consumer<TickRecord>,
        mut recording: Option<OpenRecording>,
        stop: &AtomicBool,
    ) -> Result<Accumulator, RunError> {
        let period_ns = (1e9 / self.plan.loop_.rate_hz).round() as u64;
        let mut run =
            Accumulator::new(period_ns, self.plan.probes.len()).ok_or(RunError::Histogram)?;
        let mut next_status = 0;
        let mut printed = Printed::default();
        let mut error = None;
        loop {
            // Read before the log, so that no record comes after the last look.
            let ended = self.shared.ended.load(Ordering::Acquire);
            drain_once(&mut log, &mut recording, &mut run)?;
            if ended {
                break;
            }
            error = error.or_else(|| self.check(&mut printed));
            if error.is_some() || stop.load(Ordering::Relaxed) {
                self.shared.stop.store(true, Ordering::Relaxed);
            }
            let now = monotonic_ns();
            if self.args.output == Output::Supervised && now >= next_status {
                next_status = now + STATUS_PERIOD_NS;
                let mut status = run.status();
                status.station = self.shared.station.load(Ordering::Relaxed) != 0;
                print_line(&SupervisedLine::Status { status })?;
            }
            std::thread::sleep(DRAIN_PERIOD);
        }
        if let Some((file, _)) = recording {
            file.finish()?;
        }
        match error {
            Some(error) => Err(error),
            None => Ok(run),
        }
    }

    /// Prints news; returns an error that ends the run.
    fn check(&self, printed: &mut Printed) -> Option<RunError> {
        if let Some(fault) = *self.shared.fault.lock().unwrap_or_else(|e| e.into_inner()) {
            return Some(RunError::Fault(fault));
        }
        if self.shared.ticking.load(Ordering::Acquire) && !printed.rights {
            printed.rights = true;
            let missing = self.shared.missing.lock();
            let missing = missing.unwrap_or_else(|e| e.into_inner());
            if let (Some(first), true) = (missing.first(), self.plan.loop_.require_realtime) {
                return Some(RunError::Right(first.to_string()));
            }
            for right in missing.iter() {
                eprintln!("hrtc: {right}");
            }
        }
        let other = self.other_version.load(Ordering::Relaxed);
        if other != 0 && other != printed.other_version {
            printed.other_version = other;
            eprintln!(
                "hrtc: a station here speaks protocol version {other}, this program another: install the same release on both sides"
            );
        }
        self.check_objects(printed);
        self.check_station(printed);
        None
    }

    /// Prints the faults of objects, each once, while the run goes on.
    fn check_objects(&self, printed: &mut Printed) {
        let faults = self.shared.object_faults.lock();
        let faults = faults.unwrap_or_else(|e| e.into_inner()).clone();
        for &fault in faults
            .iter()
            .filter(|fault| !printed.faults.contains(fault))
        {
            eprintln!("hrtc: {}", outcome::object_fault(self.plan, fault));
        }
        printed.faults = faults;
    }

    /// Prints that the station has come, has gone, or has not come yet.
    fn check_station(&self, printed: &mut Printed) {
        let domain = &self.args.domain;
        let is_alive = self.shared.station.load(Ordering::Relaxed) != 0;
        if is_alive && !printed.station_found {
            printed.station_found = true;
            eprintln!("hrtc: station found in domain {domain}");
        } else if !is_alive && printed.station_found {
            printed.station_found = false;
            printed.station_absent = true;
            eprintln!("hrtc: the station is gone; contact continues with the loaded mesh");
        } else if !is_alive
            && !printed.station_absent
            && monotonic_ns() > self.started_ns + STATION_ABSENT_NS
        {
            printed.station_absent = true;
            eprintln!(
                "hrtc: no station in domain {domain} yet: ticking without a model until one starts (ve-station serve {})",
                self.args.scene.display()
            );
        }
    }

    /// Prints the result.
    pub fn finish(&self, run: Accumulator, end: &TickThreadEnd) -> Result<(), RunError> {
        let controller = &end.controller;
        let mut finished = run.finish(self.meta(end));
        finished.result.cache.high_water_bytes = controller.bytes_high_water() as u64;
        outcome::add_lod(&mut finished.result, controller, self.plan.loop_.rate_hz);
        let faults = controller.faults();
        let named = faults.map(|fault| outcome::object_fault(self.plan, fault));
        finished.result.faults = named.collect();
        finished.result.capacities.extend_from_slice(&end.rings);
        self.print_losses(end);
        self.print_result(finished)
    }

    fn meta(&self, end: &TickThreadEnd) -> RunMeta {
        let controller = &end.controller;
        let first = self.shared.first_tick_ns.load(Ordering::Relaxed);
        let seed = match &self.plan.probes[0].trajectory {
            TrajectoryPlan::Tour { seed, .. } => *seed,
            TrajectoryPlan::Points(_) => 0,
        };
        let missing = self.shared.missing.lock();
        let missing = missing.unwrap_or_else(|e| e.into_inner());
        RunMeta {
            scene: self.plan.name.clone(),
            model: self.plan.objects[0].model.name(),
            faces: controller.header().map_or(0, |h| u64::from(h.faces)),
            seed,
            cache_bytes: self.plan.cache_bytes as u64,
            bytes_full_mesh: controller.headers().map(outcome::bytes_full_mesh).sum(),
            objects: self.plan.objects.len() as u64,
            active_objects_max: self.plan.active_objects() as u64,
            rss_bytes: outcome::resident_bytes(),
            start_to_first_tick_ms: first.saturating_sub(self.started_ns) as f64 / 1e6,
            operations_budget: u64::from(end.work_budget),
            rights: rights(&self.plan.loop_, &missing),
        }
    }

    /// Prints the numbers of dropped and refused items.
    fn print_losses(&self, end: &TickThreadEnd) {
        let dropped = self.shared.log_dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            eprintln!("hrtc: {dropped} tick records found the log full and are not in the figures");
        }
        let rejected = end.controller.rejected_samples();
        if rejected > 0 {
            eprintln!(
                "hrtc: {rejected} samples of the devices were rejected: they were no numbers, or no motion within the device's limits leads to them"
            );
        }
        let (refused, last) = end.controller.refused();
        if refused > 0 {
            eprintln!(
                "hrtc: {refused} regions were refused or did not fit the mesh, the last one {last:#x}; they stayed coarse"
            );
        }
        let constraints = end.controller.dropped_constraints();
        if constraints > 0 {
            eprintln!(
                "hrtc: {constraints} times a face at the contact found no room beside {MAX_CONSTRAINTS} deeper ones; the probe was swept against it instead"
            );
        }
    }

    fn print_result(&self, finished: Finished) -> Result<(), RunError> {
        match self.args.output {
            Output::Supervised => print_line(&SupervisedLine::Finished(Box::new(finished))),
            Output::Json => print_line(&finished.result),
            Output::Text => {
                outcome::print_text(&finished);
                Ok(())
            }
        }
    }
}

/// Takes all waiting records and chunks.
fn drain_once(
    log: &mut Consumer<TickRecord>,
    recording: &mut Option<OpenRecording>,
    run: &mut Accumulator,
) -> Result<(), RunError> {
    while let Ok(record) = log.pop() {
        run.push(&record);
        if let Some((file, _)) = recording {
            file.tick(&record)?;
        }
    }
    if let Some((file, chunks)) = recording {
        for chunk in chunks.try_iter() {
            file.chunk(&chunk)?;
        }
    }
    Ok(())
}

fn print_line(value: &impl serde::Serialize) -> Result<(), RunError> {
    let line = serde_json::to_string(value).map_err(|e| RunError::Print(e.into()))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")
        .and_then(|()| out.flush())
        .map_err(RunError::Print)
}
