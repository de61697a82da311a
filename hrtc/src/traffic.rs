//! Bytes of the messages between controller and station, by kind: as they travel, compact where
//! they do, without what carries them.

use protocol::{ChunkKind, ContactReport, Hello, Request};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes of messages, by kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct LinkBytes {
    /// Received: closures and records of regions.
    pub answers: u64,
    /// Base meshes.
    pub models: u64,
    /// Points of tours.
    pub tours: u64,
    /// Measured errors, refusals, and whatever else comes as a chunk.
    pub others: u64,
    /// Heartbeats, of stations and of other controllers.
    pub heartbeats_heard: u64,
    /// Sent: requests.
    pub requests: u64,
    /// Contact reports.
    pub contacts: u64,
    /// Heartbeats.
    pub heartbeats: u64,
}

impl LinkBytes {
    /// Of all that comes as chunks.
    #[must_use]
    pub fn chunks(&self) -> u64 {
        self.answers + self.models + self.tours + self.others
    }
}

/// The same while it grows: the link adds, anyone reads.
#[derive(Debug, Default)]
pub struct Traffic {
    answers: AtomicU64,
    models: AtomicU64,
    tours: AtomicU64,
    others: AtomicU64,
    heartbeats_heard: AtomicU64,
    requests: AtomicU64,
    contacts: AtomicU64,
    heartbeats: AtomicU64,
}

fn add(to: &AtomicU64, bytes: usize) {
    to.fetch_add(bytes as u64, Ordering::Relaxed);
}

impl Traffic {
    /// A chunk of a kind came, with its header.
    pub fn chunk(&self, kind: u32, bytes: usize) {
        let of = match ChunkKind::from_code(kind) {
            Some(ChunkKind::Answers) => &self.answers,
            Some(ChunkKind::Model) => &self.models,
            Some(ChunkKind::Tour) => &self.tours,
            Some(ChunkKind::Measured | ChunkKind::Refused | ChunkKind::File) | None => &self.others,
        };
        add(of, bytes);
    }

    /// A heartbeat came.
    pub fn heartbeat_heard(&self) {
        add(&self.heartbeats_heard, size_of::<Hello>());
    }

    /// A request was sent.
    pub fn request(&self, request: &Request) {
        add(&self.requests, size_of_val(request.words()));
    }

    /// A contact report was sent.
    pub fn contact(&self) {
        add(&self.contacts, size_of::<ContactReport>());
    }

    /// A heartbeat was sent.
    pub fn heartbeat(&self) {
        add(&self.heartbeats, size_of::<Hello>());
    }

    /// What has crossed so far.
    #[must_use]
    pub fn bytes(&self) -> LinkBytes {
        let of = |bytes: &AtomicU64| bytes.load(Ordering::Relaxed);
        LinkBytes {
            answers: of(&self.answers),
            models: of(&self.models),
            tours: of(&self.tours),
            others: of(&self.others),
            heartbeats_heard: of(&self.heartbeats_heard),
            requests: of(&self.requests),
            contacts: of(&self.contacts),
            heartbeats: of(&self.heartbeats),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;

    #[test]
    fn every_message_counts_for_its_kind_as_long_as_it_travels() {
        let traffic = Traffic::default();
        let kinds = [ChunkKind::Answers, ChunkKind::Model, ChunkKind::Tour];
        for (kind, bytes) in kinds.into_iter().zip([10, 200, 3000]) {
            traffic.chunk(kind as u32, bytes);
        }
        // A kind of a later version counts too.
        for kind in [ChunkKind::Measured as u32, u32::MAX] {
            traffic.chunk(kind, 40_000);
        }
        let request = Request::zeroed();
        traffic.request(&request);
        traffic.contact();
        let bytes = traffic.bytes();
        assert_eq!(bytes.answers + bytes.models + bytes.tours, 3210);
        assert_eq!((bytes.others, bytes.chunks()), (80_000, 83_210));
        assert!(bytes.requests > 0 && bytes.requests < size_of::<Request>() as u64);
        assert_eq!(bytes.contacts, size_of::<ContactReport>() as u64);
        assert_eq!((bytes.heartbeats, bytes.heartbeats_heard), (0, 0));
    }
}
