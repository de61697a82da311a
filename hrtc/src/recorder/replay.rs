//! Replays a recording: the same inputs into a fresh controller, every output compared.

use super::reader::{Entry, RecordingReader};
use super::twin::Twin;
use super::{Hole, RecordingError};
use crate::tick_record::TickRecord;
use protocol::{ContactReport, Request};
use serde::Serialize;
use std::path::Path;

/// Outcome of a replay.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Replay {
    /// Ticks replayed.
    pub ticks: u64,
    /// Whether every tick gave the recorded outputs.
    pub equal: bool,
    /// Whether the recording has its end and no hole. One that was cut, after a crash for example,
    /// is replayed to its last tick.
    pub whole: bool,
    /// Index of the first tick with other outputs; -1 for none.
    pub first_difference: i64,
    /// The field that differs there, with both values; empty for none.
    pub field: String,
    /// Index of the first tick of the file; -1 without any.
    pub first_tick: i64,
    /// Ticks that the recording says are missing.
    pub holes: Vec<Hole>,
}

/// Runs a recording through the core and compares every output of every tick.
///
/// # Errors
/// When the file cannot be read or is not a recording.
pub fn replay(path: &Path) -> Result<Replay, RecordingError> {
    let mut reader = RecordingReader::open(path)?;
    let twin = match reader.head().segment {
        0 => Some(Twin::new(reader.head().controller(reader.files())?)),
        _ => None,
    };
    let mut run = Run::new(twin);
    for entry in reader.by_ref() {
        if run.take(entry)?.is_some() {
            break;
        }
    }
    let mut found = run.found;
    found.equal = found.first_difference < 0;
    let reached_end = reader.is_whole() || !found.equal;
    found.whole = reached_end && found.holes.is_empty();
    Ok(found)
}

/// A replay under way.
struct Run {
    /// `None` until there is a keyframe.
    twin: Option<Twin>,
    requests: Vec<Request>,
    reports: Vec<ContactReport>,
    found: Replay,
}

/// A replay ends before the file does.
struct Ended;

impl Run {
    fn new(twin: Option<Twin>) -> Self {
        Self {
            twin,
            requests: Vec::new(),
            reports: Vec::new(),
            found: Replay {
                ticks: 0,
                equal: false,
                whole: false,
                first_difference: -1,
                field: String::new(),
                first_tick: -1,
                holes: Vec::new(),
            },
        }
    }

    fn take(&mut self, entry: Entry) -> Result<Option<Ended>, RecordingError> {
        match entry {
            Entry::Keyframe(state) => self.twin = Some(Twin::from_bytes(&state)?),
            Entry::Request(_, request) => self.requests.push(*request),
            Entry::Report(_, report) => self.reports.push(*report),
            Entry::Hole(hole) => self.found.holes.push(hole),
            Entry::Damaged(topic) => {
                let tick = self.twin.as_ref().map_or(0, |twin| twin.next_tick);
                let field = format!("{topic}: its bytes are not those that were recorded");
                return Ok(Some(self.differ(tick, field)));
            }
            Entry::Chunk(index, chunk) => {
                // A gap shows at the tick that needs the chunk.
                if let Some(twin) = &mut self.twin {
                    let _ = twin.arrive(index, &chunk);
                }
            }
            Entry::Tick(record) => return Ok(self.tick(&record)),
        }
        Ok(None)
    }

    fn tick(&mut self, record: &TickRecord) -> Option<Ended> {
        let (requests, reports) = (
            std::mem::take(&mut self.requests),
            std::mem::take(&mut self.reports),
        );
        let twin = self.twin.as_mut()?;
        if let Err(gap) = twin.tick(record) {
            // No state until the next keyframe.
            self.twin = None;
            if self
                .found
                .holes
                .last()
                .is_none_or(|hole| hole.last < gap.tick)
            {
                self.found.holes.push(Hole {
                    first: gap.tick,
                    last: record.tick,
                    reason: "an input is not in the recording".to_owned(),
                });
            }
            return None;
        }
        if self.found.ticks == 0 {
            self.found.first_tick = i64::try_from(record.tick).unwrap_or(i64::MAX);
        }
        self.found.ticks += 1;
        let hole = self.found.holes.last();
        let difference = if hole.is_some_and(|hole| hole.last == record.tick) {
            twin.difference_of_state(record)
        } else {
            twin.difference(record, &requests, &reports)
        };
        difference.map(|field| self.differ(record.tick, field))
    }

    fn differ(&mut self, tick: u64, field: String) -> Ended {
        self.found.first_difference = i64::try_from(tick).unwrap_or(i64::MAX);
        self.found.field = field;
        Ended
    }
}
