//! Pictures as SVG text that takes its text colour from the page, so that it is readable on light and dark:
//! curves on logarithmic axes, and stacked bars.

use super::table::{digits, length};
use crate::report::bytes;
use std::fmt::Write as _;

/// Colours apart in hue and lightness, also for most who see few colours (Okabe and Ito), of middle lightness.
pub const COLORS: [&str; 6] = [
    "#0f7cc0", "#d55e00", "#0a9e78", "#c46a9b", "#c98a00", "#5b6fd6",
];
/// Height of a line of text, pixels.
const LINE: f64 = 13.0;
/// Width of a character at the size of labels, pixels, rather too wide.
const CHARACTER: f64 = 6.4;

/// What an axis counts in, which decides where its marks are and how they read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Length,
    /// Microseconds.
    Time,
    /// Bytes.
    Bytes,
}

/// A logarithmic axis; 0 has a place of its own below the lowest mark.
#[derive(Debug, Clone)]
pub struct Axis {
    title: String,
    unit: Unit,
    low: f64,
    high: f64,
    zero: bool,
}

impl Axis {
    /// An axis for these numbers; what is not finite or below 0 is left out.
    #[must_use]
    pub fn over(title: &str, unit: Unit, numbers: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high, mut zero) = (f64::INFINITY, 0.0_f64, false);
        for number in numbers.filter(|n| n.is_finite() && *n >= 0.0) {
            zero |= number == 0.0;
            if number > 0.0 {
                low = low.min(number);
                high = high.max(number);
            }
        }
        if low > high {
            (low, high) = (1.0, 1.0);
        }
        // Room on both sides, and never an empty range.
        let room = (high / low).powf(0.06).max(1.25);
        Self {
            title: title.to_string(),
            unit,
            low: low / room,
            high: high * room,
            zero,
        }
    }

    /// Share of the axis, 0 to 1, at which a number lies.
    fn place(&self, number: f64) -> f64 {
        let first = if self.zero { 0.1 } else { 0.0 };
        if number <= 0.0 {
            return 0.03;
        }
        let share = (number / self.low).ln() / (self.high / self.low).ln();
        first + (1.0 - first) * share.clamp(0.0, 1.0)
    }

    /// Marks with their words.
    fn marks(&self) -> Vec<(f64, String)> {
        let decades = (self.high / self.low).log10();
        let steps: &[f64] = match self.unit {
            _ if decades > 2.6 => &[1.0],
            _ if decades > 0.9 => &[1.0, 2.0, 5.0],
            _ => &[1.0, 2.0, 3.0, 5.0, 7.0],
        };
        let mut marks = Vec::new();
        if self.unit == Unit::Bytes {
            let factor = if decades > 2.2 { 4.0 } else { 2.0 };
            let mut mark = 1.0;
            while mark <= self.high {
                if mark >= self.low {
                    marks.push((mark, bytes(mark as u64).replace(".0 ", " ")));
                }
                mark *= factor;
            }
        } else {
            let first = self.low.log10().floor() as i32;
            let last = self.high.log10().ceil() as i32;
            for decade in first..=last {
                for step in steps {
                    let mark = step * 10_f64.powi(decade);
                    if (self.low..=self.high).contains(&mark) {
                        let words = match self.unit {
                            Unit::Length => length(mark),
                            _ => digits(mark),
                        };
                        marks.push((mark, words));
                    }
                }
            }
        }
        if self.zero {
            marks.push((0.0, "0".to_string()));
        }
        marks
    }
}

/// How a curve looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A line with filled dots.
    Solid,
    /// A thin line with small dots.
    Thin,
    /// A dashed line with rings.
    Dashed,
    /// A dotted line without points, for what is no measurement.
    Dotted,
}

/// A curve.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name.
    pub label: String,
    /// One of [`COLORS`].
    pub color: &'static str,
    /// How it looks.
    pub stroke: Stroke,
    /// Its points, and what each is.
    pub points: Vec<(f64, f64, String)>,
}

/// Axes with curves.
#[derive(Debug, Clone)]
pub struct Chart {
    /// What it shows.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// Its curves; the labels of the points of the first are written beside them.
    pub curves: Vec<Curve>,
    /// Whether the line of equal numbers on both axes is drawn, dotted.
    pub diagonal: bool,
    /// Whether curves are named at their first point.
    pub named: bool,
}

/// Where a chart lies in its picture, pixels.
#[derive(Debug, Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl Frame {
    fn x(&self, axis: &Axis, number: f64) -> f64 {
        self.left + self.width * axis.place(number)
    }

    fn y(&self, axis: &Axis, number: f64) -> f64 {
        self.top + self.height * (1.0 - axis.place(number))
    }
}

/// Rectangles that are taken by words: left, top, right, bottom.
type Taken = Vec<[f64; 4]>;

/// Charts in a grid, `columns` wide, as one SVG of a width in pixels.
#[must_use]
pub fn grid(charts: &[Chart], columns: usize, width: f64, height: f64) -> String {
    let columns = columns.max(1);
    let rows = charts.len().div_ceil(columns);
    let cell = width / columns as f64;
    let mut svg = open(width, height * rows as f64);
    for (place, chart) in charts.iter().enumerate() {
        let frame = Frame {
            left: cell * (place % columns) as f64 + 66.0,
            top: height * (place / columns) as f64 + 26.0,
            width: cell - 66.0 - 22.0,
            height: height - 26.0 - 46.0,
        };
        chart.draw(&frame, &mut svg);
    }
    svg.push_str("</svg>\n");
    svg
}

fn open(width: f64, height: f64) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" width=\"{width:.0}\" font-family=\"sans-serif\" font-size=\"11\" fill=\"currentColor\" role=\"img\">\n"
    )
}

fn words(svg: &mut String, x: f64, y: f64, anchor: &str, more: &str, text: &str) {
    let text = escaped(text);
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\"{more}>{text}</text>"
    );
}

/// Text with the characters that XML keeps for itself written otherwise.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

impl Chart {
    fn draw(&self, frame: &Frame, svg: &mut String) {
        self.draw_axes(frame, svg);
        let mut taken = Taken::new();
        // Words keep off all curves: their dots, and small squares along their lines.
        for curve in &self.curves {
            let mut last: Option<(f64, f64)> = None;
            for (x, y, _) in &curve.points {
                let (px, py) = (frame.x(&self.x, *x), frame.y(&self.y, *y));
                taken.push([px - 3.0, py - 3.0, px + 3.0, py + 3.0]);
                if let Some((x0, y0)) = last {
                    let steps = ((px - x0).hypot(py - y0) / 4.0).ceil().max(1.0);
                    for step in 1..steps as u32 {
                        let share = f64::from(step) / steps;
                        let (x, y) = (x0 + share * (px - x0), y0 + share * (py - y0));
                        taken.push([x - 1.0, y - 1.0, x + 1.0, y + 1.0]);
                    }
                }
                last = Some((px, py));
            }
        }
        for curve in self.curves.iter().rev() {
            self.draw_curve(curve, frame, svg);
        }
        if self.named {
            for curve in &self.curves {
                if let Some((x, y, _)) = curve.points.first() {
                    let at = (frame.x(&self.x, *x), frame.y(&self.y, *y));
                    let style = format!(" fill=\"{}\" font-weight=\"bold\"", curve.color);
                    put(svg, &mut taken, frame, at, &style, &curve.label);
                }
            }
        }
        if let Some(curve) = self.curves.first() {
            for (x, y, label) in &curve.points {
                let at = (frame.x(&self.x, *x), frame.y(&self.y, *y));
                put(svg, &mut taken, frame, at, " font-size=\"10\"", label);
            }
        }
    }

    fn draw_axes(&self, frame: &Frame, svg: &mut String) {
        let (right, bottom) = (frame.left + frame.width, frame.top + frame.height);
        words(
            svg,
            frame.left,
            frame.top - 10.0,
            "start",
            " font-weight=\"bold\" font-size=\"12\"",
            &self.title,
        );
        let mut edge = f64::NEG_INFINITY;
        for (mark, label) in self.x.marks() {
            let x = frame.x(&self.x, mark);
            let _ = writeln!(
                svg,
                "<path d=\"M{x:.1} {:.1}V{bottom:.1}\" stroke=\"currentColor\" opacity=\"0.13\"/>",
                frame.top
            );
            let half = 0.5 * CHARACTER * label.chars().count() as f64;
            if x - half > edge && x + half < right + 20.0 {
                words(svg, x, bottom + 15.0, "middle", "", &label);
                edge = x + half + 4.0;
            }
        }
        for (mark, label) in self.y.marks() {
            let y = frame.y(&self.y, mark);
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {y:.1}H{right:.1}\" stroke=\"currentColor\" opacity=\"0.13\"/>",
                frame.left
            );
            words(svg, frame.left - 6.0, y + 4.0, "end", "", &label);
        }
        let _ = writeln!(
            svg,
            "<path d=\"M{:.1} {:.1}V{bottom:.1}H{right:.1}\" fill=\"none\" stroke=\"currentColor\" opacity=\"0.6\"/>",
            frame.left, frame.top
        );
        words(
            svg,
            frame.left + 0.5 * frame.width,
            bottom + 32.0,
            "middle",
            "",
            &self.x.title,
        );
        let (x, y) = (frame.left - 54.0, frame.top + 0.5 * frame.height);
        let turn = format!(" transform=\"rotate(-90 {x:.1} {y:.1})\"");
        words(svg, x, y, "middle", &turn, &self.y.title);
        if self.diagonal {
            self.draw_diagonal(frame, svg);
        }
    }

    fn draw_diagonal(&self, frame: &Frame, svg: &mut String) {
        let low = self.x.low.max(self.y.low);
        let high = self.x.high.min(self.y.high);
        if low < high {
            let (x0, y0) = (frame.x(&self.x, low), frame.y(&self.y, low));
            let (x1, y1) = (frame.x(&self.x, high), frame.y(&self.y, high));
            let _ = writeln!(
                svg,
                "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"currentColor\" stroke-dasharray=\"2 3\" opacity=\"0.6\"/>"
            );
        }
    }

    fn draw_curve(&self, curve: &Curve, frame: &Frame, svg: &mut String) {
        let places: Vec<(f64, f64)> = curve
            .points
            .iter()
            .map(|(x, y, _)| (frame.x(&self.x, *x), frame.y(&self.y, *y)))
            .collect();
        let mut path = String::new();
        for (place, (x, y)) in places.iter().enumerate() {
            let _ = write!(path, "{}{x:.1} {y:.1}", if place == 0 { "M" } else { "L" });
        }
        let color = curve.color;
        let (style, radius) = match curve.stroke {
            Stroke::Solid => ("stroke-width=\"2\"", 3.5),
            Stroke::Thin => ("stroke-width=\"1\" opacity=\"0.75\"", 2.0),
            Stroke::Dashed => ("stroke-width=\"1.2\" stroke-dasharray=\"5 3\"", 3.0),
            Stroke::Dotted => ("stroke-dasharray=\"2 3\"", 0.0),
        };
        let _ = writeln!(
            svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" {style}/>"
        );
        for ((x, y), (_, _, label)) in places.iter().zip(&curve.points) {
            let dot = match curve.stroke {
                Stroke::Dashed => format!("fill=\"none\" stroke=\"{color}\""),
                _ => format!("fill=\"{color}\""),
            };
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" {dot}><title>{}: {}</title></circle>",
                escaped(&curve.label),
                escaped(label)
            );
        }
    }
}

/// Writes words beside a point where nothing is yet; where there is no such place they are left out (the
/// tables have them).
fn put(svg: &mut String, taken: &mut Taken, frame: &Frame, at: (f64, f64), more: &str, text: &str) {
    let width = CHARACTER * text.chars().count() as f64;
    let (x, y) = at;
    let near = [
        (x + 7.0, y + 4.0),
        (x - 7.0 - width, y + 4.0),
        (x + 5.0, y - 6.0),
        (x - 5.0 - width, y - 6.0),
        (x + 5.0, y + 14.0),
        (x - 5.0 - width, y + 14.0),
        (x - 0.5 * width, y - 8.0),
        (x - 0.5 * width, y + 17.0),
    ];
    // A little farther away, where it is crowded.
    let places = near.into_iter().chain(near.map(|(left, base)| {
        let (right, below) = (left + 0.5 * width > x, base - 4.0 > y);
        (
            left + if right { 6.0 } else { -6.0 },
            base + if below { 9.0 } else { -9.0 },
        )
    }));
    for (left, base) in places {
        let mine = [
            left - 1.0,
            base - LINE + 3.0,
            left + width + 1.0,
            base + 3.0,
        ];
        let inside = mine[0] > frame.left
            && mine[2] < frame.left + frame.width + 20.0
            && mine[1] > frame.top - 8.0
            && mine[3] < frame.top + frame.height;
        let free = taken.iter().all(|other| {
            mine[2] < other[0] || other[2] < mine[0] || mine[3] < other[1] || other[3] < mine[1]
        });
        if inside && free {
            words(svg, left, base, "start", more, text);
            taken.push(mine);
            return;
        }
    }
}

/// A stacked bar: its name, its parts, and what stands behind it.
#[derive(Debug, Clone)]
pub struct Bar {
    /// What it is of.
    pub name: String,
    /// Parts, from the left, in the order of the colours.
    pub parts: Vec<f64>,
    /// What is written behind it.
    pub note: String,
}

/// Stacked bars in groups with a title each, `columns` groups a row, all to the same scale.
#[must_use]
pub fn bars(groups: &[(String, Vec<Bar>)], columns: usize, width: f64) -> String {
    const ROW: f64 = 17.0;
    const NAMES: f64 = 92.0;
    const NOTES: f64 = 132.0;
    let columns = columns.max(1);
    let cell = width / columns as f64;
    let room = cell - NAMES - NOTES - 12.0;
    let totals = groups.iter().flat_map(|(_, bars)| bars);
    let most = totals
        .map(|bar| bar.parts.iter().sum::<f64>())
        .fold(f64::MIN_POSITIVE, f64::max);
    let rows: Vec<f64> = groups
        .chunks(columns)
        .map(|row| row.iter().map(|(_, bars)| bars.len()).max().unwrap_or(0))
        .map(|most| 30.0 + ROW * most as f64 + 10.0)
        .collect();
    let mut svg = open(width, rows.iter().sum());
    let mut top = 0.0;
    for (row, height) in groups.chunks(columns).zip(&rows) {
        for (column, (title, bars)) in row.iter().enumerate() {
            let left = cell * column as f64;
            words(
                &mut svg,
                left,
                top + 16.0,
                "start",
                " font-weight=\"bold\" font-size=\"12\"",
                title,
            );
            for (place, bar) in bars.iter().enumerate() {
                let y = top + 26.0 + ROW * place as f64;
                words(&mut svg, left + NAMES - 6.0, y + 11.0, "end", "", &bar.name);
                let mut x = left + NAMES;
                for (part, color) in bar.parts.iter().zip(COLORS) {
                    let width = room * part / most;
                    let _ = writeln!(
                        svg,
                        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.2}\" height=\"{:.1}\" fill=\"{color}\"/>",
                        ROW - 4.0
                    );
                    x += width;
                }
                words(&mut svg, x + 6.0, y + 11.0, "start", "", &bar.note);
            }
        }
        top += height;
    }
    svg.push_str("</svg>\n");
    svg
}

/// Names beside samples of their lines, in one row behind a heading.
#[must_use]
pub fn key(heading: &str, entries: &[(String, &str, Stroke)]) -> String {
    let mut html = format!("<p class=\"key\"><b>{heading}</b> ");
    for (name, color, stroke) in entries {
        let sample = match stroke {
            Stroke::Solid => format!(
                "<path d=\"M0 6H26\" stroke=\"{color}\" stroke-width=\"2\"/><circle cx=\"13\" cy=\"6\" r=\"3.5\" fill=\"{color}\"/>"
            ),
            Stroke::Thin => format!(
                "<path d=\"M0 6H26\" stroke=\"{color}\" stroke-width=\"1\"/><circle cx=\"13\" cy=\"6\" r=\"2\" fill=\"{color}\"/>"
            ),
            Stroke::Dashed => format!(
                "<path d=\"M0 6H26\" stroke=\"{color}\" stroke-dasharray=\"5 3\"/><circle cx=\"13\" cy=\"6\" r=\"3\" fill=\"none\" stroke=\"{color}\"/>"
            ),
            Stroke::Dotted => {
                format!("<path d=\"M0 6H26\" stroke=\"{color}\" stroke-dasharray=\"2 3\"/>")
            }
        };
        let _ = write!(
            html,
            "<span><svg width=\"26\" height=\"12\">{sample}</svg> {}</span> ",
            escaped(name)
        );
    }
    html.push_str("</p>\n");
    html
}
