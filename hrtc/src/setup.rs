//! Values beside the scene that make a controller. A recording holds them, so that a replay makes
//! the same controller.

use haptic_device::{Capabilities, DegreesOfFreedom, MotionLimits};
use hrtc_core::Controller;
use hrtc_core::governor::WorkCosts;
use hrtc_core::streaming::subscriber::Identity;
use scene::{DeviceRotationPlan, ScenePlan};
use serde::{Deserialize, Serialize};

/// Identity of a controller and the limits of its devices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ControllerSetup {
    /// Id of the client, the same after a restart or not.
    pub client: u64,
    /// Different at every start.
    pub incarnation: u64,
    /// Limit of the force of the weakest device, newtons.
    pub max_force_n: f64,
    /// Limit of the torque of the weakest device that renders torque, newton metres.
    pub max_torque_nm: f64,
    /// Position resolution of each probe's device, metres.
    pub position_resolutions_m: Vec<f64>,
    /// Orientation resolution of each probe's device, radians.
    pub orientation_resolutions_rad: Vec<f64>,
    /// Whether each probe's device renders torque; in a recording without this list, all do.
    #[serde(default)]
    pub renders_torque: Vec<bool>,
    /// Limits of the motion of each probe's device: speed, m/s; acceleration, m/s²; angular speed,
    /// rad/s.
    pub motion_limits: Vec<[f64; 3]>,
    /// Length of a tour, seconds.
    pub tour_seconds: f64,
    /// Whether the station is on another machine; in a recording without this, it is not known to
    /// be.
    #[serde(default)]
    pub station_is_far: bool,
    /// What the counted work costs on the controller's machine; in a recording without this, as on
    /// the reference machine.
    #[serde(default)]
    pub costs: WorkCosts,
}

/// Limits of force that the controller's own machine states. They hold whatever scene and devices
/// say: of all limits the least one counts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ForceLimits {
    /// Newtons, above 0.
    pub max_force_n: Option<f64>,
    /// Newton metres, above 0.
    pub max_torque_nm: Option<f64>,
}

impl ControllerSetup {
    /// A controller with these devices, one a probe.
    #[must_use]
    pub fn new<'a>(
        identity: Identity,
        devices: impl Iterator<Item = &'a Capabilities> + Clone,
        tour_seconds: f64,
    ) -> Self {
        let torques = devices
            .clone()
            .filter(|device| device.rendered == DegreesOfFreedom::Six)
            .map(|device| device.max_torque_nm);
        let forces = devices.clone().map(|device| device.max_force_n);
        Self {
            client: identity.client,
            incarnation: identity.incarnation,
            // JSON has no infinity.
            max_force_n: forces.fold(f64::MAX, f64::min),
            max_torque_nm: torques.fold(f64::MAX, f64::min),
            position_resolutions_m: devices
                .clone()
                .map(|device| device.position_resolution_m)
                .collect(),
            orientation_resolutions_rad: devices
                .clone()
                .map(|device| device.orientation_resolution_rad)
                .collect(),
            renders_torque: devices
                .clone()
                .map(|device| device.rendered == DegreesOfFreedom::Six)
                .collect(),
            motion_limits: devices
                .map(|device| {
                    let of = device.motion;
                    let limits = [
                        of.speed_m_per_s,
                        of.acceleration_m_per_s2,
                        of.angular_speed_rad_per_s,
                    ];
                    limits.map(|limit| limit.min(f64::MAX))
                })
                .collect(),
            tour_seconds,
            station_is_far: false,
            costs: WorkCosts::REFERENCE,
        }
    }

    /// The same within these limits too.
    #[must_use]
    pub fn within(mut self, limits: ForceLimits) -> Self {
        let least = |limit: f64, own: Option<f64>| limit.min(own.unwrap_or(f64::MAX));
        self.max_force_n = least(self.max_force_n, limits.max_force_n);
        self.max_torque_nm = least(self.max_torque_nm, limits.max_torque_nm);
        self
    }

    /// The identity towards the station.
    #[must_use]
    pub fn identity(&self) -> Identity {
        Identity {
            client: self.client,
            incarnation: self.incarnation,
        }
    }

    /// Puts the limits into the scene's plan and makes the controller.
    #[must_use]
    pub fn controller(&self, plan: &mut ScenePlan) -> Controller {
        plan.safety.torque_max_nm = plan.safety.torque_max_nm.min(self.max_torque_nm);
        for (probe, &resolution_m) in plan.probes.iter_mut().zip(&self.position_resolutions_m) {
            probe.device.encoder_m = resolution_m;
        }
        let resolutions = &self.orientation_resolutions_rad;
        for (probe, &resolution_rad) in plan.probes.iter_mut().zip(resolutions) {
            let device = &mut probe.device;
            if resolution_rad > 0.0 && device.rotation.is_none() {
                // A custom device measures the turn of a ball too, though that renders no torque.
                device.rotation = Some(DeviceRotationPlan {
                    is_rendered: false,
                    ..DeviceRotationPlan::of_handle(device)
                });
            }
            if let Some(rotation) = &mut device.rotation {
                rotation.encoder_rad = resolution_rad;
            }
        }
        let mut controller =
            Controller::new(plan, self.identity(), self.max_force_n, self.tour_seconds);
        controller.set_costs(self.costs);
        if self.station_is_far {
            controller.station_is_far();
        }
        for (probe, &[speed, acceleration, angular_speed]) in self.motion_limits.iter().enumerate()
        {
            let limits = MotionLimits {
                speed_m_per_s: speed,
                acceleration_m_per_s2: acceleration,
                angular_speed_rad_per_s: angular_speed,
            };
            controller.set_motion_limits(probe, limits);
        }
        for (probe, &renders_torque) in self.renders_torque.iter().enumerate() {
            let rendered = if renders_torque {
                DegreesOfFreedom::Six
            } else {
                DegreesOfFreedom::Three
            };
            controller.set_rendered(probe, rendered);
        }
        controller
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::{NoFiles, Overrides, parse};
    use std::path::Path;

    #[test]
    fn the_angular_step_of_a_custom_device_counts_for_a_ball_and_for_a_tool() {
        let (ball, tool) = (
            "",
            "shape = { capsule = { radius_m = 0.005, length_m = 0.1 } }",
        );
        for shape in [ball, tool] {
            let text = format!(
                "[[object]]\nmodel = \"none.spm\"\nsize_m = 0.1\n[[probe]]\n\
                 device = {{ custom = {{ name = \"arm\" }} }}\n{shape}\n"
            );
            let overrides = Overrides::default();
            let mut plan = parse(&text, "arm", Path::new(""), &overrides, &NoFiles).unwrap();
            let arm = Capabilities {
                sensed: DegreesOfFreedom::Six,
                orientation_resolution_rad: 0.033,
                ..Capabilities::translational("arm", 5.0)
            };
            let identity = Identity {
                client: 1,
                incarnation: 1,
            };
            let setup = ControllerSetup::new(identity, [&arm].into_iter(), 1.0);
            drop(setup.controller(&mut plan));
            let rotation = plan.probes[0].device.rotation;
            let step = rotation.map(|rotation| rotation.encoder_rad);
            assert_eq!(step, Some(0.033), "{shape}");
        }
    }
}
