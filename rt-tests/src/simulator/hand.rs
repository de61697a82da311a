//! The simulated device in the hand that leads it along a tour: the loop is closed.

use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{Device, Sample, Simulated};
use hrtc_core::ModelFrame;
use hrtc_core::script::Script;
use protocol::TourPoint;
use scene::SimulatedDevicePlan;

/// A device and the tour that it is led along.
#[derive(Debug, Clone)]
pub struct Hand {
    device: Simulated,
    script: Script,
    tour: Vec<TourPoint>,
    period_s: f64,
}

impl Hand {
    /// At the start of a tour, which has at least one point.
    #[must_use]
    pub fn new(plan: SimulatedDevicePlan, period_s: f64, tour: Vec<TourPoint>) -> Self {
        Self {
            device: Simulated::new(plan, period_s),
            script: Script::default(),
            tour,
            period_s,
        }
    }

    /// The sample of a tick that is `ticks` periods into the tour; ticks must not go back.
    pub fn sample(&mut self, ticks: u64, frame: &ModelFrame) -> Option<Sample> {
        let t = ticks as f64 * self.period_s;
        if let Some(intent) = self.script.along_tour(&self.tour, frame, t) {
            self.device.intend(intent);
        }
        self.device.read(1)
    }

    /// A sample at rest where the tour begins, for the time until it does.
    #[must_use]
    pub fn rest(&self, frame: &ModelFrame) -> Option<Sample> {
        let first = self.tour.first()?;
        let position = DVec3::from_array(first.position) - frame.origin;
        Some(Sample {
            pose: Pose::at(frame.to_world(position)),
        })
    }

    /// The device feels this until the next sample.
    pub fn feel(&mut self, wrench: Wrench) {
        self.device.write(wrench);
    }
}
