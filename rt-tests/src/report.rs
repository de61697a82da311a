//! The closing report of a run: for the terminal in plain words, and as a page with plots beside it.

use crate::failure::Failure;
use crate::machine::Machine;
use crate::plots::{BLUE, Curve, GREEN, GREY, ORANGE, Panel, Picture};
use hrtc::result::{Finished, SeriesBucket, Spread};
use shared::scene::{ScenePlan, TrajectoryPlan};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Everything that a report tells of.
#[derive(Debug)]
pub struct Report<'a> {
    /// The scene as it ran.
    pub plan: &'a ScenePlan,
    /// What the controller counted.
    pub finished: &'a Finished,
    /// The machine.
    pub machine: &'a Machine,
    /// The greatest speed at full resolution for this model at its size, m/s; 0 when it is not known.
    pub greatest_speed_m_per_s: f64,
    /// What the supervisor saw, a sentence each: restarts, an early end.
    pub notes: &'a [String],
}

impl Report<'_> {
    /// The report in plain words, one fact a line.
    #[must_use]
    pub fn words(&self) -> String {
        let mut text = String::new();
        for (name, sentences) in self.sections() {
            for (index, sentence) in sentences.iter().enumerate() {
                let head = if index == 0 { name } else { "" };
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{head:<11} {sentence}");
            }
        }
        text
    }

    fn sections(&self) -> Vec<(&'static str, Vec<String>)> {
        let mut sections = vec![
            ("run", self.run()),
            ("touch", self.touch()),
            ("resolution", self.resolution()),
            ("transfer", self.transfer()),
            ("timing", self.timing()),
            ("rights", self.rights()),
        ];
        if !self.notes.is_empty() {
            sections.push(("notes", self.notes.to_vec()));
        }
        sections
    }

    fn run(&self) -> Vec<String> {
        let r = &self.finished.result;
        let seed = match r.seed {
            0 => String::new(),
            seed => format!(", seed {seed}"),
        };
        vec![
            format!(
                "scene {}, model {} ({} faces), {:.1} s{seed}",
                r.scene,
                r.model,
                grouped(r.faces),
                r.seconds
            ),
            if r.first_force_ready_ms > 0.0 {
                format!(
                    "a touch could be answered {:.0} ms after the start of both processes",
                    r.first_force_ready_ms
                )
            } else {
                "no model arrived: a touch could not be answered".to_string()
            },
        ]
    }

    fn touch(&self) -> Vec<String> {
        let r = &self.finished.result;
        if r.contact_ticks == 0 {
            return vec!["the probe never touched the object".to_string()];
        }
        let safety = &self.plan.safety;
        let mut lines = vec![
            format!(
                "{:.1} s in contact ({} ticks); force p50 {:.2} N, p99 {:.2} N, max {:.2} N, at most {:.2} N of change a tick",
                r.contact_ticks as f64 / self.plan.loop_.rate_hz,
                grouped(r.contact_ticks),
                r.force_n.p50,
                r.force_n.p99,
                r.force_n.max,
                r.force_step_n_max
            ),
            format!(
                "{} tick(s) clamped at {} N, {} sample(s) rejected; deepest {} behind the surface",
                r.clamped_ticks,
                safety.force_max_n,
                r.rejected_samples,
                length(r.depth_m_max)
            ),
        ];
        lines.push(if r.energy_j > 0.0 {
            format!(
                "the rendering pushed {:.3} mJ into the hand: an ideal surface gives none",
                r.energy_j * 1e3
            )
        } else {
            format!(
                "the rendering took {:.3} mJ out and pushed none in",
                -r.energy_j * 1e3
            )
        });
        lines
    }

    fn resolution(&self) -> Vec<String> {
        let r = &self.finished.result;
        let mut lines = vec![format!(
            "{} of the contact at full resolution; refined faces p50 {}, max {} of {}",
            percent(r.contact_full_ticks, r.contact_ticks),
            grouped(r.refined_faces.p50 as u64),
            grouped(r.refined_faces.max as u64),
            grouped(r.faces)
        )];
        lines.push(format!(
            "error at the contact: certified p50 {}, max {}; measured p50 {}, max {} over {} measurement(s)",
            length(r.certified_error_m.p50),
            length(r.certified_error_m.max),
            length(r.measured_error_m.p50),
            length(r.measured_error_m.max),
            grouped(r.measured_errors)
        ));
        if self.greatest_speed_m_per_s > 0.0 {
            lines.push(self.greatest_speed());
        }
        if r.contact_unbounded_ticks > 0 {
            lines.push(format!(
                "{} contact tick(s) had no certified bound",
                grouped(r.contact_unbounded_ticks)
            ));
        }
        lines
    }

    fn greatest_speed(&self) -> String {
        let greatest = self.greatest_speed_m_per_s;
        let mut line = format!(
            "greatest speed at full resolution: {greatest:.3} m/s for this model at its size ({} operations a tick)",
            self.plan.loop_.operations
        );
        let probe = self.plan.probes.first();
        if let Some(TrajectoryPlan::Tour { speed_m_per_s, .. }) = probe.map(|p| &p.trajectory) {
            let _ = write!(line, "; the tour goes at {speed_m_per_s} m/s");
            if *speed_m_per_s > greatest {
                line.push_str(", so resolution follows speed");
            }
        }
        line
    }

    fn transfer(&self) -> Vec<String> {
        let r = &self.finished.result;
        vec![
            format!(
                "{} region(s) subscribed ({} asked again), {} splits and {} collapses performed",
                grouped(r.regions_subscribed),
                grouped(r.resubscribed),
                grouped(r.vsplits),
                grouped(r.ecols)
            ),
            format!(
                "{} received, {} of them before the first touch; the whole mesh would be {}",
                bytes(r.bytes_received),
                bytes(r.bytes_to_first_touch),
                bytes(r.bytes_full_mesh)
            ),
            format!(
                "cache at most {} of {} ({} records at once, {} evicted); the controller's process holds {}",
                bytes(r.cache.high_water_bytes),
                bytes(r.cache.bytes),
                grouped(r.cache.vsps),
                grouped(r.cache.evicted),
                bytes(r.hrtc_rss_bytes)
            ),
        ]
    }

    fn timing(&self) -> Vec<String> {
        let r = &self.finished.result;
        let spread = |s: &Spread| {
            format!(
                "p50 {:.1}, p99 {:.1}, p99.9 {:.1}, max {:.1} µs",
                s.p50, s.p99, s.p999, s.max
            )
        };
        let mut lines = vec![
            format!("work of a tick (thread CPU): {}", spread(&r.work_us)),
            format!("wake-up after the deadline: {}", spread(&r.wake_us)),
            format!("period: {}", spread(&r.period_us)),
        ];
        lines.push(if r.missed == 0 {
            format!("no period missed in {} ticks", grouped(r.ticks))
        } else {
            let m = &r.misses;
            format!(
                "{} period(s) missed beside {} ticks: {} by our own work, {} while the kernel ran something else, {} by a late timer, {} with the processor taken away, {} unexplained",
                grouped(r.missed),
                grouped(r.ticks),
                m.own_cpu,
                m.run_queue,
                m.late_timer,
                m.stolen,
                m.unexplained
            )
        });
        if r.operations_budget > 0 {
            lines.push(format!(
                "worst tick {} work units of a budget of {}",
                grouped(r.operations_max),
                grouped(r.operations_budget)
            ));
        }
        lines.push(format!(
            "{} page fault(s) and {} allocation(s) within ticks",
            r.page_faults, r.allocations
        ));
        lines.push(format!("replay hash {:014x}", r.replay_hash));
        lines
    }

    fn rights(&self) -> Vec<String> {
        let machine = self.machine;
        let mut lines = vec![format!(
            "{}; kernel {} ({})",
            machine.processor, machine.kernel, machine.preemption
        )];
        for right in &self.finished.rights {
            lines.push(match (right.obtained, right.detail.is_empty()) {
                (true, true) => format!("{}: obtained", right.name),
                (true, false) => format!("{}: obtained ({})", right.name, right.detail),
                (false, _) => format!("{}: NOT obtained ({})", right.name, right.detail),
            });
        }
        lines
    }

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
fn contact_bands(series: &[SeriesBucket]) -> Vec<(f64, f64)> {
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

/// A share in percent; nothing of nothing is said as such. Never rounded up to 100.
fn percent(part: u64, whole: u64) -> String {
    if whole == 0 {
        return "none".to_string();
    }
    let share = 100.0 * part as f64 / whole as f64;
    format!("{:.2} %", (share * 100.0).floor() / 100.0)
}

/// A whole number with a narrow space between the thousands.
#[must_use]
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push('\u{202f}');
        }
        text.push(digit);
    }
    text
}

/// Bytes as a person reads them.
#[must_use]
pub fn bytes(count: u64) -> String {
    let count = count as f64;
    match count {
        c if c >= 1048576.0 => format!("{:.1} MiB", c / 1048576.0),
        c if c >= 1024.0 => format!("{:.1} KiB", c / 1024.0),
        c => format!("{c} B"),
    }
}

/// A length as a person reads it.
fn length(metres: f64) -> String {
    match metres.abs() {
        0.0 => "0".to_string(),
        m if m < 1e-10 => "below 0.1 nm".to_string(),
        m if m < 1e-6 => format!("{:.1} nm", metres * 1e9),
        m if m < 1e-3 => format!("{:.1} µm", metres * 1e6),
        m if m < 1.0 => format!("{:.2} mm", metres * 1e3),
        _ => format!("{metres:.3} m"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hrtc::result::{Accumulator, RunMeta};
    use hrtc::tick_record::{CoreRecord, MissClass, TickRecord};
    use shared::geometry::Wrench;
    use shared::scene::{Overrides, parse};

    fn finished(contact: bool) -> Finished {
        let mut run = Accumulator::new(1_000_000).unwrap();
        for tick in 0..5000 {
            let touches = contact && tick % 1000 > 400;
            run.push(&TickRecord {
                tick,
                skipped: 0,
                miss: MissClass::None,
                wake_ns: 9_000,
                period_ns: 1_000_000,
                work_cpu_ns: 20_000,
                work_wall_ns: 20_000,
                stage_ns: [4_000; 5],
                page_faults: 0,
                allocations: 0,
                chunks_arrived: 0,
                station: 1,
                sample: None,
                wrench: Wrench {
                    force: glam::DVec3::X * f64::from(u8::from(touches)),
                    torque: glam::DVec3::ZERO,
                },
                core: CoreRecord {
                    contact: touches,
                    contact_full: tick % 7 != 0,
                    contact_bounded: true,
                    ready: true,
                    ..CoreRecord::default()
                },
            });
        }
        run.finish(RunMeta {
            scene: "a<b".to_string(),
            model: "m&n".to_string(),
            ..RunMeta::default()
        })
    }

    #[test]
    fn a_report_is_written_whole_and_its_pictures_are_beside_it() {
        let scene = include_str!("../../config/scenes/first-touch.toml");
        let plan = parse(scene, "s", Path::new(""), &Overrides::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let machine = Machine::read();
        for contact in [true, false] {
            let finished = finished(contact);
            let report = Report {
                plan: &plan,
                finished: &finished,
                machine: &machine,
                greatest_speed_m_per_s: 0.05,
                notes: &["a note".to_string()],
            };
            let out = folder.path().join("deep/er");
            report.write(&out).unwrap();
            let page = std::fs::read_to_string(out.join("report.html")).unwrap();
            assert!(page.contains("a&lt;b on m&amp;n") && !page.contains("a<b"));
            for name in ["force", "timing", "resolution"] {
                assert!(page.contains(&format!("src=\"{name}.svg\"")));
                let svg = std::fs::read_to_string(out.join(format!("{name}.svg"))).unwrap();
                assert!(svg.contains("</svg>") && !svg.contains("NaN"));
            }
            let json = std::fs::read(out.join("result.json")).unwrap();
            let back: Finished = serde_json::from_slice(&json).unwrap();
            assert!(back.result.ticks == 5000 && back.series.len() == finished.series.len());
            assert_eq!(
                std::fs::read_dir(&out).unwrap().count(),
                5,
                "nothing half-written"
            );
            let words = report.words();
            assert!(words.contains(if contact {
                "in contact"
            } else {
                "never touched"
            }));
            assert!(words.contains("a note"));
            assert!(words.contains("0.050 m/s") && words.contains("resolution follows speed"));
        }
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let finished = finished(false);
        let report = Report {
            plan: &plan,
            finished: &finished,
            machine: &machine,
            greatest_speed_m_per_s: 0.0,
            notes: &[],
        };
        assert_eq!(report.write(&file).unwrap_err().status(), 2);
    }

    #[test]
    fn contact_is_banded_where_it_was() {
        let finished = finished(true);
        let bands = contact_bands(&finished.series);
        assert_eq!(bands.len(), 5, "{bands:?}");
        for (index, (from, to)) in bands.iter().enumerate() {
            assert!((from - (index as f64 + 0.4)).abs() < 0.01);
            assert!((to - (index as f64 + 1.0)).abs() < 0.01);
        }
    }

    #[test]
    fn numbers_read_as_a_person_writes_them() {
        assert_eq!(grouped(1234567), "1\u{202f}234\u{202f}567");
        assert_eq!(grouped(12), "12");
        assert_eq!(percent(99_999, 100_000), "99.99 %");
        assert_eq!(percent(1, 1), "100.00 %");
        assert_eq!(percent(0, 0), "none");
        assert_eq!(bytes(3 << 20), "3.0 MiB");
        assert_eq!(length(2.5e-5), "25.0 µm");
    }
}
