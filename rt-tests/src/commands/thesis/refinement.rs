//! Time of refinement in the controller (Figure 5.19).

use super::result::{Figure, Quote, Series};
use super::{Study, StudyModel};
use crate::commands::fronts::cost::cost;
use crate::failure::Failure;
use crate::models::surface::Surface;
use crate::report::chart::{Axis, COLORS, Chart, Curve, Stroke, Unit, xs, ys};
use crate::report::quantile::{Quantiles, quantile};
use crate::report::units::digits;
use crate::trajectory::scene_model::SceneModel;
use crate::trajectory::stage_times::least_ns;
use crate::trajectory::touch::touch;
use hrtc_core::Stage;

/// Length of the tour, seconds of simulated time.
const SECONDS: f64 = 10.0;

/// What refinement took on a model.
struct Refinement {
    faces: f64,
    /// Refinement and update of the tree in a tick of the tour, µs.
    tick_us: Quantiles,
    /// A split with its share of the update, mean of a batch, median, ns.
    split_ns: f64,
}

fn measure(study: &Study, of: &StudyModel) -> Result<Refinement, Failure> {
    let model = SceneModel::open(&of.typed)?;
    let mut simulation = model.simulation(&model.plan)?;
    simulation.client_mut().record();
    let start = touch(&model, &mut simulation, study.seed, SECONDS, &mut |_| ())?;
    let recording = simulation
        .client_mut()
        .take_recording()
        .ok_or_else(|| Failure::Run("nothing was recorded".to_string()))?;
    let least = least_ns(&[(&recording, &model.plan)])?.swap_remove(0);
    let stages = [Stage::Refine as usize, Stage::Refit as usize];
    let mut us: Vec<f64> = least[start as usize..]
        .iter()
        .map(|ns| stages.iter().map(|&k| f64::from(ns[k])).sum::<f64>() * 1e-3)
        .collect();
    let full = Surface::new(of.model.full_triangles());
    let cost = cost(&of.model, &full, &mut study.random())?;
    Ok(Refinement {
        faces: f64::from(of.faces()),
        tick_us: Quantiles::of(&mut us),
        split_ns: quantile(&cost.splits.batch_ns, 0.5),
    })
}

/// Figure 5.19.
///
/// # Errors
/// When a model cannot be touched.
pub fn figure_5_19(study: &Study) -> Result<Figure, Failure> {
    let mut series = Vec::new();
    let mut found = Vec::new();
    for of in &study.models {
        study.says(of, "time of refinement in a touch");
        let refinement = measure(study, of)?;
        let name = |what: &str| format!("{}: {what}", of.name);
        let us = refinement.tick_us;
        series.push(Series::new(name("T_R of a tick, median"), "µs", us.p50));
        series.push(Series::new(name("T_R of a tick, p99"), "µs", us.p99));
        series.push(Series::new(
            name("a split with its update, median"),
            "ns",
            refinement.split_ns,
        ));
        found.push(refinement);
    }
    found.sort_by(|a, b| a.faces.total_cmp(&b.faces));
    let (Some(first), Some(last)) = (found.first(), found.last()) else {
        return Err(Failure::Input("no model is given".to_string()));
    };
    let grown = last.split_ns / first.split_ns;
    let logarithm = last.faces.ln() / first.faces.ln();
    if found.len() > 1 {
        let name = "a split, largest model over smallest".to_string();
        series.push(Series::new(name, "", grown).beside(&[logarithm]));
    }
    let curve = |name: &str, color, of: fn(&Refinement) -> f64| {
        Curve::new(
            name,
            color,
            Stroke::Solid,
            found.iter().map(|row| (row.faces, of(row))),
        )
    };
    let ticks = vec![
        curve("median", COLORS[0], |row| row.tick_us.p50),
        curve("p99", COLORS[1], |row| row.tick_us.p99),
    ];
    let splits = vec![curve("a split", COLORS[0], |row| row.split_ns * 1e-3)];
    let axes = |title: &str, y: &str, curves: Vec<Curve>| {
        let x = Axis::over("faces of the full mesh", Unit::Number, xs(&curves));
        let y = Axis::linear(y, ys(&curves)).with_room();
        Chart::new(title, x, y, curves)
    };
    Ok(Figure {
        figure: "5.19",
        title: "Time of refinement in the controller",
        series,
        says: format!(
            "On tours at 0.1 m/s, at 0.15 m, refinement and the update of the tree take {} µs of a median tick on the \
             smallest model and {} µs on the largest, where more faces pass under the hand: a small constant, as in \
             the thesis. A split with its update costs {} times as much on the largest as on the smallest, beside {} \
             for the logarithm of the faces, which the thesis sees. It publishes curves and no numbers.",
            digits(first.tick_us.p50),
            digits(last.tick_us.p50),
            digits(grown),
            digits(logarithm)
        ),
        quotes: vec![Quote {
            section: "5.8",
            line: 3969,
            text: "When contact location does not change drastically, the time cost for mesh refinement is near a \
                small constant. With this assumption, T_R is observed to increase in the order of the logarithm of \
                the size of the full meshes.",
        }],
        charts: vec![
            axes("T_R in a tick", "refinement and update, µs", ticks),
            axes("A split with its update", "median, µs", splits),
        ],
        names: vec![
            ("median".to_string(), COLORS[0], Stroke::Solid),
            ("p99".to_string(), COLORS[1], Stroke::Solid),
        ],
    })
}
