//! The grid of regions (thesis 5.3.1.1): sparse and addressed by cell, so a controller needs no
//! table.

use bytemuck::{Pod, Zeroable};
use geometry::triangle_overlaps_box;
use glam::{DVec3, UVec3};

/// Number of tolerance levels; the cells of each have twice the side of those of the one before.
pub const LEVELS: usize = 10;

/// A region: a cell, the whole model, or a prefix of the sequence. A cell is given by its
/// coordinates, ten bits each, x lowest, in the grid of the tolerance's level
/// ([`crate::ModelHeader::level_of`]).
#[repr(transparent)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RegionId(pub u32);

impl RegionId {
    /// The whole model at a tolerance: global refinement.
    pub const WHOLE: Self = Self(1 << 30);
    /// The first VSPs of the sequence (thesis Figure 4.4). Their count replaces the bits of the
    /// tolerance.
    pub const PREFIX: Self = Self(1 << 31);

    /// The region of a cell whose coordinates are below 1024.
    #[inline]
    #[must_use]
    pub fn of_cell(cell: UVec3) -> Self {
        debug_assert!(cell.max_element() < RegionGrid::MAX_DIVISIONS);
        Self(cell.x | cell.y << 10 | cell.z << 20)
    }

    /// The coordinates of its cell.
    #[inline]
    #[must_use]
    pub fn cell(self) -> UVec3 {
        UVec3::new(self.0 & 1023, self.0 >> 10 & 1023, self.0 >> 20 & 1023)
    }
}

/// Cubic cells over a model's bounding box: `divisions` along its longest side, fewer along the
/// others.
///
/// The thesis divides every side by the same number instead. With cubes, a cell means the same
/// distance in every direction, and flat models do not get flat cells.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RegionGrid {
    /// Smallest corner of the bounding box, model units.
    pub lower: [f64; 3],
    /// Side of a cell, model units.
    pub cell: f64,
    /// Cells along x, y, z; each 1..=1024.
    pub cells: [u32; 3],
    /// D, cells along the longest side: a power of two.
    pub divisions: u32,
}

impl RegionGrid {
    /// Largest number of cells along a side.
    pub const MAX_DIVISIONS: u32 = 1024;

    /// The grid with `divisions` cells along the longest side of a box (model units).
    ///
    /// `None` when the box is empty, not finite or a point, or `divisions` is no power of two up to
    /// 1024.
    #[must_use]
    pub fn new(lower: DVec3, upper: DVec3, divisions: u32) -> Option<Self> {
        // A side is rounded, and may not end below the corner: a face there would have no cell.
        let side = |k: usize| {
            let side = upper[k] - lower[k];
            if lower[k] + side < upper[k] {
                side.next_up()
            } else {
                side
            }
        };
        let sides = DVec3::new(side(0), side(1), side(2));
        let cell = sides.max_element() / f64::from(divisions);
        let usable = divisions.is_power_of_two() && divisions <= Self::MAX_DIVISIONS;
        if !usable || !cell.is_normal() || sides.min_element() < 0.0 || !lower.is_finite() {
            return None;
        }
        // So is the quotient.
        let count = |side: f64| {
            let whole = (side / cell).ceil();
            let more = if whole * cell < side { 1.0 } else { 0.0 };
            ((whole + more) as u32).clamp(1, divisions)
        };
        Some(Self {
            lower: lower.to_array(),
            cell,
            cells: [count(sides.x), count(sides.y), count(sides.z)],
            divisions,
        })
    }

    /// The coarser grid whose cells are 2^`level` cells of this one along each side, with the same
    /// lower corner. Its walls are walls of this grid, bit for bit.
    ///
    /// `None` when no such cell is left along the longest side.
    #[must_use]
    pub fn at_level(&self, level: u32) -> Option<Self> {
        let divisions = self.divisions.checked_shr(level).unwrap_or(0);
        (divisions > 0).then(|| Self {
            cell: self.cell * f64::from(1u32 << level),
            cells: self.cells.map(|count| count.div_ceil(1 << level)),
            divisions,
            ..*self
        })
    }

    /// Whether the numbers can be those of a grid; for grids from a file or the wire.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.lower.iter().all(|x| x.is_finite())
            && self.cell.is_normal()
            && self.cell > 0.0
            && self.divisions.is_power_of_two()
            && self.divisions <= Self::MAX_DIVISIONS
            && self.cells.iter().all(|&c| c >= 1 && c <= self.divisions)
    }

    /// Whether the region is a cell of this grid.
    #[must_use]
    pub fn contains(&self, region: RegionId) -> bool {
        let cell = region.cell();
        region.0 >> 30 == 0 && cell.cmplt(UVec3::from_array(self.cells)).all()
    }

    /// The closed box of a cell, model units.
    #[inline]
    #[must_use]
    pub fn cell_box(&self, region: RegionId) -> (DVec3, DVec3) {
        let lower = DVec3::from_array(self.lower);
        let cell = region.cell();
        (
            lower + cell.as_dvec3() * self.cell,
            lower + (cell + UVec3::ONE).as_dvec3() * self.cell,
        )
    }

    /// The cells (lowest and highest corner, both included) whose boxes may meet the given box;
    /// clamped to the grid, `None` when the box lies outside the grid.
    #[must_use]
    pub fn cell_range(&self, lower: DVec3, upper: DVec3) -> Option<(UVec3, UVec3)> {
        let origin = DVec3::from_array(self.lower);
        let last = UVec3::from_array(self.cells) - UVec3::ONE;
        // One step outwards where a bound is within rounding of a wall: closed cells share walls.
        let slack = 1e-9;
        let low = ((lower - origin) / self.cell - slack).floor();
        let high = ((upper - origin) / self.cell + slack).floor();
        let outside = high.cmplt(DVec3::ZERO).any() || low.cmpgt(last.as_dvec3()).any();
        if outside || !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let clamp = |v: DVec3| v.clamp(DVec3::ZERO, last.as_dvec3()).as_uvec3();
        Some((clamp(low), clamp(high)))
    }

    /// The region whose cell holds a point, clamped to the grid.
    #[must_use]
    pub fn region_of_point(&self, point: DVec3) -> RegionId {
        let last = UVec3::from_array(self.cells) - UVec3::ONE;
        let cell = ((point - DVec3::from_array(self.lower)) / self.cell)
            .floor()
            .clamp(DVec3::ZERO, last.as_dvec3());
        RegionId::of_cell(cell.as_uvec3())
    }

    /// Squared distance from a point to a region's closed box, model units.
    #[inline]
    #[must_use]
    pub fn distance_squared(&self, region: RegionId, point: DVec3) -> f64 {
        let (lower, upper) = self.cell_box(region);
        (lower - point)
            .max(point - upper)
            .max(DVec3::ZERO)
            .length_squared()
    }

    /// Displacement from a point to the nearest point of a region's closed box, model units; zero
    /// inside.
    #[inline]
    #[must_use]
    pub fn towards(&self, region: RegionId, point: DVec3) -> DVec3 {
        let (lower, upper) = self.cell_box(region);
        point.clamp(lower, upper) - point
    }

    /// Whether a triangle overlaps the closed box of a region: then the region owns that face.
    #[must_use]
    pub fn overlaps(&self, region: RegionId, corners: [DVec3; 3]) -> bool {
        let (lower, upper) = self.cell_box(region);
        triangle_overlaps_box(corners, lower, upper)
    }

    /// Calls `visit` with every region that owns the triangle, in ascending order of z, y, x.
    pub fn for_each_owner(&self, corners: [DVec3; 3], mut visit: impl FnMut(RegionId)) {
        let lower = corners[0].min(corners[1]).min(corners[2]);
        let upper = corners[0].max(corners[1]).max(corners[2]);
        let Some((low, high)) = self.cell_range(lower, upper) else {
            return;
        };
        if low == high {
            visit(RegionId::of_cell(low));
            return;
        }
        let overlaps = |low: UVec3, high: UVec3| self.block_overlaps(low, high, corners);
        visit_overlapping(low, high, &overlaps, &mut visit);
    }

    /// Whether a triangle overlaps the closed box of a block of cells, from `low` to `high`. The
    /// box of several is a little larger than they are: rounding takes no cell away that overlaps
    /// by itself.
    fn block_overlaps(&self, low: UVec3, high: UVec3, corners: [DVec3; 3]) -> bool {
        let (lower, _) = self.cell_box(RegionId::of_cell(low));
        let (_, upper) = self.cell_box(RegionId::of_cell(high));
        let margin = if low == high { 0.0 } else { 1e-9 * self.cell };
        triangle_overlaps_box(corners, lower - margin, upper + margin)
    }
}

/// Blocks of so many cells are not halved any more.
const SMALL_BLOCK: u32 = 8;

/// Visits all cells from `low` to `high` that overlap, in ascending order of z, y, x. Larger blocks
/// are halved, and halves that do not overlap left out: a large tilted face takes time in
/// proportion to its owners, not to the cells of its box.
fn visit_overlapping(
    low: UVec3,
    high: UVec3,
    overlaps: &impl Fn(UVec3, UVec3) -> bool,
    visit: &mut impl FnMut(RegionId),
) {
    let size = high - low + UVec3::ONE;
    if size.element_product() <= SMALL_BLOCK {
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                for x in low.x..=high.x {
                    let cell = UVec3::new(x, y, z);
                    if overlaps(cell, cell) {
                        visit(RegionId::of_cell(cell));
                    }
                }
            }
        }
        return;
    }
    // The slowest coordinate first: that keeps the order.
    let axis = (0..3).rev().find(|&k| size[k] > 1).unwrap_or(0);
    let (mut end, mut start) = (high, low);
    end[axis] = low[axis] + size[axis] / 2 - 1;
    start[axis] = end[axis] + 1;
    for (low, high) in [(low, end), (start, high)] {
        if overlaps(low, high) {
            visit_overlapping(low, high, overlaps, visit);
        }
    }
}

// The layout of the file (`FORMAT_VERSION`).
const _: () = {
    use std::mem::offset_of;
    assert!(size_of::<RegionGrid>() == 48 && offset_of!(RegionGrid, cell) == 24);
    assert!(offset_of!(RegionGrid, cells) == 32 && offset_of!(RegionGrid, divisions) == 44);
};

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_point_of_a_triangle_lies_in_a_region_that_owns_it(
            raw in prop::array::uniform3(prop::array::uniform3(0.0..1.0f64)),
            weights in prop::array::uniform2(0.0..1.0f64),
            exponent in -6..6i32,
        ) {
            let scale = 10f64.powi(exponent);
            let grid = RegionGrid::new(DVec3::ZERO, DVec3::new(1.0, 0.7, 0.3) * scale, 16).unwrap();
            prop_assert_eq!(grid.cells, [16, 12, 5]);
            let corners = raw.map(|c| DVec3::from_array(c) * DVec3::new(1.0, 0.7, 0.3) * scale);
            let mut owners = Vec::new();
            grid.for_each_owner(corners, |r| owners.push(r));
            let s = weights[0];
            let t = weights[1] * (1.0 - s);
            let p = corners[0] * (1.0 - s - t) + corners[1] * s + corners[2] * t;
            let holder = grid.region_of_point(p);
            prop_assert!(grid.contains(holder));
            prop_assert!(owners.contains(&holder), "{holder:?} not in {owners:?}");
        }
    }

    proptest! {
        #[test]
        fn the_owners_are_all_cells_that_overlap_in_their_order(
            raw in prop::array::uniform3(prop::array::uniform3(0.0..1.0f64)),
        ) {
            let upper = DVec3::new(1.0, 0.7, 0.9);
            let grid = RegionGrid::new(DVec3::ZERO, upper, 16).unwrap();
            let corners = raw.map(|c| DVec3::from_array(c) * upper);
            let mut owners = Vec::new();
            grid.for_each_owner(corners, |r| owners.push(r));
            let [width, height, depth] = grid.cells;
            let cells = (0..width * height * depth)
                .map(|k| UVec3::new(k % width, k / width % height, k / (width * height)));
            let all = cells.map(RegionId::of_cell);
            let expected: Vec<RegionId> = all.filter(|&r| grid.overlaps(r, corners)).collect();
            prop_assert_eq!(owners, expected);
        }
    }

    /// In any direction, and not in proportion to the cells of its box.
    #[test]
    fn a_large_tilted_face_takes_time_in_proportion_to_its_owners() {
        let grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 64).unwrap();
        let tilted = [[0.0, 0.0, 0.4], [1.0, 0.0, 0.6], [0.0, 1.0, 0.5]];
        let diagonal = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let faces = [0, 1, 2].map(|turn| {
            tilted.map(|mut p: [f64; 3]| {
                p.rotate_left(turn);
                p
            })
        });
        for face in faces.into_iter().chain([diagonal]) {
            let corners = face.map(DVec3::from_array);
            let looks = std::cell::Cell::new(0);
            let overlaps = |low: UVec3, high: UVec3| {
                looks.set(looks.get() + 1);
                grid.block_overlaps(low, high, corners)
            };
            let mut owners = 0;
            let last = UVec3::splat(63);
            visit_overlapping(UVec3::ZERO, last, &overlaps, &mut |_| owners += 1);
            assert!(owners > 2000, "{owners}");
            let looks = looks.get();
            assert!(looks < 16 * owners, "{looks} for {owners}");
        }
    }

    #[test]
    fn the_last_walls_reach_the_upper_corner_and_a_face_there_has_owners() {
        // Noise beside zero is below the last bit of the side's length.
        let noise = f64::from(6.123e-17_f32);
        let (lower, upper) = (DVec3::new(0.0, -1.0, 0.0), DVec3::new(2.0, noise, 1.0));
        // Five cells of this length are a little less than the side; the quotient is five.
        let fifth = DVec3::new(0.72, 0.225, 0.1);
        for (lower, upper) in [(lower, upper), (DVec3::ZERO, fifth)] {
            let grid = RegionGrid::new(lower, upper, 16).unwrap();
            for level in 0..=4 {
                let grid = grid.at_level(level).unwrap();
                let last = UVec3::from_array(grid.cells) - UVec3::ONE;
                let (_, wall) = grid.cell_box(RegionId::of_cell(last));
                assert!(wall.cmpge(upper).all(), "level {level}: {wall} {upper}");
            }
        }
        let grid = RegionGrid::new(lower, upper, 16).unwrap();
        let corners = [[0.1, 0.1], [0.2, 0.1], [0.15, 0.6]].map(|[x, z]| DVec3::new(x, noise, z));
        for level in 0..=4 {
            let mut owners = 0;
            let grid = grid.at_level(level).unwrap();
            grid.for_each_owner(corners, |_| owners += 1);
            assert!(owners > 0, "level {level}");
        }
    }

    #[test]
    fn coarser_levels_share_the_walls_of_the_finest() {
        let lower = DVec3::new(-0.1, 3.7, 1e-3);
        let grid = RegionGrid::new(lower, lower + DVec3::new(0.7, 0.3, 0.013), 64).unwrap();
        assert_eq!(grid.at_level(0), Some(grid));
        for level in 1..7 {
            let coarse = grid.at_level(level).unwrap();
            assert!(coarse.is_valid());
            assert_eq!(coarse.divisions, 64 >> level);
            let ratio = 1 << level;
            let last = UVec3::from_array(coarse.cells) - UVec3::ONE;
            let (low, high) = coarse.cell_box(RegionId::of_cell(last));
            let first_fine = RegionId::of_cell(last * ratio);
            assert_eq!(low, grid.cell_box(first_fine).0);
            let beyond = RegionId::of_cell(last * ratio + UVec3::splat(ratio - 1));
            assert_eq!(high, grid.cell_box(beyond).1);
            let end = UVec3::from_array(grid.cells);
            assert!(end.cmple((last + UVec3::ONE) * ratio).all());
            assert!(end.cmpgt(last * ratio).all());
        }
        for level in [7, 31, 32, u32::MAX] {
            assert_eq!(grid.at_level(level), None);
        }
        assert!(!grid.contains(RegionId::WHOLE) && !grid.contains(RegionId::PREFIX));
    }

    #[test]
    fn ids_come_back_and_foreign_ones_are_refused() {
        let grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 8).unwrap();
        let region = RegionId::of_cell(UVec3::new(7, 0, 3));
        assert_eq!(region.cell(), UVec3::new(7, 0, 3));
        assert!(grid.contains(region));
        assert!(!grid.contains(RegionId::of_cell(UVec3::new(8, 0, 0))));
        assert!(!grid.contains(RegionId(u32::MAX)));
        assert!(RegionGrid::new(DVec3::ZERO, DVec3::ONE, 12).is_none());
        assert!(RegionGrid::new(DVec3::ZERO, DVec3::ZERO, 8).is_none());
    }
}
