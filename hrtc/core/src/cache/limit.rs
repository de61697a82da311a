//! The limit of the cache's bytes, which may be lowered and raised within what was allocated.
//!
//! Nothing is allocated or freed: the storage of the start stays, less of it is in use. While more
//! is in use than may be, nothing is loaded; records that nothing holds are evicted first, the
//! oldest first, then [`crate::lod::front::Front`] releases regions.

use super::id_map::IdMap;
use super::lists::ListPool;
use super::{Cache, References, RegionTable};
use ab_tree::AbTree;
use spm::{ActiveMesh, NONE, Slot};

impl Cache {
    /// Bytes of a loaded record beside the closures that name it.
    const BYTES_PER_RECORD: usize = ActiveMesh::BYTES_PER_SLOT
        + 2 * AbTree::BYTES_PER_FACE
        + size_of::<References>()
        + size_of::<Slot>()
        + IdMap::<u32>::BYTES_PER_ENTRY;

    /// So many bytes may be in use from now on; never more than there are.
    pub fn set_limit(&mut self, bytes: usize) {
        self.limit = bytes.min(self.bytes);
    }

    /// Bytes that may be in use now.
    #[must_use]
    pub fn limit(&self) -> usize {
        self.limit
    }

    /// Whether more is in use than may be.
    #[must_use]
    pub fn is_over_limit(&self) -> bool {
        self.is_limited() && self.in_use() > self.limit
    }

    /// Whether another region may be known.
    #[must_use]
    pub fn has_room_for_region(&mut self) -> bool {
        self.make_fit(RegionTable::BYTES_PER_REGION)
    }

    /// Evicts records that nothing holds while more is in use than may be: so many at the most.
    /// Returns how many.
    pub fn evict_excess(&mut self, most: u32) -> u32 {
        let before = self.evicted;
        while self.evicted - before < u64::from(most)
            && self.evictions.first != NONE
            && self.is_over_limit()
        {
            self.evict(self.evictions.first);
        }
        (self.evicted - before) as u32
    }

    /// Bytes of the base mesh and so many records, blocks of closures and regions.
    pub(super) fn counted(&self, loaded: u32, blocks: u32, regions: usize) -> usize {
        let sizes = self.sizes;
        sizes.base_vertices as usize * ActiveMesh::BYTES_PER_BASE_VERTEX
            + sizes.base_faces as usize * (ActiveMesh::BYTES_PER_BASE_FACE + AbTree::BYTES_PER_FACE)
            + loaded as usize * Self::BYTES_PER_RECORD
            + blocks as usize * ListPool::BYTES_PER_BLOCK
            + regions * RegionTable::BYTES_PER_REGION
    }

    fn is_limited(&self) -> bool {
        self.limit < self.bytes
    }

    /// Bytes in use; unlike [`Cache::bytes_used`] not capped at those that were allocated.
    pub(crate) fn in_use(&self) -> usize {
        self.counted(self.loaded, self.lists.used(), self.regions.known())
    }

    /// Whether so many more bytes, no more than a record takes, may be in use; a record that
    /// nothing holds goes for them.
    pub(super) fn make_fit(&mut self, more: usize) -> bool {
        if !self.fits(more) && self.fits(0) && self.evictions.first != NONE {
            self.evict(self.evictions.first);
        }
        self.fits(more)
    }

    fn fits(&self, more: usize) -> bool {
        !self.is_limited() || self.in_use() + more <= self.limit
    }

    /// Slots that a record could go to now; negative where records have to go.
    pub(super) fn headroom(&self) -> i64 {
        let free = i64::from(self.free_slots());
        if !self.is_limited() {
            return free;
        }
        let left = self.limit as i64 - self.in_use() as i64;
        free.min(left.div_euclid(Self::BYTES_PER_RECORD as i64))
    }
}
