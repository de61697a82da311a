//! Cells that a motion meets, and when it comes and leaves.

use crate::horizons::PredictionHorizons;
use crate::tuning::prediction::SIDEWAYS;
use glam::{DVec3, UVec3};
use spm::{RegionGrid, RegionId};

/// Start of a prediction; model frame and units.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Motion {
    /// The probe's centre (the proxy, in contact).
    pub position: DVec3,
    /// Radius of the probe.
    pub radius: f64,
    /// Surely no surface is nearer to the centre than this.
    pub clearance: f64,
}

/// Ticks until the probe may be in a cell: it moves on with its velocity, or to a side with a share
/// of it.
pub(super) fn ticks_until(
    grid: &RegionGrid,
    id: RegionId,
    (motion, velocity): (Motion, DVec3),
    horizons: &PredictionHorizons,
) -> f64 {
    let displacement = grid.towards(id, motion.position);
    let distance = displacement.length();
    let left = distance - motion.radius;
    if left <= 0.0 {
        return 0.0;
    }
    let speed = velocity.length();
    let ahead = velocity.dot(displacement) / distance;
    left / (ahead.max(SIDEWAYS * speed) + grid.cell / horizons.drift)
}

/// Ticks until the probe has left a cell with its velocity; infinite at rest.
pub(super) fn ticks_to_leave(
    grid: &RegionGrid,
    id: RegionId,
    (motion, velocity): (Motion, DVec3),
) -> f64 {
    let (lower, upper) = grid.cell_box(id);
    let mut ticks = f64::INFINITY;
    for axis in 0..3 {
        let speed = velocity[axis].abs();
        let left = if velocity[axis] > 0.0 {
            upper[axis] - motion.position[axis]
        } else {
            motion.position[axis] - lower[axis]
        };
        if speed > 0.0 {
            ticks = ticks.min((left + motion.radius) / speed);
        }
    }
    ticks
}

/// Visits the regions whose cells meet a ball. A ball of more than `max_cells` is cut down: no
/// unbounded loop, whatever the speed.
pub(super) fn visit_ball(
    grid: &RegionGrid,
    centre: DVec3,
    (radius, max_cells): (f64, f64),
    mut visit: impl FnMut(RegionId),
) {
    let radius = radius.min(max_cells * grid.cell);
    let Some((low, high)) = grid.cell_range(centre - radius, centre + radius) else {
        return;
    };
    for z in low.z..=high.z {
        for y in low.y..=high.y {
            for x in low.x..=high.x {
                let id = RegionId::of_cell(UVec3::new(x, y, z));
                if grid.distance_squared(id, centre) <= radius * radius {
                    visit(id);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_left_behind_its_far_wall_and_never_at_rest() {
        let grid = RegionGrid::new(DVec3::ZERO, DVec3::ONE, 16).unwrap();
        let motion = Motion {
            position: DVec3::splat(8.25 / 16.0),
            radius: 0.01,
            clearance: 0.0,
        };
        let here = grid.region_of_point(motion.position);
        let leaves = |velocity| ticks_to_leave(&grid, here, (motion, velocity));
        assert_eq!(leaves(DVec3::ZERO), f64::INFINITY);
        let far = 0.75 / 16.0 + 0.01;
        let near = 0.25 / 16.0 + 0.01;
        let ticks = |velocity: DVec3, expected: f64| {
            assert!(
                (leaves(velocity) / expected - 1.0).abs() < 1e-12,
                "{velocity}"
            );
        };
        ticks(DVec3::new(1e-3, 0.0, 0.0), far / 1e-3);
        ticks(DVec3::new(-1e-3, 0.0, 0.0), near / 1e-3);
        // The first wall that is passed counts.
        ticks(DVec3::new(1e-3, -1e-4, 0.0), far / 1e-3);
        ticks(DVec3::new(1e-3, 0.0, -1e-3), near / 1e-3);
    }
}
