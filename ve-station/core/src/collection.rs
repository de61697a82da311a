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

use crate::sparse::{IdSet, Sparse};
use glam::DVec3;
use protocol::Refusal;
use spm::{BoundsScale, ErrorScale, FileError, NONE, RegionId, Section, SpmFile};
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
#[derive(Debug)]
struct Wanted {
    /// The largest code of an expected error that does not exceed the tolerance.
    floor: u16,
    reach: BoundsScale,
    /// The grown cell; `None` for the whole model.
    within: Option<(DVec3, DVec3)>,
}

/// How far a search is.
#[derive(Debug)]
enum Phase {
    /// The first VSPs of the sequence: nothing is searched.
    Prefix(u32),
    /// VSPs of the hierarchy, each with the vertex that it must split, are to be looked at.
    Seeds(Wanted, Vec<(u32, u32)>),
    /// Everything found is to be closed.
    Closing,
}

/// The search for a closure, a bounded part at a time. Memory follows what is found.
///
/// | asked for | the smallest front that holds |
/// |---|---|
/// | a cell at tolerance 0 | what makes every face of the full mesh that it owns |
/// | a cell at t > 0 | VSPs with E > t whose descendant bounds meet the cell grown by 2 t |
/// | the whole at t > 0 | VSPs with expected error E > t |
/// | the whole at tolerance 0 | every VSP |
/// | a prefix | the first VSPs of the sequence, at most all |
#[derive(Debug)]
pub struct Search {
    asked: RegionAt,
    phase: Phase,
    found: IdSet,
    /// Found, but what it depends on is not.
    open: Vec<u32>,
    /// The least id that [`Search::next_id`] may give.
    next: u32,
    looked_at: u64,
}

impl Search {
    /// Begins a search.
    ///
    /// # Errors
    /// When the grid has no such cell, the tolerance is none, or the index of regions is damaged.
    pub fn new<D: AsRef<[u8]>>(file: &SpmFile<D>, asked: RegionAt) -> Result<Self, CollectError> {
        let header = file.model_header();
        let mut search = Self {
            asked,
            phase: Phase::Closing,
            found: IdSet::default(),
            open: Vec::new(),
            next: 0,
            looked_at: 0,
        };
        if asked.region == RegionId::PREFIX {
            search.phase = Phase::Prefix(asked.tolerance_bits.min(header.vsps));
            return Ok(search);
        }
        let tolerance = f32::from_bits(asked.tolerance_bits);
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(CollectError::Tolerance(asked));
        }
        let whole = asked.region == RegionId::WHOLE;
        if whole && tolerance == 0.0 {
            search.phase = Phase::Prefix(header.vsps);
            return Ok(search);
        }
        let grid = header.grid_of(tolerance);
        if !whole && !grid.contains(asked.region) {
            return Err(CollectError::UnknownRegion(asked));
        }
        if tolerance == 0.0 {
            let seeds = file.seeds(asked.region);
            let seeds = seeds.map_err(|error| CollectError::Damaged { asked, error })?;
            for &seed in seeds.unwrap_or_default() {
                search.visit(seed, header.vsps);
            }
            return Ok(search);
        }
        let within = (!whole).then(|| {
            let (lower, upper) = grid.cell_box(asked.region);
            let grown = DVec3::splat(2.0 * f64::from(tolerance));
            (lower - grown, upper + grown)
        });
        let scale = ErrorScale::for_diagonal(header.diagonal);
        let wanted = Wanted {
            // Below the largest code, which is beyond any tolerance.
            floor: scale.floor(tolerance.into()),
            reach: BoundsScale::new(header.lower, header.upper),
            within,
        };
        let of_base = (0u32..).zip(file.base_splits());
        let candidates = of_base.filter_map(|(vertex, &i)| (i != NONE).then_some((i, vertex)));
        search.phase = Phase::Seeds(wanted, candidates.collect());
        Ok(search)
    }

    /// A search that is done.
    ///
    /// # Errors
    /// As those of [`Search::new`] and [`Search::step`].
    pub fn complete<D: AsRef<[u8]>>(
        file: &SpmFile<D>,
        asked: RegionAt,
    ) -> Result<Self, CollectError> {
        let mut search = Self::new(file, asked)?;
        while !search.step(file, u32::MAX)? {}
        Ok(search)
    }

    /// The closure, ascending; of a complete search.
    #[must_use]
    pub fn into_closure(mut self) -> Vec<u32> {
        std::iter::from_fn(|| self.next_id()).collect()
    }

    /// What is searched for.
    #[must_use]
    pub fn asked(&self) -> RegionAt {
        self.asked
    }

    /// Nodes of the hierarchy looked at so far: at most the base vertices and two for each VSP
    /// found.
    #[must_use]
    pub fn looked_at(&self) -> u64 {
        self.looked_at
    }

    /// Looks at so many VSPs at the most; whether the closure is complete.
    ///
    /// # Errors
    /// When a block that the search needs is damaged.
    pub fn step<D: AsRef<[u8]>>(
        &mut self,
        file: &SpmFile<D>,
        vsps: u32,
    ) -> Result<bool, CollectError> {
        let asked = self.asked;
        for _ in 0..vsps {
            let more = self.look_at_one(file);
            if !more.map_err(|error| CollectError::Damaged { asked, error })? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Looks at one VSP; false when none is left.
    fn look_at_one<D: AsRef<[u8]>>(&mut self, file: &SpmFile<D>) -> Result<bool, FileError> {
        let header = file.model_header();
        let sizes = header.sizes();
        if let Phase::Seeds(wanted, candidates) = &mut self.phase {
            if let Some((i, splits)) = candidates.pop() {
                self.looked_at += 1;
                if wants(wanted, file, i, splits)? {
                    let children = file.node(i)?.children;
                    let below = children.into_iter().zip(sizes.vt(i)..);
                    candidates.extend(below.filter(|&(child, _)| child != NONE));
                    self.visit(i, header.vsps);
                }
                return Ok(true);
            }
            self.phase = Phase::Closing;
        }
        let Some(i) = self.open.pop() else {
            return Ok(false);
        };
        for dependency in file.record(i)?.dependencies(sizes) {
            self.visit(dependency, header.vsps);
        }
        Ok(true)
    }

    /// Takes a VSP that was not found yet.
    fn visit(&mut self, i: u32, vsps: u32) {
        if i < vsps && self.found.insert(i) {
            self.open.push(i);
        }
    }

    /// [`Search::next_id`] starts again.
    pub fn rewind(&mut self) {
        self.next = 0;
    }

    /// The next VSP of the closure, ascending; for a complete one.
    pub fn next_id(&mut self) -> Option<u32> {
        let id = match self.phase {
            Phase::Prefix(end) => (self.next < end).then_some(self.next),
            _ => self.found.next(self.next),
        };
        self.next = id? + 1;
        id
    }
}

/// Whether a search takes a VSP, which must split the vertex `splits`. It stops below every VSP
/// that is not wanted: those that split its descendants are not wanted either (see `VspNode`).
fn wants<D: AsRef<[u8]>>(
    wanted: &Wanted,
    file: &SpmFile<D>,
    i: u32,
    splits: u32,
) -> Result<bool, FileError> {
    let node = file.node(i)?;
    let reached = wanted
        .within
        .is_none_or(|(lower, upper)| wanted.reach.meets(node.bounds, lower, upper));
    if !reached {
        return Ok(false);
    }
    let record = file.record(i)?;
    if record.vs != splits {
        return Err(FileError::Inconsistent(Section::Hierarchy));
    }
    Ok(record.e > wanted.floor)
}

/// The closure of what is asked for, ascending.
///
/// # Errors
/// When the grid has no such cell, the tolerance is none, or a block that the search needs is
/// damaged.
pub fn closure<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    asked: RegionAt,
) -> Result<Vec<u32>, CollectError> {
    Ok(Search::complete(file, asked)?.into_closure())
}

/// Marks a VSP of a closure that the client lacks; numbers of VSPs are below it.
pub const MISSING: u32 = 1 << 31;

/// What one client holds of one model. Regions are taken in and given up VSP by VSP, so that it can
/// be done a bounded part at a time. Memory follows what is held.
#[derive(Debug, Default)]
pub struct Residency {
    /// Held regions that contain each VSP.
    counts: Sparse<u32>,
    regions: BTreeSet<RegionAt>,
}

impl Residency {
    /// Begins to take a region in; false when it is held already, which changes nothing.
    pub fn hold(&mut self, region: RegionAt) -> bool {
        self.regions.insert(region)
    }

    /// Takes a VSP of a region in; whether no region held it before.
    pub fn add(&mut self, vsp: u32) -> bool {
        let count = self.counts.get(vsp);
        self.counts.set(vsp, count.saturating_add(1));
        count == 0
    }

    /// Whether the region is held.
    #[must_use]
    pub fn holds(&self, region: RegionAt) -> bool {
        self.regions.contains(&region)
    }

    /// Number of regions held.
    #[must_use]
    pub fn regions(&self) -> usize {
        self.regions.len()
    }

    /// Begins to give a region up; false when it is not held.
    pub fn release(&mut self, region: RegionAt) -> bool {
        self.regions.remove(&region)
    }

    /// Gives a VSP of a region up.
    pub fn subtract(&mut self, vsp: u32) {
        let count = self.counts.get(vsp);
        self.counts.set(vsp, count.saturating_sub(1));
    }

    /// Bytes kept.
    #[cfg(test)]
    pub fn bytes(&self) -> usize {
        self.counts.bytes()
    }
}

#[cfg(test)]
mod tests;
