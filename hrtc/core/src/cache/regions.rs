//! The regions that the controller knows: asked for, held, wanted.

use super::id_map::{Id, IdMap};
use super::lists::{Cursor, List};
use spm::{NONE, RegionId};

/// What names a region: a cell in the grid of its tolerance's level, or one of the special ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct RegionKey {
    /// The cell, or [`RegionId::WHOLE`] or [`RegionId::PREFIX`].
    pub id: RegionId,
    /// Bits of the tolerance, model units; of a prefix its count.
    pub tolerance_bits: u32,
}

impl RegionKey {
    /// The region of a cell at a tolerance, model units.
    #[must_use]
    pub fn new(id: RegionId, tolerance: f32) -> Self {
        Self {
            id,
            tolerance_bits: tolerance.to_bits(),
        }
    }

    /// The first `count` splits of the sequence.
    #[must_use]
    pub fn prefix(count: u32) -> Self {
        Self {
            id: RegionId::PREFIX,
            tolerance_bits: count,
        }
    }

    /// Its tolerance, model units; `None` for a prefix.
    #[must_use]
    pub fn tolerance(self) -> Option<f32> {
        (self.id != RegionId::PREFIX).then(|| f32::from_bits(self.tolerance_bits))
    }
}

impl Id for RegionKey {
    const NONE: Self = Self {
        id: RegionId(u32::MAX),
        tolerance_bits: u32::MAX,
    };

    fn bits(self) -> u64 {
        u64::from(self.tolerance_bits) << 32 | u64::from(self.id.0)
    }
}

/// What has become of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RegionState {
    /// Asked for; its closure or records are under way.
    Asked,
    /// Its closure is loaded.
    Held,
    /// Being dropped, a stretch of its closure at a time.
    Leaving,
    /// Dropped here; the station is still to be told.
    ToRelease,
    /// Its answer counted on records that are not here any more: to be asked for with every record.
    ToAskAgain,
    /// Refused by the station, or its records do not fit the mesh: not asked for again for a while.
    Refused,
}

/// A region in the table.
#[derive(Debug, Clone, Copy)]
pub struct Region {
    /// Which one.
    pub key: RegionKey,
    /// What has become of it.
    pub state: RegionState,
    /// Whether its closure is to be performed (it is in set B of thesis Figure 5.17).
    pub wanted: bool,
    /// Entries of its closure that a change of `wanted`, or its leaving, has still to go through.
    pub changing: u32,
    /// Whether all of it is performed; while wanted.
    pub refined: bool,
    /// Whether the answer that is under way has begun; while asked for.
    pub answer_begun: bool,
    /// Tick when it was refused; while refused.
    pub refused_at: u64,
    /// Its closure: slots, or ids of records that are still to come.
    pub closure: List,
    /// Records still to come.
    pub pending: u32,
    /// Next record to come, or next split to perform.
    pub cursor: Cursor,
    /// Tick when it was last in the loaded set of the prediction.
    pub touched: u64,
    /// Tick when it was last in the refined set of the prediction.
    pub needed: u64,
    /// Tick at which the contact was expected there when it was last predicted.
    pub due: u64,
    /// Splits that were still to do when it came into the set to be performed, less those done for it since:
    /// no fewer are left.
    pub to_split: u32,
}

/// Neighbours in the order of use.
#[derive(Debug, Clone, Copy)]
struct Links {
    earlier: u32,
    later: u32,
}

/// A table of fixed capacity, whose regions stand in the order in which they were last used as well.
#[derive(Debug, Clone)]
pub struct RegionTable {
    regions: Vec<Option<Region>>,
    links: Vec<Links>,
    /// Used least, and most, recently; [`NONE`] in an empty table.
    ends: Links,
    by_key: IdMap<RegionKey>,
    free: Vec<u32>,
    high_water: usize,
}

impl RegionTable {
    /// Bytes for each region that it may hold.
    pub const BYTES_PER_REGION: usize = size_of::<Option<Region>>()
        + size_of::<Links>()
        + size_of::<u32>()
        + IdMap::<RegionKey>::BYTES_PER_ENTRY;

    /// Room for `capacity` regions.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        Self {
            regions: vec![None; capacity],
            links: vec![
                Links {
                    earlier: NONE,
                    later: NONE
                };
                capacity
            ],
            ends: Links {
                earlier: NONE,
                later: NONE,
            },
            by_key: IdMap::new(capacity),
            free: (0..capacity as u32).rev().collect(),
            high_water: 0,
        }
    }

    /// Forgets every region.
    pub fn clear(&mut self) {
        self.regions.fill(None);
        self.ends = Links {
            earlier: NONE,
            later: NONE,
        };
        self.by_key.clear();
        self.free.clear();
        self.free.extend((0..self.regions.len() as u32).rev());
    }

    /// Number of regions known.
    #[must_use]
    pub fn known(&self) -> usize {
        self.regions.len() - self.free.len()
    }

    /// The most regions ever known at once.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Whether less than a sixteenth of the places is free.
    #[must_use]
    pub fn is_nearly_full(&self) -> bool {
        self.free.len() < self.regions.len() / 16
    }

    /// Index of a region.
    #[must_use]
    pub fn index(&self, key: RegionKey) -> Option<usize> {
        self.by_key.get(key).map(|k| k as usize)
    }

    /// The region at an index that [`RegionTable::index`] gave.
    #[must_use]
    pub fn at(&self, index: usize) -> &Region {
        match &self.regions[index] {
            Some(region) => region,
            None => unreachable!("indices are of known regions"),
        }
    }

    /// The region at an index, to change.
    pub fn at_mut(&mut self, index: usize) -> &mut Region {
        match &mut self.regions[index] {
            Some(region) => region,
            None => unreachable!("indices are of known regions"),
        }
    }

    /// Adds a region that is asked for; `None` when the table is full.
    pub fn add(&mut self, key: RegionKey) -> Option<usize> {
        let index = self.free.pop()?;
        self.by_key.insert(key, index);
        self.regions[index as usize] = Some(Region {
            key,
            state: RegionState::Asked,
            wanted: false,
            changing: 0,
            refined: false,
            answer_begun: false,
            refused_at: 0,
            closure: List::EMPTY,
            pending: 0,
            cursor: Cursor::start(&List::EMPTY),
            touched: 0,
            needed: 0,
            due: 0,
            to_split: 0,
        });
        self.append(index);
        self.high_water = self.high_water.max(self.known());
        Some(index as usize)
    }

    /// Notes that a region is used at a tick: it is the last one then that should go.
    pub fn touch(&mut self, index: usize, tick: u64) {
        self.at_mut(index).touched = tick;
        self.unlink(index as u32);
        self.append(index as u32);
    }

    /// The region that was not used for longest.
    #[must_use]
    pub fn oldest(&self) -> Option<usize> {
        (self.ends.earlier != NONE).then_some(self.ends.earlier as usize)
    }

    /// The one that was used next after a known one.
    #[must_use]
    pub fn next_older(&self, index: usize) -> Option<usize> {
        let later = self.links[index].later;
        (later != NONE).then_some(later as usize)
    }

    fn append(&mut self, index: u32) {
        let last = std::mem::replace(&mut self.ends.later, index);
        if last == NONE {
            self.ends.earlier = index;
        } else {
            self.links[last as usize].later = index;
        }
        self.links[index as usize] = Links {
            earlier: last,
            later: NONE,
        };
    }

    fn unlink(&mut self, index: u32) {
        let Links { earlier, later } = self.links[index as usize];
        if earlier == NONE {
            self.ends.earlier = later;
        } else {
            self.links[earlier as usize].later = later;
        }
        if later == NONE {
            self.ends.later = earlier;
        } else {
            self.links[later as usize].earlier = earlier;
        }
    }

    /// Forgets a region.
    pub fn remove(&mut self, index: usize) {
        if let Some(region) = self.regions[index].take() {
            self.by_key.remove(region.key);
            self.unlink(index as u32);
            self.free.push(index as u32);
        }
    }

    /// Indices of all regions, ascending.
    pub fn indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.regions
            .iter()
            .enumerate()
            .filter_map(|(k, region)| region.is_some().then_some(k))
    }

    /// Places in the table.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.regions.len()
    }

    /// The region at a place, if any.
    #[must_use]
    pub fn get(&self, place: usize) -> Option<&Region> {
        self.regions[place].as_ref()
    }
}
