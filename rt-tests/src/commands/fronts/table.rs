//! The table of the terminal, at most 160 columns wide.

use super::calibration::ASKED_OVER_TRUE;
use super::limits::{
    MAX_CHAIN, MAX_EXCEEDED, MAX_NS, MAX_TOO_FINE, broken, counts, has_splits, is_timed_singly,
};
use super::{Fronts, ModelFronts};
use crate::report::table::Table;
use std::fmt::Write;

/// Characters of a model's name.
const NAME: usize = 18;
/// Headings, with the least width of each column: a row is printed before the next is known.
const COLUMNS: [(&str, usize); 20] = [
    ("model", NAME),
    ("faces", 9),
    ("walk\nsplits", 6),
    ("\nundone", 6),
    ("\ndiffer", 6),
    ("chain", 5),
    ("closure\nmean", 6),
    ("\nmax", 6),
    ("certified/\nsampled", 6),
    ("\np95", 8),
    ("\nbeyond", 6),
    ("asked/\ntrue", 6),
    ("\nbest", 6),
    ("\nreach", 5),
    ("too\nfine", 5),
    ("over\nasked", 6),
    ("split\nns p50", 5),
    ("\np99", 6),
    ("undo\nns p50", 5),
    ("\np99", 6),
];

fn columns() -> Table {
    Table::new(1, &COLUMNS.map(|column| column.0).join(" | "))
        .at_least(&COLUMNS.map(|column| column.1))
        .compact()
}

/// The headings, and a row of the limits.
#[must_use]
pub fn head() -> String {
    let table = columns();
    let none = String::new;
    let limits = [
        "at most".to_string(),
        none(),
        none(),
        none(),
        0.to_string(),
        MAX_CHAIN.to_string(),
        none(),
        none(),
        none(),
        none(),
        0.to_string(),
        format!("{ASKED_OVER_TRUE:.1}"),
        none(),
        format!("{ASKED_OVER_TRUE:.1}"),
        format!("{:.0}%", 100.0 * MAX_TOO_FINE),
        format!("{:.2}%", 100.0 * MAX_EXCEEDED),
        MAX_NS.p50.to_string(),
        MAX_NS.p99.to_string(),
        MAX_NS.p50.to_string(),
        MAX_NS.p99.to_string(),
    ];
    table.head() + &table.line(limits)
}

/// A row for a model.
#[must_use]
pub fn row(m: &ModelFronts) -> String {
    let mut name = m.model.clone();
    if name.chars().count() > NAME {
        name = name.chars().take(NAME - 1).chain(['…']).collect();
    }
    let dial = |text: String| {
        if counts(&m.dial) {
            text
        } else {
            "-".to_string()
        }
    };
    let time = |ns: f64, times: usize| match times {
        0 => "-".to_string(),
        _ => format!("{ns:.0}"),
    };
    let (splits, collapses) = (m.single.timed_splits, m.single.timed_collapses);
    columns().line([
        name,
        m.faces.to_string(),
        m.walk.splits.to_string(),
        m.walk.collapses.to_string(),
        m.walk.mismatches.to_string(),
        m.chain.to_string(),
        format!("{:.0}", m.closure_mean),
        m.closure_max.to_string(),
        format!("{:.1}", m.certified_ratio.p50),
        format!("{:.1}", m.certified_ratio.p95),
        m.certified_violations.to_string(),
        dial(format!("{:.2}", m.dial.asked_over_true_p50)),
        dial(format!("{:.2}", m.dial.asked_over_attainable_p50)),
        dial(format!("{:.2}", m.dial.asked_over_true_within_reach_p50)),
        dial(format!("{:.1}%", 100.0 * m.dial.too_fine_share)),
        dial(format!("{:.3}%", 100.0 * m.dial.exceeded_share)),
        time(m.single.split_ns.p50, splits),
        time(m.single.split_ns.p99, splits),
        time(m.single.collapse_ns.p50, collapses),
        time(m.single.collapse_ns.p99, collapses),
    ])
}

/// Notes on the columns, and the limits that are broken.
#[must_use]
pub fn foot(models: &[ModelFronts]) -> String {
    let mut text = String::from(
        "chain: beyond a million faces the limit grows by 4 a doubling; \
         best: on the coarsest fronts that keep the tolerance; \
         -: nothing to judge\n\
         reach: where best is at most 3.5; \
         too fine: stretches where asked/true is beyond 3.5, and beyond best\n",
    );
    for m in models {
        let (single, batch) = (m.single, m.batch);
        let _ = writeln!(
            text,
            "{}: of {} splits and {} collapses timed singly; means of {} and {} batches (of {:.0} splits): split p50 {:.0}, \
             p99 {:.0}, undo p50 {:.0}, p99 {:.0} ns",
            m.model,
            single.timed_splits,
            single.timed_collapses,
            batch.timed_splits,
            batch.timed_collapses,
            m.batch_splits_mean,
            batch.split_ns.p50,
            batch.split_ns.p99,
            batch.collapse_ns.p50,
            batch.collapse_ns.p99,
        );
        if !has_splits(m) {
            let _ = writeln!(
                text,
                "{}: without a split: there is no front to compare with the full mesh",
                m.model
            );
        }
        if !is_timed_singly(m) {
            let _ = writeln!(
                text,
                "{}: one takes less than reading the clock ({} ns): only the batches are judged",
                m.model, m.clock_ns
            );
        }
    }
    for broken in models.iter().flat_map(broken) {
        let _ = writeln!(text, "beyond its limit: {broken}");
    }
    text
}

/// The whole table.
#[must_use]
pub fn table(found: &Fronts) -> String {
    let rows: String = found.models.iter().map(row).collect();
    head() + &rows + &foot(&found.models)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::fronts::calibration::{Calibration, Case};
    use crate::commands::fronts::{Costs, Percentiles, Ratio};

    #[test]
    fn lines_are_of_equal_length_and_not_too_long_and_name_the_limits() {
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
            dial: Calibration {
                asked_over_true_p50: 806.82,
                asked_over_attainable_p50: 234.56,
                too_fine_share: 0.99,
                cases: vec![Case {
                    counts: true,
                    ..Case::default()
                }],
                ..Calibration::default()
            },
            single: Costs {
                split_ns: ns,
                collapse_ns: ns,
                timed_splits: 1,
                timed_collapses: 1,
            },
            ..ModelFronts::default()
        };
        let shown = head() + &row(&model);
        let lengths: Vec<usize> = shown.lines().map(|line| line.chars().count()).collect();
        assert_eq!(lengths.len(), 4);
        assert!(
            lengths[1..].iter().all(|&l| l == lengths[1]),
            "{lengths:?}\n{shown}"
        );
        assert!(lengths[0] <= lengths[1] && lengths[1] <= 160, "{lengths:?}");
        let words: Vec<&str> = shown.lines().nth(2).unwrap().split_whitespace().collect();
        let limits = "0 40 0 3.5 3.5 25% 0.10% 1000 5000 1000 5000";
        assert_eq!(words[2..].join(" "), limits);
        assert!(shown.contains("a-part-with-a-ver…"));
        let bare = row(&ModelFronts::default());
        let nothing = bare.split_whitespace().filter(|word| *word == "-");
        assert_eq!(
            nothing.count(),
            9,
            "five of the dial and four times: {bare}"
        );
        let foot = foot(&[model]);
        assert!(
            foot.lines().all(|line| line.chars().count() <= 160),
            "{foot}"
        );
    }
}
