//! The messages in shared memory: fixed size, plain data, SI units unless stated.

use bytemuck::{Pod, Zeroable};
use iceoryx2_bb_derive_macros::ZeroCopySend;
use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
use spm::{ModelHeader, QuarteredFace};
use std::mem::offset_of;

/// Slots of a chunk (4 KiB). On the way a compact one takes fewer: see [`super::ChunkEncoder`].
pub const CHUNK_SLOTS: usize = 64;
/// Chunks that may be under way to one client, in all of its sessions together.
pub const CREDIT_CHUNKS: u64 = 32;
/// Chunks that may be under way to a client far away, where [`CREDIT_CHUNKS`] would be sent in less
/// than a round trip: as many as the queue of its topic holds, so that none is lost where all come
/// at once.
pub const MAX_CREDIT_CHUNKS: u64 = 64;
/// Sessions of one client that a station keeps: those of its active objects, and as many that have
/// just ended.
pub const MAX_SESSIONS: usize = 18;
/// Controllers that a station serves at once.
pub const MAX_CLIENTS: usize = 16;
/// Largest number of regions in one request.
pub const REGIONS_PER_REQUEST: usize = 32;
/// Silence after which a request is repeated, milliseconds, where the round trip is not longer.
pub const ANSWER_TIMEOUT_MS: u64 = 200;

/// Enums that travel as numbers.
macro_rules! codes {
    ($($(#[$doc:meta])* pub enum $name:ident {
        $($(#[$of_variant:meta])* $variant:ident = $code:literal,)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u32)]
        pub enum $name {
            $($(#[$of_variant])* $variant = $code,)*
        }

        impl $name {
            /// The meaning of a received code; `None` for one of another version.
            #[must_use]
            pub fn from_code(code: u32) -> Option<Self> {
                match code {
                    $($code => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }
    )*};
}

codes! {
    /// Content of a chunk.
    pub enum ChunkKind {
        /// [`ModelHeader`] in the first slots, then [`spm::BaseVertex`] four to a slot, then, from
        /// a new slot on, [`spm::BaseFace`] two to a slot.
        Model = 1,
        /// Closures of regions and their missing records, packed: see [`super::AnswersReader`].
        Answers = 2,
        /// [`MeasuredError`]s, two to a slot.
        Measured = 4,
        /// [`TourPoint`]s, one to a slot; `code` is the index of the first in its path.
        Tour = 5,
        /// The request cannot be served; `code` is the [`Refusal`].
        Refused = 6,
        /// Bytes of a file: see [`super::FileChunk`].
        File = 7,
        /// [`QuarteredFace`]s, packed: see [`quartered_faces`]; `code` is the place of the first in
        /// the model.
        Quarters = 8,
    }

    /// How chunks travel to a client.
    pub enum Encoding {
        /// With all of their slots.
        Plain = 0,
        /// Compact where that is smaller: see [`super::ChunkEncoder`].
        Compact = 1,
    }

    /// Reasons to refuse a request.
    pub enum Refusal {
        /// No object of that number, or another model than the client named.
        UnknownModel = 1,
        /// No cell of that number in the grid of the tolerance's level.
        UnknownRegion = 2,
        /// A needed block of the file fails its checksum.
        DamagedBlock = 3,
        /// The tolerance is negative or not a number.
        Tolerance = 4,
        /// Numbers of a scripted path that are not finite, not positive, or beyond the model.
        Tour = 5,
        /// The station serves [`MAX_CLIENTS`] others.
        NoPlace = 6,
        /// No file of that hash, see [`super::FileChunk`].
        UnknownFile = 7,
    }
}

/// The user header of a chunk.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.ChunkHeader.v12")]
pub struct ChunkHeader {
    /// Incarnation of the sending station.
    pub station: u64,
    /// The receiving client.
    pub client: u64,
    /// Content hash of the model.
    pub model: u64,
    /// Number of this chunk in its epoch, from 0.
    pub sequence: u64,
    /// Epoch of the session that it answers.
    pub epoch: u32,
    /// [`ChunkKind`] as a number.
    pub kind: u32,
    /// Object of the scene.
    pub object: u32,
    /// Region (refused).
    pub region: u32,
    /// Its tolerance, the bits of an f32, model units.
    pub tolerance_bits: u32,
    /// Bytes of the parts (answers); elsewhere the number of items in this chunk: base vertices and
    /// faces, quartered faces, measured errors or path points.
    pub count: u32,
    /// 1 on the last chunk of an answer; for kind Answers, when the last part ends its answer.
    pub last: u32,
    /// [`Refusal`] as a number; elsewhere the index of the chunk's first slot in its answer.
    pub code: u32,
    /// The station's clock when it sent this, microseconds, from any start; it wraps around.
    pub sent_us: u32,
    /// 1 when it was ready before, and waited for the client's credit.
    pub waited_for_credit: u32,
    /// XXH3 of the slots, seeded with that of the fields above; see [`ChunkHeader::seal`].
    pub checksum: u64,
}

impl ChunkHeader {
    /// Sets the checksum, when everything else is set.
    pub fn seal(&mut self, slots: &[ChunkSlot; CHUNK_SLOTS]) {
        self.checksum = self.checksum_with(slots);
    }

    /// A chunk that tells its reader that something of this epoch is missing, and holds nothing: no
    /// epoch comes to its number, so there is a gap before it.
    #[must_use]
    pub fn of_gap(&self) -> (Self, [ChunkSlot; CHUNK_SLOTS]) {
        let slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
        let mut header = Self {
            sequence: u64::MAX,
            count: 0,
            last: 0,
            ..*self
        };
        header.seal(&slots);
        (header, slots)
    }

    /// Whether header and slots are as they were sealed: a coordinate that was changed on the way
    /// is finite still, and would be rendered.
    #[must_use]
    pub fn is_sound(&self, slots: &[ChunkSlot; CHUNK_SLOTS]) -> bool {
        self.checksum == self.checksum_with(slots)
    }

    fn checksum_with(&self, slots: &[ChunkSlot; CHUNK_SLOTS]) -> u64 {
        let plain = Self {
            checksum: 0,
            ..*self
        };
        let seed = xxhash_rust::xxh3::xxh3_64(bytemuck::bytes_of(&plain));
        xxhash_rust::xxh3::xxh3_64_with_seed(bytemuck::cast_slice(slots), seed)
    }
}

/// Sixty-four bytes of a chunk.
#[repr(C)]
#[repr(align(8))]
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Pod,
    Zeroable,
    ZeroCopySend,
    serde::Serialize,
    serde::Deserialize,
)]
#[type_name("hrtc.ChunkSlot.v12")]
pub struct ChunkSlot {
    /// Raw words; cast with `bytemuck`.
    pub words: [u32; 16],
}

/// Slots of the [`ModelHeader`]. It and the base mesh are types of the file; the crate `spm`
/// asserts their layout, so a change of the wire needs types of its own.
pub const MODEL_HEADER_SLOTS: usize = 4;
const _: () = assert!(size_of::<ModelHeader>() <= MODEL_HEADER_SLOTS * 64);

/// [`QuarteredFace`]s in a chunk at the most.
pub const QUARTERED_PER_CHUNK: usize =
    CHUNK_SLOTS * size_of::<ChunkSlot>() / size_of::<QuarteredFace>();
const QUARTERED_BYTES: usize = QUARTERED_PER_CHUNK * size_of::<QuarteredFace>();

/// The places of a chunk of kind [`ChunkKind::Quarters`].
#[must_use]
pub fn quartered_faces(slots: &[ChunkSlot; CHUNK_SLOTS]) -> &[QuarteredFace] {
    let bytes: &[u8] = bytemuck::cast_slice(slots);
    bytemuck::cast_slice(&bytes[..QUARTERED_BYTES])
}

/// See [`quartered_faces`].
#[must_use]
pub fn quartered_faces_mut(slots: &mut [ChunkSlot; CHUNK_SLOTS]) -> &mut [QuarteredFace] {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(slots);
    bytemuck::cast_slice_mut(&mut bytes[..QUARTERED_BYTES])
}

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

/// Time between two points of a tour, seconds.
pub const TOUR_PERIOD_S: f64 = 0.005;
/// The longest tour, seconds: a day.
pub const LONGEST_TOUR_S: f64 = 86_400.0;

/// How many points a tour of so many seconds has; one that is longer than the longest is refused.
#[must_use]
pub fn tour_points(seconds: f64) -> u64 {
    // What is written as a multiple of the period is one, though its quotient may round up.
    (seconds / TOUR_PERIOD_S * (1.0 - 1e-12)).ceil() as u64 + 1
}

/// One point of a scripted path, 64 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, serde::Serialize, serde::Deserialize)]
pub struct TourPoint {
    /// Seconds from the start.
    pub t: f64,
    /// Intended position of the probe's centre, model units (the file's frame, origin included).
    pub position: [f64; 3],
    /// Orientation, w first.
    pub orientation_wxyz: [f64; 4],
}

codes! {
    /// Subject of a request.
    pub enum RequestKind {
        /// Only the credit.
        Credit = 1,
        /// The model of an object: header and base mesh.
        Model = 2,
        /// Regions to subscribe, declare resident, or release.
        Regions = 3,
        /// A scripted path over the object.
        Tour = 4,
        /// The object is no longer active at the client: the session ends.
        Close = 5,
        /// Chunks of a file: see [`super::FileAsk`].
        File = 6,
        /// A chunk of the model's quartered faces.
        Quarters = 7,
    }
}

codes! {
    /// Action of a request on one region.
    pub enum RegionAction {
        /// Send its closure and the missing records.
        Subscribe = 1,
        /// The region is resident at the client (declared at the start of an epoch).
        Resident = 2,
        /// The client has unloaded it.
        Release = 3,
        /// Like Subscribe, but with every record of the closure.
        Resend = 4,
    }
}

/// One region of a request.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
pub struct RegionAsk {
    /// [`spm::RegionId`] as a number.
    pub region: u32,
    /// Bits of the f32 tolerance, model units; 0 is full resolution. For a prefix, the number of
    /// its VSPs.
    pub tolerance_bits: u32,
    /// [`RegionAction`] as a number.
    pub action: u32,
}

/// Parameters of a scripted path.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, serde::Serialize, serde::Deserialize)]
pub struct TourAsk {
    /// Seed of its random choices.
    pub seed: u64,
    /// Length, seconds.
    pub seconds: f64,
    /// Speed, model units a second.
    pub speed: f64,
    /// Depth of the path below the surface, model units.
    pub depth: f64,
    /// Radius of the probe, model units.
    pub radius: f64,
    /// Points that the client has: those from here on are sent. The same ask has the same points,
    /// whichever station of the model is asked.
    pub from: u64,
}

/// A message of the controller. It travels as the [`RequestWord`]s that its kind needs.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
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
    /// Epoch of the session.
    pub epoch: u32,
    /// [`RequestKind`] as a number.
    pub kind: u32,
    /// Object of the scene.
    pub object: u32,
    /// Valid entries of `regions`; the place of the first quartered face (kind Quarters); slots of
    /// the model that the client has (kind Model): those from there on are sent, or all of them by
    /// a station that does not know that.
    pub count: u32,
    /// Chunks that may be under way in this session from now on; the sessions of a client share
    /// [`CREDIT_CHUNKS`], or up to [`MAX_CREDIT_CHUNKS`] of one far away.
    pub credit: u32,
    /// How this client wants its chunks from now on, in all of its sessions: [`Encoding`] as a
    /// number; plain for a number of another version.
    pub encoding: u32,
    /// Regions (kind Regions); all before them is in every message.
    pub regions: [RegionAsk; REGIONS_PER_REQUEST],
    /// Tour (kind Tour).
    pub tour: TourAsk,
}

/// Four bytes of a request.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.RequestWord.v12")]
pub struct RequestWord {
    word: u32,
}

impl Request {
    /// Hash of a model's name, to check that both sides mean the same model.
    #[must_use]
    pub fn name_hash(name: &str) -> u64 {
        xxhash_rust::xxh3::xxh3_64(name.as_bytes())
    }

    /// Words of the longest.
    pub const MAX_WORDS: usize = size_of::<Self>() / size_of::<RequestWord>();
    /// Words before the regions.
    const HEAD_WORDS: usize = offset_of!(Self, regions) / size_of::<RequestWord>();

    /// The message: as many words as its kind needs.
    #[must_use]
    pub fn words(&self) -> &[RequestWord] {
        let all: &[RequestWord] = bytemuck::cast_slice(std::slice::from_ref(self));
        let count = (self.count as usize).min(REGIONS_PER_REQUEST);
        let regions = count * (size_of::<RegionAsk>() / size_of::<RequestWord>());
        match RequestKind::from_code(self.kind) {
            Some(RequestKind::Tour) => all,
            Some(RequestKind::Regions) => &all[..Self::HEAD_WORDS + regions],
            _ => &all[..Self::HEAD_WORDS],
        }
    }

    /// A copy of what a message says: what it lacks is zero, what it has beyond is left.
    #[must_use]
    pub fn of_words(words: &[RequestWord]) -> Self {
        let mut request = Self::zeroed();
        let all: &mut [RequestWord] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut request));
        let used = words.len().min(all.len());
        all[..used].copy_from_slice(&words[..used]);
        request
    }
}

/// Pose and contact of one tick, for the measured error and the view. Sent decimated.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable, ZeroCopySend)]
#[type_name("hrtc.ContactReport.v12")]
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// 0.07 s by 0.005 s is 14 and a little more.
    #[test]
    fn a_tour_has_a_point_each_period_and_one_at_its_end() {
        for periods in 0..4000u32 {
            let seconds = f64::from(periods) / 200.0;
            let points = u64::from(periods) + 1;
            assert_eq!(tour_points(seconds), points, "{seconds} s");
            let longer = (f64::from(periods) + 0.001) / 200.0;
            assert_eq!(tour_points(longer), points + 1, "{longer} s");
        }
        assert_eq!(tour_points(LONGEST_TOUR_S), 17_280_001);
    }

    fn any_request() -> impl Strategy<Value = Request> {
        let bytes = prop::collection::vec(any::<u8>(), size_of::<Request>());
        (bytes, 0..8_u32, 0..40_u32).prop_map(|(bytes, kind, count)| Request {
            kind,
            count,
            ..bytemuck::pod_read_unaligned(&bytes)
        })
    }

    proptest! {
        #[test]
        fn a_request_arrives_as_its_kind_needs_it_and_takes_no_more_words(request in any_request()) {
            let arrived = Request::of_words(request.words());
            let regions = (request.count as usize).min(REGIONS_PER_REQUEST);
            let bytes = size_of_val(request.words());
            let head = Request { regions: arrived.regions, tour: arrived.tour, ..request };
            prop_assert_eq!(bytemuck::bytes_of(&head), bytemuck::bytes_of(&arrived));
            match RequestKind::from_code(request.kind) {
                Some(RequestKind::Tour) => {
                    let tours = [&request.tour, &arrived.tour].map(bytemuck::bytes_of);
                    prop_assert_eq!(tours[0], tours[1]);
                }
                Some(RequestKind::Regions) => {
                    prop_assert_eq!(&request.regions[..regions], &arrived.regions[..regions]);
                    prop_assert_eq!(bytes, 72 + 12 * regions);
                }
                _ => prop_assert_eq!(bytes, 72),
            }
        }

        #[test]
        fn any_words_are_a_request(words in prop::collection::vec(any::<u32>(), 0..200)) {
            let words: Vec<RequestWord> = words.into_iter().map(|word| RequestWord { word }).collect();
            let request = Request::of_words(&words);
            let all: &[RequestWord] = bytemuck::cast_slice(std::slice::from_ref(&request));
            let known = words.len().min(all.len());
            prop_assert_eq!(&all[..known], &words[..known]);
            prop_assert!(all[known..].iter().all(|of| of.word == 0));
        }

        #[test]
        fn a_changed_bit_anywhere_in_a_chunk_is_noticed(
            content in prop::collection::vec(any::<u8>(), CHUNK_SLOTS * size_of::<ChunkSlot>()),
            head in prop::array::uniform32(any::<u8>()),
            bit in 0..8 * (size_of::<ChunkHeader>() + CHUNK_SLOTS * size_of::<ChunkSlot>()),
        ) {
            let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            bytemuck::cast_slice_mut(&mut slots).copy_from_slice(&content);
            let mut header = ChunkHeader::zeroed();
            bytemuck::bytes_of_mut(&mut header)[..head.len()].copy_from_slice(&head);
            header.seal(&slots);
            prop_assert!(header.is_sound(&slots));
            let (byte, mask) = (bit / 8, 1 << (bit % 8));
            match byte.checked_sub(size_of::<ChunkHeader>()) {
                None => bytemuck::bytes_of_mut(&mut header)[byte] ^= mask,
                Some(byte) => bytemuck::cast_slice_mut::<_, u8>(&mut slots)[byte] ^= mask,
            }
            prop_assert!(!header.is_sound(&slots));
        }
    }
}
