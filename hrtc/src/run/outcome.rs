//! How a run ends: errors of one sentence, figures, and the few lines for a person.

use crate::fetch::FetchError;
use crate::link::LinkError;
use crate::recorder::RecordingError;
use crate::result::{Finished, ResidentBytes, Right, RunResult, folded};
use crate::tuning::RECORDER_NICE;
use hrtc_core::{Controller, Fault};
use realtime::rights::MissingRight;
use scene::{LoopPlan, SceneError, ScenePlan};
use spm::VspRecord;
use spm::{BaseFace, BaseVertex, ModelHeader};
use std::io::Write;
use std::path::{Path, PathBuf};
use thiserror::Error;
use transport::TransportError;

/// Reasons of a run without a result: one sentence each.
#[derive(Debug, Error)]
pub enum RunError {
    /// The scene cannot be read or is refused.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// The station's scene is not here.
    #[error("{0}")]
    Fetch(#[from] FetchError),
    /// The iceoryx2 domain cannot be used.
    #[error("{0}")]
    Transport(#[from] TransportError),
    /// The thread of the link did not start.
    #[error("{0}")]
    Link(#[from] LinkError),
    /// The recording cannot be written.
    #[error("{0}")]
    Recording(#[from] RecordingError),
    /// The controller found a fault in the model.
    #[error("{0}")]
    Fault(Fault),
    /// Figures that are no numbers: a defect of hrtc.
    #[error(
        "values that are not finite were met, by a defect in hrtc; the result leaves them out: {0}"
    )]
    NonFinite(String),
    /// The scene requires a right that is missing.
    #[error("the scene says require_realtime = true, but {0}")]
    Right(String),
    /// The machine is too slow for the plan.
    #[error("{0}")]
    TooSlow(String),
    /// The operating system gave no thread of this name.
    #[error("cannot start the thread {0}: {1}")]
    Thread(&'static str, std::io::Error),
    /// The tick thread panicked: a defect of hrtc, or of a device's driver.
    #[error(
        "the thread of the tick ended by a defect in hrtc or in a device's driver ({0}); the force was ramped down and the devices are off; please report this sentence, with the black box where one is named"
    )]
    TickPanicked(String),
    /// The thread of the link ended by itself: a defect of hrtc.
    #[error(
        "the thread of the link to the station ended by a defect in hrtc; the run ended with a ramp; please report what it printed above"
    )]
    LinkEnded,
    /// A second Ctrl-C came.
    #[error("switched off at once by a second Ctrl-C, without a ramp and without a result")]
    SwitchedOff,
    /// A second Ctrl-C came, and the tick thread did not answer.
    #[error(
        "ended at once by a second Ctrl-C, though the thread of the tick hangs; devices without a safe stop go to zero when their last wrench expires"
    )]
    TickHangs,
    /// Standard output cannot be written.
    #[error("cannot print the result: {0}")]
    Print(std::io::Error),
}

impl RunError {
    /// Whether a defect or a damaged model ended the run, so that its last seconds are worth a file
    /// of their own: not a request, a missing right, or what could not begin or be printed.
    pub(super) fn is_fault(&self) -> bool {
        matches!(
            self,
            Self::TickPanicked(_)
                | Self::TickHangs
                | Self::LinkEnded
                | Self::Fault(_)
                | Self::NonFinite(_)
        )
    }
}

/// Adds the figures that only the controller has: its level of detail, its capacities and the
/// objects that moved.
pub(super) fn add_lod(result: &mut RunResult, controller: &Controller, rate_hz: f64) {
    result.tolerance_m = controller.tolerance_m();
    result.capacities = controller.capacities();
    result.moved = controller.movables().report();
    result.front_hash = folded(controller.front_hash());
    let offsets = controller.active_objects().iter();
    let offsets = offsets.map(|object| object.contact_offset_m());
    result.contact_offset_m = offsets.fold(0.0, f64::max);
    let first = controller
        .active_objects()
        .iter()
        .find(|object| object.is_ready());
    if let Some((object, lod, frame)) = first.and_then(|s| Some((s, s.lod()?, s.frame()?))) {
        let scale = frame.metres_per_unit;
        let rings = lod.rings().iter();
        result.rings_m = rings.map(|r| f64::from(r.tolerance) * scale).collect();
        result.greatest_speed_m_per_s = object.greatest_speed() * scale * rate_hz;
    }
}

/// The fault of an object in one sentence with its name; the run goes on.
pub(super) fn object_fault(plan: &ScenePlan, (object, fault): (usize, Fault)) -> String {
    let model = plan.objects.get(object).map(|of| of.model.name());
    let model = model.unwrap_or_default();
    format!("object {object} ({model}): {fault}")
}

/// Bytes of the whole mesh as the station would send it: base mesh and records.
pub(super) fn bytes_full_mesh(header: &ModelHeader) -> u64 {
    u64::from(header.base_vertices) * size_of::<BaseVertex>() as u64
        + u64::from(header.base_faces) * size_of::<BaseFace>() as u64
        + u64::from(header.vsps) * size_of::<VspRecord>() as u64
}

/// Resident memory of this process.
pub(super) fn resident_bytes() -> ResidentBytes {
    ResidentBytes::of(&std::fs::read_to_string("/proc/self/status").unwrap_or_default())
}

/// Every right that the tick thread and the recorder ask for, with its outcome.
pub(super) fn rights(plan: &LoopPlan, is_recorded: bool, missing: &[MissingRight]) -> Vec<Right> {
    use realtime::rights::Right as Kind;
    let mut asked = vec![Kind::LockedMemory];
    asked.extend(plan.core.map(Kind::Core));
    asked.extend([Kind::Latency, Kind::Fifo(plan.priority)]);
    asked.extend(is_recorded.then_some(Kind::Nice(RECORDER_NICE)));
    asked
        .into_iter()
        .map(|kind| {
            let refused = missing.iter().find(|missing| missing.right == kind);
            Right {
                name: kind.name(),
                obtained: refused.is_none(),
                detail: refused.map(ToString::to_string).unwrap_or_default(),
            }
        })
        .collect()
}

/// Closing lines of `hrtc run`; the full report is that of `rt-tests run`.
pub(super) fn print_text(finished: &Finished, recording: Option<&Path>) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    write_text(&mut out, &finished.result, recording)?;
    out.flush()
}

/// These lines; `recording` is the first file of the recording, where there is one.
fn write_text(
    out: &mut impl Write,
    r: &RunResult,
    recording: Option<&Path>,
) -> std::io::Result<()> {
    writeln!(
        out,
        "{}: {} ticks in {:.1} s, {} periods missed ({} by own work)",
        r.scene, r.ticks, r.seconds, r.missed, r.missed_own_cpu
    )?;
    if r.first_heard_ms <= 0.0 {
        writeln!(out, "no station was heard")?;
    }
    writeln!(
        out,
        "touched for {} ticks, {} of them at full resolution, {} coarser than asked for; force p50 {:.2} N, max {:.2} N",
        r.contact_ticks, r.contact_full_ticks, r.coarser_ticks, r.force_n.p50, r.force_n.max
    )?;
    writeln!(
        out,
        "work p50 {:.0} us, p99 {:.0} us (thread CPU); its record p50 {:.2} us, p99 {:.2} us; cache {} of {} KiB; {} splits, {} collapses",
        r.work_us.p50,
        r.work_us.p99,
        r.record_us.p50,
        r.record_us.p99,
        r.cache.high_water_bytes / 1024,
        r.cache.bytes / 1024,
        r.vsplits,
        r.ecols
    )?;
    writeln!(out, "highest fill of everything that was sized at start:")?;
    let width = r.capacities.iter().map(|c| c.name.len()).max().unwrap_or(0);
    for c in &r.capacities {
        writeln!(
            out,
            "  {:<width$} {:>9} of {:>9}",
            c.name, c.high_water, c.capacity
        )?;
    }
    if let Some(first) = recording {
        let lacks = match r.safety.recording_errors {
            0 => "",
            _ => ", not complete: what it lacks was said, or is in it as a hole",
        };
        writeln!(out, "recording {}{lacks}", files_of(first).display())?;
    }
    Ok(())
}

/// The first file of a recording, or where it had to go for later ones, a pattern for those, as
/// [`crate::recorder::RecordingPlace::path`] names them.
fn files_of(first: &Path) -> PathBuf {
    if first.exists() {
        return first.to_owned();
    }
    let mut pattern = first.file_stem().unwrap_or_default().to_os_string();
    pattern.push("-*");
    if let Some(extension) = first.extension() {
        pattern.push(".");
        pattern.push(extension);
    }
    first.with_file_name(pattern)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorder::RecordingPlace;
    use std::ffi::OsStr;

    #[test]
    fn a_panic_of_the_tick_is_to_be_reported_by_its_sentence() {
        let panic = RunError::TickPanicked("made on purpose (at tick.rs:1)".to_owned());
        let sentence = panic.to_string();
        assert!(sentence.contains("(made on purpose (at tick.rs:1))"));
        // Nothing was printed before: a backtrace takes too long.
        assert!(!sentence.contains("above"), "{sentence}");
    }

    #[test]
    fn only_what_nobody_wanted_leaves_a_black_box() {
        for fault in [
            RunError::TickPanicked("made on purpose".to_owned()),
            RunError::TickHangs,
            RunError::LinkEnded,
            RunError::Fault(Fault::NoTour),
            RunError::NonFinite("force_n".to_owned()),
        ] {
            assert!(fault.is_fault(), "{fault}");
        }
        for other in [
            RunError::SwitchedOff,
            RunError::Right("memory is not locked".to_owned()),
            RunError::Print(std::io::ErrorKind::StorageFull.into()),
            RunError::Thread("hrtc-status", std::io::ErrorKind::WouldBlock.into()),
        ] {
            assert!(!other.is_fault(), "{other}");
        }
    }

    #[test]
    fn a_thread_that_does_not_start_is_named() {
        let missing = RunError::Thread("hrtc-watchdog", std::io::ErrorKind::WouldBlock.into());
        let sentence = missing.to_string();
        assert!(sentence.contains("hrtc-watchdog"), "{sentence}");
        assert!(!sentence.contains("tick"), "{sentence}");
    }

    #[test]
    fn later_files_of_a_recording_are_those_of_its_pattern() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, expected) in [
            ("run.mcap", "run-*.mcap"),
            ("run.rec", "run-*.rec"),
            ("run", "run-*"),
            ("a.b.mcap", "a.b-*.mcap"),
        ] {
            let place = RecordingPlace {
                first: folder.path().join(name),
                keep_bytes: 1 << 20,
                owns_folder: false,
            };
            let pattern = files_of(&place.first);
            assert_eq!(pattern, folder.path().join(expected));
            let (before, after) = expected.split_once('*').expect("one *");
            let later = place.path(12);
            let later = later.file_name().and_then(OsStr::to_str).expect("a name");
            assert!(
                later.starts_with(before) && later.ends_with(after),
                "{later}"
            );
        }
    }

    #[test]
    fn the_closing_lines_name_the_recording_and_a_station_that_never_came() {
        let text = |result: &RunResult, recording: Option<&Path>| {
            let mut out = Vec::new();
            write_text(&mut out, result, recording).expect("memory takes it");
            String::from_utf8(out).expect("it is text")
        };
        let mut result = RunResult::default();
        let alone = text(&result, None);
        assert!(alone.contains("no station was heard\n"), "{alone}");
        assert!(!alone.contains("recording"), "{alone}");
        result.first_heard_ms = 12.0;
        let folder = tempfile::tempdir().expect("a folder");
        let first = folder.path().join("run.mcap");
        let heard = text(&result, Some(&first));
        assert!(!heard.contains("no station"), "{heard}");
        // The first file had to go.
        assert!(heard.ends_with("/run-*.mcap\n"), "{heard}");
        std::fs::write(&first, b"").expect("it is written");
        let heard = text(&result, Some(&first));
        assert!(heard.ends_with("/run.mcap\n"), "{heard}");
        // As on a full disk.
        result.safety.recording_errors = 1;
        let heard = text(&result, Some(&first));
        assert!(heard.contains("/run.mcap, not complete"), "{heard}");
    }
}
