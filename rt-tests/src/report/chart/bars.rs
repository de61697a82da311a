//! Stacked bars in groups.

use super::COLORS;
use super::svg::{Ground, heading, open, words};
use std::fmt::Write as _;

/// Height of a bar with the gap to the next; widths of the names before and the notes behind it,
/// pixels.
const ROW: f64 = 17.0;
const NAMES: f64 = 92.0;
const NOTES: f64 = 132.0;

/// A stacked bar.
#[derive(Debug, Clone)]
pub struct Bar {
    /// Its name, before it.
    pub name: String,
    /// Parts from the left, in the order of the colours.
    pub parts: Vec<f64>,
    /// A note behind it.
    pub note: String,
}

/// Groups of bars with a title each, `columns` groups a row, all to the same scale.
#[must_use]
pub fn bars(groups: &[(String, Vec<Bar>)], columns: usize, width: f64) -> String {
    let columns = columns.max(1);
    let cell = width / columns as f64;
    let all = groups.iter().flat_map(|(_, bars)| bars);
    let longest = all
        .map(|bar| bar.parts.iter().sum::<f64>())
        .fold(f64::MIN_POSITIVE, f64::max);
    let scale = (cell - NAMES - NOTES - 12.0) / longest;
    let heights: Vec<f64> = groups
        .chunks(columns)
        .map(|row| row.iter().map(|(_, bars)| bars.len()).max().unwrap_or(0))
        .map(|most| 30.0 + ROW * most as f64 + 10.0)
        .collect();
    let mut svg = open(Ground::Page, width, heights.iter().sum());
    let mut top = 0.0;
    for (row, height) in groups.chunks(columns).zip(&heights) {
        for (column, (title, bars)) in row.iter().enumerate() {
            let left = cell * column as f64;
            heading(&mut svg, (left, top + 16.0), title);
            for (place, bar) in bars.iter().enumerate() {
                draw(&mut svg, bar, left, top + 26.0 + ROW * place as f64, scale);
            }
        }
        top += height;
    }
    svg.push_str("</svg>\n");
    svg
}

/// A bar with its top at `y`; `scale` is pixels a unit.
fn draw(svg: &mut String, bar: &Bar, left: f64, y: f64, scale: f64) {
    words(svg, (left + NAMES - 6.0, y + 11.0), "end", "", &bar.name);
    let mut x = left + NAMES;
    for (part, color) in bar.parts.iter().zip(COLORS) {
        let width = scale * part;
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.2}\" height=\"{:.1}\" fill=\"{color}\"/>",
            ROW - 4.0
        );
        x += width;
    }
    words(svg, (x + 6.0, y + 11.0), "start", "", &bar.note);
}
