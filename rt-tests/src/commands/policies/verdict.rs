//! Which policy is the better one.

use super::{POLICIES, Row};
use scene::PolicyPlan;
use serde::Serialize;

/// By how much a mean error must be smaller to be so beyond what another tour would give: the
/// smaller is at most this share of the larger.
const CLEARLY: f64 = 0.9;

/// The rule, for whoever reads the table.
pub const RULE: &str = "a pair of rows goes to the policy whose mean measured error at the contact is \
smaller by a tenth or more, or to none; the better policy has more pairs";

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
    let mean = |k: usize| pair[k].trial.measured_error_m.mean;
    // What is no number wins nothing.
    (0..POLICIES.len()).find(|&k| mean(k) < CLEARLY * mean(1 - k))
}
