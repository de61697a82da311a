//! What `rt-tests policies` prints.

use super::verdict::RULE;
use super::{POLICIES, Policies, Row};
use crate::report::table::Table;
use crate::report::units::{length, percent, percent_of};
use scene::PolicyPlan;

/// The table and the verdict.
#[must_use]
pub fn words(found: &Policies) -> String {
    let heads = "scene | F | policy | full | certified\n\
                 p50 | p99 | max | measured\n\
                 mean | p50 | p99 | max | time\n\
                 spent | over\n\
                 budget | turns\n\
                 a second | step,\n\
                 N";
    let mut table = Table::new(3, heads);
    for row in &found.rows {
        table.row(cells(row));
    }
    let mut text = format!(
        "F: how many times as long every unit of work takes\n\
         full: ticks in contact at full resolution\n\
         certified, measured: error at the contact, 0 where it is rounding, none where there is none\n\
         time spent: of what a tick might take; over budget: ticks that spent more\n\
         turns: changes of direction of the tolerance\n\
         step: largest change of a force in a period\n\n{table}\n"
    );
    let sentences = found.left_out.iter().chain(&found.faults);
    let sentences = sentences.chain(&found.failed);
    for sentence in sentences.chain(&unbounded(found)) {
        text += sentence;
        text.push('\n');
    }
    let [first, second] = found.verdict.pairs;
    let [a, b] = POLICIES.map(name);
    text += &format!(
        "Rule: {RULE}.\n{a} {first}, {b} {second}, none {}: ",
        found.verdict.even
    );
    text += &match found.verdict.better {
        Some(better) if better == found.default => {
            format!("{}, the default, is the better one\n", name(better))
        }
        Some(better) => format!("{} is better than the default\n", name(better)),
        None => "neither is better\n".to_string(),
    };
    text
}

/// Rows that cannot be compared, and why.
#[must_use]
pub fn faults(rows: &[Row]) -> Vec<String> {
    let of_row = |row: &Row| {
        let place = format!("{}, F = {}, {}", row.scene, row.slow, name(row.policy));
        let faults = row.trial.faults().into_iter();
        faults
            .map(|why| format!("{place}: {why}"))
            .collect::<Vec<_>>()
    };
    rows.iter().flat_map(of_row).collect()
}

/// Where a contact had no certified error.
fn unbounded(found: &Policies) -> Vec<String> {
    let rows = found.rows.iter();
    let unbounded = rows.filter(|row| row.trial.contact_unbounded_ticks > 0);
    let sentence = |row: &Row| {
        format!(
            "{}, F = {}, {}: {} of {} contact ticks have no certified error and are left out of it",
            row.scene,
            row.slow,
            name(row.policy),
            row.trial.contact_unbounded_ticks,
            row.trial.contact_ticks
        )
    };
    unbounded.map(sentence).collect()
}

fn cells(row: &Row) -> [String; 15] {
    let trial = &row.trial;
    let (certified, measured) = (&trial.certified_error_m, &trial.measured_error_m);
    // A number of nothing is none, and not 0.
    let unbounded = trial.contact_unbounded_ticks;
    let bound = |metres: f64| match trial.contact_ticks.saturating_sub(unbounded) {
        0 => "none".to_string(),
        _ => length(metres),
    };
    let error = |metres: f64| match trial.measured_errors {
        0 => "none".to_string(),
        _ if metres <= trial.rounding_m => length(0.0),
        _ => length(metres),
    };
    [
        row.scene.clone(),
        format!("{}", row.slow),
        name(row.policy).to_string(),
        percent(trial.contact_full_ticks, trial.contact_ticks),
        bound(certified.p50),
        bound(certified.p99),
        bound(certified.max),
        error(measured.mean),
        error(measured.p50),
        error(measured.p99),
        error(measured.max),
        percent_of(trial.spent_share),
        trial.over_budget_ticks.to_string(),
        format!("{:.2}", trial.turns_per_s),
        format!("{:.3}", trial.force_step_n_max),
    ]
}

fn name(policy: PolicyPlan) -> &'static str {
    match policy {
        PolicyPlan::Predictive => "predictive",
        PolicyPlan::Reactive => "reactive",
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::Trial;
    use super::*;

    #[test]
    fn an_error_that_nobody_measured_or_certified_is_none_and_not_0() {
        let cells = |trial: Trial| {
            cells(&Row {
                scene: "a".to_string(),
                slow: 1.0,
                policy: PolicyPlan::Predictive,
                trial,
            })
        };
        let rounding = Trial {
            contact_ticks: 2,
            contact_unbounded_ticks: 1,
            measured_errors: 1,
            rounding_m: 1e-9,
            ..Trial::default()
        };
        assert!(cells(rounding.clone())[4..11].iter().all(|of| of != "none"));
        let nothing = Trial {
            contact_unbounded_ticks: 2,
            measured_errors: 0,
            ..rounding
        };
        assert_eq!(cells(nothing)[4..11], ["none"; 7]);
    }
}
