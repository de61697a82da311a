//! Pictures as SVG text: curves over linear and logarithmic axes, and stacked bars.
//!
//! Written by hand and not with a plotting crate, for what the accuracy page needs of it: text and
//! lines in the colour of the page (light or dark), 0 on a logarithmic axis, marks in units of
//! length and bytes, points with labels that cover nothing and say their numbers when pointed at.

mod axis;
mod bars;
mod labels;
mod svg;

pub use axis::{Axis, Unit};
pub use bars::{Bar, bars};
pub use svg::Ground;

use super::html::escaped;
use labels::Taken;
use std::fmt::Write as _;
use svg::{heading, open, path, words};

/// Colours apart in hue and lightness, also for most who see few colours (Okabe and Ito), of middle
/// lightness.
pub const COLORS: [&str; 6] = [
    "#0f7cc0", "#d55e00", "#0a9e78", "#c46a9b", "#c98a00", "#5b6fd6",
];
/// For a curve that is a bound or a theory.
pub const GREY: &str = "#808080";
/// Width of every picture, pixels: that of a page's text.
pub const WIDTH: f64 = 960.0;
/// Width of a character at the size of labels, pixels, rather too wide.
const CHARACTER: f64 = 6.4;
/// Room around the axes of a chart, pixels: left, top, right, bottom.
const MARGINS: [f64; 4] = [66.0, 26.0, 22.0, 46.0];

/// Height of a row of names above charts, pixels.
const NAMES_HEIGHT: f64 = 28.0;

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
    /// A thin line without points, for a series over time.
    Line,
    /// Filled dots without a line.
    Dots,
}

impl Stroke {
    /// Attributes of the line, none for no line; radius of the points.
    fn looks(self) -> (Option<&'static str>, f64) {
        match self {
            Self::Solid => (Some("stroke-width=\"2\""), 3.5),
            Self::Thin => (Some("stroke-width=\"1\" opacity=\"0.75\""), 2.0),
            Self::Dashed => (Some("stroke-width=\"1.2\" stroke-dasharray=\"5 3\""), 3.0),
            Self::Dotted => (Some("stroke-dasharray=\"2 3\""), 0.0),
            Self::Line => (Some("stroke-width=\"1.2\" stroke-linecap=\"round\""), 0.0),
            Self::Dots => (None, 2.5),
        }
    }

    /// Attributes of the points.
    fn dot(self, color: &str) -> String {
        match self {
            Self::Dashed => format!("fill=\"none\" stroke=\"{color}\""),
            _ => format!("fill=\"{color}\""),
        }
    }
}

/// A curve.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name.
    pub label: String,
    /// One of [`COLORS`], or [`GREY`].
    pub color: &'static str,
    /// How it looks.
    pub stroke: Stroke,
    /// Its points, each with a label that may be empty. One whose height is no number breaks the
    /// line.
    pub points: Vec<(f64, f64, String)>,
}

impl Curve {
    /// A curve of points without labels.
    #[must_use]
    pub fn new(
        label: &str,
        color: &'static str,
        stroke: Stroke,
        points: impl IntoIterator<Item = (f64, f64)>,
    ) -> Self {
        let points = points.into_iter().map(|(x, y)| (x, y, String::new()));
        Self {
            label: label.to_string(),
            color,
            stroke,
            points: points.collect(),
        }
    }
}

/// Horizontal coordinates of all points of some curves.
pub fn xs(curves: &[Curve]) -> impl Iterator<Item = f64> + '_ {
    curves.iter().flat_map(|c| c.points.iter().map(|p| p.0))
}

/// Vertical coordinates of all points of some curves.
pub fn ys(curves: &[Curve]) -> impl Iterator<Item = f64> + '_ {
    curves.iter().flat_map(|c| c.points.iter().map(|p| p.1))
}

/// Where the names of curves stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Names {
    /// Nowhere: a [`key`] beside the picture has them.
    Nowhere,
    /// At the first point of each curve, or at the next where there is room.
    AtCurves,
    /// At the right of the chart.
    Legend,
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
    /// Where the names of the curves stand.
    pub names: Names,
    /// A dashed horizontal line with its name, such as a limit.
    pub limit: Option<(f64, String)>,
    /// Stretches of the horizontal axis with a grey ground, such as contact.
    pub bands: Vec<(f64, f64)>,
}

impl Chart {
    /// A chart without names, limit or bands.
    #[must_use]
    pub fn new(title: &str, x: Axis, y: Axis, curves: Vec<Curve>) -> Self {
        Self {
            title: title.to_string(),
            x,
            y,
            curves,
            diagonal: false,
            names: Names::Nowhere,
            limit: None,
            bands: Vec::new(),
        }
    }
}

/// The axes of a chart in its picture, pixels.
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

/// Charts in a grid, `columns` wide, as one SVG; `height` is that of a chart in pixels.
#[must_use]
pub fn grid(charts: &[Chart], columns: usize, height: f64, ground: Ground) -> String {
    grid_under(&[], charts, columns, height, ground)
}

/// The same under one row of names that hold in all charts, each with its line.
#[must_use]
pub fn grid_under(
    names: &[(String, &str, Stroke)],
    charts: &[Chart],
    columns: usize,
    height: f64,
    ground: Ground,
) -> String {
    let above = if names.is_empty() { 0.0 } else { NAMES_HEIGHT };
    let columns = columns.max(1);
    let rows = charts.len().div_ceil(columns);
    let cell = WIDTH / columns as f64;
    let [left, top, right, bottom] = MARGINS;
    // The same in every chart, so that equal axes are of equal length.
    let legend = charts.iter().map(Chart::legend_width).fold(0.0, f64::max);
    let mut svg = open(ground, WIDTH, above + height * rows as f64);
    let mut x = left;
    for (name, color, stroke) in names {
        let sample = sample(color, *stroke);
        let _ = writeln!(svg, "<g transform=\"translate({x:.1} 6)\">{sample}</g>");
        words(&mut svg, (x + 32.0, 16.0), "start", "", name);
        x += 54.0 + CHARACTER * name.chars().count() as f64;
    }
    for (place, chart) in charts.iter().enumerate() {
        let frame = Frame {
            left: cell * (place % columns) as f64 + left,
            top: above + height * (place / columns) as f64 + top,
            width: cell - left - right - legend,
            height: height - top - bottom,
        };
        chart.draw(&frame, &mut svg);
    }
    svg.push_str("</svg>\n");
    svg
}

impl Chart {
    fn draw(&self, frame: &Frame, svg: &mut String) {
        self.draw_bands(frame, svg);
        self.draw_axes(frame, svg);
        for curve in self.curves.iter().rev() {
            self.draw_curve(curve, frame, svg);
        }
        self.draw_limit(frame, svg);
        if self.names == Names::Legend {
            self.draw_legend(frame, svg);
        }
        self.draw_labels(frame, svg);
    }

    fn at(&self, frame: &Frame, (x, y): (f64, f64)) -> (f64, f64) {
        (frame.x(&self.x, x), frame.y(&self.y, y))
    }

    /// The points of a curve that can be drawn, pixels, with their labels.
    fn places<'a>(
        &'a self,
        curve: &'a Curve,
        frame: &'a Frame,
    ) -> impl Iterator<Item = (f64, f64, &'a str)> {
        let points = curve.points.iter();
        let points = points.filter(|(x, y, _)| self.x.has(*x) && self.y.has(*y));
        points.map(|(x, y, label)| {
            let (px, py) = self.at(frame, (*x, *y));
            (px, py, label.as_str())
        })
    }

    /// Names of curves and labels of the points of the first, beside them.
    fn draw_labels(&self, frame: &Frame, svg: &mut String) {
        let labelled = |curve: &Curve| curve.points.iter().any(|point| !point.2.is_empty());
        if !self.curves.iter().any(labelled) {
            return;
        }
        let mut taken = Taken::default();
        for curve in &self.curves {
            taken.keep_off(self.places(curve, frame).map(|(x, y, _)| (x, y)));
        }
        if self.names == Names::AtCurves {
            for curve in &self.curves {
                let style = format!(" fill=\"{}\" font-weight=\"bold\"", curve.color);
                let points: Vec<_> = self.places(curve, frame).map(|(x, y, _)| (x, y)).collect();
                let middles = points
                    .windows(2)
                    .map(|pair| (0.5 * (pair[0].0 + pair[1].0), 0.5 * (pair[0].1 + pair[1].1)));
                // Where curves begin together, further on.
                points
                    .iter()
                    .copied()
                    .chain(middles)
                    .any(|at| taken.put(svg, frame, at, &style, &curve.label));
            }
        }
        if let Some(curve) = self.curves.first() {
            for (x, y, label) in self.places(curve, frame) {
                taken.put(svg, frame, (x, y), " font-size=\"10\"", label);
            }
        }
    }

    fn draw_bands(&self, frame: &Frame, svg: &mut String) {
        for &(from, to) in &self.bands {
            let (left, right) = (frame.x(&self.x, from), frame.x(&self.x, to));
            let _ = writeln!(
                svg,
                "<rect x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" opacity=\"0.07\"/>",
                frame.top,
                right - left,
                frame.height
            );
        }
    }

    fn draw_axes(&self, frame: &Frame, svg: &mut String) {
        let (left, top) = (frame.left, frame.top);
        let (right, bottom) = (left + frame.width, top + frame.height);
        const FAINT: &str = "opacity=\"0.13\"";
        heading(svg, (left, top - 10.0), &self.title);
        let mut edge = f64::NEG_INFINITY;
        for (mark, label) in self.x.marks() {
            let x = frame.x(&self.x, mark);
            path(svg, &format!("M{x:.1} {top:.1}V{bottom:.1}"), FAINT);
            let half = 0.5 * CHARACTER * label.chars().count() as f64;
            if x - half > edge && x + half < right + 20.0 {
                words(svg, (x, bottom + 15.0), "middle", "", &label);
                edge = x + half + 4.0;
            }
        }
        for (mark, label) in self.y.marks() {
            let y = frame.y(&self.y, mark);
            path(svg, &format!("M{left:.1} {y:.1}H{right:.1}"), FAINT);
            words(svg, (left - 6.0, y + 4.0), "end", "", &label);
        }
        path(
            svg,
            &format!("M{left:.1} {top:.1}V{bottom:.1}H{right:.1}"),
            "fill=\"none\" opacity=\"0.6\"",
        );
        let middle = (left + 0.5 * frame.width, bottom + 32.0);
        words(svg, middle, "middle", "", &self.x.title);
        let (x, y) = (left - 54.0, top + 0.5 * frame.height);
        let turn = format!(" transform=\"rotate(-90 {x:.1} {y:.1})\"");
        words(svg, (x, y), "middle", &turn, &self.y.title);
        if self.diagonal {
            self.draw_diagonal(frame, svg);
        }
    }

    fn draw_diagonal(&self, frame: &Frame, svg: &mut String) {
        let (x, y) = (self.x.range(), self.y.range());
        let (low, high) = (x.0.max(y.0), x.1.min(y.1));
        if low < high {
            let (x0, y0) = self.at(frame, (low, low));
            let (x1, y1) = self.at(frame, (high, high));
            let line = format!("M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}");
            path(svg, &line, "stroke-dasharray=\"2 3\" opacity=\"0.6\"");
        }
    }

    fn draw_limit(&self, frame: &Frame, svg: &mut String) {
        if let Some((value, _)) = &self.limit {
            let (left, y) = (frame.left, frame.y(&self.y, *value));
            let line = format!("M{left:.1} {y:.1}H{:.1}", left + frame.width);
            path(svg, &line, "stroke-dasharray=\"6 4\" opacity=\"0.5\"");
        }
    }

    fn draw_curve(&self, curve: &Curve, frame: &Frame, svg: &mut String) {
        let mut data = String::new();
        let mut next = 'M';
        for &(x, y, _) in &curve.points {
            if self.x.has(x) && self.y.has(y) {
                let (x, y) = self.at(frame, (x, y));
                let _ = write!(data, "{next}{x:.1} {y:.1}");
                // A point between two gaps is a dot.
                if next == 'M' {
                    data.push_str("h0");
                }
                next = 'L';
            } else if y.is_nan() {
                next = 'M';
            }
        }
        let (line, radius) = curve.stroke.looks();
        let color = curve.color;
        if let Some(style) = line.filter(|_| !data.is_empty()) {
            let _ = writeln!(
                svg,
                "<path d=\"{data}\" fill=\"none\" stroke=\"{color}\" {style}/>"
            );
        }
        if radius == 0.0 {
            return;
        }
        let dot = curve.stroke.dot(color);
        for (x, y, label) in self.places(curve, frame) {
            let _ = write!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" {dot}>"
            );
            if !label.is_empty() {
                let (name, label) = (escaped(&curve.label), escaped(label));
                let _ = write!(svg, "<title>{name}: {label}</title>");
            }
            svg.push_str("</circle>\n");
        }
    }

    /// Names at the right of the chart, where they cover no curve.
    fn draw_legend(&self, frame: &Frame, svg: &mut String) {
        let left = frame.left + frame.width + 12.0;
        let curves = self.curves.iter();
        let curves = curves.map(|curve| (sample(curve.color, curve.stroke), &curve.label));
        let limit = self.limit.iter().map(|(_, name)| {
            let dashes =
                "<path d=\"M0 6H26\" stroke=\"currentColor\" stroke-dasharray=\"6 4\" opacity=\"0.5\"/>";
            (dashes.to_string(), name)
        });
        for (place, (sample, name)) in curves.chain(limit).enumerate() {
            let y = frame.top + 18.0 * place as f64;
            let _ = writeln!(
                svg,
                "<g transform=\"translate({left:.1} {y:.1})\">{sample}</g>"
            );
            words(svg, (left + 32.0, y + 10.0), "start", "", name);
        }
    }

    /// Width of the legend, pixels; 0 without one.
    fn legend_width(&self) -> f64 {
        if self.names != Names::Legend {
            return 0.0;
        }
        let names = self.curves.iter().map(|curve| &curve.label);
        let names = names.chain(self.limit.iter().map(|(_, name)| name));
        let longest = names.map(|name| name.chars().count()).max().unwrap_or(0);
        44.0 + CHARACTER * longest as f64
    }
}

/// A short piece of a curve, 26 by 12 pixels.
fn sample(color: &str, stroke: Stroke) -> String {
    let (line, radius) = stroke.looks();
    let line = line.map_or(String::new(), |style| {
        format!("<path d=\"M0 6H26\" stroke=\"{color}\" {style}/>")
    });
    let dot = stroke.dot(color);
    if radius == 0.0 {
        return line;
    }
    format!("{line}<circle cx=\"13\" cy=\"6\" r=\"{radius}\" {dot}/>")
}

/// Names beside samples of their lines as HTML, in one row behind a heading.
#[must_use]
pub fn key(heading: &str, entries: &[(String, &str, Stroke)]) -> String {
    let mut html = format!("<p class=\"key\"><b>{heading}</b> ");
    for (name, color, stroke) in entries {
        let _ = write!(
            html,
            "<span><svg width=\"26\" height=\"12\">{}</svg> {}</span> ",
            sample(color, *stroke),
            escaped(name)
        );
    }
    html.push_str("</p>\n");
    html
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_data_gives_a_picture_without_nan() {
        let hard: [&[(f64, f64)]; 4] = [
            &[],
            &[(0.0, 0.0)],
            &[(1.0, 5.0), (1.0, 5.0)],
            &[
                (0.0, -1.0),
                (1.0, f64::NAN),
                (2.0, f64::INFINITY),
                (3.0, 1e12),
            ],
        ];
        for points in hard {
            let curve = |stroke| Curve::new("c", COLORS[0], stroke, points.iter().copied());
            let curves = vec![curve(Stroke::Line), curve(Stroke::Dots)];
            let axes = |xs: Vec<f64>| {
                let all = || xs.iter().copied();
                [
                    Axis::linear("time, s", all()).with_room(),
                    Axis::over("force, N", Unit::Number, all()),
                ]
            };
            for x in axes(xs(&curves).collect()) {
                for y in axes(ys(&curves).collect()) {
                    let mut chart = Chart::new("t", x.clone(), y, curves.clone());
                    chart.limit = Some((8.0, "limit".to_string()));
                    chart.bands = vec![(0.5, 2.0)];
                    chart.names = Names::Legend;
                    let svg = grid(&[chart], 1, 250.0, Ground::Paper);
                    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
                    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{points:?}");
                    assert!(svg.contains("limit"));
                }
            }
        }
    }

    #[test]
    fn a_point_that_is_no_number_breaks_the_line() {
        let points = [
            (0.0, 1.0),
            (1.0, 2.0),
            (2.0, f64::NAN),
            (3.0, 1.0),
            (4.0, 2.0),
            (5.0, f64::NAN),
            (6.0, 1.0),
            (7.0, f64::NAN),
        ];
        let curve = Curve::new("c", COLORS[0], Stroke::Line, points);
        let x = Axis::linear("time, s", xs(std::slice::from_ref(&curve)));
        let y = Axis::linear("error", ys(std::slice::from_ref(&curve)));
        let chart = Chart::new("t", x, y, vec![curve]);
        let svg = grid(&[chart], 1, 250.0, Ground::Paper);
        let mut lines = svg.lines();
        let line = lines.find(|line| line.contains(COLORS[0])).unwrap();
        let count = |of: char| line.matches(of).count();
        assert_eq!((count('M'), count('L')), (3, 2), "{line}");
        // A point alone is a dot.
        assert!(line.contains("h0\" fill"), "{line}");
    }

    #[test]
    fn words_stand_nearest_to_their_own_point() {
        // Two points so near each other that words beside the first would read as the second's.
        let mut curve = Curve::new(
            "c",
            COLORS[0],
            Stroke::Line,
            [(0.0, 9.0), (0.6, 8.5), (9.0, 0.0)],
        );
        curve.points[0].2 = "10 mm, the first".to_owned();
        curve.points[1].2 = "1 mm".to_owned();
        let x = Axis::linear("time, s", xs(std::slice::from_ref(&curve)));
        let y = Axis::linear("error", ys(std::slice::from_ref(&curve)));
        let svg = grid(
            &[Chart::new("t", x, y, vec![curve])],
            1,
            400.0,
            Ground::Paper,
        );
        assert!(svg.contains("1 mm<"), "{svg}");
        assert!(!svg.contains("the first"), "{svg}");
    }

    #[test]
    fn curves_that_begin_together_are_each_named() {
        let end = |x: f64| [(0.0, 9.0), (0.1, 8.9), (x, 5.0), (x, 0.0)];
        let curves: Vec<_> = [("first", 3.0), ("second", 6.0), ("third", 9.0)]
            .into_iter()
            .map(|(name, x)| {
                let mut curve = Curve::new(name, COLORS[0], Stroke::Line, end(x));
                curve.points[0].2 = "base".to_owned();
                curve
            })
            .collect();
        let x = Axis::linear("time, s", xs(&curves));
        let y = Axis::linear("error", ys(&curves));
        let mut chart = Chart::new("t", x, y, curves);
        chart.names = Names::AtCurves;
        let svg = grid(&[chart], 1, 400.0, Ground::Paper);
        for name in ["first", "second", "third"] {
            assert!(svg.contains(name), "{name}");
        }
    }
}
