//! What `rt-tests policies` prints.

use super::verdict::RULE;
use super::{POLICIES, Policies, Row};
use crate::report::table::Table;
use crate::report::units::{length, percent, percent_of};
use scene::PolicyPlan;

/// The table and the verdict.
#[must_use]
pub fn words(found: &Policies) -> String {
    let heads = "scene | policy | F | full | certified\np50 | p99 | max | measured\nmean | p50 | p99 | max | time\nspent | turns\na second | step,\nN";
    let mut table = Table::new(2, heads).compact();
    for row in &found.rows {
        table.row(cells(row));
    }
    let mut text = format!(
        "F: how many times as long every unit of work takes; full: ticks in contact at full resolution;\n\
         certified, measured: error at the contact; time spent: of what a tick might take;\n\
         turns: changes of direction of the tolerance; step: largest change of a force in a period\n\n{table}\n"
    );
    for sentence in &found.left_out {
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

fn cells(row: &Row) -> [String; 14] {
    let trial = &row.trial;
    let (certified, measured) = (&trial.certified_error_m, &trial.measured_error_m);
    [
        row.scene.clone(),
        name(row.policy).to_string(),
        format!("{}", row.slow),
        percent(trial.contact_full_ticks, trial.contact_ticks),
        length(certified.p50),
        length(certified.p99),
        length(certified.max),
        length(measured.mean),
        length(measured.p50),
        length(measured.p99),
        length(measured.max),
        percent_of(trial.spent_share),
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
