//! A path as a polyline, walked in equal steps.

use glam::DVec3;
use std::collections::VecDeque;

/// What a part of the path is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leg {
    /// Approach, lift, travel.
    Free,
    /// Pressing and sliding.
    Slide,
}

/// A corner of the path, or a point on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    pub position: DVec3,
    /// Direction of the tool, away from the surface; unit length.
    pub axis: DVec3,
    /// What the way to here is for.
    pub leg: Leg,
}

/// Walks a polyline in steps of equal length, measured along it: so no step is longer, whatever its
/// corners.
#[derive(Debug)]
pub struct Resampler {
    step: f64,
    corners: VecDeque<Sample>,
    at: Option<Sample>,
}

impl Resampler {
    /// With steps of this length.
    pub fn new(step: f64) -> Self {
        Self {
            step,
            corners: VecDeque::new(),
            at: None,
        }
    }

    /// Adds a corner.
    pub fn push(&mut self, position: DVec3, axis: DVec3, leg: Leg) {
        self.corners.push_back(Sample {
            position,
            axis,
            leg,
        });
    }

    /// The point one step on (at first, the first corner); `None` when more corners are needed.
    pub fn next(&mut self) -> Option<Sample> {
        let Some(mut at) = self.at else {
            self.at = self.corners.pop_front();
            return self.at;
        };
        let mut left = self.step;
        for (passed, corner) in self.corners.iter().enumerate() {
            let distance = corner.position.distance(at.position);
            if distance >= left {
                let share = left / distance;
                let axis = at.axis.lerp(corner.axis, share).normalize_or(at.axis);
                let sample = Sample {
                    position: at.position.lerp(corner.position, share),
                    axis,
                    leg: corner.leg,
                };
                self.corners.drain(..passed);
                self.at = Some(sample);
                return Some(sample);
            }
            left -= distance;
            at = *corner;
        }
        None
    }

    /// What the way to the last point was for.
    #[cfg(test)]
    pub fn leg(&self) -> Option<Leg> {
        self.at.map(|at| at.leg)
    }
}
