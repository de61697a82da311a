//! Header and base mesh of a model: from chunks, or from the store, into the cache.

use super::Fault;
use super::chunk::InboxChunk;
use super::session::{Receiver, Session, Taken, TickContext};
use crate::cache::Cache;
use crate::cache::base_mesh_store::{Model, first_face_slot, model_slots};
use crate::instance::ModelFrame;
use crate::lod::lod_controller::triangle_area;
use crate::tuning::streaming::{MIN_UNITS, UNITS_PER_ITEM};
use glam::{DVec3, Vec3};
use protocol::{CHUNK_SLOTS, ChunkSlot, MODEL_HEADER_SLOTS, quartered_faces};
use spm::{BaseFace, BaseVertex, ModelHeader};

impl Session {
    pub(super) fn take_model(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        // An object that loads a stored base mesh has its model and requests none.
        if self.fault.is_some() || self.loading.is_some() {
            return Taken::Whole;
        }
        if let Some(known) = of.front.model() {
            if known.model.header.model != chunk.header.model {
                self.fault = Some(Fault::AnotherModel);
            }
            return Taken::Whole;
        }
        let is_first = self.progress.done == 0 && chunk.header.code == 0;
        if is_first && self.progress.header.is_none() {
            match begin_model(chunk, of, context) {
                Ok(header) => {
                    self.progress.header = Some(header);
                    self.progress.measures = BaseMeasures::default();
                    self.progress.model_slots = MODEL_HEADER_SLOTS as u32;
                }
                Err(fault) => {
                    self.fault = Some(fault);
                    return Taken::Whole;
                }
            }
        }
        let Some(header) = self.progress.header else {
            return Taken::Gap;
        };
        if header.model != chunk.header.model {
            self.fault = Some(Fault::AnotherModel);
            return Taken::Whole;
        }
        self.take_base_slots(&header, chunk, of, context)
    }

    /// Takes the slots of a chunk that come next.
    fn take_base_slots(
        &mut self,
        header: &ModelHeader,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        let end = model_slots(header) as u32;
        // An answer after the end of an epoch goes on from what is here, or begins anew.
        for slot in 0..CHUNK_SLOTS as u32 {
            let place = chunk.header.code.saturating_add(slot);
            if place < self.progress.model_slots || place >= end {
                continue;
            }
            if place > self.progress.model_slots {
                return Taken::Gap;
            }
            if context.budget.ingest < MIN_UNITS {
                context.budget.end_ingest();
                return Taken::Part;
            }
            let slot = &chunk.slots[slot as usize];
            let (cache, units) = (&mut of.front.cache, &mut context.budget.ingest);
            let measures = &mut self.progress.measures;
            if !take_base_slot(cache, header, (place, slot), units, measures) {
                self.fault = Some(Fault::DamagedModel);
                return Taken::Whole;
            }
            context.store.keep(of.instance.model, place as usize, slot);
            self.progress.model_slots = place + 1;
            self.progress.done += 1;
        }
        if self.progress.model_slots >= end {
            self.finish_model(*header, of, context);
        }
        Taken::Whole
    }

    /// Takes the quartered faces of a chunk that come next, thirty in the time of a record.
    pub(super) fn take_quarters(
        &mut self,
        chunk: &InboxChunk,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) -> Taken {
        const FACES_PER_ITEM: usize = 30;
        if self.subscriber.model() != chunk.header.model {
            self.fault = Some(Fault::AnotherModel);
            return Taken::Whole;
        }
        let faces = quartered_faces(&chunk.slots);
        let faces = &faces[..faces.len().min(chunk.header.count as usize)];
        let cache = &mut of.front.cache;
        let place = chunk.header.code as usize + self.progress.done;
        if faces.is_empty() || cache.next_quarters() != u32::try_from(place).ok() {
            self.fault = Some(Fault::DamagedModel);
            return Taken::Whole;
        }
        for part in faces[self.progress.done..].chunks(FACES_PER_ITEM) {
            if context.budget.ingest < MIN_UNITS {
                context.budget.end_ingest();
                return Taken::Part;
            }
            context.budget.ingest -= UNITS_PER_ITEM;
            if !part.iter().all(|face| cache.add_quarters(face)) {
                self.fault = Some(Fault::DamagedModel);
                return Taken::Whole;
            }
            self.progress.done += part.len();
        }
        self.subscriber.quarters_are_here();
        Taken::Whole
    }

    /// Loads more of a stored base mesh, while the object becomes active; with half of the tick's
    /// budget at the most, so that records for other objects go on arriving. Where there is time
    /// for one or the other only, they take turns.
    pub fn load_stored(&mut self, of: &mut Receiver<'_>, context: &mut TickContext<'_, '_>) {
        let Some(mut place) = self.loading else {
            return;
        };
        let (Some(model), Some(slots)) = (
            context.store.model(of.instance.model).copied(),
            context.store.slots(of.instance.model),
        ) else {
            return;
        };
        let ingest = context.budget.ingest;
        if ingest < MIN_UNITS + MAX_SLOT_UNITS && !context.tick.is_multiple_of(2) {
            return;
        }
        let least = (ingest / 2).min(ingest.saturating_sub(MIN_UNITS));
        while place < slots.len() && context.budget.ingest >= least + MIN_UNITS {
            let slot = &slots[place];
            let (cache, units) = (&mut of.front.cache, &mut context.budget.ingest);
            let (slot, measures) = ((place as u32, slot), &mut self.progress.measures);
            if !take_base_slot(cache, &model.header, slot, units, measures) {
                self.fault = Some(Fault::DamagedModel);
                return;
            }
            place += 1;
        }
        let is_whole = place == slots.len();
        self.loading = (!is_whole).then_some(place);
        if is_whole {
            self.finish_model(model.header, of, context);
        }
    }

    /// The base mesh is complete: the front begins, and the scripted path is requested.
    fn finish_model(
        &mut self,
        header: ModelHeader,
        of: &mut Receiver<'_>,
        context: &mut TickContext<'_, '_>,
    ) {
        let instance = of.instance;
        if !of.front.cache.mesh().base_is_consistent() {
            self.fault = Some(Fault::DamagedModel);
            return;
        }
        of.front.cache.refit();
        let frame = ModelFrame::new(instance.pose, instance.scale, &header);
        let model = match context.store.model(instance.model) {
            Some(known) if known.header.model != header.model => {
                self.fault = Some(Fault::AnotherModel);
                return;
            }
            Some(known) => *known,
            None => {
                let BaseMeasures { radius_max, area } = self.progress.measures;
                let model = Model {
                    header,
                    radius_max,
                    area,
                };
                context.store.insert(instance.model, model);
                model
            }
        };
        of.front.begin(model, frame.metres_per_unit);
        *of.frame = Some(frame);
        self.subscriber.model_is(header.model);
        self.request_next_tour(of, context.probes);
    }
}

/// The header of a model arrives: the cache is laid out for it, and the store sets slots aside.
fn begin_model(
    chunk: &InboxChunk,
    of: &mut Receiver<'_>,
    context: &mut TickContext<'_, '_>,
) -> Result<ModelHeader, Fault> {
    let raw: &[u8] = bytemuck::cast_slice(&chunk.slots);
    let header: ModelHeader = bytemuck::pod_read_unaligned(&raw[..size_of::<ModelHeader>()]);
    if !header.is_valid() || header.model != chunk.header.model {
        return Err(Fault::DamagedModel);
    }
    of.front.cache.begin_model(&header)?;
    context.store.begin(of.instance.model, &header);
    for (place, slot) in chunk.slots[..MODEL_HEADER_SLOTS].iter().enumerate() {
        context.store.keep(of.instance.model, place, slot);
    }
    Ok(header)
}

/// What is measured of a base mesh while it arrives; model units.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct BaseMeasures {
    /// The largest R, as far as the model's box says nothing less.
    radius_max: f64,
    area: f64,
}

/// Distance of a point in stored coordinates from the farthest corner of the model's box, model
/// units: no vertex of the full mesh is farther.
fn farthest_corner(header: &ModelHeader, position: [f32; 3]) -> f64 {
    let origin = DVec3::from_array(header.origin);
    let point = Vec3::from_array(position).as_dvec3();
    let [lower, upper] = [header.lower, header.upper].map(|corner| {
        let corner = DVec3::from_array(corner) - origin;
        (corner - point).abs()
    });
    lower.max(upper).length()
}

/// Work units of a slot at the most: that of two base faces.
const MAX_SLOT_UNITS: u32 = 2 * UNITS_PER_ITEM;

/// Takes a slot of base vertices or base faces; false when its numbers are invalid.
fn take_base_slot(
    cache: &mut Cache,
    header: &ModelHeader,
    (place, slot): (u32, &ChunkSlot),
    units: &mut u32,
    measures: &mut BaseMeasures,
) -> bool {
    let faces_from = first_face_slot(header) as u32;
    if place < faces_from {
        let first = 4 * (place - MODEL_HEADER_SLOTS as u32);
        let items: &[BaseVertex; 4] = bytemuck::cast_ref(&slot.words);
        let count = 4.min(header.base_vertices - first);
        *units -= UNITS_PER_ITEM;
        (0..count).all(|k| {
            let vertex = &items[k as usize];
            if !cache.set_base_vertex(first + k, vertex) {
                return false;
            }
            // A vertex of which nothing is certified has an infinite R.
            let radius = f64::from(cache.mesh().radius(first + k));
            let radius = radius.min(farthest_corner(header, vertex.position));
            measures.radius_max = measures.radius_max.max(radius);
            true
        })
    } else {
        let first = 2 * (place - faces_from);
        let items: &[BaseFace; 2] = bytemuck::cast_ref(&slot.words);
        let count = 2.min(header.base_faces - first);
        *units -= MAX_SLOT_UNITS;
        (0..count).all(|k| {
            let is_set = cache.set_base_face(first + k, &items[k as usize]);
            if is_set {
                measures.area += triangle_area(cache.mesh().corners(first + k));
            }
            is_set
        })
    }
}
