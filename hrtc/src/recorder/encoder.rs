//! Encodes one file of a recording into memory, never into a file: the disk has its own thread.

use super::format::{
    Channel, FILES, HEAD, Hole, PROFILE, PlainChunk, PlainReport, PlainRequest, keyframe_part,
    sealed,
};
use super::schema::Schemas;
use super::shown::{Display, Level, Shown};
use super::{RecordingError, RecordingHead, paths};
use crate::tick_record::TickRecord;
use crate::tuning::{MAX_FRAME_BYTES, SHOWN_EVERY};
use hrtc_core::Controller;
use hrtc_core::streaming::chunk::InboxChunk;
use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use mcap::{Attachment, WriteOptions, Writer};
use protocol::{ContactReport, Request};
use scene_files::KeptFiles;
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::rc::Rc;

/// Bytes that no one has taken yet.
#[derive(Debug, Default, Clone)]
struct Pending(Rc<RefCell<Vec<u8>>>);

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// One file of a recording.
pub(super) struct Encoder {
    writer: Writer<NoSeek<Pending>>,
    pending: Pending,
    /// Ids of [`Channel::ALL`].
    replay: [u16; Channel::ALL.len()],
    /// Ids of [`Shown::OF_PROBE`] of each probe.
    of_probe: Vec<[u16; Shown::OF_PROBE.len()]>,
    /// Ids of [`Shown::OF_RUN`].
    of_run: [u16; Shown::OF_RUN.len()],
    schemas: Schemas,
    /// Bytes of messages that no one has taken yet.
    size: u64,
    realtime_offset_ns: u64,
    /// Start of the last tick, CLOCK_REALTIME, ns.
    now_ns: u64,
    tick: u64,
}

impl Encoder {
    /// Begins a file: its head, the scene's files, its channels.
    pub(super) fn new(
        head: &RecordingHead,
        files: &KeptFiles,
        probes: usize,
        now_ns: u64,
    ) -> Result<Self, RecordingError> {
        let pending = Pending::default();
        let options = WriteOptions::new()
            .profile(PROFILE)
            .library(concat!("hrtc ", env!("CARGO_PKG_VERSION")))
            .compression(None)
            .chunk_size(Some(MAX_FRAME_BYTES))
            .disable_seeking(true);
        let mut writer = options.create(NoSeek::new(pending.clone()))?;
        let now_ns = now_ns + head.realtime_offset_ns;
        attach(
            &mut writer,
            now_ns,
            HEAD.to_owned(),
            "application/json",
            &head.to_json()?,
        )?;
        for (path, content) in &files.contents {
            let name = format!("{FILES}{}", paths::to_text(path));
            attach(
                &mut writer,
                now_ns,
                name,
                "application/octet-stream",
                content,
            )?;
        }
        let mut replay = [0; Channel::ALL.len()];
        for (id, channel) in replay.iter_mut().zip(Channel::ALL) {
            let (topic, encoding) = (channel.topic(), channel.encoding());
            *id = writer.add_channel(0, topic, encoding, &BTreeMap::new())?;
        }
        let schemas = Schemas::new()?;
        let mut of_probe = Vec::with_capacity(probes);
        for k in 0..probes {
            let folder = format!("/probe/{k}/");
            of_probe.push(add_shown(&mut writer, &schemas, &folder, Shown::OF_PROBE)?);
        }
        let of_run = add_shown(&mut writer, &schemas, "/", Shown::OF_RUN)?;
        Ok(Self {
            writer,
            pending,
            replay,
            of_probe,
            of_run,
            schemas,
            size: 0,
            realtime_offset_ns: head.realtime_offset_ns,
            now_ns,
            tick: 0,
        })
    }

    /// The bytes of all whole frames since the last call.
    pub(super) fn take(&mut self) -> Vec<u8> {
        self.size = 0;
        self.pending.0.take()
    }

    /// Ends the frame under way; the bytes since the last call of [`Encoder::take`].
    pub(super) fn flush(&mut self) -> Result<Vec<u8>, RecordingError> {
        self.writer.flush()?;
        Ok(self.take())
    }

    /// Bytes of the messages since the last call of [`Encoder::take`].
    pub(super) fn size(&self) -> u64 {
        self.size
    }

    /// Ends the file; the last bytes.
    pub(super) fn finish(mut self) -> Result<Vec<u8>, RecordingError> {
        self.writer.finish()?;
        Ok(self.take())
    }

    fn message(&mut self, id: u16, bytes: &[u8]) -> Result<(), RecordingError> {
        let header = MessageHeader {
            channel_id: id,
            // Only a help to whoever looks for damage: a tick's index without its upper half.
            sequence: self.tick as u32,
            log_time: self.now_ns,
            publish_time: self.now_ns,
        };
        self.size += bytes.len() as u64;
        Ok(self.writer.write_to_known_channel(&header, bytes)?)
    }

    fn replay(&mut self, channel: Channel, bytes: Vec<u8>) -> Result<(), RecordingError> {
        self.message(self.replay[channel as usize], &sealed(bytes))
    }

    /// Writes a message for people, if there is one.
    fn show(
        &mut self,
        id: u16,
        message: impl FnOnce(&Display<'_>) -> Result<Option<Vec<u8>>, RecordingError>,
    ) -> Result<(), RecordingError> {
        let display = Display {
            schemas: &self.schemas,
            now_ns: self.now_ns,
        };
        match message(&display)? {
            Some(bytes) => self.message(id, &bytes),
            None => Ok(()),
        }
    }

    /// A part of a keyframe, by its number from 0.
    pub(super) fn keyframe(
        &mut self,
        state: &[u8],
        number: u32,
        is_last: bool,
    ) -> Result<(), RecordingError> {
        let part = keyframe_part(state, number, is_last);
        self.replay(Channel::Keyframe, part)
    }

    pub(super) fn chunk(&mut self, index: u64, chunk: &InboxChunk) -> Result<(), RecordingError> {
        let plain = PlainChunk::new(index, chunk);
        self.replay(Channel::Chunk, bytemuck::bytes_of(&plain).to_vec())
    }

    pub(super) fn request(&mut self, tick: u64, request: &Request) -> Result<(), RecordingError> {
        let plain = PlainRequest {
            tick,
            request: *request,
        };
        self.replay(Channel::Request, bytemuck::bytes_of(&plain).to_vec())
    }

    pub(super) fn report(
        &mut self,
        tick: u64,
        report: &ContactReport,
    ) -> Result<(), RecordingError> {
        let plain = PlainReport {
            tick,
            report: *report,
        };
        self.replay(Channel::Report, bytemuck::bytes_of(&plain).to_vec())
    }

    pub(super) fn hole(&mut self, hole: &Hole) -> Result<(), RecordingError> {
        let bytes = postcard::to_stdvec(hole)?;
        self.replay(Channel::Hole, bytes)?;
        let Hole {
            first,
            last,
            reason,
        } = hole;
        let sentence = format!("ticks {first} to {last} are not in this recording: {reason}");
        self.event(Level::Warning, &sentence)
    }

    pub(super) fn event(&mut self, level: Level, sentence: &str) -> Result<(), RecordingError> {
        let last = Shown::OF_RUN.len() - 1;
        self.show(self.of_run[last], |display| display.event(level, sentence))
    }

    /// A tick: for the replay in full, for people the wrench and a miss at every tick, the rest of
    /// it at every [`SHOWN_EVERY`]th.
    pub(super) fn tick(
        &mut self,
        record: &TickRecord,
        twin: Option<&Controller>,
    ) -> Result<(), RecordingError> {
        self.now_ns = record.start_ns + self.realtime_offset_ns;
        self.tick = record.tick;
        self.replay(Channel::Tick, postcard::to_stdvec(record)?)?;
        let is_shown = record.tick.is_multiple_of(SHOWN_EVERY);
        for k in 0..self.of_probe.len() {
            for (channel, id) in Shown::OF_PROBE.into_iter().zip(self.of_probe[k]) {
                if is_shown || channel == Shown::Wrench {
                    self.show(id, |display| display.of_probe(channel, k, record, twin))?;
                }
            }
        }
        for (channel, id) in Shown::OF_RUN.into_iter().zip(self.of_run) {
            if is_shown || channel == Shown::Miss {
                self.show(id, |display| display.of_run(channel, record))?;
            }
        }
        Ok(())
    }
}

fn attach(
    writer: &mut Writer<NoSeek<Pending>>,
    now_ns: u64,
    name: String,
    media_type: &str,
    data: &[u8],
) -> Result<(), RecordingError> {
    Ok(writer.attach(&Attachment {
        log_time: now_ns,
        create_time: now_ns,
        name,
        media_type: media_type.to_owned(),
        data: Cow::Borrowed(data),
    })?)
}

fn add_shown<const N: usize>(
    writer: &mut Writer<NoSeek<Pending>>,
    schemas: &Schemas,
    folder: &str,
    channels: [Shown; N],
) -> Result<[u16; N], RecordingError> {
    let mut ids = [0; N];
    for (id, channel) in ids.iter_mut().zip(channels) {
        let (name, description) = (channel.schema_name(), &schemas.description);
        let schema = writer.add_schema(name, "protobuf", description)?;
        let topic = format!("{folder}{}", channel.topic());
        *id = writer.add_channel(schema, &topic, "protobuf", &BTreeMap::new())?;
    }
    Ok(ids)
}
