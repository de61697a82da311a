//! The recording of `hrtc run`: where it lies, and what is kept when a fault ends the run.

use super::KEEP_BYTES;
use super::loaded_scene::LoadedScene;
use super::outcome::RunError;
use crate::message::note;
use crate::recorder::{
    Recorder, RecordingError, RecordingHead, RecordingPlace, Taps, write_black_box,
};
use crate::setup::ControllerSetup;
use crate::tick_record::TickRecord;
use hrtc_core::Capacity;
use realtime::rights::{MissingRight, monotonic_ns};
use scene::ScenePlan;
use scene_files::recordings_folder;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The recording of a run.
#[derive(Debug)]
pub(super) struct RunRecording {
    recorder: Recorder,
    /// Its first file.
    first: PathBuf,
    /// Where the last seconds before a fault go.
    black_box: PathBuf,
}

impl RunRecording {
    /// Starts the recording, unless it is off. A default place that cannot be used costs the
    /// recording only; one that was named, the run.
    ///
    /// # Errors
    /// When the named file cannot be created.
    pub(super) fn start(
        named: Option<&Path>,
        scene: &LoadedScene,
        setup: &ControllerSetup,
    ) -> Result<(Option<Self>, Option<Taps>), RecordingError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let realtime_ns = now.map_or(0, |since| since.as_nanos() as u64);
        let Some(place) = place(named, &scene.plan, realtime_ns) else {
            return Ok((None, None));
        };
        let offset_ns = realtime_ns.saturating_sub(monotonic_ns());
        let files = scene.files.clone();
        let head = RecordingHead::new(&scene.path, &scene.overrides, setup, &files, offset_ns);
        let black_box = beside(&place.first, "fault");
        let first = place.first.clone();
        let is_default = place.owns_folder;
        if is_default && let Some(folder) = place.first.parent() {
            // A folder that cannot be made shows when the file is.
            let _ = std::fs::create_dir_all(folder);
        }
        match Recorder::start(head, files, place) {
            Ok((recorder, taps)) => {
                let recording = Self {
                    recorder,
                    first,
                    black_box,
                };
                Ok((Some(recording), Some(taps)))
            }
            Err(error) if is_default => {
                note!("this run is not recorded: {error}");
                Ok((None, None))
            }
            Err(error) => Err(error),
        }
    }

    /// The first file.
    pub(super) fn first(&self) -> &Path {
        &self.first
    }

    /// Hands over a tick.
    pub(super) fn push(&mut self, record: &TickRecord) {
        self.recorder.push(record);
    }

    /// The right that the recorder was refused, once.
    pub(super) fn take_missing(&mut self) -> Option<MissingRight> {
        self.recorder.take_missing()
    }

    /// Whether the recording lacks what it should have.
    pub(super) fn has_lost(&self) -> bool {
        self.recorder.has_lost()
    }

    /// Size and high water of the recorder's rings.
    pub(super) fn capacities(&self) -> Vec<Capacity> {
        self.recorder.capacities()
    }

    /// Ends the recording; after a fault, which is said first since that takes seconds, the last
    /// seconds are kept in a file of their own.
    pub(super) fn finish(self, ended_by: Option<&RunError>) {
        let Some(error) = ended_by else {
            let _ = self.recorder.finish(None);
            return;
        };
        let sentence = error.to_string();
        if !error.is_fault() {
            let _ = self.recorder.finish_early(&sentence);
            return;
        }
        note!("the run ended by a fault, its last seconds are being kept: {sentence}");
        let files = self.recorder.finish(Some(&sentence));
        match write_black_box(&files, &sentence, &self.black_box) {
            Ok(()) => note!(
                "the last seconds before the fault are in {}",
                self.black_box.display()
            ),
            Err(error) => note!("there is no black box: {error}"),
        }
    }
}

/// Where a run's recording goes; `None` when it is off.
fn place(named: Option<&Path>, plan: &ScenePlan, realtime_ns: u64) -> Option<RecordingPlace> {
    let named = match named {
        Some(path) if path.as_os_str() == "off" => return None,
        Some(path) => Some((path, plan.record.keep_bytes.unwrap_or(KEEP_BYTES))),
        None => plan.record.path.as_deref().zip(plan.record.keep_bytes),
    };
    if let Some((path, keep_bytes)) = named {
        return Some(RecordingPlace {
            first: path.to_owned(),
            keep_bytes,
            owns_folder: false,
        });
    }
    let keep_bytes = plan.record.keep_bytes?;
    let Some(folder) = recordings_folder() else {
        note!(
            "this run is not recorded: no home is known for its file; name one with --record FILE"
        );
        return None;
    };
    let seconds = realtime_ns / 1_000_000_000;
    let name = format!("{}-{seconds}-{}.mcap", plan.name, std::process::id());
    Some(RecordingPlace {
        first: folder.join(name),
        keep_bytes,
        owns_folder: true,
    })
}

/// A path beside another, with a word behind its stem.
fn beside(path: &Path, word: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push(format!("-{word}.mcap"));
    path.with_file_name(name)
}
