//! The table that a person sees, at most 160 columns wide.

use super::dial::ASKED_OVER_TRUE;
use super::limits::{MAX_CHAIN, MAX_EXCEEDED, MAX_NS, MAX_TOO_FINE, broken};
use super::{Fronts, ModelFronts};
use std::fmt::Write;

/// Columns of a model's name.
const NAME: usize = 20;

/// The lines above: what the columns are, and what is allowed.
#[must_use]
pub fn head() -> String {
    let mut text = String::from(
        "                                 random walk  chain      closure certified/sampled                asked/true p50     too    over     split ns  collapse ns\n\
         model                    faces splits undone differ  most   mean    max    p50      p95 beyond    dial    best  reach    fine   asked   p50    p99   p50    p99\n",
    );
    let _ = writeln!(
        text,
        "{:<NAME$} {:>9} {:>6} {:>6} {:>6} {:>5} {:>6} {:>6} {:>6} {:>8} {:>6} {:>7.1} {:>7} {:>6.1} {:>6.1}% {:>6.2}% {:>5} {:>6} {:>5} {:>6}",
        "at most",
        "",
        "",
        "",
        0,
        MAX_CHAIN,
        "",
        "",
        "",
        "",
        0,
        ASKED_OVER_TRUE,
        "",
        ASKED_OVER_TRUE,
        100.0 * MAX_TOO_FINE,
        100.0 * MAX_EXCEEDED,
        MAX_NS.p50,
        MAX_NS.p99,
        MAX_NS.p50,
        MAX_NS.p99,
    );
    text
}

/// One model.
#[must_use]
pub fn row(m: &ModelFronts) -> String {
    let mut name = m.model.clone();
    if name.chars().count() > NAME {
        name = name.chars().take(NAME - 1).chain(['…']).collect();
    }
    format!(
        "{:<NAME$} {:>9} {:>6} {:>6} {:>6} {:>5} {:>6.0} {:>6} {:>6.1} {:>8.1} {:>6} {:>7.2} {:>7.2} {:>6.2} {:>6.1}% {:>6.3}% {:>5.0} {:>6.0} {:>5.0} {:>6.0}\n",
        name,
        m.faces,
        m.walk.splits,
        m.walk.collapses,
        m.walk.mismatches,
        m.chain,
        m.closure_mean,
        m.closure_max,
        m.certified_ratio.p50,
        m.certified_ratio.p95,
        m.certified_violations,
        m.dial.asked_over_true_p50,
        m.dial.asked_over_attainable_p50,
        m.dial.asked_over_true_within_reach_p50,
        m.dial.too_fine_share * 100.0,
        m.dial.exceeded_share * 100.0,
        m.split_ns.p50,
        m.split_ns.p99,
        m.collapse_ns.p50,
        m.collapse_ns.p99,
    )
}

/// The lines below: what the columns mean that do not say it, and what is beyond its limit.
#[must_use]
pub fn foot(models: &[ModelFronts]) -> String {
    let mut text = String::from(
        "most: the longest chain, beyond a million faces 4 a doubling; \
         best: on the coarsest fronts that keep what is asked;\n\
         reach: where best is at most 3.5; \
         too fine: stretches where asked/true is beyond 3.5, and beyond best\n",
    );
    for broken in models.iter().flat_map(broken) {
        let _ = writeln!(text, "beyond its limit: {broken}");
    }
    text
}

/// All of it.
#[must_use]
pub fn table(found: &Fronts) -> String {
    let rows: String = found.models.iter().map(row).collect();
    head() + &rows + &foot(&found.models)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fronts::dial::Dial;
    use crate::fronts::{Percentiles, Ratio};

    #[test]
    fn lines_are_of_equal_length_and_not_too_long_and_say_the_limits() {
        let ns = Percentiles {
            p50: 4567.0,
            p99: 123_456.0,
        };
        let model = ModelFronts {
            model: "a-part-with-a-very-long-name.stl".to_string(),
            faces: 100_000_000,
            chain: 123,
            closure_max: 123_456,
            certified_ratio: Ratio {
                p50: 1055.3,
                p95: 103_153.4,
            },
            dial: Dial {
                asked_over_true_p50: 5806.82,
                asked_over_attainable_p50: 1234.56,
                too_fine_share: 1.0,
                ..Dial::default()
            },
            split_ns: ns,
            collapse_ns: ns,
            ..ModelFronts::default()
        };
        let shown = head() + &row(&model);
        let lengths: Vec<usize> = shown.lines().map(|line| line.chars().count()).collect();
        assert_eq!(lengths.len(), 4);
        assert!(lengths[1..].iter().all(|&l| l == lengths[1]), "{lengths:?}");
        assert!(lengths[0] <= lengths[1] && lengths[1] <= 160, "{lengths:?}");
        let words: Vec<&str> = shown.lines().nth(2).unwrap().split_whitespace().collect();
        let limits = "0 40 0 3.5 3.5 25.0% 0.10% 1000 5000 1000 5000";
        assert_eq!(words[2..].join(" "), limits);
        assert!(shown.contains("a-part-with-a-very-…"));
        assert!(
            foot(&[model])
                .lines()
                .all(|line| line.chars().count() <= 160)
        );
    }
}
