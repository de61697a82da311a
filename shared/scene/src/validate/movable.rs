//! Checks of the objects that move.

use crate::limits::{
    MAX_COEFFICIENT, MAX_TICK_ROTATION_RAD, MIN_PERIOD_TICKS, NOT_NEGATIVE, POSITIVE, Range,
    rounded_up,
};
use crate::plan::{
    DrivenPlan, FreePlan, HingePlan, MAX_MOVABLES, MassPlan, ModelScale, MovablePlan, ObjectPlan,
    RailPlan, ScenePlan, SpringDamperPlan, min_coupled_mass,
};
use crate::source::{Keyed, SceneError, Source, key};
use crate::typed::{MovableTyped, Number, Numbers, ObjectTyped, Vector};
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
                key!(typed.mass_kg),
                &typed.inertia_kgm2,
                key!(typed.gravity_m_per_s2),
            )?,
            linear: spring_damper(
                source,
                key!(typed.spring_n_per_m),
                key!(typed.damping_ns_per_m),
            )?,
            angular: spring_damper(
                source,
                key!(typed.spring_nm_per_rad),
                key!(typed.damping_nms_per_rad),
            )?,
        }),
        MovableTyped::Hinge(typed) => MovablePlan::Hinge(HingePlan {
            mass: mass(
                source,
                key!(typed.mass_kg),
                &typed.inertia_kgm2,
                key!(typed.gravity_m_per_s2),
            )?,
            axis: source.direction(key!(typed.axis))?,
            anchor_m: source.vector_or_zero(key!(typed.anchor_m))?,
            angular: spring_damper(
                source,
                key!(typed.spring_nm_per_rad),
                key!(typed.damping_nms_per_rad),
            )?,
            limits_rad: limits(source, key!(typed.limits_deg))?
                .map(|limits| limits.map(f64::to_radians)),
        }),
        MovableTyped::Rail(typed) => MovablePlan::Rail(RailPlan {
            mass: mass(
                source,
                key!(typed.mass_kg),
                &None,
                key!(typed.gravity_m_per_s2),
            )?,
            axis: source.direction(key!(typed.axis))?,
            linear: spring_damper(
                source,
                key!(typed.spring_n_per_m),
                key!(typed.damping_ns_per_m),
            )?,
            limits_m: limits(source, key!(typed.limits_m))?,
        }),
        MovableTyped::Driven(typed) => MovablePlan::Driven(DrivenPlan {
            linear_m_per_s: source.vector_or_zero(key!(typed.linear_m_per_s))?,
            angular_rad_per_s: source.vector_or_zero(key!(typed.angular_rad_per_s))?,
            anchor_m: source.vector_or_zero(key!(typed.anchor_m))?,
            period_s: source.optional(key!(typed.period_s), POSITIVE)?,
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
        check_driven(source, typed.get_ref(), movable, plan.loop_.rate_hz)?;
        if let Some((mass, inertia)) = typed.get_ref().mass() {
            check_mass(source, mass, inertia, object, movable, plan)?;
        }
    }
    Ok(())
}

/// Refuses a driven motion that is too fast for the loop.
fn check_driven(
    source: &Source,
    typed: &MovableTyped,
    movable: &MovablePlan,
    rate_hz: f64,
) -> Result<(), SceneError> {
    let (MovableTyped::Driven(typed), MovablePlan::Driven(driven)) = (typed, movable) else {
        return Ok(());
    };
    if let Some(angular) = &typed.angular_rad_per_s
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
    let shortest_s = MIN_PERIOD_TICKS / rate_hz;
    if let Some(typed) = &typed.period_s
        && *typed.get_ref() < shortest_s
    {
        return Err(source.value(
            typed,
            &format!(
                "period_s is {}, shorter than {MIN_PERIOD_TICKS} ticks of {rate_hz} a second; write at least {shortest_s}",
                typed.get_ref()
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
            &format!(
                "mass_kg is {given}, {too_light} mass_kg = {:.3e} or more",
                rounded_up(needed)
            ),
        ),
        Some(inertia) => source.value(
            inertia,
            &format!(
                "mass_kg and inertia_kgm2 are {too_light} {:.3} times both or more",
                rounded_up(min / found)
            ),
        ),
    })
}

fn mass(
    source: &Source,
    mass_kg: Keyed<Spanned<f64>>,
    inertia: &Vector,
    gravity: Keyed<Vector>,
) -> Result<MassPlan, SceneError> {
    let moments = |typed| moments(source, typed);
    Ok(MassPlan {
        inertia_kgm2: inertia.as_ref().map(moments).transpose()?,
        mass_kg: source.required(mass_kg, Range::Within(1e-9, MAX_COEFFICIENT))?,
        gravity_m_per_s2: source.vector_or_zero(gravity)?,
    })
}

fn moments(source: &Source, typed: &Spanned<Numbers<3>>) -> Result<DVec3, SceneError> {
    let moments = DVec3::from_array(typed.get_ref().0);
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

fn spring_damper(
    source: &Source,
    spring: Keyed<Number>,
    damping: Keyed<Number>,
) -> Result<SpringDamperPlan, SceneError> {
    Ok(SpringDamperPlan {
        damping: source.optional(damping, NOT_NEGATIVE)?,
        spring: source.number(spring, 0.0, NOT_NEGATIVE)?,
    })
}

fn limits(
    source: &Source,
    (key, typed): Keyed<Option<Spanned<Numbers<2>>>>,
) -> Result<Option<[f64; 2]>, SceneError> {
    let Some(typed) = typed else {
        return Ok(None);
    };
    let [min, max] = typed.get_ref().0;
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
