//! What `rt-tests deadline` prints.

use super::{Deadline, MAX_P999_RATIO, Row};
use crate::report::quantile::median;
use crate::report::table::Table;
use crate::report::units::{length, percent};
use hrtc_core::record::max_or_nan;
use std::collections::BTreeSet;

/// The table and the verdict.
#[must_use]
pub fn words(found: &Deadline) -> String {
    let heads = "scene | F | own\nmisses | over\nbudget | full | certified\np99 | measured\np99 | work p50,\nus | p99 | p99.9 | max | p99.9 over\nreference | its own\nmisses | step, N";
    let mut table = Table::new(1, heads);
    let summaries: Vec<Summary<'_>> = found
        .rows
        .chunk_by(|a, b| a.scene == b.scene && a.slow == b.slow)
        .map(Summary::new)
        .collect();
    for summary in &summaries {
        table.row(summary.cells());
    }
    let mut text = format!(
        "F: how many times as long every stage of a tick takes; full: ticks in contact at full resolution\n\
         reference: a loop of fixed arithmetic with the same median, slowed down alike, after each run\n\
         p99.9 over reference: median of the seeds; all else: sums and the largest of the seeds\n\n{table}\n"
    );
    let odd = odd(&summaries);
    let denied = missing_rights(&found.rows);
    let sentences = found.left_out.iter().chain(&denied).chain(&odd);
    for sentence in sentences.chain(&found.failed) {
        text += sentence;
        text.push('\n');
    }
    text + &verdict(found)
}

/// What the controller was denied: its ticks may be longer for want of it.
fn missing_rights(rows: &[Row]) -> Option<String> {
    let all: BTreeSet<&str> = rows
        .iter()
        .flat_map(|row| &row.missing_rights)
        .map(String::as_str)
        .collect();
    let all: Vec<&str> = all.into_iter().collect();
    (!all.is_empty()).then(|| {
        format!(
            "ran without all real-time rights, so ticks may be longer than with them: {}",
            all.join("; ")
        )
    })
}

/// All seeds of a scene at one F, which are never none.
struct Summary<'a> {
    rows: &'a [Row],
    /// None where no contact has one.
    certified_p99_m: Option<f64>,
}

impl<'a> Summary<'a> {
    fn new(rows: &'a [Row]) -> Self {
        let bounded = |row: &&Row| row.contact_ticks > row.contact_unbounded_ticks;
        let certified = rows
            .iter()
            .filter(bounded)
            .map(|row| row.certified_error_m.p99);
        Self {
            rows,
            certified_p99_m: certified.reduce(max_or_nan),
        }
    }

    fn cells(&self) -> [String; 14] {
        let rows = self.rows;
        let sum = |of: fn(&Row) -> u64| rows.iter().map(of).sum::<u64>();
        let us = |of: fn(&Row) -> f64| format!("{:.0}", most(rows, of));
        let contact = sum(|row| row.contact_ticks);
        let ratios: Vec<f64> = rows.iter().map(|row| row.reference_p999_ratio).collect();
        [
            rows[0].scene.clone(),
            format!("{}", rows[0].slow),
            sum(|row| row.missed_own_cpu).to_string(),
            sum(|row| row.units_over_budget_ticks).to_string(),
            percent(sum(|row| row.contact_full_ticks), contact),
            // A bound of nothing is none, and not 0.
            self.certified_p99_m
                .map_or_else(|| "none".to_string(), length),
            match sum(|row| row.measured_errors) {
                0 => "none".to_string(),
                _ => length(most(rows, |row| row.measured_error_m.p99)),
            },
            us(|row| row.work_us.p50),
            us(|row| row.work_us.p99),
            us(|row| row.work_us.p999),
            us(|row| row.work_us.max),
            format!("{:.1}", median(&ratios)),
            sum(|row| row.reference_missed_own_cpu).to_string(),
            format!("{:.3}", most(rows, |row| row.force_step_n_max)),
        ]
    }
}

/// The largest; NaN when one is.
fn most(rows: &[Row], of: fn(&Row) -> f64) -> f64 {
    rows.iter().map(of).fold(f64::NEG_INFINITY, max_or_nan)
}

/// Where a slower machine has the smaller error: tours that end elsewhere, or chance.
fn odd(summaries: &[Summary<'_>]) -> Vec<String> {
    let pairs = summaries.windows(2);
    let odd = pairs.filter_map(|pair| {
        let [before, after] = pair else { return None };
        let [faster, slower] = [&before.rows[0], &after.rows[0]];
        (faster.scene == slower.scene
            && slower.slow > faster.slow
            && after
                .certified_p99_m
                .zip(before.certified_p99_m)
                .is_some_and(|(after, before)| after < before))
        .then_some([faster, slower])
    });
    odd.map(|[faster, slower]| {
        format!(
            "{}: at F = {} the certified error is smaller than at F = {}: the hand was led elsewhere, or the tolerance was coarser before the contact",
            faster.scene, slower.slow, faster.slow
        )
    })
    .collect()
}

/// How many runs break each of what is asked, and what that is.
fn counted(rows: &[Row]) -> [(usize, String); 8] {
    let runs = |of: fn(&Row) -> bool| rows.iter().filter(|row| of(row)).count();
    let of_references = runs(|row| row.reference_missed_own_cpu > 0);
    let unbounded: u64 = rows.iter().map(|row| row.contact_unbounded_ticks).sum();
    [
        (
            runs(|row| row.missed_own_cpu > 0),
            format!("with own misses ({of_references} of their references)"),
        ),
        (
            runs(|row| row.unaccounted_periods != 0),
            "with lost records".to_string(),
        ),
        (
            runs(|row| row.units_over_budget_ticks > 0),
            "over a budget".to_string(),
        ),
        (
            runs(|row| !row.is_steady()),
            format!("with a p99.9 over {MAX_P999_RATIO} times the reference's"),
        ),
        (
            runs(|row| row.contact_ticks == 0),
            "without a touch".to_string(),
        ),
        (
            runs(|row| row.contact_unbounded_ticks > 0),
            format!("with contacts without a certified error ({unbounded} ticks)"),
        ),
        (
            runs(|row| row.measured_errors == 0),
            "without a measured error".to_string(),
        ),
        (
            runs(|row| !row.non_finite.is_empty()),
            "with a figure that is not finite".to_string(),
        ),
    ]
}

/// What some runs did not keep, with how many of them; nothing where all pass.
#[must_use]
pub fn reasons(rows: &[Row]) -> Vec<String> {
    let broken = counted(rows).into_iter().filter(|(runs, _)| *runs > 0);
    broken
        .map(|(runs, what)| format!("{runs} {what}"))
        .collect()
}

/// How many runs break each of what is asked, in one line, and the verdict.
fn verdict(found: &Deadline) -> String {
    let counted = counted(&found.rows).map(|(runs, what)| format!("{runs} {what}"));
    let verdict = if found.pass { "pass" } else { "FAIL" };
    let runs = found.rows.len();
    format!("of {runs} runs: {}\n{verdict}\n", counted.join(", "))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use hrtc::result::ShortSpread;

    /// A row that keeps all that is asked of it.
    pub fn kept() -> Row {
        Row {
            contact_ticks: 1,
            measured_errors: 1,
            reference_p999_ratio: 1.0,
            ..Row::default()
        }
    }

    #[test]
    fn a_run_passes_when_all_that_is_asked_was_kept() {
        assert!(kept().passes() && reasons(&[kept()]).is_empty());
        let faults: [fn(&mut Row); 9] = [
            |row| row.contact_ticks = 0,
            |row| row.measured_errors = 0,
            |row| row.contact_unbounded_ticks = 1,
            |row| row.missed_own_cpu = 1,
            |row| row.unaccounted_periods = 1,
            |row| row.units_over_budget_ticks = 1,
            |row| row.reference_p999_ratio = 1.6,
            |row| row.reference_p999_ratio = f64::NAN,
            |row| row.non_finite = vec!["work".to_owned()],
        ];
        for (index, fault) in faults.into_iter().enumerate() {
            let mut row = kept();
            fault(&mut row);
            assert!(!row.passes(), "fault {index}");
            assert_eq!(reasons(&[row]).len(), 1, "fault {index}");
        }
    }

    #[test]
    fn contacts_without_a_certified_error_are_counted_in_the_verdict() {
        let unbounded = |ticks: u64| Row {
            contact_ticks: 100,
            contact_unbounded_ticks: ticks,
            ..kept()
        };
        let found = Deadline {
            rows: vec![kept(), unbounded(3), unbounded(4)],
            left_out: Vec::new(),
            failed: Vec::new(),
            pass: false,
        };
        let text = words(&found);
        let said = "2 with contacts without a certified error (7 ticks)";
        assert!(text.contains(said), "{text}");
    }

    #[test]
    fn an_error_that_nobody_measured_is_none_and_not_0() {
        let unmeasured = Row {
            measured_errors: 0,
            ..kept()
        };
        let text = |rows: Vec<Row>| {
            words(&Deadline {
                rows,
                left_out: Vec::new(),
                failed: Vec::new(),
                pass: false,
            })
        };
        let none = text(vec![unmeasured.clone()]);
        assert!(none.contains(" none "), "{none}");
        assert!(none.contains("1 without a measured error"), "{none}");
        // One of the seeds is enough for a number.
        let some = text(vec![unmeasured, kept()]);
        assert!(!some.contains(" none "), "{some}");
        // Nor has a run without a touch any part at full resolution, or a certified error.
        let untouched = Row {
            contact_ticks: 0,
            ..kept()
        };
        let none = text(vec![untouched]);
        assert_eq!(none.matches(" none ").count(), 2, "{none}");
        // Of two seeds the ratio is their mean.
        let ratio = |reference_p999_ratio| Row {
            reference_p999_ratio,
            ..kept()
        };
        let both = text(vec![ratio(1.0), ratio(1.4)]);
        assert!(both.contains(" 1.2 "), "{both}");
    }

    #[test]
    fn an_error_that_falls_as_the_machine_gets_slower_is_said() {
        let row = |slow: f64, p99: f64| Row {
            scene: "a".to_owned(),
            slow,
            certified_error_m: ShortSpread {
                p99,
                ..ShortSpread::default()
            },
            ..kept()
        };
        let mut found = Deadline {
            rows: vec![
                row(1.0, 0.0),
                row(2.0, 1e-3),
                row(2.0, 1e-4),
                row(4.0, 5e-4),
            ],
            left_out: Vec::new(),
            failed: Vec::new(),
            pass: false,
        };
        assert_eq!(words(&found).matches("is smaller than").count(), 1);
        found.rows[3].certified_error_m.p99 = 2e-3;
        assert_eq!(words(&found).matches("is smaller than").count(), 0);
        // An error of nothing is none, and not 0.
        found.rows[3].contact_unbounded_ticks = found.rows[3].contact_ticks;
        found.rows[3].certified_error_m.p99 = 0.0;
        assert_eq!(words(&found).matches("is smaller than").count(), 0);
    }

    #[test]
    fn a_right_that_was_denied_is_said_once() {
        let denied = Row {
            missing_rights: vec!["memory is not locked".to_owned()],
            ..kept()
        };
        let text = |rows: Vec<Row>| {
            words(&Deadline {
                rows,
                left_out: Vec::new(),
                failed: Vec::new(),
                pass: true,
            })
        };
        let said = text(vec![kept(), denied.clone(), denied]);
        assert_eq!(said.matches("memory is not locked").count(), 1, "{said}");
        assert!(!text(vec![kept()]).contains("rights"));
    }

    #[test]
    fn seeds_are_one_line_of_the_table() {
        let mut slow = kept();
        (slow.seed, slow.missed_own_cpu, slow.work_us.p999) = (2, 3, 250.0);
        let found = Deadline {
            rows: vec![kept(), slow],
            left_out: Vec::new(),
            failed: Vec::new(),
            pass: false,
        };
        let text = words(&found);
        assert!(text.contains("of 2 runs: 1 with own misses"), "{text}");
        assert_eq!(text.matches(" 250 ").count(), 1, "{text}");
    }
}
