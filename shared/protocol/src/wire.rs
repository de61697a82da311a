//! The messages as they lie in shared memory: fixed size, plain data, SI units unless said.

use bytemuck::{Pod, Zeroable};
use iceoryx2_bb_derive_macros::ZeroCopySend;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use spm::ModelHeader;

/// Slots of a chunk; every chunk is sent whole (4 KiB), so that a tunnel's segments never grow.
pub const CHUNK_SLOTS: usize = 64;
/// Chunks that may be under way to one client, in all of its sessions together.
pub const CREDIT_CHUNKS: u64 = 32;
/// Sessions of one client that a station keeps: those of the objects that the client has awake, and as many again
/// that it has just given up.
pub const MAX_SESSIONS: usize = 18;
/// Controllers that a station serves at once.
pub const MAX_CLIENTS: usize = 16;
/// Regions named by one request at the most.
pub const REGIONS_PER_REQUEST: usize = 32;
/// Silence after which a question is asked again, milliseconds.
pub const ANSWER_TIMEOUT_MS: u64 = 200;

/// What a chunk carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum ChunkKind {
    /// [`ModelHeader`] in the first slots, then [`BaseVertex`] four to a slot, then, from a fresh slot on,
    /// [`BaseFace`] two to a slot.
    Model = 1,
    /// Closures of regions and the records of them that the client lacks, packed: see
    /// [`super::AnswersReader`].
    Answers = 2,
    /// [`MeasuredError`]s, two to a slot.
    Measured = 4,
    /// [`TourPoint`]s, one to a slot.
    Tour = 5,
    /// The request cannot be served; `code` says why ([`Refusal`]).
    Refused = 6,
}

impl ChunkKind {
    /// The kind of a received code, `None` for one of another version.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        [
            Self::Model,
            Self::Answers,
            Self::Measured,
            Self::Tour,
            Self::Refused,
        ]
        .into_iter()
        .find(|&kind| kind as u32 == code)
    }
}

/// Why the station refuses a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Refusal {
    /// No object of that number, or its model is another one than the client named.
    UnknownModel = 1,
    /// No cell of that number in the grid of the tolerance's level.
    UnknownRegion = 2,
    /// A block of the file that the region needs fails its checksum.
    DamagedBlock = 3,
    /// The tolerance is no number from 0 up.
    Tolerance = 4,
    /// The numbers of a tour cannot be served: not finite, not positive, or beyond the model.
    Tour = 5,
}

impl Refusal {
    /// The refusal of a received code.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        [
            Self::UnknownModel,
            Self::UnknownRegion,
            Self::DamagedBlock,
            Self::Tolerance,
            Self::Tour,
        ]
        .into_iter()
        .find(|&refusal| refusal as u32 == code)
    }
}

/// The user header of a chunk.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.ChunkHeader.v3")]
pub struct ChunkHeader {
    /// Incarnation of the sending station.
    pub station: u64,
    /// The client it is for.
    pub client: u64,
    /// Content hash of the model.
    pub model: u64,
    /// Number of this chunk in its epoch, from 0.
    pub sequence: u64,
    /// The session's epoch that it answers.
    pub epoch: u32,
    /// [`ChunkKind`] as a number.
    pub kind: u32,
    /// Object of the scene.
    pub object: u32,
    /// Region (refused).
    pub region: u32,
    /// Its tolerance, the bits of an f32, model units.
    pub tolerance_bits: u32,
    /// Bytes of the parts (answers); elsewhere items in this chunk: base items, measured errors or tour points.
    pub count: u32,
    /// 1 on the last chunk of an answer; of answers, when the last part ends its answer.
    pub last: u32,
    /// [`Refusal`] as a number; elsewhere the index of the chunk's first slot in its answer.
    pub code: u32,
}

/// Sixty-four bytes of a chunk.
#[repr(C)]
#[repr(align(8))]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.ChunkSlot.v3")]
pub struct ChunkSlot {
    /// Raw words; cast with `bytemuck`.
    pub words: [u32; 16],
}

/// Slots that the [`ModelHeader`] takes.
pub const MODEL_HEADER_SLOTS: usize = 4;
const _: () = assert!(size_of::<ModelHeader>() <= MODEL_HEADER_SLOTS * 64);

/// Exact distance of a reported contact to the full mesh.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct MeasuredError {
    /// The tick of the contact.
    pub tick: u64,
    /// Distance, model units.
    pub distance: f64,
    /// Zero.
    pub reserved: [u64; 2],
}

/// One point of a scripted path, 64 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct TourPoint {
    /// Seconds from the start.
    pub t: f64,
    /// Intended position of the probe's centre, model units (the file's frame, origin included).
    pub position: [f64; 3],
    /// Orientation, w first.
    pub orientation_wxyz: [f64; 4],
}

/// What a request asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum RequestKind {
    /// Only the credit in the head.
    Credit = 1,
    /// The model of an object: header and base mesh.
    Model = 2,
    /// Regions to subscribe, declare as held, or release.
    Regions = 3,
    /// A scripted path over the object.
    Tour = 4,
    /// The client has put the object to sleep: the session ends.
    Close = 5,
}

impl RequestKind {
    /// The kind of a received code.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        [
            Self::Credit,
            Self::Model,
            Self::Regions,
            Self::Tour,
            Self::Close,
        ]
        .into_iter()
        .find(|&kind| kind as u32 == code)
    }
}

/// What is asked of one region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum RegionAction {
    /// Send its closure, and the records that the client lacks.
    Subscribe = 1,
    /// The client holds it (said at the start of an epoch).
    Held = 2,
    /// The client dropped it.
    Release = 3,
    /// Like Subscribe, but with every record of the closure, whatever the client is believed to hold.
    Resend = 4,
}

impl RegionAction {
    /// The action of a received code.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        [Self::Subscribe, Self::Held, Self::Release, Self::Resend]
            .into_iter()
            .find(|&action| action as u32 == code)
    }
}

/// One region of a request.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.RegionAsk.v3")]
pub struct RegionAsk {
    /// [`spm::RegionId`] as a number.
    pub region: u32,
    /// Bits of the f32 tolerance, model units; 0 is full resolution. Of a prefix the number of its VSPs.
    pub tolerance_bits: u32,
    /// [`RegionAction`] as a number.
    pub action: u32,
}

/// What a tour is made from.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.TourAsk.v3")]
pub struct TourAsk {
    /// Seed of every choice.
    pub seed: u64,
    /// Length, seconds.
    pub seconds: f64,
    /// Speed, model units a second.
    pub speed: f64,
    /// How deep the intent lies below the surface, model units.
    pub depth: f64,
    /// Radius of the probe, model units.
    pub radius: f64,
}

/// A message of the controller.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.Request.v3")]
pub struct Request {
    /// The client.
    pub client: u64,
    /// Incarnation of the client.
    pub incarnation: u64,
    /// Number of this request in its epoch, from 0.
    pub sequence: u64,
    /// Chunks of this epoch consumed so far.
    pub consumed: u64,
    /// Content hash of the model; 0 while unknown.
    pub model: u64,
    /// Hash of the model's name in the scene ([`Request::name_hash`]), compared by the station.
    pub name: u64,
    /// Tour (kind Tour).
    pub tour: TourAsk,
    /// Epoch of the session.
    pub epoch: u32,
    /// [`RequestKind`] as a number.
    pub kind: u32,
    /// Object of the scene.
    pub object: u32,
    /// Valid entries of `regions`.
    pub count: u32,
    /// Chunks that may be under way in this session from now on; the client's sessions share [`CREDIT_CHUNKS`].
    pub credit: u32,
    /// Zero.
    pub reserved: u32,
    /// Regions (kind Regions).
    pub regions: [RegionAsk; REGIONS_PER_REQUEST],
}

impl Request {
    /// The hash by which both sides make sure that they speak of the same model.
    #[must_use]
    pub fn name_hash(name: &str) -> u64 {
        xxhash_rust::xxh3::xxh3_64(name.as_bytes())
    }
}

/// Pose and contact of one tick, for the measured error and the view. Sent decimated.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.ContactReport.v3")]
pub struct ContactReport {
    /// The client.
    pub client: u64,
    /// The tick.
    pub tick: u64,
    /// Probe of the scene.
    pub probe: u32,
    /// Object touched; [`spm::NONE`] in free space.
    pub object: u32,
    /// Probe position, world, metres.
    pub position: [f64; 3],
    /// Probe orientation, w first.
    pub orientation_wxyz: [f64; 4],
    /// Contact point on the front, model units (relative to the file's origin).
    pub contact: [f64; 3],
    /// Force on the device, newtons.
    pub force: [f64; 3],
}
