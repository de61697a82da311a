//! Which policy is the better one.

use super::{POLICIES, Row};
use scene::PolicyPlan;
use serde::Serialize;

/// By how much a mean error must be smaller to be so beyond what another tour would give: the
/// smaller is at most this share of the larger.
const CLEARLY: f64 = 0.9;

/// The rule, for whoever reads the table.
pub const RULE: &str = "a pair of rows goes to the policy whose mean measured error is smaller by \
                        a tenth or more, to none where neither is, both are rounding, or one \
                        cannot be compared; the better policy has more pairs";

/// Which policy is the better one; see [`RULE`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Verdict {
    /// Pairs of rows that went to each policy.
    pub pairs: [u64; POLICIES.len()],
    /// Pairs that went to none.
    pub even: u64,
    /// The better policy, if one has more pairs.
    pub better: Option<PolicyPlan>,
}

/// Judges rows that come in pairs.
#[must_use]
pub fn verdict(rows: &[Row]) -> Verdict {
    let mut found = Verdict {
        pairs: [0; POLICIES.len()],
        even: 0,
        better: None,
    };
    for pair in rows.chunks_exact(POLICIES.len()) {
        match winner(pair) {
            Some(k) => found.pairs[k] += 1,
            None => found.even += 1,
        }
    }
    let [first, second] = found.pairs;
    found.better = match first.cmp(&second) {
        std::cmp::Ordering::Greater => Some(POLICIES[0]),
        std::cmp::Ordering::Less => Some(POLICIES[1]),
        std::cmp::Ordering::Equal => None,
    };
    found
}

fn winner(pair: &[Row]) -> Option<usize> {
    // A run without a touch has a mean of 0 that nobody measured.
    if pair.iter().any(|row| !row.trial.faults().is_empty()) {
        return None;
    }
    let mean = |k: usize| pair[k].trial.measured_error_m.mean;
    // What is no number wins nothing.
    (0..POLICIES.len()).find(|&k| {
        let other = mean(1 - k);
        mean(k) < CLEARLY * other && other > pair[k].trial.rounding_m
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::policies::trial::{Errors, Trial};

    fn row(policy: usize, mean: f64) -> Row {
        Row {
            scene: "a".to_owned(),
            slow: 1.0,
            policy: POLICIES[policy],
            trial: Trial {
                measured_error_m: Errors {
                    mean,
                    ..Errors::default()
                },
                rounding_m: 1e-8,
                contact_ticks: 1,
                measured_errors: 1,
                ..Trial::default()
            },
        }
    }

    fn judged(pairs: &[[f64; 2]]) -> Verdict {
        let pair = |of: &[f64; 2]| [row(0, of[0]), row(1, of[1])];
        verdict(&pairs.iter().flat_map(pair).collect::<Vec<_>>())
    }

    #[test]
    fn the_better_policy_has_more_pairs_that_are_clearly_smaller() {
        let found = judged(&[[1e-6, 2e-6], [3e-6, 1e-6], [0.0, 1e-4], [1e-6, 1.05e-6]]);
        assert_eq!((found.pairs, found.even), ([2, 1], 1));
        assert_eq!(found.better, Some(POLICIES[0]));
        let found = judged(&[[2e-6, 1e-6]]);
        assert_eq!(found.better, Some(POLICIES[1]));
    }

    #[test]
    fn rounding_and_what_is_no_number_win_nothing() {
        let found = judged(&[[1e-12, 9e-9], [f64::NAN, 1.0], [1.0, f64::NAN], [0.0, 0.0]]);
        assert_eq!((found.pairs, found.even), ([0, 0], 4));
        assert_eq!(found.better, None);
    }

    #[test]
    fn a_run_that_cannot_be_compared_wins_nothing_and_loses_nothing() {
        let faults: [fn(&mut Trial); 3] = [
            |trial| trial.contact_ticks = 0,
            |trial| trial.measured_errors = 0,
            |trial| trial.over_budget_ticks = 1,
        ];
        for (index, fault) in faults.into_iter().enumerate() {
            for k in 0..POLICIES.len() {
                let mut pair = [row(0, 0.0), row(1, 1e-4)];
                fault(&mut pair[k].trial);
                let found = verdict(&pair);
                assert_eq!((found.pairs, found.even), ([0, 0], 1), "fault {index}");
            }
        }
    }
}
