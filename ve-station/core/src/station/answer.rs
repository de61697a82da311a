//! Answers, made chunk by chunk.

use super::SEARCHED_A_STEP;
use super::residency_change::ResidencyChange;
use super::{Chunk, Station, region_at};
use crate::collection::{CollectError, MISSING, RegionAt, Residency, Search};
use crate::tuning::service::MAX_PASSED;
use bytemuck::Zeroable;
use protocol::{
    AnswersWriter, CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, MODEL_HEADER_SLOTS,
    QUARTERED_PER_CHUNK, Refusal, RegionAsk, quartered_faces_mut,
};
use spm::{BaseFace, BaseVertex, ModelHeader};
use spm::{FileError, NONE, SpmFile};

/// Base vertices in one slot.
const VERTICES_PER_SLOT: usize = size_of::<ChunkSlot>() / size_of::<BaseVertex>();
/// Base faces in one slot.
const FACES_PER_SLOT: usize = size_of::<ChunkSlot>() / size_of::<BaseFace>();

/// A question that waits or is being answered.
#[derive(Debug)]
pub enum Job {
    /// Say no.
    Refused {
        /// The region asked for, if it is about one.
        ask: Option<RegionAsk>,
        refusal: Refusal,
    },
    /// Head and base mesh, from a slot on.
    Model { model: usize, next_slot: usize },
    /// Quartered faces from this place on, as many as a chunk holds.
    Quarters { model: usize, first: usize },
    /// Closure and records.
    Region {
        model: usize,
        ask: RegionAsk,
        /// With every record, whatever the client is believed to hold.
        whole: bool,
        answer: Option<Box<Answer>>,
    },
}

impl Job {
    /// Whether it is the question for this region.
    pub fn is_of(&self, region: RegionAt) -> bool {
        matches!(self, Self::Region { ask, .. } if region_at(ask) == region)
    }
}

/// How far the answer for a region is.
#[derive(Debug)]
pub struct Answer {
    /// The search, until all that it found is in `closure`.
    search: Option<Search>,
    /// Whether the search is complete: what it found is taken over, id by id as they are written.
    is_found: bool,
    /// Whether this answer takes its region in: it was not held before.
    takes_in: bool,
    /// The closure, marked with [`MISSING`] where a record is to be sent.
    closure: Vec<u32>,
    next_id: usize,
    /// The next place of the closure whose record may be to be sent.
    next_record: usize,
    started: bool,
}

/// What came of working on a job.
pub enum Progress {
    /// No steps are left: there is more to do before there is a chunk.
    Working,
    /// A chunk, and more to come.
    Chunk(Chunk),
    /// The last chunk.
    Last(Chunk),
}

impl Progress {
    fn of(chunk: Chunk) -> Self {
        if chunk.0.last == 1 {
            Self::Last(chunk)
        } else {
            Self::Chunk(chunk)
        }
    }
}

/// A chunk without content; [`Station::poll`] numbers and addresses it.
pub fn blank(kind: ChunkKind, object: u32) -> Chunk {
    let mut header = ChunkHeader::zeroed();
    header.kind = kind as u32;
    header.object = object;
    header.region = NONE;
    (header, [ChunkSlot::zeroed(); CHUNK_SLOTS])
}

impl<D: AsRef<[u8]>> Station<D> {
    /// Makes the next chunk of an answer, with so many steps at the most.
    pub(super) fn advance(&mut self, at: usize, job: &mut Job, steps: &mut u64) -> Progress {
        let object = self.sessions[at].object;
        match job {
            Job::Refused { ask, refusal } => {
                Progress::Last(self.refused(object, ask.as_ref(), *refusal))
            }
            Job::Model { model, next_slot } => {
                Progress::of(model_chunk(&self.models[*model].file, object, next_slot))
            }
            Job::Quarters { model, first } => {
                Progress::Last(quarters_chunk(&self.models[*model].file, object, *first))
            }
            Job::Region { .. } => self.advance_regions(at, object, job, steps),
        }
    }

    /// A part of an answer that is still searched for, without content: so that its client knows
    /// that it is not forgotten.
    pub(super) fn unfinished_answer(&mut self, at: usize) -> Option<Chunk> {
        let session = &mut self.sessions[at];
        let Some(Job::Region { ask, answer, .. }) = session.jobs.front_mut() else {
            return None;
        };
        let mut writer = AnswersWriter::new();
        // What the client holds may have to be gone through first: then no answer has begun.
        if let Some(answer) = answer {
            if answer.is_found {
                return None;
            }
            writer.begin(ask.region, ask.tolerance_bits, !answer.started);
            writer.end(false);
            answer.started = true;
        }
        let (mut header, _) = blank(ChunkKind::Answers, session.object);
        let (count, slots) = writer.finish();
        header.count = count;
        Some((header, slots))
    }

    pub(super) fn refused(
        &mut self,
        object: u32,
        ask: Option<&RegionAsk>,
        refusal: Refusal,
    ) -> Chunk {
        let (mut header, slots) = blank(ChunkKind::Refused, object);
        if let Some(ask) = ask {
            header.region = ask.region;
            header.tolerance_bits = ask.tolerance_bits;
        }
        header.code = refusal as u32;
        header.last = 1;
        self.counters.refused += 1;
        (header, slots)
    }

    /// Packs the answer to a region, and what waits behind it for other regions, into a chunk.
    fn advance_regions(
        &mut self,
        at: usize,
        object: u32,
        first: &mut Job,
        steps: &mut u64,
    ) -> Progress {
        let mut writer = AnswersWriter::new();
        // The job being packed, once that is not the first any more.
        let mut later: Option<Job> = None;
        let mut whole = true;
        loop {
            match self.pack(at, later.as_mut().unwrap_or(first), &mut writer, steps) {
                Packed::Whole => {}
                Packed::Nothing if writer.is_empty() => return Progress::Working,
                // It goes on when what is packed is sent.
                Packed::Nothing => {
                    if let Some(job) = later.take() {
                        self.sessions[at].jobs.push_front(job);
                    }
                    break;
                }
                Packed::Part => {
                    whole = false;
                    break;
                }
                Packed::Refused(ask, refusal) if writer.is_empty() => {
                    return Progress::Last(self.refused(object, Some(&ask), refusal));
                }
                Packed::Refused(ask, refusal) => {
                    self.sessions[at].jobs.push_front(Job::Refused {
                        ask: Some(ask),
                        refusal,
                    });
                    break;
                }
            }
            let jobs = &mut self.sessions[at].jobs;
            let is_alike = matches!(jobs.front(), Some(Job::Region { .. }));
            if !is_alike || writer.room() < AnswersWriter::MIN_ROOM {
                break;
            }
            later = jobs.pop_front();
        }
        let (mut header, _) = blank(ChunkKind::Answers, object);
        let (count, slots) = writer.finish();
        header.count = count;
        header.last = u32::from(whole);
        match later {
            None => Progress::of((header, slots)),
            Some(job) => {
                if !whole {
                    self.sessions[at].jobs.push_front(job);
                }
                Progress::Last((header, slots))
            }
        }
    }

    /// Packs as much of an answer as there is room for.
    fn pack(
        &mut self,
        at: usize,
        job: &mut Job,
        writer: &mut AnswersWriter,
        steps: &mut u64,
    ) -> Packed {
        let Job::Region {
            model,
            ask,
            whole,
            answer,
            ..
        } = job
        else {
            return Packed::Whole;
        };
        let (model, region) = (*model, region_at(ask));
        let file = &self.models[model].file;
        let session = &mut self.sessions[at];
        let mut given = match answer.take() {
            Some(given) => given,
            None => match session.begin_answer(file, model, region) {
                Ok(started) => Box::new(started),
                Err(error) => {
                    self.refuse_region(model, &error);
                    return Packed::Refused(*ask, error.refusal());
                }
            },
        };
        match given.find(file, region, &mut session.residency, steps) {
            Ok(true) => {}
            Ok(false) => {
                *answer = Some(given);
                return Packed::Nothing;
            }
            Err(error) => {
                self.refuse_region(model, &error);
                return Packed::Refused(*ask, error.refusal());
            }
        }
        match given.pack(file, (ask, *whole), &mut session.residency, writer) {
            Ok((records, done)) => {
                self.counters.records += records;
                self.counters.regions += u64::from(done);
                if done {
                    return Packed::Whole;
                }
                *answer = Some(given);
                Packed::Part
            }
            Err(_) => {
                // Its blocks were sound a moment ago; still, no record is made up.
                session.residency.release(region);
                session
                    .residency_changes
                    .push_back(ResidencyChange::Forget(given.ids()));
                Packed::Refused(*ask, Refusal::DamagedBlock)
            }
        }
    }
}

/// What came of packing an answer into a chunk.
enum Packed {
    /// All of it is in.
    Whole,
    /// The chunk is full.
    Part,
    /// Its closure is not found yet, and no steps are left.
    Nothing,
    /// There is no answer, or no more of it.
    Refused(RegionAsk, Refusal),
}

impl Answer {
    pub(super) fn new(search: Search) -> Self {
        Self {
            search: Some(search),
            is_found: false,
            takes_in: false,
            closure: Vec::new(),
            next_id: 0,
            next_record: 0,
            started: false,
        }
    }

    /// The search, as far as it is: for whoever asks again.
    pub(super) fn into_search(self) -> Option<Search> {
        let mut search = self.search?;
        search.rewind();
        Some(search)
    }

    /// What the client is believed to hold by it, to be given up: nothing where the region was held
    /// before.
    pub(super) fn taken_in(self) -> Option<Vec<u32>> {
        self.takes_in.then(|| self.ids())
    }

    /// Its VSPs.
    fn ids(self) -> Vec<u32> {
        let mut ids = self.closure;
        ids.iter_mut().for_each(|i| *i &= !MISSING);
        ids
    }

    /// Writes the answer again from its start, with every record: its client had no use for it.
    /// What is found stays found.
    pub(super) fn again(&mut self) {
        self.closure.iter_mut().for_each(|i| *i |= MISSING);
        self.next_id = 0;
        self.next_record = 0;
        self.started = false;
    }

    /// Goes on with the search; whether the closure is found.
    fn find<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        region: RegionAt,
        residency: &mut Residency,
        steps: &mut u64,
    ) -> Result<bool, CollectError> {
        while !self.is_found
            && *steps > 0
            && let Some(search) = &mut self.search
        {
            *steps -= 1;
            if search.step(file, SEARCHED_A_STEP)? {
                self.is_found = true;
                self.takes_in = residency.hold(region);
            }
        }
        Ok(self.is_found)
    }

    /// The next id to be written. Where all are that were taken over, the next that was found is:
    /// from then on the client is believed to hold it.
    fn id(&mut self, whole: bool, residency: &mut Residency) -> Option<u32> {
        if self.next_id == self.closure.len() {
            let Some(vsp) = self.search.as_mut()?.next_id() else {
                self.search = None;
                return None;
            };
            let lacks = self.takes_in && residency.add(vsp);
            let mark = if lacks || whole { MISSING } else { 0 };
            self.closure.push(vsp | mark);
        }
        self.closure.get(self.next_id).copied()
    }

    /// Writes a part; the number of records in it, and whether the answer ends with it.
    fn pack<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        (ask, whole): (&RegionAsk, bool),
        residency: &mut Residency,
        writer: &mut AnswersWriter,
    ) -> Result<(u64, bool), FileError> {
        writer.begin(ask.region, ask.tolerance_bits, !self.started);
        self.started = true;
        while let Some(i) = self.id(whole, residency)
            && writer.id(i & !MISSING, i & MISSING != 0)
        {
            self.next_id += 1;
        }
        let mut records = 0;
        let end = self.closure.len().min(self.next_record + MAX_PASSED);
        while self.search.is_none() && self.next_id == self.closure.len() && self.next_record < end
        {
            let i = self.closure[self.next_record];
            if i & MISSING != 0 {
                let record = match file.record(i & !MISSING) {
                    Ok(record) => record,
                    Err(error) => {
                        writer.end(false);
                        return Err(error);
                    }
                };
                if !writer.record(&record) {
                    break;
                }
                records += 1;
            }
            self.next_record += 1;
        }
        let done = self.search.is_none() && self.next_record == self.closure.len();
        writer.end(done);
        Ok((records, done))
    }
}

/// A chunk of the model's quartered faces from a place on.
fn quarters_chunk<D: AsRef<[u8]>>(file: &SpmFile<D>, object: u32, first: usize) -> Chunk {
    let (mut header, mut slots) = blank(ChunkKind::Quarters, object);
    let rest = file.quartered_faces().get(first..).unwrap_or_default();
    let part = &rest[..rest.len().min(QUARTERED_PER_CHUNK)];
    quartered_faces_mut(&mut slots)[..part.len()].copy_from_slice(part);
    header.code = first as u32;
    header.count = part.len() as u32;
    header.last = 1;
    (header, slots)
}

/// A chunk of the model's head and base mesh: slots are numbered through the answer, the head
/// first, then base vertices, then base faces from a fresh slot. A client that says it has all of
/// them, or more, means another model: it gets this one from its start.
fn model_chunk<D: AsRef<[u8]>>(file: &SpmFile<D>, object: u32, next_slot: &mut usize) -> Chunk {
    let (mut header, mut slots) = blank(ChunkKind::Model, object);
    let head: ModelHeader = file.model_header();
    let (vertices, faces) = (file.base_vertices(), file.base_faces());
    let first_face_slot = MODEL_HEADER_SLOTS + vertices.len().div_ceil(VERTICES_PER_SLOT);
    let end = first_face_slot + faces.len().div_ceil(FACES_PER_SLOT);
    if *next_slot >= end {
        *next_slot = 0;
    }
    header.code = *next_slot as u32;
    for slot in &mut slots {
        let at = *next_slot;
        if at == end {
            break;
        }
        if at < MODEL_HEADER_SLOTS {
            let bytes = bytemuck::bytes_of(&head);
            let from = at * size_of::<ChunkSlot>();
            let part =
                &bytes[from.min(bytes.len())..bytes.len().min(from + size_of::<ChunkSlot>())];
            bytemuck::bytes_of_mut(slot)[..part.len()].copy_from_slice(part);
        } else if at < first_face_slot {
            let from = (at - MODEL_HEADER_SLOTS) * VERTICES_PER_SLOT;
            let part = &vertices[from..vertices.len().min(from + VERTICES_PER_SLOT)];
            let places: &mut [BaseVertex] = bytemuck::cast_slice_mut(&mut slot.words);
            places[..part.len()].copy_from_slice(part);
            header.count += part.len() as u32;
        } else {
            let from = (at - first_face_slot) * FACES_PER_SLOT;
            let part = &faces[from..faces.len().min(from + FACES_PER_SLOT)];
            let places: &mut [BaseFace] = bytemuck::cast_slice_mut(&mut slot.words);
            places[..part.len()].copy_from_slice(part);
            header.count += part.len() as u32;
        }
        *next_slot += 1;
    }
    header.last = u32::from(*next_slot == end);
    (header, slots)
}
