//! A motion and how far from it a tool may stray: the places of which the surface near the tool is known.

use super::shape::ToolShape;
use crate::contact::motion::{Placement, Twist};

/// Halvings by which a share of a motion is found.
const HALVINGS: i32 = 6;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub struct LookAheadTube {
    start: Placement,
    path: Twist,
    /// No pair of faces that comes nearer than this anywhere on the way is left out, model units; negative where nothing is
    /// known.
    margin: f64,
    /// What the arcs of the tool's points stray from straight lines on the way.
    bend: f64,
    /// Greatest distance of the tool's points from its centre, and its radius of gyration.
    radius: f64,
    gyration: f64,
    /// How far from its place on the way a point of the tool is now, at the most.
    off: f64,
}

impl LookAheadTube {
    /// No place.
    pub fn nowhere() -> Self {
        Self {
            start: Placement::NOWHERE,
            path: Twist::default(),
            margin: f64::NEG_INFINITY,
            bend: 0.0,
            radius: 0.0,
            gyration: 0.0,
            off: 0.0,
        }
    }

    /// The places of a way from a start, with room for straying by `stray` where nothing may come nearer than `distance`.
    pub fn along(
        start: Placement,
        path: Twist,
        distance: f64,
        skin: f64,
        shape: &ToolShape,
    ) -> Self {
        let bend = path.sagitta(shape.radius);
        Self {
            start,
            path,
            // A step on it bends no more than it does.
            margin: distance + skin + 2.0 * bend,
            bend,
            radius: shape.radius,
            gyration: shape.gyration,
            off: 0.0,
        }
    }

    /// Where it begins and ends.
    pub fn ends(&self) -> [Placement; 2] {
        [self.start, self.start.moved(&self.path)]
    }

    /// The margin around the straight lines on which the tool's points get from start to end.
    pub fn straight_margin(&self) -> f64 {
        self.margin + self.bend
    }

    /// How far what comes within a distance of the straight lines strays, seen from the tool, from the straight line between
    /// where it is seen first and last: the bound of [`Twist::sagitta`] with what a turning frame adds.
    pub fn bend_seen(&self, distance: f64) -> f64 {
        let (turn, path) = (self.path.angular.length(), self.path.linear.length());
        let farthest = self.radius + distance + path;
        self.bend + 0.125 * turn * (turn * (farthest + path) + 2.0 * path)
    }

    /// The same corridor with another margin around the straight lines.
    pub fn narrowed(self, straight_margin: f64) -> Self {
        Self {
            margin: straight_margin - self.bend,
            ..self
        }
    }

    /// What is left of the margin where the tool is: all pairs nearer than this are known.
    pub fn left(&self) -> f64 {
        self.margin - self.off
    }

    /// No point of the tool gets farther on the way and beside it; not positive where nothing is known.
    pub fn reach(&self) -> f64 {
        self.path.farthest(self.radius) + self.margin
    }

    /// The tool has come to a place.
    pub fn move_to(&mut self, place: &Placement) {
        self.off = self.deviation_at(place);
    }

    /// Whether on a motion from where the tool is (`from`) every pair that comes nearer than a distance is known.
    pub fn covers(&self, from: &Placement, motion: &Twist, distance: f64) -> bool {
        let off = self.deviation_at(&from.moved(motion)).max(self.off);
        off + self.bend + motion.sagitta(self.radius) <= self.margin - distance
    }

    /// The share of a motion for which that holds, within a 64th of what is in reach.
    pub fn covered_share(&self, from: &Placement, motion: &Twist, distance: f64) -> f64 {
        if self.covers(from, motion, distance) {
            return 1.0;
        }
        let within = (self.reach() / motion.farthest(self.radius)).clamp(0.0, 1.0);
        (1..=HALVINGS).fold(0.0, |share, k| {
            let farther = share + within * 0.5f64.powi(k);
            if self.covers(from, &motion.times(farther), distance) {
                farther
            } else {
                share
            }
        })
    }

    /// How far the tool's points at a place are from those at a place on the way beside it, at the most.
    fn deviation_at(&self, place: &Placement) -> f64 {
        let square = self.gyration * self.gyration;
        let product =
            |a: &Twist, b: &Twist| a.linear.dot(b.linear) + square * a.angular.dot(b.angular);
        let length = product(&self.path, &self.path);
        let share = if length > 0.0 {
            (product(&self.start.to(place), &self.path) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let beside = self.start.moved(&self.path.times(share));
        beside.to(place).farthest(self.radius)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64).prop_map(DVec3::from_array)
    }

    fn twist() -> impl Strategy<Value = Twist> {
        (vector(), vector()).prop_map(|(linear, angular)| Twist { linear, angular })
    }

    const RADIUS: f64 = 1.5;
    /// Places on the way that are looked at.
    const PLACES: u32 = 400;

    proptest! {
        /// Wherever a tool is on a covered motion, a place on the way is nearer to all of its points than the margin.
        #[test]
        fn what_is_covered_is_beside_the_way(
            turn in vector(), path in twist(), from in 0.0..1.0f64, off in twist(), motion in twist(),
            size in 0.01..0.5f64, corner in vector(),
        ) {
            let start = Placement { centre: DVec3::X, orientation: DQuat::from_scaled_axis(turn) };
            let mut tube = LookAheadTube {
                start,
                path,
                margin: 1.0,
                bend: path.sagitta(RADIUS),
                radius: RADIUS,
                gyration: 1.0,
                off: 0.0,
            };
            let here = start.moved(&path.times(from)).moved(&off.times(0.1));
            tube.move_to(&here);
            let share = tube.covered_share(&here, &motion.times(size), 0.2);
            let motion = motion.times(size * share);
            prop_assert!(share == 0.0 || tube.covers(&here, &motion, 0.2));
            if share > 0.0 {
                let arm = corner.normalize_or(DVec3::X) * RADIUS;
                let point = |at: &Placement| at.centre + at.rotation() * arm;
                for part in 0..=8 {
                    let there = point(&here.moved(&motion.times(0.125 * f64::from(part))));
                    let nearest = (0..=PLACES).map(|k| {
                        let beside = start.moved(&path.times(f64::from(k) / f64::from(PLACES)));
                        point(&beside).distance(there)
                    });
                    let between = path.farthest(RADIUS) / f64::from(PLACES);
                    prop_assert!(nearest.fold(f64::INFINITY, f64::min) <= 0.8 + between);
                }
            }
        }
    }
}
