//! Motion of an object: free, on a hinge, on a rail, or driven.
//!
//! A contact couples a body and the device through a spring of stiffness K and damping B, once a
//! tick of period T. At the place and in the direction where a body of mass m yields most, it acts
//! like a smaller mass m'. For a box, 1/m' is at most 7/m (1/m by translation, 6/m by rotation, at
//! a corner); on a hinge it is less, on a rail it is 1/m. Semi-implicit steps hold such a coupling
//! up to K T² + 2 B T = 4 m'. Beyond 1 m' the force of a single tick throws the body farther than
//! the depth that caused it, out of contact again, so force and no force alternate. A body
//! therefore needs m' of at least n (K T² + 2 B T), for n probes that may push it at once.

use glam::DVec3;

/// Largest number of objects of a scene that move: all awake at once take some 50 µs of a tick.
pub const MAX_MOVABLES: usize = 128;
/// Largest 1/m' of a box of mass m, in units of 1/m.
const MAX_MOBILITY: f64 = 7.0;

/// Motion of an object. Axes and points are in the axes of the object's pose, relative to its
/// position, metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum MovablePlan {
    /// In six degrees of freedom.
    Free(FreePlan),
    /// About an axis.
    Hinge(HingePlan),
    /// Along an axis.
    Rail(RailPlan),
    /// By time alone; forces do not matter.
    Driven(DrivenPlan),
}

/// Mass of a body that forces move.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MassPlan {
    /// kg, above 0.
    pub mass_kg: f64,
    /// Moments of inertia about the middle of the model's box, along its axes, kg m²; those of a
    /// solid box if `None`.
    pub inertia_kgm2: Option<DVec3>,
    /// Constant acceleration, m/s², in the axes of the world.
    pub gravity_m_per_s2: DVec3,
}

/// Spring and damper of a coordinate: N/m and N s/m, or N m/rad and N m s/rad.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct SpringDamperPlan {
    /// Stiffness towards the start; 0 for none.
    pub spring: f64,
    /// Damping. With `None` the motion fades to a third within half a second, and a spring does not
    /// oscillate.
    pub damping: Option<f64>,
}

/// A free body.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FreePlan {
    /// Its mass.
    pub mass: MassPlan,
    /// Of the middle of its box.
    pub linear: SpringDamperPlan,
    /// Of its rotation.
    pub angular: SpringDamperPlan,
}

/// A body on a hinge.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HingePlan {
    /// Its mass.
    pub mass: MassPlan,
    /// Unit vector.
    pub axis: DVec3,
    /// A point of the axis.
    pub anchor_m: DVec3,
    /// Of its angle.
    pub angular: SpringDamperPlan,
    /// Smallest and largest angle from its start, radians; the range contains 0.
    pub limits_rad: Option<[f64; 2]>,
}

/// A body on a rail.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RailPlan {
    /// Its mass.
    pub mass: MassPlan,
    /// Unit vector.
    pub axis: DVec3,
    /// Of its displacement.
    pub linear: SpringDamperPlan,
    /// Smallest and largest displacement from its start, metres; the range contains 0.
    pub limits_m: Option<[f64; 2]>,
}

/// An object that moves by itself from the first tick on.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DrivenPlan {
    /// Velocity, m/s; with a period the largest.
    pub linear_m_per_s: DVec3,
    /// Angular velocity, rad/s; with a period the largest.
    pub angular_rad_per_s: DVec3,
    /// Centre of the rotation.
    pub anchor_m: DVec3,
    /// Period of a sine, there and back, seconds; `None` for constant velocity.
    pub period_s: Option<f64>,
}

impl MovablePlan {
    /// Mass of the body; `None` for a driven object.
    #[must_use]
    pub fn mass(&self) -> Option<&MassPlan> {
        match self {
            Self::Free(plan) => Some(&plan.mass),
            Self::Hinge(plan) => Some(&plan.mass),
            Self::Rail(plan) => Some(&plan.mass),
            Self::Driven(_) => None,
        }
    }

    /// Lower bound of m', the effective mass at any contact (kg), for an object of this longest
    /// side (metres; only needed with a given inertia).
    #[must_use]
    pub fn min_effective_mass(&self, longest_side: f64) -> f64 {
        let Some(mass) = self.mass() else {
            return f64::INFINITY;
        };
        match (self, mass.inertia_kgm2) {
            (Self::Rail(_), _) => mass.mass_kg,
            (_, None) => mass.mass_kg / MAX_MOBILITY,
            (_, Some(inertia)) => {
                // No corner is farther from the middle than half the diagonal of a cube.
                let arm_squared = 0.75 * longest_side * longest_side;
                1.0 / (1.0 / mass.mass_kg + arm_squared / inertia.min_element())
            }
        }
    }
}

/// Smallest m' (kg) that a surface can couple to, from its stiffness (N/m), its damping (N s/m),
/// the period of a tick (seconds) and the number of probes.
#[must_use]
pub fn min_coupled_mass(
    stiffness_n_per_m: f64,
    damping_ns_per_m: f64,
    period_s: f64,
    probes: usize,
) -> f64 {
    let of_one = period_s * (stiffness_n_per_m * period_s + 2.0 * damping_ns_per_m);
    of_one * probes as f64
}
