//! Colours, and the scale that shows a number as one.

/// Red, green and blue, as a screen shows them.
pub type Color = [u8; 3];

/// White.
pub const WHITE: Color = [255; 3];

/// The colour between two: the first at 0, the second at 1.
#[must_use]
pub fn mix(from: Color, to: Color, share: f64) -> Color {
    let share = share.clamp(0.0, 1.0);
    let channel = |k: usize| f64::from(from[k]) * (1.0 - share) + f64::from(to[k]) * share;
    [0, 1, 2].map(|k| channel(k).round() as u8)
}

/// Colours of the numbers from 0 to the largest one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorScale {
    /// The largest number; all above it have its colour.
    pub largest: f64,
    /// Colours of 0, of the middle and of the largest number.
    pub colors: [Color; 3],
}

impl ColorScale {
    /// The colour of a number; that of 0 where it is none.
    #[must_use]
    pub fn of(&self, number: f64) -> Color {
        let place = 2.0 * number / self.largest;
        let [low, middle, high] = self.colors;
        if place > 1.0 {
            mix(middle, high, place - 1.0)
        } else {
            mix(low, middle, if place > 0.0 { place } else { 0.0 })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_goes_through_its_colours_and_ends_there() {
        let colors = [[0, 0, 0], [100, 0, 0], [100, 200, 0]];
        let scale = ColorScale {
            largest: 4.0,
            colors,
        };
        let found = [-1.0, 0.0, 1.0, 2.0, 3.0, 4.0, 9.0, f64::NAN].map(|x| scale.of(x));
        let [low, middle, high] = colors;
        let expected = [low, low, [50, 0, 0], middle, [100, 100, 0], high, high, low];
        assert_eq!(found, expected);
        let empty = ColorScale {
            largest: 0.0,
            colors,
        };
        assert_eq!(empty.of(0.0), low);
    }
}
