//! What is known of the models of a scene: head and base mesh, once for all objects that have the same model.
//!
//! A base mesh is kept as it came, in the slots of its chunks, so that an object that wakes takes it in by the same
//! way as one whose model arrives. The slots are made at start; a base mesh that finds no room in them is asked for
//! anew whenever an object of it wakes.

use protocol::{ChunkSlot, MODEL_HEADER_SLOTS};
use spm::ModelHeader;

/// Bytes set aside for each model's base mesh: 900 faces; and the most, as a share of the cache.
const BYTES_PER_MODEL: usize = 36 << 10;
const MAX_SHARE: usize = 4;

/// A model that is known.
#[derive(Debug, Clone, Copy)]
pub struct Model {
    /// Its head.
    pub header: ModelHeader,
    /// The largest R of the base mesh: no full-mesh point is farther from the front, model units.
    pub radius_max: f64,
    /// Area of the base mesh, square model units.
    pub area: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Entry {
    model: Option<Model>,
    /// First of its slots and their number, once they are set aside.
    slots: Option<(usize, usize)>,
}

/// See the module.
#[derive(Debug)]
pub struct BaseMeshStore {
    shelves: Vec<Entry>,
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
    /// Bytes that base meshes take beside the awake objects: none where every object stays awake.
    #[must_use]
    pub fn bytes_for(models: usize, cache_bytes: usize, all_awake: bool) -> usize {
        if all_awake {
            return 0;
        }
        (models * BYTES_PER_MODEL).min(cache_bytes / MAX_SHARE)
    }

    /// Nothing is known of so many models; everything is allocated now.
    #[must_use]
    pub fn new(models: usize, bytes: usize) -> Self {
        Self {
            shelves: vec![Entry::default(); models],
            slots: vec![bytemuck::Zeroable::zeroed(); bytes / size_of::<ChunkSlot>()],
            used: 0,
            known: 0,
        }
    }

    /// A model, once it is known.
    #[must_use]
    pub fn model(&self, model: usize) -> Option<&Model> {
        self.shelves[model].model.as_ref()
    }

    /// The models that are known.
    pub fn models(&self) -> impl Iterator<Item = &Model> {
        self.shelves.iter().filter_map(|shelf| shelf.model.as_ref())
    }

    /// Whether every model is known.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.known == self.shelves.len()
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

    /// A model's answer begins: its slots are set aside if there is room.
    pub fn begin(&mut self, model: usize, header: &ModelHeader) {
        let count = model_slots(header);
        let shelf = &mut self.shelves[model];
        if shelf.slots.is_none() && count <= self.slots.len() - self.used {
            shelf.slots = Some((self.used, count));
            self.used += count;
        }
    }

    /// Keeps a slot of a model's answer.
    pub fn keep(&mut self, model: usize, place: usize, slot: &ChunkSlot) {
        if let Some((first, count)) = self.shelves[model].slots
            && place < count
        {
            self.slots[first + place] = *slot;
        }
    }

    /// A model is whole, and sound.
    pub fn learn(&mut self, model: usize, known: Model) {
        let shelf = &mut self.shelves[model];
        self.known += usize::from(shelf.model.is_none());
        shelf.model = Some(known);
    }

    /// The kept answer of a model that is known; `None` when it found no room.
    #[must_use]
    pub fn slots(&self, model: usize) -> Option<&[ChunkSlot]> {
        let shelf = &self.shelves[model];
        shelf.model?;
        let (first, count) = shelf.slots?;
        Some(&self.slots[first..first + count])
    }
}
