//! The black box: the last seconds of a run that ended by a fault, cut out of its recording.

use super::encoder::Encoder;
use super::reader::{Entry, RecordingReader};
use super::shown::Level;
use super::twin::Twin;
use super::{RecordingError, RecordingHead};
use crate::tick_record::TickRecord;
use crate::tuning::BLACK_BOX_NS;
use protocol::{ContactReport, Request};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes the last ten seconds of a recording, given by its files, the oldest first, into one
/// file that replays by itself.
///
/// # Errors
/// When there is no recording or a file cannot be used.
pub fn write_black_box(files: &[PathBuf], fault: &str, out: &Path) -> Result<(), RecordingError> {
    let failed = |e: std::io::Error| RecordingError::Disk(format!("{}: {e}", out.display()));
    // Another run may have deleted the oldest; a pipe or device cannot be read again.
    let gone = files.iter().rposition(|path| !path.is_file());
    let files = &files[gone.map_or(0, |last| last + 1)..];
    let mut last_ns = None;
    // The last one may have begun only now.
    for path in files.iter().rev() {
        last_ns = ticks_ns(path)?.last();
        if last_ns.is_some() {
            break;
        }
    }
    let Some(last_ns) = last_ns else {
        return Err(failed(std::io::ErrorKind::NotFound.into()));
    };
    let from_ns = last_ns.saturating_sub(BLACK_BOX_NS);
    let mut start = files.len() - 1;
    while start > 0 && !(begins_before(&files[start], from_ns)? && stands_alone(&files[start])?) {
        start -= 1;
    }
    let mut copy = Copy::new(from_ns);
    let mut file = File::create(out).map_err(failed)?;
    for path in &files[start..] {
        let mut reader = RecordingReader::open(path)?;
        copy.open(&reader)?;
        while let Some(entry) = reader.next() {
            copy.take(entry, &reader)?;
            file.write_all(&copy.bytes()).map_err(failed)?;
        }
    }
    file.write_all(&copy.finish(fault)?).map_err(failed)
}

/// Whether a file has a tick from before a time.
fn begins_before(path: &Path, ns: u64) -> Result<bool, RecordingError> {
    Ok(ticks_ns(path)?.next().is_some_and(|first| first <= ns))
}

/// Whether a file replays without those before it: it is the first, or begins with a keyframe.
///
/// # Errors
/// When it cannot be read.
pub fn stands_alone(path: &Path) -> Result<bool, RecordingError> {
    let mut entries = RecordingReader::open(path)?;
    if entries.head().segment == 0 {
        return Ok(true);
    }
    let first = entries.find(|of| matches!(of, Entry::Keyframe(_) | Entry::Tick(_)));
    Ok(matches!(first, Some(Entry::Keyframe(_))))
}

/// Starts of a file's ticks, ns.
fn ticks_ns(path: &Path) -> Result<impl Iterator<Item = u64>, RecordingError> {
    let entries = RecordingReader::open(path)?.without_keyframes();
    Ok(entries.filter_map(|entry| match entry {
        Entry::Tick(record) => Some(record.start_ns),
        _ => None,
    }))
}

/// Writes the state of a twin.
fn keyframe(encoder: &mut Encoder, twin: &Twin) -> Result<(), RecordingError> {
    twin.to_parts(|part, number, is_last| encoder.keyframe(part, number, is_last))
}

/// Copies entries from a time on, with a keyframe before them.
struct Copy {
    from_ns: u64,
    twin: Option<Twin>,
    requests: Vec<Request>,
    reports: Vec<ContactReport>,
    encoder: Option<Encoder>,
}

impl Copy {
    fn new(from_ns: u64) -> Self {
        Self {
            from_ns,
            twin: None,
            requests: Vec::new(),
            reports: Vec::new(),
            encoder: None,
        }
    }

    fn open(&mut self, reader: &RecordingReader) -> Result<(), RecordingError> {
        if reader.head().segment == 0 {
            let controller = reader.head().controller(reader.files())?;
            self.twin = Some(Twin::new(controller));
        }
        Ok(())
    }

    fn take(&mut self, entry: Entry, reader: &RecordingReader) -> Result<(), RecordingError> {
        match entry {
            Entry::Keyframe(state) => {
                // That of before a hole knows nothing of what came after it.
                let twin = Twin::from_bytes(&state)?;
                let before = self.twin.as_ref().map(|before| before.next_tick);
                if before.is_none_or(|before| before < twin.next_tick) {
                    if let Some(encoder) = &mut self.encoder {
                        keyframe(encoder, &twin)?;
                    }
                    self.twin = Some(twin);
                }
            }
            Entry::Chunk(index, chunk) => {
                if let Some(twin) = &mut self.twin {
                    // A gap shows at the tick.
                    let _ = twin.arrive(index, &chunk);
                }
                if let Some(encoder) = &mut self.encoder {
                    encoder.chunk(index, &chunk)?;
                }
            }
            Entry::Request(_, request) => self.requests.push(*request),
            Entry::Report(_, report) => self.reports.push(*report),
            Entry::Hole(hole) => {
                if let Some(encoder) = &mut self.encoder {
                    encoder.hole(&hole)?;
                }
            }
            Entry::Damaged(_) => self.twin = None,
            Entry::Tick(record) => self.tick(&record, reader)?,
        }
        Ok(())
    }

    fn tick(
        &mut self,
        record: &TickRecord,
        reader: &RecordingReader,
    ) -> Result<(), RecordingError> {
        let requests = std::mem::take(&mut self.requests);
        let reports = std::mem::take(&mut self.reports);
        if self.encoder.is_none() && record.start_ns >= self.from_ns {
            self.encoder = Some(self.begin(record, reader)?);
        }
        if self
            .twin
            .as_mut()
            .is_some_and(|twin| twin.tick(record).is_err())
        {
            self.twin = None;
        }
        let Some(encoder) = &mut self.encoder else {
            return Ok(());
        };
        for request in &requests {
            encoder.request(record.tick, request)?;
        }
        for report in &reports {
            encoder.report(record.tick, report)?;
        }
        encoder.tick(record, self.twin.as_ref().map(Twin::controller))
    }

    fn begin(
        &self,
        record: &TickRecord,
        reader: &RecordingReader,
    ) -> Result<Encoder, RecordingError> {
        let head = RecordingHead {
            // Not the first: it begins with its keyframe.
            segment: reader.head().segment.max(1),
            ..reader.head().clone()
        };
        let probes = head.probes();
        let mut encoder = Encoder::new(&head, reader.files(), probes, record.start_ns)?;
        if let Some(twin) = &self.twin {
            keyframe(&mut encoder, twin)?;
        }
        Ok(encoder)
    }

    fn bytes(&mut self) -> Vec<u8> {
        self.encoder.as_mut().map(Encoder::take).unwrap_or_default()
    }

    fn finish(self, fault: &str) -> Result<Vec<u8>, RecordingError> {
        let Some(mut encoder) = self.encoder else {
            return Ok(Vec::new());
        };
        encoder.event(Level::Fatal, &format!("the run ended by a fault: {fault}"))?;
        encoder.finish()
    }
}
