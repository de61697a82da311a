//! Base meshes of the models of a scene, each once for all objects that have the same model.
//!
//! A base mesh is kept in the slots of its chunks, so that a newly active object loads it by the
//! same code as one that arrives. The slots are allocated at start; a base mesh without room in
//! them is requested again whenever an object of it becomes active.

use glam::{DVec3, Vec3};
use protocol::{ChunkSlot, MODEL_HEADER_SLOTS};
use spm::{BaseFace, BaseVertex, ModelHeader};

/// Bytes set aside for each model's base mesh: 900 faces; and the most, as a share of the cache.
const BYTES_PER_MODEL: usize = 36 << 10;
const MAX_SHARE: usize = 4;

/// A model whose base mesh is known.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct Model {
    /// Its header.
    pub header: ModelHeader,
    /// The largest R of the base mesh: no full-mesh point is farther from the front, model units.
    pub radius_max: f64,
    /// Area of the base mesh, square model units.
    pub area: f64,
}

#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct Entry {
    model: Option<Model>,
    /// First of its slots and their number, once they are set aside.
    slots: Option<(usize, usize)>,
}

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct BaseMeshStore {
    entries: Vec<Entry>,
    slots: Vec<ChunkSlot>,
    used: usize,
    known: usize,
}

/// Slots of a model's answer: head, base vertices four to a slot, base faces two to a slot.
#[must_use]
pub fn model_slots(header: &ModelHeader) -> usize {
    first_face_slot(header) + header.base_faces.div_ceil(2) as usize
}

/// The slot of a model's answer with its first faces.
#[must_use]
pub fn first_face_slot(header: &ModelHeader) -> usize {
    MODEL_HEADER_SLOTS + header.base_vertices.div_ceil(4) as usize
}

impl BaseMeshStore {
    /// Bytes that base meshes take beside the active objects: none where every object stays active.
    #[must_use]
    pub fn bytes_for(models: usize, cache_bytes: usize, all_active: bool) -> usize {
        if all_active {
            return 0;
        }
        (models * BYTES_PER_MODEL).min(cache_bytes / MAX_SHARE)
    }

    /// Nothing is known of so many models; everything is allocated now.
    #[must_use]
    pub fn new(models: usize, bytes: usize) -> Self {
        Self {
            entries: vec![Entry::default(); models],
            slots: vec![bytemuck::Zeroable::zeroed(); bytes / size_of::<ChunkSlot>()],
            used: 0,
            known: 0,
        }
    }

    /// A model, once it is known.
    #[must_use]
    pub fn model(&self, model: usize) -> Option<&Model> {
        self.entries[model].model.as_ref()
    }

    /// The models that are known.
    pub fn models(&self) -> impl Iterator<Item = &Model> {
        self.entries.iter().filter_map(|entry| entry.model.as_ref())
    }

    /// How many models are known.
    #[must_use]
    pub fn known(&self) -> usize {
        self.known
    }

    /// Bytes of the base meshes that are kept.
    #[must_use]
    pub fn bytes_used(&self) -> usize {
        self.used * size_of::<ChunkSlot>()
    }

    /// Bytes that base meshes may take.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(&self.slots[..])
    }

    /// The slots used and there are.
    #[must_use]
    pub fn high_water(&self) -> (usize, usize) {
        (self.used, self.slots.len())
    }

    /// A model's answer begins: its slots are set aside if there is room. An answer that began
    /// before, perhaps of another model under the same name, gives its slots to this one; a model
    /// that is known keeps them.
    pub fn begin(&mut self, model: usize, header: &ModelHeader) {
        let count = model_slots(header);
        let entry = &mut self.entries[model];
        if entry.model.is_some() {
            return;
        }
        entry.slots = match entry.slots {
            Some((first, room)) if count <= room => Some((first, count)),
            _ if count <= self.slots.len() - self.used => {
                let first = self.used;
                self.used += count;
                Some((first, count))
            }
            _ => None,
        };
    }

    /// Keeps a slot of a model's answer; those of a model that is known stay as they are.
    pub fn keep(&mut self, model: usize, place: usize, slot: &ChunkSlot) {
        let entry = &self.entries[model];
        if let Some((first, count)) = entry.slots
            && entry.model.is_none()
            && place < count
        {
            self.slots[first + place] = *slot;
        }
    }

    /// A model is complete and valid.
    pub fn insert(&mut self, model: usize, known: Model) {
        let entry = &mut self.entries[model];
        self.known += usize::from(entry.model.is_none());
        entry.model = Some(known);
    }

    /// The kept answer of a model that is known; `None` when it found no room.
    #[must_use]
    pub fn slots(&self, model: usize) -> Option<&[ChunkSlot]> {
        let entry = &self.entries[model];
        entry.model?;
        let (first, count) = entry.slots?;
        Some(&self.slots[first..first + count])
    }

    /// The kept base mesh of a model: vertices in stored coordinates, and corners of faces. Not for
    /// a tick: it allocates.
    #[must_use]
    pub fn base_mesh(&self, model: usize) -> Option<(Vec<DVec3>, Vec<[u32; 3]>)> {
        let (header, slots) = (self.model(model)?.header, self.slots(model)?);
        let (vertices, faces) = slots.split_at(first_face_slot(&header));
        let vertices = vertices[MODEL_HEADER_SLOTS..].iter().flat_map(|slot| {
            let items: &[BaseVertex; 4] = bytemuck::cast_ref(&slot.words);
            items.map(|item| Vec3::from_array(item.position).as_dvec3())
        });
        let faces = faces.iter().flat_map(|slot| {
            let items: &[BaseFace; 2] = bytemuck::cast_ref(&slot.words);
            items.map(|item| item.corners)
        });
        let vertices = vertices.take(header.base_vertices as usize).collect();
        Some((vertices, faces.take(header.base_faces as usize).collect()))
    }
}
