//! The page of a run: its sentences, and pictures over time.

use super::Report;
use crate::failure::Failure;
use crate::report::chart::{
    Axis, COLORS, Chart, Curve, GREY, Ground, Names, Stroke, Unit, grid, ys,
};
use crate::report::html::{self, escaped};
use crate::report::output::{make_folder, write_json, write_whole};
use hrtc::result::SeriesBucket;
use std::fmt::Write as _;
use std::path::Path;

/// Height of a chart, pixels.
const CHART_HEIGHT: f64 = 250.0;
/// The picture of the touch, and what it shows.
const PICTURE: &str = "touch.png";
const PICTURE_WORDS: &str = "The controller's own mesh at the greatest force, whole and from near, with the path of the probe before.";
/// Least range of the axis of errors, micrometres: less could neither be rendered nor felt.
const MIN_ERROR_UM: f64 = 0.01;

impl Report<'_> {
    /// Writes `report.html`, its pictures and `result.json` into a folder.
    ///
    /// # Errors
    /// When the folder or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Failure> {
        make_folder(folder)?;
        let pictures = [
            ("force", "Force", self.force_charts()),
            ("timing", "Timing", self.timing_charts()),
            ("resolution", "Resolution", self.resolution_charts()),
        ];
        for (name, _, charts) in &pictures {
            let svg = grid(charts, 1, CHART_HEIGHT, Ground::Paper);
            write_whole(&folder.join(format!("{name}.svg")), svg.as_bytes())?;
        }
        if let Some(picture) = self.picture {
            write_whole(&folder.join(PICTURE), picture)?;
        }
        write_json(&folder.join("result.json"), self.finished)?;
        let page = self.page(&pictures.map(|(_, title, charts)| (title, charts)));
        write_whole(&folder.join("report.html"), page.as_bytes())
    }

    fn page(&self, pictures: &[(&str, Vec<Chart>)]) -> String {
        let r = &self.finished.result;
        let mut body = String::from("<table class=\"sections\">\n");
        for (name, sentences) in self.sections() {
            let cell: Vec<String> = sentences.iter().map(|s| escaped(s)).collect();
            let cell = cell.join("<br>");
            let _ = writeln!(body, "<tr><th>{name}</th><td>{cell}</td></tr>");
        }
        body.push_str(
            "</table>\n<p>A point of a curve is the largest number of its stretch of time; of missed periods it is their sum, of full resolution the share of the ticks in contact. A grey ground means contact. All numbers are in result.json.</p>\n",
        );
        if self.picture.is_some() {
            let _ = writeln!(
                body,
                "<h2>Touch</h2>\n<img src=\"{PICTURE}\" alt=\"{PICTURE_WORDS}\" style=\"max-width: 100%\">\n<p>{PICTURE_WORDS}</p>"
            );
        }
        for (title, charts) in pictures {
            let svg = grid(charts, 1, CHART_HEIGHT, Ground::Page);
            let _ = writeln!(body, "<h2>{title}</h2>\n{svg}");
        }
        html::page(&format!("{} on {}", r.scene, r.model), &body)
    }

    fn curve(
        &self,
        label: &str,
        color: &'static str,
        stroke: Stroke,
        value: impl Fn(&SeriesBucket) -> Option<f64>,
    ) -> Curve {
        let series = self.finished.series.iter();
        let points = series.filter_map(|bucket| Some((bucket.seconds, value(bucket)?)));
        Curve::new(label, color, stroke, points)
    }

    /// A chart over the whole time, with a grey ground during contact.
    fn over_time(&self, title: &str, y: Axis, curves: Vec<Curve>) -> Chart {
        let series = &self.finished.series;
        let x = Axis::linear("time, s", series.iter().map(|bucket| bucket.seconds));
        let mut chart = Chart::new(title, x, y, curves);
        chart.bands = contact_bands(series);
        chart
    }

    /// The same with a linear vertical axis.
    fn linear(&self, title: &str, y: &str, curve: Curve) -> Chart {
        let curves = vec![curve];
        let y = Axis::linear(y, ys(&curves)).with_room();
        self.over_time(title, y, curves)
    }

    fn force_charts(&self) -> Vec<Chart> {
        let limit = self.finished.result.force_limit_n;
        let force = self.curve("force", COLORS[0], Stroke::Line, |b| Some(b.force_n));
        let mut chart = self.linear("Force on the hand", "force, N", force);
        // A limit far above the data would press the curve flat.
        if self.finished.result.force_n.max > 0.25 * limit {
            chart.y = chart.y.at_least(1.08 * limit);
            chart.limit = Some((limit, "force limit".to_string()));
            chart.names = Names::Legend;
        }
        vec![chart]
    }

    fn timing_charts(&self) -> Vec<Chart> {
        let period_us = 1e6 / self.plan.loop_.rate_hz;
        let curves = vec![
            self.curve("wake-up", COLORS[1], Stroke::Line, |b| Some(b.wake_us)),
            self.curve("work (thread CPU)", COLORS[0], Stroke::Line, |b| {
                Some(b.work_us)
            }),
        ];
        let numbers = ys(&curves).filter(|us| *us > 0.0).chain([period_us]);
        let y = Axis::over("time, µs", Unit::Time, numbers);
        let title = "Work of a tick and wake-up after its deadline";
        let mut times = self.over_time(title, y, curves);
        times.limit = Some((period_us, "period".to_string()));
        times.names = Names::Legend;
        let missed = self.curve("missed", COLORS[1], Stroke::Line, |b| Some(b.missed as f64));
        let missed = self.linear("Missed periods", "periods", missed);
        vec![times, missed]
    }

    pub(super) fn resolution_charts(&self) -> Vec<Chart> {
        // Where nothing is touched there is no number, which breaks the line.
        let in_contact = |bucket: &SeriesBucket, value: f64| match bucket.contact_ticks {
            0 => Some(f64::NAN),
            _ => Some(value),
        };
        let faces = self.curve("faces", COLORS[0], Stroke::Line, |b| {
            Some(b.refined_faces as f64)
        });
        let errors = vec![
            self.curve("certified", COLORS[1], Stroke::Line, |b| {
                // A contact without a bound breaks the line.
                let bound_m = Some(b.certified_error_m).filter(|m| *m >= 0.0);
                in_contact(b, 1e6 * bound_m.unwrap_or(f64::NAN))
            }),
            self.curve("measured", COLORS[2], Stroke::Dots, |b| {
                (b.measured_error_m >= 0.0).then_some(1e6 * b.measured_error_m)
            }),
        ];
        let axis = Axis::linear("error, µm", ys(&errors)).at_least(MIN_ERROR_UM);
        let title = "Error at the contact";
        let mut errors = self.over_time(title, axis.with_room(), errors);
        errors.names = Names::Legend;
        let full = self.curve("full resolution", GREY, Stroke::Line, |b| {
            let share = b.contact_full_ticks as f64 / b.contact_ticks.max(1) as f64;
            in_contact(b, 100.0 * share)
        });
        vec![
            self.linear("Refined faces", "faces", faces),
            errors,
            self.linear("Contact at full resolution", "share, %", full),
        ]
    }
}

/// Stretches of time with contact.
pub(super) fn contact_bands(series: &[SeriesBucket]) -> Vec<(f64, f64)> {
    let mut bands: Vec<(f64, f64)> = Vec::new();
    let mut open: Option<f64> = None;
    for bucket in series {
        match (open, bucket.contact_ticks > 0) {
            (None, true) => open = Some(bucket.seconds),
            (Some(from), false) => {
                bands.push((from, bucket.seconds));
                open = None;
            }
            _ => {}
        }
    }
    if let (Some(from), Some(last)) = (open, series.last()) {
        bands.push((from, last.seconds));
    }
    bands
}
