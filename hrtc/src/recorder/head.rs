//! The head of a recording: everything that makes the controller.

use super::{RecordingError, paths};
use crate::setup::ControllerSetup;
use hrtc_core::Controller;
use scene::{MAX_PROBES, Overrides, ScenePlan};
use scene_files::KeptFiles;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Scene, options and devices of a run; the scene's files are in [`KeptFiles`] beside it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct RecordingHead {
    /// Version of hrtc.
    pub version: String,
    /// Architecture: floating point differs between them.
    pub architecture: String,
    /// Path of the scene file.
    pub scene: PathBuf,
    /// Options of the command line.
    pub overrides: Overrides,
    /// Identity and devices.
    pub setup: ControllerSetup,
    /// Paths from the root, by the path that the scene asked for.
    pub absolute: Vec<(PathBuf, PathBuf)>,
    /// CLOCK_REALTIME less CLOCK_MONOTONIC at the start, ns: times of messages are of the former.
    pub realtime_offset_ns: u64,
    /// Number of this file among those of the run, from 0.
    pub segment: u32,
}

impl RecordingHead {
    /// Head of a run's first file.
    #[must_use]
    pub fn new(
        scene: &Path,
        overrides: &Overrides,
        setup: &ControllerSetup,
        files: &KeptFiles,
        realtime_offset_ns: u64,
    ) -> Self {
        let absolute = files.absolute.iter();
        Self {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            architecture: std::env::consts::ARCH.to_owned(),
            scene: scene.to_path_buf(),
            overrides: overrides.clone(),
            setup: setup.clone(),
            absolute: absolute.map(|(a, b)| (a.clone(), b.clone())).collect(),
            realtime_offset_ns,
            segment: 0,
        }
    }

    /// The head as a recording holds it, JSON: a path that is not UTF-8 as in [`paths`].
    pub(super) fn to_json(&self) -> Result<Vec<u8>, RecordingError> {
        let head = self.clone().with_paths(|path| paths::to_text(path).into());
        serde_json::to_vec(&head).map_err(|error| RecordingError::Head(error.to_string()))
    }

    /// The head of [`RecordingHead::to_json`]; `None` of anything else.
    pub(super) fn from_json(json: &[u8]) -> Option<Self> {
        let head: Self = serde_json::from_slice(json).ok()?;
        Some(head.with_paths(|path| paths::from_text(&path.to_string_lossy())))
    }

    /// The head with each of its paths changed.
    fn with_paths(mut self, change: impl Fn(&Path) -> PathBuf) -> Self {
        let of_overrides = &mut self.overrides;
        let typed = of_overrides.model.iter_mut();
        let typed = typed.chain(&mut of_overrides.devices);
        let absolute = self.absolute.iter_mut().flat_map(|(of, path)| [of, path]);
        for path in typed.chain(absolute).chain([&mut self.scene]) {
            *path = change(path.as_path());
        }
        self
    }

    /// Number of probes. No seal protects the head: a changed one has no more than a run may.
    #[must_use]
    pub fn probes(&self) -> usize {
        self.setup.position_resolutions_m.len().min(MAX_PROBES)
    }

    /// The scene of the recording, from the files in it.
    ///
    /// # Errors
    /// When the scene is refused: a file of it is missing or changed.
    pub fn plan(&self, files: &KeptFiles) -> Result<ScenePlan, RecordingError> {
        let files = KeptFiles {
            contents: files.contents.clone(),
            absolute: self.absolute.iter().cloned().collect(),
        };
        Ok(scene::load(&self.scene, &self.overrides, &files)?)
    }

    /// The controller of the recording before its first tick.
    ///
    /// # Errors
    /// As [`RecordingHead::plan`].
    pub fn controller(&self, files: &KeptFiles) -> Result<Box<Controller>, RecordingError> {
        let mut plan = self.plan(files)?;
        Ok(Box::new(self.setup.controller(&mut plan)))
    }
}
