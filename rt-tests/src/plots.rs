//! Pictures for the reports: panels above each other over one horizontal axis, as SVG text.

use plotters::coord::Shift;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::prelude::*;

/// The colours of the reports, apart in hue and in lightness.
pub const BLUE: RGBColor = RGBColor(31, 90, 166);
/// See [`BLUE`].
pub const ORANGE: RGBColor = RGBColor(217, 108, 26);
/// See [`BLUE`].
pub const GREEN: RGBColor = RGBColor(56, 142, 80);
/// See [`BLUE`].
pub const PURPLE: RGBColor = RGBColor(130, 70, 160);
/// See [`BLUE`].
pub const GREY: RGBColor = RGBColor(120, 120, 120);

const WIDTH: u32 = 960;
const PANEL_HEIGHT: u32 = 250;

/// One curve of a panel.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Its name in the legend.
    pub label: String,
    /// Its colour.
    pub color: RGBColor,
    /// Its points, ascending in x.
    pub points: Vec<(f64, f64)>,
    /// Whether it is drawn as dots rather than as a line.
    pub dots: bool,
}

/// One pair of axes.
#[derive(Debug, Clone, Default)]
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// Quantity and unit of the vertical axis.
    pub y_label: String,
    /// Whether the vertical axis is logarithmic; what is not above 0 is then left out.
    pub y_log: bool,
    /// The vertical axis reaches at least so far: what is smaller is no news.
    pub y_at_least: f64,
    /// Its curves.
    pub curves: Vec<Curve>,
    /// A dashed horizontal line with its name, such as a limit.
    pub mark: Option<(f64, String)>,
    /// Stretches of the horizontal axis with a grey background, such as contact.
    pub bands: Vec<(f64, f64)>,
}

/// Panels over one horizontal axis.
#[derive(Debug, Clone, Default)]
pub struct Picture {
    /// Quantity and unit of the horizontal axis.
    pub x_label: String,
    /// Whether the horizontal axis is logarithmic.
    pub x_log: bool,
    /// The panels, from above.
    pub panels: Vec<Panel>,
}

impl Picture {
    /// The picture as SVG.
    ///
    /// # Errors
    /// What the plotting library says.
    pub fn svg(&self) -> Result<String, String> {
        let mut text = String::new();
        {
            let height = PANEL_HEIGHT * self.panels.len().max(1) as u32;
            let root = SVGBackend::with_string(&mut text, (WIDTH, height)).into_drawing_area();
            root.fill(&WHITE).map_err(|error| error.to_string())?;
            let x = self.x_range();
            let areas = root.split_evenly((self.panels.len().max(1), 1));
            for (area, panel) in areas.iter().zip(&self.panels) {
                self.draw(area, panel, x)?;
            }
            root.present().map_err(|error| error.to_string())?;
        }
        Ok(text)
    }

    fn x_range(&self) -> (f64, f64) {
        let all = self.panels.iter().flat_map(|panel| &panel.curves);
        let xs = all.flat_map(|curve| curve.points.iter().map(|point| point.0));
        let (low, high) = range(xs, self.x_log);
        if self.x_log {
            (low, high)
        } else {
            (low.min(0.0), high)
        }
    }

    fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        panel: &Panel,
        (x0, x1): (f64, f64),
    ) -> Result<(), String> {
        let ys = panel
            .curves
            .iter()
            .flat_map(|curve| curve.points.iter().map(|point| point.1))
            .chain(panel.mark.iter().map(|mark| mark.0))
            .chain((panel.y_at_least > 0.0).then_some(panel.y_at_least));
        let (low, high) = range(ys, panel.y_log);
        let (y0, y1) = if panel.y_log {
            (low / 1.3, high * 1.5)
        } else {
            (low.min(0.0), high + 0.08 * (high - low.min(0.0)))
        };
        let mut builder = ChartBuilder::on(area);
        builder
            .caption(&panel.title, ("sans-serif", 16))
            .margin(6)
            // The last label of the horizontal axis reaches past it.
            .margin_right(28 + self.legend_width())
            .x_label_area_size(36)
            .y_label_area_size(72);
        let failed = |error: &dyn std::fmt::Display| error.to_string();
        match (self.x_log, panel.y_log) {
            (false, false) => self.fill(
                builder
                    .build_cartesian_2d(x0..x1, y0..y1)
                    .map_err(|e| failed(&e))?,
                panel,
                (x0, x1, y0, y1),
            ),
            (false, true) => self.fill(
                builder
                    .build_cartesian_2d(x0..x1, (y0..y1).log_scale())
                    .map_err(|e| failed(&e))?,
                panel,
                (x0, x1, y0, y1),
            ),
            (true, false) => self.fill(
                builder
                    .build_cartesian_2d((x0..x1).log_scale(), y0..y1)
                    .map_err(|e| failed(&e))?,
                panel,
                (x0, x1, y0, y1),
            ),
            (true, true) => self.fill(
                builder
                    .build_cartesian_2d((x0..x1).log_scale(), (y0..y1).log_scale())
                    .map_err(|e| failed(&e))?,
                panel,
                (x0, x1, y0, y1),
            ),
        }?;
        self.legend(area, panel)
    }

    /// Names beside the panel, where they cover no curve.
    fn legend<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        panel: &Panel,
    ) -> Result<(), String> {
        let failed = |error: DrawingAreaErrorKind<DB::ErrorType>| error.to_string();
        let left = (WIDTH - self.legend_width()) as i32;
        let names = panel
            .curves
            .iter()
            .map(|curve| (&curve.label, curve.color, 3));
        let mark = panel.mark.iter().map(|(_, label)| (label, GREY, 0));
        let is_named = panel.curves.len() > 1 || panel.mark.is_some();
        for (k, (label, color, half)) in (0i32..).zip(names.chain(mark)).filter(|_| is_named) {
            let y = 36 + 18 * k;
            let sign = Rectangle::new([(left, y - half), (left + 12, y + half)], color.filled());
            area.draw(&sign).map_err(failed)?;
            let text = Text::new(label.as_str(), (left + 18, y - 6), ("sans-serif", 12));
            area.draw(&text).map_err(failed)?;
        }
        Ok(())
    }

    /// Room for the longest name, the same in every panel, so that their horizontal axes are one.
    fn legend_width(&self) -> u32 {
        let named = |panel: &&Panel| panel.curves.len() > 1 || panel.mark.is_some();
        let labels = self.panels.iter().filter(named).flat_map(|panel| {
            let curves = panel.curves.iter().map(|curve| &curve.label);
            curves.chain(panel.mark.iter().map(|(_, label)| label))
        });
        let longest = labels.map(|label| label.chars().count()).max();
        longest.map_or(0, |count| (24 + 7 * count as u32).min(WIDTH / 3))
    }

    fn fill<'a, DB, X, Y>(
        &self,
        mut chart: ChartContext<'a, DB, Cartesian2d<X, Y>>,
        panel: &Panel,
        (x0, x1, y0, y1): (f64, f64, f64, f64),
    ) -> Result<(), String>
    where
        DB: DrawingBackend + 'a,
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let failed = |error: DrawingAreaErrorKind<DB::ErrorType>| error.to_string();
        let bands = panel.bands.iter().map(|&(from, to)| {
            Rectangle::new(
                [(from.max(x0), y0), (to.min(x1), y1)],
                RGBColor(238, 238, 238).filled(),
            )
        });
        chart.draw_series(bands).map_err(failed)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .x_desc(&self.x_label)
            .y_desc(&panel.y_label)
            .x_labels(11)
            .y_labels(6)
            .x_label_formatter(&|v| tidy(*v))
            .y_label_formatter(&|v| tidy(*v))
            .draw()
            .map_err(failed)?;
        for curve in &panel.curves {
            let color = curve.color;
            let drawn = |&(x, y): &(f64, f64)| {
                x.is_finite()
                    && y.is_finite()
                    && (!panel.y_log || y > 0.0)
                    && (!self.x_log || x > 0.0)
            };
            let points = curve.points.iter().copied().filter(drawn);
            let series = if curve.dots {
                chart.draw_series(points.map(|point| Circle::new(point, 2, color.filled())))
            } else {
                chart.draw_series(LineSeries::new(points, color.stroke_width(1)))
            };
            series.map_err(failed)?;
        }
        if let Some((value, _)) = &panel.mark {
            let line =
                DashedLineSeries::new([(x0, *value), (x1, *value)], 6, 4, GREY.stroke_width(1));
            chart.draw_series(line).map_err(failed)?;
        }
        Ok(())
    }
}

/// Smallest and largest of the numbers, never an empty range; of those above 0 for a logarithmic axis.
fn range(numbers: impl Iterator<Item = f64>, log: bool) -> (f64, f64) {
    let usable = numbers.filter(|v| v.is_finite() && (!log || *v > 0.0));
    let (low, high) = usable.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    match (low < high, low.is_finite()) {
        (true, _) => (low, high),
        (false, true) if log => (low / 2.0, low * 2.0),
        (false, true) if low == 0.0 => (0.0, 1.0),
        (false, true) => (low.min(0.0), high.max(0.0)),
        (false, false) if log => (0.1, 10.0),
        (false, false) => (0.0, 1.0),
    }
}

/// A number as a person writes it on an axis.
fn tidy(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_string();
    }
    if !(1e-4..1e6).contains(&size) {
        return format!("{value:.1e}");
    }
    let decimals = (2.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_string()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(points: Vec<(f64, f64)>, x_log: bool, y_log: bool) -> Picture {
        let curve = |dots| Curve {
            label: "c".to_string(),
            color: BLUE,
            points: points.clone(),
            dots,
        };
        Picture {
            x_label: "time, s".to_string(),
            x_log,
            panels: vec![Panel {
                title: "t".to_string(),
                y_label: "force, N".to_string(),
                y_log,
                curves: vec![curve(false), curve(true)],
                mark: Some((8.0, "limit".to_string())),
                bands: vec![(0.5, 2.0)],
                ..Panel::default()
            }],
        }
    }

    #[test]
    fn any_data_gives_a_picture_without_nan() {
        let hard = [
            vec![],
            vec![(0.0, 0.0)],
            vec![(1.0, 5.0), (1.0, 5.0)],
            vec![
                (0.0, -1.0),
                (1.0, f64::NAN),
                (2.0, f64::INFINITY),
                (3.0, 1e12),
            ],
        ];
        for points in hard {
            for (x_log, y_log) in [(false, false), (false, true), (true, false), (true, true)] {
                let svg = picture(points.clone(), x_log, y_log).svg().unwrap();
                assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
                assert!(!svg.contains("NaN"), "{points:?} {x_log} {y_log}");
                assert!(svg.contains("force, N"));
            }
        }
    }

    #[test]
    fn axis_labels_are_short() {
        for (value, text) in [
            (100.0, "100"),
            (0.0, "0"),
            (0.25, "0.25"),
            (2.5, "2.5"),
            (1e-7, "1.0e-7"),
            (17_600.0, "17600"),
            (-3.0, "-3"),
        ] {
            assert_eq!(tidy(value), text);
        }
    }
}
