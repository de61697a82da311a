//! The device that moves a probe.

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
    pub hand: Hand,
}

/// A spring and damper to the intended position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hand {
    /// N/m.
    pub stiffness_n_per_m: f64,
    /// N s/m.
    pub damping_ns_per_m: f64,
}
