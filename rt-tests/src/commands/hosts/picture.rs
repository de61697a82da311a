//! What was seen over round trip and bandwidth.

use super::result::{Found, Row};
use crate::links::points::{Point, is_of_curves};
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, grid_under, xs, ys,
};
use crate::report::units::grouped;
use std::path::Path;

/// Height of a chart, pixels.
const HEIGHT: f64 = 300.0;

/// Name of the points where nothing was touched: they have no share, and stand at the bottom.
const UNTOUCHED: &str = "no contact";

/// A quantity of a link.
type Of = fn(&Point) -> f64;

const RTT: Of = |point| point.rtt_ms;
const BANDWIDTH: Of = |point| point.mbit;

/// Two charts as SVG.
#[must_use]
pub fn draw(found: &Found) -> String {
    let x = "round-trip time, ms";
    let against_rtt = chart(found, x, RTT, |point| format!("{} Mbit/s", point.mbit));
    let x = "bandwidth of each direction, Mbit/s";
    let against_bandwidth = chart(found, x, BANDWIDTH, |point| format!("{} ms", point.rtt_ms));
    grid(&[against_rtt, against_bandwidth], 1, HEIGHT, Ground::Paper)
}

/// A curve for each value of what is not on the axis.
fn chart(found: &Found, title: &str, x: Of, name: fn(&Point) -> String) -> Chart {
    let share = |row: &Row| row.full_share.map(|share| 100.0 * share);
    // A touch beside others is no point of the curve of those that are alone.
    let label = |row: &Row, point: &Point| name(point) + &row.conditions();
    let links = found.rows.iter();
    let links = links.filter_map(|row| {
        let point = row.point()?;
        Some((label(row, &point), x(&point), share(row)))
    });
    let links: Vec<(String, f64, Option<f64>)> = links.collect();
    let mut names: Vec<&str> = Vec::new();
    for (name, ..) in &links {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let curves = names.into_iter().zip(COLORS.into_iter().cycle());
    let curves = curves.map(|(label, color)| {
        let own = links.iter().filter(|(name, ..)| name == label);
        let own = own.filter_map(|(_, x, share)| Some((*x, (*share)?)));
        let mut own: Vec<(f64, f64)> = own.collect();
        own.sort_by(|a, b| a.0.total_cmp(&b.0));
        Curve::new(label, color, Stroke::Solid, own)
    });
    let mut curves: Vec<Curve> = curves.collect();
    let untouched = links.iter().filter(|(.., share)| share.is_none());
    let untouched: Vec<(f64, f64)> = untouched.map(|(_, x, _)| (*x, 0.0)).collect();
    if !untouched.is_empty() {
        curves.push(Curve::new(UNTOUCHED, GREY, Stroke::Dots, untouched));
    }
    let x = Axis::over(title, Unit::Number, xs(&curves));
    let y = Axis::linear("contact at full resolution, %", [100.0].into_iter()).with_room();
    let mut chart = Chart::new("Share of the contact at full resolution", x, y, curves);
    chart.names = Names::Legend;
    let local = found.rows.iter().find(|row| row.wire.is_none());
    chart.limit = local
        .and_then(share)
        .map(|share| (share, "one machine".to_string()));
    chart
}

/// Height of a chart of the whole, pixels.
const SMALL: f64 = 215.0;

/// A quantity of a touch; none where there was none.
type Seen = fn(&Row) -> Option<f64>;

/// A chart of the whole: what it shows, of which quantities, the first with a solid line and the
/// second with a dashed one.
struct Panel {
    title: &'static str,
    y: &'static str,
    unit: Unit,
    is_linear: bool,
    seen: &'static [Seen],
}

const PANELS: [Panel; 5] = [
    Panel {
        title: "Contact at full resolution",
        y: "share, %",
        unit: Unit::Number,
        is_linear: true,
        seen: &[|row| row.full_share.map(|share| 100.0 * share)],
    },
    Panel {
        title: "Error at the contact, median",
        y: "error",
        unit: Unit::Length,
        is_linear: false,
        seen: &[
            |row| row.certified_error_m.map(|error| error.p50),
            |row| row.measured_error_m.map(|error| error.p50),
        ],
    },
    Panel {
        title: "First touch, from the start",
        y: "time, ms",
        unit: Unit::Number,
        is_linear: false,
        seen: &[|row| row.first_touch_ms],
    },
    Panel {
        title: "Full resolution, from the first touch",
        y: "time, ms",
        unit: Unit::Number,
        is_linear: true,
        seen: &[|row| row.local_full_ms],
    },
    Panel {
        title: "Bytes on the wire for each VSP",
        y: "bytes",
        unit: Unit::Number,
        is_linear: true,
        // Those on one machine are of messages.
        seen: &[|row| row.wire.and(row.bytes_per_vsp)],
    },
];

/// Small charts as SVG: each quantity over the round trip and over the bandwidth, a colour for each
/// model.
#[must_use]
pub fn draw_whole(parts: &[Found]) -> String {
    let colors = || COLORS.into_iter().cycle();
    let mut charts = Vec::new();
    for panel in &PANELS {
        for axis in [0, 1] {
            let mut curves = Vec::new();
            for (part, color) in parts.iter().zip(colors()) {
                for (seen, stroke) in panel.seen.iter().zip([Stroke::Solid, Stroke::Dashed]) {
                    let points = points(part, axis, *seen);
                    curves.push(Curve::new(&short_name(part), color, stroke, points));
                }
            }
            // The same in all charts, also where a quantity was not seen.
            let all = parts
                .iter()
                .flat_map(|part| points(part, axis, |_| Some(0.0)));
            charts.push(panel.chart(axis, all.map(|point| point.0), curves));
        }
    }
    let names = parts.iter().zip(colors());
    let names = names.map(|(part, color)| (short_name(part), color, Stroke::Solid));
    let dashed = ("measured error".to_string(), GREY, Stroke::Dashed);
    let names: Vec<_> = names.chain([dashed]).collect();
    grid_under(&names, &charts, 2, SMALL, Ground::Paper)
}

impl Panel {
    /// Its chart over the round trip (0) or over the bandwidth (1).
    fn chart(&self, axis: usize, all: impl Iterator<Item = f64>, curves: Vec<Curve>) -> Chart {
        let title = match axis {
            0 => "round-trip time at 100 Mbit/s, ms (0: one machine)",
            _ => "bandwidth at 20 ms, Mbit/s",
        };
        let x = Axis::over(title, Unit::Number, all);
        let y = if self.is_linear {
            Axis::linear(self.y, ys(&curves)).with_room()
        } else {
            Axis::over(self.y, self.unit, ys(&curves))
        };
        Chart::new(self.title, x, y, curves)
    }
}

/// A quantity over the round trip (0), from one machine on, or over the bandwidth (1).
fn points(part: &Found, axis: usize, seen: Seen) -> Vec<(f64, f64)> {
    let alone = part.rows.iter().filter(|row| row.is_undisturbed());
    let points = alone.filter_map(|row| {
        let x = match (row.point(), axis) {
            (None, 0) => 0.0,
            (None, _) => return None,
            (Some(point), _) if !is_of_curves(point)[axis] => return None,
            (Some(point), 0) => point.rtt_ms,
            (Some(point), _) => point.mbit,
        };
        Some((x, seen(row)?))
    });
    let mut points: Vec<(f64, f64)> = points.collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// A model by the name of its file, or its shape.
fn short_name(part: &Found) -> String {
    match part.scene.model.split(':').collect::<Vec<_>>()[..] {
        ["generate", shape, _] => format!("{shape}, {} faces", grouped(part.scene.faces)),
        _ => {
            let stem = Path::new(&part.scene.model).file_stem().unwrap_or_default();
            stem.to_string_lossy().into_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::hosts::result::Wire;
    use crate::commands::hosts::session::Ask;
    use hrtc::result::{Finished, RunResult};

    fn row(link: Option<(f64, f64)>, contact_ticks: u64, full: u64) -> Row {
        let result = RunResult {
            contact_ticks,
            contact_full_ticks: full,
            ..RunResult::default()
        };
        let row = Row::of(Finished {
            result,
            ..Finished::default()
        });
        let Some((rtt_ms, mbit)) = link else {
            return row;
        };
        row.over(Point::new(rtt_ms, mbit), Wire::default())
    }

    #[test]
    fn a_link_without_a_contact_is_shown_apart() {
        let mut found = Found::default();
        found.add(row(Some((20.0, 100.0)), 100, 100), Ask::Nothing);
        found.add(row(Some((20.0, 0.25)), 0, 0), Ask::Nothing);
        let chart = chart(&found, "x", BANDWIDTH, |point| point.rtt_ms.to_string());
        let shown = |curve: &Curve| (curve.label.clone(), curve.points.len(), curve.points[0].1);
        let shown: Vec<_> = chart.curves.iter().map(shown).collect();
        let expected = [
            ("20".to_string(), 1, 100.0),
            (UNTOUCHED.to_string(), 1, 0.0),
        ];
        assert_eq!(shown, expected);
    }

    #[test]
    fn a_touch_beside_others_has_a_curve_of_its_own() {
        let mut found = Found::default();
        found.add(row(Some((20.0, 10.0)), 100, 100), Ask::Nothing);
        let mut among = row(Some((20.0, 10.0)), 100, 90);
        among.controllers = 3;
        found.add(among, Ask::Nothing);
        let mut lossy = row(Some((20.0, 10.0)), 100, 80);
        lossy.rests = true;
        lossy.loss = 0.01;
        found.add(lossy, Ask::Nothing);
        let chart = self::chart(&found, "x", RTT, |point| point.mbit.to_string());
        let labels = chart.curves.iter().map(|curve| curve.label.as_str());
        let expected = ["10", "10, one of 3", "10, 1 % lost, resting"];
        assert_eq!(labels.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn every_bandwidth_has_a_curve_whose_points_ascend() {
        let mut found = Found::default();
        found.add(row(None, 100, 98), Ask::Nothing);
        for link in [(100.0, 10.0), (1.0, 10.0), (20.0, 2.0)] {
            found.add(row(Some(link), 100, 75), Ask::Nothing);
        }
        let against_rtt = chart(&found, "x", RTT, |point| point.mbit.to_string());
        let labels = against_rtt.curves.iter().map(|curve| curve.label.as_str());
        assert_eq!(labels.collect::<Vec<_>>(), ["10", "2"]);
        let points = &against_rtt.curves[0].points;
        let points: Vec<(f64, f64)> = points.iter().map(|&(x, y, _)| (x, y)).collect();
        assert_eq!(points, [(1.0, 75.0), (100.0, 75.0)]);
        assert_eq!(against_rtt.limit.map(|limit| limit.0), Some(98.0));
    }

    #[test]
    fn the_whole_has_both_curves_of_every_model() {
        let mut found = Found::default();
        found.add(row(None, 100, 98), Ask::Nothing);
        let links = [(100.0, 100.0), (20.0, 2.0), (20.0, 100.0), (100.0, 0.25)];
        for (full, link) in (10..).zip(links) {
            found.add(row(Some(link), 100, full), Ask::Nothing);
        }
        let mut lossy = row(Some((1.0, 100.0)), 100, 50);
        lossy.loss = 0.01;
        found.add(lossy, Ask::Nothing);
        let mut among = row(Some((200.0, 100.0)), 100, 50);
        among.controllers = 3;
        found.add(among, Ask::Nothing);
        let share: Seen = |row| row.full_share.map(|share| 100.0 * share);
        let far = [(0.0, 98.0), (20.0, 12.0), (100.0, 10.0)];
        assert_eq!(points(&found, 0, share), far);
        assert_eq!(points(&found, 1, share), [(2.0, 11.0), (100.0, 12.0)]);
        found.scene.model = "generate:terrain:10000000".to_string();
        let svg = draw_whole(&[found]);
        assert!(svg.contains("terrain, 0 faces") && !svg.contains("NaN"));
    }
}
