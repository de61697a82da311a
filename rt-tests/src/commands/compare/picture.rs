//! The pictures of a comparison.

use super::levels::Level;
use super::marking::{Marking, Spread};
use super::row::{Row, Who};
use super::{Compare, closest, tools};
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, xs, ys,
};

/// Height of a chart, pixels.
const HEIGHT: f64 = 250.0;

/// Every picture that has data, as SVG with the name of its file.
pub fn pictures(found: &Compare) -> Vec<(&'static str, String)> {
    let pictures = [
        ("compare.svg", growth(found)),
        ("marking.svg", marking(found)),
        ("levels.svg", levels(found)),
    ];
    let drawn = pictures.into_iter().map(|(name, mut charts)| {
        charts.retain(|chart| !chart.curves.is_empty());
        (name, charts)
    });
    drawn
        .filter(|(_, charts)| !charts.is_empty())
        .map(|(name, charts)| (name, grid(&charts, 1, HEIGHT, Ground::Paper)))
        .collect()
}

/// A chart over a logarithmic number of faces, with the curves that have points.
fn over_faces(title: &str, x: &str, y: impl Fn(&[Curve]) -> Axis, curves: Vec<Curve>) -> Chart {
    let mut curves = curves;
    curves.retain(|curve| !curve.points.is_empty());
    let x = Axis::over(x, Unit::Number, xs(&curves));
    let mut chart = Chart::new(title, x, y(&curves), curves);
    chart.names = Names::Legend;
    chart
}

/// Cost against the number of faces: a chart for each task and quantile.
fn growth(found: &Compare) -> Vec<Chart> {
    let chart = |task: &str, title: &str, quantile: &str, of: fn(&Row) -> f64| {
        let colors = COLORS.into_iter().cycle();
        let curves = Who::ALL.into_iter().zip(colors).map(|(who, color)| {
            let is_ours = matches!(who, Who::OursLocal | Who::OursFull);
            let stroke = if is_ours { Stroke::Line } else { Stroke::Thin };
            let rows = found.growth.iter();
            let rows = rows.filter(|row| row.who == who && row.task == task);
            let points = rows.map(|row| (f64::from(row.faces), of(row)));
            Curve::new(who.words(), color, stroke, points)
        });
        over_faces(
            &format!("{title}: {quantile}"),
            "faces of the full mesh",
            |curves| Axis::over("ns", Unit::Number, ys(curves)),
            curves.collect(),
        )
    };
    let titles = [
        (closest::PATH, "Closest point along a path, no memory"),
        (closest::MEMORY, "Closest point along a path"),
        (closest::COLD, "Closest point, caches swept"),
        (tools::TOOLS[0].0, "All pairs of a tool of 240 faces"),
        (tools::TOOLS[1].0, "All pairs of a tool of 960 faces"),
        ("update64", "Update of 64 deformed faces"),
    ];
    let charts = titles.into_iter().flat_map(|(task, title)| {
        [
            chart(task, title, "median", |row| row.p50_ns),
            chart(task, title, "99th of 100", |row| row.p99_ns),
        ]
    });
    charts.collect()
}

/// Nodes that an update marks, of the first model (thesis Figure 4.7).
fn marking(found: &Compare) -> Vec<Chart> {
    let first = found.marking.first().map(|row| row.model.as_str());
    let rows = |spread: Spread| {
        let is_drawn =
            move |row: &&Marking| Some(row.model.as_str()) == first && row.spread == spread;
        found.marking.iter().filter(is_drawn)
    };
    let curves = |of: fn(&Marking) -> f64| {
        let spreads = Spread::ALL.into_iter().zip(COLORS);
        let curves = spreads.map(|(spread, color)| {
            let points = rows(spread).map(|row| (f64::from(row.deformed), of(row)));
            Curve::new(spread.words(), color, Stroke::Thin, points)
        });
        curves.collect::<Vec<_>>()
    };
    let mut marked = curves(|row| f64::from(row.marked_max));
    let bound = rows(Spread::Even).map(|row| (f64::from(row.deformed), row.bound as f64));
    marked.push(Curve::new("Theorem 2", GREY, Stroke::Dotted, bound));
    let chart = |title: &str, y: &str, curves| {
        let y = |curves: &[Curve]| Axis::over(y, Unit::Number, ys(curves));
        over_faces(title, "leaves deformed", y, curves)
    };
    vec![
        chart("Nodes marked by an update", "nodes", marked),
        chart("Time of an update", "ns", curves(|row| row.update_p50_ns)),
    ]
}

/// A probe against the coarse, the locally refined and the full mesh (thesis Figure 5.20): models
/// as dots, shapes of one family as lines.
fn levels(found: &Compare) -> Vec<Chart> {
    let chart = |title: &str, y: &str, of: fn(&Level) -> f64| {
        let fronts = [("coarse", GREY), ("local", COLORS[0]), ("full", COLORS[2])];
        let curves = fronts.into_iter().flat_map(|(front, color)| {
            let families = [
                (&found.levels, "models", Stroke::Dots),
                (&found.growth_levels, "relief", Stroke::Line),
            ];
            families.map(|(levels, family, stroke)| {
                let levels = levels.iter().filter(|level| level.front == front);
                let mut points: Vec<(f64, f64)> = levels
                    .map(|level| (f64::from(level.faces), of(level)))
                    .collect();
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Curve::new(&format!("{front}, {family}"), color, stroke, points)
            })
        });
        let y = |curves: &[Curve]| Axis::linear(y, ys(curves)).with_room();
        over_faces(title, "faces of the full mesh", y, curves.collect())
    };
    vec![
        chart("Query of a cylinder probe: median", "µs", |level| {
            level.p50_ns / 1e3
        }),
        chart("Pairs of nodes visited", "pairs", |level| level.node_pairs),
    ]
}
