//! Changes of a force, and what is not felt of them.

use super::setup::Setup;
use glam::DVec3;
use std::collections::VecDeque;

/// Changes of a force over a millisecond, or over a tick where that is longer.
#[derive(Debug)]
pub struct Changes {
    setup: Setup,
    /// The forces of the last ticks, newtons, the oldest first, and the change to each that the
    /// device's own motion explains.
    last: VecDeque<(DVec3, f64)>,
}

impl Changes {
    /// From a force on.
    #[must_use]
    pub fn new(setup: &Setup, force: DVec3) -> Self {
        Self {
            setup: *setup,
            last: VecDeque::from([(force, 0.0)]),
        }
    }

    /// The force of the next tick: its change beyond its `own`, which the device's motion
    /// explains, over what is not felt.
    pub fn add(&mut self, force: DVec3, own: f64) -> f64 {
        let ticks = self.setup.ticks(1) as usize;
        self.last.push_back((force, own));
        if self.last.len() > ticks + 1 {
            self.last.pop_front();
        }
        let (before, _) = self.last[0];
        let own: f64 = self.last.iter().skip(1).map(|(_, own)| own).sum();
        let allowed = ticks as f64 * self.setup.unfelt_n(before.length());
        (force.distance(before) - own) / allowed
    }
}
