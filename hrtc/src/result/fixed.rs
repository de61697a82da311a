//! Histograms of fixed size.

use super::{Buckets, MedianMax, ShortSpread, Spread};
use hdrhistogram::Histogram;

/// A histogram with a fixed range, three significant digits and an exact maximum. Counts of 32 bits
/// suffice for 49 days at 1 kHz; 64 bits would double the locked memory.
pub(super) struct Fixed {
    histogram: Histogram<u32>,
    /// Histogram counts a unit of the quantity.
    scale: f64,
    /// Largest value, in the unit of the quantity.
    max: f64,
    /// Whether every value was finite; the others are not in the table.
    pub(super) is_finite: bool,
}

impl Fixed {
    /// For a quantity counted in steps of 1 / `scale`, up to 2^`bits` steps.
    pub(super) fn new(scale: f64, bits: u32) -> Option<Self> {
        Histogram::new_with_bounds(1, 1 << bits, 3)
            .ok()
            .map(|histogram| Self {
                histogram,
                scale,
                max: 0.0,
                is_finite: true,
            })
    }

    pub(super) fn push(&mut self, value: f64) {
        if !value.is_finite() {
            self.is_finite = false;
            return;
        }
        let value = value.max(0.0);
        self.max = self.max.max(value);
        // `as` saturates; so does the histogram at its upper bound.
        self.histogram
            .saturating_record((value * self.scale).round() as u64);
    }

    pub(super) fn quantile(&self, q: f64) -> f64 {
        if self.histogram.is_empty() {
            return 0.0;
        }
        (self.histogram.value_at_quantile(q) as f64 / self.scale).min(self.max)
    }

    pub(super) fn spread(&self) -> Spread {
        Spread {
            p50: self.quantile(0.5),
            p99: self.quantile(0.99),
            p999: self.quantile(0.999),
            max: self.max,
        }
    }

    pub(super) fn short(&self) -> ShortSpread {
        let Spread { p50, p99, max, .. } = self.spread();
        ShortSpread { p50, p99, max }
    }

    pub(super) fn median_max(&self) -> MedianMax {
        let Spread { p50, max, .. } = self.spread();
        MedianMax { p50, max }
    }

    /// The sum of two tables.
    pub(super) fn together(mut self, other: Self) -> Self {
        // Both have the same range, so every count finds its place.
        let _ = self.histogram.add(&other.histogram);
        self.max = self.max.max(other.max);
        self.is_finite &= other.is_finite;
        self
    }

    pub(super) fn buckets(&self) -> Buckets {
        self.histogram
            .iter_recorded()
            .map(|step| (step.value_iterated_to(), u64::from(step.count_at_value())))
            .collect()
    }
}
