//! What the queries of a touch cost by their counts: a fit of the times of its ticks.
//!
//! The touch runs in virtual time, then its ticks are done again several times; the time of a
//! tick's queries, effects and forces is the least of them. That time is to be a pair's cost, and
//! its units times theirs. Each tick weighs by its time, so that a long one counts as much as a
//! short one.

use super::check_stop;
use crate::failure::Failure;
use crate::report::quantile::Quantiles;
use crate::scenes::{BUNDLED_SCENE, SceneFile};
use crate::trajectory::stage_times::least_ns_with;
use crate::trajectory::virtual_scene::virtual_scene;
use glam::{DMat3, DVec3};
use hrtc_core::Stage;
use hrtc_core::governor::{QueryWork, WorkCosts};
use scene::{Overrides, ScenePlan, load};
use scene_files::DiskFiles;
use serde::Serialize;
use simulator::{Drive, new_controller};
use std::sync::atomic::AtomicBool;

/// Length of a touch, ticks.
const TICKS: usize = 6000;
/// Ticks from one look at the stop flag to the next.
const LOOK_TICKS: usize = 256;
/// A ball, and a tool.
const TOUCHES: [(&str, &str, QueryWork); 2] = [
    ("first-touch.toml", BUNDLED_SCENE, QueryWork::Ball),
    (
        "tool.toml",
        include_str!("../../../../config/scenes/tool.toml"),
        QueryWork::Tool,
    ),
];

/// The costs of a touch by its counts.
#[derive(Debug, Clone, Serialize)]
pub struct QueryFit {
    /// The scene.
    pub scene: &'static str,
    /// Ticks in contact.
    pub ticks: usize,
    /// Cost of a pair, of a unit of its searches and of its steps, ns.
    pub fitted_ns: [f64; 3],
    /// The same of the reference machine.
    pub reference_ns: [f64; 3],
    /// Time of a tick's queries over the fit of it.
    pub over_fit: Quantiles,
}

/// A tick: what its queries were counted as, and what they took, ns.
#[derive(Debug, Clone, Copy)]
struct Row {
    counts: DVec3,
    ns: f64,
}

/// The fits of a ball and a tool.
///
/// # Errors
/// When a scene cannot be served, a replay differs, or the command is to end.
pub fn query_fits(stop: &AtomicBool) -> Result<Vec<QueryFit>, Failure> {
    let costs = WorkCosts::REFERENCE;
    let one = |(scene, text, steps): (&'static str, &str, QueryWork)| {
        let rows = rows(scene, text, steps, stop)?;
        let fitted = fit(&rows).ok_or_else(|| {
            Failure::Run(format!("{scene}: its ticks do not tell the costs apart"))
        })?;
        let over = rows.iter().map(|row| row.ns / row.counts.dot(fitted));
        Ok(QueryFit {
            scene,
            ticks: rows.len(),
            fitted_ns: fitted.to_array(),
            reference_ns: [costs.contact, costs.search, costs.of_query(steps)],
            over_fit: Quantiles::of(&mut over.collect::<Vec<_>>()),
        })
    };
    TOUCHES.into_iter().map(one).collect()
}

/// The ticks of a touch that are in contact.
fn rows(name: &str, text: &str, steps: QueryWork, stop: &AtomicBool) -> Result<Vec<Row>, Failure> {
    check_stop(stop)?;
    let scene = SceneFile::of_text(name, text)?;
    let plan: ScenePlan = load(scene.path(), &Overrides::default(), &DiskFiles)?;
    let (mut simulation, options) = virtual_scene(&plan, TICKS as f64 / plan.loop_.rate_hz)?;
    simulation.client_mut().record();
    let mut counts = Vec::with_capacity(TICKS);
    for tick in 0..TICKS {
        if tick.is_multiple_of(LOOK_TICKS) {
            check_stop(stop)?;
        }
        simulation.advance(Drive::Hands, &mut hrtc_core::NoObserver);
        let record = &simulation.outputs().record;
        let units = record.query_units.map(f64::from);
        let of_steps = units[steps.unit()];
        let counted = DVec3::new(1.0, units[QueryWork::Search.unit()], of_steps);
        counts.push(record.contact.then_some(counted));
    }
    check_stop(stop)?;
    let recording = simulation.client_mut().take_recording().unwrap_or_default();
    let fresh = |_| new_controller(&plan, &options);
    let least = least_ns_with(&[(&recording, &plan)], &fresh)?.swap_remove(0);
    let of_pair = [Stage::Query, Stage::Force];
    let ns = least.iter().map(|stages| {
        let each = of_pair.map(|stage| f64::from(stages[stage as usize]));
        each.iter().sum::<f64>()
    });
    let ticks = counts.into_iter().zip(ns);
    let touching = ticks.filter_map(|(counts, ns)| counts.map(|counts| Row { counts, ns }));
    Ok(touching.filter(|row| row.ns > 0.0).collect())
}

/// The costs with the least squares of relative errors; none where the counts do not tell them
/// apart.
fn fit(rows: &[Row]) -> Option<DVec3> {
    let (mut squares, mut products) = (DMat3::ZERO, DVec3::ZERO);
    for row in rows {
        let weighted = row.counts / row.ns;
        let outer = weighted.to_array().map(|part| weighted * part);
        squares += DMat3::from_cols(outer[0], outer[1], outer[2]);
        products += weighted;
    }
    let costs = squares.inverse() * products;
    costs.is_finite().then_some(costs)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_run_once_the_command_is_to_end() {
        let ended = query_fits(&AtomicBool::new(true)).map(|fits| fits.len());
        assert_eq!(ended, Err(Failure::Run("ended on request".to_string())));
    }

    #[test]
    fn a_fit_finds_the_costs_that_made_the_times() {
        let costs = DVec3::new(2_000.0, 20.0, 300.0);
        let rows: Vec<Row> = (1..200_u32)
            .map(|k| {
                let counts = DVec3::new(1.0, f64::from(k % 37), f64::from(k * k % 101));
                let noise = if k % 2 == 0 { 1.01 } else { 0.99 };
                let ns = noise * counts.dot(costs);
                Row { counts, ns }
            })
            .collect();
        let found = fit(&rows).unwrap();
        assert!(
            ((found - costs) / costs).abs().max_element() < 0.02,
            "{found}"
        );
    }
}
