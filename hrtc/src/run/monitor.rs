//! The main thread of a run: drains the log, reports what happens, prints the result. It writes
//! nothing itself before the tick has ended: result and recording are fed by what it drains.
//!
//! No error here may leave the tick alone with a force on the hand: the loop ends only when the
//! tick has ended. A recording that cannot be written loses records with a message; an output that
//! cannot be written ends the run with its ramp.

use super::outcome::{self, RunError, rights};
use super::recording::RunRecording;
use super::shared::Shared;
use super::status_lines::StatusLines;
use super::tick_thread::TickThreadEnd;
use super::watchdog::Watchdog;
use super::{Output, RunArgs, StopFlags};
use crate::link::LinkHandle;
use crate::message::note;
use crate::result::{Accumulator, Finished, RunMeta, SupervisedLine};
use crate::tick_record::TickRecord;
use crate::tuning::{
    DRAIN_PERIOD, OFF_TIMEOUT, RECORDER_NICE, STATION_ABSENT_NS, STATUS_PERIOD_NS,
};
use hrtc_core::contact::sphere_proxy::MAX_CONSTRAINTS;
use hrtc_core::governor::WorkCosts;
use hrtc_core::{Capacity, Controller, Fault};
use realtime::rights::{hold_nice, monotonic_ns};
use rtrb::Consumer;
use scene::{ScenePlan, TrajectoryPlan};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::Instant;

/// The main thread's view of a run.
pub(super) struct Monitor<'a> {
    pub args: &'a RunArgs,
    /// The plan, with the limits of the devices in it.
    pub plan: &'a ScenePlan,
    /// Most force by the devices and the command line, newtons.
    pub max_force_n: f64,
    pub shared: &'a Shared,
    /// Start of both processes on CLOCK_MONOTONIC, ns.
    pub started_ns: u64,
    pub is_recorded: bool,
    pub link: &'a LinkHandle,
    pub watchdog: &'a Watchdog,
}

/// What the main thread has gathered when the tick has ended.
pub(super) struct Drained {
    pub run: Accumulator,
    pub recording_errors: u64,
    /// Rings of the recorder; none without one.
    pub recorder_rings: Vec<Capacity>,
    /// The first file of the recording.
    pub recording: Option<PathBuf>,
    /// Those of a supervised run.
    pub status_lines: StatusLines,
    /// The first error that ended the run.
    pub error: Option<RunError>,
}

/// Messages that were printed already.
#[derive(Default)]
struct Printed {
    rights: bool,
    /// When the link began to listen for a station, on CLOCK_MONOTONIC, ns: later than the run,
    /// which may have fetched its scene and measured the machine before.
    linked_ns: u64,
    station_found: bool,
    station_absent: bool,
    /// Faults of objects.
    faults: Vec<(usize, Fault)>,
    expiries: u64,
    requests_lost: u64,
}

/// What has become of the station.
#[derive(Debug, PartialEq, Eq)]
enum StationNews {
    Found,
    Gone,
    /// It has not come yet.
    Absent,
}

impl Printed {
    /// Whether there is something new to say of the station at this time on CLOCK_MONOTONIC.
    fn station_news(&mut self, is_alive: bool, now_ns: u64) -> Option<StationNews> {
        let is_late = now_ns > self.linked_ns + STATION_ABSENT_NS;
        if is_alive && !self.station_found {
            self.station_found = true;
            Some(StationNews::Found)
        } else if !is_alive && self.station_found {
            self.station_found = false;
            self.station_absent = true;
            Some(StationNews::Gone)
        } else if !is_alive && !self.station_absent && is_late {
            self.station_absent = true;
            Some(StationNews::Absent)
        } else {
            None
        }
    }
}

impl Monitor<'_> {
    /// Drains the log until the tick has ended, or does not answer a second request to stop.
    pub fn drain(
        &self,
        run: Accumulator,
        mut log: Consumer<TickRecord>,
        mut recording: Option<&mut RunRecording>,
        stop: StopFlags<'_>,
    ) -> Drained {
        let mut drained = Drained {
            run,
            recording_errors: 0,
            recorder_rings: Vec::new(),
            recording: None,
            status_lines: StatusLines::default(),
            error: None,
        };
        if self.args.output == Output::Supervised {
            match StatusLines::start(std::io::stdout()) {
                Ok(lines) => drained.status_lines = lines,
                Err(error) => drained.error = Some(error),
            }
        }
        let mut next_status = 0;
        let mut printed = Printed {
            linked_ns: monotonic_ns(),
            ..Printed::default()
        };
        let mut off_since = None;
        // It feeds the recorder, whose thread is told of a refusal.
        let _precedence = recording.is_some().then(|| hold_nice(RECORDER_NICE));
        loop {
            // Read before the log, so that no record comes after the last look.
            let ended = self.shared.ended.load(Ordering::Acquire);
            drain_once(&mut log, recording.as_deref_mut(), &mut drained.run);
            if ended {
                if self.shared.off.load(Ordering::Acquire) {
                    drained.error.get_or_insert(RunError::SwitchedOff);
                }
                break;
            }
            let error = self.check(&mut printed);
            drained.error = drained.error.or(error);
            if drained.error.is_some() || stop.with_ramp.load(Ordering::Relaxed) {
                self.shared.stop.store(true, Ordering::Relaxed);
            }
            if stop.at_once.load(Ordering::Relaxed) {
                drained.error.get_or_insert(RunError::SwitchedOff);
                let since = *off_since.get_or_insert_with(|| self.switch_off());
                if since.elapsed() > OFF_TIMEOUT {
                    drained.error = Some(RunError::TickHangs);
                    return drained;
                }
            }
            let now = monotonic_ns();
            if self.args.output == Output::Supervised && now >= next_status {
                next_status = now + STATUS_PERIOD_NS;
                let mut status = drained.run.status();
                status.station = self.shared.station.load(Ordering::Relaxed) != 0;
                let told = drained.status_lines.tell(status);
                drained.error = drained.error.or(told.err());
            }
            std::thread::sleep(DRAIN_PERIOD);
        }
        if let Some(recording) = recording {
            drained.recording_errors = u64::from(recording.has_lost());
            drained.recorder_rings = recording.capacities();
            drained.recording = Some(recording.first().to_owned());
        }
        drained
    }

    /// Has tick and watchdog switch the devices off.
    fn switch_off(&self) -> Instant {
        self.shared.off.store(true, Ordering::Release);
        self.watchdog.wake();
        Instant::now()
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
            let first = missing.iter().find(|of| of.right.is_of_loop());
            if let (Some(first), true) = (first, self.plan.loop_.require_realtime) {
                return Some(RunError::Right(first.to_string()));
            }
            for right in missing.iter() {
                note!("{right}");
            }
        }
        self.check_objects(printed);
        self.check_station(printed);
        self.check_safety(printed);
        self.link.has_ended().then_some(RunError::LinkEnded)
    }

    /// Prints what the chain of safety did.
    fn check_safety(&self, printed: &mut Printed) {
        let expiries = self.shared.expiries.load(Ordering::Relaxed);
        if expiries > printed.expiries {
            printed.expiries = expiries;
            let done = self.watchdog.what_ends_a_force(self.plan.probes.len());
            note!(
                "no wrench was written for longer than one is valid: {done}; the force will rise from zero ({expiries} times so far)"
            );
        }
        let lost = self.shared.requests_lost.load(Ordering::Relaxed);
        if lost > 0 && printed.requests_lost == 0 {
            printed.requests_lost = lost;
            note!("the ring of requests to the link is full; what was lost is asked for again");
        }
    }

    /// Prints the faults of objects, each once, while the run goes on.
    fn check_objects(&self, printed: &mut Printed) {
        let faults = self.shared.object_faults.lock();
        let faults = faults.unwrap_or_else(|e| e.into_inner()).clone();
        for &fault in faults
            .iter()
            .filter(|fault| !printed.faults.contains(fault))
        {
            note!("{}", outcome::object_fault(self.plan, fault));
        }
        printed.faults = faults;
    }

    /// Prints that the station has come, has gone, or has not come yet.
    fn check_station(&self, printed: &mut Printed) {
        let domain = &self.args.domain;
        let is_alive = self.shared.station.load(Ordering::Relaxed) != 0;
        match printed.station_news(is_alive, monotonic_ns()) {
            Some(StationNews::Found) => note!("station found in domain {domain}"),
            Some(StationNews::Gone) => {
                note!("the station is gone; contact continues with the loaded mesh");
            }
            Some(StationNews::Absent) => self.note_absent_station(),
            None => {}
        }
    }

    /// Prints that the station has not come yet, and what to do.
    fn note_absent_station(&self) {
        let domain = &self.args.domain;
        let scene = self.args.scene.as_deref().unwrap_or(Path::new("SCENE"));
        let scene = scene.display();
        match &self.args.station {
            Some(address) => note!(
                "no station at {address} yet: ticking without a model until it answers (on that machine: ve-station serve {scene} --listen ADDRESS; a refusal is told in a line of the link)"
            ),
            None => note!(
                "no station in domain {domain} yet: ticking without a model until one of the same user starts (ve-station serve {scene})"
            ),
        }
    }

    /// Prints the result, as far as it is known, unless the run ended by an error that leaves none.
    pub fn conclude(
        &self,
        mut drained: Drained,
        end: Option<TickThreadEnd>,
    ) -> Result<(), RunError> {
        use RunError::{Fault, Right, SwitchedOff, TickHangs};
        let error = drained.error.take();
        let has_result = !matches!(error, Some(Fault(_) | Right(_) | SwitchedOff | TickHangs));
        let Some(end) = end.filter(|end| has_result || end.panic.is_some()) else {
            return error.map_or(Ok(()), Err);
        };
        let printed = self.finish(drained, &end);
        let panicked = end.panic.map(RunError::TickPanicked);
        match panicked.or(error) {
            Some(error) => Err(error),
            None => printed,
        }
    }

    fn finish(&self, mut drained: Drained, end: &TickThreadEnd) -> Result<(), RunError> {
        let mut finished = drained.run.finish(self.meta(end));
        let result = &mut finished.result;
        result.safety.tick_panics = u64::from(end.panic.is_some());
        result.safety.recording_errors = drained.recording_errors;
        result.force_limit_n = self.plan.safety.force_max_n.min(self.max_force_n);
        result.link_bytes = self.shared.traffic.bytes();
        // Negative: it was never the limit.
        if result.bytes_received > 0 && result.link_mbit_per_s >= 0.0 {
            // The tick counts whole chunks; over a line they travel compact.
            let travelled = result.link_bytes.chunks() as f64 / result.bytes_received as f64;
            result.link_mbit_per_s *= travelled;
        }
        if let Some(controller) = &end.controller {
            result.cache.high_water_bytes = controller.bytes_high_water() as u64;
            outcome::add_lod(result, controller, self.plan.loop_.rate_hz);
            let faults = controller.faults();
            let named = faults.map(|fault| outcome::object_fault(self.plan, fault));
            result.faults = named.collect();
        }
        result.capacities.extend_from_slice(&end.rings);
        result.capacities.extend(drained.recorder_rings);
        self.print_losses(end);
        let non_finite = finished.result.non_finite.join(", ");
        // The result is the last line.
        drained.status_lines.finish()?;
        self.print_result(finished, drained.recording.as_deref())?;
        if non_finite.is_empty() {
            Ok(())
        } else {
            Err(RunError::NonFinite(non_finite))
        }
    }

    fn meta(&self, end: &TickThreadEnd) -> RunMeta {
        let controller = end.controller.as_deref();
        let first = self.shared.first_tick_ns.load(Ordering::Relaxed);
        let seed = match &self.plan.probes[0].trajectory {
            TrajectoryPlan::Tour { seed, .. } => *seed,
            TrajectoryPlan::Points(_) => 0,
        };
        let missing = self.shared.missing.lock();
        let missing = missing.unwrap_or_else(|e| e.into_inner());
        let header = controller.and_then(Controller::header);
        let headers = controller.into_iter().flat_map(Controller::headers);
        RunMeta {
            scene: self.plan.name.clone(),
            model: self.plan.objects[0].model.name(),
            faces: header.map_or(0, |h| u64::from(h.faces)),
            seed,
            cache_bytes: self.plan.cache_bytes as u64,
            bytes_full_mesh: headers.map(outcome::bytes_full_mesh).sum(),
            objects: self.plan.objects.len() as u64,
            active_objects_max: self.plan.active_objects() as u64,
            rss_bytes: outcome::resident_bytes(),
            start_to_first_tick_ms: first.saturating_sub(self.started_ns) as f64 / 1e6,
            slow: self.args.slow,
            operations_budget: u64::from(end.work_budget),
            query_work_budget: u64::from(end.query_budget),
            costs: controller.map_or(WorkCosts::REFERENCE, |of| *of.governor().costs()),
            safety: self.shared.events(),
            rights: rights(&self.plan.loop_, self.is_recorded, &missing),
        }
    }

    /// Prints the numbers of dropped and refused items.
    fn print_losses(&self, end: &TickThreadEnd) {
        let dropped = self.shared.log_dropped.load(Ordering::Relaxed);
        if dropped > 0 {
            note!("{dropped} tick records found the log full and are not in the figures");
        }
        let Some(controller) = &end.controller else {
            return;
        };
        let rejected = controller.rejected_samples();
        if rejected > 0 {
            note!(
                "{rejected} samples of the devices were rejected: they were no numbers, or no motion within the device's limits leads to them"
            );
        }
        let (refused, last) = controller.refused();
        if refused > 0 {
            note!(
                "{refused} regions were refused or did not fit the mesh, the last one {last:#x}; they stayed coarse"
            );
        }
        let constraints = controller.dropped_constraints();
        if constraints > 0 {
            note!(
                "{constraints} times a face at the contact found no room beside {MAX_CONSTRAINTS} deeper ones; the probe was swept against it instead"
            );
        }
    }

    fn print_result(&self, finished: Finished, recording: Option<&Path>) -> Result<(), RunError> {
        match self.args.output {
            // A supervisor that is gone lacks the result.
            Output::Supervised => print_line(&SupervisedLine::Finished(Box::new(finished))),
            Output::Json => or_unread(print_line(&finished.result)),
            Output::Text => {
                let printed = outcome::print_text(&finished, recording);
                or_unread(printed.map_err(RunError::Print))
            }
        }
    }
}

/// A reader that went away (`| head`) is no error.
fn or_unread(printed: Result<(), RunError>) -> Result<(), RunError> {
    match printed {
        Err(RunError::Print(error)) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        printed => printed,
    }
}

/// Takes all waiting records.
fn drain_once(
    log: &mut Consumer<TickRecord>,
    mut recording: Option<&mut RunRecording>,
    run: &mut Accumulator,
) {
    while let Ok(record) = log.pop() {
        run.push(&record);
        if let Some(recording) = &mut recording {
            recording.push(&record);
        }
    }
}

fn print_line(value: &impl serde::Serialize) -> Result<(), RunError> {
    let line = serde_json::to_string(value).map_err(|e| RunError::Print(e.into()))?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}")
        .and_then(|()| out.flush())
        .map_err(RunError::Print)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_station_is_absent_some_time_after_the_link_began_and_each_news_is_told_once() {
        const LINKED_NS: u64 = 20_000_000_000;
        let mut printed = Printed {
            linked_ns: LINKED_NS,
            ..Printed::default()
        };
        let late_ns = LINKED_NS + STATION_ABSENT_NS + 1;
        // The run is older.
        assert_eq!(printed.station_news(false, late_ns - 1), None);
        assert_eq!(
            printed.station_news(false, late_ns),
            Some(StationNews::Absent)
        );
        for (is_alive, expected) in [
            (false, None),
            (true, Some(StationNews::Found)),
            (true, None),
            (false, Some(StationNews::Gone)),
            (false, None),
        ] {
            assert_eq!(printed.station_news(is_alive, late_ns), expected);
        }
    }

    #[test]
    fn a_reader_that_went_away_is_no_error_and_a_full_disk_is() {
        let of = |kind: ErrorKind| or_unread(Err(RunError::Print(kind.into())));
        assert!(or_unread(Ok(())).is_ok() && of(ErrorKind::BrokenPipe).is_ok());
        assert!(of(ErrorKind::StorageFull).is_err());
    }
}
