//! Objects that move: free, on a hinge, on a rail, or driven.
//!
//! The touch couples a body and the device through a spring of stiffness K and damping B, once a tick of period T. At
//! the place and in the direction where a body of mass m gives way most it acts like a smaller mass m': of a box 1/m'
//! is at most 7/m (1/m along, 6/m by turning, at a corner), on a hinge less, on a rail 1/m. Semi-implicit steps hold
//! such a coupling up to K T² + 2 B T = 4 m', but beyond 1 m' the force of a single tick throws the body farther than
//! the depth that it came from, out of the touch again: force, none, force. So a body must have m' of at least
//! n (K T² + 2 B T), for n probes that may push it at once.

use super::{LENGTH, MAX, Range, SceneError, Source};
use crate::plan::{ModelScale, ScenePlan};
use crate::typed::ObjectTyped;
use glam::DVec3;
use serde::Deserialize;
use toml::Spanned;

/// Objects of a scene that move, at the most: all awake at once take some fifty microseconds of a tick.
pub const MAX_MOVABLES: usize = 128;
/// 1/m' of a box of mass m, in units of 1/m, at the most.
const MAX_MOBILITY: f64 = 7.0;
/// Rotation that a driven object may make in a tick, radians: farther, a way round is no short way any more.
const MAX_TURN: f64 = 0.5;

/// How an object moves. Axes and places are in the axes of the object's pose, seen from its position, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MovablePlan {
    /// In six degrees of freedom.
    Free(FreePlan),
    /// About an axis.
    Hinge(HingePlan),
    /// Along an axis.
    Rail(RailPlan),
    /// By time alone, whatever pushes.
    Driven(DrivenPlan),
}

/// What is pushed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassPlan {
    /// kg, above 0.
    pub mass_kg: f64,
    /// Moments of inertia about the middle of the model's box, along its axes, kg m²; those of a solid box if `None`.
    pub inertia_kgm2: Option<DVec3>,
    /// Acceleration that acts on it everywhere, m/s², in the axes of the world.
    pub gravity_m_per_s2: DVec3,
}

/// What brings a motion to rest: N/m and N s/m, or N m/rad and N m s/rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestPlan {
    /// Back to where the scene puts it; 0 for none.
    pub spring: f64,
    /// Against the motion; `None`: the motion fades to a third within half a second, and a spring does not swing.
    pub damping: Option<f64>,
}

/// A free body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreePlan {
    /// What is pushed.
    pub mass: MassPlan,
    /// Of the middle of its box.
    pub linear: RestPlan,
    /// Of its rotation.
    pub angular: RestPlan,
}

/// A body on a hinge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HingePlan {
    /// What is pushed.
    pub mass: MassPlan,
    /// Unit vector.
    pub axis: DVec3,
    /// A point of the axis.
    pub anchor_m: DVec3,
    /// Of its rotation.
    pub turn: RestPlan,
    /// Least and largest angle from where the scene puts it, radians, around 0.
    pub limits_rad: Option<[f64; 2]>,
}

/// A body on a rail.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RailPlan {
    /// What is pushed.
    pub mass: MassPlan,
    /// Unit vector.
    pub axis: DVec3,
    /// Of its way.
    pub slide: RestPlan,
    /// Least and largest way from where the scene puts it, metres, around 0.
    pub limits_m: Option<[f64; 2]>,
}

/// An object that moves by itself from the first tick on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrivenPlan {
    /// Velocity, m/s; with a period the greatest.
    pub linear_m_per_s: DVec3,
    /// Angular velocity, rad/s; with a period the greatest.
    pub angular_rad_per_s: DVec3,
    /// What it turns about.
    pub anchor_m: DVec3,
    /// There and back, as a sine, in so many seconds; `None`: on and on.
    pub period_s: Option<f64>,
}

impl MovablePlan {
    /// What is pushed; nothing of what is driven.
    #[must_use]
    pub fn mass(&self) -> Option<&MassPlan> {
        match self {
            Self::Free(plan) => Some(&plan.mass),
            Self::Hinge(plan) => Some(&plan.mass),
            Self::Rail(plan) => Some(&plan.mass),
            Self::Driven(_) => None,
        }
    }

    /// What resists a push where and in the direction in which it does so least, at the least: m', kg, of an object
    /// of this longest side (metres; only needed where the inertia is given).
    #[must_use]
    pub fn least_mass(&self, longest_side: f64) -> f64 {
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

/// The least m' (see the module), kg, that a surface of stiffness N/m and damping N s/m can couple to, with ticks of
/// so many seconds and so many probes.
#[must_use]
pub fn least_coupled_mass(
    stiffness_n_per_m: f64,
    damping_ns_per_m: f64,
    period_s: f64,
    probes: usize,
) -> f64 {
    let of_one = period_s * (stiffness_n_per_m * period_s + 2.0 * damping_ns_per_m);
    of_one * probes as f64
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MovableTyped {
    Free(FreeTyped),
    Hinge(HingeTyped),
    Rail(RailTyped),
    Driven(DrivenTyped),
}

type Number = Option<Spanned<f64>>;
type Vector = Option<Spanned<[f64; 3]>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct FreeTyped {
    mass_kg: Spanned<f64>,
    inertia_kgm2: Vector,
    damping_ns_per_m: Number,
    damping_nms_per_rad: Number,
    spring_n_per_m: Number,
    spring_nm_per_rad: Number,
    gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct HingeTyped {
    axis: Spanned<[f64; 3]>,
    anchor_m: Vector,
    mass_kg: Spanned<f64>,
    inertia_kgm2: Vector,
    damping_nms_per_rad: Number,
    spring_nm_per_rad: Number,
    limits_deg: Option<Spanned<[f64; 2]>>,
    gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RailTyped {
    axis: Spanned<[f64; 3]>,
    mass_kg: Spanned<f64>,
    damping_ns_per_m: Number,
    spring_n_per_m: Number,
    limits_m: Option<Spanned<[f64; 2]>>,
    gravity_m_per_s2: Vector,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DrivenTyped {
    linear_m_per_s: Vector,
    angular_rad_per_s: Vector,
    anchor_m: Vector,
    period_s: Number,
}

impl MovableTyped {
    /// What a body that is too light was given: its mass, and its inertia if there is one.
    fn given(&self) -> Option<(&Spanned<f64>, &Vector)> {
        match self {
            Self::Free(typed) => Some((&typed.mass_kg, &typed.inertia_kgm2)),
            Self::Hinge(typed) => Some((&typed.mass_kg, &typed.inertia_kgm2)),
            Self::Rail(typed) => Some((&typed.mass_kg, &None)),
            Self::Driven(_) => None,
        }
    }
}

/// Checks every number by itself.
pub(super) fn movable_plan(
    source: &Source,
    typed: &MovableTyped,
) -> Result<MovablePlan, SceneError> {
    Ok(match typed {
        MovableTyped::Free(typed) => MovablePlan::Free(FreePlan {
            mass: mass(
                source,
                &typed.mass_kg,
                &typed.inertia_kgm2,
                &typed.gravity_m_per_s2,
            )?,
            linear: linear_rest(source, &typed.spring_n_per_m, &typed.damping_ns_per_m)?,
            angular: angular_rest(source, &typed.spring_nm_per_rad, &typed.damping_nms_per_rad)?,
        }),
        MovableTyped::Hinge(typed) => MovablePlan::Hinge(HingePlan {
            mass: mass(
                source,
                &typed.mass_kg,
                &typed.inertia_kgm2,
                &typed.gravity_m_per_s2,
            )?,
            axis: axis(source, &typed.axis)?,
            anchor_m: vector(source, &typed.anchor_m, "anchor_m")?,
            turn: angular_rest(source, &typed.spring_nm_per_rad, &typed.damping_nms_per_rad)?,
            limits_rad: limits(source, &typed.limits_deg, "limits_deg")?
                .map(|limits| limits.map(f64::to_radians)),
        }),
        MovableTyped::Rail(typed) => MovablePlan::Rail(RailPlan {
            mass: mass(source, &typed.mass_kg, &None, &typed.gravity_m_per_s2)?,
            axis: axis(source, &typed.axis)?,
            slide: linear_rest(source, &typed.spring_n_per_m, &typed.damping_ns_per_m)?,
            limits_m: limits(source, &typed.limits_m, "limits_m")?,
        }),
        MovableTyped::Driven(typed) => MovablePlan::Driven(DrivenPlan {
            linear_m_per_s: vector(source, &typed.linear_m_per_s, "linear_m_per_s")?,
            angular_rad_per_s: vector(source, &typed.angular_rad_per_s, "angular_rad_per_s")?,
            anchor_m: vector(source, &typed.anchor_m, "anchor_m")?,
            period_s: typed
                .period_s
                .as_ref()
                .map(|period| source.number(Some(period), "period_s", 0.0, Range::Positive(MAX)))
                .transpose()?,
        }),
    })
}

/// Checks what depends on the loop, on the probes and on the size that the command line may have changed: `tables`,
/// each with the objects that it made.
pub(super) fn check<'a>(
    source: &Source,
    tables: impl Iterator<Item = (&'a ObjectTyped, &'a std::ops::Range<usize>)>,
    plan: &ScenePlan,
) -> Result<(), SceneError> {
    let rate_hz = plan.loop_.rate_hz;
    let mut moving = 0;
    for (table, copies) in tables {
        let Some(typed) = &table.movable else {
            continue;
        };
        moving += copies.len();
        if moving > MAX_MOVABLES {
            return Err(source.value(
                typed,
                &format!("these are more than {MAX_MOVABLES} objects that move, the most that a tick has time for; let others stand, or make fewer copies"),
            ));
        }
        let object = &plan.objects[copies.start];
        let Some(movable) = &object.movable else {
            continue;
        };
        if let (MovableTyped::Driven(typed), MovablePlan::Driven(driven)) =
            (typed.get_ref(), movable)
            && let Some(angular) = &typed.angular_rad_per_s
            && driven.angular_rad_per_s.length() > MAX_TURN * rate_hz
        {
            return Err(source.value(
                angular,
                &format!(
                    "angular_rad_per_s turns the object by more than {MAX_TURN} rad in a tick of {rate_hz} a second; write at most {} rad/s",
                    MAX_TURN * rate_hz
                ),
            ));
        }
        let Some((mass, inertia)) = typed.get_ref().given() else {
            continue;
        };
        let longest_side = match (object.scale, inertia) {
            (ModelScale::Size(metres), _) => metres,
            (ModelScale::MetresPerUnit(_), None) => 0.0,
            (ModelScale::MetresPerUnit(_), Some(inertia)) => {
                return Err(source.value(
                    inertia,
                    "inertia_kgm2 can only be checked against a size: give the object size_m instead of metres_per_unit, or leave inertia_kgm2 out",
                ));
            }
        };
        let surface = &object.surface;
        let least = least_coupled_mass(
            surface.stiffness_n_per_m,
            surface.damping_ns_per_m,
            1.0 / rate_hz,
            plan.probes.len(),
        );
        let found = movable.least_mass(longest_side);
        if found >= least {
            continue;
        }
        let too_light = format!(
            "too light for {} probe(s) on a surface of {} N/m and {} N s/m at {rate_hz} ticks a second, each of which would throw it off; make the surface softer, the loop faster, or write",
            plan.probes.len(),
            surface.stiffness_n_per_m,
            surface.damping_ns_per_m,
        );
        let given = *mass.get_ref();
        let needed = given * least / found;
        return Err(match inertia {
            None => source.value(
                mass,
                &format!("mass_kg is {given}, {too_light} mass_kg = {needed:.3e} or more"),
            ),
            Some(inertia) => source.value(
                inertia,
                &format!(
                    "mass_kg and inertia_kgm2 are {too_light} {:.3} times both or more",
                    least / found
                ),
            ),
        });
    }
    Ok(())
}

fn mass(
    source: &Source,
    mass_kg: &Spanned<f64>,
    inertia: &Vector,
    gravity: &Vector,
) -> Result<MassPlan, SceneError> {
    let inertia_kgm2 = match inertia {
        None => None,
        Some(typed) => {
            let moments = DVec3::from_array(*typed.get_ref());
            let sound = moments.min_element() > 0.0 && moments.max_element() <= MAX;
            // None is larger than the two others together: no mass is at a negative distance.
            let most = moments.max_element();
            let rest = moments.element_sum() - most;
            if !sound || most > rest * (1.0 + 1e-9) {
                return Err(source.value(
                    typed,
                    "inertia_kgm2 needs three moments above 0 along the model's axes, none larger than the two others together",
                ));
            }
            Some(moments)
        }
    };
    Ok(MassPlan {
        mass_kg: source.number(Some(mass_kg), "mass_kg", 0.0, Range::Within(1e-9, MAX))?,
        inertia_kgm2,
        gravity_m_per_s2: vector(source, gravity, "gravity_m_per_s2")?,
    })
}

fn linear_rest(source: &Source, spring: &Number, damping: &Number) -> Result<RestPlan, SceneError> {
    rest(
        source,
        [spring, damping],
        ["spring_n_per_m", "damping_ns_per_m"],
    )
}

fn angular_rest(
    source: &Source,
    spring: &Number,
    damping: &Number,
) -> Result<RestPlan, SceneError> {
    rest(
        source,
        [spring, damping],
        ["spring_nm_per_rad", "damping_nms_per_rad"],
    )
}

fn rest(
    source: &Source,
    [spring, damping]: [&Number; 2],
    keys: [&str; 2],
) -> Result<RestPlan, SceneError> {
    let number =
        |typed: &Number, key| source.number(typed.as_ref(), key, 0.0, Range::NotNegative(MAX));
    let given = number(damping, keys[1])?;
    Ok(RestPlan {
        spring: number(spring, keys[0])?,
        damping: damping.as_ref().map(|_| given),
    })
}

fn vector(source: &Source, typed: &Vector, key: &str) -> Result<DVec3, SceneError> {
    let Some(typed) = typed else {
        return Ok(DVec3::ZERO);
    };
    let vector = DVec3::from_array(*typed.get_ref());
    let Range::Within(_, most) = LENGTH else {
        return Ok(vector);
    };
    if vector.abs().cmple(DVec3::splat(most)).all() {
        return Ok(vector);
    }
    Err(source.value(
        typed,
        &format!("{key} needs three numbers, none larger than {most}"),
    ))
}

fn axis(source: &Source, typed: &Spanned<[f64; 3]>) -> Result<DVec3, SceneError> {
    DVec3::from_array(*typed.get_ref())
        .try_normalize()
        .ok_or_else(|| {
            source.value(
                typed,
                "axis has no direction; write three numbers that are not all zero, such as [0, 0, 1]",
            )
        })
}

fn limits(
    source: &Source,
    typed: &Option<Spanned<[f64; 2]>>,
    key: &str,
) -> Result<Option<[f64; 2]>, SceneError> {
    let Some(typed) = typed else {
        return Ok(None);
    };
    let [least, most] = *typed.get_ref();
    // Compared such that what is no number is refused.
    if least.is_finite() && most.is_finite() && least <= 0.0 && most >= 0.0 && least < most {
        return Ok(Some([least, most]));
    }
    Err(source.value(
        typed,
        &format!("{key} is [{least}, {most}]; write the least and then the largest, around 0, which is where the object is put"),
    ))
}

#[cfg(test)]
#[path = "movable_tests.rs"]
mod tests;
