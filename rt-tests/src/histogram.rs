//! The picture of latency histograms: both axes logarithmic.

use crate::plots::{BLUE, Curve, GREEN, ORANGE, Panel, Picture};
use hrtc::result::Buckets;

/// Bins a factor of ten.
const BINS_A_DECADE: f64 = 12.0;

/// Named histograms (nanoseconds) as curves of ticks over microseconds.
#[must_use]
pub fn picture(histograms: &[(&str, &Buckets)]) -> Picture {
    let colors = [BLUE, ORANGE, GREEN];
    let curves = histograms
        .iter()
        .zip(colors.iter().cycle())
        .map(|((name, buckets), &color)| Curve {
            label: (*name).to_string(),
            color,
            points: binned(buckets),
            dots: false,
        })
        .collect();
    Picture {
        x_label: "time, µs".to_string(),
        x_log: true,
        panels: vec![Panel {
            title: "How often each time was taken".to_string(),
            y_label: "ticks".to_string(),
            y_log: true,
            curves,
            ..Panel::default()
        }],
    }
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
        let svg = picture(&[("a", &buckets), ("b", &Vec::new())])
            .svg()
            .unwrap();
        assert!(svg.contains("ticks") && !svg.contains("NaN"));
    }
}
