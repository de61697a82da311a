//! The paths of the probes up to a tick.

use glam::DVec3;
use hrtc::recorder::Twin;
use hrtc::tick_record::TickRecord;
use std::collections::VecDeque;

/// Length of a path, seconds: long enough to see where the probe came from, short enough that it
/// does not cover the object.
pub const TRAIL_S: f64 = 3.0;

/// A point of a probe's path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Where the probe was: its proxy, in free space the device, metres.
    pub at: DVec3,
    /// The force on the hand, newtons; `None` in free space.
    pub force_n: Option<f64>,
}

/// The newest part of each probe's path.
#[derive(Debug, Clone, PartialEq)]
pub struct Trails {
    ticks: usize,
    paths: Vec<VecDeque<PathPoint>>,
}

impl Trails {
    /// Empty paths of so many probes.
    #[must_use]
    pub fn new(probes: usize, rate_hz: f64) -> Self {
        Self {
            ticks: (TRAIL_S * rate_hz).ceil() as usize,
            paths: vec![VecDeque::new(); probes],
        }
    }

    /// Adds a tick.
    pub fn take(&mut self, record: &TickRecord, twin: &Twin) {
        for (k, path) in self.paths.iter_mut().enumerate() {
            let contact = record.contacts[k];
            let proxy = contact.and_then(|of| twin.controller().proxy_of(k, of.object as usize));
            let device = record.samples[k].map(|sample| sample.pose.position);
            let Some(at) = proxy.or(device) else { continue };
            let force_n = contact.map(|_| record.wrenches[k].force.length());
            path.push_back(PathPoint { at, force_n });
            if path.len() > self.ticks {
                path.pop_front();
            }
        }
    }

    /// The paths, the oldest point first.
    #[must_use]
    pub fn paths(&self) -> Vec<Vec<PathPoint>> {
        self.paths
            .iter()
            .map(|path| path.iter().copied().collect())
            .collect()
    }
}
