//! The picture of a moment: the touched objects whole, and each touch from near.

use super::legend::{self, BACKGROUND, DEVICE, FORCE, FREE, GREY, INK, NORMAL, PROXY, of_fineness};
use super::moment::{Body, Fineness, Moment, ShownProbe};
use super::sight::{NORMAL_LENGTH, Sight, half_width};
use super::trail::PathPoint;
use crate::report::units::{digits, grouped, length};
use geometry::Pose;
use picture::{Align, Camera, Canvas, Color, ColorScale, Size, Solids, render};
use scene::{ModelSource, ScenePlan};

/// Size of a picture, pixels: as wide as a page of text.
const WIDTH: u32 = 1100;
const TITLE: u32 = 52;
const PANELS: u32 = 480;
const OVERVIEW: u32 = 430;
const GAP: u32 = 8;
/// Height of a picture, pixels.
const HEIGHT: u32 = TITLE + PANELS + legend::HEIGHT;
/// Darkness of the edges of faces.
const EDGES: f64 = 0.38;
/// Radius of a path, and of the shaft of an arrow, half widths of the panel.
const PATH: f64 = 0.006;
const SHAFT: f64 = 0.011;
/// Length of an arrow of the greatest force, half widths: the normal, which it mostly points along,
/// is seen beyond it.
const FORCE_LENGTH: f64 = 0.62;
/// The least radius of a probe in the overview, half widths, so that it is seen.
const LEAST_BALL: f64 = 0.018;
/// Width of the scale bar, at most, as a share of the panel.
const BAR: f64 = 0.25;

/// Everything that a picture is made of.
#[derive(Debug)]
pub struct TouchPicture<'a> {
    /// The scene as it ran.
    pub plan: &'a ScenePlan,
    /// The moment.
    pub moment: &'a Moment,
    /// Bodies of the probes.
    pub bodies: &'a [Body],
    /// Paths of the probes up to the moment.
    pub paths: &'a [Vec<PathPoint>],
    /// Colours of forces; the greatest one is the longest arrow.
    pub scale: ColorScale,
}

/// From where a picture sees.
#[derive(Debug, Clone, PartialEq)]
pub struct Views {
    /// The directions.
    pub sight: Sight,
    /// The objects whole.
    pub overview: Camera,
    /// Probes seen from near: their number and camera.
    pub close_ups: Vec<(usize, Camera)>,
}

impl TouchPicture<'_> {
    /// The views that show the most: from the side of the strongest touch, every probe that touches
    /// from near.
    #[must_use]
    pub fn views(&self) -> Views {
        let moment = self.moment;
        let strongest = moment.strongest();
        let half = |k: usize| half_width(moment, &moment.probes[k], &self.plan.probes[k].shape);
        let probe = &moment.probes[strongest];
        let sight = Sight::of_probe(moment, probe, half(strongest));
        let mut seen: Vec<usize> = (0..moment.probes.len()).collect();
        seen.retain(|&k| k == strongest || moment.probes[k].touch.is_some());
        seen.sort_by_key(|&k| k != strongest);
        let close_ups = seen.into_iter().map(|k| {
            let probe = &moment.probes[k];
            let sight = match k {
                _ if k == strongest => sight,
                _ => Sight::of_probe(moment, probe, half(k)),
            };
            let at = probe.position().unwrap_or_default();
            (k, sight.close_up(at, half(k)))
        });
        Views {
            sight,
            overview: sight.overview(moment, f64::from(OVERVIEW) / f64::from(PANELS)),
            close_ups: close_ups.collect(),
        }
    }

    /// Draws it.
    #[must_use]
    pub fn draw(&self, views: &Views) -> Canvas {
        let mut canvas = Canvas::new(WIDTH, HEIGHT, BACKGROUND);
        self.write_title(&mut canvas);
        let whole = self.panel(&views.overview, OVERVIEW, PANELS, true);
        canvas.paste(&whole, 0, TITLE);
        let (columns, size) = close_up_panels(views.close_ups.len() as u32);
        for (place, (k, camera)) in (0u32..).zip(&views.close_ups) {
            let mut panel = self.panel(camera, size[0], size[1], false);
            self.write_touch(&mut panel, *k);
            let x = OVERVIEW + GAP + place % columns * (size[0] + GAP);
            let y = TITLE + place / columns * (size[1] + GAP);
            canvas.paste(&panel, x, y);
        }
        legend::write(&mut canvas, TITLE + PANELS, &self.scale);
        canvas
    }

    fn write_title(&self, canvas: &mut Canvas) {
        let moment = self.moment;
        let probe = &moment.probes[moment.strongest()];
        let object = probe.touch.as_ref().map_or(0, |touch| touch.object);
        let title = format!(
            "{}, {}: {} N at {:.2} s",
            self.plan.name,
            model_words(&self.plan.objects[object].model),
            digits(probe.force.length()),
            moment.seconds
        );
        canvas.write((16, 8), Align::Left, Size::Large, INK, &title);
        let faces = moment.objects.iter().filter(|of| of.is_active);
        let faces = faces.flat_map(|of| &of.faces);
        let count = |fineness| {
            let of = faces.clone().filter(|face| face.fineness == fineness);
            grouped(of.count() as u64)
        };
        let words = format!(
            "{} original faces, {} refined, {} of the base mesh are in the controller's mesh",
            count(Fineness::Original),
            count(Fineness::Refined),
            count(Fineness::Base)
        );
        canvas.write((16, 31), Align::Left, Size::Small, GREY, &words);
    }

    /// Says what a probe touches.
    fn write_touch(&self, panel: &mut Canvas, k: usize) {
        let probe = &self.moment.probes[k];
        let name = match self.moment.probes.len() {
            1 => String::new(),
            _ => format!("probe {k}: "),
        };
        let parts = match &probe.touch {
            None => vec![format!("{name}in free space")],
            Some(touch) => {
                let of = match self.plan.objects.len() {
                    1 => String::new(),
                    _ => format!(" on object {}", touch.object),
                };
                let error = match touch.certified_m {
                    _ if touch.is_full => "at full resolution".to_string(),
                    m if m.is_finite() => format!("error at most {}", length(m)),
                    _ => "error without a bound".to_string(),
                };
                let force = digits(probe.force.length());
                let depth = length(touch.depth_m);
                let torque = match probe.torque.length() {
                    0.0 => String::new(),
                    nm => format!("{} mN m, ", digits(1e3 * nm)),
                };
                vec![
                    format!("{name}{force} N{of}, "),
                    format!("{torque}{depth} deep, "),
                    error,
                ]
            }
        };
        let height = Size::Normal.height() + 4;
        let lines = lines(parts, panel.width().saturating_sub(16));
        for (line, y) in lines.iter().zip((0..).step_by(height as usize)) {
            let width = Size::Normal.width(line);
            panel.fill(0, y, width + 16, height + 4, [255; 3]);
            panel.write((8, y + 5), Align::Left, Size::Normal, INK, line);
        }
    }

    fn panel(&self, camera: &Camera, width: u32, height: u32, is_whole: bool) -> Canvas {
        let mut solids = Solids::default();
        for object in &self.moment.objects {
            for face in &object.faces {
                solids.face(face.corners, of_fineness(face.fineness), EDGES);
            }
        }
        solids.begin_marks();
        for path in self.paths {
            self.add_path(&mut solids, path, PATH * camera.half_width());
        }
        let least = if is_whole {
            LEAST_BALL * camera.half_width()
        } else {
            0.0
        };
        for (probe, body) in self.moment.probes.iter().zip(self.bodies) {
            let poses = [(&probe.device, DEVICE), (&probe.proxy, PROXY)];
            for (pose, color) in poses {
                if let Some(pose) = pose {
                    add_body(&mut solids, body, pose, color, least);
                }
            }
        }
        solids.begin_signs();
        for probe in &self.moment.probes {
            self.add_arrows(&mut solids, probe, camera.half_width());
        }
        let mut panel = render(&solids, camera, width, height, [255; 3]);
        write_bar(&mut panel, camera);
        panel
    }

    fn add_path(&self, solids: &mut Solids, path: &[PathPoint], radius: f64) {
        // A tube of no less than its radius: shorter pieces are not seen apart.
        let mut from: Option<&PathPoint> = None;
        for point in path {
            let Some(begin) = from else {
                from = Some(point);
                continue;
            };
            if begin.at.distance(point.at) < radius {
                continue;
            }
            let color = point.force_n.map_or(FREE, |force_n| self.scale.of(force_n));
            solids.tube(begin.at, point.at, radius, color);
            from = Some(point);
        }
    }

    fn add_arrows(&self, solids: &mut Solids, probe: &ShownProbe, half: f64) {
        let Some(touch) = &probe.touch else { return };
        for contact in &touch.contacts {
            let out = contact.normal * probe.force.dot(contact.normal).signum();
            let normal = NORMAL_LENGTH * half * out;
            solids.arrow(contact.point, normal, 0.45 * SHAFT * half, NORMAL);
        }
        if let (Some(contact), Some(force)) = (touch.contacts.first(), probe.force.try_normalize())
        {
            let share = probe.force.length() / self.scale.largest;
            let by = FORCE_LENGTH * half * share * force;
            solids.arrow(contact.point, by, SHAFT * half, FORCE);
        }
    }
}

/// Columns of so many close-ups, and the width and height of each, pixels: one fills the place, two
/// are beside each other, three and four are a square, so that none is too flat for its arrows.
fn close_up_panels(count: u32) -> (u32, [u32; 2]) {
    let (width, columns) = (WIDTH - OVERVIEW - GAP, count.clamp(1, 2));
    let rows = count.div_ceil(columns).max(1);
    let size = [
        (width - GAP * (columns - 1)) / columns,
        (PANELS - GAP * (rows - 1)) / rows,
    ];
    (columns, size)
}

/// A model in words.
fn model_words(model: &ModelSource) -> String {
    match model {
        ModelSource::Generate { shape, faces } => {
            format!("{shape} of {} faces", grouped(u64::from(*faces)))
        }
        file => file.name(),
    }
}

/// Parts of a text as lines that are no wider than so many pixels where they can be.
fn lines(parts: Vec<String>, width: u32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in parts {
        match lines.last_mut() {
            Some(line) if Size::Normal.width(&format!("{line}{}", part.trim_end())) <= width => {
                line.push_str(&part);
            }
            _ => lines.push(part),
        }
    }
    lines
}

fn add_body(solids: &mut Solids, body: &Body, pose: &Pose, color: Color, least: f64) {
    match body {
        Body::Ball(radius) => solids.ball(pose.position, radius.max(least), color),
        Body::Tool(mesh) => {
            for triangle in &mesh.triangles {
                let corner = |v: u32| pose.transform_point(mesh.positions[v as usize]);
                solids.face(triangle.map(corner), color, 0.0);
            }
        }
    }
}

/// A bar of a round length, as it is where the camera looks.
fn write_bar(panel: &mut Canvas, camera: &Camera) {
    let metres_a_pixel = 2.0 * camera.half_width() / f64::from(panel.width());
    let metres = round_below(BAR * f64::from(panel.width()) * metres_a_pixel);
    let pixels = (metres / metres_a_pixel).round() as u32;
    let (right, bottom) = (panel.width() - 12, panel.height() - 12);
    let text = length(metres);
    let plate = pixels.max(Size::Small.width(&text)) + 12;
    let height = Size::Small.height() + 12;
    let left = right - pixels / 2 - plate / 2;
    panel.fill(left, bottom + 6 - height, plate, height, [255; 3]);
    panel.fill(right - pixels, bottom - 3, pixels, 3, INK);
    let at = (right - pixels / 2, bottom - 4 - Size::Small.height());
    panel.write(at, Align::Middle, Size::Small, INK, &text);
}

/// The largest of 1, 2 and 5 times a power of ten that is no more than a number above 0.
fn round_below(number: f64) -> f64 {
    let power = 10f64.powf(number.log10().floor());
    let steps = [5.0, 2.0].into_iter().find(|step| step * power <= number);
    steps.unwrap_or(1.0) * power
}

#[cfg(test)]
mod tests {
    use super::super::sight::RAISED;
    use super::*;
    use scene::MAX_PROBES;

    #[test]
    fn an_arrow_of_the_greatest_force_ends_within_its_panel() {
        for count in 1..=MAX_PROBES as u32 {
            let (columns, [width, height]) = close_up_panels(count);
            let rows = count.div_ceil(columns);
            assert!(columns * width <= WIDTH - OVERVIEW - GAP && rows * height <= PANELS);
            // Half of the height, in half widths.
            let above = f64::from(height) / f64::from(width);
            assert!(FORCE_LENGTH - RAISED < above, "{count}: {above}");
        }
    }

    #[test]
    fn a_text_is_broken_where_it_is_too_wide() {
        let parts = || ["0.98 N on object 77, ", "1.2 mm deep, ", "full"].map(String::from);
        let wide = lines(parts().into(), 2_000);
        assert_eq!(wide, ["0.98 N on object 77, 1.2 mm deep, full"]);
        let narrow = lines(parts().into(), Size::Normal.width("0.98 N on object 77, "));
        assert_eq!(narrow, ["0.98 N on object 77, ", "1.2 mm deep, full"]);
    }

    #[test]
    fn a_bar_is_round() {
        for (number, expected) in [(0.0123, 0.01), (0.5, 0.5), (49.0, 20.0), (0.0021, 0.002)] {
            assert!(
                (round_below(number) / expected - 1.0).abs() < 1e-12,
                "{number}"
            );
        }
    }
}
