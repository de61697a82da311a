//! The twin: a second controller that is fed from the recording.
//!
//! While a run is recorded, the twin ticks in the recorder's thread behind the real one. Its state
//! is what a keyframe holds, and it shows at once when a tick would not replay. A replay is a twin
//! that is fed from a file.

use super::RecordingError;
use crate::tick_record::TickRecord;
use crate::time_answers::RecordedAnswers;
use crate::tuning::{KEYFRAME_PART_BYTES, KEYFRAME_STACK_BYTES};
use bytemuck::Zeroable;
use geometry::Wrench;
use hrtc_core::streaming::chunk::InboxChunk;
use hrtc_core::{Controller, TickInputs, TickOutputs};
use postcard::ser_flavors::Size;
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot, ContactReport, Request};
use serde::{Deserialize, Serialize};
use std::io::{self, Write};

/// A recording that lacks an input, so that the twin cannot go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    /// First tick that is not known.
    pub tick: u64,
}

/// A twin as a keyframe holds it.
#[derive(Serialize, Deserialize)]
struct State<C> {
    controller: C,
    /// Header and slots of each chunk that waits, as plain bytes.
    waiting: Vec<Vec<u8>>,
    consumed: u64,
    next_tick: u64,
}

/// A second controller with the chunks that wait for it.
#[derive(Debug)]
pub struct Twin {
    pub(super) controller: Box<Controller>,
    pub(super) outputs: TickOutputs,
    /// Chunks that arrived and were not consumed, the oldest first.
    pub(super) waiting: Vec<InboxChunk>,
    /// Chunks consumed so far.
    pub(super) consumed: u64,
    /// The tick that comes next when no period is skipped.
    pub(super) next_tick: u64,
}

impl Twin {
    /// A twin before its first tick. Its samples are recorded ones: it keeps no points of the tours
    /// that lead the hands.
    #[must_use]
    pub fn new(mut controller: Box<Controller>) -> Self {
        controller.drop_tour_points();
        Self {
            outputs: controller.new_outputs(),
            controller,
            waiting: Vec::new(),
            consumed: 0,
            next_tick: 0,
        }
    }

    /// A twin from a keyframe.
    ///
    /// # Errors
    /// When the bytes are not those of a keyframe of this build.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RecordingError> {
        let state = state_of(bytes)?;
        let mut twin = Self::new(state.controller);
        for bytes in &state.waiting {
            twin.waiting
                .push(chunk_of(bytes).ok_or(postcard::Error::DeserializeBadEncoding)?);
        }
        twin.consumed = state.consumed;
        twin.next_tick = state.next_tick;
        Ok(twin)
    }

    /// The state for a keyframe.
    ///
    /// # Errors
    /// Of the encoder, when there is no memory.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RecordingError> {
        Ok(postcard::to_stdvec(&self.state())?)
    }

    /// Length of [`Twin::to_bytes`].
    ///
    /// # Errors
    /// Of the encoder.
    pub(super) fn state_bytes(&self) -> Result<usize, RecordingError> {
        let counted = postcard::serialize_with_flavor(&self.state(), Size::default());
        Ok(counted?)
    }

    /// Hands over what [`Twin::to_bytes`] gives in parts of [`KEYFRAME_PART_BYTES`]: each with its
    /// number, from 0, and whether it is the last.
    ///
    /// # Errors
    /// Those of `take`, which gets no part after one, and of the encoder.
    pub(super) fn to_parts(
        &self,
        take: impl FnMut(&[u8], u32, bool) -> Result<(), RecordingError>,
    ) -> Result<(), RecordingError> {
        let mut parts = Parts {
            part: Vec::with_capacity(KEYFRAME_PART_BYTES),
            number: 0,
            take,
            failed: None,
        };
        let encoded = postcard::to_io(&self.state(), &mut parts).map(|_| ());
        if let Some(error) = parts.failed.take() {
            return Err(error);
        }
        encoded?;
        parts.hand_over(true)
    }

    fn state(&self) -> State<&Controller> {
        let bytes = |chunk: &InboxChunk| {
            let header = bytemuck::bytes_of(&chunk.header);
            [header, bytemuck::bytes_of(&chunk.slots)].concat()
        };
        State {
            controller: self.controller(),
            waiting: self.waiting.iter().map(bytes).collect(),
            consumed: self.consumed,
            next_tick: self.next_tick,
        }
    }

    /// The controller, after the last tick.
    #[must_use]
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The outputs of the last tick.
    #[must_use]
    pub fn outputs(&self) -> &TickOutputs {
        &self.outputs
    }

    /// Takes a chunk by its number in the order of arrival; one that is here already is passed
    /// over.
    ///
    /// # Errors
    /// When a chunk before it is missing.
    pub fn arrive(&mut self, index: u64, chunk: &InboxChunk) -> Result<(), Gap> {
        let next = self.consumed + self.waiting.len() as u64;
        if index > next {
            return Err(self.gap());
        }
        if index == next {
            self.waiting.push(*chunk);
        }
        Ok(())
    }

    /// Runs a tick over its recorded inputs.
    ///
    /// # Errors
    /// When a tick before it or a chunk is missing; the twin is unchanged.
    pub fn tick(&mut self, record: &TickRecord) -> Result<(), Gap> {
        let follows = record.tick == self.next_tick + u64::from(record.skipped);
        let arrived = record.chunks_arrived.checked_sub(self.consumed);
        let arrived = arrived.and_then(|arrived| usize::try_from(arrived).ok());
        let chunks = arrived.and_then(|arrived| self.waiting.get(..arrived));
        let (Some(chunks), true) = (chunks, follows) else {
            return Err(self.gap());
        };
        let inputs = TickInputs {
            tick: record.tick,
            samples: &record.samples[..self.controller.probes()],
            station: record.station,
            chunks: [chunks, &[]],
            stopping: record.core.stopping,
        };
        if record.rises_again {
            self.controller.force_was_cut();
        }
        if let Some(measured) = record.measured {
            self.controller.note_work(measured);
        }
        if let Some(bytes) = record.cache_limit {
            self.controller.set_cache_limit(bytes as usize);
        }
        let outputs = &mut self.outputs;
        let mut answers = RecordedAnswers(record.time);
        self.controller.tick(&inputs, outputs, &mut answers);
        let consumed = outputs.chunks_consumed.min(self.waiting.len());
        self.waiting.drain(..consumed);
        self.consumed += consumed as u64;
        self.next_tick = record.tick + 1;
        Ok(())
    }

    fn gap(&self) -> Gap {
        Gap {
            tick: self.next_tick,
        }
    }

    /// The first field of the last tick's outputs that is not as recorded, bit by bit.
    #[must_use]
    pub fn difference(
        &self,
        record: &TickRecord,
        requests: &[Request],
        reports: &[ContactReport],
    ) -> Option<String> {
        let outputs = &self.outputs;
        self.difference_of_state(record)
            .or_else(|| plain_field("requests", requests, outputs.outbox.requests()))
            .or_else(|| plain_field("reports", reports, &outputs.reports))
    }

    /// As [`Twin::difference`], for a tick whose requests and reports are not all recorded.
    #[must_use]
    pub fn difference_of_state(&self, record: &TickRecord) -> Option<String> {
        let outputs = &self.outputs;
        let pairs = record.wrenches.iter().zip(&outputs.wrenches).enumerate();
        let mut wrenches = pairs.map(|(k, (a, &b))| {
            let b = if record.force_cut { Wrench::ZERO } else { b };
            field(&format!("wrenches[{k}]"), a, &b)
        });
        let pairs = record.contacts.iter().zip(&outputs.contacts).enumerate();
        let mut contacts = pairs.map(|(k, (a, b))| field(&format!("contacts[{k}]"), a, b));
        let counts = [
            (
                "requests",
                record.requests,
                outputs.outbox.requests().len() as u32,
            ),
            ("reports", record.reports, outputs.reports.len() as u32),
            (
                "chunks_consumed",
                record.chunks_consumed,
                outputs.chunks_consumed as u32,
            ),
        ];
        let mut counts = counts.iter().map(|(name, a, b)| field(name, a, b));
        let first = wrenches.find_map(|of| of);
        first
            .or_else(|| contacts.find_map(|of| of))
            .or_else(|| field("core", &record.core, &outputs.record))
            .or_else(|| counts.find_map(|of| of))
    }
}

/// Hands over what is written in parts.
struct Parts<F> {
    part: Vec<u8>,
    number: u32,
    take: F,
    /// Why it was refused: the encoder says only that it was.
    failed: Option<RecordingError>,
}

impl<F: FnMut(&[u8], u32, bool) -> Result<(), RecordingError>> Parts<F> {
    fn hand_over(&mut self, is_last: bool) -> Result<(), RecordingError> {
        (self.take)(&self.part, self.number, is_last)?;
        self.part.clear();
        self.number += 1;
        Ok(())
    }
}

impl<F: FnMut(&[u8], u32, bool) -> Result<(), RecordingError>> Write for Parts<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let is_full = self.part.len() + bytes.len() > KEYFRAME_PART_BYTES;
        if is_full
            && !self.part.is_empty()
            && let Err(error) = self.hand_over(false)
        {
            self.failed = Some(error);
            return Err(io::ErrorKind::Other.into());
        }
        self.part.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The state in a keyframe, read on a stack of its own: serde builds every part of it there.
fn state_of(bytes: &[u8]) -> Result<State<Box<Controller>>, RecordingError> {
    let read = || Ok(postcard::from_bytes(bytes)?);
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(KEYFRAME_STACK_BYTES);
        let thread = thread.spawn_scoped(scope, read);
        let read = thread.map_err(RecordingError::Thread)?.join();
        read.unwrap_or(Err(postcard::Error::DeserializeBadEncoding.into()))
    })
}

/// A chunk from its plain bytes.
fn chunk_of(bytes: &[u8]) -> Option<InboxChunk> {
    let (header, slots) = bytes.split_at_checked(size_of::<ChunkHeader>())?;
    let mut chunk = InboxChunk {
        header: bytemuck::try_pod_read_unaligned(header).ok()?,
        slots: [ChunkSlot::zeroed(); CHUNK_SLOTS],
    };
    let all = bytemuck::bytes_of_mut(&mut chunk.slots);
    if all.len() != slots.len() {
        return None;
    }
    all.copy_from_slice(slots);
    Some(chunk)
}

/// The first of two lists' members that differs.
fn plain_field<T: bytemuck::Pod>(name: &str, recorded: &[T], found: &[T]) -> Option<String> {
    if recorded.len() != found.len() {
        return Some(format!("{name}: not all of them are in the recording"));
    }
    let mut pairs = recorded.iter().zip(found);
    let bytes = bytemuck::bytes_of::<T>;
    let first = pairs.position(|(a, b)| bytes(a) != bytes(b))?;
    Some(format!("{name}[{first}]"))
}

/// The path of the first field in which two values differ, bit by bit.
fn field<T: serde::Serialize>(name: &str, recorded: &T, found: &T) -> Option<String> {
    let bytes = |value: &T| postcard::to_stdvec(value).unwrap_or_default();
    if bytes(recorded) == bytes(found) {
        return None;
    }
    let value = |value: &T| serde_json::to_value(value).unwrap_or_default();
    Some(deepest(name, &value(recorded), &value(found)))
}

/// The innermost member that differs.
fn deepest(name: &str, recorded: &serde_json::Value, found: &serde_json::Value) -> String {
    use serde_json::Value::{Array, Object};
    let inner = match (recorded, found) {
        (Object(a), Object(b)) => {
            let mut pairs = a.iter().filter_map(|(key, a)| Some((key, a, b.get(key)?)));
            let first = pairs.find(|(_, a, b)| differ(a, b));
            first.map(|(key, a, b)| deepest(&format!("{name}.{key}"), a, b))
        }
        (Array(a), Array(b)) => {
            let mut pairs = a.iter().zip(b).enumerate();
            let first = pairs.find(|(_, (a, b))| differ(a, b));
            first.map(|(k, (a, b))| deepest(&format!("{name}[{k}]"), a, b))
        }
        _ => None,
    };
    inner.unwrap_or_else(|| format!("{name}: {recorded} recorded, {found} now"))
}

/// Whether two values have different texts: as numbers, -0 is 0.
fn differ(a: &serde_json::Value, b: &serde_json::Value) -> bool {
    let texts = [a, b].map(ToString::to_string);
    texts[0] != texts[1]
}
