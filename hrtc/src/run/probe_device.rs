//! The device of a probe, and the scene's path that leads it.

use geometry::Pose;
use haptic_device::{GuardedDevice, Intent, Sample, TickTime};
use hrtc_core::Controller;
use hrtc_core::script::Script;
use scene::{ProbePlan, TrajectoryPlan};
use std::slice::from_ref;

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
        if let Some(intent) = self.intent(probe, controller, tick, rate_hz) {
            self.device.intend(intent);
        }
        self.device.read(time)
    }

    /// Where the hand is led: nowhere before it is known where its path begins.
    fn intent(
        &mut self,
        probe: usize,
        controller: &Controller,
        tick: u64,
        rate_hz: f64,
    ) -> Option<Intent> {
        let start = &mut self.start;
        let mut t = || (tick - *start.get_or_insert(tick)) as f64 / rate_hz;
        if !self.points.is_empty() {
            return self.script.along_points(&self.points, t());
        }
        // The hand waits where its tour begins, as one does that is about to touch: what it needs
        // there comes meanwhile.
        let whole = controller.tour_of(probe);
        let begin = || controller.tour_begin_of(probe);
        let (object, points) =
            whole.or_else(|| begin().map(|(of, point)| (of, from_ref(point))))?;
        let frame = controller.frame_of(object)?;
        let t = if whole.is_some() { t() } else { 0.0 };
        let mut intent = self.script.along_tour(points, &frame, t)?;
        // The path moves with its object: to the pose at the end of the coming period.
        let carried = controller.carried(object, intent.pose.position);
        intent.pose.position += carried.linear;
        intent.velocity += carried.linear * rate_hz;
        Some(intent)
    }
}
