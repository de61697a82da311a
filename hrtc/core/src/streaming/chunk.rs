//! A chunk as it lies in the ring between the connection's thread and the tick.

use protocol::{CHUNK_SLOTS, ChunkHeader, ChunkSlot};

/// One received chunk.
#[derive(Debug, Clone, Copy)]
pub struct InboxChunk {
    /// Its header.
    pub header: ChunkHeader,
    /// Its slots; how many are valid follows from the header.
    pub slots: [ChunkSlot; CHUNK_SLOTS],
}
