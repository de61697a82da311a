//! The page of a report: its sentences, and plots over time beside it.

use super::Report;
use crate::failure::Failure;
use crate::plots::{BLUE, Curve, GREEN, GREY, ORANGE, Panel, Picture};
use hrtc::result::SeriesBucket;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

impl Report<'_> {
    /// Writes `report.html`, its plots and `result.json` into a folder, which is made if it is not there.
    ///
    /// # Errors
    /// When the folder or a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), Failure> {
        std::fs::create_dir_all(folder).map_err(|error| Failure::write(folder, &error))?;
        let pictures = [
            ("force", "Force", self.force_picture()),
            ("timing", "Timing", self.timing_picture()),
            ("resolution", "Resolution", self.resolution_picture()),
        ];
        for (name, _, picture) in &pictures {
            let path = folder.join(format!("{name}.svg"));
            let svg = picture
                .svg()
                .map_err(|error| Failure::Run(format!("{}: {error}", path.display())))?;
            write_whole(&path, svg.as_bytes())?;
        }
        let json = serde_json::to_vec(self.finished)
            .map_err(|error| Failure::Run(format!("the result has no JSON ({error})")))?;
        write_whole(&folder.join("result.json"), &json)?;
        let images: Vec<(&str, &str)> = pictures.iter().map(|p| (p.0, p.1)).collect();
        write_whole(&folder.join("report.html"), self.page(&images).as_bytes())
    }

    fn page(&self, images: &[(&str, &str)]) -> String {
        let r = &self.finished.result;
        let title = escaped(&format!("{} on {}", r.scene, r.model));
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\n<style>body{{font:15px/1.5 sans-serif;max-width:62em;margin:2em auto;padding:0 1em;color:#222}}th{{text-align:left;vertical-align:top;padding-right:1.5em}}img{{max-width:100%}}</style></head>\n<body><h1>{title}</h1>\n<table>\n"
        );
        for (name, sentences) in self.sections() {
            let cell: Vec<String> = sentences.iter().map(|s| escaped(s)).collect();
            let _ = writeln!(
                page,
                "<tr><th>{name}</th><td>{}</td></tr>",
                cell.join("<br>")
            );
        }
        page.push_str("</table>\n<p>In the plots every point is the worst tick of its stretch of time; a grey ground means contact. All numbers are in result.json.</p>\n");
        for (name, title) in images {
            let _ = writeln!(
                page,
                "<h2>{title}</h2>\n<p><img src=\"{name}.svg\" alt=\"{title} over time\"></p>"
            );
        }
        page.push_str("</body></html>\n");
        page
    }

    fn curve(
        &self,
        label: &str,
        color: plotters::style::RGBColor,
        value: impl Fn(&SeriesBucket) -> Option<f64>,
    ) -> Curve {
        let series = &self.finished.series;
        Curve {
            label: label.to_string(),
            color,
            points: series
                .iter()
                .filter_map(|bucket| Some((bucket.seconds, value(bucket)?)))
                .collect(),
            dots: false,
        }
    }

    fn over_time(&self, panels: Vec<Panel>) -> Picture {
        let bands = contact_bands(&self.finished.series);
        Picture {
            x_label: "time, s".to_string(),
            x_log: false,
            panels: panels
                .into_iter()
                .map(|panel| Panel {
                    bands: bands.clone(),
                    ..panel
                })
                .collect(),
        }
    }

    fn force_picture(&self) -> Picture {
        let limit = self.plan.safety.force_max_n;
        let near = self.finished.result.force_n.max > 0.25 * limit;
        self.over_time(vec![Panel {
            title: "Force on the hand".to_string(),
            y_label: "force, N".to_string(),
            curves: vec![self.curve("force", BLUE, |b| Some(b.force_n))],
            // A limit far above the data would press the curve flat.
            mark: near.then(|| (limit, "limit of the gate".to_string())),
            ..Panel::default()
        }])
    }

    fn timing_picture(&self) -> Picture {
        let period_us = 1e6 / self.plan.loop_.rate_hz;
        self.over_time(vec![
            Panel {
                title: "Work of a tick and wake-up after its deadline".to_string(),
                y_label: "time, µs".to_string(),
                y_log: true,
                curves: vec![
                    self.curve("wake-up", ORANGE, |b| Some(b.wake_us)),
                    self.curve("work (thread CPU)", BLUE, |b| Some(b.work_us)),
                ],
                mark: Some((period_us, "period".to_string())),
                ..Panel::default()
            },
            Panel {
                title: "Missed periods".to_string(),
                y_label: "periods".to_string(),
                curves: vec![self.curve("missed", ORANGE, |b| Some(b.missed as f64))],
                ..Panel::default()
            },
        ])
    }

    fn resolution_picture(&self) -> Picture {
        let micrometres = |metres: f64| metres * 1e6;
        let measured = Curve {
            dots: true,
            ..self.curve("measured", GREEN, |b| {
                (b.measured_error_m >= 0.0).then(|| micrometres(b.measured_error_m))
            })
        };
        self.over_time(vec![
            Panel {
                title: "Refined faces".to_string(),
                y_label: "faces".to_string(),
                curves: vec![self.curve("faces", BLUE, |b| Some(b.refined_faces as f64))],
                ..Panel::default()
            },
            Panel {
                title: "Error at the contact".to_string(),
                y_label: "error, µm".to_string(),
                // A hundredth of a micrometre is below what a device or a hand could tell.
                y_at_least: 0.01,
                curves: vec![
                    self.curve("certified", ORANGE, |b| {
                        (b.contact_ticks > 0).then(|| micrometres(b.certified_error_m))
                    }),
                    measured,
                ],
                ..Panel::default()
            },
            Panel {
                title: "Contact at full resolution".to_string(),
                y_label: "share, %".to_string(),
                curves: vec![self.curve("full resolution", GREY, |b| {
                    (b.contact_ticks > 0)
                        .then(|| 100.0 * b.contact_full_ticks as f64 / b.contact_ticks as f64)
                })],
                ..Panel::default()
            },
        ])
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

/// Writes a file whole or not at all.
///
/// # Errors
/// When it cannot be written.
pub fn write_whole(path: &Path, contents: &[u8]) -> Result<(), Failure> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let write = || -> std::io::Result<()> {
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(contents)?;
        // A temporary file is private; a report is for whoever may read the folder.
        let readable = std::os::unix::fs::PermissionsExt::from_mode(0o644);
        file.as_file().set_permissions(readable)?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|error| Failure::write(path, &error))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}
