//! Checks of the objects that move.

use crate::limits::{MAX_COEFFICIENT, MAX_LENGTH_M, MAX_TICK_ROTATION_RAD};
use crate::plan::{
    DrivenPlan, FreePlan, HingePlan, MAX_MOVABLES, MassPlan, ModelScale, MovablePlan, ObjectPlan,
    RailPlan, ScenePlan, SpringDamperPlan, min_coupled_mass,
};
use crate::source::{Range, SceneError, Source};
use crate::typed::{MovableTyped, Number, ObjectTyped, Vector};
use glam::DVec3;
use toml::Spanned;

/// Checks every number on its own.
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
            linear: linear(source, &typed.spring_n_per_m, &typed.damping_ns_per_m)?,
            angular: angular(source, &typed.spring_nm_per_rad, &typed.damping_nms_per_rad)?,
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
            angular: angular(source, &typed.spring_nm_per_rad, &typed.damping_nms_per_rad)?,
            limits_rad: limits(source, &typed.limits_deg, "limits_deg")?
                .map(|limits| limits.map(f64::to_radians)),
        }),
        MovableTyped::Rail(typed) => MovablePlan::Rail(RailPlan {
            mass: mass(source, &typed.mass_kg, &None, &typed.gravity_m_per_s2)?,
            axis: axis(source, &typed.axis)?,
            linear: linear(source, &typed.spring_n_per_m, &typed.damping_ns_per_m)?,
            limits_m: limits(source, &typed.limits_m, "limits_m")?,
        }),
        MovableTyped::Driven(typed) => MovablePlan::Driven(DrivenPlan {
            linear_m_per_s: vector(source, &typed.linear_m_per_s, "linear_m_per_s")?,
            angular_rad_per_s: vector(source, &typed.angular_rad_per_s, "angular_rad_per_s")?,
            anchor_m: vector(source, &typed.anchor_m, "anchor_m")?,
            period_s: typed
                .period_s
                .as_ref()
                .map(|period| {
                    let range = Range::Positive(MAX_COEFFICIENT);
                    source.number(Some(period), "period_s", 0.0, range)
                })
                .transpose()?,
        }),
    })
}

/// Checks against the loop, the probes and the size, which the command line may have changed.
/// `tables` are the object tables, each with the objects that it made.
pub(super) fn check<'a>(
    source: &Source,
    tables: impl Iterator<Item = (&'a ObjectTyped, &'a std::ops::Range<usize>)>,
    plan: &ScenePlan,
) -> Result<(), SceneError> {
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
        check_rotation(source, typed.get_ref(), movable, plan.loop_.rate_hz)?;
        if let Some((mass, inertia)) = typed.get_ref().mass() {
            check_mass(source, mass, inertia, object, movable, plan)?;
        }
    }
    Ok(())
}

/// Refuses a driven rotation that is too fast for the loop.
fn check_rotation(
    source: &Source,
    typed: &MovableTyped,
    movable: &MovablePlan,
    rate_hz: f64,
) -> Result<(), SceneError> {
    if let (MovableTyped::Driven(typed), MovablePlan::Driven(driven)) = (typed, movable)
        && let Some(angular) = &typed.angular_rad_per_s
        && driven.angular_rad_per_s.length() > MAX_TICK_ROTATION_RAD * rate_hz
    {
        return Err(source.value(
            angular,
            &format!(
                "angular_rad_per_s turns the object by more than {MAX_TICK_ROTATION_RAD} rad in a tick of {rate_hz} a second; write at most {} rad/s",
                MAX_TICK_ROTATION_RAD * rate_hz
            ),
        ));
    }
    Ok(())
}

/// Refuses a body that is too light for its surface, the loop and the probes.
fn check_mass(
    source: &Source,
    mass: &Spanned<f64>,
    inertia: &Vector,
    object: &ObjectPlan,
    movable: &MovablePlan,
    plan: &ScenePlan,
) -> Result<(), SceneError> {
    let rate_hz = plan.loop_.rate_hz;
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
    let min = min_coupled_mass(
        surface.stiffness_n_per_m,
        surface.damping_ns_per_m,
        1.0 / rate_hz,
        plan.probes.len(),
    );
    let found = movable.min_effective_mass(longest_side);
    if found >= min {
        return Ok(());
    }
    let too_light = format!(
        "too light for {} probe(s) on a surface of {} N/m and {} N s/m at {rate_hz} ticks a second, each of which would throw it off; make the surface softer, the loop faster, or write",
        plan.probes.len(),
        surface.stiffness_n_per_m,
        surface.damping_ns_per_m,
    );
    let given = *mass.get_ref();
    let needed = given * min / found;
    Err(match inertia {
        None => source.value(
            mass,
            &format!("mass_kg is {given}, {too_light} mass_kg = {needed:.3e} or more"),
        ),
        Some(inertia) => source.value(
            inertia,
            &format!(
                "mass_kg and inertia_kgm2 are {too_light} {:.3} times both or more",
                min / found
            ),
        ),
    })
}

fn mass(
    source: &Source,
    mass_kg: &Spanned<f64>,
    inertia: &Vector,
    gravity: &Vector,
) -> Result<MassPlan, SceneError> {
    let inertia_kgm2 = match inertia {
        None => None,
        Some(typed) => Some(moments(source, typed)?),
    };
    let range = Range::Within(1e-9, MAX_COEFFICIENT);
    Ok(MassPlan {
        mass_kg: source.number(Some(mass_kg), "mass_kg", 0.0, range)?,
        inertia_kgm2,
        gravity_m_per_s2: vector(source, gravity, "gravity_m_per_s2")?,
    })
}

fn moments(source: &Source, typed: &Spanned<[f64; 3]>) -> Result<DVec3, SceneError> {
    let moments = DVec3::from_array(*typed.get_ref());
    let is_positive = moments.min_element() > 0.0 && moments.max_element() <= MAX_COEFFICIENT;
    // No moment exceeds the sum of the two others: no mass is at a negative distance.
    let max = moments.max_element();
    let others = moments.element_sum() - max;
    if !is_positive || max > others * (1.0 + 1e-9) {
        return Err(source.value(
            typed,
            "inertia_kgm2 needs three moments above 0 along the model's axes, none larger than the two others together",
        ));
    }
    Ok(moments)
}

fn linear(
    source: &Source,
    spring: &Number,
    damping: &Number,
) -> Result<SpringDamperPlan, SceneError> {
    let keys = ["spring_n_per_m", "damping_ns_per_m"];
    spring_damper(source, [spring, damping], keys)
}

fn angular(
    source: &Source,
    spring: &Number,
    damping: &Number,
) -> Result<SpringDamperPlan, SceneError> {
    let keys = ["spring_nm_per_rad", "damping_nms_per_rad"];
    spring_damper(source, [spring, damping], keys)
}

fn spring_damper(
    source: &Source,
    [spring, damping]: [&Number; 2],
    keys: [&str; 2],
) -> Result<SpringDamperPlan, SceneError> {
    let range = Range::NotNegative(MAX_COEFFICIENT);
    let number = |typed: &Number, key| source.number(typed.as_ref(), key, 0.0, range);
    let given = number(damping, keys[1])?;
    Ok(SpringDamperPlan {
        spring: number(spring, keys[0])?,
        damping: damping.as_ref().map(|_| given),
    })
}

fn vector(source: &Source, typed: &Vector, key: &str) -> Result<DVec3, SceneError> {
    let Some(typed) = typed else {
        return Ok(DVec3::ZERO);
    };
    let vector = DVec3::from_array(*typed.get_ref());
    if vector.abs().cmple(DVec3::splat(MAX_LENGTH_M)).all() {
        return Ok(vector);
    }
    Err(source.value(
        typed,
        &format!("{key} needs three numbers, none larger than {MAX_LENGTH_M}"),
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
    let [min, max] = *typed.get_ref();
    // NaN fails every comparison, so it is refused.
    if min.is_finite() && max.is_finite() && min <= 0.0 && max >= 0.0 && min < max {
        return Ok(Some([min, max]));
    }
    Err(source.value(
        typed,
        &format!("{key} is [{min}, {max}]; write the least and then the largest, around 0, which is where the object is put"),
    ))
}

#[cfg(test)]
#[path = "movable_tests.rs"]
mod tests;
