//! A twin that is behind: it reads what it missed from the recording's own files.

use super::RecordingPlace;
use super::reader::{Entry, RecordingReader};
use super::twin::Twin;

/// Entries that a late twin reads at once, so that no tick waits for longer than a few dozen
/// milliseconds for the recorder.
const ENTRIES: usize = 512;

/// How far a late twin came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CatchUp {
    /// There is more to read.
    Some,
    /// It has read all that lies in the files.
    All,
    /// It cannot go on: an input is not there.
    Lost,
}

/// A twin that is behind, with the place where it reads.
pub(super) struct LateTwin {
    twin: Twin,
    place: RecordingPlace,
    /// Number of the file that it reads.
    number: u32,
    /// `None` before it is opened.
    reader: Option<RecordingReader>,
}

impl LateTwin {
    /// A twin whose next tick lies in the file of this number, or in one after it.
    pub(super) fn new(twin: Twin, place: RecordingPlace, number: u32) -> Self {
        Self {
            twin,
            place,
            number,
            reader: None,
        }
    }

    /// The tick that comes next when no period is skipped.
    pub(super) fn next_tick(&self) -> u64 {
        self.twin.next_tick
    }

    /// The twin as far as it came.
    pub(super) fn into_twin(self) -> Twin {
        self.twin
    }

    /// Reads on, as much as a tick may wait for.
    pub(super) fn read(&mut self) -> CatchUp {
        for _ in 0..ENTRIES {
            let Some(reader) = &mut self.reader else {
                let path = self.place.path(self.number);
                // A file's head may not be written yet.
                let reader = RecordingReader::open_growing(&path, self.place.keep_bytes);
                self.reader = reader.ok().map(RecordingReader::without_keyframes);
                if self.reader.is_none() {
                    return CatchUp::All;
                }
                continue;
            };
            let Some(entry) = reader.next() else {
                if !reader.is_whole() {
                    return CatchUp::All;
                }
                self.reader = None;
                self.number += 1;
                continue;
            };
            if !self.take(entry) {
                return CatchUp::Lost;
            }
        }
        CatchUp::Some
    }

    /// Takes an entry; whether the twin can go on. Entries of before are passed over.
    fn take(&mut self, entry: Entry) -> bool {
        match entry {
            Entry::Chunk(index, chunk) => {
                // A gap shows at the tick.
                let _ = self.twin.arrive(index, &chunk);
                true
            }
            Entry::Tick(record) if record.tick >= self.twin.next_tick => {
                let has_ticked = self.twin.tick(&record).is_ok();
                has_ticked && self.twin.outputs().record.replay_hash == record.core.replay_hash
            }
            Entry::Damaged(_) => false,
            _ => true,
        }
    }
}
