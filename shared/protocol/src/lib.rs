//! What `hrtc` and `ve-station` say to each other.
//!
//! | service | direction | payload |
//! |---|---|---|
//! | `hrtc/v3/subscribe` | controller to station | [`Request`] |
//! | `hrtc/v3/records/CLIENT` | station to one controller | [`ChunkHeader`] and 64 [`ChunkSlot`]s |
//! | `hrtc/v3/pose` | controller to station | [`ContactReport`] |
//! | `hrtc/hello` | both ways | [`Hello`], whose first bytes never change |
//!
//! **A session** is what a client and a station say about one object. Each has its own numbers, its own epochs and
//! its own belief of what is held, also where two objects have the same model; all sessions of a client share its
//! topic of records, and a chunk says by its object where it belongs. A client has sessions of the objects that it
//! has awake ([`RequestKind::Close`] ends one), and never goes back in the epochs of an object.
//!
//! **Epochs heal.** A controller numbers its requests and the station its chunks, both from 0 in every
//! *epoch*. Whoever misses something (a gap in the numbers, 200 ms of silence, a new incarnation of the
//! other side) ends the epoch: the controller counts it up, tells the regions it still holds and asks
//! again for the rest; the station forgets what it believed of that session and starts from what it is told.
//! A chunk of an older epoch is dropped. So every loss ends in the same mesh as a fresh start.
//!
//! **Answers count on what the client holds.** The station sends the records that no region held contains, and
//! says of every id whether its record follows. Who drops a region while an answer is under way may drop what
//! that answer counts on. It finds out when it reads the id, and asks for that region again, with every record
//! ([`RegionAction::Resend`]): such an answer counts on nothing. Parts of the answer before it are told apart by
//! [`PartHead::FIRST`], which every answer begins with.
//!
//! **Credit.** Every request carries how many chunks of the epoch were consumed and how many may be under way; the
//! station never has more under way in that session. A client shares out [`CREDIT_CHUNKS`] to its sessions.

#![deny(clippy::disallowed_methods, clippy::disallowed_types)]

mod answers;
mod hello;
mod wire;

pub use answers::{AnswerItem, AnswersReader, AnswersWriter, DamagedAnswers, PartHead};
pub use hello::{HELLO_PERIOD_MS, Hello, HelloError, PROTOCOL_VERSION, Role};
pub use wire::{
    ANSWER_TIMEOUT_MS, CHUNK_SLOTS, CREDIT_CHUNKS, ChunkHeader, ChunkKind, ChunkSlot,
    ContactReport, MAX_CLIENTS, MAX_SESSIONS, MODEL_HEADER_SLOTS, MeasuredError,
    REGIONS_PER_REQUEST, Refusal, RegionAction, RegionAsk, Request, RequestKind, TourAsk,
    TourPoint,
};
