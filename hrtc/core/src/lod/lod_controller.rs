//! Level of detail by distance: the tolerance asked for at each distance, and when it is coarser.
//!
//! The scene asks for an expected error near the contact, and every ring around it for the next
//! level of the model ([`ModelHeader::level_tolerances`]): cells of twice the side, so a ring has
//! about as many cells and each of them about as many splits. A probe that outruns a ring lands on
//! the next one, not on the base mesh.
//!
//! The finest ring is a value that may change between two ticks: regions are named by cell and
//! tolerance, so another one is another set of names and nothing else. It is raised, one ring at a
//! time,
//!
//! - above the greatest speed of a ring, K / (rho w T): its splits and collapses would not fit the
//!   ticks (thesis 4.1: resolution follows speed);
//! - when the cache cannot hold what the contact needs (`memory_pressure`).

use glam::DVec3;
use spm::ModelHeader;
use spm::{LEVELS, RegionGrid};

/// Most rings: the tolerance asked for, then the levels above it.
pub const MAX_RINGS: usize = LEVELS + 1;

/// Regions of one tolerance around the contact.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Ring {
    /// Tolerance of its regions, model units; 0 is the full mesh.
    pub tolerance: f32,
    /// Its level on the ladder.
    pub level: u32,
    /// Its grid.
    pub grid: RegionGrid,
}

/// The rings of a model, finest first, and the first of them that is asked for.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct LodController {
    rings: [Ring; MAX_RINGS],
    count: usize,
    finest: usize,
    /// Faces for each square model unit.
    density: f64,
    asked: f32,
}

impl LodController {
    /// The rings of a tolerance, model units. `area` is that of the model's surface, square model
    /// units: the base mesh's will do, it is the smaller one and so the greatest speed comes out on
    /// the safe side.
    #[must_use]
    pub fn new(header: &ModelHeader, tolerance: f32, area: f64) -> Self {
        let ring = |tolerance: f32| Ring {
            tolerance,
            level: header.level_of(tolerance),
            grid: header.grid_of(tolerance),
        };
        let mut controller = Self {
            rings: [ring(tolerance); MAX_RINGS],
            count: 1,
            finest: 0,
            density: f64::from(header.faces) / area.max(f64::MIN_POSITIVE),
            asked: tolerance,
        };
        let first = controller.rings[0].level as usize;
        for &level in &header.level_tolerances[first + 1..] {
            let last = controller.rings[controller.count - 1].tolerance;
            // Equal levels are one tolerance, and so one name: its level is the coarsest of them.
            if level.is_finite() && level > last {
                controller.rings[controller.count] = ring(level);
                controller.count += 1;
            }
        }
        controller
    }

    /// The tolerance asked for, model units.
    #[must_use]
    pub fn asked(&self) -> f32 {
        self.asked
    }

    /// All rings, finest first.
    #[must_use]
    pub fn rings(&self) -> &[Ring] {
        &self.rings[..self.count]
    }

    /// Index of the finest ring that is asked for now.
    #[must_use]
    pub fn finest(&self) -> usize {
        self.finest
    }

    /// The finest tolerance that is asked for now, model units.
    #[must_use]
    pub fn finest_tolerance(&self) -> f32 {
        self.rings[self.finest].tolerance
    }

    /// Makes a ring the finest; the coarsest there is when there are fewer.
    pub fn set_finest(&mut self, ring: usize) {
        self.finest = ring.min(self.count - 1);
    }

    /// The greatest speed at which a ring's splits and collapses fit into `operations` a tick,
    /// model units a tick, for a strip of `2 * reach` and a cell.
    #[must_use]
    pub fn greatest_speed(&self, ring: usize, reach: f64, operations: f64) -> f64 {
        let ring = &self.rings[ring.min(self.count - 1)];
        // A level leaves at most a quarter of the splits of the one before.
        let faces = self.density / f64::from(1u32 << (2 * ring.level));
        operations / (faces * (2.0 * reach + ring.grid.cell))
    }

    /// The speed at which a ring's own strip, which is `lead` ticks of motion wider on either side,
    /// just fits: model units a tick.
    #[must_use]
    pub fn limit(&self, ring: usize, reach: f64, lead: f64, operations: f64) -> f64 {
        // speed * (width + 2 lead speed) = product, where product = speed * width at rest.
        let width = 2.0 * reach + self.rings[ring.min(self.count - 1)].grid.cell;
        let product = self.greatest_speed(ring, reach, operations) * width;
        let root = (width * width + 8.0 * lead * product).sqrt();
        2.0 * product / (width + root)
    }

    /// The finest ring that a speed, model units a tick, leaves time for. A ring that is given up
    /// comes back when the speed has fallen to 80 % of its greatest, so that the finest does not
    /// flicker.
    #[must_use]
    pub fn finest_at_speed(&self, speed: f64, reach: f64, operations: f64) -> usize {
        let fits = |ring: usize| {
            let share = if ring < self.finest { 0.8 } else { 1.0 };
            speed <= share * self.greatest_speed(ring, reach, operations)
        };
        (0..self.count - 1)
            .find(|&ring| fits(ring))
            .unwrap_or(self.count - 1)
    }

    /// The ring that is nearest to so large a share of the splits of the first one, 0 to 1.
    #[must_use]
    pub fn finest_of_splits(&self, share: f64) -> usize {
        let first = self.rings[0].level;
        // A level leaves a quarter of the splits of the one before, or fewer; half way is a half.
        let fits = |ring: &Ring| 2.0 * share * f64::from(1u32 << (2 * (ring.level - first))) >= 1.0;
        let rings = &self.rings[..self.count - 1];
        rings.iter().position(fits).unwrap_or(self.count - 1)
    }
}

/// Area of a triangle, in squares of the unit of its corners.
#[must_use]
pub fn triangle_area(corners: [DVec3; 3]) -> f64 {
    0.5 * (corners[1] - corners[0])
        .cross(corners[2] - corners[0])
        .length()
}

#[cfg(test)]
pub(crate) fn header(levels: &[f32]) -> ModelHeader {
    let mut header: ModelHeader = bytemuck::Zeroable::zeroed();
    header.grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 16).unwrap();
    header.level_tolerances = [f32::INFINITY; LEVELS];
    header.level_tolerances[..levels.len()].copy_from_slice(levels);
    header.faces = 4096;
    header
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rings(levels: &[f32], tolerance: f32) -> Vec<(f32, u32)> {
        let controller = LodController::new(&header(levels), tolerance, 1.0);
        let pairs = controller
            .rings()
            .iter()
            .map(|ring| (ring.tolerance, ring.level));
        pairs.collect()
    }

    #[test]
    fn rings_go_up_the_ladder_from_what_is_asked() {
        let ladder = [0.0, 0.1, 0.2, 0.4];
        assert_eq!(
            rings(&ladder, 0.0),
            [(0.0, 0), (0.1, 1), (0.2, 2), (0.4, 3)]
        );
        assert_eq!(
            rings(&ladder, 0.05),
            [(0.05, 0), (0.1, 1), (0.2, 2), (0.4, 3)]
        );
        assert_eq!(rings(&ladder, 0.1), [(0.1, 1), (0.2, 2), (0.4, 3)]);
        assert_eq!(rings(&ladder, 0.3), [(0.3, 2), (0.4, 3)]);
        assert_eq!(rings(&ladder, 7.0), [(7.0, 3)]);
        // Equal levels are one tolerance; without expected errors there is only what is asked for.
        assert_eq!(
            rings(&[0.0, 0.0, 0.2, 0.2, 0.4], 0.0),
            [(0.0, 0), (0.2, 3), (0.4, 4)]
        );
        assert_eq!(rings(&[0.0], 0.0), [(0.0, 0)]);
        assert_eq!(rings(&[0.0], 0.5), [(0.5, 0)]);
    }

    #[test]
    fn every_rings_name_means_the_same_grid_to_the_station() {
        let header = header(&[0.0, 0.0, 0.2, 0.2, 0.4]);
        for tolerance in [0.0, 0.1, 0.2, 0.3, 1.0] {
            for ring in LodController::new(&header, tolerance, 1.0).rings() {
                assert_eq!(ring.grid, header.grid_of(ring.tolerance));
            }
        }
    }

    #[test]
    fn the_finest_ring_follows_the_speed_and_does_not_flicker() {
        let mut controller = LodController::new(&header(&[0.0, 0.1, 0.2, 0.4]), 0.0, 1.0);
        let (reach, operations) = (0.01, 32.0);
        // 4096 faces a unit square, a strip of 0.02 and a cell of 1/16.
        let greatest = controller.greatest_speed(0, reach, operations);
        assert!((greatest - 32.0 / (4096.0 * (0.02 + 0.0625))).abs() < 1e-12);
        let mut last = 0;
        for k in 0..400 {
            let finest =
                controller.finest_at_speed(greatest * 0.05 * f64::from(k), reach, operations);
            assert!(finest >= last && finest <= last + 1, "one ring at a time");
            controller.set_finest(finest);
            last = finest;
        }
        assert_eq!(last, 3);
        controller.set_finest(0);
        assert_eq!(
            controller.finest_at_speed(0.99 * greatest, reach, operations),
            0
        );
        controller.set_finest(1);
        assert_eq!(
            controller.finest_at_speed(0.99 * greatest, reach, operations),
            1
        );
        assert_eq!(
            controller.finest_at_speed(0.79 * greatest, reach, operations),
            0
        );
    }
}
