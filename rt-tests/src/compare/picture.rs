//! The pictures of a comparison.

use super::levels::Level;
use super::marking::{Marking, Spread};
use super::{Compare, Row, Who, tools};
use crate::plots::{BLUE, Curve, GREEN, GREY, ORANGE, PURPLE, Panel, Picture};

/// Every picture with the name of its file.
pub fn pictures(found: &Compare) -> Vec<(&'static str, Picture)> {
    vec![
        ("compare.svg", growth(found)),
        ("marking.svg", marking(found)),
        ("levels.svg", levels(found)),
    ]
}

/// Cost against the number of faces: a panel for each task and quantile.
fn growth(found: &Compare) -> Picture {
    let panel = |task: &str, title: &str, quantile: &str, of: fn(&Row) -> f64| Panel {
        title: format!("{title}: {quantile}"),
        y_label: "ns".to_string(),
        y_log: true,
        curves: Who::ALL
            .into_iter()
            .zip([BLUE, GREEN, ORANGE, GREY, PURPLE])
            .map(|(who, color)| Curve {
                label: who.words().to_string(),
                color,
                points: found
                    .growth
                    .iter()
                    .filter(|row| row.who == who && row.task == task)
                    .map(|row| (f64::from(row.faces), of(row)))
                    .collect(),
                dots: false,
            })
            .filter(|curve| !curve.points.is_empty())
            .collect(),
        ..Panel::default()
    };
    let titles = [
        ("closest_path", "Closest point along a path"),
        (tools::TOOLS[0].0, "All pairs of a tool of 240 faces"),
        (tools::TOOLS[1].0, "All pairs of a tool of 960 faces"),
        ("update64", "Update of 64 deformed faces"),
    ];
    Picture {
        x_label: "faces of the full mesh".to_string(),
        x_log: true,
        panels: titles
            .into_iter()
            .flat_map(|(task, title)| {
                [
                    panel(task, title, "median", |row| row.p50_ns),
                    panel(task, title, "99th of 100", |row| row.p99_ns),
                ]
            })
            .collect(),
    }
}

/// Nodes that an update marks, of the first model (thesis Figure 4.7).
fn marking(found: &Compare) -> Picture {
    let first = found.marking.first().map(|row| row.model.as_str());
    let rows = || {
        let of_first = |model: &str| Some(model) == first;
        found.marking.iter().filter(move |row| of_first(&row.model))
    };
    let curves = |of: fn(&Marking) -> f64| {
        Spread::ALL
            .into_iter()
            .zip([BLUE, GREEN, ORANGE])
            .map(|(spread, color)| Curve {
                label: spread.words().to_string(),
                color,
                points: rows()
                    .filter(|row| row.spread == spread)
                    .map(|row| (f64::from(row.deformed), of(row)))
                    .collect(),
                dots: false,
            })
            .collect::<Vec<_>>()
    };
    let mut marked = curves(|row| f64::from(row.marked_max));
    marked.push(Curve {
        label: "Theorem 2".to_string(),
        color: GREY,
        points: rows()
            .filter(|row| row.spread == Spread::Even)
            .map(|row| (f64::from(row.deformed), row.bound as f64))
            .collect(),
        dots: false,
    });
    let panel = |title: &str, y_label: &str, curves| Panel {
        title: title.to_string(),
        y_label: y_label.to_string(),
        y_log: true,
        curves,
        ..Panel::default()
    };
    Picture {
        x_label: "leaves deformed".to_string(),
        x_log: true,
        panels: vec![
            panel("Nodes marked by an update", "nodes", marked),
            panel("Time of an update", "ns", curves(|row| row.update_p50_ns)),
        ],
    }
}

/// A probe against the coarse, the locally refined and the full mesh (thesis Figure 5.20): models as dots, shapes of one
/// family as lines.
fn levels(found: &Compare) -> Picture {
    let panel = |title: &str, y_label: &str, of: fn(&Level) -> f64| {
        let curves = [("coarse", GREY), ("local", BLUE), ("full", GREEN)]
            .into_iter()
            .flat_map(|(front, color)| {
                [(&found.levels, true), (&found.growth_levels, false)].map(|(levels, dots)| {
                    let levels = levels.iter().filter(|level| level.front == front);
                    let mut points: Vec<(f64, f64)> = levels
                        .map(|level| (f64::from(level.faces), of(level)))
                        .collect();
                    points.sort_by(|a, b| a.0.total_cmp(&b.0));
                    let family = if dots { "models" } else { "relief" };
                    Curve {
                        label: format!("{front}, {family}"),
                        color,
                        points,
                        dots,
                    }
                })
            })
            .filter(|curve| !curve.points.is_empty())
            .collect();
        Panel {
            title: title.to_string(),
            y_label: y_label.to_string(),
            curves,
            ..Panel::default()
        }
    };
    Picture {
        x_label: "faces of the full mesh".to_string(),
        x_log: true,
        panels: vec![
            panel("Query of a cylinder probe: median", "µs", |level| {
                level.p50_ns / 1e3
            }),
            panel("Pairs of nodes visited", "pairs", |level| level.node_pairs),
        ],
    }
}
