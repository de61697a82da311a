//! Codecs that were tried for chunks of answers; the product has the last. Those with zstd are of
//! the feature `zstd`: the default build compiles none of its sources.

#[cfg(feature = "zstd")]
mod with_zstd;

use bytemuck::Zeroable;
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{CHUNK_SLOTS, ChunkDecoder, ChunkEncoder, ChunkHeader, ChunkSlot};
use spm::Sizes;

/// Slots of a chunk.
type Slots = [ChunkSlot; CHUNK_SLOTS];

/// Both ends of a codec, for the chunks of one client in their order.
pub trait Codec {
    /// What it is called in the table.
    fn name(&self) -> &'static str;
    /// The bytes of a chunk.
    fn encode(&mut self, chunk: &InboxChunk, sizes: Sizes) -> Option<Vec<u8>>;
    /// The slots of a chunk from these bytes; of the chunk itself only its header is known.
    fn decode(&mut self, chunk: &InboxChunk, bytes: &[u8]) -> Option<Slots>;
}

/// All of them.
pub fn all() -> Vec<Box<dyn Codec>> {
    let mut all: Vec<Box<dyn Codec>> = vec![Box::new(Plain)];
    #[cfg(feature = "zstd")]
    all.extend(with_zstd::all());
    all.push(Box::new(Alone));
    all.push(Box::new(Product::default()));
    all
}

/// The slots that begin with these bytes.
fn slots_of(bytes: &[u8]) -> Option<Slots> {
    let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
    let place = bytemuck::cast_slice_mut::<_, u8>(&mut slots).get_mut(..bytes.len())?;
    place.copy_from_slice(bytes);
    Some(slots)
}

/// Bytes as the slots that they came from.
fn whole_slots(bytes: &[u8]) -> Vec<ChunkSlot> {
    let slots = bytes.chunks_exact(size_of::<ChunkSlot>());
    slots.map(bytemuck::pod_read_unaligned).collect()
}

/// As on one machine.
struct Plain;

impl Codec for Plain {
    fn name(&self) -> &'static str {
        "plain"
    }

    fn encode(&mut self, chunk: &InboxChunk, _: Sizes) -> Option<Vec<u8>> {
        Some(bytemuck::bytes_of(&chunk.slots).to_vec())
    }

    fn decode(&mut self, _: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        slots_of(bytes)
    }
}

/// The product's, with nothing learnt from the chunks before.
struct Alone;

/// As the first of an epoch.
fn first(header: &ChunkHeader, slots: &Slots) -> ChunkHeader {
    let mut header = ChunkHeader {
        sequence: 0,
        ..*header
    };
    header.seal(slots);
    header
}

impl Codec for Alone {
    fn name(&self) -> &'static str {
        "range coder, each alone"
    }

    fn encode(&mut self, chunk: &InboxChunk, sizes: Sizes) -> Option<Vec<u8>> {
        let header = first(&chunk.header, &chunk.slots);
        let mut encoder = ChunkEncoder::default();
        // The very first is plain.
        let _ = encoder.encode(&header, &chunk.slots, Some(sizes));
        let slots = encoder.encode(&header, &chunk.slots, Some(sizes))?;
        Some(bytemuck::cast_slice(&slots).to_vec())
    }

    fn decode(&mut self, chunk: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        let slots = whole_slots(bytes);
        let header = first(&chunk.header, &chunk.slots);
        ChunkDecoder::default().decode(&header, &slots).ok()
    }
}

/// The product's.
#[derive(Default)]
struct Product {
    encoder: ChunkEncoder,
    decoder: ChunkDecoder,
}

impl Codec for Product {
    fn name(&self) -> &'static str {
        "range coder"
    }

    fn encode(&mut self, chunk: &InboxChunk, sizes: Sizes) -> Option<Vec<u8>> {
        let InboxChunk { header, slots } = chunk;
        let compact = self.encoder.encode(header, slots, Some(sizes));
        let sent = compact.as_deref().unwrap_or(slots);
        Some(bytemuck::cast_slice(sent).to_vec())
    }

    fn decode(&mut self, chunk: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        let slots = whole_slots(bytes);
        self.decoder.decode(&chunk.header, &slots).ok()
    }
}
