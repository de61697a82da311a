//! The name of a region.

use super::id_map::Id;
use spm::RegionId;

/// Name of a region: a cell in the grid of its tolerance's level, or one of the special ids.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
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
