//! Mesh collection (thesis 5.3.2.2): which VSPs a region needs, and which of them a client already
//! holds.
//!
//! The thesis walks the adjacency of every split recursively and remembers the VSPs already sent.
//! With the dependencies of a record implicit in its ids, the same set is a plain graph search from
//! the seeds of the region, and "already sent" is a count of the held regions that contain the VSP:
//! so a release, an eviction or a new start of either side needs no geometry.
//!
//! The seeds at tolerance 0 are those of the file's index: they make every face of the full mesh
//! that the region owns. At a tolerance t they are the VSPs whose expected error exceeds t and
//! whose reach meets the cell grown by 2 t (contact points slide that far along coarse faces),
//! found from the base mesh down.

use glam::DVec3;
use protocol::Refusal;
use spm::ModelHeader;
use spm::{BoundsScale, ErrorScale, FileError, NONE, RegionId, Section, SpmFile, VspRecord};
use std::collections::BTreeSet;
use std::fmt;
use thiserror::Error;

/// What a client asks for and holds: a region at a tolerance, as on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct RegionAt {
    /// A cell of the grid of the tolerance's level, [`RegionId::WHOLE`] or [`RegionId::PREFIX`].
    pub region: RegionId,
    /// Bits of the f32 tolerance, model units; of a prefix the number of its VSPs.
    pub tolerance_bits: u32,
}

impl RegionAt {
    /// A region of the full mesh.
    #[must_use]
    pub fn full(region: RegionId) -> Self {
        Self {
            region,
            tolerance_bits: 0,
        }
    }

    /// A region at a tolerance, model units.
    #[must_use]
    pub fn tolerance(region: RegionId, tolerance: f32) -> Self {
        Self {
            region,
            tolerance_bits: tolerance.to_bits(),
        }
    }
}

impl fmt::Display for RegionAt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tolerance = f32::from_bits(self.tolerance_bits);
        match self.region {
            RegionId::PREFIX => write!(f, "the prefix of {} VSPs", self.tolerance_bits),
            RegionId::WHOLE => write!(f, "the whole model at tolerance {tolerance}"),
            cell => write!(
                f,
                "the region {:?} at tolerance {tolerance}",
                cell.cell().to_array()
            ),
        }
    }
}

/// Why a region has no closure.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum CollectError {
    /// The grid of the tolerance's level has no such cell.
    #[error("the model does not have {0}")]
    UnknownRegion(RegionAt),
    /// No number, negative or infinite.
    #[error("{0} is asked for: a tolerance is a number from 0 up")]
    Tolerance(RegionAt),
    /// A part of the file that the region needs is damaged.
    #[error("{asked} cannot be served: {error}")]
    Damaged {
        /// The region.
        asked: RegionAt,
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
            Self::Tolerance(_) => Refusal::Tolerance,
            Self::Damaged { .. } => Refusal::DamagedBlock,
        }
    }

    /// What was asked for.
    #[must_use]
    pub fn asked(&self) -> RegionAt {
        let (Self::UnknownRegion(asked) | Self::Tolerance(asked) | Self::Damaged { asked, .. }) =
            self;
        *asked
    }
}

/// Which VSPs a search takes from the hierarchy.
struct Wanted {
    /// The largest code of an expected error that does not exceed the tolerance.
    floor: u16,
    reach: BoundsScale,
    /// The grown cell; `None` for the whole model.
    within: Option<(DVec3, DVec3)>,
}

/// Finds closures. One per model; holds 4 bytes a VSP so that a search touches only what it visits.
#[derive(Debug)]
pub struct Collection {
    /// The search that last visited each VSP; [n].
    stamps: Vec<u32>,
    /// The current search; 0 is none.
    stamp: u32,
    /// VSPs to look at, each with the vertex that it must split. Empty between searches.
    candidates: Vec<(u32, u32)>,
    looked_at: u64,
}

impl Collection {
    /// For a model with so many VSPs.
    #[must_use]
    pub fn new(vsps: u32) -> Self {
        Self {
            stamps: vec![0; vsps as usize],
            stamp: 0,
            candidates: Vec::new(),
            looked_at: 0,
        }
    }

    /// Nodes of the hierarchy that searches have looked at so far: at most the base vertices and
    /// two for each VSP taken, a search.
    #[must_use]
    pub fn looked_at(&self) -> u64 {
        self.looked_at
    }

    /// The closure of what is asked for, ascending.
    ///
    /// | asked for | the smallest front that holds |
    /// |---|---|
    /// | a cell at tolerance 0 | what makes every face of the full mesh that it owns |
    /// | a cell at t > 0 | VSPs with E > t whose descendant bounds meet the cell grown by 2 t |
    /// | the whole at t > 0 | VSPs with expected error E > t |
    /// | the whole at tolerance 0 | every VSP |
    /// | a prefix | the first VSPs of the sequence, at most all |
    ///
    /// # Errors
    /// When the grid has no such cell, the tolerance is none, or a block that the search needs is
    /// damaged.
    pub fn closure<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        asked: RegionAt,
    ) -> Result<Vec<u32>, CollectError> {
        let header = file.model_header();
        if asked.region == RegionId::PREFIX {
            return Ok((0..asked.tolerance_bits.min(header.vsps)).collect());
        }
        let tolerance = f32::from_bits(asked.tolerance_bits);
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(CollectError::Tolerance(asked));
        }
        let whole = asked.region == RegionId::WHOLE;
        if whole && tolerance == 0.0 {
            return Ok((0..header.vsps).collect());
        }
        let grid = header.grid_of(tolerance);
        if !whole && !grid.contains(asked.region) {
            return Err(CollectError::UnknownRegion(asked));
        }
        let within = (!whole).then(|| {
            let (lower, upper) = grid.cell_box(asked.region);
            let grown = DVec3::splat(2.0 * f64::from(tolerance));
            (lower - grown, upper + grown)
        });
        let found = if tolerance == 0.0 {
            self.seeds_in_index(file, asked.region)
        } else {
            self.seeds_in_hierarchy(file, &header, tolerance, within)
        };
        let closed = found.and_then(|seeds| self.close(file, seeds));
        self.candidates.clear();
        closed.map_err(|error| CollectError::Damaged { asked, error })
    }

    /// The seeds of a region, each visited.
    fn seeds_in_index<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        region: RegionId,
    ) -> Result<Vec<u32>, FileError> {
        self.begin();
        let Some(seeds) = file.seeds(region)? else {
            return Ok(Vec::new());
        };
        let mut found = Vec::with_capacity(2 * seeds.len());
        for &seed in seeds {
            self.visit(seed, &mut found);
        }
        Ok(found)
    }

    /// The VSPs that a tolerance and a box want, each visited. Stops below every VSP that is not
    /// wanted: those that split its descendants are not wanted either (see `VspNode`).
    fn seeds_in_hierarchy<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        header: &ModelHeader,
        tolerance: f32,
        within: Option<(DVec3, DVec3)>,
    ) -> Result<Vec<u32>, FileError> {
        let scale = ErrorScale::for_diagonal(header.diagonal);
        let wanted = Wanted {
            // An unknown error is larger than any tolerance.
            floor: scale.floor(tolerance.into()).min(VspRecord::E_UNKNOWN - 1),
            reach: BoundsScale::new(header.lower, header.upper),
            within,
        };
        let sizes = header.sizes();
        self.begin();
        self.candidates.clear();
        let of_base = (0u32..).zip(file.base_splits());
        self.candidates
            .extend(of_base.filter_map(|(vertex, &i)| (i != NONE).then_some((i, vertex))));
        let mut found = Vec::new();
        while let Some((i, splits)) = self.candidates.pop() {
            self.looked_at += 1;
            let node = file.node(i)?;
            let reached = wanted
                .within
                .is_none_or(|(lower, upper)| wanted.reach.meets(node.bounds, lower, upper));
            if !reached {
                continue;
            }
            let record = file.record(i)?;
            if record.vs != splits {
                return Err(FileError::Inconsistent(Section::Hierarchy));
            }
            if record.e <= wanted.floor {
                continue;
            }
            self.visit(i, &mut found);
            for (child, vertex) in node.children.into_iter().zip(sizes.vt(i)..) {
                if child != NONE {
                    self.candidates.push((child, vertex));
                }
            }
        }
        Ok(found)
    }

    /// Adds to visited VSPs everything that they depend on; ascending.
    fn close<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        mut closure: Vec<u32>,
    ) -> Result<Vec<u32>, FileError> {
        let sizes = file.model_header().sizes();
        // `closure` is the queue of the search as well: what lies before `next` has its
        // dependencies in it.
        let mut next = 0;
        while let Some(&i) = closure.get(next) {
            next += 1;
            for dependency in file.record(i)?.dependencies(sizes) {
                self.visit(dependency, &mut closure);
            }
        }
        closure.sort_unstable();
        Ok(closure)
    }

    /// Appends a VSP that this search has not visited yet.
    fn visit(&mut self, i: u32, closure: &mut Vec<u32>) {
        if let Some(seen) = self.stamps.get_mut(i as usize)
            && *seen != self.stamp
        {
            *seen = self.stamp;
            closure.push(i);
        }
    }

    /// Starts a search: nothing is visited.
    fn begin(&mut self) {
        if self.stamp == u32::MAX {
            self.stamps.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
    }
}

/// Marks a VSP of a closure that the client lacks; numbers of VSPs are below it.
pub const MISSING: u32 = 1 << 31;

/// What one client holds of one model.
#[derive(Debug, Default)]
pub struct Residency {
    /// Held regions that contain each VSP; [n], or empty before the first region.
    counts: Vec<u32>,
    /// Held regions with a closure that is not empty.
    regions: BTreeSet<RegionAt>,
}

impl Residency {
    /// Takes a region in and marks with [`MISSING`] the VSPs of its closure that no region held
    /// before.
    ///
    /// A region that is held already changes nothing and lacks nothing.
    pub fn insert(&mut self, region: RegionAt, closure: &mut [u32], vsps: u32) {
        if closure.is_empty() || !self.regions.insert(region) {
            return;
        }
        self.counts.resize(vsps as usize, 0);
        for i in closure {
            let count = &mut self.counts[*i as usize];
            *count += 1;
            if *count == 1 {
                *i |= MISSING;
            }
        }
    }

    /// Whether the region is held.
    #[must_use]
    pub fn holds(&self, region: RegionAt) -> bool {
        self.regions.contains(&region)
    }

    /// Gives a region up; nothing happens when it is not held.
    pub fn remove(&mut self, region: RegionAt, closure: &[u32]) {
        if self.regions.remove(&region) {
            for &i in closure {
                self.counts[i as usize] -= 1;
            }
        }
    }
}

#[cfg(test)]
mod tests;
