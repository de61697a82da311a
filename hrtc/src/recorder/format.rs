//! The form of a recording: its channels, and how a message for a replay is sealed.
//!
//! Channels for people (`/probe/0/wrench`) are protobuf, described in the file.
//! Channels for a replay (`/replay/tick`) are binary: postcard for a tick, plain records for what
//! crossed the link, and for a state, which is large, parts of its postcard. Each of their messages
//! ends with the hash of its bytes, so that a change is found wherever it is.

use bytemuck::{Pod, Zeroable};
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot, ContactReport, Request};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

/// Profile of the file; the number grows when a replay of older files is not possible any more.
pub(super) const PROFILE: &str = "hrtc-46";
/// Attachment with the [`super::RecordingHead`].
pub(super) const HEAD: &str = "hrtc/run.json";
/// Attachments with the files of the scene begin so; the path follows, as in [`super::paths`].
pub(super) const FILES: &str = "scene/";

/// A channel for a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Channel {
    /// A part of the state of the controller after all messages before it, as in
    /// [`keyframe_part`]. No other message for a replay comes between two.
    Keyframe,
    /// A chunk, in the order of arrival.
    Chunk,
    /// A request, before the tick that made it.
    Request,
    /// A contact report, before the tick that made it.
    Report,
    /// A [`crate::tick_record::TickRecord`].
    Tick,
    /// A [`Hole`].
    Hole,
}

impl Channel {
    pub(super) const ALL: [Self; 6] = [
        Self::Keyframe,
        Self::Chunk,
        Self::Request,
        Self::Report,
        Self::Tick,
        Self::Hole,
    ];

    pub(super) const fn topic(self) -> &'static str {
        match self {
            Self::Keyframe => "/replay/keyframe",
            Self::Chunk => "/replay/chunk",
            Self::Request => "/replay/request",
            Self::Report => "/replay/report",
            Self::Tick => "/replay/tick",
            Self::Hole => "/replay/hole",
        }
    }

    /// Name of the message's form.
    pub(super) const fn encoding(self) -> &'static str {
        match self {
            Self::Tick | Self::Hole => "postcard",
            Self::Keyframe => "postcard in parts",
            Self::Chunk | Self::Request | Self::Report => "plain",
        }
    }
}

/// Ticks that are not in the recording, or whose messages are not whole.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hole {
    /// First tick.
    pub first: u64,
    /// Last tick.
    pub last: u64,
    /// Why.
    pub reason: String,
}

/// A chunk with its number in the order of arrival.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct PlainChunk {
    pub index: u64,
    pub header: ChunkHeader,
    pub slots: [ChunkSlot; CHUNK_SLOTS],
}

impl PlainChunk {
    pub(super) fn new(index: u64, chunk: &InboxChunk) -> Self {
        let InboxChunk { header, slots } = *chunk;
        Self {
            index,
            header,
            slots,
        }
    }

    pub(super) fn chunk(&self) -> InboxChunk {
        let Self { header, slots, .. } = *self;
        InboxChunk { header, slots }
    }
}

/// A request with the tick that made it.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct PlainRequest {
    pub tick: u64,
    pub request: Request,
}

/// A contact report with the tick that made it.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct PlainReport {
    pub tick: u64,
    pub report: ContactReport,
}

/// Bytes that each part of a keyframe has behind those of the state: its number, and whether it is
/// the last.
const PART_TAIL_BYTES: usize = 5;
/// Bytes of a hash.
const HASH_BYTES: usize = 8;

/// A part of a keyframe's state with its number, from 0, and whether it is the last.
pub(super) fn keyframe_part(state: &[u8], number: u32, is_last: bool) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(state.len() + PART_TAIL_BYTES + HASH_BYTES);
    bytes.extend_from_slice(state);
    bytes.extend_from_slice(&number.to_le_bytes());
    bytes.push(u8::from(is_last));
    bytes
}

/// What [`keyframe_part`] was made of; `None` when it is none.
pub(super) fn of_keyframe_part(bytes: &[u8]) -> Option<(&[u8], u32, bool)> {
    let (state, tail) = bytes.split_last_chunk::<PART_TAIL_BYTES>()?;
    let [number @ .., is_last] = tail;
    Some((state, u32::from_le_bytes(*number), *is_last != 0))
}

/// Bytes with their hash behind them.
pub(super) fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = xxh3_64(&bytes);
    bytes.extend_from_slice(&hash.to_le_bytes());
    bytes
}

/// The bytes before their hash; `None` when they are not those that were sealed.
pub(super) fn unsealed(bytes: &[u8]) -> Option<&[u8]> {
    let (bytes, hash) = bytes.split_last_chunk::<HASH_BYTES>()?;
    (xxh3_64(bytes) == u64::from_le_bytes(*hash)).then_some(bytes)
}
