//! The lists of effects: every number is checked against the limits of the loop and the devices.

#[path = "effects_stability.rs"]
mod stability;

use crate::limits::{
    GRAVITY_M_PER_S2, LENGTH_M, MAX_COEFFICIENT, MAX_FRICTION, MAX_LENGTH_M, MAX_PATH_POINTS,
    MAX_TEXTURE_SLOPE, NOT_NEGATIVE, POSITIVE, Range,
};
use crate::plan::{
    BoundaryPlan, Effect, EffectPlan, FrictionPlan, GravityPlan, HeightMap, InertiaPlan,
    MagnetPlan, Pattern, ScenePlan, ShadingPlan, SpringPlan, TexturePlan, VibrationPlan, Workspace,
};
use crate::source::{SceneError, Source, key};
use crate::typed::*;
use glam::DVec3;
use stability::Limits;
use std::f64::consts::TAU;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// Adds the effects of the scene and its objects to an otherwise complete plan. `copies` are the
/// objects of each object table.
pub(super) fn add(
    source: &Source,
    typed: &SceneTyped,
    copies: &[std::ops::Range<usize>],
    plan: &mut ScenePlan,
) -> Result<(), SceneError> {
    let limits = Limits::new(plan);
    let of_scene = list(source, &typed.effects, &limits)?;
    let entries = typed
        .effects
        .iter()
        .zip(of_scene.clone())
        .collect::<Vec<_>>();
    let (of_surfaces, of_scene): (Vec<_>, Vec<_>) = of_scene
        .into_iter()
        .partition(|effect| effect.effect.is_of_surface());
    stability::check(source, &limits, &entries)?;
    plan.effects = of_scene;
    for (table, copies) in typed.object.iter().zip(copies) {
        let own = &table.get_ref().effects;
        let effects = object_effects(source, own, &of_surfaces, &limits)?;
        // The object's own magnet takes the place of the scene's.
        if let Some(own) = own.iter().find(|entry| entry.get_ref().magnet.is_some()) {
            let mut together = entries.clone();
            together.retain(|(_, of)| !matches!(of.effect, Effect::Magnet(_)));
            together.push((own, effect_plan(source, own, &limits)?));
            stability::check(source, &limits, &together)?;
        }
        for object in &mut plan.objects[copies.clone()] {
            object.effects = effects.clone();
        }
    }
    Ok(())
}

/// Effects of an object, in the order in which they act on the force. `of_surfaces` are the surface
/// effects of the scene; the object's own effect of the same kind replaces one of them.
fn object_effects(
    source: &Source,
    entries: &[Spanned<EffectTyped>],
    of_surfaces: &[EffectPlan],
    limits: &Limits,
) -> Result<Arc<[EffectPlan]>, SceneError> {
    let mut effects = list(source, entries, limits)?;
    for (entry, effect) in entries.iter().zip(&effects) {
        let name = effect.effect.name();
        let is_of_object =
            effect.effect.is_of_surface() || matches!(effect.effect, Effect::Vibration(_));
        if !is_of_object {
            return Err(source.value(
                entry,
                &format!("{name} is felt anywhere, not at an object's surface; list it in effects = [...] at the top of the scene, before the first table"),
            ));
        }
    }
    for effect in of_surfaces {
        let has_its_own = |own: &EffectPlan| own.effect.index() == effect.effect.index();
        if !effects.iter().any(has_its_own) {
            effects.push(effect.clone());
        }
    }
    effects.retain(|effect| !is_nothing(&effect.effect));
    effects.sort_by_key(|effect| match effect.effect {
        Effect::Shading(_) => 0,
        Effect::Texture(_) => 1,
        Effect::Friction(_) => 2,
        _ => 3,
    });
    Ok(effects.into())
}

/// An effect without influence is left out, so that the forces are bit-equal to those without it.
fn is_nothing(effect: &Effect) -> bool {
    matches!(effect, Effect::Friction(friction) if friction.static_ == 0.0)
}

fn list(
    source: &Source,
    typed: &[Spanned<EffectTyped>],
    limits: &Limits,
) -> Result<Vec<EffectPlan>, SceneError> {
    let mut effects: Vec<EffectPlan> = Vec::new();
    for entry in typed {
        let plan = effect_plan(source, entry, limits)?;
        let name = plan.effect.name();
        if effects.iter().any(|other| other.effect.name() == name) {
            return Err(source.value(
                entry,
                &format!("there is a {name} in this list already; leave one of them out"),
            ));
        }
        effects.push(plan);
    }
    Ok(effects)
}

fn effect_plan(
    source: &Source,
    entry: &Spanned<EffectTyped>,
    limits: &Limits,
) -> Result<EffectPlan, SceneError> {
    let effect = effect(source, entry, limits)?;
    let typed = entry.get_ref();
    let from_s = source.number(key!(typed.from_s), 0.0, NOT_NEGATIVE)?;
    let until_s = source.number(key!(typed.until_s), f64::INFINITY, NOT_NEGATIVE)?;
    if let (Some(until), true) = (&typed.until_s, until_s <= from_s) {
        return Err(source.value(until, &format!("until_s is {until_s}, not after from_s, {from_s}; write a later second or leave the effect out")));
    }
    Ok(EffectPlan {
        effect,
        from_s,
        until_s,
        fade_s: source.number(key!(typed.fade_s), 0.1, Range::Within(1e-3, 60.0))?,
    })
}

/// The one effect of an entry.
fn effect(
    source: &Source,
    entry: &Spanned<EffectTyped>,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    let typed = entry.get_ref();
    let effects = [
        typed.friction.as_ref().map(|of| friction(source, of)),
        typed.shading.as_ref().map(|of| shading(source, of)),
        typed
            .texture
            .as_ref()
            .map(|of| texture(source, of, entry, limits)),
        typed.magnet.as_ref().map(|of| magnet(source, of, limits)),
        typed
            .vibration
            .as_ref()
            .map(|of| vibration(source, of, limits)),
        typed
            .viscosity
            .as_ref()
            .map(|of| viscosity(source, of, limits)),
        typed
            .spring
            .as_ref()
            .map(|of| spring(source, of, entry, limits)),
        typed.gravity.as_ref().map(|of| gravity(source, of, limits)),
        typed.inertia.as_ref().map(|of| inertia(source, of, limits)),
        typed
            .boundary
            .as_ref()
            .map(|of| boundary(source, of, entry)),
    ];
    let mut given = effects.into_iter().flatten();
    if let (Some(effect), None) = (given.next(), given.next()) {
        return effect;
    }
    Err(source.value(
        entry,
        &format!(
            "an entry of effects is one effect; write one of {} in braces of its own",
            Effect::NAMES.join(", ")
        ),
    ))
}

fn friction(source: &Source, typed: &FrictionTyped) -> Result<Effect, SceneError> {
    let range = Range::NotNegative(MAX_FRICTION);
    let static_ = source.required(("static", &typed.static_), range)?;
    let dynamic = source.number(key!(typed.dynamic), static_, range)?;
    if let (Some(at), true) = (&typed.dynamic, dynamic > static_) {
        return Err(source.value(at, &format!("dynamic is {dynamic}, more than static, {static_}: what slides would be held better than what sticks; write at most {static_}")));
    }
    Ok(Effect::Friction(FrictionPlan { static_, dynamic }))
}

fn shading(source: &Source, typed: &ShadingTyped) -> Result<Effect, SceneError> {
    let radius_m = source.required(key!(typed.radius_m), LENGTH_M)?;
    let turn = source.number(key!(typed.max_turn_deg), 45.0, Range::Within(1.0, 85.0))?;
    Ok(Effect::Shading(ShadingPlan {
        radius_m,
        max_turn: turn.to_radians(),
    }))
}

fn texture(
    source: &Source,
    typed: &TextureTyped,
    entry: &Spanned<EffectTyped>,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    let amplitude_m = source.required(key!(typed.amplitude_m), LENGTH_M)?;
    let waves = |typed_length| {
        let length = wavelength(source, typed_length, limits)?;
        check_slope(source, &typed.amplitude_m, amplitude_m, length)?;
        Ok(length)
    };
    let pattern = match (&typed.grating, &typed.noise, &typed.height_map) {
        (Some(grating), None, None) => Pattern::Grating {
            wavelength_m: waves(&grating.wavelength_m)?,
            direction: direction(source, &grating.direction, DVec3::X)?,
        },
        (None, Some(noise), None) => Pattern::Noise {
            wavelength_m: waves(&noise.wavelength_m)?,
            seed: source
                .number(key!(noise.seed), 1, 0..=i64::MAX)?
                .unsigned_abs(),
        },
        (None, None, Some(of)) => height_map(source, of, (&typed.amplitude_m, amplitude_m))?,
        _ => {
            return Err(source.value(
                entry,
                "a texture is one of grating = { wavelength_m = ... }, noise = { wavelength_m = ... } and height_map = { file = \"...\", width_m = ... }; write exactly one of them",
            ));
        }
    };
    Ok(Effect::Texture(TexturePlan {
        amplitude_m,
        pattern,
    }))
}

/// A wavelength of a texture. Its frequency, speed over wavelength, must stay below half the rate
/// of the loop (Nyquist).
fn wavelength(source: &Source, typed: &Spanned<f64>, limits: &Limits) -> Result<f64, SceneError> {
    let wavelength_m = source.required(("wavelength_m", typed), LENGTH_M)?;
    let finest = 2.0 * limits.speed_m_per_s / limits.rate_hz;
    if wavelength_m <= finest {
        return Err(source.value(typed, &format!(
            "wavelength_m is {wavelength_m}, but a loop of {} Hz renders no waves shorter than {finest} m at the {} m/s of this scene; write more, or move slower",
            limits.rate_hz, limits.speed_m_per_s
        )));
    }
    Ok(wavelength_m)
}

fn check_slope(
    source: &Source,
    typed: &Spanned<f64>,
    amplitude_m: f64,
    wavelength_m: f64,
) -> Result<(), SceneError> {
    // Compared with the number that is named, which is to be let in.
    let max = MAX_TEXTURE_SLOPE * wavelength_m / TAU;
    if amplitude_m <= max {
        return Ok(());
    }
    Err(source.value(typed, &format!(
        "amplitude_m is {amplitude_m}: waves of {wavelength_m} m would be steeper than 45 degrees; write at most {max}"
    )))
}

/// The picture of a texture, no steeper than waves may be: the force grows with the slope.
fn height_map(
    source: &Source,
    typed: &HeightMapTyped,
    (amplitude, amplitude_m): (&Spanned<f64>, f64),
) -> Result<Pattern, SceneError> {
    let path = source.path(&typed.file);
    let shown = path.display();
    let (map, steepest) = picture(source, &path).map_err(|error| {
        source.value(&typed.file, &format!("the height map {shown} cannot be used ({error}); name a PNG picture relative to the scene"))
    })?;
    let width_m = source.required(key!(typed.width_m), LENGTH_M)?;
    let steepest = steepest / width_m;
    if amplitude_m * steepest > MAX_TEXTURE_SLOPE {
        let max = MAX_TEXTURE_SLOPE / steepest;
        return Err(source.value(amplitude, &format!(
            "amplitude_m is {amplitude_m}: the height map {shown} over {width_m} m would be steeper than 45 degrees; write at most {max}, or a larger width_m"
        )));
    }
    Ok(Pattern::HeightMap {
        map,
        width_m,
        axis: typed.axis as usize,
    })
}

/// The picture of a path and its steepest slope, read once for all that name it.
fn picture(source: &Source, path: &Path) -> Result<(Arc<HeightMap>, f64), String> {
    if let Some(read) = source.maps.borrow().get(path) {
        return Ok(read.clone());
    }
    let bytes = source.read(path).map_err(|error| error.to_string())?;
    let map = HeightMap::read_png(Cursor::new(bytes)).map_err(|error| error.to_string())?;
    let steepest = map.steepest();
    let read = (Arc::new(map), steepest);
    let mut maps = source.maps.borrow_mut();
    maps.insert(path.to_path_buf(), read.clone());
    Ok(read)
}

fn magnet(source: &Source, typed: &MagnetTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let range = Range::Positive(limits.force_max_n);
    let force_n = source.required(key!(typed.force_n), range)?;
    let reach_m = source.required(key!(typed.reach_m), LENGTH_M)?;
    let steepest = stability::steepest(force_n, reach_m);
    let max = limits.stiffness(0.0);
    if steepest > max {
        let mut shortest_m = 4.0 * force_n / max;
        if stability::steepest(force_n, shortest_m) > max {
            // Rounded down: what is named is to be let in.
            shortest_m = shortest_m.next_up();
        }
        let remedy = if shortest_m <= MAX_LENGTH_M {
            format!("write at least {shortest_m}")
        } else {
            "it has no damping or hardly any, so no spring is stable on it: give it a damping_ns_per_m, or leave the magnet out".to_string()
        };
        return Err(source.value(&typed.reach_m, &format!(
            "reach_m is {reach_m}: over so short a distance {force_n} N are as stiff as {steepest} N/m, more than this loop holds stable on this device ({max}); {remedy}"
        )));
    }
    Ok(Effect::Magnet(MagnetPlan { force_n, reach_m }))
}

fn vibration(
    source: &Source,
    typed: &VibrationTyped,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    // At least four samples a wave.
    let frequency = Range::Within(1e-3, 0.25 * limits.rate_hz);
    let frequency_hz = source.required(key!(typed.frequency_hz), frequency)?;
    // A larger amplitude would exceed the slew limit.
    let max_amplitude_n = limits.slew_n_per_s / (TAU * frequency_hz);
    let amplitude = Range::Positive(max_amplitude_n.min(limits.force_max_n));
    Ok(Effect::Vibration(VibrationPlan {
        frequency_hz,
        amplitude_n: source.required(key!(typed.amplitude_n), amplitude)?,
        direction: direction(source, &typed.direction, DVec3::Z)?,
    }))
}

fn viscosity(
    source: &Source,
    typed: &ViscosityTyped,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    let range = Range::Positive(limits.damping());
    Ok(Effect::Viscosity {
        damping_ns_per_m: source.required(key!(typed.damping_ns_per_m), range)?,
    })
}

fn spring(
    source: &Source,
    typed: &SpringTyped,
    entry: &Spanned<EffectTyped>,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    let path_m = match (&typed.point_m, &typed.path_m) {
        (Some(point), None) => vec![source.vector(("point_m", point), *point.get_ref())?],
        (None, Some(path)) if (2..=MAX_PATH_POINTS).contains(&path.get_ref().len()) => path
            .get_ref()
            .iter()
            .map(|&point| source.vector(("path_m", path), point))
            .collect::<Result<_, _>>()?,
        _ => {
            return Err(source.value(
                entry,
                &format!("a spring holds to point_m = [x, y, z] or to path_m = [[x, y, z], ...] of 2 to {MAX_PATH_POINTS} points; write one of the two"),
            ));
        }
    };
    let damping = Range::NotNegative(limits.damping());
    let damping_ns_per_m = source.number(key!(typed.damping_ns_per_m), 0.0, damping)?;
    let max = limits.stiffness(damping_ns_per_m);
    if max == 0.0 {
        return Err(source.value(
            &typed.stiffness_n_per_m,
            "a device of this scene has no damping, so no spring without damping is stable on it; give the spring or the device a damping_ns_per_m",
        ));
    }
    let stiffness = Range::Positive(max);
    let force_max_n = limits.force_max_n;
    let force = Range::Positive(force_max_n);
    Ok(Effect::Spring(SpringPlan {
        path_m,
        stiffness_n_per_m: source.required(key!(typed.stiffness_n_per_m), stiffness)?,
        damping_ns_per_m,
        force_max_n: source.number(key!(typed.force_max_n), force_max_n, force)?,
    }))
}

fn gravity(source: &Source, typed: &GravityTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let range = Range::Positive(limits.force_max_n / GRAVITY_M_PER_S2);
    Ok(Effect::Gravity(GravityPlan {
        mass_kg: source.required(key!(typed.mass_kg), range)?,
        direction: direction(source, &typed.direction, DVec3::NEG_Z)?,
        centre_m: source.vector_or_zero(key!(typed.centre_m))?,
    }))
}

fn inertia(source: &Source, typed: &InertiaTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let mass_kg = source.required(key!(typed.mass_kg), Range::Within(1e-6, MAX_COEFFICIENT))?;
    let limits = limits.with_mass(mass_kg);
    // Within the limits, the defaults are 0.5 N s/m and 200 N/m.
    let at_most = |default: f64, max: f64| (default.min(max), Range::Positive(max));
    let (default, range) = at_most(0.5, limits.damping());
    let damping_ns_per_m = source.number(key!(typed.damping_ns_per_m), default, range)?;
    let (default, range) = at_most(200.0, limits.stiffness(damping_ns_per_m));
    Ok(Effect::Inertia(InertiaPlan {
        mass_kg,
        stiffness_n_per_m: source.number(key!(typed.stiffness_n_per_m), default, range)?,
        damping_ns_per_m,
    }))
}

fn boundary(
    source: &Source,
    typed: &BoundaryTyped,
    entry: &Spanned<EffectTyped>,
) -> Result<Effect, SceneError> {
    let shape = match (&typed.ball, &typed.box_) {
        (Some(ball), None) => Workspace::Ball {
            centre: source.vector_or_zero(key!(ball.centre_m))?,
            radius: source.required(key!(ball.radius_m), LENGTH_M)?,
        },
        (None, Some(of)) => {
            let lower = source.vector(key!(of.lower_m), *of.lower_m.get_ref())?;
            let upper = source.vector(key!(of.upper_m), *of.upper_m.get_ref())?;
            if !lower.cmplt(upper).all() {
                return Err(source.value(
                    &of.upper_m,
                    "upper_m is not above lower_m on every axis; write the two corners of a box",
                ));
            }
            Workspace::Box { lower, upper }
        }
        _ => {
            return Err(source.value(
                entry,
                "a boundary is either ball = { radius_m = ... } or box = { lower_m = [...], upper_m = [...] }; write one of the two",
            ));
        }
    };
    Ok(Effect::Boundary(BoundaryPlan {
        shape,
        // Passivity control keeps it stable at any stiffness, like a surface.
        stiffness_n_per_m: source.number(key!(typed.stiffness_n_per_m), 800.0, POSITIVE)?,
    }))
}

/// A direction, made a unit vector.
fn direction(source: &Source, typed: &Vector, default: DVec3) -> Result<DVec3, SceneError> {
    let given = typed.as_ref();
    given.map_or(Ok(default), |typed| source.direction(("direction", typed)))
}

#[cfg(test)]
#[path = "effects_tests.rs"]
mod tests;
