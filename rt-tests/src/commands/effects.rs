//! `rt-tests effects`: what each effect of a scene costs a tick, and that what is not listed costs
//! nothing.
//!
//! The device's poses are recorded once on the model of the scene's first object, 0.15 m long,
//! under the bundled scene's probe and without effects; then they go, in virtual time, to a
//! controller without effects, to one with each effect alone, and to one with all of them. The
//! ticks are timed from the recorded inputs in turns, so what differs is the effect. The same is
//! done with a tool, whose effects act at every contact.

use crate::failure::Failure;
use crate::report::output::{print, print_json};
use crate::report::quantile::Quantiles;
use crate::report::table::Table;
use crate::scenes::check_seconds;
use crate::trajectory::reference::{Reference, come_to_rest};
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::stage_times::{STAGES, least_ns};
use crate::trajectory::virtual_scene::make_ready;
use clap::Args;
use hrtc_core::Stage;
use hrtc_core::force::effects::UsageByKind;
use scene::{
    Effect, EffectPlan, ModelSource, NoFiles, Overrides, ProbeShape, ScenePlan, load, parse,
};
use scene_files::DiskFiles;
use serde::Serialize;
use simulator::InputRecording;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scene that lists every effect.
const BUNDLED: &str = include_str!("../../../config/scenes/effects.toml");
/// All effects of a scene together are to take less than this in a tick, nanoseconds.
const MAX_NS: f64 = 20_000.0;
/// The tool: the capsule of `config/scenes/tool.toml`.
const TOOL: ProbeShape = ProbeShape::Capsule {
    radius_m: 0.003,
    length_m: 0.02,
    faces: 960,
};
/// Seconds from which an effect acts that is listed but never comes.
const NEVER_S: f64 = 1e8;

/// Arguments of `rt-tests effects`.
#[derive(Debug, Args)]
pub struct EffectsArgs {
    /// Scene whose effects are measured [default: config/scenes/effects.toml, which lists every
    /// effect]
    #[arg(value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// Length of the tour
    #[arg(long, value_name = "S", default_value_t = 8.0)]
    pub seconds: f64,
    /// Seed of the tour
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Print one JSON object with the result on standard output
    #[arg(long)]
    pub json: bool,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
pub struct Effects {
    /// Seed of the tour.
    pub seed: u64,
    /// The effects that the scene lists, and all of them together as `all`.
    pub effects: Vec<Cost>,
    /// Calls of effects where they were not listed.
    pub unlisted_calls: u64,
    /// Bytes of effects where they were not listed.
    pub unlisted_bytes: u64,
    /// Whether effects that are listed but do not act leave every bit of every tick as it is
    /// without them.
    pub unlisted_bit_equal: bool,
    /// Whether nothing unlisted was called, and all effects together acted and stayed below 20 µs
    /// in 99 of 100 ticks.
    pub pass: bool,
}

/// What an effect costs, over the ticks in which it acts: with it, less without.
#[derive(Debug, Serialize)]
pub struct Cost {
    /// Its name in a scene.
    pub name: &'static str,
    /// What touches: `ball` or `tool`.
    pub probe: &'static str,
    /// Median, nanoseconds a tick.
    pub ns_per_tick: f64,
    /// 99 of 100 ticks take no more.
    pub p99_ns: f64,
    /// The most.
    pub max_ns: f64,
    /// Ticks in which it was called.
    pub ticks: u64,
    /// Bytes of its state.
    pub bytes: usize,
    /// Ticks at which the force was another one than without it.
    pub felt_ticks: u64,
}

/// A recorded run.
struct Recorded {
    plan: ScenePlan,
    recording: InputRecording,
    /// Ticks before the tour.
    start: usize,
    usage: UsageByKind,
    /// Of every tick of the tour: whether an effect was called, and the hash of all that came out
    /// so far.
    ticks: Vec<(bool, u64)>,
    forces: Vec<glam::DVec3>,
}

/// Runs the command.
///
/// # Errors
/// One sentence: status 2 for a bad scene, 1 when an effect that is not listed costs or changes
/// anything, or all of them cost too much or never act.
pub fn effects(args: &EffectsArgs) -> Result<(), Failure> {
    check_seconds(args.seconds)?;
    let found = measure(args)?;
    if args.json {
        print_json(&found)?;
    } else {
        print(&table(&found))?;
    }
    if found.pass {
        return Ok(());
    }
    Err(Failure::Run(
        "all effects together cost too much or never act, or one costs or changes something where it is not listed: see the table"
            .to_string(),
    ))
}

/// Measures the effects of a scene.
///
/// # Errors
/// One sentence for a scene that is refused, lists no effect, or whose object is not touched.
pub fn measure(args: &EffectsArgs) -> Result<Effects, Failure> {
    let none = Overrides::default();
    let scene = match &args.scene {
        Some(path) => load(path, &none, &DiskFiles)?,
        None => parse(BUNDLED, "effects", Path::new(""), &none, &NoFiles)?,
    };
    let listed: Vec<EffectPlan> = scene.objects[0]
        .effects
        .iter()
        .chain(&scene.effects)
        .cloned()
        .map(|effect| EffectPlan {
            from_s: 0.0,
            until_s: f64::INFINITY,
            ..effect
        })
        .collect();
    if listed.is_empty() {
        return Err(Failure::Input(
            "the scene lists no effect at its first object or for itself; take config/scenes/effects.toml to see all of them"
                .to_string(),
        ));
    }
    let typed = match &scene.objects[0].model {
        ModelSource::Generate { shape, faces } => format!("{shape}:{faces}"),
        ModelSource::File(path) => scene.folder.join(path).display().to_string(),
    };
    let mut model = SceneModel::open(&typed)?;
    let mut found = Effects {
        seed: args.seed,
        effects: Vec::new(),
        unlisted_calls: 0,
        unlisted_bytes: 0,
        unlisted_bit_equal: true,
        pass: true,
    };
    for (probe, shape) in [("ball", None), ("tool", Some(TOOL))] {
        if let Some(shape) = shape {
            model.plan.probes[0].shape = shape;
        }
        measure_probe(probe, &model, &listed, args, &mut found)?;
    }
    Ok(found)
}

/// Measures the effects on one probe.
fn measure_probe(
    probe: &'static str,
    model: &SceneModel,
    listed: &[EffectPlan],
    args: &EffectsArgs,
    found: &mut Effects,
) -> Result<(), Failure> {
    let reference = Reference::record(model, args.seed, args.seconds)?;
    let record = |effects: &[EffectPlan]| record(model, &reference, effects);
    let plain = record(&[])?;
    let never: Vec<EffectPlan> = listed
        .iter()
        .map(|effect| EffectPlan {
            from_s: NEVER_S,
            ..effect.clone()
        })
        .collect();
    let never = record(&never)?;
    let mut runs = vec![plain];
    for effect in listed {
        runs.push(record(std::slice::from_ref(effect))?);
    }
    runs.push(record(listed)?);

    let pairs: Vec<(&InputRecording, &ScenePlan)> =
        runs.iter().map(|run| (&run.recording, &run.plan)).collect();
    let ns = least_ns(&pairs)?;
    let names = listed.iter().map(|effect| effect.effect.name());
    for (k, name) in names.chain(["all"]).enumerate() {
        let (with, with_ns) = (&runs[k + 1], &ns[k + 1]);
        let cost = cost((name, probe), &runs[0], with, &ns[0], with_ns);
        found.effects.push(cost);
    }
    let unlisted = |run: &Recorded, listed: Option<&'static str>| {
        let kinds = Effect::NAMES.iter().zip(&run.usage);
        let others = kinds.filter(|&(&name, _)| listed != Some(name));
        others.fold((0, 0), |(calls, bytes), (_, usage)| {
            (calls + usage.calls, bytes + usage.bytes as u64)
        })
    };
    let alone = listed.iter().map(|effect| Some(effect.effect.name()));
    for (run, listed) in runs.iter().zip([None].into_iter().chain(alone)) {
        let (calls, bytes) = unlisted(run, listed);
        found.unlisted_calls += calls;
        found.unlisted_bytes += bytes;
    }
    found.unlisted_calls += unlisted(&never, None).0;
    found.unlisted_bit_equal &= never.ticks == runs[0].ticks;
    // Effects that never acted cost nothing that was measured.
    let all = found.effects.last().filter(|all| all.ticks > 0);
    let all = all.map_or(f64::INFINITY, |all| all.p99_ns);
    found.pass = found.pass
        && all < MAX_NS
        && found.unlisted_calls + found.unlisted_bytes == 0
        && found.unlisted_bit_equal;
    Ok(())
}

/// The recorded poses with these effects.
fn record(
    model: &SceneModel,
    reference: &Reference,
    effects: &[EffectPlan],
) -> Result<Recorded, Failure> {
    let mut plan = model.plan.clone();
    let (of_surface, of_scene): (Vec<_>, Vec<_>) = effects
        .iter()
        .cloned()
        .partition(|effect| effect.effect.is_of_surface());
    plan.objects[0].effects = Arc::from(of_surface);
    plan.effects = of_scene;
    let mut simulation = model.simulation(&plan)?;
    simulation.client_mut().record();
    let ready = make_ready(&mut simulation)?;
    come_to_rest(&mut simulation, reference.rest, ready)?;
    let start = simulation.tick() as usize;
    let calls = |usage: UsageByKind| usage.iter().map(|kind| kind.calls).sum::<u64>();
    let mut before = calls(simulation.controller().effects());
    let (mut ticks, mut forces) = (Vec::new(), Vec::new());
    for &sample in &reference.samples {
        let force = simulation.step(Some(sample)).wrenches[0].force;
        let now = calls(simulation.controller().effects());
        ticks.push((now > before, simulation.controller().replay_hash()));
        forces.push(force);
        before = now;
    }
    let recording = simulation.client_mut().take_recording().unwrap_or_default();
    Ok(Recorded {
        plan,
        recording,
        start,
        usage: simulation.controller().effects(),
        ticks,
        forces,
    })
}

type StageNs = [u32; STAGES];

fn cost(
    (name, probe): (&'static str, &'static str),
    plain: &Recorded,
    with: &Recorded,
    plain_ns: &[StageNs],
    with_ns: &[StageNs],
) -> Cost {
    // Effects act between the end of the boxes and the end of the tick.
    let taken =
        |ns: &StageNs| f64::from(ns[Stage::Query as usize]) + f64::from(ns[Stage::Force as usize]);
    let mut more: Vec<f64> = with
        .ticks
        .iter()
        .zip(&plain_ns[plain.start..])
        .zip(&with_ns[with.start..])
        .filter(|((tick, _), _)| tick.0)
        .map(|((_, plain), with)| taken(with) - taken(plain))
        .collect();
    let quantiles = Quantiles::of(&mut more);
    Cost {
        name,
        probe,
        ns_per_tick: quantiles.p50,
        p99_ns: quantiles.p99,
        max_ns: quantiles.max,
        ticks: more.len() as u64,
        bytes: with.usage.iter().map(|kind| kind.bytes).sum(),
        felt_ticks: with
            .forces
            .iter()
            .zip(&plain.forces)
            .filter(|(with, without)| with != without)
            .count() as u64,
    }
}

fn table(found: &Effects) -> String {
    let heads = "effect | probe | median | p99 | max | ticks | felt in | bytes";
    let mut table = Table::new(2, heads);
    for cost in &found.effects {
        let ns = |ns: f64| match cost.ticks {
            0 => "none".to_string(),
            _ => format!("{ns:.0}"),
        };
        table.row([
            cost.name.to_string(),
            cost.probe.to_string(),
            ns(cost.ns_per_tick),
            ns(cost.p99_ns),
            ns(cost.max_ns),
            cost.ticks.to_string(),
            cost.felt_ticks.to_string(),
            cost.bytes.to_string(),
        ]);
    }
    format!(
        "cost of an effect in a tick in which it acts, ns (seed {})\n\n{table}\nnot listed: {} calls, {} bytes, forces {}\n{}\n",
        found.seed,
        found.unlisted_calls,
        found.unlisted_bytes,
        if found.unlisted_bit_equal {
            "equal bit for bit"
        } else {
            "DIFFERENT"
        },
        if found.pass { "pass" } else { "FAIL" }
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_never_acted_has_no_cost() {
        let cost = |ticks: u64| Cost {
            name: "damping",
            probe: "ball",
            ns_per_tick: 0.0,
            p99_ns: 0.0,
            max_ns: 0.0,
            ticks,
            bytes: 0,
            felt_ticks: 0,
        };
        let found = |ticks: u64| Effects {
            seed: 1,
            effects: vec![cost(ticks)],
            unlisted_calls: 0,
            unlisted_bytes: 0,
            unlisted_bit_equal: true,
            pass: true,
        };
        assert_eq!(table(&found(0)).matches("none").count(), 3);
        assert!(!table(&found(1)).contains("none"));
    }
}
