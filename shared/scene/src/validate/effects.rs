//! The lists of effects: each number checked against what the loop and the devices can render.

use super::super::effects::*;
use super::super::height_map::HeightMap;
use super::super::plan::{ProbePlan, ScenePlan, TrajectoryPlan};
use super::super::typed::*;
use super::{LENGTH, MAX, Range, SceneError, Source};
use glam::DVec3;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// Largest coefficient of friction: rubber has 1 to 2. With more, a touch would pull along the surface so much harder
/// than the surface pushes that a corner of two faces holds the proxy for good.
const MAX_FRICTION: f64 = 3.0;
/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;
/// Points of a path at the most.
const MAX_POINTS: usize = 4096;
/// Slope of a texture at the most: beyond 45 degrees a crest is no relief any more.
const MAX_SLOPE: f64 = 1.0;

/// What a loop and its devices can render.
struct Limits<'a> {
    folder: &'a Path,
    rate_hz: f64,
    force_max_n: f64,
    slew_n_per_s: f64,
    /// The lightest and the least damped device.
    mass_kg: f64,
    damping_ns_per_m: f64,
    /// Speed of the fastest intent, m/s.
    speed_m_per_s: f64,
}

/// Adds what the scene and its objects list to the plan, which is complete otherwise. `copies`: the objects of each table.
pub(super) fn add(
    source: &Source,
    typed: &SceneTyped,
    copies: &[std::ops::Range<usize>],
    plan: &mut ScenePlan,
) -> Result<(), SceneError> {
    let devices = || plan.probes.iter().map(|probe| probe.device);
    let folder = plan.folder.clone();
    let limits = Limits {
        folder: &folder,
        rate_hz: plan.loop_.rate_hz,
        force_max_n: plan.safety.force_max_n,
        slew_n_per_s: plan.safety.slew_n_per_s,
        mass_kg: devices().fold(f64::INFINITY, |least, device| least.min(device.mass_kg)),
        damping_ns_per_m: devices().fold(f64::INFINITY, |least, device| {
            least.min(device.damping_ns_per_m)
        }),
        speed_m_per_s: plan.probes.iter().map(speed).fold(0.0, f64::max),
    };
    let of_scene = list(source, &typed.effects, &limits)?;
    let (of_surfaces, of_scene): (Vec<_>, Vec<_>) = of_scene
        .into_iter()
        .partition(|effect| effect.effect.is_of_surface());
    plan.effects = of_scene;
    for (table, copies) in typed.object.iter().zip(copies) {
        let entries = &table.get_ref().effects;
        let mut effects = list(source, entries, &limits)?;
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
        for effect in &of_surfaces {
            let has_its_own = |own: &EffectPlan| own.effect.index() == effect.effect.index();
            if !effects.iter().any(has_its_own) {
                effects.push(effect.clone());
            }
        }
        effects.retain(|effect| !is_nothing(&effect.effect));
        // The order in which they act on the force.
        effects.sort_by_key(|effect| match effect.effect {
            Effect::Shading(_) => 0,
            Effect::Texture(_) => 1,
            Effect::Friction(_) => 2,
            _ => 3,
        });
        let effects: Arc<[EffectPlan]> = effects.into();
        for object in &mut plan.objects[copies.clone()] {
            object.effects = effects.clone();
        }
    }
    Ok(())
}

/// What has no effect is not there: so its forces are those without it, bit for bit.
fn is_nothing(effect: &Effect) -> bool {
    matches!(effect, Effect::Friction(friction) if friction.static_ == 0.0)
}

/// Speed of a probe's intent at the most, m/s.
fn speed(probe: &ProbePlan) -> f64 {
    match &probe.trajectory {
        TrajectoryPlan::Tour { speed_m_per_s, .. } => *speed_m_per_s,
        TrajectoryPlan::Points(points) => points
            .windows(2)
            .map(|pair| {
                let [(t, a), (u, b)] = [pair[0], pair[1]];
                a.position.distance(b.position) / (u - t)
            })
            .fold(0.0, f64::max),
    }
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
    let typed = entry.get_ref();
    let mut effects = Vec::new();
    if let Some(of) = &typed.friction {
        effects.push(friction(source, of)?);
    }
    if let Some(of) = &typed.shading {
        effects.push(shading(source, of)?);
    }
    if let Some(of) = &typed.texture {
        effects.push(texture(source, of, entry, limits)?);
    }
    if let Some(of) = &typed.magnet {
        effects.push(magnet(source, of, limits)?);
    }
    if let Some(of) = &typed.vibration {
        effects.push(vibration(source, of, limits)?);
    }
    if let Some(of) = &typed.viscosity {
        effects.push(Effect::Viscosity {
            damping_ns_per_m: damping(source, &of.damping_ns_per_m, limits)?,
        });
    }
    if let Some(of) = &typed.spring {
        effects.push(spring(source, of, entry, limits)?);
    }
    if let Some(of) = &typed.gravity {
        effects.push(gravity(source, of, limits)?);
    }
    if let Some(of) = &typed.inertia {
        effects.push(inertia(source, of, limits)?);
    }
    if let Some(of) = &typed.boundary {
        effects.push(boundary(source, of, entry)?);
    }
    let (Some(effect), None) = (effects.pop(), effects.pop()) else {
        return Err(source.value(
            entry,
            &format!(
                "an entry of effects is one effect; write one of {} in braces of its own",
                Effect::NAMES.join(", ")
            ),
        ));
    };
    let seconds = |value: &Option<Spanned<f64>>, key, default, range| {
        source.number(value.as_ref(), key, default, range)
    };
    let from_s = seconds(&typed.from_s, "from_s", 0.0, Range::NotNegative(MAX))?;
    let until_s = seconds(
        &typed.until_s,
        "until_s",
        f64::INFINITY,
        Range::NotNegative(MAX),
    )?;
    if let (Some(until), true) = (&typed.until_s, until_s <= from_s) {
        return Err(source.value(until, &format!("until_s is {until_s}, not after from_s, {from_s}; write a later second or leave the effect out")));
    }
    Ok(EffectPlan {
        effect,
        from_s,
        until_s,
        fade_s: seconds(&typed.fade_s, "fade_s", 0.1, Range::Within(1e-3, 60.0))?,
    })
}

fn friction(source: &Source, typed: &FrictionTyped) -> Result<Effect, SceneError> {
    let range = Range::NotNegative(MAX_FRICTION);
    let static_ = source.number(Some(&typed.static_), "static", 0.0, range)?;
    let dynamic = source.number(typed.dynamic.as_ref(), "dynamic", static_, range)?;
    if let (Some(at), true) = (&typed.dynamic, dynamic > static_) {
        return Err(source.value(at, &format!("dynamic is {dynamic}, more than static, {static_}: what slides would be held better than what sticks; write at most {static_}")));
    }
    Ok(Effect::Friction(FrictionPlan { static_, dynamic }))
}

fn shading(source: &Source, typed: &ShadingTyped) -> Result<Effect, SceneError> {
    let radius_m = source.number(Some(&typed.radius_m), "radius_m", 0.0, LENGTH)?;
    let turn = source.number(
        typed.max_turn_deg.as_ref(),
        "max_turn_deg",
        45.0,
        Range::Within(1.0, 85.0),
    )?;
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
    let amplitude_m = source.number(Some(&typed.amplitude_m), "amplitude_m", 0.0, LENGTH)?;
    let waves = |wavelength: &Spanned<f64>| {
        let wavelength_m = source.number(Some(wavelength), "wavelength_m", 0.0, LENGTH)?;
        // Facts of haptics, F13: v / wavelength below half the rate.
        let finest = 2.0 * limits.speed_m_per_s / limits.rate_hz;
        if wavelength_m <= finest {
            return Err(source.value(wavelength, &format!(
                "wavelength_m is {wavelength_m}, but a loop of {} Hz renders no waves shorter than {finest} m at the {} m/s of this scene; write more, or move slower",
                limits.rate_hz, limits.speed_m_per_s
            )));
        }
        if std::f64::consts::TAU * amplitude_m / wavelength_m > MAX_SLOPE {
            let most = MAX_SLOPE * wavelength_m / std::f64::consts::TAU;
            return Err(source.value(&typed.amplitude_m, &format!(
                "amplitude_m is {amplitude_m}: waves of {wavelength_m} m would be steeper than 45 degrees; write at most {most}"
            )));
        }
        Ok(wavelength_m)
    };
    let pattern = match (&typed.grating, &typed.noise, &typed.height_map) {
        (Some(grating), None, None) => Pattern::Grating {
            wavelength_m: waves(&grating.wavelength_m)?,
            direction: direction(source, grating.direction.as_ref(), DVec3::X)?,
        },
        (None, Some(noise), None) => Pattern::Noise {
            wavelength_m: waves(&noise.wavelength_m)?,
            seed: source
                .whole_number(noise.seed.as_ref(), "seed", 1, 0..=i64::MAX)?
                .unsigned_abs(),
        },
        (None, None, Some(of)) => {
            let path = limits.folder.join(of.file.get_ref());
            let shown = path.display();
            let refused = |error: &dyn std::fmt::Display| {
                source.value(&of.file, &format!("the height map {shown} cannot be used ({error}); name a PNG picture relative to the scene"))
            };
            let file = File::open(&path).map_err(|error| refused(&error))?;
            let map = HeightMap::read_png(file).map_err(|error| refused(&error))?;
            Pattern::HeightMap {
                map: Arc::new(map),
                width_m: source.number(Some(&of.width_m), "width_m", 0.0, LENGTH)?,
                axis: of.axis as usize,
            }
        }
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

fn magnet(source: &Source, typed: &MagnetTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let most = Range::Positive(limits.force_max_n);
    let force_n = source.number(Some(&typed.force_n), "force_n", 0.0, most)?;
    let reach_m = source.number(Some(&typed.reach_m), "reach_m", 0.0, LENGTH)?;
    // It falls off by so much a metre at the most: a spring that pushes away.
    let steepest = 4.0 * force_n / reach_m;
    let most = limits.stiffness(0.0);
    if steepest > most {
        return Err(source.value(&typed.reach_m, &format!(
            "reach_m is {reach_m}: over so short a way {force_n} N are as stiff as {steepest} N/m, more than this loop holds stable on this device ({most}); write at least {}",
            4.0 * force_n / most
        )));
    }
    Ok(Effect::Magnet(MagnetPlan { force_n, reach_m }))
}

fn vibration(
    source: &Source,
    typed: &VibrationTyped,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    // Four samples a wave: above half the rate there is nothing, and little just below.
    let frequency = Range::Within(1e-3, 0.25 * limits.rate_hz);
    let frequency_hz = source.number(Some(&typed.frequency_hz), "frequency_hz", 0.0, frequency)?;
    // The gate lets no more through.
    let steepest = limits.slew_n_per_s / (std::f64::consts::TAU * frequency_hz);
    let amplitude = Range::Positive(steepest.min(limits.force_max_n));
    Ok(Effect::Vibration(VibrationPlan {
        frequency_hz,
        amplitude_n: source.number(Some(&typed.amplitude_n), "amplitude_n", 0.0, amplitude)?,
        direction: direction(source, typed.direction.as_ref(), DVec3::Z)?,
    }))
}

fn spring(
    source: &Source,
    typed: &SpringTyped,
    entry: &Spanned<EffectTyped>,
    limits: &Limits,
) -> Result<Effect, SceneError> {
    let path_m = match (&typed.point_m, &typed.path_m) {
        (Some(point), None) => vec![place(source, point, *point.get_ref())?],
        (None, Some(path)) if (2..=MAX_POINTS).contains(&path.get_ref().len()) => path
            .get_ref()
            .iter()
            .map(|&point| place(source, path, point))
            .collect::<Result<_, _>>()?,
        _ => {
            return Err(source.value(
                entry,
                &format!("a spring holds to point_m = [x, y, z] or to path_m = [[x, y, z], ...] of 2 to {MAX_POINTS} points; write one of the two"),
            ));
        }
    };
    let damping_ns_per_m = match &typed.damping_ns_per_m {
        None => 0.0,
        Some(typed) => damping(source, typed, limits)?,
    };
    Ok(Effect::Spring(SpringPlan {
        path_m,
        stiffness_n_per_m: stiffness(
            source,
            Some(&typed.stiffness_n_per_m),
            0.0,
            limits.stiffness(damping_ns_per_m),
        )?,
        damping_ns_per_m,
        force_max_n: source.number(
            typed.force_max_n.as_ref(),
            "force_max_n",
            limits.force_max_n,
            Range::Positive(limits.force_max_n),
        )?,
    }))
}

fn gravity(source: &Source, typed: &GravityTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let most = Range::Positive(limits.force_max_n / GRAVITY);
    Ok(Effect::Gravity(GravityPlan {
        mass_kg: source.number(Some(&typed.mass_kg), "mass_kg", 0.0, most)?,
        direction: direction(source, typed.direction.as_ref(), DVec3::NEG_Z)?,
        centre_m: match &typed.centre_m {
            None => DVec3::ZERO,
            Some(centre) => place(source, centre, *centre.get_ref())?,
        },
    }))
}

fn inertia(source: &Source, typed: &InertiaTyped, limits: &Limits) -> Result<Effect, SceneError> {
    let mass_kg = source.number(
        Some(&typed.mass_kg),
        "mass_kg",
        0.0,
        Range::Within(1e-6, MAX),
    )?;
    // The two masses swing against each other: the lighter one counts.
    let limits = Limits {
        mass_kg: limits.mass_kg.min(mass_kg),
        ..*limits
    };
    let damping_ns_per_m = match &typed.damping_ns_per_m {
        None => (0.5f64).min(limits.damping()),
        Some(typed) => damping(source, typed, &limits)?,
    };
    let most = limits.stiffness(damping_ns_per_m);
    let typed = typed.stiffness_n_per_m.as_ref();
    Ok(Effect::Inertia(InertiaPlan {
        mass_kg,
        stiffness_n_per_m: stiffness(source, typed, (200.0f64).min(most), most)?,
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
            centre: match &ball.centre_m {
                None => DVec3::ZERO,
                Some(centre) => place(source, centre, *centre.get_ref())?,
            },
            radius: source.number(Some(&ball.radius_m), "radius_m", 0.0, LENGTH)?,
        },
        (None, Some(of)) => {
            let lower = place(source, &of.lower_m, *of.lower_m.get_ref())?;
            let upper = place(source, &of.upper_m, *of.upper_m.get_ref())?;
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
        // The energy account holds it at any stiffness, as it holds a surface.
        stiffness_n_per_m: stiffness(source, typed.stiffness_n_per_m.as_ref(), 800.0, MAX)?,
    }))
}

impl Limits<'_> {
    /// Largest damping that a loop can render on a device: of the speed of a mass it may take half in a tick, for it is
    /// measured over the tick before.
    fn damping(&self) -> f64 {
        0.5 * self.mass_kg * self.rate_hz
    }

    /// Largest stiffness that it can render together with a damping: half of what theory allows (facts of haptics, F1 and
    /// F2), where it would ring for seconds, with half of the damping, which comes late; and never more than a quarter of
    /// a swing of the mass in a tick. `rt-tests stability fields` tries the limit.
    fn stiffness(&self, damping: f64) -> f64 {
        let damped = (self.damping_ns_per_m + 0.5 * damping) * self.rate_hz;
        damped.min(0.25 * self.mass_kg * self.rate_hz * self.rate_hz)
    }
}

fn stiffness(
    source: &Source,
    typed: Option<&Spanned<f64>>,
    default: f64,
    most: f64,
) -> Result<f64, SceneError> {
    source.number(typed, "stiffness_n_per_m", default, Range::Positive(most))
}

fn damping(source: &Source, typed: &Spanned<f64>, limits: &Limits) -> Result<f64, SceneError> {
    let range = Range::Positive(limits.damping());
    source.number(Some(typed), "damping_ns_per_m", 0.0, range)
}

/// A direction, made a unit vector.
fn direction(
    source: &Source,
    typed: Option<&Spanned<[f64; 3]>>,
    default: DVec3,
) -> Result<DVec3, SceneError> {
    let Some(typed) = typed else {
        return Ok(default);
    };
    let vector = DVec3::from_array(*typed.get_ref());
    // Scaled first, so that no square overflows or vanishes.
    let unit = (vector / vector.abs().max_element()).try_normalize();
    unit.ok_or_else(|| {
        source.value(
            typed,
            "direction needs three finite numbers that are not all zero",
        )
    })
}

/// A place in the world.
fn place<T>(source: &Source, at: &Spanned<T>, typed: [f64; 3]) -> Result<DVec3, SceneError> {
    let place = DVec3::from_array(typed);
    if place.abs().max_element() <= 1e7 && place.is_finite() {
        return Ok(place);
    }
    Err(source.value(at, "a place needs three finite numbers within 1e7 m"))
}

#[cfg(test)]
#[path = "effects_tests.rs"]
mod tests;
