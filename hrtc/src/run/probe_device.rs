//! The device of a probe, and the scene's path that leads it.

use geometry::Pose;
use haptic_device::{GuardedDevice, Sample, TickTime};
use hrtc_core::Controller;
use hrtc_core::script::Script;
use scene::{ProbePlan, TrajectoryPlan};

/// A device and its path.
pub(super) struct ProbeDevice {
    pub device: GuardedDevice,
    script: Script,
    /// Points of the scene, seconds and poses; none for a tour.
    points: Vec<(f64, Pose)>,
    /// Tick in which the path began.
    start: Option<u64>,
}

impl ProbeDevice {
    /// A device before the first point of its path.
    pub fn new(device: GuardedDevice, probe: &ProbePlan) -> Self {
        Self {
            device,
            script: Script::default(),
            points: match &probe.trajectory {
                TrajectoryPlan::Points(points) => points.clone(),
                TrajectoryPlan::Tour { .. } => Vec::new(),
            },
            start: None,
        }
    }

    /// Asks for the path's next pose and reads the device.
    pub fn sample(
        &mut self,
        probe: usize,
        controller: &Controller,
        tick: u64,
        rate_hz: f64,
        time: TickTime,
    ) -> Option<Sample> {
        self.intend(probe, controller, tick, rate_hz);
        self.device.read(time)
    }

    fn intend(&mut self, probe: usize, controller: &Controller, tick: u64, rate_hz: f64) {
        let t = |start: u64| (tick - start) as f64 / rate_hz;
        let intent = if self.points.is_empty() {
            let Some((object, tour)) = controller.tour_of(probe) else {
                return;
            };
            let Some(frame) = controller.frame_of(object) else {
                return;
            };
            let from = *self.start.get_or_insert(tick);
            let intent = self.script.along_tour(tour, &frame, t(from));
            intent.map(|mut intent| {
                // The path moves with its object: to the pose at the end of the coming period.
                let carried = controller.carried(object, intent.pose.position);
                intent.pose.position += carried.linear;
                intent.velocity += carried.linear * rate_hz;
                intent
            })
        } else {
            let from = *self.start.get_or_insert(tick);
            self.script.along_points(&self.points, t(from))
        };
        if let Some(intent) = intent {
            self.device.intend(intent);
        }
    }
}
