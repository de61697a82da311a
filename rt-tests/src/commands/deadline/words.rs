//! What `rt-tests deadline` prints.

use super::{Deadline, Row};
use crate::report::table::Table;
use crate::report::units::length;

/// The table and the verdict.
#[must_use]
pub fn words(found: &Deadline) -> String {
    let heads = "scene | F | own\nmisses | over\nbudget | full | certified\np99 | measured\np99 | work p50,\nus | p99 | p99.9 | max | reference\np99.9 | its\nmisses | step, N";
    let mut table = Table::new(1, heads);
    for row in &found.rows {
        table.row([
            row.scene.clone(),
            format!("{}", row.slow),
            row.missed_own.to_string(),
            row.over_budget_ticks.to_string(),
            full(row),
            length(row.certified_error_m[1]),
            length(row.measured_error_m[1]),
            format!("{:.0}", row.work_us.p50),
            format!("{:.0}", row.work_us.p99),
            format!("{:.0}", row.work_us.p999),
            format!("{:.0}", row.work_us.max),
            format!(
                "{:.0} ({:.1}x)",
                row.reference_work_us.p999,
                row.tail_ratio()
            ),
            row.reference_missed_own.to_string(),
            format!("{:.3}", row.force_step_n_max),
        ]);
    }
    let mut text = format!(
        "F: how many times as long every stage of a tick takes; full: ticks in contact at full resolution\n\
         reference: a loop of fixed arithmetic with the same median, slowed down alike; in brackets our p99.9 over its\n\n{table}\n"
    );
    for sentence in found.left_out.iter().chain(&odd_rows(found)) {
        text += sentence;
        text.push('\n');
    }
    text + if found.pass { "pass\n" } else { "FAIL\n" }
}

fn full(row: &Row) -> String {
    let share = row.contact_full_ticks as f64 / row.contact_ticks.max(1) as f64;
    format!("{:.1} %", 100.0 * share)
}

/// Where a slower machine has the smaller error: tours that end elsewhere, or chance.
fn odd_rows(found: &Deadline) -> Vec<String> {
    let pairs = found.rows.windows(2);
    let odd = pairs.filter(|pair| {
        let [before, after] = pair else { return false };
        before.scene == after.scene
            && after.slow > before.slow
            && after.certified_error_m[1] < before.certified_error_m[1]
    });
    odd.map(|pair| {
        format!(
            "{}: at F = {} the certified error is smaller than at F = {}: the hand was led elsewhere, or the tolerance was coarser before the contact",
            pair[0].scene, pair[1].slow, pair[0].slow
        )
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missed_period_a_broken_budget_and_no_touch_fail() {
        let kept = Row {
            contact_ticks: 1,
            ..Row::default()
        };
        assert!(kept.passes());
        assert!(!Row::default().passes(), "nothing was touched");
        assert!(
            !Row {
                missed_own: 1,
                ..kept.clone()
            }
            .passes()
        );
        assert!(
            !Row {
                over_budget_ticks: 1,
                ..kept.clone()
            }
            .passes()
        );
        let nan = vec!["work".to_owned()];
        assert!(
            !Row {
                non_finite: nan,
                ..kept
            }
            .passes()
        );
    }

    #[test]
    fn an_error_that_falls_as_the_machine_gets_slower_is_said() {
        let row = |slow: f64, error: f64| Row {
            scene: "a".to_owned(),
            slow,
            certified_error_m: [0.0, error, error],
            ..Row::default()
        };
        let mut found = Deadline {
            rows: vec![row(1.0, 0.0), row(2.0, 1e-3), row(4.0, 5e-4)],
            left_out: Vec::new(),
            pass: false,
        };
        assert_eq!(words(&found).matches("is smaller than").count(), 1);
        found.rows[2].certified_error_m[1] = 2e-3;
        assert_eq!(words(&found).matches("is smaller than").count(), 0);
    }
}
