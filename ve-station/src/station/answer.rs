//! Answers, made chunk by chunk.

use super::{Chunk, Station, region_at};
use crate::collection::RegionAt;
use crate::tour::Tour;
use bytemuck::Zeroable;
use shared::protocol::{
    BaseFace, BaseVertex, CHUNK_SLOTS, ChunkHeader, ChunkKind, ChunkSlot, IDS_PER_SLOT,
    MODEL_HEADER_SLOTS, ModelHeader, Refusal, RegionAsk,
};
use shared::spm::{NONE, SpmFile};

/// Base vertices in one slot.
const VERTICES_PER_SLOT: usize = size_of::<ChunkSlot>() / size_of::<BaseVertex>();
/// Base faces in one slot.
const FACES_PER_SLOT: usize = size_of::<ChunkSlot>() / size_of::<BaseFace>();

/// A question that waits or is being answered.
#[derive(Debug)]
pub enum Job {
    /// Say no.
    Refused {
        object: u32,
        /// The region asked for, if it is about one.
        ask: Option<RegionAsk>,
        refusal: Refusal,
    },
    /// Head and base mesh.
    Model {
        model: usize,
        object: u32,
        next_slot: usize,
    },
    /// Closure and records.
    Region {
        model: usize,
        object: u32,
        ask: RegionAsk,
        answer: Option<Answer>,
    },
    /// A scripted path.
    Tour {
        model: usize,
        object: u32,
        tour: Box<Tour>,
        next_slot: usize,
    },
}

impl Job {
    /// Whether it is the question for this region.
    pub fn is_of(&self, of: usize, region: RegionAt) -> bool {
        matches!(self, Self::Region { model, ask, .. } if *model == of && region_at(ask) == region)
    }
}

/// How far the answer for a region is.
#[derive(Debug)]
pub struct Answer {
    closure: Vec<u32>,
    lacking: Vec<u32>,
    ids_sent: usize,
    records_sent: usize,
    chunks: u32,
}

/// What came of working on a job.
pub enum Progress {
    /// A chunk, and more to come.
    Chunk(Chunk),
    /// The last chunk.
    Last(Chunk),
    /// Nothing, and no more to come.
    Nothing,
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
    /// Makes the next chunk of an answer.
    pub(super) fn advance(&mut self, at: usize, job: &mut Job) -> Progress {
        match job {
            Job::Refused {
                object,
                ask,
                refusal,
            } => Progress::Last(self.refused(*object, ask.as_ref(), *refusal)),
            Job::Model {
                model,
                object,
                next_slot,
            } => Progress::of(model_chunk(
                &self.models[*model].served.file,
                *object,
                next_slot,
            )),
            Job::Region {
                model,
                object,
                ask,
                answer,
            } => self.advance_region(at, *model, *object, ask, answer),
            Job::Tour {
                model,
                object,
                tour,
                next_slot,
            } => {
                let (model, object) = (*model, *object);
                match tour_chunk(&self.models[model].served.file, object, tour, next_slot) {
                    Some(chunk) => Progress::of(chunk),
                    None => {
                        let name = &self.models[model].served.name;
                        let note =
                            format!("a tour of {name} is refused: the file is damaged all over");
                        self.note((model, NONE), note);
                        Progress::Last(self.refused(object, None, Refusal::DamagedBlock))
                    }
                }
            }
        }
    }

    fn refused(&mut self, object: u32, ask: Option<&RegionAsk>, refusal: Refusal) -> Chunk {
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

    /// Answers an empty region, and all empty ones that wait behind it.
    fn empty_chunk(&mut self, at: usize, model: usize, object: u32, first: RegionAt) -> Chunk {
        let (mut header, mut slots) = blank(ChunkKind::Empty, object);
        let ids: &mut [u32] = bytemuck::cast_slice_mut(&mut slots);
        header.tolerance_bits = first.tolerance_bits;
        ids[0] = first.region.0;
        let mut count = 1;
        let of_model = &mut self.models[model];
        self.clients[at].jobs.retain(|job| match job {
            Job::Region {
                model: other,
                object: of,
                ask,
                answer: None,
            } if *other == model
                && *of == object
                && ask.tolerance_bits == first.tolerance_bits
                && count < ids.len() =>
            {
                let closure = of_model.closure(region_at(ask));
                let empty = closure.is_ok_and(|closure| closure.is_empty());
                if empty {
                    ids[count] = ask.region;
                    count += 1;
                }
                !empty
            }
            _ => true,
        });
        header.count = count as u32;
        header.last = 1;
        self.counters.regions += count as u64;
        (header, slots)
    }

    fn advance_region(
        &mut self,
        at: usize,
        model: usize,
        object: u32,
        ask: &RegionAsk,
        answer: &mut Option<Answer>,
    ) -> Progress {
        let region = region_at(ask);
        if answer.is_none() {
            match self.models[model].closure(region) {
                Ok(closure) if closure.is_empty() => {
                    return Progress::Last(self.empty_chunk(at, model, object, region));
                }
                Ok(closure) => {
                    let vsps = self.models[model].served.file.model_header().vsps;
                    let lacking = self.clients[at]
                        .residency(model)
                        .insert(region, &closure, vsps);
                    *answer = Some(Answer {
                        closure,
                        lacking,
                        ids_sent: 0,
                        records_sent: 0,
                        chunks: 0,
                    });
                }
                Err(error) => {
                    self.refuse_region(model, &error);
                    return Progress::Last(self.refused(object, Some(ask), error.refusal()));
                }
            }
        }
        let Some(answer) = answer else {
            return Progress::Nothing;
        };
        let (mut header, slots) = if answer.ids_sent < answer.closure.len() {
            answer.ids_chunk(object)
        } else {
            match answer.records_chunk(&self.models[model].served.file, object) {
                Some(chunk) => chunk,
                None => {
                    // Its blocks were sound a moment ago; still, no record is made up.
                    let closure = std::mem::take(&mut answer.closure);
                    self.clients[at].residency(model).remove(region, &closure);
                    return Progress::Last(self.refused(object, Some(ask), Refusal::DamagedBlock));
                }
            }
        };
        header.region = ask.region;
        header.tolerance_bits = ask.tolerance_bits;
        header.code = answer.chunks * CHUNK_SLOTS as u32;
        let done =
            answer.ids_sent == answer.closure.len() && answer.records_sent == answer.lacking.len();
        header.last = u32::from(done);
        answer.chunks += 1;
        if header.kind == ChunkKind::Records as u32 {
            self.counters.records += u64::from(header.count);
        }
        self.counters.regions += u64::from(header.last);
        Progress::of((header, slots))
    }
}

impl Answer {
    fn ids_chunk(&mut self, object: u32) -> Chunk {
        let (mut header, mut slots) = blank(ChunkKind::Closure, object);
        let words: &mut [u32] = bytemuck::cast_slice_mut(&mut slots);
        let rest = &self.closure[self.ids_sent..];
        let count = rest.len().min(CHUNK_SLOTS * IDS_PER_SLOT);
        words[..count].copy_from_slice(&rest[..count]);
        self.ids_sent += count;
        header.count = count as u32;
        (header, slots)
    }

    /// `None` when a record cannot be read.
    fn records_chunk<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>, object: u32) -> Option<Chunk> {
        let (mut header, mut slots) = blank(ChunkKind::Records, object);
        let rest = &self.lacking[self.records_sent..];
        for (slot, &i) in slots.iter_mut().zip(rest) {
            *slot = bytemuck::cast(file.record(i).ok()?);
            header.count += 1;
        }
        self.records_sent += header.count as usize;
        Some((header, slots))
    }
}

/// A chunk of the model's head and base mesh: slots are numbered through the answer, the head first, then
/// base vertices, then base faces from a fresh slot.
fn model_chunk<D: AsRef<[u8]>>(file: &SpmFile<D>, object: u32, next_slot: &mut usize) -> Chunk {
    let (mut header, mut slots) = blank(ChunkKind::Model, object);
    let head: ModelHeader = file.model_header();
    let (vertices, faces) = (file.base_vertices(), file.base_faces());
    let first_face_slot = MODEL_HEADER_SLOTS + vertices.len().div_ceil(VERTICES_PER_SLOT);
    let end = first_face_slot + faces.len().div_ceil(FACES_PER_SLOT);
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

/// The next points of a tour, `None` when the file is damaged where it goes.
fn tour_chunk<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    object: u32,
    tour: &mut Tour,
    next_slot: &mut usize,
) -> Option<Chunk> {
    let (mut header, mut slots) = blank(ChunkKind::Tour, object);
    header.code = *next_slot as u32;
    for slot in &mut slots {
        let Some(point) = tour.next_point(file).ok()? else {
            break;
        };
        *slot = bytemuck::cast(point);
        header.count += 1;
        *next_slot += 1;
    }
    header.last = u32::from(tour.is_over());
    Some((header, slots))
}
