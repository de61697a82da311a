//! The device of a probe, and the scene's path that leads it.

use geometry::Pose;
use haptic_device::{GuardedDevice, Intent, Sample, TickTime};
use hrtc_core::script::Script;
use hrtc_core::{Controller, ModelFrame};
use protocol::TourPoint;
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
    /// Whether the hand goes back along its tour at the end, instead of resting there.
    turns_back: bool,
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
            turns_back: false,
        }
    }

    /// The same with a hand that goes back and forth along its tour, or rests at its end.
    pub fn turning_back(mut self, turns_back: bool) -> Self {
        self.turns_back = turns_back;
        self
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
        let beyond = || beyond_end(points, &frame, t);
        let beyond = self.turns_back.then(beyond).flatten();
        let mut intent = match beyond {
            Some(intent) => intent,
            None => self.script.along_tour(points, &frame, t)?,
        };
        // The path moves with its object: to the pose at the end of the coming period.
        let carried = controller.carried(object, intent.pose.position);
        intent.pose.position += carried.linear;
        intent.velocity += carried.linear * rate_hz;
        Some(intent)
    }
}

/// The intent after the end of a tour: back along it to its begin, forth again, and so on. `None`
/// up to the end, and where the tour has no length.
fn beyond_end(points: &[TourPoint], frame: &ModelFrame, t: f64) -> Option<Intent> {
    let (first, last) = (points.first()?.t, points.last()?.t);
    let (length, beyond) = (last - first, t - last);
    if !(length > 0.0 && beyond > 0.0) {
        return None;
    }
    let turns = (beyond / length).floor();
    let gone = beyond - turns * length;
    let is_back = (turns as u64).is_multiple_of(2);
    let at = if is_back { last - gone } else { first + gone };
    let next = points.partition_point(|point| point.t <= at);
    let next = next.clamp(1, points.len() - 1);
    let intent = Script::default().along_tour(&points[next - 1..=next], frame, at)?;
    if !is_back {
        return Some(intent);
    }
    Some(Intent {
        velocity: -intent.velocity,
        angular_velocity: -intent.angular_velocity,
        ..intent
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// In a run that is longer than its tour.
    #[test]
    fn after_the_end_of_a_tour_the_hand_goes_back_and_forth_along_it() {
        let point = |k: u32| TourPoint {
            t: 0.005 * f64::from(k),
            position: [0.001 * f64::from(k), 0.0, 0.0],
            orientation_wxyz: [1.0, 0.0, 0.0, 0.0],
        };
        let points: Vec<TourPoint> = (0..=10).map(point).collect();
        let frame = ModelFrame {
            pose: Pose::IDENTITY,
            metres_per_unit: 1.0,
            origin: DVec3::ZERO,
        };
        let at = |t: f64| beyond_end(&points, &frame, t);
        for t in [0.0, 0.02, 0.05] {
            assert!(at(t).is_none(), "{t} s lie within it");
        }
        // It takes 50 ms for 10 mm.
        for (t, x, speed) in [
            (0.052, 0.0096, -0.2),
            (0.08, 0.004, -0.2),
            (0.098, 0.0004, -0.2),
            (0.102, 0.0004, 0.2),
            (0.13, 0.006, 0.2),
            (0.152, 0.0096, -0.2),
            (3600.032, 0.0064, 0.2),
        ] {
            let intent = at(t).expect("it is over");
            assert!((intent.pose.position.x - x).abs() < 1e-9, "{t}: {intent:?}");
            assert!((intent.velocity.x - speed).abs() < 1e-9, "{t}: {intent:?}");
        }
        assert!(beyond_end(&points[..1], &frame, 1.0).is_none());
    }
}
