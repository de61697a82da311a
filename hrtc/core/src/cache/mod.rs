//! The cache: base mesh, loaded front, refined front and their tree in a fixed number of bytes.
//!
//! | part | bytes a VSP | what |
//! |---|---|---|
//! | active mesh | 132 | record in handles, two vertices, two faces |
//! | AB-tree | 146 | two faces: a node of 64 bytes and links each |
//! | references | 16 | held, wanted, dependents, queue links |
//! | ids | 16 to 32 | open addressing, at most half full |
//! | closures | 26 | six list entries a VSP |
//! | regions | 11 | one region for 16 VSPs |
//!
//! Base vertices and faces live at the head of the same arrays. Reference counts say what may go:
//! *held* counts the regions whose closure a record belongs to, *wanted* those of them that are to
//! be performed. A performed VSP with no wanted region and no performed dependent waits in the
//! queue of collapses, a record with no holder and no loaded dependent in the queue of evictions;
//! both queues are in order of arrival. Nothing that a wanted region needs is in either.

mod base_mesh;
pub mod base_mesh_store;
mod check;
mod geomorphs;
mod id_map;
mod limit;
mod lists;
mod operations;
mod queues;
mod region;
mod region_key;
mod regions;
mod unload;

pub use geomorphs::MAX_GEOMORPHS;
pub use lists::{Cursor, List};
pub use operations::NextBehind;
pub use region::{AfterUnload, Region, RegionState};
pub use region_key::RegionKey;
pub use regions::{MAX_OUTSTANDING, RegionTable};

use ab_tree::AbTree;
use id_map::IdMap;
use lists::ListPool;
use mutants::{Mutant, is};
use spm::{ActiveMesh, Certified, ErrorScale, NONE, Sizes, Slot, VspRecord};
use spm::{ModelHeader, QuarteredFace};
use thiserror::Error;

/// Marks a closure entry whose record has not come yet: the rest is the VSP's id.
const PENDING: u32 = 1 << 31;
/// Closure entries that the pool holds for each slot.
const ENTRIES_PER_SLOT: usize = 6;
/// Slots for each region of the table.
const SLOTS_PER_REGION: usize = 16;

/// The most that was ever in use, and what there is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CacheHighWater {
    /// Splits loaded.
    pub splits: (usize, usize),
    /// Blocks of closure lists.
    pub blocks: (usize, usize),
    /// Regions known.
    pub regions: (usize, usize),
    /// Faces of the refined front, each with a place in the tree.
    pub faces: (usize, usize),
}

/// The cache cannot hold what it must.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error, serde::Serialize, serde::Deserialize)]
pub enum CacheError {
    /// The base mesh and one closure need more than there is.
    #[error(
        "the cache of {bytes} bytes is too small for the model's base mesh ({base_faces} faces) and its largest closure: set cache.bytes to at least {needed}"
    )]
    TooSmall {
        /// What there is.
        bytes: usize,
        /// What is needed.
        needed: usize,
        /// Faces of the base mesh.
        base_faces: u32,
    },
}

/// Records that one stands on, at the most: its vertex's and those of four faces.
const MAX_DEPENDENCIES: u16 = 5;

/// Why a record was not loaded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoadError {
    /// No slot is free and none may be evicted.
    NoRoom,
    /// It is not the record that the closure says comes next, or a dependency is missing.
    Gap,
    /// It cannot belong to this model.
    Damaged,
    /// More loaded entries lie before it than may be gone through now: load it again later.
    Unfinished,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
enum Queue {
    #[default]
    None,
    Collapses,
    Evictions,
}

#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
struct References {
    held: u16,
    wanted: u16,
    loaded_dependents: u16,
    queue: Queue,
    /// Whether its vertices are on their way to their parent: it waits for no collapse then.
    leaving: bool,
    previous: u32,
    next: u32,
}

#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Ends {
    first: u32,
    last: u32,
    count: u32,
}

/// See the module.
#[derive(Debug, serde::Serialize, serde::Deserialize)]
pub struct Cache {
    bytes: usize,
    /// Bytes that may be in use now; as many as there are unless it was lowered.
    limit: usize,
    mesh: ActiveMesh,
    tree: AbTree,
    ids: IdMap<u32>,
    /// Those of the slots that were ever in use, so that the room for the others is not written.
    references: Vec<References>,
    free: Vec<Slot>,
    collapses: Ends,
    evictions: Ends,
    lists: ListPool,
    /// The regions.
    pub regions: RegionTable,
    sizes: Sizes,
    /// Faces of the model whose quarters have bounds.
    quartered: u32,
    scale: ErrorScale,
    loaded: u32,
    loaded_high_water: u32,
    faces_high_water: u32,
    slots: u32,
    /// Slots, and faces of the front, that a model had at the most: marks stay when it goes.
    most_slots: u32,
    most_faces: u32,
    /// Slots that were ever in use for this model, from the first on; `free` holds those of them
    /// that came back.
    slots_used: u32,
    /// Records that may be on their way from a station far away.
    in_transit: u32,
    evicted: u64,
    is_clearing: bool,
}

const NO_MODEL: Sizes = Sizes {
    base_vertices: 0,
    base_faces: 0,
    vsps: 0,
    faces: 0,
};

const EMPTY_QUEUE: Ends = Ends {
    first: NONE,
    last: NONE,
    count: 0,
};

impl Cache {
    fn bytes_for(slots: usize) -> usize {
        let regions = Self::regions_for(slots);
        slots
            * (ActiveMesh::BYTES_PER_SLOT
                + 2 * AbTree::BYTES_PER_FACE
                + size_of::<References>()
                + size_of::<Slot>())
            + (2 * slots.max(1)).next_power_of_two() * (IdMap::<u32>::BYTES_PER_ENTRY / 4)
            + Self::blocks_for(slots) * ListPool::BYTES_PER_BLOCK
            + regions * RegionTable::BYTES_PER_REGION
    }

    fn blocks_for(slots: usize) -> usize {
        // A list's last block is half full on average.
        slots * ENTRIES_PER_SLOT / ListPool::ITEMS_PER_BLOCK + Self::regions_for(slots) / 2
    }

    fn regions_for(slots: usize) -> usize {
        (slots / SLOTS_PER_REGION).clamp(64, 4096)
    }

    /// Least bytes of a cache that takes a model: room for its base mesh and its largest closure.
    #[must_use]
    pub fn least_bytes(model: &ModelHeader) -> usize {
        let base = model.base_faces.max(model.base_vertices);
        Self::bytes_for(base.div_ceil(2) as usize + model.closure_max as usize + 1)
    }

    /// Everything allocated now, at most `bytes` (the scene's `cache.bytes`). Unless the process
    /// has locked its memory, what is kept for each slot takes memory as it is used, but for ids,
    /// whose places are all over their table, and states.
    #[must_use]
    pub fn new(bytes: usize) -> Self {
        let (mut least, mut most) = (0, bytes / 64);
        while least < most {
            let middle = (least + most).div_ceil(2);
            if Self::bytes_for(middle) <= bytes {
                least = middle;
            } else {
                most = middle - 1;
            }
        }
        let slots = least;
        Self {
            bytes,
            limit: bytes,
            mesh: ActiveMesh::new(0, 0, slots as u32)
                .with_geomorphs(MAX_GEOMORPHS)
                .with_quarters(QuarteredFace::MAX as usize),
            tree: AbTree::new(2 * slots as u32),
            ids: IdMap::new(slots),
            references: Vec::with_capacity(slots),
            free: Vec::with_capacity(slots),
            collapses: EMPTY_QUEUE,
            evictions: EMPTY_QUEUE,
            lists: ListPool::new(Self::blocks_for(slots)),
            regions: RegionTable::new(Self::regions_for(slots)),
            sizes: NO_MODEL,
            quartered: 0,
            scale: ErrorScale::for_diagonal(1.0),
            loaded: 0,
            loaded_high_water: 0,
            faces_high_water: 0,
            slots: 0,
            most_slots: 0,
            most_faces: 0,
            slots_used: 0,
            in_transit: 0,
            evicted: 0,
            is_clearing: false,
        }
    }

    /// The active mesh of the refined front.
    #[must_use]
    pub fn mesh(&self) -> &ActiveMesh {
        &self.mesh
    }

    /// Its AB-tree.
    #[must_use]
    pub fn tree(&self) -> &AbTree {
        &self.tree
    }

    /// VSPs loaded now.
    #[must_use]
    pub fn loaded(&self) -> u32 {
        self.loaded
    }

    /// VSPs that fit beside the base mesh.
    #[must_use]
    pub fn slots(&self) -> u32 {
        self.slots
    }

    /// Records evicted so far.
    #[must_use]
    pub fn evicted(&self) -> u64 {
        self.evicted
    }

    /// Bytes that there are: all that the limit may be.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// Bytes in use by the base mesh, loaded records, closures and regions.
    #[must_use]
    pub fn bytes_used(&self) -> usize {
        self.in_use().min(self.bytes)
    }

    /// The most that was ever in use of each part, and how many of it a model had at the most.
    #[must_use]
    pub fn high_water(&self) -> CacheHighWater {
        CacheHighWater {
            splits: (self.loaded_high_water as usize, self.most_slots as usize),
            blocks: (self.lists.high_water() as usize, self.lists.capacity()),
            regions: (self.regions.high_water(), self.regions.capacity()),
            faces: (self.faces_high_water as usize, self.most_faces as usize),
        }
    }

    // --- the base mesh -------------------------------------------------------------------------

    /// Begins to forget the model and everything of it: no face is active any more.
    /// [`Cache::go_on_unloading`] does the rest. Counts and high-water marks stay; nothing is freed
    /// or allocated.
    pub fn begin_clear(&mut self) {
        self.is_clearing = true;
        self.mesh.begin_clear();
        self.tree.begin_clear();
        self.free.clear();
        self.collapses = EMPTY_QUEUE;
        self.evictions = EMPTY_QUEUE;
        self.loaded = 0;
        self.slots = 0;
        self.regions.begin_clear();
    }

    /// Whether a model is being forgotten: [`Cache::begin_model`] has to wait.
    #[must_use]
    pub fn is_clearing(&self) -> bool {
        self.is_clearing
    }

    /// Goes on to forget the model after [`Cache::begin_clear`]: regions, slots, then base faces,
    /// of which two count as one of the `entries` that may be gone through.
    fn go_on_clearing(&mut self, entries: &mut u32) {
        self.regions.go_on_clearing(entries);
        // Slots are handed out from the first on, and again when they come back.
        let count = self.slots_used.min(*entries);
        let slots = self.slots_used - count..self.slots_used;
        for slot in slots.clone() {
            let id = self.mesh.id(slot);
            if self.ids.get(id) == Some(slot) {
                self.ids.remove(id);
            }
        }
        self.tree.forget_faces(self.mesh.forget_slots(slots));
        self.slots_used -= count;
        *entries -= count;
        let count = self.sizes.base_faces.div_ceil(2).min(*entries);
        let left = self.sizes.base_faces.saturating_sub(2 * count);
        let faces = left..self.sizes.base_faces;
        self.mesh.forget_base_faces(faces.clone());
        self.tree.forget_faces(faces);
        self.sizes.base_faces = left;
        *entries -= count;
        if self.slots_used == 0 && left == 0 && self.regions.known() == 0 {
            self.lists.clear();
            self.sizes = NO_MODEL;
            self.quartered = 0;
            self.is_clearing = false;
        }
    }

    // --- closures and records --------------------------------------------------------------------

    /// Adds a VSP to the closure of an asked region and holds it when it is loaded already.
    /// `record_follows`: whether its record is to come in the same answer.
    ///
    /// # Errors
    /// `NoRoom` when the lists are full, `Damaged` for ids out of range, `Gap` when the record is
    /// neither here nor to come.
    pub fn add_to_closure(
        &mut self,
        region: usize,
        id: u32,
        record_follows: bool,
    ) -> Result<(), LoadError> {
        if id >= self.sizes.vsps {
            return Err(LoadError::Damaged);
        }
        let length = self.regions.at(region).closure.length() as usize;
        if length.is_multiple_of(ListPool::ITEMS_PER_BLOCK)
            && !self.make_fit(ListPool::BYTES_PER_BLOCK)
        {
            return Err(LoadError::NoRoom);
        }
        let known = self.ids.get(id);
        if known.is_none() && !record_follows {
            return Err(LoadError::Gap);
        }
        // A sound station names it once a region, and there are fewer of those.
        if known.is_some_and(|slot| self.references[slot as usize].held == u16::MAX) {
            return Err(LoadError::Damaged);
        }
        let mut list = self.regions.at(region).closure;
        if !self.lists.push(&mut list, known.unwrap_or(id | PENDING)) {
            return Err(LoadError::NoRoom);
        }
        let entry = self.regions.at_mut(region);
        // Where the first record to come belongs: no run of loaded ones is gone through for it.
        if known.is_none() && entry.pending == 0 {
            entry.cursor = ListPool::last(&list);
        }
        entry.closure = list;
        match known {
            Some(slot) => {
                let held = &mut self.references[slot as usize].held;
                *held += u16::from(!is(Mutant::Reference));
                if *held == 1 {
                    self.requeue(slot);
                }
            }
            None => entry.pending += 1,
        }
        Ok(())
    }

    /// Loads the next record that an asked region waits for. `entries`: loaded entries of its
    /// closure that may be gone through on the way to it.
    ///
    /// # Errors
    /// See [`LoadError`]; nothing has changed then, but that a record which nothing holds may be
    /// gone.
    pub fn load(
        &mut self,
        region: usize,
        record: &VspRecord,
        entries: &mut u32,
    ) -> Result<(), LoadError> {
        if record.i >= self.sizes.vsps {
            return Err(LoadError::Damaged);
        }
        // The station counts what was asked for and released; what was released and not yet evicted
        // is still here, and comes again.
        if self.ids.get(record.i).is_some() {
            return Ok(());
        }
        let expected = self.next_pending(region, entries)?;
        let cursor = self.regions.at(region).cursor;
        if record.i != expected {
            return Err(LoadError::Gap);
        }
        if record.validate(expected, self.sizes).is_err() {
            return Err(LoadError::Damaged);
        }
        let slot = self.take_slot().ok_or(LoadError::NoRoom)?;
        if let Err(error) = self.put(slot, record) {
            self.give_back(slot);
            return Err(error);
        }
        self.ids.insert(expected, slot);
        self.begin_references(slot);
        for dependency in self.mesh.dependencies(slot) {
            self.references[dependency as usize].loaded_dependents += 1;
        }
        self.loaded += 1;
        self.loaded_high_water = self.loaded_high_water.max(self.loaded);
        self.lists.set(cursor, slot);
        let entry = self.regions.at_mut(region);
        entry.cursor = self.lists.next(cursor);
        entry.pending -= 1;
        Ok(())
    }

    /// Puts a sound record into a slot. What it stands on is looked up only now: to have the slot,
    /// a record may have been evicted.
    fn put(&mut self, slot: Slot, record: &VspRecord) -> Result<(), LoadError> {
        let (base_vertices, base_faces) = (self.sizes.base_vertices, self.sizes.base_faces);
        let handle = |id: u32, base: u32| -> Result<u32, LoadError> {
            match id.checked_sub(base) {
                _ if id == NONE => Ok(NONE),
                None => Ok(id),
                Some(made) => match self.ids.get(made / 2) {
                    Some(slot) => Ok(base + 2 * slot + made % 2),
                    None => Err(LoadError::Gap),
                },
            }
        };
        let vs = handle(record.vs, base_vertices)?;
        let mut fn_ = [NONE; 4];
        for (place, &face) in fn_.iter_mut().zip(&record.fn_) {
            *place = handle(face, base_faces)?;
        }
        let mut certified = self.scale.certified(record);
        if is(Mutant::Certified) {
            certified = [Certified::EXACT; 2];
        }
        self.mesh.load(slot, record, vs, fn_, certified);
        // Of a sound model some tens stand on one.
        let most = u16::MAX - MAX_DEPENDENCIES;
        let stand_on = |of: Slot| self.references[of as usize].loaded_dependents;
        if self.mesh.dependencies(slot).any(|of| stand_on(of) > most) {
            self.mesh.unload(slot);
            return Err(LoadError::Damaged);
        }
        Ok(())
    }

    /// The id of the next record that an asked region waits for; its cursor is there then. Entries
    /// that were loaded already lie between the pending ones.
    fn next_pending(&mut self, region: usize, entries: &mut u32) -> Result<u32, LoadError> {
        let entry = self.regions.at_mut(region);
        loop {
            match self.lists.get(&entry.closure, entry.cursor) {
                Some(item) if item & PENDING != 0 => return Ok(item & !PENDING),
                Some(_) if *entries == 0 => return Err(LoadError::Unfinished),
                Some(_) => {
                    *entries -= 1;
                    entry.cursor = self.lists.next(entry.cursor);
                }
                None => return Err(LoadError::Gap),
            }
        }
    }

    /// Puts a held region into the set to be performed, or takes it out: at most `most` entries of
    /// its closure, the rest when it is called again. A change that has begun is finished before
    /// another begins.
    ///
    /// Returns the number of entries gone through.
    pub fn set_wanted(&mut self, region: usize, wanted: bool, most: u32) -> u32 {
        let entry = self.regions.at_mut(region);
        if entry.changing == 0 {
            if entry.wanted == wanted {
                return 0;
            }
            entry.want(wanted);
        }
        let entry = *entry;
        let mut cursor = entry.cursor;
        let mut to_split = 0;
        let count = most.min(entry.changing);
        for _ in 0..count {
            if let Some(slot) = self.lists.get(&entry.closure, cursor)
                && slot & PENDING == 0
            {
                to_split += u32::from(!self.mesh.is_performed(slot));
                let references = &mut self.references[slot as usize];
                // Most of a closure is wanted by its neighbours too: only the first and the last
                // count.
                let turns = if entry.wanted {
                    references.wanted += 1;
                    references.wanted == 1
                } else {
                    references.wanted -= 1;
                    references.wanted == 0
                };
                if turns {
                    self.requeue(slot);
                }
            }
            cursor = self.lists.next(cursor);
        }
        let entry = self.regions.at_mut(region);
        entry.changing -= count;
        entry.cursor = cursor;
        if entry.wanted {
            entry.to_split += to_split;
        }
        if entry.changing == 0 {
            entry.cursor = Cursor::start(&entry.closure);
        }
        count
    }
}

#[cfg(test)]
mod tests;
