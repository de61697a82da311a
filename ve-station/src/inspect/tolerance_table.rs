//! Cost of the tolerance levels: of each level its tolerance, its share of the
//! VSPs, and the closures of its regions.

use super::finite;
use crate::tuning::inspect::SAMPLED_REGIONS;
use serde::Serialize;
use spm::{ErrorScale, FileError, LEVELS, RegionId, SpmFile};
use station_core::collection::{CollectError, RegionAt, Search};
use std::collections::BTreeSet;

/// A tolerance level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ToleranceRow {
    /// The level; 0 is the full mesh.
    pub level: u32,
    /// Smallest tolerance of the level, model units.
    pub tolerance: f64,
    /// The same at the asked size, metres.
    pub tolerance_m: f64,
    /// VSPs whose expected error exceeds it (of level 0 all): the global front.
    pub vsps: u32,
    /// Side of a cell, model units.
    pub cell: f64,
    /// Occupied and empty cells.
    pub regions: u64,
    /// Mean closure of a region, VSPs, over at most 256 regions spread evenly.
    pub closure_mean: f64,
    /// Largest closure among them.
    pub closure_max: u64,
    /// Nodes of the hierarchy that the search for one looked at, mean (of level 0 none: it has an
    /// index).
    pub looked_at_mean: f64,
}

/// All levels that the file has.
///
/// # Errors
/// When a block is damaged.
pub fn tolerance_table<D: AsRef<[u8]>>(
    file: &SpmFile<D>,
    metres_per_unit: f64,
) -> Result<Vec<ToleranceRow>, FileError> {
    let header = file.model_header();
    let scale = ErrorScale::for_diagonal(header.diagonal);
    let mut rows = Vec::new();
    for (level, tolerance) in (0..LEVELS as u32).zip(header.level_tolerances) {
        // Two levels of one tolerance are named by the coarser one.
        if !tolerance.is_finite() || header.level_of(tolerance) != level {
            continue;
        }
        let floor = scale.floor(tolerance.into());
        let mut vsps = 0;
        for i in 0..header.vsps {
            vsps += u32::from(level == 0 || file.record(i)?.e > floor);
        }
        let cells: BTreeSet<RegionId> = file
            .regions()
            .iter()
            .map(|region| RegionId::of_cell(region.cell() >> level))
            .collect();
        let step = cells.len().div_ceil(SAMPLED_REGIONS).max(1);
        let (mut sum, mut most, mut count, mut looked_at) = (0, 0, 0u32, 0);
        for &cell in cells.iter().step_by(step) {
            let asked = RegionAt::tolerance(cell, tolerance);
            let search = match Search::complete(file, asked) {
                Ok(search) => search,
                Err(CollectError::Damaged { error, .. }) => return Err(error),
                // The cells are the grid's own, the tolerance is the level's.
                Err(_) => continue,
            };
            looked_at += search.looked_at();
            let closure = search.into_closure().len() as u64;
            sum += closure;
            most = most.max(closure);
            count += 1;
        }
        let mean = |total: u64| finite(total as f64 / f64::from(count));
        rows.push(ToleranceRow {
            level,
            tolerance: tolerance.into(),
            tolerance_m: f64::from(tolerance) * metres_per_unit,
            vsps,
            cell: header.grid_of(tolerance).cell,
            regions: cells.len() as u64,
            closure_mean: mean(sum),
            closure_max: most,
            looked_at_mean: mean(looked_at),
        });
    }
    Ok(rows)
}
