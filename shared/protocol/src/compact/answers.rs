//! Chunks of answers: the heads and ids of their parts. Records: see `records`.

use super::numbers::{Difference, Number, Tree};
use super::range_coder::{Bit, Code};
use super::records::{Bases, Closure, Known, RecordModel, Records};
use crate::answers::{AnswerItem, AnswersReader, AnswersWriter, PartHead};
use crate::wire::{CHUNK_SLOTS, ChunkSlot};
use bytemuck::Zeroable;
use spm::VspRecord;

/// Bytes of a chunk.
const CHUNK_BYTES: usize = CHUNK_SLOTS * size_of::<ChunkSlot>();
/// The most parts of a chunk.
const MAX_PARTS: usize = CHUNK_BYTES / size_of::<PartHead>();
/// The most ids of a chunk: each takes a byte.
const MAX_IDS: usize = CHUNK_BYTES;
/// The most records of a chunk.
const MAX_RECORDS: usize = CHUNK_BYTES / size_of::<VspRecord>();
/// Where the fields of a region begin, and their bits: its cell's coordinates and its kind.
const REGION_FIELDS: [(u32, u32); 4] = [(0, 10), (10, 10), (20, 10), (30, 2)];

/// A part of an answer.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Part {
    /// Region, tolerance and flags; the rest follows.
    pub head: PartHead,
    pub ids: Vec<(u32, bool)>,
    pub records: Vec<VspRecord>,
}

/// The parts of a chunk; `None` where it is no sequence of parts.
pub fn unpack(count: u32, slots: &[ChunkSlot; CHUNK_SLOTS]) -> Option<Vec<Part>> {
    let mut reader = AnswersReader::new(count);
    let mut parts: Vec<Part> = Vec::new();
    while let Some(item) = reader.next(slots).ok()? {
        if let AnswerItem::Part(head) = item {
            parts.push(Part {
                head,
                ..Part::default()
            });
        }
        let part = parts.last_mut()?;
        match item {
            AnswerItem::Id { id, record_follows } => part.ids.push((id, record_follows)),
            AnswerItem::Record(record) => part.records.push(record),
            AnswerItem::Part(_) | AnswerItem::End(_) => {}
        }
    }
    Some(parts)
}

/// The count and the slots of a chunk of parts; `None` where there is no room for them.
pub fn pack(parts: &[Part]) -> Option<(u32, [ChunkSlot; CHUNK_SLOTS])> {
    let mut writer = AnswersWriter::new();
    for Part { head, ids, records } in parts {
        if writer.room() < size_of::<PartHead>() {
            return None;
        }
        writer.begin(head.region, head.tolerance_bits, head.is_first());
        let mut next = 0;
        for &(id, record_follows) in ids {
            if id < next || id >= 1 << 30 || !writer.id(id, record_follows) {
                return None;
            }
            next = id + 1;
        }
        if !records.iter().all(|record| writer.record(record)) {
            return None;
        }
        writer.end(head.is_last());
    }
    Some(writer.finish())
}

/// What is known of answers.
#[derive(Debug)]
pub struct AnswersModel {
    parts: Number,
    flags: Tree<4>,
    is_same_region: [Bit; 2],
    region: [Difference; 4],
    tolerance: Difference,
    ids: Number,
    gaps: Vec<Number>,
    follows: [Bit; 8],
    records: Difference,
    last: PartHead,
    closure: Closure,
    kept: Records,
    record: RecordModel,
}

impl Default for AnswersModel {
    fn default() -> Self {
        Self {
            parts: Number::NEW,
            flags: Tree::NEW,
            is_same_region: [Bit::NEW; 2],
            region: [const { Difference::NEW }; 4],
            tolerance: Difference::NEW,
            ids: Number::NEW,
            gaps: vec![Number::NEW; 32],
            follows: [Bit::NEW; 8],
            records: Difference::NEW,
            last: PartHead::default(),
            closure: Closure::default(),
            kept: Records::default(),
            record: RecordModel::default(),
        }
    }
}

impl AnswersModel {
    /// Codes the parts of a chunk; `None` where they cannot be those of one.
    pub fn code(
        &mut self,
        code: &mut impl Code,
        given: &[Part],
        bases: Bases,
    ) -> Option<Vec<Part>> {
        let none = Part::default();
        let count = self.parts.code(code, given.len() as u32) as usize;
        let (mut ids, mut records) = (0, 0);
        let mut parts = Vec::with_capacity(count.min(MAX_PARTS));
        for k in 0..count {
            let given = given.get(k).unwrap_or(&none);
            let head = self.head(code, &given.head);
            if head.is_first() {
                self.closure.clear();
            }
            let part_ids = self.ids.code(code, given.ids.len() as u32) as usize;
            ids += part_ids;
            if k >= MAX_PARTS || ids > MAX_IDS {
                return None;
            }
            let part_ids = self.ids(code, &given.ids, part_ids);
            let expected = self.closure.expected().min(MAX_RECORDS) as u32;
            let part_records = self
                .records
                .code(code, given.records.len() as u32, expected);
            records += part_records as usize;
            if records > MAX_RECORDS {
                return None;
            }
            let part_records = self.records(code, &given.records, part_records, bases);
            parts.push(Part {
                head,
                ids: part_ids,
                records: part_records,
            });
        }
        Some(parts)
    }

    fn head(&mut self, code: &mut impl Code, given: &PartHead) -> PartHead {
        let mut head = PartHead {
            flags: self.flags.code(code, u32::from(given.flags)) as u16,
            ..PartHead::default()
        };
        let of = |head: &PartHead| (head.region, head.tolerance_bits);
        let is_same = of(given) == of(&self.last);
        let model = &mut self.is_same_region[usize::from(head.is_first())];
        if code.bit(is_same, model) {
            (head.region, head.tolerance_bits) = of(&self.last);
        } else {
            for (model, (at, bits)) in self.region.iter_mut().zip(REGION_FIELDS) {
                let field = |region: u32| region >> at & ((1 << bits) - 1);
                let value = model.code(code, field(given.region), field(self.last.region));
                head.region |= (value & ((1 << bits) - 1)) << at;
            }
            let (given, last) = (given.tolerance_bits, self.last.tolerance_bits);
            head.tolerance_bits = self.tolerance.code(code, given, last);
        }
        self.last = head;
        head
    }

    /// Codes ids with whether their records follow.
    fn ids(
        &mut self,
        code: &mut impl Code,
        given: &[(u32, bool)],
        count: usize,
    ) -> Vec<(u32, bool)> {
        let mut ids = Vec::with_capacity(count);
        let (mut next, mut class, mut last) = (0u32, 0, false);
        for k in 0..count {
            let (id, follows) = given.get(k).copied().unwrap_or_default();
            let model = &mut self.gaps[2 * class + usize::from(last)];
            let gap = model.code(code, id.wrapping_sub(next));
            let id = next.wrapping_add(gap);
            let is_kept = self.kept.get(id).is_some();
            let model = &mut self.follows[2 * usize::from(is_kept) + usize::from(last)];
            let follows = code.bit(follows, model);
            ids.push((id, follows));
            self.closure.push(id, follows);
            next = id.wrapping_add(1);
            class = (u32::BITS - gap.leading_zeros()).min(15) as usize;
            last = follows;
        }
        ids
    }

    fn records(
        &mut self,
        code: &mut impl Code,
        given: &[VspRecord],
        count: u32,
        bases: Bases,
    ) -> Vec<VspRecord> {
        let none = VspRecord::zeroed();
        let record = |k: u32| {
            let given = given.get(k as usize).unwrap_or(&none);
            let known = Known {
                expected: self.closure.next_record(),
                closure: &self.closure.ids,
                kept: &self.kept,
                bases,
            };
            let record = self.record.code(code, given, &known);
            self.kept.keep(&record);
            record
        };
        (0..count).map(record).collect()
    }
}
