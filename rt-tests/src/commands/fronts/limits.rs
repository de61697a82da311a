//! What is judged.

use super::calibration::{ASKED_OVER_TRUE, Calibration};
use super::{Costs, ModelFronts, Percentiles};
use crate::models::Model;

/// The longest chain of dependencies that a model may have, up to a million faces.
pub const MAX_CHAIN: u32 = 40;
/// Beyond a million faces: so many times the doublings from base mesh to full mesh.
const CHAIN_A_DOUBLING: f64 = 4.0;
/// Limits of the cost, ns an operation: median and 99 of 100, of single operations and of batches.
pub const MAX_NS: Percentiles = Percentiles {
    p50: 1000.0,
    p99: 5000.0,
};
/// The most stretches of all that may be too fine for no reason.
///
/// The median of asked over true being at most [`ASKED_OVER_TRUE`] means that at most half of the
/// stretches are beyond it. Those where the mesh gives no choice are taken out
/// ([`Calibration::too_fine_share`]); of all stretches, not of the others, only half as many may
/// then be beyond.
pub const MAX_TOO_FINE: f64 = 0.25;
/// The most contacts that may exceed what was asked.
pub const MAX_EXCEEDED: f64 = 1e-3;
/// Fewer times say nothing about the slowest in a hundred.
const FEWEST_TIMES: usize = 100;

/// The longest chain that the issue of the model's size allows.
#[must_use]
pub fn chain(model: &Model) -> u32 {
    let header = model.file.model_header();
    let vertices = f64::from(header.base_vertices) + f64::from(header.vsps);
    let doublings = (vertices / f64::from(header.base_vertices)).log2();
    if header.faces > 1_000_000 {
        MAX_CHAIN.max((CHAIN_A_DOUBLING * doublings) as u32)
    } else {
        MAX_CHAIN
    }
}

/// What is beyond its limit, in words.
#[must_use]
pub fn broken(m: &ModelFronts) -> Vec<String> {
    let mut broken = Vec::new();
    let (comparisons, samples) = (m.walk.comparisons, m.certified_samples);
    if has_splits(m) && (comparisons == 0 || samples == 0) {
        broken.push(format!(
            "{}: nothing was compared: {comparisons} comparisons on a walk, {samples} distances",
            m.model
        ));
    }
    let mut limit = |name: &str, value: f64, most: f64| {
        // What is no number is beyond every limit.
        let is_within = value <= most;
        if !is_within {
            broken.push(format!(
                "{}: {name} is {value:.6}, at most {most} is allowed",
                m.model
            ));
        }
    };
    limit("mismatches", m.walk.mismatches as f64, 0.0);
    limit(
        "splits that need a collapse",
        m.walk.needed_a_collapse.into(),
        0.0,
    );
    limit(
        "fronts that are not the image of the full mesh",
        m.walk.wrong_images.into(),
        0.0,
    );
    limit("chain", m.chain.into(), m.chain_limit.into());
    limit("certified_violations", m.certified_violations as f64, 0.0);
    if counts(&m.dial) {
        limit(
            "dial.asked_over_true_within_reach_p50",
            m.dial.asked_over_true_within_reach_p50,
            ASKED_OVER_TRUE,
        );
        limit("dial.too_fine_share", m.dial.too_fine_share, MAX_TOO_FINE);
        limit("dial.exceeded_share", m.dial.exceeded_share, MAX_EXCEEDED);
        // The mesh may be the reason, and is named then; the limit stands all the same.
        let reason = format!(
            "dial.asked_over_true_p50 (best {:.2}, in reach {:.2}, fine {:.1} %)",
            m.dial.asked_over_attainable_p50,
            m.dial.asked_over_true_within_reach_p50,
            m.dial.too_fine_share * 100.0,
        );
        limit(&reason, m.dial.asked_over_true_p50, ASKED_OVER_TRUE);
    }
    let single = is_timed_singly(m).then_some(("", m.single));
    for (of, costs) in single.into_iter().chain([("batch.", m.batch)]) {
        for (name, ns, times) in [
            ("split_ns", costs.split_ns, costs.timed_splits),
            ("collapse_ns", costs.collapse_ns, costs.timed_collapses),
        ] {
            limit(&format!("{of}{name}.p50"), ns.p50, MAX_NS.p50);
            if times >= FEWEST_TIMES {
                limit(&format!("{of}{name}.p99"), ns.p99, MAX_NS.p99);
            }
        }
    }
    broken
}

/// Whether single operations, of the kinds that were timed, are long enough for the clock.
#[must_use]
pub fn is_timed_singly(m: &ModelFronts) -> bool {
    let Costs {
        split_ns,
        collapse_ns,
        timed_splits,
        timed_collapses,
    } = m.single;
    // What is no number is judged, too.
    let is_long = |ns: f64| ns.is_nan() || ns >= m.clock_ns as f64;
    let kinds = [(split_ns, timed_splits), (collapse_ns, timed_collapses)];
    let mut timed = kinds.iter().filter(|(_, times)| *times > 0);
    timed.all(|(ns, _)| is_long(ns.p50))
}

/// Whether the model has a split: one without has no front but its full mesh, and nothing of it is
/// judged but that.
#[must_use]
pub fn has_splits(m: &ModelFronts) -> bool {
    m.chain > 0
}

/// Whether any tolerance counts.
#[must_use]
pub fn counts(calibration: &Calibration) -> bool {
    calibration.cases.iter().any(|case| case.counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::fronts::calibration::Case;

    fn slow(timed_splits: usize, timed_collapses: usize) -> ModelFronts {
        let ns = Percentiles {
            p50: 2000.0,
            p99: 9000.0,
        };
        ModelFronts {
            model: "slow".to_string(),
            single: Costs {
                split_ns: ns,
                collapse_ns: ns,
                timed_splits,
                timed_collapses,
            },
            clock_ns: 200,
            ..ModelFronts::default()
        }
    }

    fn names(m: &ModelFronts) -> Vec<String> {
        let word = |text: String| {
            let rest = text.split_once(": ")?.1;
            rest.split_whitespace().next().map(str::to_string)
        };
        broken(m).into_iter().filter_map(word).collect()
    }

    #[test]
    fn the_median_cost_is_judged_over_however_few_times_and_the_slowest_over_a_hundred() {
        let medians = ["split_ns.p50", "collapse_ns.p50"];
        assert_eq!(names(&slow(1, 1)), medians);
        assert_eq!(names(&slow(99, 99)), medians);
        // Each by its own times.
        let of_splits = ["split_ns.p50", "split_ns.p99", "collapse_ns.p50"];
        assert_eq!(names(&slow(100, 99)), of_splits);
        assert_eq!(names(&slow(100, 100)).len(), 4);
        // Shorter than the clock takes: the batches are judged alone, and they are in any case.
        let batched = ModelFronts {
            batch: slow(1, 1).single,
            ..slow(1, 1)
        };
        assert_eq!(names(&batched).len(), 4);
        let short = ModelFronts {
            clock_ns: 3000,
            ..batched
        };
        assert_eq!(names(&short), medians.map(|name| format!("batch.{name}")));
        assert_eq!(names(&ModelFronts::default()), [""; 0]);
    }

    #[test]
    fn a_kind_that_was_not_timed_does_not_hide_the_other() {
        assert!(is_timed_singly(&slow(0, 100)) && is_timed_singly(&slow(100, 0)));
        let mut m = slow(100, 0);
        m.single.collapse_ns = Percentiles::default();
        assert!(is_timed_singly(&m));
        assert_eq!(names(&m), ["split_ns.p50", "split_ns.p99"]);
        m.clock_ns = 3000;
        assert!(!is_timed_singly(&m));
    }

    #[test]
    fn a_model_with_splits_of_which_nothing_was_compared_does_not_pass() {
        let mut m = ModelFronts {
            chain: 1,
            chain_limit: 1,
            ..ModelFronts::default()
        };
        assert_eq!(names(&m), ["nothing"]);
        m.walk.comparisons = 1;
        assert_eq!(names(&m), ["nothing"]);
        m.certified_samples = 1;
        assert_eq!(names(&m), [""; 0]);
        // Without a split there is nothing to compare.
        assert_eq!(names(&ModelFronts::default()), [""; 0]);
    }

    #[test]
    fn a_dial_that_is_too_fine_is_named_whether_the_mesh_leaves_a_choice_or_not() {
        let with = |share: f64, counts: bool| {
            let case = Case {
                counts,
                ..Case::default()
            };
            ModelFronts {
                dial: Calibration {
                    asked_over_true_p50: 93.0,
                    too_fine_share: share,
                    cases: vec![case],
                    ..Calibration::default()
                },
                ..ModelFronts::default()
            }
        };
        let raw = "dial.asked_over_true_p50";
        assert_eq!(names(&with(0.26, true)), ["dial.too_fine_share", raw]);
        assert_eq!(names(&with(0.25, true)), [raw]);
        assert_eq!(names(&with(1.0, false)), [""; 0]);
        let mut beyond = with(0.0, true);
        beyond.dial.asked_over_true_p50 = 3.4;
        assert_eq!(names(&beyond), [""; 0]);
        beyond.dial.asked_over_true_within_reach_p50 = 3.6;
        let median = ["dial.asked_over_true_within_reach_p50"];
        assert_eq!(names(&beyond), median);
    }

    #[test]
    fn what_is_no_number_is_beyond_its_limit() {
        let mut m = ModelFronts::default();
        m.batch.split_ns.p50 = f64::NAN;
        assert_eq!(names(&m), ["batch.split_ns.p50"]);
    }
}
