//! Files of a scene, by the hash of their content: how requests and chunks carry them.
//!
//! Nothing of it belongs to a session. A request names a range of chunks, the station answers it
//! and forgets it; whoever misses some asks again. So loss, another order and a restart of either
//! side need no agreement.

use crate::{CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, Refusal, Request, RequestKind};
use bytemuck::Zeroable;
use std::fmt;
use std::str::FromStr;

/// Bytes of a file in a chunk; the last one has the rest.
pub const FILE_CHUNK_BYTES: usize = CHUNK_SLOTS * size_of::<ChunkSlot>();

/// Content hash of a file: XXH3 of 128 bits.
///
/// It tells one content from another and notices damage. It is no signature, and need be none: who
/// may serve a scene decides the forces on the hand anyway, and mutual TLS decides who may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FileHash(pub u128);

impl FileHash {
    /// Stands for the scene that the station serves, whatever its content.
    pub const SCENE: Self = Self(0);

    /// Hash of a content.
    #[must_use]
    pub fn of(content: &[u8]) -> Self {
        Self(xxhash_rust::xxh3::xxh3_128(content))
    }

    /// Lower and upper half.
    fn halves(self) -> [u64; 2] {
        [self.0 as u64, (self.0 >> 64) as u64]
    }

    fn from_halves([low, high]: [u64; 2]) -> Self {
        Self(u128::from(high) << 64 | u128::from(low))
    }
}

impl fmt::Display for FileHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

/// Not 32 digits of a hash.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a content hash has 32 lower-case hexadecimal digits")]
pub struct NoFileHash;

impl FromStr for FileHash {
    type Err = NoFileHash;

    fn from_str(text: &str) -> Result<Self, NoFileHash> {
        let is_digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
        if text.len() != 32 || !text.bytes().all(is_digit) {
            return Err(NoFileHash);
        }
        let number = u128::from_str_radix(text, 16).map_err(|_| NoFileHash)?;
        Ok(Self(number))
    }
}

/// Number of chunks of a file; an empty one has one.
#[must_use]
pub fn file_chunks(bytes: u64) -> u64 {
    bytes.div_ceil(FILE_CHUNK_BYTES as u64).max(1)
}

/// What a request of kind [`RequestKind::File`] says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileAsk {
    /// The client, to whose topic the chunks go.
    pub client: u64,
    /// The file.
    pub file: FileHash,
    /// First chunk.
    pub first: u64,
    /// Number of chunks.
    pub count: u32,
    /// Number of this question, which its chunks repeat.
    pub question: u32,
}

impl FileAsk {
    /// As a message.
    #[must_use]
    pub fn request(self) -> Request {
        let [low, high] = self.file.halves();
        Request {
            client: self.client,
            model: low,
            name: high,
            sequence: self.first,
            count: self.count,
            epoch: self.question,
            kind: RequestKind::File as u32,
            ..Request::zeroed()
        }
    }

    /// From a message; `None` for one of another kind.
    #[must_use]
    pub fn of(request: &Request) -> Option<Self> {
        (request.kind == RequestKind::File as u32).then_some(Self {
            client: request.client,
            file: FileHash::from_halves([request.model, request.name]),
            first: request.sequence,
            count: request.count,
            question: request.epoch,
        })
    }
}

/// What the header of a chunk of kind [`ChunkKind::File`] says, and of a refusal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileChunk {
    /// Content hash of the file; that of the current scene where [`FileHash::SCENE`] was asked for.
    /// Of a refusal, what was asked for.
    pub file: FileHash,
    /// Number of this chunk in the file.
    pub index: u64,
    /// Number of chunks of the file; 0 when there is no such file.
    pub chunks: u32,
    /// Bytes in this chunk.
    pub bytes: u32,
    /// The question that it answers.
    pub question: u32,
}

impl FileChunk {
    /// A sealed header for these slots.
    #[must_use]
    pub fn header(
        self,
        station: u64,
        client: u64,
        slots: &[ChunkSlot; CHUNK_SLOTS],
    ) -> ChunkHeader {
        let [low, high] = self.file.halves();
        let is_refused = self.chunks == 0;
        let (kind, code) = if is_refused {
            (ChunkKind::Refused, Refusal::UnknownFile as u32)
        } else {
            (ChunkKind::File, self.chunks)
        };
        let mut header = ChunkHeader {
            station,
            client,
            model: low,
            sequence: self.index,
            epoch: self.question,
            kind: kind as u32,
            object: 0,
            region: high as u32,
            tolerance_bits: (high >> 32) as u32,
            count: self.bytes,
            last: u32::from(is_refused || self.index == u64::from(self.chunks) - 1),
            code,
            ..ChunkHeader::default()
        };
        header.seal(slots);
        header
    }

    /// From a header; `None` when it is of another kind.
    #[must_use]
    pub fn of(header: &ChunkHeader) -> Option<Self> {
        let chunks = match ChunkKind::from_code(header.kind) {
            Some(ChunkKind::File) => header.code,
            Some(ChunkKind::Refused) if header.code == Refusal::UnknownFile as u32 => 0,
            _ => return None,
        };
        let high = u64::from(header.tolerance_bits) << 32 | u64::from(header.region);
        Some(Self {
            file: FileHash::from_halves([header.model, high]),
            index: header.sequence,
            chunks,
            bytes: header.count,
            question: header.epoch,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn questions_and_chunks_are_read_back(
            [client, station, first] in prop::array::uniform3(any::<u64>()),
            hash in any::<u128>(),
            [count, question, bytes, chunks] in prop::array::uniform4(any::<u32>()),
        ) {
            let file = FileHash(hash);
            prop_assert_eq!(file.to_string().parse(), Ok(file));
            let ask = FileAsk { client, file, first, count, question };
            prop_assert_eq!(FileAsk::of(&ask.request()), Some(ask));
            let slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let index = first % (1 << 40);
            let chunk = FileChunk { file, index, chunks, bytes, question };
            let header = chunk.header(station, client, &slots);
            prop_assert!(header.is_sound(&slots));
            prop_assert_eq!(FileChunk::of(&header), Some(chunk));
        }
    }

    #[test]
    fn other_texts_are_no_hash() {
        for text in [
            "",
            "0",
            "+0000000000000000000000000000000",
            &"G".repeat(32),
            &"A".repeat(32),
        ] {
            assert_eq!(text.parse::<FileHash>(), Err(NoFileHash), "{text}");
        }
    }
}
