//! Values beside the scene that make a controller. A recording holds them, so that a replay makes
//! the same controller.

use haptic_device::{Capabilities, DegreesOfFreedom, MotionLimits};
use hrtc_core::governor::WorkCosts;
use hrtc_core::streaming::subscriber::Identity;
use hrtc_core::{Controller, ControllerOptions, WrenchLimits};
use scene::{DeviceRotationPlan, ScenePlan};
use serde::{Deserialize, Serialize};

/// Identity of a controller and the limits of its devices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ControllerSetup {
    /// Id of the client, the same after a restart or not.
    pub client: u64,
    /// Different at every start.
    pub incarnation: u64,
    /// Most force of any probe, newtons: that of the strongest device, or of this machine.
    pub max_force_n: f64,
    /// The same of a torque, newton metres.
    pub max_torque_nm: f64,
    /// Limits of each probe: its device's, or this machine's; force, newtons; torque, newton
    /// metres.
    pub wrench_limits: Vec<[f64; 2]>,
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
        let limits = devices.clone().map(limits_of);
        let most = |of: usize| limits.clone().map(|limits| limits[of]).fold(0.0, f64::max);
        Self {
            client: identity.client,
            incarnation: identity.incarnation,
            max_force_n: most(0),
            max_torque_nm: most(1),
            wrench_limits: limits.clone().collect(),
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
        let own = [limits.max_force_n, limits.max_torque_nm].map(|of| of.unwrap_or(f64::MAX));
        self.max_force_n = self.max_force_n.min(own[0]);
        self.max_torque_nm = self.max_torque_nm.min(own[1]);
        for [force_n, torque_nm] in &mut self.wrench_limits {
            *force_n = force_n.min(own[0]);
            *torque_nm = torque_nm.min(own[1]);
        }
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

    /// The limits of each probe.
    fn limits(&self) -> Vec<WrenchLimits> {
        let limits = self.wrench_limits.iter();
        limits
            .map(|&[force_n, torque_nm]| WrenchLimits { force_n, torque_nm })
            .collect()
    }

    /// Puts the steps of the devices into the scene's plan and makes the controller, with their
    /// limits.
    #[must_use]
    pub fn controller(&self, plan: &mut ScenePlan) -> Controller {
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
        let options = ControllerOptions {
            limits: &self.limits(),
            tour_seconds: self.tour_seconds,
        };
        let mut controller = Controller::new(plan, self.identity(), options);
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

/// Force and torque of a device; where it renders no torque, that has no limit.
fn limits_of(device: &Capabilities) -> [f64; 2] {
    let torque_nm = match device.rendered {
        DegreesOfFreedom::Six => device.max_torque_nm,
        DegreesOfFreedom::Three => f64::MAX,
    };
    // JSON has no infinity.
    [device.max_force_n, torque_nm].map(|limit| limit.min(f64::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Pose;
    use glam::DVec3;
    use haptic_device::Sample;
    use hrtc_core::streaming::chunk::InboxChunk;
    use hrtc_core::{NoObserver, TickInputs};
    use protocol::Request;
    use scene::{NoFiles, Overrides, parse};
    use spm::{SpmFile, write_spm};
    use spm_builder::generate::{Shape, generate};
    use spm_builder::{BuildOptions, NoProgress, build_model};
    use station_core::station::{Message, ServedModel, ServedObject, Station};
    use std::path::Path;

    const IDENTITY: Identity = Identity {
        client: 1,
        incarnation: 1,
    };

    /// A station with a ball of a thousand faces.
    fn station() -> Station<Vec<u8>> {
        let mesh = generate(Shape::Sphere, 1000, 1);
        let parts = build_model(mesh, &BuildOptions::default(), &NoProgress).unwrap();
        let mut bytes = Vec::new();
        write_spm(&parts, &mut bytes).unwrap();
        let name = "ball.spm".to_owned();
        let object = ServedObject {
            model: 0,
            name: Request::name_hash(&name),
        };
        let file = SpmFile::open(bytes).unwrap();
        Station::new(1, vec![ServedModel { name, file }], vec![object])
    }

    /// The most force of each of two probes that press onto the ball from both sides.
    fn most_forces(setup: &ControllerSetup) -> [f64; 2] {
        let text = "[[object]]\nmodel = \"ball.spm\"\nsize_m = 0.1\n[[probe]]\n[[probe]]\n";
        let overrides = Overrides::default();
        let mut plan = parse(text, "ball", Path::new(""), &overrides, &NoFiles).unwrap();
        let mut controller = setup.controller(&mut plan);
        let mut outputs = controller.new_outputs();
        let (mut station, mut inbox) = (station(), Vec::<InboxChunk>::new());
        let mut most = [0.0; 2];
        for tick in 0..2000u64 {
            let height = 0.06 - 0.015 * (tick as f64 / 1000.0).min(1.0);
            let at = |side: f64| Some(Sample::at(Pose::at(DVec3::Z * (side * height))));
            let inputs = TickInputs {
                tick,
                samples: &[at(1.0), at(-1.0)],
                station: 1,
                chunks: [&inbox, &[]],
                stopping: false,
            };
            controller.tick(&inputs, &mut outputs, &mut NoObserver);
            inbox.drain(..outputs.chunks_consumed);
            for request in outputs.outbox.requests() {
                station.handle(Message::Request(request));
            }
            station.tell_time((1000 * tick) as u32);
            while let Some((header, slots)) = station.poll(IDENTITY.client) {
                inbox.push(InboxChunk { header, slots });
            }
            for (most, wrench) in most.iter_mut().zip(&outputs.wrenches) {
                *most = wrench.force.length().max(*most);
            }
        }
        most
    }

    #[test]
    fn each_probe_has_the_force_of_its_own_device_or_of_a_lower_limit_of_all() {
        let devices = [0.5, 1.0].map(|force_n| Capabilities::translational("arm", force_n));
        let setup = ControllerSetup::new(IDENTITY, devices.iter(), 1.0);
        assert_eq!(setup.max_force_n, 1.0);
        let told = ForceLimits {
            max_force_n: Some(0.75),
            ..ForceLimits::default()
        };
        for (setup, limits) in [
            (setup.clone(), [0.5, 1.0]),
            (setup.within(told), [0.5, 0.75]),
        ] {
            let most = most_forces(&setup);
            for (most, limit) in most.iter().zip(limits) {
                let reached = 0.99 * limit..=limit;
                assert!(reached.contains(most), "{most} N, limit {limit} N");
            }
        }
    }

    #[test]
    fn each_probe_has_the_torque_of_its_own_device() {
        let arm = |rendered, max_torque_nm| Capabilities {
            rendered,
            max_torque_nm,
            ..Capabilities::translational("arm", f64::INFINITY)
        };
        let (three, six) = (DegreesOfFreedom::Three, DegreesOfFreedom::Six);
        let devices = [arm(three, 0.0), arm(six, 0.1), arm(six, 0.4)];
        let setup = ControllerSetup::new(IDENTITY, devices.iter(), 1.0);
        let most = f64::MAX;
        assert_eq!(
            setup.wrench_limits,
            [[most, most], [most, 0.1], [most, 0.4]]
        );
        let told = ForceLimits {
            max_force_n: Some(5.0),
            max_torque_nm: Some(0.2),
        };
        let setup = setup.within(told);
        assert_eq!(setup.wrench_limits, [[5.0, 0.2], [5.0, 0.1], [5.0, 0.2]]);
        assert_eq!([setup.max_force_n, setup.max_torque_nm], [5.0, 0.2]);
    }

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
            let setup = ControllerSetup::new(IDENTITY, [&arm].into_iter(), 1.0);
            drop(setup.controller(&mut plan));
            let rotation = plan.probes[0].device.rotation;
            let step = rotation.map(|rotation| rotation.encoder_rad);
            assert_eq!(step, Some(0.033), "{shape}");
        }
    }
}
