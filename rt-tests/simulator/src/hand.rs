//! The hand that holds the simulated device. The loop through both is closed: the force moves the
//! device, and the device moves the probe.

use geometry::{Pose, Wrench};
use glam::DVec3;
use haptic_device::{Device, Intent, Sample, TickTime, WrenchCommand};
use hrtc_core::script::Script;
use hrtc_core::{Controller, ModelFrame};
use protocol::TourPoint;
use scene::SimulatedDevicePlan;
use simulated_device::{DeviceState, SimulatedDevice};
use std::slice::from_ref;

/// The path of a hand.
#[derive(Debug, Clone)]
enum Path {
    /// None yet: the hand waits for the station's tour.
    Unknown,
    /// Points of the scene: time in seconds from the first tick, pose in the world.
    Points(Vec<(f64, Pose)>),
    /// A tour of which only the first point is there: the hand waits at it.
    Begin { object: usize, point: TourPoint },
    /// A tour over an object, in its file's frame, from a tick on.
    Tour {
        object: usize,
        points: Vec<TourPoint>,
        start: u64,
    },
}

/// A simulated device in a hand.
#[derive(Debug, Clone)]
pub struct Hand {
    device: SimulatedDevice,
    script: Script,
    path: Path,
    period_s: f64,
    /// Time of the path at which it stops and stays, seconds.
    stop_s: f64,
    /// Where it is led instead of along its path.
    led_to: Option<Intent>,
}

impl Hand {
    /// A hand without a path; a period of the device takes `period_s`.
    #[must_use]
    pub fn new(plan: SimulatedDevicePlan, period_s: f64) -> Self {
        Self {
            device: SimulatedDevice::new(plan, period_s),
            script: Script::default(),
            path: Path::Unknown,
            period_s,
            stop_s: f64::INFINITY,
            led_to: None,
        }
    }

    /// Along points: time in seconds, pose in the world.
    #[must_use]
    pub fn along_points(mut self, points: Vec<(f64, Pose)>) -> Self {
        self.path = Path::Points(points);
        self
    }

    /// Along a tour over the first object, which begins at tick 0.
    #[must_use]
    pub fn along_tour(mut self, points: Vec<TourPoint>) -> Self {
        self.path = Path::Tour {
            object: 0,
            points,
            start: 0,
        };
        self
    }

    /// Stops at this time of the path, in seconds, and stays.
    pub fn stop_at(&mut self, seconds: f64) {
        self.stop_s = seconds;
    }

    /// Holds the device at a pose instead of following the path; `None` ends that.
    pub fn hold_at(&mut self, pose: Option<Pose>) {
        self.led_to = pose.map(Intent::still);
    }

    /// Leads the device by this intent in every tick to come instead of along the path.
    pub fn lead_to(&mut self, intent: Intent) {
        self.led_to = Some(intent);
    }

    /// The sample of a tick of the tour of the first object, whose frame is given; ticks must not
    /// go back.
    pub fn sample(&mut self, tick: u64, frame: &ModelFrame) -> Option<Sample> {
        self.intend(tick, |_| Some(*frame));
        self.read(1)
    }

    /// A sample at rest at the beginning of the tour.
    #[must_use]
    pub fn start(&self, frame: &ModelFrame) -> Option<Sample> {
        let Path::Tour { points, .. } = &self.path else {
            return None;
        };
        let position = DVec3::from_array(points.first()?.position) - frame.origin;
        Some(Sample::at(Pose::at(frame.to_world(position))))
    }

    /// The device after so many periods under the force that it has.
    pub fn read(&mut self, periods: u32) -> Option<Sample> {
        self.read_at(0, periods)
    }

    /// The same at a time, ns.
    pub(crate) fn read_at(&mut self, start_ns: u64, periods: u32) -> Option<Sample> {
        self.device.read(TickTime { start_ns, periods })
    }

    /// The wrench acts on the device until the next sample.
    pub fn feel(&mut self, wrench: Wrench) {
        self.obey(WrenchCommand::unlimited(wrench));
    }

    /// The wrench acts until the next sample, or its end.
    pub(crate) fn obey(&mut self, command: WrenchCommand) {
        self.device.write(command);
    }

    /// True state of the device, without its encoders.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        self.device.state()
    }

    /// Decides where to go in a tick; waits where the station's tour of its probe begins, and takes
    /// it over when it is there.
    pub(crate) fn follow(&mut self, tick: u64, controller: &Controller, probe: usize) {
        if matches!(self.path, Path::Unknown | Path::Begin { .. }) {
            let whole = controller
                .tour_of(probe)
                .map(|(object, points)| Path::Tour {
                    object,
                    points: points.to_vec(),
                    start: tick,
                });
            let begin = controller.tour_begin_of(probe);
            let begin = begin.map(|(object, &point)| Path::Begin { object, point });
            self.path = whole.or(begin).unwrap_or(Path::Unknown);
        }
        self.intend(tick, |object| controller.frame_of(object));
    }

    fn intend(&mut self, tick: u64, frame_of: impl Fn(usize) -> Option<ModelFrame>) {
        let seconds = |ticks: u64| ticks as f64 * self.period_s;
        let intent = match (&self.path, self.led_to) {
            (_, Some(intent)) => Some(intent),
            (Path::Unknown, None) => None,
            (Path::Points(points), None) => {
                let t = seconds(tick);
                let intent = self.script.along_points(points, t.min(self.stop_s));
                intent.map(|intent| stopped(intent, t >= self.stop_s))
            }
            (Path::Begin { object, point }, None) => frame_of(*object)
                .and_then(|frame| self.script.along_tour(from_ref(point), &frame, 0.0)),
            (
                Path::Tour {
                    object,
                    points,
                    start,
                },
                None,
            ) => frame_of(*object).and_then(|frame| {
                let t = seconds(tick - start);
                let intent = self.script.along_tour(points, &frame, t.min(self.stop_s));
                intent.map(|intent| stopped(intent, t >= self.stop_s))
            }),
        };
        if let Some(intent) = intent {
            self.device.intend(intent);
        }
    }
}

/// The intent, at rest once it has stopped.
fn stopped(intent: Intent, has_stopped: bool) -> Intent {
    if has_stopped {
        Intent::still(intent.pose)
    } else {
        intent
    }
}
