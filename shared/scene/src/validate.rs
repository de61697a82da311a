//! From the scene as typed to the [`ScenePlan`]: every number is checked here. A scene is refused
//! with one sentence that names file, line and remedy.

mod cache;
mod device;
mod effects;
mod movable;
mod objects;
mod overrides;
mod record;
mod shape;
mod tick;
mod trajectory;

use crate::files::{Files, read_text};
use crate::limits::DEFAULT_CACHE_BYTES;
use crate::plan::{MAX_PROBES, Overrides, ProbePlan, ScenePlan, TrajectoryPlan};
use crate::source::{SceneError, Source};
use crate::typed::{ProbeTyped, SceneTyped};
use cache::cache_changes;
use device::{device_of_file, device_plan};
use objects::Objects;
use record::record_plan;
use shape::probe_shape;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tick::{accuracy_plan, loop_plan, safety_plan};
use toml::Spanned;
use trajectory::trajectory_plan;

/// Reads a scene file and validates it under the command line's overrides.
///
/// # Errors
/// One sentence that names the file, the line where there is one, and the remedy.
pub fn load(
    path: &Path,
    overrides: &Overrides,
    files: &dyn Files,
) -> Result<ScenePlan, SceneError> {
    let shown = path.display().to_string();
    let text = read_text(files, path).map_err(|error| {
        SceneError(format!(
            "{shown}: cannot be read as a scene ({error}); give the path of a scene file such as config/scenes/first-touch.toml"
        ))
    })?;
    let name = path
        .file_stem()
        .map_or_else(|| shown.clone(), |stem| stem.to_string_lossy().into_owned());
    let source = Source {
        shown: &shown,
        text: &text,
        folder: path.parent().unwrap_or(Path::new("")),
        files,
        maps: RefCell::default(),
    };
    plan(&source, &name, overrides)
}

/// Validates the text of a scene. `name` stands for the file in messages; relative paths start from
/// `folder`. Trajectories (CSV), tool meshes and height maps are read from `files`.
///
/// # Errors
/// One sentence that names the scene, the line where there is one, and the remedy.
pub fn parse(
    text: &str,
    name: &str,
    folder: &Path,
    overrides: &Overrides,
    files: &dyn Files,
) -> Result<ScenePlan, SceneError> {
    let source = Source {
        shown: name,
        text,
        folder,
        files,
        maps: RefCell::default(),
    };
    plan(&source, name, overrides)
}

fn plan(source: &Source, name: &str, overrides: &Overrides) -> Result<ScenePlan, SceneError> {
    let typed: SceneTyped = source.typed()?;
    let objects = Objects::new(source, &typed.object)?;
    let probes = probe_plans(source, &typed.probe, &objects, &overrides.devices)?;
    let mut plan = ScenePlan {
        name: name.to_string(),
        folder: source.folder.to_path_buf(),
        loop_: loop_plan(source, &typed.loop_)?,
        cache_bytes: typed
            .cache
            .bytes
            .map_or(DEFAULT_CACHE_BYTES, |bytes| bytes.0),
        cache_changes: Arc::new([]),
        accuracy: accuracy_plan(source, &typed.accuracy)?,
        safety: safety_plan(source, &typed.safety)?,
        record: record_plan(source, &typed.record)?,
        objects: objects.plans,
        probes,
        effects: Vec::new(),
    };
    let first_copies = objects.copies.first().map_or(0, |copies| copies.end);
    overrides::apply(&mut plan, first_copies, overrides, source.files)
        .map_err(|sentence| source.whole(&sentence))?;
    plan.cache_changes = cache_changes(source, &typed.cache.change, plan.cache_bytes)?;
    trajectory::check(source, &typed.probe, &plan)?;
    device::check(source, &typed.probe, &overrides.devices, &plan)?;
    effects::add(source, &typed, &objects.copies, &mut plan)?;
    let tables = typed.object.iter().map(Spanned::get_ref);
    movable::check(source, tables.zip(&objects.copies), &plan)?;
    Ok(plan)
}

fn probe_plans(
    source: &Source,
    typed: &[Spanned<ProbeTyped>],
    objects: &Objects,
    devices: &[PathBuf],
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
    if devices.len() > typed.len() {
        return Err(source.whole(&format!(
            "--device is given {} times, but there are {} probes; give it once for each of the first probes at the most",
            devices.len(),
            typed.len()
        )));
    }
    let own = devices.iter().map(Some).chain(std::iter::repeat(None));
    typed
        .iter()
        .zip(own)
        .map(|(probe, own)| {
            let probe = probe.get_ref();
            let shape = probe_shape(source, probe.shape.as_ref())?;
            let (device, custom_device) = match own {
                Some(file) => device_of_file(source.files, file, &shape)?,
                None => device_plan(source, probe.device.as_ref(), &shape)?,
            };
            let trajectory = match &probe.trajectory {
                // A custom device moves by itself unless the scene gives it a path.
                None if custom_device.is_some() => TrajectoryPlan::Points(Vec::new()),
                typed => trajectory_plan(source, typed.as_ref(), objects)?,
            };
            Ok(ProbePlan {
                shape,
                device,
                custom_device,
                trajectory,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests;
