//! A picture to write and draw on.

use crate::color::Color;
use embedded_graphics::Drawable;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{Dimensions, OriginDimensions, Point, Size as PixelSize};
use embedded_graphics::mono_font::iso_8859_1::{FONT_7X13, FONT_9X15, FONT_9X18_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use embedded_graphics::primitives::Rectangle;
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use std::convert::Infallible;

/// Which part of a text its place names; it is written below that place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Align {
    /// Its left end.
    Left,
    /// Its middle.
    Middle,
    /// Its right end.
    Right,
}

/// Sizes of text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Size {
    /// Notes and marks of a scale.
    Small,
    /// Sentences.
    Normal,
    /// Headings.
    Large,
}

impl Size {
    fn font(self) -> &'static MonoFont<'static> {
        match self {
            Self::Small => &FONT_7X13,
            Self::Normal => &FONT_9X15,
            Self::Large => &FONT_9X18_BOLD,
        }
    }

    /// Width of a text, pixels.
    #[must_use]
    pub fn width(self, text: &str) -> u32 {
        self.font().character_size.width * text.chars().count() as u32
    }

    /// Height of a line, pixels.
    #[must_use]
    pub fn height(self) -> u32 {
        self.font().character_size.height
    }
}

/// A picture in memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<Color>,
}

impl Canvas {
    /// A picture of one colour.
    #[must_use]
    pub fn new(width: u32, height: u32, color: Color) -> Self {
        let count = width as usize * height as usize;
        Self {
            width,
            height,
            pixels: vec![color; count],
        }
    }

    /// Its width, pixels.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Its height, pixels.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// All pixels, the uppermost row first.
    pub(crate) fn bytes(&self) -> &[u8] {
        self.pixels.as_flattened()
    }

    /// A pixel.
    ///
    /// # Panics
    /// When it lies beside the picture.
    #[must_use]
    pub fn pixel(&self, x: u32, y: u32) -> Color {
        self.pixels[(y * self.width + x) as usize]
    }

    /// Sets a pixel; beside the picture there is none.
    pub fn set(&mut self, x: u32, y: u32, color: Color) {
        if x < self.width && y < self.height {
            self.pixels[(y * self.width + x) as usize] = color;
        }
    }

    /// Copies a picture into this one, its upper left corner at a place; what is beside is left
    /// out.
    pub fn paste(&mut self, picture: &Self, left: u32, top: u32) {
        for y in 0..picture.height {
            for x in 0..picture.width {
                self.set(left + x, top + y, picture.pixel(x, y));
            }
        }
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, left: u32, top: u32, width: u32, height: u32, color: Color) {
        for y in top..top.saturating_add(height).min(self.height) {
            for x in left..left.saturating_add(width).min(self.width) {
                self.set(x, y, color);
            }
        }
    }

    /// Writes a line of text, its upper edge at a place. Narrow spaces become wide
    /// ones, other letters beyond Latin-1 question marks.
    pub fn write(&mut self, at: (u32, u32), align: Align, size: Size, color: Color, text: &str) {
        let [r, g, b] = color;
        let style = MonoTextStyle::new(size.font(), Rgb888::new(r, g, b));
        let alignment = match align {
            Align::Left => Alignment::Left,
            Align::Middle => Alignment::Center,
            Align::Right => Alignment::Right,
        };
        let place = TextStyleBuilder::new()
            .alignment(alignment)
            .baseline(Baseline::Top)
            .build();
        let text = &text.replace('\u{202f}', " ");
        let at = Point::new(at.0 as i32, at.1 as i32);
        // Infallible.
        let _ = Text::with_text_style(text, at, style, place).draw(self);
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> PixelSize {
        PixelSize::new(self.width, self.height)
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I>(&mut self, pixels: I) -> Result<(), Infallible>
    where
        I: IntoIterator<Item = embedded_graphics::Pixel<Rgb888>>,
    {
        let bounds: Rectangle = self.bounding_box();
        for embedded_graphics::Pixel(at, color) in pixels {
            if bounds.contains(at) {
                let color = [color.r(), color.g(), color.b()];
                self.set(at.x as u32, at.y as u32, color);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WHITE;

    #[test]
    fn text_lies_within_its_size_and_beside_the_picture_nothing_is_drawn() {
        let mut canvas = Canvas::new(60, 20, WHITE);
        canvas.write((2, 3), Align::Left, Size::Small, [0; 3], "5 µm");
        let (width, height) = (Size::Small.width("5 µm"), Size::Small.height());
        let mut found = 0;
        for y in 0..canvas.height() {
            for x in 0..canvas.width() {
                let is_inside = (2..2 + width).contains(&x) && (3..3 + height).contains(&y);
                let is_black = canvas.pixel(x, y) != WHITE;
                assert!(is_inside || !is_black, "({x}, {y})");
                found += u32::from(is_black);
            }
        }
        assert!(found > 20, "{found} pixels are black");
        canvas.write((59, 19), Align::Left, Size::Large, [0; 3], "far");
        canvas.fill(50, 10, 100, 100, [9; 3]);
        assert_eq!(canvas.pixel(59, 19), [9; 3]);
    }
}
