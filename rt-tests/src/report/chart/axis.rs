//! Axes: their ranges, and the places and words of their marks.

use crate::report::units::{axis_label, bytes, digits, length};

/// Share of a logarithmic axis that 0 takes, and where in it 0 lies.
const ZERO_ROOM: f64 = 0.1;
const ZERO_PLACE: f64 = 0.03;
/// Room above the largest number on a linear axis, as a share of the range.
const LINEAR_ROOM: f64 = 0.08;
/// Marks that a linear axis has at the most.
const MAX_LINEAR_MARKS: f64 = 8.0;

/// What an axis counts in: decides where its marks are and how they read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Length,
    /// Microseconds.
    Time,
    /// Bytes.
    Bytes,
    /// Any other; the title names it.
    Number,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Scale {
    Linear,
    /// 0 has a place of its own below the lowest mark.
    Logarithmic {
        has_zero: bool,
    },
}

/// An axis with its range.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Quantity and unit.
    pub title: String,
    unit: Unit,
    scale: Scale,
    low: f64,
    high: f64,
}

impl Axis {
    /// A logarithmic axis over these numbers; what is not finite or below 0 is left out.
    #[must_use]
    pub fn over(title: &str, unit: Unit, numbers: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high, mut has_zero) = (f64::INFINITY, 0.0_f64, false);
        for number in numbers.filter(|n| n.is_finite() && *n >= 0.0) {
            has_zero |= number == 0.0;
            if number > 0.0 {
                low = low.min(number);
                high = high.max(number);
            }
        }
        if low > high {
            (low, high) = (1.0, 1.0);
        }
        // Room on both sides, and never an empty range.
        let room = (high / low).powf(0.06).max(1.25);
        Self {
            title: title.to_string(),
            unit,
            scale: Scale::Logarithmic { has_zero },
            low: low / room,
            high: high * room,
        }
    }

    /// A linear axis over 0 and these numbers; what is not finite is left out.
    #[must_use]
    pub fn linear(title: &str, numbers: impl Iterator<Item = f64>) -> Self {
        let numbers = numbers.filter(|n| n.is_finite());
        let (low, high) = numbers.fold((0.0_f64, 0.0_f64), |(low, high), n| {
            (low.min(n), high.max(n))
        });
        let high = if low < high { high } else { 1.0 };
        Self {
            title: title.to_string(),
            unit: Unit::Number,
            scale: Scale::Linear,
            low,
            high,
        }
    }

    /// The same axis with room above its largest number.
    #[must_use]
    pub fn with_room(mut self) -> Self {
        self.high += LINEAR_ROOM * (self.high - self.low);
        self
    }

    /// The axis reaches at least so far up.
    #[must_use]
    pub fn at_least(mut self, high: f64) -> Self {
        self.high = self.high.max(high);
        self
    }

    /// Smallest and largest number on the axis.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Whether a number can be drawn.
    #[must_use]
    pub fn has(&self, number: f64) -> bool {
        match self.scale {
            Scale::Linear => number.is_finite(),
            Scale::Logarithmic { has_zero } => {
                number.is_finite() && (number > 0.0 || number == 0.0 && has_zero)
            }
        }
    }

    /// Share of the axis, 0 to 1, at which a number lies.
    #[must_use]
    pub fn place(&self, number: f64) -> f64 {
        match self.scale {
            Scale::Linear => ((number - self.low) / (self.high - self.low)).clamp(0.0, 1.0),
            Scale::Logarithmic { .. } if number <= 0.0 => ZERO_PLACE,
            Scale::Logarithmic { has_zero } => {
                let first = if has_zero { ZERO_ROOM } else { 0.0 };
                let share = (number / self.low).ln() / (self.high / self.low).ln();
                first + (1.0 - first) * share.clamp(0.0, 1.0)
            }
        }
    }

    /// Marks with their words.
    #[must_use]
    pub fn marks(&self) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Linear => self.linear_marks(),
            Scale::Logarithmic { has_zero } => {
                let mut marks = match self.unit {
                    Unit::Bytes => self.byte_marks(),
                    _ => self.decade_marks(),
                };
                if marks.is_empty() {
                    // So short an axis lies between two marks.
                    let middle = (self.low * self.high).sqrt();
                    marks.push((middle, self.worded(middle)));
                }
                if has_zero {
                    marks.insert(0, (0.0, "0".to_string()));
                }
                marks
            }
        }
    }

    /// Multiples of 1, 2 or 5 times a power of ten.
    fn linear_marks(&self) -> Vec<(f64, String)> {
        let least = (self.high - self.low) / MAX_LINEAR_MARKS;
        let decade = 10_f64.powf(least.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0]
            .map(|factor| factor * decade)
            .into_iter()
            .find(|&step| step >= least)
            .unwrap_or(10.0 * decade);
        let first = (self.low / step).ceil() as i64;
        let last = (self.high / step).floor() as i64;
        (first..=last)
            .map(|k| (k as f64 * step, axis_label(k as f64 * step)))
            .collect()
    }

    /// Powers of two or four.
    fn byte_marks(&self) -> Vec<(f64, String)> {
        let factor = if self.decades() > 2.2 { 4.0 } else { 2.0 };
        let mut marks = Vec::new();
        let mut mark = 1.0;
        while mark <= self.high {
            if mark >= self.low {
                marks.push((mark, bytes(mark as u64).replace(".0 ", " ")));
            }
            mark *= factor;
        }
        marks
    }

    /// Powers of ten, and steps between them on a short axis.
    fn decade_marks(&self) -> Vec<(f64, String)> {
        let steps: &[f64] = match self.decades() {
            decades if decades > 2.6 => &[1.0],
            decades if decades > 0.9 => &[1.0, 2.0, 5.0],
            _ => &[1.0, 2.0, 3.0, 5.0, 7.0],
        };
        let first = self.low.log10().floor() as i32;
        let last = self.high.log10().ceil() as i32;
        let marks = (first..=last).flat_map(|decade| {
            let power = 10_f64.powi(decade);
            steps.iter().map(move |step| step * power)
        });
        let marks = marks.filter(|mark| (self.low..=self.high).contains(mark));
        marks.map(|mark| (mark, self.worded(mark))).collect()
    }

    fn worded(&self, mark: f64) -> String {
        match self.unit {
            Unit::Length => length(mark),
            Unit::Time => digits(mark),
            Unit::Bytes => bytes(mark as u64),
            Unit::Number => axis_label(mark),
        }
    }

    fn decades(&self) -> f64 {
        (self.high / self.low).log10()
    }
}
