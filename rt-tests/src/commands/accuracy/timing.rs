//! Times of the settings' ticks, from their recorded inputs.

use super::measure::Measured;
use super::result::{StageQuantiles, StageTimes};
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
        settings[k].beside.set(&mut controller);
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
    point.stage_us = stage_times(&touching);
}

/// The stages of some ticks.
fn stage_times(ticks: &[&[u32; STAGES]]) -> StageTimes {
    let mut stages = [StageQuantiles::default(); STAGES];
    for (place, stage) in stages.iter_mut().enumerate() {
        let mut times: Vec<f64> = ticks.iter().map(|ns| f64::from(ns[place]) * 1e-3).collect();
        let mean = times.iter().sum::<f64>() / times.len().max(1) as f64;
        *stage = StageQuantiles::of(mean, &Quantiles::of(&mut times));
    }
    let [inbox, refine, refit, query, force, broad_phase] = stages;
    StageTimes {
        inbox,
        refine,
        refit,
        query,
        force,
        broad_phase,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_means_of_the_stages_sum_up_to_that_of_a_tick() {
        let ticks = [[1_000, 2_000, 3_000, 4_000, 5_000, 6_000], [500; STAGES]];
        let means = stage_times(&[&ticks[0], &ticks[1]]).named();
        let sum: f64 = means.iter().map(|(_, stage)| stage.mean).sum();
        assert!((sum - 12.0).abs() < 1e-12, "{sum}");
    }
}
