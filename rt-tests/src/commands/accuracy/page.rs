//! The page: pictures, what they say, and the numbers, in one file without any other.

mod knobs;

use super::measure::{ROUNDING, TOOL_RADIUS_M};
use super::result::{Accuracy, Bytes, Knob, Point};
use super::table::{asked, bytes_row};
use crate::machine::Machine;
use crate::report::chart::{
    Axis, Bar, COLORS, Chart, Curve, Ground, Names, Stroke, Unit, WIDTH, bars, grid, key, xs, ys,
};
use crate::report::html::{self, escaped};
use crate::report::table::Table;
use crate::report::units::{bytes, digits, grouped, length};
use crate::trajectory::stage_times::REPEATS;
use hrtc::run::FIXED_BYTES;
use std::fmt::Write as _;

/// Colours of the knobs.
const LOCAL: &str = COLORS[0];
const GLOBAL: &str = COLORS[1];
const PREFIX: &str = COLORS[2];

/// The points of one model.
struct Group<'a> {
    name: &'a str,
    points: Vec<&'a Point>,
    bytes: Option<&'a Bytes>,
}

impl<'a> Group<'a> {
    fn all(found: &'a Accuracy) -> Vec<Self> {
        let mut groups: Vec<Self> = Vec::new();
        for point in &found.points {
            match groups.last_mut() {
                Some(group) if group.place() == point.model_place => group.points.push(point),
                _ => groups.push(Self {
                    name: &point.model,
                    points: vec![point],
                    bytes: None,
                }),
            }
        }
        for (group, bytes) in groups.iter_mut().zip(&found.bytes) {
            group.bytes = Some(bytes);
        }
        groups
    }

    /// The place of its model; each has a point.
    fn place(&self) -> usize {
        self.points.first().map_or(0, |point| point.model_place)
    }

    /// The settings of a knob under the hand at its own speed.
    fn of(&self, knob: Knob) -> impl Iterator<Item = (usize, &'a Point)> + '_ {
        let slow = self.points.first().map_or(0.0, |p| p.speed_m_per_s);
        let points = self.points.iter().copied();
        points
            .filter(move |p| p.knob == knob && p.speed_m_per_s == slow)
            .enumerate()
    }

    /// The same under the faster hand.
    fn faster(&self, knob: Knob) -> impl Iterator<Item = &'a Point> + '_ {
        let slow = self.points.first().map_or(0.0, |p| p.speed_m_per_s);
        let points = self.points.iter().copied();
        points.filter(move |p| p.knob == knob && p.speed_m_per_s != slow)
    }

    /// A curve over the settings of a knob.
    fn curve(
        &self,
        (label, color, stroke): (&str, &'static str, Stroke),
        knob: Knob,
        place: impl Fn(&Point) -> (f64, f64),
    ) -> Curve {
        Curve {
            label: label.to_string(),
            color,
            stroke,
            points: self
                .of(knob)
                .map(|(index, point)| {
                    let (x, y) = place(point);
                    (x, shown(y), short(point, index == 0))
                })
                .collect(),
        }
    }

    fn title(&self) -> String {
        let faces = self.bytes.map_or(0, |bytes| bytes.faces);
        format!("{}, {} faces", self.name, grouped(faces))
    }

    fn base(&self) -> Option<&'a Point> {
        self.of(Knob::Local).next().map(|(_, point)| point)
    }

    fn full(&self, knob: Knob) -> Option<&'a Point> {
        self.of(knob).map(|(_, p)| p).find(|p| p.full_mesh)
    }
}

/// An error as it is drawn: what rounding alone makes of 0 is 0, or most of the axis would be about
/// nothing.
fn shown(error: f64) -> f64 {
    if error < ROUNDING { 0.0 } else { error }
}

/// What was asked for, in a word or two.
fn short(point: &Point, first: bool) -> String {
    match (point.knob, point.full_mesh) {
        (Knob::Local, _) if first => "base".to_string(),
        (Knob::Local | Knob::Global, true) => "full".to_string(),
        _ => asked(point, first),
    }
}

/// The page.
#[must_use]
pub fn page(found: &Accuracy, machine: &Machine) -> String {
    let groups = Group::all(found);
    let mut html = String::new();
    let _ = writeln!(
        html,
        "<p>A 1 mm ball strokes each model, {} long, at {} m/s for {} s (tour {}). The device's poses were recorded once, in a closed loop on the mesh that was never simplified; every setting is given the same poses, so what differs between two points is the front alone. Errors are over every tick of contact.</p>",
        length(found.size_m),
        digits(found.speed_m_per_s),
        digits(found.seconds),
        found.seed
    );
    summary(&mut html, &groups);
    html.push_str("<h2>Error against time</h2>\n");
    hero(&mut html, &groups);
    html.push_str("<h2>Error against time, and what is asked against what is got</h2>\n");
    rows(&mut html, &groups);
    html.push_str("<h2>Where the time goes</h2>\n");
    stages(&mut html, &groups);
    html.push_str("<h2>Error against bytes and memory</h2>\n");
    costs(&mut html, &groups);
    knobs::knobs(&mut html, &groups);
    html.push_str("<h2>Bytes over the link</h2>\n");
    bytes_table(&mut html, found);
    html.push_str("<h2>All numbers</h2>\n");
    tables(&mut html, &groups);
    checks(&mut html, found);
    let _ = writeln!(
        html,
        "<p class=\"small\">Measured on {}, kernel {} ({}). Times are processor time of one thread; a tick's time is the least of {REPEATS} replays of that very tick, with the settings in turns, so that whatever slows the machine for a while slows them all. Those of a tool's queries are the least of three at one contact, taken while other settings are measured on the other cores. Absolute times still drift from run to run on a virtual machine: compare points of one page, not of two. The same numbers are in accuracy.csv and accuracy.json beside this page.</p>",
        escaped(&machine.processor),
        escaped(&machine.kernel),
        escaped(&machine.preemption)
    );
    html::page("What accuracy costs", &html)
}

/// A range of numbers over the models, in words.
fn span(numbers: impl Iterator<Item = f64>, word: impl Fn(f64) -> String) -> String {
    let (low, high) = numbers.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), n| {
        (low.min(n), high.max(n))
    });
    let (low, high) = (word(low), word(high));
    if low == high {
        low
    } else {
        format!("{low} to {high}")
    }
}

fn summary(html: &mut String, groups: &[Group<'_>]) {
    let rows: Vec<(&Bytes, &Point, &Point, &Point)> = groups
        .iter()
        .filter_map(|group| {
            let global = group.full(Knob::Global)?;
            Some((
                group.bytes?,
                group.base()?,
                group.full(Knob::Local)?,
                global,
            ))
        })
        .collect();
    if rows.is_empty() {
        return;
    }
    let size = |n: f64| bytes(n as u64);
    let reached: Vec<u64> = rows
        .iter()
        .filter_map(|row| u64::try_from(row.0.local_full_bytes).ok())
        .collect();
    let needed = span(reached.iter().map(|&bytes| bytes as f64), size);
    let full = match reached.len() {
        0 => "was never reached".to_string(),
        all if all == rows.len() => format!("has needed {needed}"),
        _ => format!("has needed {needed} where it was reached"),
    };
    let ms = |n: f64| format!("{} ms", digits(n));
    let us = |n: f64| format!("{} µs", digits(n));
    html.push_str("<h2>What refinement buys</h2>\n<ul>\n");
    let _ = writeln!(
        html,
        "<li><b>Bytes.</b> A first touch needs header and base mesh: {}, whatever the mesh. The first contact at full resolution {full}; the plain mesh is {}.</li>",
        span(rows.iter().map(|r| r.0.first_touch_bytes as f64), size),
        span(rows.iter().map(|r| r.0.plain_bytes as f64), size)
    );
    let _ = writeln!(
        html,
        "<li><b>Memory.</b> The cache held at most {} on this tour at local full resolution, and {} with the full mesh everywhere; the larger the mesh, the larger the gain.</li>",
        span(rows.iter().map(|r| r.2.cache_bytes as f64), size),
        span(rows.iter().map(|r| r.3.cache_bytes as f64), size)
    );
    let _ = writeln!(
        html,
        "<li><b>Start-up.</b> A touch can be answered after {} of simulated time; the full mesh everywhere is there after {}.</li>",
        span(rows.iter().map(|r| r.2.ready_ms), ms),
        span(rows.iter().map(|r| r.3.settled_ms), ms)
    );
    let _ = writeln!(
        html,
        "<li><b>Tool queries.</b> A tool meets every face within its reach: a ball of {} finds {} faces of the base mesh in {} (medians), and {} faces of the full mesh in {}.</li>",
        length(TOOL_RADIUS_M),
        span(rows.iter().map(|r| r.1.tool_faces), digits),
        span(rows.iter().map(|r| r.1.tool_us), us),
        span(rows.iter().map(|r| r.2.tool_faces), digits),
        span(rows.iter().map(|r| r.2.tool_us), us)
    );
    html.push_str("</ul>\n<h2>What it does not</h2>\n<ul>\n");
    let query = |point: &Point| point.stage_us.query.p50;
    let _ = writeln!(
        html,
        "<li><b>A warm point query is not faster.</b> At full resolution the query of a contact tick (proxy and closest point, median) takes {} on the local front and {} with the full mesh everywhere: that there are fewer faces elsewhere does not help, since the way down the tree grows with the logarithm only. What it costs is the faces in reach of the ball: {} on the base mesh.</li>",
        span(rows.iter().map(|r| query(r.2)), us),
        span(rows.iter().map(|r| query(r.3)), us),
        span(rows.iter().map(|r| query(r.1)), us)
    );
    let _ = writeln!(
        html,
        "<li><b>Following the hand costs ticks.</b> Prediction, records, splits and collapses make the median tick {} and one in a hundred {} at local full resolution, where they are {} and {} with the full mesh there already.</li>",
        span(rows.iter().map(|r| r.2.tick_us.p50), us),
        span(rows.iter().map(|r| r.2.tick_us.p99), us),
        span(rows.iter().map(|r| r.3.tick_us.p50), us),
        span(rows.iter().map(|r| r.3.tick_us.p99), us)
    );
    let _ = writeln!(
        html,
        "<li><b>A whole mesh does not get smaller.</b> All records are {} times the plain mesh, since each says where it fits; and a hand that goes everywhere on a small mesh receives more than the mesh ({} on these tours), since every region names its splits.</li>",
        span(
            rows.iter()
                .map(|r| r.0.records_bytes as f64 / r.0.plain_bytes as f64),
            digits
        ),
        span(rows.iter().map(|r| r.0.trajectory_bytes as f64), size)
    );
    html.push_str("</ul>\n");
}

/// All models in one picture: the median tick, and one in a hundred.
fn hero_charts(groups: &[Group<'_>]) -> [Chart; 2] {
    let chart = |title: &str, x: &str, number: fn(&Point) -> f64| {
        let colors = groups.iter().zip(COLORS.iter().cycle());
        let curves = colors.map(|(group, color)| {
            let name = (group.name, *color, Stroke::Solid);
            group.curve(name, Knob::Local, |p| (number(p), p.true_m))
        });
        let curves: Vec<Curve> = curves.collect();
        let x = Axis::over(x, Unit::Time, xs(&curves));
        let y = Axis::over("largest true error at a contact", Unit::Length, ys(&curves));
        Chart {
            names: Names::AtCurves,
            ..Chart::new(title, x, y, curves)
        }
    };
    let median = "time of a tick in contact, p50, µs";
    let slow = "time of a tick in contact, p99, µs";
    [
        chart("the median tick", median, |p| p.tick_us.p50),
        chart("one tick in a hundred", slow, |p| p.tick_us.p99),
    ]
}

/// That picture alone, as a file of its own.
pub fn curve(found: &Accuracy) -> String {
    grid(&hero_charts(&Group::all(found)), 2, 400.0, Ground::Paper)
}

fn hero(html: &mut String, groups: &[Group<'_>]) {
    html.push_str("<p>Local refinement: each point is a tolerance, from the base mesh (above) to the full mesh (error 0, below). Left the median tick in contact, right the 99th percentile.</p>\n");
    let names: Vec<(String, &str, Stroke)> = groups
        .iter()
        .zip(COLORS.iter().cycle())
        .map(|(group, &color)| (group.title(), color, Stroke::Solid))
        .collect();
    html.push_str(&key("", &names));
    html.push_str(&grid(&hero_charts(groups), 2, 400.0, Ground::Page));
}

/// A row of two charts for each model.
fn rows(html: &mut String, groups: &[Group<'_>]) {
    html.push_str("<p>Left, the largest true error at a contact over the time of a tick. Right, local refinement: errors over the tolerance that was asked for. The certified error bounds the true one in the same tick: on fronts of a tolerance closely, on others by how far vertices have moved, along the surface too.</p>\n");
    html.push_str(&key(
        "left",
        &[
            ("local, p50".to_string(), LOCAL, Stroke::Solid),
            ("local, p99".to_string(), LOCAL, Stroke::Thin),
            ("global, p50".to_string(), GLOBAL, Stroke::Solid),
            ("global, p99".to_string(), GLOBAL, Stroke::Thin),
            (
                "prefix of the sequence, p50".to_string(),
                PREFIX,
                Stroke::Dashed,
            ),
        ],
    ));
    html.push_str(&key(
        "right",
        &[
            ("largest true error".to_string(), LOCAL, Stroke::Solid),
            ("median true error".to_string(), LOCAL, Stroke::Thin),
            (
                "largest certified error".to_string(),
                GLOBAL,
                Stroke::Dashed,
            ),
            ("as asked".to_string(), "currentColor", Stroke::Dotted),
        ],
    ));
    let mut charts = Vec::new();
    for group in groups {
        let p50 = |p: &Point| (p.tick_us.p50, p.true_m);
        let p99 = |p: &Point| (p.tick_us.p99, p.true_m);
        let curves = vec![
            group.curve(("local, p50", LOCAL, Stroke::Solid), Knob::Local, p50),
            group.curve(("local, p99", LOCAL, Stroke::Thin), Knob::Local, p99),
            group.curve(("global, p50", GLOBAL, Stroke::Solid), Knob::Global, p50),
            group.curve(("global, p99", GLOBAL, Stroke::Thin), Knob::Global, p99),
            group.curve(("prefix, p50", PREFIX, Stroke::Dashed), Knob::Prefix, p50),
        ];
        let x = Axis::over("time of a tick in contact, µs", Unit::Time, xs(&curves));
        let y = Axis::over("largest true error", Unit::Length, ys(&curves));
        charts.push(Chart::new(&group.title(), x, y, curves));
        let curves = vec![
            group.curve(
                ("largest true error", LOCAL, Stroke::Solid),
                Knob::Local,
                |p| (p.value, p.true_m),
            ),
            group.curve(
                ("median true error", LOCAL, Stroke::Thin),
                Knob::Local,
                |p| (p.value, p.true_p50_m),
            ),
            group.curve(
                ("largest certified error", GLOBAL, Stroke::Dashed),
                Knob::Local,
                |p| (p.value, p.certified_m),
            ),
        ];
        let x = Axis::over("tolerance asked for", Unit::Length, xs(&curves));
        let y = Axis::over("error at the contact", Unit::Length, ys(&curves));
        charts.push(Chart {
            diagonal: true,
            ..Chart::new(&format!("{}: asked and got", group.name), x, y, curves)
        });
    }
    html.push_str(&grid(&charts, 2, 290.0, Ground::Page));
}

fn stages(html: &mut String, groups: &[Group<'_>]) {
    html.push_str("<p>Mean time of each stage in the ticks of contact, local refinement, and the full mesh everywhere (global). Behind the bars: the mean of a tick and its 99.9th percentile.</p>\n<p class=\"key\">");
    let names = [
        "inbox and prediction",
        "splits and collapses",
        "boxes",
        "query and proxy",
        "force and limiter",
        "broad phase",
    ];
    for (name, color) in names.iter().zip(COLORS) {
        let _ = write!(
            html,
            "<span><svg width=\"14\" height=\"12\"><rect width=\"14\" height=\"12\" fill=\"{color}\"/></svg> {name}</span> "
        );
    }
    html.push_str("</p>\n");
    let bar = |name: String, point: &Point| {
        let parts: Vec<f64> = point.stage_us.named().iter().map(|(_, s)| s.mean).collect();
        Bar {
            name,
            note: format!(
                "{:.1} µs, p99.9 {:.0} µs",
                parts.iter().sum::<f64>(),
                point.tick_us.p999
            ),
            parts,
        }
    };
    let groups: Vec<(String, Vec<Bar>)> = groups
        .iter()
        .map(|group| {
            let local = group.of(Knob::Local);
            let mut bars: Vec<Bar> = local
                .map(|(index, point)| bar(short(point, index == 0), point))
                .collect();
            if let Some(point) = group.full(Knob::Global) {
                bars.push(bar("full, global".to_string(), point));
            }
            (group.title(), bars)
        })
        .collect();
    html.push_str(&bars(&groups, 2, WIDTH));
}

fn costs(html: &mut String, groups: &[Group<'_>]) {
    let _ = writeln!(
        html,
        "<p>Bytes are those received over the whole tour, chunks and all, without the measured errors that the station sends back; memory is the most of the cache that was ever in use, beside fixed rings and a stack of {}.</p>",
        bytes(FIXED_BYTES as u64)
    );
    html.push_str(&key(
        "",
        &[
            ("local".to_string(), LOCAL, Stroke::Solid),
            ("global".to_string(), GLOBAL, Stroke::Solid),
            ("prefix of the sequence".to_string(), PREFIX, Stroke::Dashed),
        ],
    ));
    let mut charts = Vec::new();
    for group in groups {
        let three = |place: &dyn Fn(&Point) -> (f64, f64)| {
            vec![
                group.curve(("local", LOCAL, Stroke::Solid), Knob::Local, place),
                group.curve(("global", GLOBAL, Stroke::Solid), Knob::Global, place),
                group.curve(("prefix", PREFIX, Stroke::Dashed), Knob::Prefix, place),
            ]
        };
        for (what, curves) in [
            ("bytes received", three(&|p| (p.bytes as f64, p.true_m))),
            ("cache in use", three(&|p| (p.cache_bytes as f64, p.true_m))),
        ] {
            let x = Axis::over(what, Unit::Bytes, xs(&curves));
            let y = Axis::over("largest true error", Unit::Length, ys(&curves));
            charts.push(Chart::new(&group.title(), x, y, curves));
        }
    }
    html.push_str(&grid(&charts, 2, 270.0, Ground::Page));
}

fn bytes_table(html: &mut String, found: &Accuracy) {
    let mut table = Table::new(
        1,
        "model | vertices | faces | until the first touch: header and base mesh | \
            until local full resolution at the first contact | \
            whole tour at local full resolution | whole mesh as SPM records | \
            whole mesh as plain triangles",
    );
    for row in &found.bytes {
        table.row(bytes_row(row));
    }
    html.push_str(&table.html());
    html.push_str("<p class=\"small\">The first three are what came over the link, in chunks of 4 KiB that are sent whole; plain triangles are 12 bytes a vertex and 12 a face.</p>\n");
}

/// Headings of the table of all numbers of a model.
const HEADS: &str = "asked | true error, largest | median | certified, largest | \
    measured by the station | force error, largest | median | \
    normal error, largest | median | tick p50, µs | p99 | p99.9 | faces, median | \
    received | memory | ticks of contact | of these full | \
    faces in reach of a tool | time, µs";

fn tables(html: &mut String, groups: &[Group<'_>]) {
    for group in groups {
        let mut table = Table::new(1, HEADS);
        for knob in [Knob::Local, Knob::Global, Knob::Prefix] {
            for (index, p) in group.of(knob) {
                let measured = if p.measured_m < 0.0 {
                    "none".to_string()
                } else {
                    length(p.measured_m)
                };
                table.row([
                    format!("{} {}", knob.name(), asked(p, index == 0)),
                    length(p.true_m),
                    length(p.true_p50_m),
                    length(p.certified_m),
                    measured,
                    format!("{} N", digits(p.force_n)),
                    format!("{} N", digits(p.force_p50_n)),
                    format!("{}°", digits(p.normal_deg)),
                    format!("{}°", digits(p.normal_p50_deg)),
                    format!("{:.2}", p.tick_us.p50),
                    format!("{:.2}", p.tick_us.p99),
                    format!("{:.2}", p.tick_us.p999),
                    grouped(p.faces_p50 as u64),
                    bytes(p.bytes),
                    bytes(p.rss_bytes),
                    grouped(p.contact_ticks),
                    grouped(p.contact_full_ticks),
                    digits(p.tool_faces),
                    digits(p.tool_us),
                ]);
            }
        }
        let title = escaped(&group.title());
        let _ = writeln!(
            html,
            "<details><summary>{title}</summary>{}</details>",
            table.html()
        );
    }
    html.push_str("<p class=\"small\">Forces and normals are compared with those of the full mesh at the same pose. The largest force error of a coarse front is that of a touch which the full mesh does not have, or of one that the coarse front misses.</p>\n");
}

fn checks(html: &mut String, found: &Accuracy) {
    let mut table = Table::new(2, "check | model | worst | at most | verdict");
    for check in &found.checks {
        table.row([
            check.name.clone(),
            check.model.clone(),
            format!("{:.1e}", check.worst),
            format!("{:.0e}", check.limit),
            check.verdict().to_string(),
        ]);
    }
    let failed = found.failed.iter().map(|failed| escaped(failed));
    let failed: String = failed.map(|failed| format!(" Failed: {failed}.")).collect();
    let _ = writeln!(
        html,
        "<h2>Checks</h2>\n<p{}>{}.{}</p>\n<details><summary>each</summary>{}</details>",
        if found.pass { "" } else { " class=\"bad\"" },
        found.held(),
        failed,
        table.html()
    );
}

#[cfg(test)]
mod tests;
