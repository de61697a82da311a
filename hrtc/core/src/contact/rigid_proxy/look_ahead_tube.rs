//! The look-ahead tube: a path of the tool and the margin around it within which all candidate
//! pairs are known (as the skin of a Verlet list).

use super::shape::ToolShape;
use crate::contact::motion::{Placement, Twist};

/// Bisection steps for the covered share of a motion.
const HALVINGS: i32 = 6;

/// A path from a start, with a margin. Model units.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
pub struct LookAheadTube {
    start: Placement,
    path: Twist,
    /// Every pair of faces that comes nearer than this anywhere on the path is known; negative if
    /// none is.
    margin: f64,
    /// Largest deviation of the tool's points from straight lines on the path.
    bend: f64,
    /// Largest distance of the tool's points from its centre, and its radius of gyration.
    radius: f64,
    gyration: f64,
    /// Upper bound of the current deviation of the tool's points from the path.
    off: f64,
}

impl LookAheadTube {
    /// An empty tube: nothing is known.
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

    /// The tube around a path, for pairs within `distance` of a tool that deviates from the path by
    /// at most `skin`.
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
            // A step on the path bends no more than the path does.
            margin: distance + skin + 2.0 * bend,
            bend,
            radius: shape.radius,
            gyration: shape.gyration,
            off: 0.0,
        }
    }

    /// First and last placement of the path.
    pub fn ends(&self) -> [Placement; 2] {
        [self.start, self.start.moved(&self.path)]
    }

    /// Margin around the straight lines between the first and last positions of the tool's points.
    pub fn straight_margin(&self) -> f64 {
        self.margin + self.bend
    }

    /// Bound of the deviation, in the tool's frame, of points within `distance` from the straight
    /// lines between their first and last positions: [`Twist::sagitta`] plus the part of the
    /// turning frame.
    pub fn bend_seen(&self, distance: f64) -> f64 {
        let (turn, path) = (self.path.angular.length(), self.path.linear.length());
        let farthest = self.radius + distance + path;
        self.bend + 0.125 * turn * (turn * (farthest + path) + 2.0 * path)
    }

    /// The same tube with another margin around the straight lines.
    pub fn narrowed(self, straight_margin: f64) -> Self {
        Self {
            margin: straight_margin - self.bend,
            ..self
        }
    }

    /// The tube of a share of the path, and the margin around its straight lines within which all
    /// pairs are known that are known within `straight_margin` around those of all of it: both
    /// lines are within their bend of the path.
    pub fn shortened(self, share: f64, straight_margin: f64) -> (Self, f64) {
        let path = self.path.times(share);
        let bend = path.sagitta(self.radius);
        let shorter = Self { path, bend, ..self };
        let margin = straight_margin - self.bend - bend;
        (shorter.narrowed(margin), margin)
    }

    /// Validity margin: at the tool's current placement all pairs nearer than this are known.
    pub fn left(&self) -> f64 {
        self.margin - self.off
    }

    /// Upper bound of the motion of a point from the start to any place within the tube; not
    /// positive if nothing is known.
    pub fn reach(&self) -> f64 {
        self.length() + self.margin
    }

    /// Largest motion of a point along the path.
    pub fn length(&self) -> f64 {
        self.path.farthest(self.radius)
    }

    /// Notes the current placement of the tool.
    pub fn move_to(&mut self, place: &Placement) {
        self.off = self.deviation_at(place);
    }

    /// Whether every pair nearer than `distance` is known along a motion from the placement `from`.
    pub fn covers(&self, from: &Placement, motion: &Twist, distance: f64) -> bool {
        self.deviation_on(from, motion) <= self.margin - distance
    }

    /// Upper bound of the distance of the tool's points, on a motion from the placement `from`, to
    /// the straight lines of the path.
    pub fn deviation_on(&self, from: &Placement, motion: &Twist) -> f64 {
        let off = self.deviation_at(&from.moved(motion)).max(self.off);
        off + self.bend + motion.sagitta(self.radius)
    }

    /// The share of a motion that is covered, to a 64th of the reach.
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

    /// Upper bound of the distance between the tool's points at a placement and at the nearest
    /// placement of the path.
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
    /// Samples of the path.
    const PLACES: u32 = 400;

    proptest! {
        /// On a covered motion, every point of the tool is within the margin of its path.
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
