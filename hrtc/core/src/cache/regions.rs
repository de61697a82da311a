//! The regions that the controller knows, with the messages about them that the station is still to
//! get.

use super::id_map::IdMap;
use super::region::{AfterUnload, Region, RegionState};
use super::region_key::RegionKey;
use crate::tuning::cache::REFUSED_WINDOW;
use protocol::{CREDIT_CHUNKS, REGIONS_PER_REQUEST};
use spm::NONE;

/// Answers that may be outstanding, however far the station is: several share a chunk, and the
/// credit admits [`CREDIT_CHUNKS`].
pub const MAX_OUTSTANDING: u32 = 4 * CREDIT_CHUNKS as u32;
/// Releases that may wait for the next request: half of its capacity.
pub const MAX_RELEASES: usize = REGIONS_PER_REQUEST / 2;

/// Neighbours in an order, or its ends; [`NONE`] where there is none.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Links {
    earlier: u32,
    later: u32,
}

impl Links {
    const NONE: Self = Self {
        earlier: NONE,
        later: NONE,
    };
}

/// A table of fixed capacity. Its regions stand in one of two orders as well: that in which they
/// were last used, or that in which they are unloaded.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct RegionTable {
    /// Up to the last place that was ever in use, so that the room for the others is not written.
    regions: Vec<Option<Region>>,
    links: Vec<Links>,
    /// Used least, and most, recently.
    used: Links,
    /// Unloaded first, and last.
    unloading: Links,
    by_key: IdMap<RegionKey>,
    free: Vec<u32>,
    high_water: usize,
    /// Regions to be released.
    releases: [u32; MAX_RELEASES],
    release_count: usize,
    releases_high_water: usize,
    /// Regions to be requested again.
    #[serde(with = "serde_big_array::BigArray")]
    repeats: [u32; MAX_OUTSTANDING as usize],
    repeat_count: usize,
    /// Places gone through since the epoch began.
    settled: usize,
    /// Place where the search for old refusals goes on.
    next_refused: usize,
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
            regions: Vec::with_capacity(capacity),
            links: vec![Links::NONE; capacity],
            used: Links::NONE,
            unloading: Links::NONE,
            by_key: IdMap::new(capacity),
            free: (0..capacity as u32).rev().collect(),
            high_water: 0,
            releases: [0; MAX_RELEASES],
            release_count: 0,
            releases_high_water: 0,
            repeats: [0; MAX_OUTSTANDING as usize],
            repeat_count: 0,
            settled: capacity,
            next_refused: 0,
        }
    }

    /// Begins to forget every region: nothing about them is to be told any more.
    pub fn begin_clear(&mut self) {
        self.forget_messages();
        self.settled = self.capacity();
    }

    /// Goes on to forget every region, as many as the `entries` that may be gone through.
    pub fn go_on_clearing(&mut self, entries: &mut u32) {
        while *entries > 0
            && let Some(region) = self.first_unloading().or_else(|| self.oldest())
        {
            self.remove(region);
            *entries -= 1;
        }
    }

    /// Number of regions known.
    #[must_use]
    pub fn known(&self) -> usize {
        self.capacity() - self.free.len()
    }

    /// The most regions ever known at once.
    #[must_use]
    pub fn high_water(&self) -> usize {
        self.high_water
    }

    /// Whether less than a sixteenth of the places is free.
    #[must_use]
    pub fn is_nearly_full(&self) -> bool {
        self.free.len() < self.capacity() / 16
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

    /// Adds a region that is requested at this moment; `None` when the table is full.
    pub fn request(&mut self, key: RegionKey) -> Option<usize> {
        let index = self.free.pop()?;
        self.by_key.insert(key, index);
        let region = Some(Region::requested(key));
        // Places that were never in use come in their order.
        match self.regions.get_mut(index as usize) {
            Some(place) => *place = region,
            None => self.regions.push(region),
        }
        self.append(index);
        self.high_water = self.high_water.max(self.known());
        Some(index as usize)
    }

    /// The region that is unloaded first.
    #[must_use]
    pub fn first_unloading(&self) -> Option<usize> {
        (self.unloading.earlier != NONE).then_some(self.unloading.earlier as usize)
    }

    /// A region is to be unloaded, and then what is said.
    pub(super) fn begin_unload(&mut self, index: usize, then: AfterUnload, tick: u64) {
        self.unlink(index as u32);
        self.at_mut(index).begin_unload(then, tick);
        self.append(index as u32);
    }

    /// A region is unloaded. Returns false if what follows has to wait: the station cannot be told
    /// yet.
    pub(super) fn end_unload(&mut self, index: usize) -> bool {
        let then = self.at(index).after_unload();
        if then == AfterUnload::Release && !self.may_release() {
            return false;
        }
        if then == AfterUnload::Forget {
            self.remove(index);
            return true;
        }
        self.unlink(index as u32);
        match then {
            AfterUnload::Release => self.release(index),
            AfterUnload::RequestAgain => self.ask_again(index),
            AfterUnload::Refuse | AfterUnload::Reject | AfterUnload::Forget => {
                self.at_mut(index).refuse();
            }
        }
        self.append(index as u32);
        true
    }

    /// The epoch ends: see [`RegionTable::settle_epoch`].
    pub(super) fn end_epoch(&mut self) {
        self.forget_messages();
        self.settled = 0;
    }

    /// Goes on through the places of the table after the end of an epoch: what the station was to
    /// answer or to be told is forgotten. One of the `entries` pays for a place, here and where it
    /// is declared. Returns whether all places are gone through.
    pub(super) fn settle_epoch(&mut self, entries: &mut u32) -> bool {
        while self.settled < self.capacity() {
            if *entries == 0 {
                return false;
            }
            *entries -= 1;
            let place = self.settled;
            match self.get(place).map(Region::state) {
                Some(RegionState::ToRelease) => self.remove(place),
                Some(RegionState::Resident | RegionState::Refused) | None => {}
                Some(_) => self.begin_unload(place, AfterUnload::Forget, 0),
            }
            self.settled += 1;
        }
        true
    }

    /// Places gone through since the epoch began.
    #[must_use]
    pub fn settled(&self) -> usize {
        self.settled
    }

    /// Forgets one region that was refused so many ticks ago, so that it may be requested again.
    /// One that the station holds for subscribed is to be released before: what is under way of its
    /// answer is of no use, and it is not given anew to who only asks for it again.
    pub fn forget_old_refusal(&mut self, tick: u64, ticks: u64) {
        let capacity = self.capacity();
        for _ in 0..REFUSED_WINDOW.min(capacity) {
            let place = self.next_refused;
            self.next_refused = (place + 1) % capacity;
            let region = self.get(place);
            let Some(region) = region.filter(|region| region.is_refused_before(tick, ticks)) else {
                continue;
            };
            if region.after_unload() != AfterUnload::Reject {
                self.remove(place);
                break;
            }
            if self.may_release() {
                self.release(place);
                break;
            }
        }
    }

    /// Whether another release can be told.
    #[must_use]
    pub fn may_release(&self) -> bool {
        self.release_count < MAX_RELEASES
    }

    /// A region is unloaded: the station is to be told; only while [`RegionTable::may_release`].
    fn release(&mut self, index: usize) {
        self.at_mut(index).release();
        self.releases[self.release_count] = index as u32;
        self.release_count += 1;
        self.releases_high_water = self.releases_high_water.max(self.release_count);
    }

    /// Forgets every region to be released, and tells its name.
    pub fn drain_releases(&mut self, mut told: impl FnMut(RegionKey)) {
        for k in 0..self.release_count {
            let place = self.releases[k] as usize;
            told(self.at(place).key);
            self.remove(place);
        }
        self.release_count = 0;
    }

    /// A requested region is to be requested again with every record. Its answer stays outstanding,
    /// so there is room for it.
    fn ask_again(&mut self, index: usize) {
        self.at_mut(index).ask_again();
        if self.repeat_count < self.repeats.len() {
            self.repeats[self.repeat_count] = index as u32;
            self.repeat_count += 1;
        }
    }

    /// The name of a region that is requested again at this moment, with every record.
    pub fn request_again(&mut self) -> Option<RegionKey> {
        self.repeat_count = self.repeat_count.checked_sub(1)?;
        let region = self.at_mut(self.repeats[self.repeat_count] as usize);
        region.request_again();
        Some(region.key)
    }

    /// Forgets the messages that the station was still to get: the epoch ends.
    fn forget_messages(&mut self) {
        self.release_count = 0;
        self.repeat_count = 0;
    }

    /// Releases that waited to be told at once, at the most, and how many may.
    #[must_use]
    pub fn releases_high_water(&self) -> (usize, usize) {
        (self.releases_high_water, MAX_RELEASES)
    }

    /// Notes that a region is used at a tick: it is the last one then that should go.
    pub fn mark_used(&mut self, index: usize, tick: u64) {
        let region = self.at_mut(index);
        region.used_at = tick;
        if !region.is_unloading() {
            self.unlink(index as u32);
            self.append(index as u32);
        }
    }

    /// The region that was not used for longest.
    #[must_use]
    pub fn oldest(&self) -> Option<usize> {
        (self.used.earlier != NONE).then_some(self.used.earlier as usize)
    }

    /// The one that was used next after a known one.
    #[must_use]
    pub fn next_older(&self, index: usize) -> Option<usize> {
        let later = self.links[index].later;
        (later != NONE).then_some(later as usize)
    }

    /// The ends of the order that a known region stands in.
    fn ends_of(&mut self, index: u32) -> &mut Links {
        if self.at(index as usize).is_unloading() {
            &mut self.unloading
        } else {
            &mut self.used
        }
    }

    fn append(&mut self, index: u32) {
        let ends = self.ends_of(index);
        let last = std::mem::replace(&mut ends.later, index);
        if last == NONE {
            ends.earlier = index;
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
            self.ends_of(index).earlier = later;
        } else {
            self.links[earlier as usize].later = later;
        }
        if later == NONE {
            self.ends_of(index).later = earlier;
        } else {
            self.links[later as usize].earlier = earlier;
        }
    }

    /// Forgets a region.
    pub fn remove(&mut self, index: usize) {
        let Some(key) = self.get(index).map(|region| region.key) else {
            return;
        };
        self.by_key.remove(key);
        self.unlink(index as u32);
        self.regions[index] = None;
        self.free.push(index as u32);
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
        self.links.len()
    }

    /// The region at a place, if any.
    #[must_use]
    pub fn get(&self, place: usize) -> Option<&Region> {
        self.regions.get(place)?.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_that_were_never_used_are_not_written() {
        const PLACES: usize = 1000;
        let mut table = RegionTable::new(PLACES);
        let places = [0, 1, 2].map(|k| table.request(RegionKey::prefix(k)));
        assert_eq!(places, [0, 1, 2].map(Some));
        table.remove(1);
        let again = table.request(RegionKey::prefix(3));
        assert_eq!(again, Some(1), "a free one is used again");
        assert_eq!(table.regions.len(), 3);
        assert_eq!((table.known(), table.capacity()), (3, PLACES));
        assert!(table.get(PLACES - 1).is_none());
        // The end of an epoch goes through all places.
        table.end_epoch();
        let mut entries = PLACES as u32 + 1;
        assert!(table.settle_epoch(&mut entries));
        assert_eq!((entries, table.settled()), (1, PLACES));
    }
}
