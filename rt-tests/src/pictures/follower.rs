//! A recording that is read while it is written: the controller behind the run.

use super::playback::{FedTwin, files_of, input};
use crate::failure::Failure;
use hrtc::recorder::{RecordingError, RecordingReader, Twin};
use hrtc::tick_record::TickRecord;
use hrtc::tuning::RECORDING_RETRY_NS;
use scene::ScenePlan;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest record that is read of a file, bytes: a greater length is a damaged one.
const RECORD_BYTES: u64 = u32::MAX as u64;
/// Files that nobody has locked for so long are written no more. Between two files of a run none is
/// locked for some milliseconds, and after a disk that refused until it is tried again.
const UNLOCKED: Duration = Duration::from_nanos(RECORDING_RETRY_NS + 1_000_000_000);

/// Time between two looks at a recording: as long as between two of its frames.
pub const LOOK: Duration = Duration::from_millis(50);
/// So many looks, the head of a file that is written has to be there.
const HEAD_LOOKS: u32 = 100;

/// How far a recording was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// Up to what is written now: there may be more.
    Now,
    /// Up to its end.
    End,
}

/// Reads a recording to its end, or behind the run that writes it.
pub struct Follower {
    first: PathBuf,
    path: PathBuf,
    reader: RecordingReader,
    fed: FedTwin,
    /// Since when nobody has the file locked.
    unlocked: Option<Instant>,
    /// The scene as it runs.
    pub plan: ScenePlan,
    /// Limit of the force on the hand, newtons.
    pub force_max_n: f64,
}

impl Follower {
    /// Opens a recording by its first file.
    ///
    /// # Errors
    /// When the oldest file of it that is left cannot be read.
    pub fn open(first: &Path) -> Result<Self, Failure> {
        let path = files_of(first).swap_remove(0);
        let mut left = HEAD_LOOKS;
        let reader = loop {
            match open(&path) {
                // Its head is on the way.
                Err(_) if left > 0 && !is_free(&path) => left -= 1,
                result => break result.map_err(input)?,
            }
            std::thread::sleep(LOOK);
        };
        let mut fed = FedTwin::default();
        fed.begin(&reader)?;
        let plan = reader.head().plan(reader.files()).map_err(input)?;
        let device_max_n = reader.head().setup.max_force_n;
        Ok(Self {
            first: first.to_path_buf(),
            path,
            force_max_n: plan.safety.force_max_n.min(device_max_n),
            fed,
            reader,
            unlocked: None,
            plan,
        })
    }

    /// Gives each tick that is there now to `visit`, with the controller after it.
    ///
    /// # Errors
    /// Those of `visit`, and when a tick gives other outputs than the controller's.
    pub fn read(
        &mut self,
        mut visit: impl FnMut(&ScenePlan, &TickRecord, &Twin) -> Result<(), Failure>,
    ) -> Result<Reach, Failure> {
        // Looked at first: what was written before the lock went is read below.
        let mut is_over = self.is_left();
        loop {
            self.read_file(&mut visit)?;
            let Some((path, reader)) = self.later_file() else {
                return Ok(if is_over { Reach::End } else { Reach::Now });
            };
            // The recorder closes a file before it begins the next one, so all that there will be
            // of this one is there by now. After a disk that refused it has no end of its own.
            self.read_file(&mut visit)?;
            self.fed.begin(&reader)?;
            (self.path, self.reader, self.unlocked) = (path, reader, None);
            // That was about the file before.
            is_over = false;
        }
    }

    /// The last tick that was read, and the controller after it; `None` where that is not known.
    #[must_use]
    pub fn last(&self) -> Option<(&TickRecord, &Twin)> {
        self.fed.last()
    }

    /// Ticks so far, from the first one on, that were not given: they are not in the recording, or
    /// their inputs are not.
    #[must_use]
    pub fn passed_over(&self) -> u64 {
        self.fed.passed_over()
    }

    /// Reads the present file as far as it is there.
    fn read_file(
        &mut self,
        visit: &mut impl FnMut(&ScenePlan, &TickRecord, &Twin) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        for entry in self.reader.by_ref() {
            if let Some((record, twin)) = self.fed.take(entry)? {
                visit(&self.plan, record, twin)?;
            }
        }
        Ok(())
    }

    /// Whether nobody writes any more.
    fn is_left(&mut self) -> bool {
        let is_free = is_free(&self.path);
        let since = self.unlocked.unwrap_or_else(Instant::now);
        self.unlocked = is_free.then_some(since);
        is_free && since.elapsed() >= UNLOCKED
    }

    /// The next file of the same run, once this one is whole or written no more and that is there.
    fn later_file(&self) -> Option<(PathBuf, RecordingReader)> {
        if !self.reader.is_whole() && self.unlocked.is_none() {
            return None;
        }
        let now = self.reader.head();
        files_of(&self.first).into_iter().find_map(|path| {
            // Its head may not be written yet.
            let reader = open(&path).ok()?;
            let head = reader.head();
            // Files of an earlier run may lie beside.
            let is_ours = head.setup.incarnation == now.setup.incarnation;
            (is_ours && head.segment > now.segment).then_some((path, reader))
        })
    }
}

/// Whether a file is there and not locked, as by who writes it.
fn is_free(path: &Path) -> bool {
    File::open(path).is_ok_and(|file| file.try_lock().is_ok())
}

fn open(path: &Path) -> Result<RecordingReader, RecordingError> {
    RecordingReader::open_growing(path, RECORD_BYTES)
}
