//! Histograms of bounded size.

use super::{Buckets, MedianMax, ShortSpread, Spread};
use hdrhistogram::Histogram;

/// A histogram with a fixed range, three significant digits and an exact maximum. It has counts up
/// to the largest value so far: those of the whole range, which no sound run needs, would be twice
/// as many. Counts of 32 bits suffice for 49 days at 1 kHz; 64 bits would double the locked memory.
pub(super) struct Fixed {
    histogram: Histogram<u32>,
    /// The largest count that is told from others.
    most: u64,
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
        Histogram::new(3).ok().map(|histogram| Self {
            histogram,
            most: 1 << bits,
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
        // `as` saturates too.
        let counted = ((value * self.scale).round() as u64).min(self.most);
        // Below its bound the histogram grows for every value.
        let _ = self.histogram.record(counted);
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
        // It grows, so every count finds its place.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_grows_with_its_values_and_ends_with_its_range() {
        let mut table = Fixed::new(1.0, 32).expect("a table");
        table.push(1000.0);
        assert!(table.histogram.distinct_values() <= 4096);
        assert_eq!(table.quantile(0.5), 1000.0);
        for _ in 0..9 {
            table.push(1e30);
        }
        assert!(table.histogram.distinct_values() <= 32 * 1024);
        let bound = 2f64.powi(32);
        assert!((table.quantile(0.9) - bound).abs() < 1e-3 * bound);
        assert_eq!(table.spread().max, 1e30);
    }

    #[test]
    fn tables_that_grew_differently_are_added_up() {
        let of = |value: f64| {
            let mut table = Fixed::new(1.0, 32).expect("a table");
            table.push(value);
            table
        };
        for [a, b] in [[10.0, 5e8], [5e8, 10.0]] {
            let both = of(a).together(of(b));
            assert_eq!(both.quantile(0.5), 10.0);
            assert_eq!(both.spread().max, 5e8);
            assert_eq!(both.buckets().iter().map(|of| of.1).sum::<u64>(), 2);
        }
    }
}
