//! Codecs with zstd, which ours is measured against.

use super::{Codec, Slots, slots_of};
use hrtc_core::streaming::chunk::InboxChunk;
use protocol::{AnswerItem, AnswersReader, AnswersWriter, ChunkKind};
use spm::{Sizes, VspRecord};
use std::collections::BTreeMap;
use std::io::Write;

/// Level of zstd: higher ones are slower and hardly smaller for a few kilobytes.
const LEVEL: i32 = 3;
/// Words of a record.
const WORDS: usize = size_of::<VspRecord>() / size_of::<u32>();

/// All of them.
pub fn all() -> [Box<dyn Codec>; 3] {
    [
        Box::new(Rows),
        Box::new(Stream::new()),
        Box::new(Planes::default()),
    ]
}

/// The bytes of a chunk without the zeros at their end.
fn used(chunk: &InboxChunk) -> &[u8] {
    let bytes: &[u8] = bytemuck::cast_slice(&chunk.slots);
    let last = bytes.iter().rposition(|&byte| byte != 0);
    &bytes[..last.map_or(0, |last| last + 1)]
}

/// zstd, each chunk alone.
struct Rows;

impl Codec for Rows {
    fn name(&self) -> &'static str {
        "zstd"
    }

    fn encode(&mut self, chunk: &InboxChunk, _: Sizes) -> Option<Vec<u8>> {
        zstd::bulk::compress(used(chunk), LEVEL).ok()
    }

    fn decode(&mut self, _: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        slots_of(&zstd::bulk::decompress(bytes, size_of::<Slots>()).ok()?)
    }
}

/// zstd, all chunks as one stream.
struct Stream {
    encoder: Option<zstd::stream::write::Encoder<'static, Vec<u8>>>,
    decoder: Option<zstd::stream::write::Decoder<'static, Vec<u8>>>,
}

impl Stream {
    fn new() -> Self {
        Self {
            encoder: zstd::stream::write::Encoder::new(Vec::new(), LEVEL).ok(),
            decoder: zstd::stream::write::Decoder::new(Vec::new()).ok(),
        }
    }
}

impl Codec for Stream {
    fn name(&self) -> &'static str {
        "zstd, one stream"
    }

    fn encode(&mut self, chunk: &InboxChunk, _: Sizes) -> Option<Vec<u8>> {
        let encoder = self.encoder.as_mut()?;
        encoder.write_all(used(chunk)).ok()?;
        encoder.flush().ok()?;
        Some(std::mem::take(encoder.get_mut()))
    }

    fn decode(&mut self, _: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        let decoder = self.decoder.as_mut()?;
        decoder.write_all(bytes).ok()?;
        decoder.flush().ok()?;
        slots_of(&std::mem::take(decoder.get_mut()))
    }
}

/// Records less the record that creates their split vertex, as planes of bytes, then zstd; each
/// chunk alone but for these records.
#[derive(Default)]
struct Planes {
    sizes: Option<Sizes>,
    sent: BTreeMap<u32, [u32; WORDS]>,
    received: BTreeMap<u32, [u32; WORDS]>,
}

/// What a record is less: the record that creates its split vertex, else the one before it.
fn parent(
    known: &BTreeMap<u32, [u32; WORDS]>,
    sizes: Option<Sizes>,
    vs: u32,
    before: &[u32; WORDS],
) -> [u32; WORDS] {
    let creator = sizes.and_then(|sizes| sizes.creator_of_vertex(vs));
    *creator.and_then(|i| known.get(&i)).unwrap_or(before)
}

impl Planes {
    /// Notes a record with what it is less; the words of the difference. The split vertex stays.
    fn row(&mut self, record: &VspRecord, before: &mut [u32; WORDS]) -> [u32; WORDS] {
        let words: [u32; WORDS] = bytemuck::cast(*record);
        let of = parent(&self.sent, self.sizes, record.vs, before);
        let mut row: [u32; WORDS] = std::array::from_fn(|k| words[k].wrapping_sub(of[k]));
        row[0] = record.i.wrapping_sub(before[0]);
        row[1] = record.vs;
        self.sent.insert(record.i, words);
        *before = words;
        row
    }

    /// The record of a difference.
    fn record(&mut self, row: [u32; WORDS], before: &mut [u32; WORDS]) -> VspRecord {
        let of = parent(&self.received, self.sizes, row[1], before);
        let mut words: [u32; WORDS] = std::array::from_fn(|k| row[k].wrapping_add(of[k]));
        words[0] = row[0].wrapping_add(before[0]);
        words[1] = row[1];
        self.received.insert(words[0], words);
        *before = words;
        bytemuck::cast(words)
    }
}

impl Codec for Planes {
    fn name(&self) -> &'static str {
        "planes, zstd"
    }

    fn encode(&mut self, chunk: &InboxChunk, sizes: Sizes) -> Option<Vec<u8>> {
        self.sizes = Some(sizes);
        if chunk.header.kind != ChunkKind::Answers as u32 {
            return Rows.encode(chunk, sizes);
        }
        let mut reader = AnswersReader::new(chunk.header.count);
        // Heads and ids, then how many records follow each head, then the records.
        let mut rest = AnswersWriter::new();
        let (mut counts, mut rows, mut before) = (Vec::new(), Vec::new(), [0; WORDS]);
        while let Some(item) = reader.next(&chunk.slots).ok()? {
            match item {
                AnswerItem::Part(head) => {
                    rest.begin(head.region, head.tolerance_bits, head.is_first());
                    counts.push(head.records as u8);
                }
                AnswerItem::Id { id, record_follows } => {
                    let _ = rest.id(id, record_follows);
                }
                AnswerItem::Record(record) => rows.push(self.row(&record, &mut before)),
                AnswerItem::End(head) => rest.end(head.is_last()),
            }
        }
        let (length, slots) = rest.finish();
        let mut bytes = (length as u16).to_le_bytes().to_vec();
        bytes.extend_from_slice(&bytemuck::cast_slice(&slots)[..length as usize]);
        bytes.push(counts.len() as u8);
        bytes.extend(counts);
        let rows: &[u8] = bytemuck::cast_slice(&rows);
        let size = size_of::<VspRecord>();
        bytes.extend((0..size).flat_map(|plane| rows.iter().skip(plane).step_by(size)));
        zstd::bulk::compress(&bytes, LEVEL).ok()
    }

    fn decode(&mut self, chunk: &InboxChunk, bytes: &[u8]) -> Option<Slots> {
        if chunk.header.kind != ChunkKind::Answers as u32 {
            return Rows.decode(chunk, bytes);
        }
        let bytes = zstd::bulk::decompress(bytes, 2 * size_of::<Slots>()).ok()?;
        let (length, bytes) = bytes.split_first_chunk()?;
        let length = u16::from_le_bytes(*length);
        let (rest, bytes) = bytes.split_at_checked(length.into())?;
        let (parts, bytes) = bytes.split_first()?;
        let (counts, planes) = bytes.split_at_checked((*parts).into())?;
        let rows = planes.len() / size_of::<VspRecord>();
        let mut rows = (0..rows).map(|row| {
            let bytes: Vec<u8> = planes.iter().skip(row).step_by(rows).copied().collect();
            bytemuck::pod_read_unaligned::<[u32; WORDS]>(&bytes)
        });
        let slots = slots_of(rest)?;
        let mut reader = AnswersReader::new(length.into());
        let mut writer = AnswersWriter::new();
        let (mut counts, mut before) = (counts.iter(), [0; WORDS]);
        while let Some(item) = reader.next(&slots).ok()? {
            match item {
                AnswerItem::Part(head) => {
                    writer.begin(head.region, head.tolerance_bits, head.is_first());
                }
                AnswerItem::Id { id, record_follows } => {
                    let _ = writer.id(id, record_follows);
                }
                AnswerItem::Record(_) => return None,
                AnswerItem::End(head) => {
                    for row in rows.by_ref().take((*counts.next()?).into()) {
                        let _ = writer.record(&self.record(row, &mut before));
                    }
                    writer.end(head.is_last());
                }
            }
        }
        Some(writer.finish().1)
    }
}
