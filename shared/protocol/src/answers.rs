//! Answers to requested regions, packed back to back into the slots of a chunk.
//!
//! A chunk of kind [`super::ChunkKind::Answers`] is a sequence of *parts*; `count` in its header is
//! their length in bytes. An answer is one part, or several in as many chunks, the first and the
//! last marked:
//!
//! | bytes | content |
//! |---|---|
//! | 16 | [`PartHead`] |
//! | `id_bytes` | VSP ids of the closure, ascending; then zeros up to a multiple of 4 |
//! | 64 each | records ([`VspRecord`]) |
//!
//! All ids of an answer come before all of its records. An id is stored as the difference to the
//! one before it in its part, less one (the first: the id itself), times two, plus one when its
//! record follows in the same answer. The number is LEB128 (seven bits a byte, lowest first, the
//! high bit for more): mostly one or two bytes.

use super::wire::{CHUNK_SLOTS, ChunkSlot};
use bytemuck::{Pod, Zeroable};
use spm::VspRecord;
use thiserror::Error;

/// Bytes of the slots of a chunk.
const CHUNK_BYTES: usize = CHUNK_SLOTS * size_of::<ChunkSlot>();
/// Largest number of bytes of an id.
const MAX_ID_BYTES: usize = 5;

/// The head of a part.
#[repr(C)]
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable, serde::Serialize, serde::Deserialize,
)]
pub struct PartHead {
    /// [`spm::RegionId`] as a number, as requested.
    pub region: u32,
    /// Tolerance bits (the count of a prefix), as requested.
    pub tolerance_bits: u32,
    /// Ids in this part.
    pub ids: u16,
    /// Bytes of the ids, without the zeros after them.
    pub id_bytes: u16,
    /// Records in this part.
    pub records: u16,
    /// [`PartHead::FIRST`] and [`PartHead::LAST`].
    pub flags: u16,
}

impl PartHead {
    /// Flag of the first part of an answer.
    pub const FIRST: u16 = 1;
    /// Flag of the last part of an answer.
    pub const LAST: u16 = 2;

    /// Whether this is the first part of an answer.
    #[must_use]
    pub fn is_first(&self) -> bool {
        self.flags & Self::FIRST != 0
    }

    /// Whether this is the last part of an answer.
    #[must_use]
    pub fn is_last(&self) -> bool {
        self.flags & Self::LAST != 0
    }

    fn bytes_behind(&self) -> usize {
        usize::from(self.id_bytes).next_multiple_of(4)
            + usize::from(self.records) * size_of::<VspRecord>()
    }
}

/// Packs parts into a chunk.
#[derive(Debug, Clone)]
pub struct AnswersWriter {
    slots: [ChunkSlot; CHUNK_SLOTS],
    at: usize,
    head_at: usize,
    head: PartHead,
    next_id: u32,
}

impl Default for AnswersWriter {
    fn default() -> Self {
        Self::new()
    }
}

impl AnswersWriter {
    /// Bytes of the smallest useful part.
    pub const MIN_ROOM: usize = size_of::<PartHead>() + 4 + size_of::<VspRecord>();

    /// An empty chunk.
    #[must_use]
    pub fn new() -> Self {
        Self {
            slots: [ChunkSlot::zeroed(); CHUNK_SLOTS],
            at: 0,
            head_at: 0,
            head: PartHead::default(),
            next_id: 0,
        }
    }

    /// Remaining bytes.
    #[must_use]
    pub fn room(&self) -> usize {
        CHUNK_BYTES - self.at
    }

    /// Whether no part was written.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.at == 0
    }

    /// Starts a part; there must be [`AnswersWriter::MIN_ROOM`]. Ends with [`AnswersWriter::end`].
    pub fn begin(&mut self, region: u32, tolerance_bits: u32, first: bool) {
        self.head = PartHead {
            region,
            tolerance_bits,
            flags: if first { PartHead::FIRST } else { 0 },
            ..PartHead::default()
        };
        self.head_at = self.at;
        self.next_id = 0;
        self.at += size_of::<PartHead>();
    }

    /// Adds an id, larger than the one before and below 2^30, to a part without records yet; false
    /// when there is no room.
    #[must_use]
    pub fn id(&mut self, id: u32, record_follows: bool) -> bool {
        // The zeros after the ids must fit too.
        if self.room() < MAX_ID_BYTES + 3 {
            return false;
        }
        let mut code = (id - self.next_id) << 1 | u32::from(record_follows);
        let start = self.at;
        loop {
            let more = code >= 1 << 7;
            let at = self.at;
            self.bytes()[at] = (code & 127) as u8 | u8::from(more) << 7;
            self.at += 1;
            code >>= 7;
            if !more {
                break;
            }
        }
        self.head.id_bytes += (self.at - start) as u16;
        self.head.ids += 1;
        self.next_id = id + 1;
        true
    }

    /// Adds a record; false when there is no room.
    #[must_use]
    pub fn record(&mut self, record: &VspRecord) -> bool {
        let start = self.at.next_multiple_of(4);
        let end = start + size_of::<VspRecord>();
        if end > CHUNK_BYTES {
            return false;
        }
        self.bytes()[start..end].copy_from_slice(bytemuck::bytes_of(record));
        self.at = end;
        self.head.records += 1;
        true
    }

    /// Ends a part; `last` for the last part of the answer.
    pub fn end(&mut self, last: bool) {
        if last {
            self.head.flags |= PartHead::LAST;
        }
        self.at = self.at.next_multiple_of(4);
        let (head, from) = (self.head, self.head_at);
        self.bytes()[from..from + size_of::<PartHead>()].copy_from_slice(bytemuck::bytes_of(&head));
    }

    /// Bytes written, and the slots.
    #[must_use]
    pub fn finish(self) -> (u32, [ChunkSlot; CHUNK_SLOTS]) {
        (self.at as u32, self.slots)
    }

    fn bytes(&mut self) -> &mut [u8] {
        bytemuck::cast_slice_mut(&mut self.slots)
    }
}

/// Bytes that are no sequence of parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a chunk of answers is damaged")]
pub struct DamagedAnswers;

/// An item of a chunk of answers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnswerItem {
    /// Start of a part.
    Part(PartHead),
    /// A VSP of the closure.
    Id {
        /// Its number.
        id: u32,
        /// Whether its record follows in this answer; otherwise it is assumed resident.
        record_follows: bool,
    },
    /// A record.
    Record(VspRecord),
    /// End of a part.
    End(PartHead),
}

/// Reads a chunk of answers item by item; a copy marks a position to return to.
///
/// For any bytes it stays within them and ends after at most one item a byte.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AnswersReader {
    at: usize,
    end: usize,
    head: PartHead,
    in_part: bool,
    ids_left: u16,
    records_left: u16,
    ids_end: usize,
    part_end: usize,
    next_id: u32,
}

impl AnswersReader {
    /// A reader before the first part; `count` is that of the chunk's header.
    #[must_use]
    pub fn new(count: u32) -> Self {
        Self {
            at: 0,
            end: (count as usize).min(CHUNK_BYTES),
            head: PartHead::default(),
            in_part: false,
            ids_left: 0,
            records_left: 0,
            ids_end: 0,
            part_end: 0,
            next_id: 0,
        }
    }

    /// The head of the current part, or of the last one.
    #[must_use]
    pub fn head(&self) -> &PartHead {
        &self.head
    }

    /// Skips the rest of the current part and its [`AnswerItem::End`].
    pub fn skip_part(&mut self) {
        if self.in_part {
            self.at = self.part_end;
            self.in_part = false;
        }
    }

    /// The next item, `None` after the last part.
    ///
    /// # Errors
    /// When the bytes do not come from an [`AnswersWriter`].
    pub fn next(
        &mut self,
        slots: &[ChunkSlot; CHUNK_SLOTS],
    ) -> Result<Option<AnswerItem>, DamagedAnswers> {
        let bytes: &[u8] = bytemuck::cast_slice(slots);
        if !self.in_part {
            return self.next_part(bytes);
        }
        if self.ids_left > 0 {
            return self.next_id(bytes).map(Some);
        }
        if self.records_left > 0 {
            let start = self.part_end - usize::from(self.records_left) * size_of::<VspRecord>();
            let record = &bytes[start..start + size_of::<VspRecord>()];
            self.records_left -= 1;
            return Ok(Some(AnswerItem::Record(bytemuck::pod_read_unaligned(
                record,
            ))));
        }
        self.skip_part();
        Ok(Some(AnswerItem::End(self.head)))
    }

    fn next_part(&mut self, bytes: &[u8]) -> Result<Option<AnswerItem>, DamagedAnswers> {
        if self.at == self.end {
            return Ok(None);
        }
        let start = self.at + size_of::<PartHead>();
        if start > self.end {
            return Err(DamagedAnswers);
        }
        let head: PartHead = bytemuck::pod_read_unaligned(&bytes[self.at..start]);
        let part_end = start + head.bytes_behind();
        let without_ids = head.ids == 0 && head.id_bytes > 0;
        if part_end > self.end || head.ids > head.id_bytes || without_ids {
            return Err(DamagedAnswers);
        }
        *self = Self {
            at: start,
            end: self.end,
            head,
            in_part: true,
            ids_left: head.ids,
            records_left: head.records,
            ids_end: start + usize::from(head.id_bytes),
            part_end,
            next_id: 0,
        };
        Ok(Some(AnswerItem::Part(head)))
    }

    fn next_id(&mut self, bytes: &[u8]) -> Result<AnswerItem, DamagedAnswers> {
        let mut code = 0u64;
        for (k, &byte) in bytes[self.at..self.ids_end]
            .iter()
            .take(MAX_ID_BYTES)
            .enumerate()
        {
            code |= u64::from(byte & 127) << (7 * k);
            if byte >> 7 != 0 {
                continue;
            }
            self.at += k + 1;
            self.ids_left -= 1;
            let id = u64::from(self.next_id) + (code >> 1);
            let whole = self.ids_left > 0 || self.at == self.ids_end;
            if id >= 1 << 30 || !whole {
                break;
            }
            self.next_id = id as u32 + 1;
            return Ok(AnswerItem::Id {
                id: id as u32,
                record_follows: code & 1 == 1,
            });
        }
        Err(DamagedAnswers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn items(
        count: u32,
        slots: &[ChunkSlot; CHUNK_SLOTS],
    ) -> Result<Vec<AnswerItem>, DamagedAnswers> {
        let mut reader = AnswersReader::new(count);
        let mut items = Vec::new();
        while let Some(item) = reader.next(slots)? {
            items.push(item);
            assert!(items.len() <= CHUNK_BYTES);
        }
        Ok(items)
    }

    fn record(i: u32) -> VspRecord {
        VspRecord {
            i,
            pos_t: [i as f32, 0.5, -1.0],
            ..VspRecord::zeroed()
        }
    }

    proptest! {
        #[test]
        fn packed_answers_are_read_back(
            answers in prop::collection::vec(
                (any::<u32>(), any::<u32>(),
                 prop::collection::btree_map(0u32..1 << 30, any::<bool>(), 0..300), 0u32..2000),
                1..8),
        ) {
            let mut writer = AnswersWriter::new();
            let mut expected = Vec::new();
            for (region, tolerance_bits, closure, first) in &answers {
                if writer.room() < AnswersWriter::MIN_ROOM {
                    break;
                }
                writer.begin(*region, *tolerance_bits, first % 2 == 0);
                let head_at = expected.len();
                expected.push(AnswerItem::Part(PartHead::default()));
                // Spread ids and dense ones.
                let ids = closure.iter().map(|(&id, &sent)| (id, sent));
                let dense = (0..*first / 4).map(|k| (k, k % 3 == 0));
                let all: Vec<(u32, bool)> =
                    if first % 3 == 0 { dense.collect() } else { ids.collect() };
                let mut whole = true;
                for &(id, record_follows) in &all {
                    whole &= writer.id(id, record_follows);
                    if !whole {
                        break;
                    }
                    expected.push(AnswerItem::Id { id, record_follows });
                }
                let sent = if whole { all.as_slice() } else { &[] };
                for &(id, _) in sent.iter().filter(|(_, sent)| *sent) {
                    whole &= writer.record(&record(id));
                    if !whole {
                        break;
                    }
                    expected.push(AnswerItem::Record(record(id)));
                }
                writer.end(whole);
                let head = PartHead {
                    region: *region,
                    tolerance_bits: *tolerance_bits,
                    ..writer.head
                };
                prop_assert_eq!(head.is_last(), whole);
                prop_assert_eq!(head.is_first(), first % 2 == 0);
                expected[head_at] = AnswerItem::Part(head);
                expected.push(AnswerItem::End(head));
            }
            let (count, slots) = writer.finish();
            prop_assert_eq!(items(count, &slots), Ok(expected));
        }

        #[test]
        fn any_bytes_end_in_items_or_an_error(
            words in prop::collection::vec(any::<u32>(), 16 * CHUNK_SLOTS), count in any::<u32>(),
            small in any::<bool>(), skip in any::<bool>(),
        ) {
            let mut slots = [ChunkSlot::zeroed(); CHUNK_SLOTS];
            let mask = if small { 0x0f0f_0f0f } else { u32::MAX };
            for (place, word) in slots.iter_mut().flat_map(|s| &mut s.words).zip(words) {
                *place = word & mask;
            }
            let count = if small { count % 5000 } else { count };
            let _ = items(count, &slots);
            let mut reader = AnswersReader::new(count);
            for _ in 0..CHUNK_BYTES {
                if !matches!(reader.next(&slots), Ok(Some(_))) {
                    break;
                }
                if skip {
                    reader.skip_part();
                }
            }
        }
    }

    #[test]
    fn dense_ids_take_a_byte_and_a_chunk_is_full_to_the_end() {
        let mut writer = AnswersWriter::new();
        writer.begin(1, 2, true);
        let mut ids = 0;
        while writer.id(ids, true) {
            ids += 1;
        }
        writer.end(false);
        assert!(ids as usize > CHUNK_BYTES - 32, "{ids}");
        let mut writer = AnswersWriter::new();
        writer.begin(1, 2, true);
        for id in 0..60 {
            assert!(writer.id(id, true));
        }
        let records = (0..60).take_while(|&i| writer.record(&record(i))).count();
        assert_eq!(records, 60);
        writer.end(true);
        assert!(writer.room() < 256);
    }
}
