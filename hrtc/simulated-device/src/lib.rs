//! The simulated device: a damped rigid body, its encoders, and a hand that holds it.
//!
//! The loop through it is closed: the rendered wrench moves the body, and the body moves the probe.
//! A rendering that is unstable in a hand is therefore unstable here as well.
//!
//! # Equations of motion
//! With the pose (x, q), the velocities v and ω, the rendered wrench (F, τ), and a hand that wants
//! (x', q', v', ω'):
//! - `m dv/dt = F + k (x' - x) + c (v' - v) - b v`
//! - `I dω/dt = τ + k_r φ + c_r (ω' - ω) - b_r ω`, where φ is the rotation vector from q to q', by
//!   the shorter way. The torque of the spring is the gradient of its energy `k_r φ² / 2`.
//!
//! The centre of mass is at x, and I is the same about every axis, so neither couples to the other
//! and there is no gyroscopic torque.
//!
//! # Integrator
//! Semi-implicit (symplectic) Euler, [`device_steps`] steps a period: a spring alone
//! neither gains nor loses energy over many periods, so that what a rendering puts out shows. The
//! orientation goes on by the exponential of `ω dt`. The damping is explicit in translation and
//! implicit in rotation; a scene whose parameters are not stable so is refused when it is read.
//!
//! ```
//! use haptic_device::{Device, Intent, Pose, TickTime};
//! use scene::SimulatedDevicePlan;
//! use simulated_device::SimulatedDevice;
//!
//! let plan = SimulatedDevicePlan { encoder_m: 0.0, ..SimulatedDevicePlan::default() };
//! let mut device = SimulatedDevice::new(plan, 1e-3);
//! assert!(device.read(TickTime::default()).is_none(), "nobody holds it yet");
//! let pose = Pose::at(glam::DVec3::Z);
//! device.intend(Intent::still(pose));
//! assert_eq!(device.read(TickTime::default()).unwrap().pose, pose);
//! ```

#![forbid(unsafe_code)]

use geometry::portable::{rotation, rotation_vector, slerp};
use geometry::{Pose, Wrench};
use glam::{DQuat, DVec3};
use haptic_device::{
    Capabilities, DegreesOfFreedom, Device, Intent, Sample, TickTime, WrenchCommand,
};
use scene::{DeviceRotationPlan, SimulatedDevicePlan, device_steps};

/// Force limit of the simulated motors, newtons: that of a small desktop device.
const MAX_FORCE_N: f64 = 10.0;
/// Torque limit of the simulated motors, newton metres: that of a desktop device which renders
/// torque.
const MAX_TORQUE_NM: f64 = 0.4;
/// Longest time that one read simulates, seconds: bounds the work after a stall.
const MAX_STALL_S: f64 = 1.0;

/// True state of a simulated device, without its encoders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceState {
    /// Pose, metres.
    pub pose: Pose,
    /// Velocity, m/s.
    pub velocity: DVec3,
    /// Angular velocity, rad/s.
    pub angular_velocity: DVec3,
    /// Work of the rendered wrench over the true motion so far, joules: the energy that the
    /// rendering has put out, whatever the controller's own account of it says.
    pub work_j: f64,
    /// Energy that the device's own dampers took so far, without the hand's, joules.
    pub damped_j: f64,
}

/// A rigid body at the end of springs and dampers that the hand holds.
#[derive(Debug, Clone)]
pub struct SimulatedDevice {
    plan: SimulatedDevicePlan,
    period_s: f64,
    /// Steps of the integrator in a period.
    steps: u32,
    state: DeviceState,
    command: WrenchCommand,
    intent: Option<Intent>,
    /// Where the hand was led to by the last sample.
    led_to: Option<Pose>,
}

impl SimulatedDevice {
    /// At rest, held by nobody: it gives no sample until the hand intends something.
    #[must_use]
    pub fn new(plan: SimulatedDevicePlan, period_s: f64) -> Self {
        Self {
            plan,
            period_s,
            steps: device_steps(period_s),
            state: DeviceState {
                pose: Pose::IDENTITY,
                velocity: DVec3::ZERO,
                angular_velocity: DVec3::ZERO,
                work_j: 0.0,
                damped_j: 0.0,
            },
            command: WrenchCommand::unlimited(Wrench::ZERO),
            intent: None,
            led_to: None,
        }
    }

    /// True state, without the encoders.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        self.state
    }

    /// Moves on for some time, seconds, under a constant rendered wrench, in
    /// [`device_steps`] of a period that end where the hand intends to be. The last command is
    /// left as it is. For loops that are not those of [`Device::read`] and [`Device::write`].
    pub fn hold(&mut self, rendered: Wrench, seconds: f64) {
        if let Some(intent) = self.intent {
            self.advance(intent, rendered, seconds);
        }
    }

    /// The sample that the encoders give now; its time is 0.
    #[must_use]
    pub fn sample(&self) -> Sample {
        let DeviceState { pose, velocity, .. } = self.state;
        let encoder = self.plan.encoder_m;
        let position = if encoder > 0.0 {
            (pose.position / encoder).round() * encoder
        } else {
            pose.position
        };
        let encoder = self.plan.rotation.map_or(0.0, |of| of.encoder_rad);
        let orientation = match (self.plan.senses_rotation, encoder > 0.0) {
            (false, _) => DQuat::IDENTITY,
            (true, false) => pose.orientation,
            (true, true) => {
                let turned = rotation_vector(pose.orientation);
                rotation((turned / encoder).round() * encoder)
            }
        };
        Sample {
            linear_velocity: Some(velocity),
            in_hand: Some(true),
            ..Sample::at(Pose {
                position,
                orientation,
            })
        }
    }

    /// A time under a constant rendered wrench.
    fn advance(&mut self, intent: Intent, rendered: Wrench, seconds: f64) {
        let steps = self.steps;
        let dt = seconds / f64::from(steps);
        let plan = &self.plan;
        let state = &mut self.state;
        for step in 1..=steps {
            let to_end = f64::from(steps - step) * dt;
            let target = intent.pose.position - intent.velocity * to_end;
            let hand = (target - state.pose.position) * plan.hand.stiffness_n_per_m
                + (intent.velocity - state.velocity) * plan.hand.damping_ns_per_m;
            let drag = state.velocity * plan.damping_ns_per_m;
            let force = rendered.force + hand - drag;
            state.velocity += force * (dt / plan.mass_kg);
            let moved = state.velocity * dt;
            state.pose.position += moved;
            state.work_j += rendered.force.dot(moved);
            state.damped_j += drag.dot(moved);
            match &plan.rotation {
                None => {
                    state.pose.orientation = intent.pose.orientation;
                    state.angular_velocity = intent.angular_velocity;
                }
                Some(rotation) => turn(state, rotation, &intent, rendered.torque, [dt, to_end]),
            }
        }
    }

    /// What the hand intends at the end of a period that is so many before the last of `periods`.
    fn intent_before(&self, intent: Intent, periods: u32, left: u32) -> Intent {
        let Some(from) = self.led_to.filter(|_| periods > 1) else {
            return intent;
        };
        let share = f64::from(periods - left) / f64::from(periods);
        let seconds = f64::from(periods) * self.period_s;
        let turn = intent.pose.orientation * from.orientation.conjugate();
        Intent {
            pose: Pose {
                position: from.position.lerp(intent.pose.position, share),
                orientation: slerp(from.orientation, intent.pose.orientation, share),
            },
            velocity: (intent.pose.position - from.position) / seconds,
            angular_velocity: rotation_vector(turn) / seconds,
        }
    }

    /// The wrench of the motors in the period that ends so many periods before a time: zero once
    /// the command is no longer valid.
    fn wrench_before(&self, time: TickTime, periods: u32) -> Wrench {
        let period_ns = (self.period_s * 1e9) as u64;
        let begin = time
            .start_ns
            .saturating_sub(period_ns * (u64::from(periods) + 1));
        if begin < self.command.valid_until_ns {
            self.command.wrench
        } else {
            Wrench::ZERO
        }
    }
}

/// A step of the rotation, `[dt, to_end]` seconds long and before the end of the intent.
fn turn(
    state: &mut DeviceState,
    plan: &DeviceRotationPlan,
    intent: &Intent,
    rendered: DVec3,
    [dt, to_end]: [f64; 2],
) {
    let target = rotation(intent.angular_velocity * -to_end) * intent.pose.orientation;
    let away = rotation_vector(target * state.pose.orientation.conjugate());
    let hand = away * plan.hand_stiffness_nm_per_rad
        + intent.angular_velocity * plan.hand_damping_nms_per_rad;
    let torque = if plan.is_rendered {
        rendered
    } else {
        DVec3::ZERO
    };
    let gain = dt / plan.inertia_kgm2;
    let damping = plan.damping_nms_per_rad + plan.hand_damping_nms_per_rad;
    let velocity = (state.angular_velocity + (torque + hand) * gain) / (1.0 + damping * gain);
    let turned = velocity * dt;
    state.angular_velocity = velocity;
    state.pose.orientation = (rotation(turned) * state.pose.orientation).normalize();
    state.work_j += torque.dot(turned);
    state.damped_j += plan.damping_nms_per_rad * velocity.dot(turned);
}

impl Device for SimulatedDevice {
    fn capabilities(&self) -> Capabilities {
        let six = |is_six: bool| {
            if is_six {
                DegreesOfFreedom::Six
            } else {
                DegreesOfFreedom::Three
            }
        };
        let rotation = self.plan.rotation;
        let renders_torque = self.plan.renders_torque();
        Capabilities {
            sensed: six(self.plan.senses_rotation),
            rendered: six(renders_torque),
            max_torque_nm: if renders_torque { MAX_TORQUE_NM } else { 0.0 },
            position_resolution_m: self.plan.encoder_m,
            orientation_resolution_rad: rotation.map_or(0.0, |of| of.encoder_rad),
            ..Capabilities::translational("simulated", MAX_FORCE_N)
        }
    }

    fn read(&mut self, time: TickTime) -> Option<Sample> {
        let intent = self.intent?;
        // The wrench has acted during skipped periods too, and the hand has gone on evenly.
        let most = (MAX_STALL_S / self.period_s).ceil() as u32;
        for left in (0..time.periods.min(most)).rev() {
            let wrench = self.wrench_before(time, left);
            let intent = self.intent_before(intent, time.periods, left);
            self.advance(intent, wrench, self.period_s);
        }
        self.led_to = Some(intent.pose);
        Some(Sample {
            time_ns: time.start_ns,
            ..self.sample()
        })
    }

    fn write(&mut self, command: WrenchCommand) {
        self.command = command;
    }

    fn safe_off(&mut self) {
        self.command = WrenchCommand::unlimited(Wrench::ZERO);
    }

    /// Sets the hand's target; the first one also puts the device there.
    fn intend(&mut self, intent: Intent) {
        if self.intent.is_none() {
            self.state.pose = intent.pose;
            self.state.velocity = intent.velocity;
            self.state.angular_velocity = intent.angular_velocity;
        }
        self.intent = Some(intent);
    }
}

#[cfg(test)]
mod tests;
