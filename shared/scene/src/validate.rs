//! From the scene as typed to the [`ScenePlan`]: every number is checked on the way. A scene is refused with
//! one sentence that names file, line and what to do.

use super::plan::{
    AccuracyPlan, Hand, LoopPlan, MAX_PROBES, ModelScale, ModelSource, Overrides, ProbePlan,
    RefinementPlan, SafetyPlan, ScenePlan, SimulatedDevicePlan, TrajectoryPlan,
};
use super::trajectory;
use super::typed::*;
use objects::Objects;
use probe_shape::probe_shape;
use std::path::Path;
use thiserror::Error;
use toml::Spanned;

mod effects;
mod movable;
mod objects;
mod probe_shape;

pub(super) use movable::MovableTyped;
pub use movable::{
    DrivenPlan, FreePlan, HingePlan, MAX_MOVABLES, MassPlan, MovablePlan, RailPlan, RestPlan,
    least_coupled_mass,
};

/// Shapes that `generate = { shape = "..." }` may name.
pub const SHAPES: [&str; 6] = ["sphere", "torus", "terrain", "plate", "wedge", "relief"];

/// Why a scene is refused: one sentence that names file, line and what to do.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0}")]
pub struct SceneError(pub String);

/// Reads a scene file and validates it under the command line's overrides.
///
/// # Errors
/// One sentence that names the file, the line where there is one, and what to do.
pub fn load(path: &Path, overrides: &Overrides) -> Result<ScenePlan, SceneError> {
    let shown = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|error| {
        SceneError(format!(
            "{shown}: cannot be read as a scene ({error}); give the path of a scene file such as config/scenes/first-touch.toml"
        ))
    })?;
    let name = path
        .file_stem()
        .map_or_else(|| shown.clone(), |stem| stem.to_string_lossy().into_owned());
    let folder = path.parent().unwrap_or(Path::new(""));
    plan(
        &Source {
            shown: &shown,
            text: &text,
        },
        &name,
        folder,
        overrides,
    )
}

/// Validates the text of a scene; `name` stands for the file in messages, `folder` is where relative
/// paths start (a trajectory's CSV file is read from there).
///
/// # Errors
/// One sentence that names the scene, the line where there is one, and what to do.
pub fn parse(
    text: &str,
    name: &str,
    folder: &Path,
    overrides: &Overrides,
) -> Result<ScenePlan, SceneError> {
    plan(&Source { shown: name, text }, name, folder, overrides)
}

/// A scene's text and the name that messages give it.
struct Source<'a> {
    shown: &'a str,
    text: &'a str,
}

impl Source<'_> {
    /// Refuses what stands at a byte of the text.
    fn at(&self, byte: usize, sentence: &str) -> SceneError {
        let before = &self.text.as_bytes()[..byte.min(self.text.len())];
        let line = 1 + before.iter().filter(|&&b| b == b'\n').count();
        SceneError(format!("{}, line {line}: {sentence}", self.shown))
    }

    /// Refuses a value of the text.
    fn value<T>(&self, value: &Spanned<T>, sentence: &str) -> SceneError {
        self.at(value.span().start, sentence)
    }

    /// Refuses the scene as a whole.
    fn whole(&self, sentence: &str) -> SceneError {
        SceneError(format!("{}: {sentence}", self.shown))
    }

    /// A number of the scene, or its default.
    fn number(
        &self,
        value: Option<&Spanned<f64>>,
        key: &str,
        default: f64,
        range: Range,
    ) -> Result<f64, SceneError> {
        let Some(value) = value else {
            return Ok(default);
        };
        range
            .check(key, *value.get_ref())
            .map_err(|sentence| self.value(value, &sentence))
    }

    /// A whole number of the scene, or its default.
    fn whole_number(
        &self,
        value: Option<&Spanned<i64>>,
        key: &str,
        default: i64,
        range: std::ops::RangeInclusive<i64>,
    ) -> Result<i64, SceneError> {
        let Some(value) = value else {
            return Ok(default);
        };
        let number = *value.get_ref();
        if range.contains(&number) {
            return Ok(number);
        }
        let (low, high) = (range.start(), range.end());
        Err(self.value(
            value,
            &format!("{key} is {number}; write a whole number from {low} to {high}"),
        ))
    }
}

/// What a number may be.
#[derive(Clone, Copy)]
enum Range {
    /// Above 0, at most this.
    Positive(f64),
    /// 0 to this.
    NotNegative(f64),
    /// Between the two.
    Within(f64, f64),
}

impl Range {
    fn check(self, key: &str, number: f64) -> Result<f64, String> {
        let (fits, wanted) = match self {
            Self::Positive(most) => (
                number > 0.0 && number <= most,
                format!("a number above 0, at most {most}"),
            ),
            Self::NotNegative(most) => (
                (0.0..=most).contains(&number),
                format!("a number from 0 to {most}"),
            ),
            Self::Within(least, most) => (
                (least..=most).contains(&number),
                format!("a number from {least} to {most}"),
            ),
        };
        if fits {
            Ok(number)
        } else {
            Err(format!("{key} is {number}; write {wanted}"))
        }
    }
}

/// Lengths in a scene, metres: from below an atom to above the Earth, so that no square overflows or vanishes.
const LENGTH: Range = Range::Within(1e-9, 1e7);
/// Largest of the coefficients (N/m, N s/m, kg, N, N/s, m/s): far above any device.
const MAX: f64 = 1e9;

/// The whole way from text to plan.
fn plan(
    source: &Source,
    name: &str,
    folder: &Path,
    overrides: &Overrides,
) -> Result<ScenePlan, SceneError> {
    let typed: SceneTyped = toml::from_str(source.text).map_err(|error| {
        let sentence = error.message().replace('\n', "; ");
        match error.span() {
            Some(span) => source.at(span.start, &sentence),
            None => source.whole(&sentence),
        }
    })?;
    let objects = Objects::new(source, &typed.object)?;
    let probes = probe_plans(source, &typed.probe, folder, &objects)?;
    let mut plan = ScenePlan {
        name: name.to_string(),
        folder: folder.to_path_buf(),
        loop_: loop_plan(source, &typed.loop_)?,
        cache_bytes: typed.cache.bytes.map_or(16 << 20, |bytes| bytes.0),
        accuracy: accuracy_plan(source, &typed.accuracy)?,
        safety: safety_plan(source, &typed.safety)?,
        objects: objects.plans,
        probes,
        effects: Vec::new(),
    };
    let first_copies = objects.copies.first().map_or(0, |copies| copies.end);
    apply(&mut plan, first_copies, overrides).map_err(|sentence| source.whole(&sentence))?;
    effects::add(source, &typed, &objects.copies, &mut plan)?;
    let tables = typed.object.iter().map(Spanned::get_ref);
    movable::check(source, tables.zip(&objects.copies), &plan)?;
    Ok(plan)
}

fn probe_plans(
    source: &Source,
    typed: &[Spanned<ProbeTyped>],
    folder: &Path,
    objects: &Objects,
) -> Result<Vec<ProbePlan>, SceneError> {
    if typed.is_empty() {
        return Err(source.whole(
            "there is no [[probe]]; describe what touches in a [[probe]] table (it may be empty)",
        ));
    }
    if let Some(extra) = typed.get(MAX_PROBES) {
        return Err(source.value(
            extra,
            &format!("this is a [[probe]] too many; a scene has at most {MAX_PROBES}, take the others out"),
        ));
    }
    typed
        .iter()
        .map(|probe| probe_plan(source, probe.get_ref(), folder, objects))
        .collect()
}

fn accuracy_plan(source: &Source, typed: &AccuracyTyped) -> Result<AccuracyPlan, SceneError> {
    let tolerance_m = source.number(
        typed.tolerance_m.as_ref(),
        "tolerance_m",
        0.0,
        Range::NotNegative(MAX),
    )?;
    let refinement = match (typed.refinement, &typed.lod) {
        (Some(RefinementTyped::Global), lod) => {
            let lod = lod
                .as_ref()
                .map(|lod| source.whole_number(Some(lod), "lod", 0, 0..=i64::from(u32::MAX - 1)))
                .transpose()?;
            RefinementPlan::Global {
                lod: lod.map(|lod| lod as u32),
            }
        }
        (_, None) => RefinementPlan::Local,
        (_, Some(lod)) => {
            return Err(source.value(
                lod,
                "lod counts the splits of the whole model, so it goes with refinement = \"global\"; write that too, or leave lod out and set tolerance_m",
            ));
        }
    };
    if let (RefinementPlan::Global { lod: Some(_) }, Some(tolerance)) =
        (refinement, &typed.tolerance_m)
        && tolerance_m != 0.0
    {
        return Err(source.value(
            tolerance,
            "lod and tolerance_m both say how fine the whole model is to be; leave one of them out",
        ));
    }
    Ok(AccuracyPlan {
        tolerance_m,
        refinement,
        geomorph: typed.geomorph.unwrap_or(true),
    })
}

fn loop_plan(source: &Source, typed: &LoopTyped) -> Result<LoopPlan, SceneError> {
    let rate_hz = source.number(
        typed.rate_hz.as_ref(),
        "rate_hz",
        1000.0,
        Range::Within(100.0, 10_000.0),
    )?;
    let core = source.whole_number(typed.core.as_ref(), "core (-1: any)", 1, -1..=1023)?;
    let priority = source.whole_number(typed.priority.as_ref(), "priority", 80, 1..=99)?;
    // Spinning longer than half a period would starve the rest of the core.
    let longest_spin = (5e5 / rate_hz) as i64;
    let spin = source.whole_number(typed.spin_us.as_ref(), "spin_us", 0, 0..=longest_spin)?;
    let operations =
        source.whole_number(typed.operations.as_ref(), "operations", 96, 1..=100_000)?;
    Ok(LoopPlan {
        rate_hz,
        core: usize::try_from(core).ok(),
        priority: priority as i32,
        spin_us: spin as u64,
        require_realtime: typed.require_realtime.unwrap_or(false),
        operations: operations as usize,
    })
}

fn safety_plan(source: &Source, typed: &SafetyTyped) -> Result<SafetyPlan, SceneError> {
    Ok(SafetyPlan {
        force_max_n: source.number(
            typed.force_max_n.as_ref(),
            "force_max_n",
            8.0,
            Range::Positive(MAX),
        )?,
        torque_max_nm: source.number(
            typed.torque_max_nm.as_ref(),
            "torque_max_nm",
            0.3,
            Range::Within(1e-6, 1e3),
        )?,
        slew_n_per_s: source.number(
            typed.slew_n_per_s.as_ref(),
            "slew_n_per_s",
            2000.0,
            Range::Positive(MAX),
        )?,
        ramp_s: source.number(
            typed.ramp_s.as_ref(),
            "ramp_s",
            0.2,
            Range::NotNegative(60.0),
        )?,
        passivity: typed.passivity.unwrap_or(true),
    })
}

fn probe_plan(
    source: &Source,
    typed: &ProbeTyped,
    folder: &Path,
    objects: &Objects,
) -> Result<ProbePlan, SceneError> {
    let absent = SimulatedTyped::default();
    let device = match &typed.device {
        Some(DeviceTyped::Simulated(device)) => device,
        None => &absent,
    };
    Ok(ProbePlan {
        shape: probe_shape(source, typed.shape.as_ref(), folder)?,
        device: device_plan(source, device)?,
        trajectory: match &typed.trajectory {
            None => tour_plan(source, &TourTyped::default(), objects)?,
            Some(TrajectoryTyped::Tour(tour)) => tour_plan(source, tour, objects)?,
            Some(TrajectoryTyped::Csv(file)) => {
                let path = folder.join(file.get_ref());
                let shown = path.display();
                let text = std::fs::read_to_string(&path).map_err(|error| {
                    source.value(file, &format!("the trajectory {shown} cannot be read ({error}); name a CSV file relative to the scene"))
                })?;
                TrajectoryPlan::Points(trajectory::parse(&text, &shown.to_string())?)
            }
        },
    })
}

fn device_plan(source: &Source, typed: &SimulatedTyped) -> Result<SimulatedDevicePlan, SceneError> {
    let coefficient = |value: &Option<Spanned<f64>>, key, default| {
        source.number(value.as_ref(), key, default, Range::NotNegative(MAX))
    };
    Ok(SimulatedDevicePlan {
        mass_kg: source.number(
            typed.mass_kg.as_ref(),
            "mass_kg",
            0.1,
            Range::Within(1e-6, MAX),
        )?,
        damping_ns_per_m: coefficient(&typed.damping_ns_per_m, "damping_ns_per_m", 1.0)?,
        encoder_m: coefficient(&typed.encoder_m, "encoder_m", 1e-5)?,
        hand: Hand {
            stiffness_n_per_m: coefficient(
                &typed.hand.stiffness_n_per_m,
                "hand's stiffness_n_per_m",
                200.0,
            )?,
            damping_ns_per_m: coefficient(
                &typed.hand.damping_ns_per_m,
                "hand's damping_ns_per_m",
                2.0,
            )?,
        },
    })
}

fn tour_plan(
    source: &Source,
    typed: &TourTyped,
    objects: &Objects,
) -> Result<TrajectoryPlan, SceneError> {
    let object = match &typed.object {
        None => 0,
        Some(object) => objects.index(source, object)?,
    };
    let seed = source.whole_number(typed.seed.as_ref(), "seed", 1, 0..=i64::MAX)?;
    Ok(TrajectoryPlan::Tour {
        object,
        seed: seed.unsigned_abs(),
        speed_m_per_s: source.number(
            typed.speed_m_per_s.as_ref(),
            "speed_m_per_s",
            0.1,
            Range::Within(1e-6, 1e3),
        )?,
        depth_m: source.number(typed.depth_m.as_ref(), "depth_m", 0.002, LENGTH)?,
    })
}

/// Lays what the command line says over the plan.
fn apply(plan: &mut ScenePlan, first_copies: usize, overrides: &Overrides) -> Result<(), String> {
    if let Some(tolerance) = overrides.tolerance_m {
        let tolerance = Range::NotNegative(MAX).check("--tolerance (metres)", tolerance)?;
        plan.accuracy.tolerance_m = tolerance;
        if let RefinementPlan::Global { lod: lod @ Some(_) } = &mut plan.accuracy.refinement {
            // What is typed last decides how fine the whole model is to be.
            *lod = None;
        }
    }
    if let Some(text) = &overrides.cache {
        plan.cache_bytes = parse_bytes(text).map_err(|sentence| format!("--cache {sentence}"))?;
    }
    for object in &mut plan.objects[..first_copies] {
        if let Some(model) = &overrides.model {
            // Made absolute, because the plan's relative paths start from the scene's folder.
            let absolute = std::path::absolute(model)
                .map_err(|error| format!("--model {}: {error}", model.display()))?;
            object.model = ModelSource::File(absolute);
        }
        if let Some(size) = overrides.size_m {
            object.scale = ModelScale::Size(LENGTH.check("--size (metres)", size)?);
        }
    }
    let (speed, seed) = (overrides.speed_m_per_s, overrides.seed);
    if speed.is_none() && seed.is_none() {
        return Ok(());
    }
    match plan.probes.first_mut().map(|probe| &mut probe.trajectory) {
        Some(TrajectoryPlan::Tour {
            seed: tour_seed,
            speed_m_per_s,
            ..
        }) => {
            if let Some(speed) = speed {
                *speed_m_per_s =
                    Range::Within(1e-6, 1e3).check("--speed (metres a second)", speed)?;
            }
            *tour_seed = seed.unwrap_or(*tour_seed);
            Ok(())
        }
        _ => Err(
            "--speed and --seed belong to a tour, but this scene's trajectory is a CSV file; leave them out or give the scene a tour".to_string(),
        ),
    }
}

#[cfg(test)]
#[path = "validate_tests.rs"]
mod tests;
