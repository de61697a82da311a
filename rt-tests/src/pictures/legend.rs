//! The colours of a picture of a touch and what they mean.

use super::moment::Fineness;
use crate::report::units::digits;
use picture::{Align, Canvas, Color, ColorScale, Size};

/// Ground of the pictures.
pub const BACKGROUND: Color = [250, 250, 252];
/// Text.
pub const INK: Color = [30, 30, 36];
/// Text that matters less.
pub const GREY: Color = [96, 98, 106];
/// The device, and a tool that it moves.
pub const DEVICE: Color = [214, 52, 52];
/// The proxy.
pub const PROXY: Color = [42, 160, 84];
/// Force on the hand.
pub const FORCE: Color = [24, 24, 28];
/// Normals of contacts.
pub const NORMAL: Color = [34, 98, 230];
/// Paths in free space.
pub const FREE: Color = [150, 152, 160];

/// Colours of faces.
#[must_use]
pub fn of_fineness(fineness: Fineness) -> Color {
    match fineness {
        Fineness::Base => [176, 200, 230],
        Fineness::Refined => [250, 236, 196],
        Fineness::Original => [250, 186, 62],
    }
}

/// Colours of forces up to the largest one.
#[must_use]
pub fn force_scale(largest_n: f64) -> ColorScale {
    ColorScale {
        largest: largest_n,
        colors: [[120, 100, 210], [206, 30, 150], [150, 0, 20]],
    }
}

/// Height of the legend, pixels.
pub const HEIGHT: u32 = 58;
const SWATCH: u32 = 14;
const GAP: u32 = 6;
/// Width of the colour scale of forces.
const SCALE_WIDTH: u32 = 220;

/// Writes the legend below a picture.
pub fn write(canvas: &mut Canvas, top: u32, scale: &ColorScale) {
    let rows = [
        [
            (of_fineness(Fineness::Original), "original faces"),
            (of_fineness(Fineness::Refined), "refined"),
            (of_fineness(Fineness::Base), "base mesh"),
            (FREE, "path in free space"),
        ],
        [
            (DEVICE, "device"),
            (PROXY, "proxy, held outside"),
            (FORCE, "force on the hand"),
            (NORMAL, "normal"),
        ],
    ];
    let width = canvas.width();
    for (row, top) in rows.iter().zip([top + 6, top + 32]) {
        let mut left = 16;
        for &(color, text) in row {
            canvas.fill(left, top, SWATCH, SWATCH, color);
            let text_left = left + SWATCH + GAP;
            canvas.write((text_left, top), Align::Left, Size::Small, INK, text);
            left += 190;
        }
    }
    // Of a recording without a touch no path has a colour.
    if scale.largest > 0.0 {
        write_scale(canvas, width - SCALE_WIDTH - 40, top, scale);
    }
}

fn write_scale(canvas: &mut Canvas, left: u32, top: u32, scale: &ColorScale) {
    for x in 0..SCALE_WIDTH {
        let share = f64::from(x) / f64::from(SCALE_WIDTH - 1);
        let color = scale.of(share * scale.largest);
        canvas.fill(left + x, top + 22, 1, SWATCH, color);
    }
    let name = "path, coloured by force, N";
    let middle = left + SCALE_WIDTH / 2;
    canvas.write((middle, top + 6), Align::Middle, Size::Small, INK, name);
    for part in [0u32, 1, 2] {
        let number = digits(0.5 * f64::from(part) * scale.largest);
        let at = (left + part * SCALE_WIDTH / 2, top + 39);
        canvas.write(at, Align::Middle, Size::Small, INK, &number);
    }
}
