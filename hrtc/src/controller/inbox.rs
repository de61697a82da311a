//! Draining the inbox: chunks into model, closures, records, tour.

use super::{Controller, Fault, Model, ModelFrame, TickInputs};
use crate::cache::{LoadError, RegionKey, RegionState};
use crate::dial::triangle_area;
use crate::inbox::InboxChunk;
use crate::proxy::Proxy;
use crate::subscriber::Reception;
use crate::tick_record::CoreRecord;
use shared::protocol::{
    AnswerItem, AnswersReader, BaseFace, BaseVertex, CHUNK_SLOTS, ChunkKind, MODEL_HEADER_SLOTS,
    MeasuredError, ModelHeader, PartHead, Refusal, TourPoint,
};
use shared::spm::{NONE, RegionId, VspRecord};

/// Work units of the inbox a tick: a record or base item is 4, sixteen ids of a closure are 8, the head of a part 1.
const BUDGET: u32 = 80;
/// Chunks that wait while that is enough; more are taken in proportion, so that a burst is spread over few ticks.
const WAITING: usize = 2;
const PER_ITEM: u32 = 4;
/// Ids of a closure that are taken in one go.
const IDS_AT_ONCE: usize = 16;
/// Ticks for which a record may wait for room before its region is given up.
const PATIENCE: u32 = 50;

/// The most work units of the inbox a tick: what K operations a tick need, a few more records than splits.
#[must_use]
pub fn budget(operations: usize) -> u32 {
    (6 * operations as u32).max(BUDGET)
}

/// Where the draining stands within the oldest chunk.
#[derive(Debug, Clone, Default)]
pub struct Inbox {
    /// Items of the oldest chunk that are done.
    done: usize,
    /// Where in its answers, if it holds answers and was begun.
    reader: Option<AnswersReader>,
    /// Slots of the model that are done.
    model_slots: u32,
    /// The header of a model whose base mesh is still coming.
    coming: Option<ModelHeader>,
    waited: u32,
}

impl Inbox {
    /// Nothing received.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Turns to the next chunk.
    fn turn(&mut self) {
        self.done = 0;
        self.reader = None;
        self.waited = 0;
    }
}

/// How far a chunk was taken.
enum Taken {
    /// To its end.
    Whole,
    /// Up to the tick's budget or the cache's room.
    Part,
    /// It does not continue what was received: the epoch ends.
    Gap,
}

impl Controller {
    /// Consumes chunks within the budget; returns how many are done with.
    pub(super) fn drain(
        &mut self,
        inputs: &TickInputs<'_>,
        operations: &mut u32,
        record: &mut CoreRecord,
    ) -> usize {
        let mut consumed = 0;
        let [first, second] = inputs.chunks;
        let waiting = (first.len() + second.len()).div_ceil(WAITING) as u32;
        let allowed = (BUDGET * waiting).clamp(BUDGET, budget(self.operations));
        let mut budget = allowed;
        for chunk in first.iter().chain(second) {
            match self.subscriber.receive(&chunk.header) {
                Reception::Stale => {
                    consumed += 1;
                    self.inbox.turn();
                    continue;
                }
                Reception::Gap => {
                    self.end_epoch(inputs.tick);
                    consumed += 1;
                    continue;
                }
                Reception::Next => {}
            }
            let before = self.inbox.done;
            match self.take(chunk, inputs.tick, &mut budget, operations, record) {
                Taken::Whole => {
                    self.subscriber.consumed(inputs.tick);
                    self.bytes_received += size_of::<InboxChunk>() as u64;
                    self.inbox.turn();
                    consumed += 1;
                }
                Taken::Part => {
                    // Room is short when budget is left and nothing moved; what leaves is about to make some.
                    if self.inbox.done == before && budget > 0 && !self.is_leaving() {
                        self.inbox.waited += 1;
                    }
                    break;
                }
                Taken::Gap => {
                    self.end_epoch(inputs.tick);
                    consumed += 1;
                }
            }
            if budget == 0 {
                break;
            }
        }
        record.work_units += allowed - budget;
        consumed
    }

    fn end_epoch(&mut self, tick: u64) {
        self.subscriber.end_epoch(tick, &mut self.cache);
        self.inbox.turn();
        if !self.path_is_whole {
            self.path.clear();
        }
    }

    fn take(
        &mut self,
        chunk: &InboxChunk,
        tick: u64,
        budget: &mut u32,
        operations: &mut u32,
        record: &mut CoreRecord,
    ) -> Taken {
        match ChunkKind::from_code(chunk.header.kind) {
            Some(ChunkKind::Model) => self.take_model(chunk, budget),
            Some(ChunkKind::Answers) => self.take_answers(chunk, tick, budget, operations, record),
            Some(ChunkKind::Measured) => {
                let items: &[MeasuredError] = bytemuck::cast_slice(&chunk.slots);
                let count = (chunk.header.count as usize).min(items.len());
                for item in items[..count].iter().filter(|m| m.distance.is_finite()) {
                    let most = self.measured.unwrap_or(0.0);
                    self.measured = Some(most.max(item.distance));
                }
                Taken::Whole
            }
            Some(ChunkKind::Tour) => {
                self.take_tour(chunk);
                Taken::Whole
            }
            Some(ChunkKind::Refused) => {
                self.take_refusal(chunk, tick);
                Taken::Whole
            }
            // A kind of a later version: skipped, the numbers go on.
            None => Taken::Whole,
        }
    }

    fn take_model(&mut self, chunk: &InboxChunk, budget: &mut u32) -> Taken {
        if self.fault.is_some() {
            return Taken::Whole;
        }
        if let Some(model) = &self.model {
            if model.header.model != chunk.header.model {
                self.fault = Some(Fault::AnotherModel);
            }
            return Taken::Whole;
        }
        if self.inbox.done == 0 && chunk.header.code == 0 && self.inbox.coming.is_none() {
            let raw: &[u8] = bytemuck::cast_slice(&chunk.slots);
            let header: ModelHeader =
                bytemuck::pod_read_unaligned(&raw[..size_of::<ModelHeader>()]);
            if !header.is_valid() || header.model != chunk.header.model {
                self.fault = Some(Fault::DamagedModel);
                return Taken::Whole;
            }
            if let Err(error) = self.cache.begin_model(&header) {
                self.fault = Some(error.into());
                return Taken::Whole;
            }
            self.inbox.coming = Some(header);
            self.inbox.model_slots = MODEL_HEADER_SLOTS as u32;
        }
        let Some(header) = self.inbox.coming else {
            return Taken::Gap;
        };
        if header.model != chunk.header.model {
            self.fault = Some(Fault::AnotherModel);
            return Taken::Whole;
        }
        let vertex_slots = header.base_vertices.div_ceil(4);
        let faces_from = MODEL_HEADER_SLOTS as u32 + vertex_slots;
        let end = faces_from + header.base_faces.div_ceil(2);
        // A repeated answer (after an epoch ended) starts anew: what was set is set again, equal.
        for slot in 0..CHUNK_SLOTS as u32 {
            let place = chunk.header.code.saturating_add(slot);
            if place < self.inbox.model_slots || place >= end {
                continue;
            }
            if place > self.inbox.model_slots {
                return Taken::Gap;
            }
            if *budget < 4 * PER_ITEM {
                *budget = 0;
                return Taken::Part;
            }
            let words = &chunk.slots[slot as usize].words;
            let good = if place < faces_from {
                let first = 4 * (place - MODEL_HEADER_SLOTS as u32);
                let items: &[BaseVertex; 4] = bytemuck::cast_ref(words);
                let count = 4.min(header.base_vertices - first);
                *budget -= PER_ITEM;
                (0..count).all(|k| self.cache.set_base_vertex(first + k, &items[k as usize]))
            } else {
                let first = 2 * (place - faces_from);
                let items: &[BaseFace; 2] = bytemuck::cast_ref(words);
                let count = 2.min(header.base_faces - first);
                *budget -= 2 * PER_ITEM;
                (0..count).all(|k| self.cache.set_base_face(first + k, &items[k as usize]))
            };
            if !good {
                self.fault = Some(Fault::DamagedModel);
                return Taken::Whole;
            }
            self.inbox.model_slots = place + 1;
            self.inbox.done += 1;
        }
        if self.inbox.model_slots >= end {
            self.finish_model(header);
        }
        Taken::Whole
    }

    fn finish_model(&mut self, header: ModelHeader) {
        if !self.cache.mesh().base_is_consistent() {
            self.fault = Some(Fault::DamagedModel);
            return;
        }
        self.cache.refit();
        let frame = ModelFrame::new(&self.object, &header);
        let mesh = self.cache.mesh();
        let radius_max = (0..header.base_vertices)
            .map(|v| mesh.radius(v))
            .fold(0.0f32, f32::max);
        let area = (0..header.base_faces)
            .map(|face| triangle_area(mesh.corners(face)))
            .sum();
        self.dial = Some(self.dial_for(&header, area, frame.metres_per_unit));
        self.proxy = Some(Proxy::new(self.radius_m / frame.metres_per_unit));
        self.model = Some(Model {
            header,
            frame,
            radius_max: f64::from(radius_max),
            area,
        });
        self.subscriber.model_is(header.model);
        self.subscriber.answered();
        if let Some(ask) = self.tour_ask(&frame) {
            self.subscriber.ask_tour(ask);
        }
    }

    /// The asked region of this name.
    fn asked(&self, region: u32, tolerance_bits: u32) -> Option<usize> {
        let key = RegionKey {
            id: RegionId(region),
            tolerance_bits,
        };
        let index = self.cache.regions.index(key)?;
        (self.cache.regions.at(index).state == RegionState::Asked).then_some(index)
    }

    /// The asked region that a part belongs to; parts of others, and of answers whose beginning was not taken,
    /// are skipped.
    fn answered_by(&self, head: &PartHead) -> Option<usize> {
        let index = self.asked(head.region, head.tolerance_bits)?;
        self.cache.regions.at(index).answer_begun.then_some(index)
    }

    fn take_answers(
        &mut self,
        chunk: &InboxChunk,
        tick: u64,
        budget: &mut u32,
        operations: &mut u32,
        record: &mut CoreRecord,
    ) -> Taken {
        let whole_chunk = AnswersReader::new(chunk.header.count);
        let mut reader = self.inbox.reader.unwrap_or(whole_chunk);
        loop {
            // What is done with; an item that has to wait is read again.
            self.inbox.reader = Some(reader);
            let item = match reader.next(&chunk.slots) {
                Ok(Some(item)) => item,
                Ok(None) => return Taken::Whole,
                Err(_) => return Taken::Gap,
            };
            let cost = match item {
                AnswerItem::Part(_) => 1,
                AnswerItem::Id { .. } => 2 * PER_ITEM,
                AnswerItem::Record(_) => PER_ITEM,
                AnswerItem::End(_) => 0,
            };
            if *budget < cost {
                *budget = 0;
                return Taken::Part;
            }
            if let AnswerItem::Part(head) = item {
                *budget -= cost;
                self.inbox.done += 1;
                self.begin_answer(&head);
                continue;
            }
            let Some(region) = self.answered_by(reader.head()) else {
                reader.skip_part();
                continue;
            };
            let loaded = match item {
                AnswerItem::Part(_) => Ok(()),
                AnswerItem::Id { id, record_follows } => {
                    *budget -= cost;
                    self.take_ids(chunk, region, (id, record_follows), &mut reader)
                }
                AnswerItem::Record(item) => {
                    if !self.cache.has_slot() && !self.make_room(region, tick, operations, record) {
                        if self.inbox.waited < PATIENCE {
                            return Taken::Part;
                        }
                        self.give_up(region);
                        self.refinement.starved(tick);
                        continue;
                    }
                    *budget -= cost;
                    self.take_record(region, &item, operations)
                }
                AnswerItem::End(head) if head.is_last() => self.cache.finish(region).map(|()| {
                    self.subscriber.answered();
                    self.refinement.arrived(region, tick, &self.cache);
                }),
                AnswerItem::End(_) => Ok(()),
            };
            match (loaded, item) {
                (Ok(()), _) => self.inbox.done += 1,
                (Err(LoadError::NoRoom), AnswerItem::Record(_)) => return Taken::Part,
                (Err(LoadError::NoRoom), _) => {
                    self.give_up(region);
                    self.refinement.starved(tick);
                }
                (Err(LoadError::Gap), _) => self.ask_again(region),
                (Err(LoadError::Damaged), _) => self.refuse(region, tick),
            }
        }
    }

    /// A part begins: with it the answer, if it says so.
    fn begin_answer(&mut self, head: &PartHead) {
        if let (true, Some(region)) = (
            head.is_first(),
            self.asked(head.region, head.tolerance_bits),
        ) {
            // The station begins again when it was asked again: what came before counts no more.
            self.cache.let_go(region, u32::MAX);
            self.cache.regions.at_mut(region).answer_begun = true;
        }
    }

    /// Takes an id of a closure, and those that come right after it.
    fn take_ids(
        &mut self,
        chunk: &InboxChunk,
        region: usize,
        first: (u32, bool),
        reader: &mut AnswersReader,
    ) -> Result<(), LoadError> {
        let (id, record_follows) = first;
        self.cache.add_to_closure(region, id, record_follows)?;
        for _ in 1..IDS_AT_ONCE {
            let mut ahead = *reader;
            let Ok(Some(AnswerItem::Id { id, record_follows })) = ahead.next(&chunk.slots) else {
                break;
            };
            self.cache.add_to_closure(region, id, record_follows)?;
            *reader = ahead;
        }
        Ok(())
    }

    fn take_record(
        &mut self,
        region: usize,
        item: &VspRecord,
        operations: &mut u32,
    ) -> Result<(), LoadError> {
        self.cache.load(region, item)?;
        self.vsps_received += 1;
        // A record costs about half an operation: one budget for both keeps ticks even.
        *operations = operations.saturating_sub((self.inbox.done % 2) as u32);
        Ok(())
    }

    /// Asks for a region again, with every record: its answer counts on records that are not here any more.
    fn ask_again(&mut self, region: usize) {
        self.cache.let_go(region, u32::MAX);
        let entry = self.cache.regions.at_mut(region);
        entry.state = RegionState::ToAskAgain;
        entry.answer_begun = false;
        self.subscriber.ask_again(region);
    }

    /// Drops an asked region for lack of room; the station is told.
    fn give_up(&mut self, region: usize) {
        self.subscriber.answered();
        if self.may_leave() {
            self.leave(region);
        } else {
            self.cache.let_go(region, u32::MAX);
            // The station goes on believing in it; should it be asked for again, the answer lacks
            // records, and is asked for once more.
            self.cache.regions.remove(region);
        }
    }

    /// Drops an asked region that cannot be used; after a while it may be asked for again.
    pub(super) fn refuse(&mut self, region: usize, tick: u64) {
        self.cache.let_go(region, u32::MAX);
        let entry = self.cache.regions.at_mut(region);
        if entry.state == RegionState::Asked {
            self.subscriber.answered();
        }
        entry.state = RegionState::Refused;
        entry.refused_at = tick;
        self.last_refused = entry.key.id.0;
        self.refused_regions += 1;
    }

    fn take_tour(&mut self, chunk: &InboxChunk) {
        if self.path_is_whole {
            return;
        }
        let points: &[TourPoint] = bytemuck::cast_slice(&chunk.slots);
        let count = (chunk.header.count as usize).min(points.len());
        for point in &points[..count] {
            let finite = point.t.is_finite()
                && point.position.iter().all(|x| x.is_finite())
                && point.orientation_wxyz.iter().all(|x| x.is_finite());
            let ordered = self.path.last().is_none_or(|last| last.t < point.t);
            // A longer tour than was asked for is cut, never stored.
            if finite && ordered && self.path.len() < self.path.capacity() {
                self.path.push(*point);
            }
        }
        if chunk.header.last == 1 {
            self.path_is_whole = true;
            self.subscriber.tour_is_here();
            self.subscriber.answered();
        }
    }

    fn take_refusal(&mut self, chunk: &InboxChunk, tick: u64) {
        match Refusal::from_code(chunk.header.code) {
            Some(Refusal::UnknownModel) => self.fault = Some(Fault::UnknownModel),
            // Only a tour is refused without a region.
            _ if chunk.header.region == NONE && !self.path_is_whole => {
                self.fault = Some(Fault::NoTour);
            }
            _ => {
                let header = &chunk.header;
                if let Some(region) = self.asked(header.region, header.tolerance_bits) {
                    self.refuse(region, tick);
                }
            }
        }
    }
}
