//! Bytes of the messages between controller and station, by kind: as they travel, compact where
//! they do, without what carries them.

use protocol::{ChunkKind, ContactReport, Hello, Request};
use serde::{Deserialize, Serialize};
use std::sync::{Mutex, MutexGuard, PoisonError};

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

/// The same while it grows: the link adds, anyone reads. The tick has no part in it.
#[derive(Debug, Default)]
pub struct Traffic(Mutex<LinkBytes>);

impl Traffic {
    /// A chunk of a kind came, with its header.
    pub fn chunk(&self, kind: u32, bytes: usize) {
        let mut all = self.lock();
        let of = match ChunkKind::from_code(kind) {
            Some(ChunkKind::Answers) => &mut all.answers,
            Some(ChunkKind::Model | ChunkKind::Quarters) => &mut all.models,
            Some(ChunkKind::Tour) => &mut all.tours,
            Some(ChunkKind::Measured | ChunkKind::Refused | ChunkKind::File) | None => {
                &mut all.others
            }
        };
        *of += bytes as u64;
    }

    /// A heartbeat came.
    pub fn heartbeat_heard(&self) {
        self.lock().heartbeats_heard += size_of::<Hello>() as u64;
    }

    /// A request was sent.
    pub fn request(&self, request: &Request) {
        self.lock().requests += size_of_val(request.words()) as u64;
    }

    /// A contact report was sent.
    pub fn contact(&self) {
        self.lock().contacts += size_of::<ContactReport>() as u64;
    }

    /// A heartbeat was sent.
    pub fn heartbeat(&self) {
        self.lock().heartbeats += size_of::<Hello>() as u64;
    }

    /// What has crossed so far.
    #[must_use]
    pub fn bytes(&self) -> LinkBytes {
        *self.lock()
    }

    fn lock(&self) -> MutexGuard<'_, LinkBytes> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
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
