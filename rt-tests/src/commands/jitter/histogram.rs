//! The picture of latency histograms: both axes logarithmic.

use crate::report::chart::{Axis, COLORS, Chart, Curve, Ground, Names, Stroke, Unit, grid, xs, ys};
use hrtc::result::Buckets;

/// Bins a factor of ten.
const BINS_A_DECADE: f64 = 12.0;
/// Height of the picture, pixels.
const HEIGHT: f64 = 320.0;

/// Named histograms (nanoseconds) as curves of ticks over microseconds, as SVG.
#[must_use]
pub fn picture(histograms: &[(&str, &Buckets)]) -> String {
    let curves: Vec<Curve> = histograms
        .iter()
        .zip(COLORS.iter().cycle())
        .map(|((name, buckets), color)| Curve::new(name, color, Stroke::Line, binned(buckets)))
        .collect();
    let x = Axis::over("time, µs", Unit::Time, xs(&curves));
    let y = Axis::over("ticks", Unit::Number, ys(&curves));
    let mut chart = Chart::new("Distribution of times", x, y, curves);
    chart.names = Names::Legend;
    grid(&[chart], 1, HEIGHT, Ground::Paper)
}

/// Counts in bins of equal width on a logarithmic axis: middle in microseconds, and ticks.
///
/// Empty bins between others are left out; the curve joins its neighbours.
fn binned(buckets: &Buckets) -> Vec<(f64, f64)> {
    let mut bins = std::collections::BTreeMap::new();
    for &(ns, count) in buckets {
        let us = ns.max(1) as f64 / 1e3;
        let bin = (us.log10() * BINS_A_DECADE).floor() as i64;
        *bins.entry(bin).or_insert(0_u64) += count;
    }
    bins.into_iter()
        .map(|(bin, count)| {
            let middle = (bin as f64 + 0.5) / BINS_A_DECADE;
            (10_f64.powf(middle), count as f64)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_tick_is_lost_in_the_bins() {
        let buckets: Buckets = (0..5000).map(|i| (i * i, i)).collect();
        let bins = binned(&buckets);
        let total: f64 = bins.iter().map(|bin| bin.1).sum();
        assert_eq!(total, (0..5000_u64).sum::<u64>() as f64);
        assert!(bins.is_sorted_by(|a, b| a.0 < b.0));
        let svg = picture(&[("a", &buckets), ("b", &Vec::new())]);
        assert!(svg.contains("ticks") && !svg.contains("NaN"));
    }
}
