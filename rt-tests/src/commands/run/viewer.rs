//! The viewer of a run: `rt-tests view --rerun` in a process of its own, which reads the recording
//! behind the run.

use crate::failure::Failure;
use crate::pictures::{check_target, check_viewer};
use crate::processes::process::{Event, Process};
use std::ffi::OsString;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

/// How long the viewer may take after the run for what it has not shown yet: it replays some ten
/// times as fast as the run was.
const PATIENCE: Duration = Duration::from_secs(60);

/// The viewer's process.
pub struct Viewer {
    arguments: Vec<OsString>,
    core: Option<usize>,
    sender: Sender<Event>,
    events: Receiver<Event>,
    /// `None` before there is a recording.
    process: Option<Result<Process, Failure>>,
}

impl Viewer {
    /// A viewer that is not started yet; with another core than the tick's where there is one.
    ///
    /// # Errors
    /// Where the build has none, nothing is recorded, or the target is no file of a viewer.
    pub fn new(record: &Path, target: &str, core: Option<usize>) -> Result<Self, Failure> {
        check_viewer()?;
        if record == Path::new("off") {
            return Err(Failure::Input(
                "--view shows what is recorded, and nothing is recorded here".to_owned(),
            ));
        }
        check_target(target, record)?;
        let target = format!("--rerun={target}");
        let (sender, events) = channel();
        Ok(Self {
            arguments: ["view".into(), target.into(), "--".into(), record.into()].to_vec(),
            core,
            sender,
            events,
            process: None,
        })
    }

    /// Starts it, unless it was: from now on there is a recording.
    pub fn start(&mut self) {
        self.process.get_or_insert_with(|| {
            Process::start("viewer", &self.arguments, self.core, &self.sender)
        });
    }

    /// Waits until it has shown all; a sentence about it for the report.
    pub fn finish(self) -> Option<String> {
        let mut process = match self.process? {
            Ok(process) => process,
            Err(failure) => return Some(failure.to_string()),
        };
        let status = process.wait(PATIENCE);
        if !status.is_some_and(|status| status.success()) {
            return Some(process.failure(status).to_string());
        }
        let said = self.events.try_iter().filter_map(|event| match event {
            Event::Line(_, line) => Some(format!("viewer: {line}")),
            Event::Said(..) => None,
        });
        said.last()
    }
}
