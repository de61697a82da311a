//! A recording, and the controller at any tick of it.

use crate::failure::Failure;
use hrtc::recorder::{Entry, RecordingError, RecordingPlace, RecordingReader, Twin, stands_alone};
use hrtc::tick_record::TickRecord;
use hrtc_core::record::max_or_nan;
use scene::ScenePlan;
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// A file of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
struct File {
    path: PathBuf,
    /// Its first tick.
    first: u64,
}

/// A recording whose ticks were looked through once.
#[derive(Debug)]
pub struct Playback {
    files: Vec<File>,
    /// The scene as it ran.
    pub plan: ScenePlan,
    /// First and last tick.
    pub ticks: [u64; 2],
    /// Whether files before its first one are gone: a long run keeps its last ones only.
    pub lacks_start: bool,
    /// The tick of the greatest force in contact; `None` where nothing was touched.
    pub strongest: Option<u64>,
    /// The greatest force in contact, newtons.
    pub force_max_n: f64,
}

impl Playback {
    /// Opens a recording by its first file, with those that follow it. Files of an earlier run may
    /// lie beside them.
    ///
    /// # Errors
    /// When a file cannot be read, or there is no tick in them.
    pub fn open(first: &Path) -> Result<Self, Failure> {
        let mut playback: Option<Self> = None;
        let mut run = None;
        for path in files_of(first) {
            let reader = match RecordingReader::open(&path) {
                Err(error) if run.is_none() => return Err(input(error)),
                // Of an earlier run by another build.
                Err(RecordingError::NotARecording(_)) => continue,
                other => other.map_err(input)?,
            };
            let (incarnation, segment) = (reader.head().setup.incarnation, reader.head().segment);
            if *run.get_or_insert(incarnation) != incarnation {
                continue;
            }
            let plan = match playback {
                Some(_) => None,
                None => Some(reader.head().plan(reader.files()).map_err(input)?),
            };
            for record in ticks(reader) {
                let of = playback.get_or_insert_with(|| Self {
                    files: Vec::new(),
                    plan: plan
                        .clone()
                        .unwrap_or_else(|| unreachable!("the first file has it")),
                    ticks: [record.tick; 2],
                    lacks_start: segment > 0,
                    strongest: None,
                    force_max_n: 0.0,
                });
                of.take(&path, &record);
            }
        }
        playback
            .ok_or_else(|| Failure::Input(format!("{}: there is no tick in it", first.display())))
    }

    fn take(&mut self, path: &Path, record: &TickRecord) {
        if self.files.last().is_none_or(|file| file.path != path) {
            self.files.push(File {
                path: path.to_path_buf(),
                first: record.tick,
            });
        }
        self.ticks[1] = record.tick;
        // An effect may push a probe that touches nothing.
        let probes = record.wrenches.iter().zip(&record.contacts);
        let touching = probes.filter(|(_, contact)| contact.is_some());
        let forces = touching.map(|(wrench, _)| wrench.force.length());
        if let Some(force) = forces.reduce(max_or_nan)
            && (self.strongest.is_none() || force > self.force_max_n)
        {
            (self.strongest, self.force_max_n) = (Some(record.tick), force);
        }
    }

    /// The tick that tells most: of the greatest force in contact, else the last.
    #[must_use]
    pub fn shown_tick(&self) -> u64 {
        self.strongest.unwrap_or(self.ticks[1])
    }

    /// Seconds from the start of the run to a tick.
    #[must_use]
    pub fn seconds(&self, tick: u64) -> f64 {
        tick as f64 / self.plan.loop_.rate_hz
    }

    /// The tick nearest to a time, seconds from the start of the run.
    ///
    /// # Errors
    /// When the recording does not reach there.
    pub fn tick_at(&self, seconds: f64) -> Result<u64, Failure> {
        let [first, last] = self.ticks;
        let tick = (seconds * self.plan.loop_.rate_hz).round();
        if tick >= first as f64 && tick <= last as f64 {
            return Ok(tick as u64);
        }
        Err(Failure::Input(format!(
            "--at {seconds}: the recording has {:.3} to {:.3} s",
            self.seconds(first),
            self.seconds(last)
        )))
    }

    /// Puts the recording through the controller again, from a tick or some before it, and shows
    /// each tick with the controller after it, until told to stop or the recording ends. Ticks
    /// without their inputs are passed over.
    ///
    /// # Errors
    /// When a file cannot be read, or a tick gives other outputs than the controller's.
    pub fn play(
        &self,
        from: u64,
        mut visit: impl FnMut(&TickRecord, &Twin) -> ControlFlow<()>,
    ) -> Result<(), Failure> {
        let first = self.files.iter().rposition(|file| file.first <= from);
        let mut first = first.unwrap_or(0);
        // After lost inputs a file may begin without the controller's state.
        while first > 0 && !stands_alone(&self.files[first].path).map_err(input)? {
            first -= 1;
        }
        let mut fed = FedTwin::default();
        for file in &self.files[first..] {
            let reader = RecordingReader::open(&file.path).map_err(input)?;
            fed.begin(&reader)?;
            for entry in reader {
                if let Some((record, twin)) = fed.take(entry)?
                    && visit(record, twin).is_break()
                {
                    return Ok(());
                }
            }
        }
        Ok(())
    }
}

/// A twin that a recording's entries feed; there is none before the first state, and none from a
/// gap to the next keyframe.
#[derive(Debug, Default)]
pub(super) struct FedTwin {
    twin: Option<Twin>,
    /// That of a keyframe, until a tick follows it.
    fresh: Option<Twin>,
    /// The last tick of the twin.
    last: Option<Box<TickRecord>>,
    /// The tick that comes next when none is missing; `None` while nothing was read.
    next_tick: Option<u64>,
    /// Ticks before `next_tick` that the twin did not run.
    passed_over: u64,
    /// The tick after those that the recording says are missing.
    after_hole: u64,
}

impl FedTwin {
    /// A file begins.
    ///
    /// # Errors
    /// When its scene is refused.
    pub fn begin(&mut self, reader: &RecordingReader) -> Result<(), Failure> {
        if reader.head().segment == 0 {
            let controller = reader.head().controller(reader.files()).map_err(input)?;
            self.fresh = Some(Twin::new(controller));
            self.next_tick = Some(0);
        }
        Ok(())
    }

    /// Takes an entry; of a tick its record, and the controller after it.
    ///
    /// # Errors
    /// When a keyframe cannot be read, or a tick gives other outputs than the controller's.
    pub fn take(&mut self, entry: Entry) -> Result<Option<(&TickRecord, &Twin)>, Failure> {
        match entry {
            Entry::Keyframe(state) => {
                self.fresh = Some(Twin::from_bytes(&state).map_err(input)?);
            }
            Entry::Chunk(index, chunk) => {
                if let Some(twin) = self.fresh.as_mut().or(self.twin.as_mut()) {
                    // A gap shows at the tick that needs the chunk.
                    let _ = twin.arrive(index, &chunk);
                }
            }
            Entry::Hole(hole) => self.after_hole = self.after_hole.max(hole.last.saturating_add(1)),
            Entry::Tick(record) => return self.tick(record),
            _ => {}
        }
        Ok(None)
    }

    fn tick(&mut self, record: Box<TickRecord>) -> Result<Option<(&TickRecord, &Twin)>, Failure> {
        self.last = None;
        if let Some(fresh) = self.fresh.take() {
            self.twin = Some(fresh);
        }
        // A tick stands for those that the run skipped before it.
        let stands_from = record.tick.saturating_sub(u64::from(record.skipped));
        let expected = self.next_tick.unwrap_or(stands_from);
        self.passed_over += stands_from.saturating_sub(expected);
        self.next_tick = Some(record.tick + 1);
        let twin = self.twin.as_mut();
        if twin.is_some_and(|twin| twin.tick(&record).is_err()) {
            // Inputs are missing: there is no state until the next keyframe.
            self.twin = None;
        }
        match &self.twin {
            Some(twin) => {
                check(&record, twin)?;
                self.last = Some(record);
            }
            None => self.passed_over += 1,
        }
        Ok(self.last())
    }

    /// The last tick, and the controller after it; `None` where that is not known.
    pub fn last(&self) -> Option<(&TickRecord, &Twin)> {
        Some((self.last.as_deref()?, self.twin.as_ref()?))
    }

    /// Ticks so far, from the first one on, that the twin did not run: they are not in the
    /// recording, or their inputs are not.
    pub fn passed_over(&self) -> u64 {
        let next_tick = self.next_tick.unwrap_or(self.after_hole);
        self.passed_over + self.after_hole.saturating_sub(next_tick)
    }
}

/// A recording that cannot be read.
pub(super) fn input(error: RecordingError) -> Failure {
    Failure::Input(error.to_string())
}

/// Whether the controller is in the state that it was in.
fn check(record: &TickRecord, twin: &Twin) -> Result<(), Failure> {
    if twin.outputs().record.replay_hash == record.core.replay_hash {
        return Ok(());
    }
    Err(Failure::Run(format!(
        "tick {} of this recording does not give the recorded outputs, so its mesh is not the one that was touched; it was made by another build, or changed since",
        record.tick
    )))
}

/// Ticks of a file.
fn ticks(reader: RecordingReader) -> impl Iterator<Item = Box<TickRecord>> {
    reader.filter_map(|entry| match entry {
        Entry::Tick(record) => Some(record),
        _ => None,
    })
}

/// The files of a recording that are there: of a long one the first is gone.
pub(super) fn files_of(first: &Path) -> Vec<PathBuf> {
    let place = RecordingPlace {
        first: first.to_path_buf(),
        keep_bytes: 0,
        owns_folder: false,
    };
    let numbers = numbers_of(&place).into_iter();
    let later = numbers.map(|number| place.path(number));
    let later = later.filter(|path| path.is_file());
    let mut files: Vec<PathBuf> = later.collect();
    // Named in the error when there is none.
    if first.is_file() || files.is_empty() {
        files.insert(0, first.to_path_buf());
    }
    files
}

/// The numbers of a recording's later files, from the names in its folder: what lies beside it may
/// have any number, so those before it are not looked for.
fn numbers_of(place: &RecordingPlace) -> BTreeSet<u32> {
    let folder = place.first.parent().filter(|of| !of.as_os_str().is_empty());
    let entries = std::fs::read_dir(folder.unwrap_or(Path::new(".")));
    let names = entries.into_iter().flatten();
    let names = names.filter_map(|entry| Some(entry.ok()?.path()));
    let numbers = names.filter_map(|path| {
        let (_, number) = path.file_stem()?.to_str()?.rsplit_once('-')?;
        let number = number.parse().ok()?;
        let is_later = number > 0 && place.path(number).file_name() == path.file_name();
        is_later.then_some(number)
    });
    numbers.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A look at every number before it would take hours.
    #[test]
    fn a_file_with_a_large_number_beside_is_one_file_more() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        let files = [
            "run.mcap",
            "run-0002.mcap",
            "run-10000.mcap",
            "run-4000000000.mcap",
        ];
        let others = [
            "run-0000.mcap",
            "run-2.mcap",
            "run-4000000001.txt",
            "walk-0003.mcap",
        ];
        for name in files.into_iter().chain(others) {
            std::fs::write(path(name), "").unwrap();
        }
        assert_eq!(files_of(&path("run.mcap")), files.map(path));
    }
}
