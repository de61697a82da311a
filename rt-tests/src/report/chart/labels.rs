//! Words beside points, where they cover neither curves nor other words.

use super::svg::words;
use super::{CHARACTER, Frame};

/// Height of a line of text, pixels.
const LINE: f64 = 13.0;

/// Points that are drawn over each other, pixels.
const SAME: f64 = 4.0;

/// The rectangles that are taken (left, top, right, bottom), and the points that words may be of.
#[derive(Debug, Default)]
pub struct Taken {
    boxes: Vec<[f64; 4]>,
    /// The points of the curves.
    points: Vec<(f64, f64)>,
}

impl Taken {
    /// Keeps words off a curve: its points, and small squares along its lines.
    pub fn keep_off(&mut self, curve: impl Iterator<Item = (f64, f64)>) {
        let mut last: Option<(f64, f64)> = None;
        for (px, py) in curve {
            self.boxes.push([px - 3.0, py - 3.0, px + 3.0, py + 3.0]);
            if let Some((x0, y0)) = last {
                let steps = ((px - x0).hypot(py - y0) / 4.0).ceil().max(1.0);
                for step in 1..steps as u32 {
                    let share = f64::from(step) / steps;
                    let (x, y) = (x0 + share * (px - x0), y0 + share * (py - y0));
                    self.boxes.push([x - 1.0, y - 1.0, x + 1.0, y + 1.0]);
                }
            }
            last = Some((px, py));
            self.points.push((px, py));
        }
    }

    /// Whether words in a rectangle read as those of the point at `at`: no other point is nearer,
    /// unless it is drawn at the same place.
    fn belongs_to(&self, at: (f64, f64), [left, top, right, bottom]: [f64; 4]) -> bool {
        let away = |(x, y): (f64, f64)| {
            let (aside, over) = (x - x.clamp(left, right), y - y.clamp(top, bottom));
            aside.hypot(over)
        };
        let is_other = |&&(x, y): &&(f64, f64)| (x - at.0).hypot(y - at.1) > SAME;
        let own = away(at);
        let others = self.points.iter().filter(is_other);
        others.copied().all(|point| away(point) > own)
    }

    /// Writes words beside a point in the first free place; whether there is one.
    pub fn put(
        &mut self,
        svg: &mut String,
        frame: &Frame,
        at: (f64, f64),
        more: &str,
        text: &str,
    ) -> bool {
        let width = CHARACTER * text.chars().count() as f64;
        for (left, base) in places(at, width) {
            let mine = [
                left - 1.0,
                base - LINE + 3.0,
                left + width + 1.0,
                base + 3.0,
            ];
            let is_inside = mine[0] > frame.left
                && mine[2] < frame.left + frame.width + 20.0
                && mine[1] > frame.top - 8.0
                && mine[3] < frame.top + frame.height;
            let is_free = self.boxes.iter().all(|other| {
                mine[2] < other[0] || other[2] < mine[0] || mine[3] < other[1] || other[3] < mine[1]
            });
            if is_inside && is_free && self.belongs_to(at, mine) {
                words(svg, (left, base), "start", more, text);
                self.boxes.push(mine);
                return true;
            }
        }
        false
    }
}

/// Left ends and baselines for words around a point: close to it, then a little farther away.
fn places((x, y): (f64, f64), width: f64) -> impl Iterator<Item = (f64, f64)> {
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
    near.into_iter().chain(near.map(move |(left, base)| {
        let (is_right, is_below) = (left + 0.5 * width > x, base - 4.0 > y);
        (
            left + if is_right { 6.0 } else { -6.0 },
            base + if is_below { 9.0 } else { -9.0 },
        )
    }))
}
