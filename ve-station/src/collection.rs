//! Mesh collection (thesis 5.3.2.2): which VSPs a region needs, and which of them a client already holds.
//!
//! The thesis walks the adjacency of every split recursively and remembers the VSPs already sent. With the
//! dependencies of a record implicit in its ids, the same set is a plain graph search from the seeds of the
//! region, and "already sent" is a count of the held regions that contain the VSP: so a release, an eviction
//! or a new start of either side needs no geometry.

use shared::protocol::Refusal;
use shared::spm::{FileError, RegionId, SpmFile};
use std::collections::BTreeSet;
use thiserror::Error;

/// Why a region has no closure.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CollectError {
    /// The grid of the model has no such cell.
    #[error("the model has no region {:?}", .0.cell().to_array())]
    UnknownRegion(RegionId),
    /// A part of the file that the region needs is damaged.
    #[error("region {:?} cannot be served: {error}", .region.cell().to_array())]
    Damaged {
        /// The region.
        region: RegionId,
        /// What is damaged.
        error: FileError,
    },
}

impl CollectError {
    /// What the client is told.
    #[must_use]
    pub fn refusal(&self) -> Refusal {
        match self {
            Self::UnknownRegion(_) => Refusal::UnknownRegion,
            Self::Damaged { .. } => Refusal::DamagedBlock,
        }
    }
}

/// Finds closures. One per model; holds 4 bytes a VSP so that a search touches only what it visits.
#[derive(Debug)]
pub struct Collection {
    /// The search that last visited each VSP; [n].
    stamps: Vec<u32>,
    /// The current search; 0 is none.
    stamp: u32,
}

impl Collection {
    /// For a model with so many VSPs.
    #[must_use]
    pub fn new(vsps: u32) -> Self {
        Self {
            stamps: vec![0; vsps as usize],
            stamp: 0,
        }
    }

    /// The closure of a region at tolerance 0: the smallest front that makes every face that it owns,
    /// ascending. Empty for a cell without faces.
    ///
    /// # Errors
    /// When the grid has no such cell, or a block that the search needs is damaged.
    pub fn closure<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        region: RegionId,
    ) -> Result<Vec<u32>, CollectError> {
        let header = file.model_header();
        if !header.grid.contains(region) {
            return Err(CollectError::UnknownRegion(region));
        }
        let damaged = |error| CollectError::Damaged { region, error };
        let Some(seeds) = file.seeds(region).map_err(damaged)? else {
            return Ok(Vec::new());
        };
        let stamp = self.next_stamp();
        let mut closure = Vec::with_capacity(2 * seeds.len());
        for &seed in seeds {
            self.visit(seed, stamp, &mut closure);
        }
        // `closure` is the queue of the search as well: what lies before `next` has its dependencies in it.
        let mut next = 0;
        while let Some(&i) = closure.get(next) {
            next += 1;
            let record = file.record(i).map_err(damaged)?;
            for dependency in record.dependencies(header.sizes()) {
                self.visit(dependency, stamp, &mut closure);
            }
        }
        closure.sort_unstable();
        Ok(closure)
    }

    fn visit(&mut self, i: u32, stamp: u32, closure: &mut Vec<u32>) {
        if let Some(seen) = self.stamps.get_mut(i as usize)
            && *seen != stamp
        {
            *seen = stamp;
            closure.push(i);
        }
    }

    fn next_stamp(&mut self) -> u32 {
        if self.stamp == u32::MAX {
            self.stamps.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
        self.stamp
    }
}

/// What one client holds of one model.
#[derive(Debug, Default)]
pub struct Residency {
    /// Held regions that contain each VSP; [n], or empty before the first region.
    counts: Vec<u32>,
    /// Held regions with a closure that is not empty.
    regions: BTreeSet<RegionId>,
}

impl Residency {
    /// Takes a region in and answers the VSPs that no region held before, ascending like `closure`.
    ///
    /// A region that is held already changes nothing and lacks nothing.
    pub fn insert(&mut self, region: RegionId, closure: &[u32], vsps: u32) -> Vec<u32> {
        if closure.is_empty() || !self.regions.insert(region) {
            return Vec::new();
        }
        self.counts.resize(vsps as usize, 0);
        let mut lacking = Vec::new();
        for &i in closure {
            let count = &mut self.counts[i as usize];
            if *count == 0 {
                lacking.push(i);
            }
            *count += 1;
        }
        lacking
    }

    /// Whether the region is held.
    #[must_use]
    pub fn holds(&self, region: RegionId) -> bool {
        self.regions.contains(&region)
    }

    /// Gives a region up; nothing happens when it is not held.
    pub fn remove(&mut self, region: RegionId, closure: &[u32]) {
        if self.regions.remove(&region) {
            for &i in closure {
                self.counts[i as usize] -= 1;
            }
        }
    }
}

#[cfg(test)]
mod tests;
