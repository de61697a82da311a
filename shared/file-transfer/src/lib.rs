//! Files of a scene by the hash of their content, from the station to a controller: the two ends,
//! pure. Times come in as values, messages go out as values.
//!
//! | module | content |
//! |---|---|
//! | `server` | files and the questions for their chunks |
//! | `download` | one file, asked for until it is whole |
//! | `tuning` | sizes and times |
//!
//! The station remembers nothing of a client but the few ranges that it has not sent yet. The
//! client asks for ranges that are not here and not under way; when it hears nothing for a measured
//! round trip and its variation, all that was under way counts as lost. So loss, another order, a
//! restarted station and a restarted controller need no agreement. Of several stations it listens
//! to one.
//!
//! ```
//! use file_transfer::{Download, FileServer};
//! use protocol::FileHash;
//! use std::collections::BTreeMap;
//! use std::time::Duration;
//!
//! let content = vec![7; 100_000];
//! let hash = FileHash::of(&content);
//! let station = 1;
//! let mut server = FileServer::new(station, hash, BTreeMap::from([(hash, content.clone())]));
//!
//! // The scene itself needs no hash; client 42 takes at most a megabyte.
//! let (now, client) = (Duration::ZERO, 42);
//! let mut download = Download::new(client, station, FileHash::SCENE, 1 << 20, now);
//! while !download.is_whole() {
//!     while let Some(request) = download.ask(now) {
//!         server.handle(&request);
//!     }
//!     while let Some((header, slots)) = server.poll(client) {
//!         download.take(&header, &slots, now)?;
//!     }
//! }
//! assert_eq!(download.take_content(), content);
//! # Ok::<(), file_transfer::DownloadError>(())
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]
#![forbid(unsafe_code)]

mod download;
mod server;
#[cfg(test)]
mod tests;
pub mod tuning;

pub use download::{Download, DownloadError};
pub use server::{FileCounters, FileServer};

use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot};

/// A chunk: header and slots.
pub type Chunk = (ChunkHeader, [ChunkSlot; CHUNK_SLOTS]);
