//! The share of full resolution over round trip and bandwidth.

use super::result::{Found, Row, Wire};
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, xs,
};

/// Height of a chart, pixels.
const HEIGHT: f64 = 300.0;

/// Name of the points where nothing was touched: they have no share, and stand at the bottom.
const UNTOUCHED: &str = "no contact";

/// A quantity of a link.
type Of = fn(&Wire) -> f64;

const RTT: Of = |wire| wire.rtt_ms;
const BANDWIDTH: Of = |wire| wire.mbit_per_s;

/// Two charts as SVG.
#[must_use]
pub fn draw(found: &Found) -> String {
    let x = "round-trip time, ms";
    let against_rtt = chart(found, x, RTT, |wire| format!("{} Mbit/s", wire.mbit_per_s));
    let x = "bandwidth of each direction, Mbit/s";
    let against_bandwidth = chart(found, x, BANDWIDTH, |wire| format!("{} ms", wire.rtt_ms));
    grid(&[against_rtt, against_bandwidth], 1, HEIGHT, Ground::Paper)
}

/// A curve for each value of what is not on the axis.
fn chart(found: &Found, title: &str, x: Of, name: fn(&Wire) -> String) -> Chart {
    let share = |row: &Row| row.full_share.map(|share| 100.0 * share);
    // A touch beside others is no point of the curve of those that are alone.
    let label = |row: &Row, wire: &Wire| match row.controllers {
        1 => name(wire),
        of => format!("{}, one of {of}", name(wire)),
    };
    let links = found.rows.iter();
    let links = links.filter_map(|row| {
        let wire = row.wire.as_ref()?;
        Some((label(row, wire), x(wire), share(row)))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::hosts::way::Carried;
    use crate::report::quantile::Quantiles;
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
        let Some((rtt_ms, mbit_per_s)) = link else {
            return row;
        };
        row.over(Wire {
            rtt_ms,
            mbit_per_s,
            loss: 0.0,
            to_controller: Carried::default(),
            to_station: Carried::default(),
            late_ms: Quantiles::default(),
        })
    }

    #[test]
    fn a_link_without_a_contact_is_shown_apart() {
        let mut found = Found::default();
        found.add(row(Some((20.0, 100.0)), 100, 100), None);
        found.add(row(Some((20.0, 0.25)), 0, 0), None);
        let chart = chart(&found, "x", BANDWIDTH, |wire| wire.rtt_ms.to_string());
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
        found.add(row(Some((20.0, 10.0)), 100, 100), None);
        let mut among = row(Some((20.0, 10.0)), 100, 90);
        among.controllers = 3;
        found.add(among, None);
        let chart = chart(&found, "x", RTT, |wire| wire.mbit_per_s.to_string());
        let labels = chart.curves.iter().map(|curve| curve.label.as_str());
        assert_eq!(labels.collect::<Vec<_>>(), ["10", "10, one of 3"]);
    }

    #[test]
    fn every_bandwidth_has_a_curve_whose_points_ascend() {
        let mut found = Found::default();
        found.add(row(None, 100, 98), None);
        for link in [(100.0, 10.0), (1.0, 10.0), (20.0, 2.0)] {
            found.add(row(Some(link), 100, 75), None);
        }
        let against_rtt = chart(&found, "x", RTT, |wire| wire.mbit_per_s.to_string());
        let labels = against_rtt.curves.iter().map(|curve| curve.label.as_str());
        assert_eq!(labels.collect::<Vec<_>>(), ["10", "2"]);
        let points = &against_rtt.curves[0].points;
        let points: Vec<(f64, f64)> = points.iter().map(|&(x, y, _)| (x, y)).collect();
        assert_eq!(points, [(1.0, 75.0), (100.0, 75.0)]);
        assert_eq!(against_rtt.limit.map(|limit| limit.0), Some(98.0));
    }
}
