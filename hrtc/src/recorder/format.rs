//! The form of a recording: its channels, and how a message for a replay is sealed.
//!
//! Channels for people (`/probe/0/wrench`) are protobuf, described in the file.
//! Channels for a replay (`/replay/tick`) are binary: postcard for a tick, plain records for what
//! crossed the link. Each of their messages ends with the hash of its bytes, so that a change is
//! found wherever it is.

use bytemuck::{Pod, Zeroable};
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot, ContactReport, Request};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

/// Profile of the file; the number grows when a replay of older files is not possible any more.
pub(super) const PROFILE: &str = "hrtc-42";
/// Attachment with the [`super::RecordingHead`].
pub(super) const HEAD: &str = "hrtc/run.json";
/// Attachments with the files of the scene begin so; the path follows, as in [`super::paths`].
pub(super) const FILES: &str = "scene/";

/// A channel for a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Channel {
    /// State of the controller after all messages before it.
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
            Self::Keyframe | Self::Tick | Self::Hole => "postcard",
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

/// Bytes with their hash behind them.
pub(super) fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = xxh3_64(&bytes);
    bytes.extend_from_slice(&hash.to_le_bytes());
    bytes
}

/// The bytes before their hash; `None` when they are not those that were sealed.
pub(super) fn unsealed(bytes: &[u8]) -> Option<&[u8]> {
    let (bytes, hash) = bytes.split_last_chunk::<8>()?;
    (xxh3_64(bytes) == u64::from_le_bytes(*hash)).then_some(bytes)
}
