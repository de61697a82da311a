//! The command line's values, laid over the plan.

use super::tick;
use crate::bytes::parse_bytes;
use crate::files::Files;
use crate::limits::{LENGTH_M, Limit, NOT_NEGATIVE, SPEED_M_PER_S};
use crate::plan::{ModelScale, ModelSource, Overrides, RefinementPlan, ScenePlan, TrajectoryPlan};

/// Applies the overrides. Model and size replace those of the first `first_copies` objects: the
/// first object table and its copies.
pub(super) fn apply(
    plan: &mut ScenePlan,
    first_copies: usize,
    overrides: &Overrides,
    files: &dyn Files,
) -> Result<(), String> {
    if let Some(tolerance) = overrides.tolerance_m {
        plan.accuracy.tolerance_m = NOT_NEGATIVE.check("--tolerance (metres)", tolerance)?;
        if let RefinementPlan::Global { lod: lod @ Some(_) } = &mut plan.accuracy.refinement {
            // The command line outranks the count of the scene.
            *lod = None;
        }
    }
    if let Some(text) = &overrides.cache {
        plan.cache_bytes = parse_bytes(text).map_err(|sentence| format!("--cache {sentence}"))?;
    }
    for object in &mut plan.objects[..first_copies] {
        if let Some(model) = &overrides.model {
            // Relative paths of the plan start from the scene's folder, this one does not.
            let absolute = files
                .absolute(model)
                .map_err(|error| format!("--model {}: {error}", model.display()))?;
            object.model = ModelSource::File(absolute);
        }
        if let Some(size) = overrides.size_m {
            object.scale = ModelScale::Size(LENGTH_M.check("--size (metres)", size)?);
        }
    }
    tick::override_loop(&mut plan.loop_, overrides)?;
    apply_to_path(plan, overrides)
}

fn apply_to_path(plan: &mut ScenePlan, overrides: &Overrides) -> Result<(), String> {
    let (speed, seed) = (overrides.speed_m_per_s, overrides.seed);
    if speed.is_none() && seed.is_none() {
        return Ok(());
    }
    match plan.probes.first_mut().map(|probe| &mut probe.trajectory) {
        Some(TrajectoryPlan::Tour {
            seed: path_seed,
            speed_m_per_s,
            ..
        }) => {
            if let Some(speed) = speed {
                *speed_m_per_s = SPEED_M_PER_S.check("--speed (metres a second)", speed)?;
            }
            *path_seed = seed.unwrap_or(*path_seed);
            Ok(())
        }
        Some(TrajectoryPlan::Points(points)) if points.is_empty() => Err(
            "--speed and --seed belong to a tour, but this scene's device has no trajectory; leave them out".to_string(),
        ),
        _ => Err(
            "--speed and --seed belong to a tour, but this scene's trajectory is a CSV file; leave them out or give the scene a tour".to_string(),
        ),
    }
}
