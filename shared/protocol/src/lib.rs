//! The messages between `hrtc` and `ve-station`.
//!
//! | module | content |
//! |---|---|
//! | `wire` | messages as they are in shared memory |
//! | `answers` | closures and records, packed into chunks |
//! | `compact` | chunks in as few bytes as they need |
//! | `files` | files of the scene, by the hash of their content |
//! | `hello` | the heartbeat, which also tells versions apart |
//! | `version` | the version, and the names of the topics |
//!
//! With N for the [`PROTOCOL_VERSION`]:
//!
//! | topic | direction | payload |
//! |---|---|---|
//! | `hrtc/vN/subscribe` | controller to station | [`Request`] as [`RequestWord`]s |
//! | `hrtc/vN/records/CLIENT` | station to one controller | [`ChunkHeader`] and up to 64 [`ChunkSlot`]s |
//! | `hrtc/vN/pose` | controller to station | [`ContactReport`] |
//! | `hrtc/hello` | both ways | [`Hello`], whose first bytes never change |
//!
//! **A session** is the exchange of a client and a station about one object. Each session has its
//! own sequence numbers, its own epochs and its own state of residency, also where two objects have
//! the same model. All sessions of a client share its topic of records; a chunk names its object. A
//! client has sessions of its active objects ([`RequestKind::Close`] ends one). The epochs of an
//! object never decrease.
//!
//! **Epochs restore agreement.** A controller numbers its requests and the station its chunks, both
//! from 0 in every *epoch*. A side that misses something (a gap in the numbers, silence for longer
//! than the measured round trip and 200 ms, a new incarnation of the peer) ends the epoch: the
//! controller increments it, declares the regions that are still resident and requests the rest
//! again; the station discards its assumptions about the session and starts from that declaration.
//! A station that misses a request says so at once ([`ChunkHeader::of_gap`]): only where the last
//! message is the one that is lost, silence must tell. A chunk of an older epoch is dropped. So
//! every loss ends in the same mesh as a fresh start. Of a model and a tour what came stays: the
//! request says how many slots or points are there ([`Request::count`], [`TourAsk::from`]).
//!
//! **Answers depend on residency.** The station sends the records that no resident region contains,
//! and marks for every id whether its record follows. When a client drops a region while an answer
//! is under way, it may drop records that the answer depends on. It detects this at the id, and
//! requests that region again with every record ([`RegionAction::Resend`]); such an answer depends
//! on nothing. Every answer begins with [`PartHead::FIRST`], which separates it from the rest of an
//! older one.
//!
//! **Credit.** Every request carries the number of consumed chunks of the epoch and the number that
//! may be under way; the station never exceeds it in that session. A client divides
//! [`CREDIT_CHUNKS`] among its sessions, and up to [`MAX_CREDIT_CHUNKS`] where a round trip to the
//! station takes long.
//!
//! **Quarters.** The bounds of quarters ([`spm::QuarteredFace`]) only tell how accurate a contact
//! is, and may be larger than the base mesh: a controller asks for them chunk by chunk, when it has
//! awaited no answer for a round trip.
//!
//! **Files.** The plan of the scene and the files that it names (tools, height maps, trajectories)
//! are asked for before any session, chunk by chunk, by the hash of their content ([`FileAsk`],
//! [`FileChunk`]); [`FileHash::SCENE`] stands for the plan. They belong to no session, epoch or
//! credit: no more than [`CREDIT_CHUNKS`] are asked for at a time. Every station of a domain
//! answers them, with its incarnation in each chunk: a client takes those of one.
//!
//! ```
//! use protocol::{AnswerItem, AnswersReader, AnswersWriter};
//!
//! // One answer: region 7 at tolerance 0 has the VSPs 3 and 5, both resident at the client.
//! let mut writer = AnswersWriter::new();
//! writer.begin(7, 0, true);
//! assert!(writer.id(3, false) && writer.id(5, false));
//! writer.end(true);
//! let (count, slots) = writer.finish();
//!
//! let mut reader = AnswersReader::new(count);
//! let mut ids = Vec::new();
//! while let Some(item) = reader.next(&slots).unwrap() {
//!     if let AnswerItem::Id { id, .. } = item {
//!         ids.push(id);
//!     }
//! }
//! assert_eq!(ids, [3, 5]);
//! assert!(reader.head().is_last());
//! ```

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]

mod answers;
mod compact;
mod files;
mod hello;
pub mod tour;
mod version;
mod wire;

pub use answers::{AnswerItem, AnswersReader, AnswersWriter, DamagedAnswers, PartHead};
pub use compact::{ChunkDecoder, ChunkEncoder, CompactError};
pub use files::{FILE_CHUNK_BYTES, FileAsk, FileChunk, FileHash, NoFileHash, file_chunks};
pub use hello::{BUILD, Greeting, HELLO_PERIOD_MS, Hello, HelloError, Role};
pub use version::{
    HELLO_TOPIC, POSE_TOPIC, PROTOCOL_VERSION, RECORDS_TOPICS, SUBSCRIBE_TOPIC, records_topic,
};
pub use wire::{
    ANSWER_TIMEOUT_MS, CHUNK_SLOTS, CREDIT_CHUNKS, ChunkHeader, ChunkKind, ChunkSlot,
    ContactReport, Encoding, LONGEST_TOUR_S, MAX_CLIENTS, MAX_CREDIT_CHUNKS, MAX_SESSIONS,
    MODEL_HEADER_SLOTS, MeasuredError, QUARTERED_PER_CHUNK, REGIONS_PER_REQUEST, Refusal,
    RegionAction, RegionAsk, Request, RequestKind, RequestWord, TOUR_PERIOD_S, TourAsk, TourPoint,
    quartered_faces, quartered_faces_mut, tour_points,
};
