//! The device that moves a probe.

use std::path::PathBuf;

/// The simulated device: a damped mass, moved by a hand and by the rendered force.
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
