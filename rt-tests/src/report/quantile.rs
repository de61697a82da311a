//! Quantiles of measured numbers, by nearest rank.

use hrtc_core::record::max_or_nan;
use serde::Serialize;

/// Sorts numbers so that they ascend; what is no number comes last, whatever its sign, so that it
/// is the maximum.
pub fn sort(numbers: &mut [f64]) {
    let key = |number: f64| if number.is_nan() { f64::NAN } else { number };
    numbers.sort_unstable_by(|&a, &b| key(a).total_cmp(&key(b)));
}

/// The smallest of ascending numbers that a share of them (0 to 1) does not exceed; 0 of none.
#[must_use]
pub fn quantile(ascending: &[f64], share: f64) -> f64 {
    let rank = (share * ascending.len() as f64).ceil() as usize;
    let last = ascending.len().saturating_sub(1);
    ascending
        .get(rank.saturating_sub(1).min(last))
        .copied()
        .unwrap_or(0.0)
}

/// The middle value, or the mean of the two middle ones; 0 of none.
#[must_use]
pub fn median(values: &[f64]) -> f64 {
    let mut ascending = values.to_vec();
    sort(&mut ascending);
    let last = ascending.len().saturating_sub(1);
    let at = |place: usize| ascending.get(place).copied().unwrap_or(0.0);
    0.5 * (at(last / 2) + at(last.div_ceil(2)))
}

/// The smallest and the largest number; not a number of none, and where one of them is none.
#[must_use]
pub fn range(numbers: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let mut numbers = numbers.into_iter();
    let Some(first) = numbers.next() else {
        return [f64::NAN; 2];
    };
    numbers.fold([first; 2], |[low, high], number| {
        [-max_or_nan(-low, -number), max_or_nan(high, number)]
    })
}

/// Quantiles of some numbers; all 0 of none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99th of 100.
    pub p99: f64,
    /// 999th of 1000.
    pub p999: f64,
    /// Maximum.
    pub max: f64,
}

impl Quantiles {
    /// Of numbers in any order, which are sorted.
    #[must_use]
    pub fn of(numbers: &mut [f64]) -> Self {
        sort(numbers);
        Self {
            p50: quantile(numbers, 0.5),
            p99: quantile(numbers, 0.99),
            p999: quantile(numbers, 0.999),
            max: quantile(numbers, 1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_sorted_numbers() {
        let numbers: Vec<f64> = (1..=100).map(f64::from).collect();
        assert_eq!(quantile(&numbers, 0.5), 50.0);
        assert_eq!(quantile(&numbers, 0.99), 99.0);
        assert_eq!(quantile(&numbers, 1.0), 100.0);
        assert_eq!(quantile(&numbers, 0.0), 1.0);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }

    #[test]
    fn what_is_no_number_is_the_maximum_whatever_its_sign() {
        for nan in [f64::NAN, -f64::NAN] {
            let found = Quantiles::of(&mut [3.0, nan, 1.0, f64::INFINITY]);
            assert!(found.max.is_nan() && found.p50 == 3.0, "{found:?}");
        }
    }

    #[test]
    fn a_range_hides_neither_that_there_was_nothing_nor_what_is_no_number() {
        assert_eq!(range([3.0, -1.0, 2.0]), [-1.0, 3.0]);
        assert_eq!(range([-4.0]), [-4.0, -4.0]);
        for numbers in [&[0.0; 0][..], &[1.0, f64::NAN], &[f64::NAN, 1.0]] {
            let found = range(numbers.iter().copied());
            assert!(found.iter().all(|of| of.is_nan()), "{found:?}");
        }
    }

    #[test]
    fn the_median_is_the_middle() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[]), 0.0);
    }
}
