//! Reads a recording, whole or cut at any byte.

use super::format::{Channel, FILES, HEAD, Hole, PROFILE, PlainChunk, PlainReport, PlainRequest};
use super::{RecordingError, RecordingHead, format, paths};
use crate::tick_record::TickRecord;
use hrtc_core::streaming::chunk::InboxChunk;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use protocol::{ContactReport, Request};
use scene_files::KeptFiles;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A message of a recording.
#[derive(Debug)]
pub enum Entry {
    /// State of the controller after all entries before this one.
    Keyframe(Vec<u8>),
    /// A chunk, by its number in the order of arrival.
    Chunk(u64, Box<InboxChunk>),
    /// A request of the tick of this index, whose record follows.
    Request(u64, Box<Request>),
    /// A contact report of the tick of this index, whose record follows.
    Report(u64, Box<ContactReport>),
    /// A tick.
    Tick(Box<TickRecord>),
    /// Ticks that are missing.
    Hole(Hole),
    /// A message that is not as it was written: its topic.
    Damaged(String),
}

/// Entries of a file, in the order in which they were recorded.
pub struct RecordingReader {
    source: Source,
    head: RecordingHead,
    files: KeptFiles,
    /// Replay channels by their ids.
    channels: BTreeMap<u16, Channel>,
    keyframe: KeyframeParts,
    /// Read while looking for the head's end.
    first: Option<Entry>,
    is_whole: bool,
}

impl RecordingReader {
    /// Opens a recording and reads its head.
    ///
    /// # Errors
    /// When the file cannot be read or its head is not there.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let length = path.metadata().map_or(0, |of| of.len());
        Self::open_growing(path, length)
    }

    /// As [`RecordingReader::open`], for a file that is still written, up to so many bytes: what it
    /// has not now, [`RecordingReader::next`] may give later.
    ///
    /// # Errors
    /// As [`RecordingReader::open`]; also while its head is not written yet.
    pub fn open_growing(path: &Path, length: u64) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let foreign = || RecordingError::NotARecording(name.clone());
        let refused = |e| RecordingError::File(name.clone(), e);
        // The open of a pipe would wait for its writer, and a device has no end.
        if !path.metadata().map_err(refused)?.is_file() {
            return Err(foreign());
        }
        let file = File::open(path).map_err(refused)?;
        let options = LinearReaderOptions::default()
            .with_record_length_limit(usize::try_from(length).map_err(|_| foreign())?);
        let mut source = Source {
            file,
            reader: LinearReader::new_with_options(options),
        };
        let mut head = None;
        let mut files = KeptFiles::default();
        let mut channels = BTreeMap::new();
        let mut keyframe = KeyframeParts::default();
        let mut first = None;
        // All of the head comes before the first message.
        let (mut has_message, mut is_whole) = (false, false);
        while !is_whole {
            let Some(record) = source.next() else { break };
            match record {
                Record::Header(header) if header.profile != PROFILE => return Err(foreign()),
                Record::Attachment { header, data, .. } if header.name == HEAD => {
                    head = RecordingHead::from_json(&data);
                }
                Record::Attachment { header, data, .. } => {
                    if let Some(path) = header.name.strip_prefix(FILES) {
                        files.contents.insert(paths::from_text(path), data.into());
                    }
                }
                Record::Channel(channel) => channels.extend(for_replay(&channel)),
                Record::Message { header, data } => {
                    has_message = true;
                    if let Some(&channel) = channels.get(&header.channel_id) {
                        first = keyframe.entry(channel, &data);
                        break;
                    }
                }
                Record::Footer(_) => is_whole = true,
                _ => {}
            }
        }
        Ok(Self {
            source,
            head: head
                .filter(|_| has_message || is_whole)
                .ok_or_else(foreign)?,
            files,
            channels,
            keyframe,
            first,
            is_whole,
        })
    }

    /// Passes over keyframes from here on, of which it then holds no more than a part.
    #[must_use]
    pub(super) fn without_keyframes(mut self) -> Self {
        self.keyframe.are_wanted = false;
        self
    }

    /// The head.
    #[must_use]
    pub fn head(&self) -> &RecordingHead {
        &self.head
    }

    /// The scene's files.
    #[must_use]
    pub fn files(&self) -> &KeptFiles {
        &self.files
    }

    /// Whether the file's own end was reached.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.is_whole
    }
}

impl Iterator for RecordingReader {
    type Item = Entry;

    /// `None` at the end, whether it is the file's own or a cut.
    fn next(&mut self) -> Option<Entry> {
        if let Some(first) = self.first.take() {
            return Some(first);
        }
        while !self.is_whole {
            match self.source.next()? {
                Record::Message { header, data } => {
                    let channel = self.channels.get(&header.channel_id).copied();
                    let entry = channel.and_then(|channel| self.keyframe.entry(channel, &data));
                    if entry.is_some() {
                        return entry;
                    }
                }
                Record::Channel(channel) => self.channels.extend(for_replay(&channel)),
                Record::Footer(_) => self.is_whole = true,
                _ => {}
            }
        }
        None
    }
}

/// Records of a file up to its end, or to the first byte that is not of one.
struct Source {
    file: File,
    reader: LinearReader,
}

impl Source {
    fn next(&mut self) -> Option<Record<'static>> {
        loop {
            match self.reader.next_event()?.ok()? {
                LinearReadEvent::ReadRequest(wanted) => {
                    let read = self.file.read(self.reader.insert(wanted)).ok()?;
                    if read == 0 {
                        // Not told to the reader: the file may grow.
                        return None;
                    }
                    self.reader.notify_read(read);
                }
                LinearReadEvent::Record { data, opcode } => {
                    if opcode == op::ATTACHMENT && !is_attachment(data) {
                        return None;
                    }
                    let record = mcap::parse_record(opcode, data).ok()?;
                    return Some(record.into_owned());
                }
            }
        }
    }
}

/// Whether the lengths in an attachment fit it: `parse_record` relies on them.
fn is_attachment(data: &[u8]) -> bool {
    const TIMES: usize = 16;
    const CRC: u64 = 4;
    let length_at = |at: usize| {
        let bytes = data.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?) as usize)
    };
    let after = |at: usize| at.checked_add(4)?.checked_add(length_at(at)?);
    let Some(at) = after(TIMES).and_then(after) else {
        return false;
    };
    let Some(bytes) = at.checked_add(8).and_then(|end| data.get(at..end)) else {
        return false;
    };
    let length = <[u8; 8]>::try_from(bytes).map_or(u64::MAX, u64::from_le_bytes);
    length.checked_add(at as u64 + 8 + CRC) == Some(data.len() as u64)
}

/// A channel for a replay with its id; `None` for another.
fn for_replay(channel: &mcap::records::Channel) -> Option<(u16, Channel)> {
    let mut all = Channel::ALL.into_iter();
    let found = all.find(|of| of.topic() == channel.topic)?;
    Some((channel.id, found))
}

/// Makes entries of messages: joins the parts of a keyframe.
struct KeyframeParts {
    are_wanted: bool,
    /// The state as far as it was read.
    state: Vec<u8>,
    /// Number of the next part.
    next: u32,
}

impl Default for KeyframeParts {
    fn default() -> Self {
        Self {
            are_wanted: true,
            state: Vec::new(),
            next: 0,
        }
    }
}

impl KeyframeParts {
    /// A message as an entry; `None` of a part that is not a keyframe's last.
    fn entry(&mut self, channel: Channel, data: &[u8]) -> Option<Entry> {
        let bytes = format::unsealed(data);
        let read = match channel {
            Channel::Keyframe => match bytes.and_then(format::of_keyframe_part) {
                Some((part, number, is_last)) if number == self.next => {
                    return self.join(part, is_last);
                }
                _ => None,
            },
            _ => bytes.and_then(|bytes| read(channel, bytes)),
        };
        // A keyframe without its last part is none.
        let _ = self.begin();
        Some(read.unwrap_or_else(|| Entry::Damaged(channel.topic().to_owned())))
    }

    /// Adds a part; the keyframe, if it was the last one.
    fn join(&mut self, part: &[u8], is_last: bool) -> Option<Entry> {
        self.next = self.next.saturating_add(1);
        if self.are_wanted {
            self.state.extend_from_slice(part);
        }
        let state = is_last.then(|| self.begin())?;
        self.are_wanted.then_some(Entry::Keyframe(state))
    }

    /// Makes ready for another keyframe; the state that was read so far.
    fn begin(&mut self) -> Vec<u8> {
        self.next = 0;
        std::mem::take(&mut self.state)
    }
}

/// A message other than a keyframe's.
fn read(channel: Channel, bytes: &[u8]) -> Option<Entry> {
    Some(match channel {
        Channel::Keyframe => return None,
        Channel::Chunk => {
            let plain: PlainChunk = bytemuck::try_pod_read_unaligned(bytes).ok()?;
            Entry::Chunk(plain.index, Box::new(plain.chunk()))
        }
        Channel::Request => {
            let plain: PlainRequest = bytemuck::try_pod_read_unaligned(bytes).ok()?;
            Entry::Request(plain.tick, Box::new(plain.request))
        }
        Channel::Report => {
            let plain: PlainReport = bytemuck::try_pod_read_unaligned(bytes).ok()?;
            Entry::Report(plain.tick, Box::new(plain.report))
        }
        Channel::Tick => Entry::Tick(Box::new(postcard::from_bytes(bytes).ok()?)),
        Channel::Hole => Entry::Hole(postcard::from_bytes(bytes).ok()?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recorder::write_black_box;
    use std::process::Command;

    #[test]
    fn a_keyframe_that_lacks_a_part_is_damaged_and_the_next_one_is_not() {
        let mut parts = KeyframeParts::default();
        let mut take = |number: u32, is_last: bool| {
            let part = format::keyframe_part(&[number as u8; 2], number, is_last);
            parts.entry(Channel::Keyframe, &format::sealed(part))
        };
        let is_state = |entry: Option<Entry>, state: &[u8]| match entry {
            Some(Entry::Keyframe(read)) => read == state,
            _ => false,
        };
        assert!(take(0, false).is_none());
        assert!(is_state(take(1, true), &[0, 0, 1, 1]));
        assert!(take(0, false).is_none());
        assert!(matches!(take(2, true), Some(Entry::Damaged(_))));
        assert!(is_state(take(0, true), &[0, 0]));
    }

    /// A pipe that nobody writes into would hold up for ever who opens it.
    #[test]
    fn what_is_no_file_is_no_recording_and_is_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("run.mcap");
        let made = Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        for path in [pipe.as_path(), folder.path(), Path::new("/dev/zero")] {
            let opened = RecordingReader::open(path).map(|_| ());
            let is_foreign = matches!(opened, Err(RecordingError::NotARecording(_)));
            assert!(is_foreign, "{}: {opened:?}", path.display());
        }
        let out = folder.path().join("fault.mcap");
        assert!(write_black_box(&[pipe], "a test", &out).is_err());
        assert!(!out.exists());
    }
}
