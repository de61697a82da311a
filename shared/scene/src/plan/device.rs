//! The device that moves a probe.

use std::path::PathBuf;

/// Steps of the simulated device's integrator in a period of the loop: 16 a millisecond, so that
/// what it does hardly depends on the rate, and at least 4.
#[must_use]
pub fn device_steps(period_s: f64) -> u32 {
    ((16e3 * period_s).round() as u32).max(4)
}

/// The simulated device: a damped rigid body, moved by a hand and by the rendered wrench. Its
/// centre of mass is at the position of the probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimulatedDevicePlan {
    /// kg.
    pub mass_kg: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
    /// Encoder step, metres; 0 for none.
    pub encoder_m: f64,
    /// The hand.
    pub hand: HandImpedance,
    /// Its rotation. `None`: the orientation is the one that the hand wants, and no torque is
    /// rendered, as for a ball, which has none.
    pub rotation: Option<DeviceRotationPlan>,
    /// Whether the orientation is sensed; else that of every sample is the identity.
    pub senses_rotation: bool,
}

impl SimulatedDevicePlan {
    /// Radius of gyration of the default handle, metres: that of a stylus 0.1 m long, held in its
    /// middle (L / sqrt 12).
    pub const GYRATION_M: f64 = 0.03;

    /// Whether it renders torque.
    #[must_use]
    pub fn renders_torque(&self) -> bool {
        self.rotation.is_some_and(|rotation| rotation.is_rendered)
    }
}

impl Default for SimulatedDevicePlan {
    /// A small desktop device with the stylus of a pen's weight in two fingers; as for a ball,
    /// without a rotation of its own.
    fn default() -> Self {
        Self {
            mass_kg: 0.1,
            damping_ns_per_m: 1.0,
            encoder_m: 1e-5,
            hand: HandImpedance {
                stiffness_n_per_m: 200.0,
                damping_ns_per_m: 2.0,
            },
            rotation: None,
            senses_rotation: true,
        }
    }
}

/// Rotation of the simulated device about its position. Its moment of inertia is the same about
/// every axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviceRotationPlan {
    /// Moment of inertia, kg m².
    pub inertia_kgm2: f64,
    /// N m s/rad.
    pub damping_nms_per_rad: f64,
    /// Encoder step, radians; 0 for none.
    pub encoder_rad: f64,
    /// Spring between the orientation that the hand wants and that of the device, N m/rad.
    pub hand_stiffness_nm_per_rad: f64,
    /// Damper between the two, N m s/rad.
    pub hand_damping_nms_per_rad: f64,
    /// Whether the device renders torque.
    pub is_rendered: bool,
}

impl DeviceRotationPlan {
    /// The rotation of a handle whose parts move as the translation of the device does: what a
    /// metre per second is there, a radian per second is at the radius of gyration
    /// [`SimulatedDevicePlan::GYRATION_M`].
    #[must_use]
    pub fn of_handle(device: &SimulatedDevicePlan) -> Self {
        let square = SimulatedDevicePlan::GYRATION_M * SimulatedDevicePlan::GYRATION_M;
        Self {
            inertia_kgm2: device.mass_kg * square,
            damping_nms_per_rad: device.damping_ns_per_m * square,
            encoder_rad: device.encoder_m / SimulatedDevicePlan::GYRATION_M,
            hand_stiffness_nm_per_rad: device.hand.stiffness_n_per_m * square,
            hand_damping_nms_per_rad: device.hand.damping_ns_per_m * square,
            is_rendered: true,
        }
    }
}

/// A device that a program registers by name.
#[derive(Debug, Clone, PartialEq)]
pub struct CustomDevicePlan {
    /// Its name in the registry.
    pub name: String,
    /// The file of the command line that describes it; `None` for the scene itself.
    pub file: Option<PathBuf>,
    /// Line of the file or scene that names it, from 1.
    pub line: usize,
    /// All other keys of its table, for its constructor.
    pub settings: toml::Table,
}

/// Spring and damper between the hand's intended position and the device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandImpedance {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
}
