//! Draining the inbox: chunks into model, closures, records, tour.

use crate::active::object::{ActiveObject, Budget, TickContext};
use crate::cache::base_mesh_store::{Model, first_face_slot, model_slots};
use crate::cache::{LoadError, RegionKey, RegionState};
use crate::controller::Fault;
use crate::frame::ModelFrame;
use crate::lod::lod_controller::triangle_area;
use crate::streaming::chunk::InboxChunk;
use crate::streaming::subscriber::Reception;
use protocol::{
    AnswerItem, AnswersReader, CHUNK_SLOTS, ChunkKind, ChunkSlot, MODEL_HEADER_SLOTS,
    MeasuredError, PartHead, Refusal, TourPoint,
};
use spm::{BaseFace, BaseVertex, ModelHeader};
use spm::{NONE, RegionId, VspRecord};

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

/// The work units of the inbox in a tick with so many chunks that wait.
#[must_use]
pub fn allowed(waiting: usize, operations: usize) -> u32 {
    let waiting = waiting.div_ceil(WAITING) as u32;
    (BUDGET * waiting).clamp(BUDGET, budget(operations))
}

/// Where a seat's draining stands within its oldest chunk.
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

impl ActiveObject {
    /// Takes a chunk of the seat's object as far as budget and room go; whether it is done with.
    pub(crate) fn receive(&mut self, chunk: &InboxChunk, desk: &mut TickContext<'_>) -> bool {
        match self.subscriber.receive(&chunk.header) {
            Reception::Stale => {
                self.inbox.turn();
                return true;
            }
            Reception::Gap => {
                self.end_epoch(desk);
                return true;
            }
            Reception::Next => {}
        }
        let before = self.inbox.done;
        match self.take(chunk, desk) {
            Taken::Whole => {
                self.subscriber.consumed(desk.tick);
                self.bytes_received += size_of::<InboxChunk>() as u64;
                self.inbox.turn();
                true
            }
            Taken::Part => {
                // Room is short when budget is left and nothing moved; what leaves is about to make some.
                if self.inbox.done == before && desk.budget.inbox > 0 && !self.is_leaving() {
                    self.inbox.waited += 1;
                }
                self.is_stalled = true;
                false
            }
            Taken::Gap => {
                self.end_epoch(desk);
                true
            }
        }
    }

    /// Follows the station's incarnation; an epoch that ends takes an unfinished tour with it.
    pub(crate) fn observe(&mut self, station: u64, tick: u64) {
        self.subscriber.observe(station, tick, &mut self.cache);
    }

    fn end_epoch(&mut self, desk: &mut TickContext<'_>) {
        self.subscriber.end_epoch(desk.tick, &mut self.cache);
        self.inbox.turn();
        if let Some(tour) = self.tour_of.and_then(|k| desk.probes[k].tour.as_mut()) {
            tour.points.clear();
        }
    }

    fn take(&mut self, chunk: &InboxChunk, desk: &mut TickContext<'_>) -> Taken {
        match ChunkKind::from_code(chunk.header.kind) {
            Some(ChunkKind::Model) => self.take_model(chunk, desk),
            Some(ChunkKind::Answers) => self.take_answers(chunk, desk),
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
                self.take_tour(chunk, desk);
                Taken::Whole
            }
            Some(ChunkKind::Refused) => {
                self.take_refusal(chunk, desk.tick);
                Taken::Whole
            }
            // A kind of a later version: skipped, the numbers go on.
            None => Taken::Whole,
        }
    }

    fn take_model(&mut self, chunk: &InboxChunk, desk: &mut TickContext<'_>) -> Taken {
        let Some(placing) = self.placing else {
            return Taken::Whole;
        };
        // What wakes has its model already and asks for none.
        if self.fault.is_some() || self.waking.is_some() {
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
            desk.library.begin(placing.model, &header);
            for (place, slot) in chunk.slots[..MODEL_HEADER_SLOTS].iter().enumerate() {
                desk.library.keep(placing.model, place, slot);
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
        let end = model_slots(&header) as u32;
        // A repeated answer (after an epoch ended) starts anew: what was set is set again, equal.
        for slot in 0..CHUNK_SLOTS as u32 {
            let place = chunk.header.code.saturating_add(slot);
            if place < self.inbox.model_slots || place >= end {
                continue;
            }
            if place > self.inbox.model_slots {
                return Taken::Gap;
            }
            if desk.budget.inbox < 4 * PER_ITEM {
                desk.budget.inbox = 0;
                return Taken::Part;
            }
            let slot = &chunk.slots[slot as usize];
            if !self.take_base_slot(&header, place, slot, &mut desk.budget.inbox) {
                self.fault = Some(Fault::DamagedModel);
                return Taken::Whole;
            }
            desk.library.keep(placing.model, place as usize, slot);
            self.inbox.model_slots = place + 1;
            self.inbox.done += 1;
        }
        if self.inbox.model_slots >= end {
            self.finish_model(header, desk);
            self.subscriber.answered();
        }
        Taken::Whole
    }

    /// Takes a slot of base vertices or base faces; false when it makes no sense.
    fn take_base_slot(
        &mut self,
        header: &ModelHeader,
        place: u32,
        slot: &ChunkSlot,
        budget: &mut u32,
    ) -> bool {
        let faces_from = first_face_slot(header) as u32;
        if place < faces_from {
            let first = 4 * (place - MODEL_HEADER_SLOTS as u32);
            let items: &[BaseVertex; 4] = bytemuck::cast_ref(&slot.words);
            let count = 4.min(header.base_vertices - first);
            *budget -= PER_ITEM;
            (0..count).all(|k| self.cache.set_base_vertex(first + k, &items[k as usize]))
        } else {
            let first = 2 * (place - faces_from);
            let items: &[BaseFace; 2] = bytemuck::cast_ref(&slot.words);
            let count = 2.min(header.base_faces - first);
            *budget -= 2 * PER_ITEM;
            (0..count).all(|k| self.cache.set_base_face(first + k, &items[k as usize]))
        }
    }

    /// Takes more of the kept base mesh in, while the object wakes; half of the tick's budget at the most, so that
    /// what others touch goes on coming.
    pub(crate) fn wake(&mut self, desk: &mut TickContext<'_>) {
        let (Some(mut place), Some(placing)) = (self.waking, self.placing) else {
            return;
        };
        let (Some(model), Some(slots)) = (
            desk.library.model(placing.model).copied(),
            desk.library.slots(placing.model),
        ) else {
            return;
        };
        let least = desk.budget.inbox / 2;
        while place < slots.len() && desk.budget.inbox >= least + 4 * PER_ITEM {
            let slot = &slots[place];
            let budget = &mut desk.budget.inbox;
            if !self.take_base_slot(&model.header, place as u32, slot, budget) {
                self.fault = Some(Fault::DamagedModel);
                return;
            }
            place += 1;
        }
        let is_whole = place == slots.len();
        self.waking = (!is_whole).then_some(place);
        if is_whole {
            self.finish_model(model.header, desk);
        }
    }

    fn finish_model(&mut self, header: ModelHeader, desk: &mut TickContext<'_>) {
        let Some(placing) = self.placing else {
            return;
        };
        if !self.cache.mesh().base_is_consistent() {
            self.fault = Some(Fault::DamagedModel);
            return;
        }
        self.cache.refit();
        let frame = ModelFrame::new(placing.pose, placing.scale, &header);
        let model = match desk.library.model(placing.model) {
            Some(known) if known.header.model != header.model => {
                self.fault = Some(Fault::AnotherModel);
                return;
            }
            Some(known) => *known,
            None => {
                let model = self.measured_base(header);
                desk.library.learn(placing.model, model);
                model
            }
        };
        self.dial = Some(self.dial_for(&header, model.area, frame.metres_per_unit));
        self.model = Some(model);
        self.frame = Some(frame);
        self.subscriber.model_is(header.model);
        self.ask_next_tour(desk);
    }

    /// The model of a base mesh that has just come.
    fn measured_base(&self, header: ModelHeader) -> Model {
        let mesh = self.cache.mesh();
        let radius_max = (0..header.base_vertices)
            .map(|v| mesh.radius(v))
            .fold(0.0f32, f32::max);
        Model {
            header,
            radius_max: f64::from(radius_max),
            area: (0..header.base_faces)
                .map(|face| triangle_area(mesh.corners(face)))
                .sum(),
        }
    }

    /// Asks for the tour of the next probe that awaits one of this object.
    pub(crate) fn ask_next_tour(&mut self, desk: &mut TickContext<'_>) {
        let (Some(object), Some(frame)) = (self.object(), self.frame) else {
            return;
        };
        let mut probes = desk.probes.iter();
        self.tour_of = probes.position(|probe| probe.awaits_tour_of(object));
        if let Some(ask) = self.tour_of.and_then(|k| desk.probes[k].tour_ask(&frame)) {
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

    fn take_answers(&mut self, chunk: &InboxChunk, desk: &mut TickContext<'_>) -> Taken {
        let tick = desk.tick;
        let budget = &mut *desk.budget;
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
            if budget.inbox < cost {
                budget.inbox = 0;
                return Taken::Part;
            }
            if let AnswerItem::Part(head) = item {
                budget.inbox -= cost;
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
                    budget.inbox -= cost;
                    self.take_ids(chunk, region, (id, record_follows), &mut reader)
                }
                AnswerItem::Record(item) => {
                    if !self.cache.has_slot() && !self.make_room(region, tick, budget) {
                        if self.inbox.waited < PATIENCE {
                            return Taken::Part;
                        }
                        self.give_up(region, budget);
                        self.refinement.starved(tick);
                        continue;
                    }
                    budget.inbox -= cost;
                    self.take_record(region, &item, &mut budget.operations)
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
                    self.give_up(region, budget);
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
    fn give_up(&mut self, region: usize, budget: &mut Budget) {
        self.subscriber.answered();
        if self.may_leave(budget) {
            self.leave(region, budget);
        } else {
            self.cache.let_go(region, u32::MAX);
            // The station goes on believing in it; should it be asked for again, the answer lacks
            // records, and is asked for once more.
            self.cache.regions.remove(region);
        }
    }

    /// Drops an asked region that cannot be used; after a while it may be asked for again.
    pub(crate) fn refuse(&mut self, region: usize, tick: u64) {
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

    fn take_tour(&mut self, chunk: &InboxChunk, desk: &mut TickContext<'_>) {
        let Some(tour) = self.tour_of.and_then(|k| desk.probes[k].tour.as_mut()) else {
            return;
        };
        let points: &[TourPoint] = bytemuck::cast_slice(&chunk.slots);
        let count = (chunk.header.count as usize).min(points.len());
        for point in &points[..count] {
            let finite = point.t.is_finite()
                && point.position.iter().all(|x| x.is_finite())
                && point.orientation_wxyz.iter().all(|x| x.is_finite());
            let ordered = tour.points.last().is_none_or(|last| last.t < point.t);
            // A longer tour than was asked for is cut, never stored.
            if finite && ordered && tour.points.len() < tour.points.capacity() {
                tour.points.push(*point);
            }
        }
        if chunk.header.last == 1 {
            tour.is_whole = true;
            self.subscriber.tour_is_here();
            self.subscriber.answered();
            self.ask_next_tour(desk);
        }
    }

    fn take_refusal(&mut self, chunk: &InboxChunk, tick: u64) {
        match Refusal::from_code(chunk.header.code) {
            Some(Refusal::UnknownModel) => self.fault = Some(Fault::UnknownModel),
            // Only a tour is refused without a region.
            _ if chunk.header.region == NONE && self.tour_of.is_some() => {
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
