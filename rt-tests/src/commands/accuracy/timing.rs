//! Times of the settings' ticks, from their recorded inputs.

use super::measure::Measured;
use super::result::StageQuantiles;
use crate::failure::Failure;
use crate::report::quantile::Quantiles;
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::stage_times::{STAGES, least_ns_with};
use scene::ScenePlan;
use simulator::InputRecording;

/// Fills in the times of all settings of a model.
///
/// Only ticks in which the full mesh is touched count.
///
/// # Errors
/// When a replay does not give the recorded bits.
pub fn time(settings: &mut [Measured]) -> Result<(), Failure> {
    let recorded: Vec<(&InputRecording, &ScenePlan)> = settings
        .iter()
        .map(|setting| (&setting.recording, &setting.plan))
        .collect();
    let fresh = |k: usize| {
        let mut controller = SceneModel::controller(&settings[k].plan);
        if let Some(sources) = settings[k].sources {
            controller.set_sources(sources);
        }
        controller
    };
    let least = least_ns_with(&recorded, &fresh)?;
    for (setting, least) in settings.iter_mut().zip(&least) {
        summarise(setting, least);
    }
    Ok(())
}

fn summarise(setting: &mut Measured, least: &[[u32; STAGES]]) {
    let us = |ns: u64| ns as f64 * 1e-3;
    let whole = |ns: &[u32; STAGES]| us(ns.iter().map(|&ns| u64::from(ns)).sum());
    let trajectory = &least[setting.start..];
    let touching: Vec<&[u32; STAGES]> = trajectory
        .iter()
        .zip(&setting.contact)
        .filter_map(|(ns, &touching)| touching.then_some(ns))
        .collect();
    let mut times: Vec<f64> = touching.iter().map(|ns| whole(ns)).collect();
    let mut all: Vec<f64> = trajectory.iter().map(whole).collect();
    let point = &mut setting.point;
    point.tick_us = Quantiles::of(&mut times);
    point.all_tick_us = Quantiles::of(&mut all);
    let mut stages = [StageQuantiles::default(); STAGES];
    for (place, stage) in stages.iter_mut().enumerate() {
        let mut times: Vec<f64> = touching.iter().map(|ns| us(u64::from(ns[place]))).collect();
        let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
        *stage = StageQuantiles::of(mean, &Quantiles::of(&mut times));
    }
    let [inbox, refine, refit, query, force, _] = stages;
    point.stage_us.inbox = inbox;
    point.stage_us.refine = refine;
    point.stage_us.refit = refit;
    point.stage_us.query = query;
    point.stage_us.force = force;
}
