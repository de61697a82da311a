//! What the runs reached: a fault that never happens in contact, or a kind of message that is never
//! lost, tests nothing.

use super::kind::Kind;
use simulator::{LinkCounts, MESSAGES};
use std::collections::BTreeMap;

/// Counts over runs.
#[derive(Debug, Clone, Default)]
pub struct Coverage {
    /// How often each kind happened to a controller in contact.
    pub in_contact: BTreeMap<Kind, u64>,
    /// What links did.
    pub link: LinkCounts,
    /// Probes whose last press was compared with a fresh controller's, and all.
    pub compared: [u64; 2],
    /// What controllers came to.
    pub states: BTreeMap<&'static str, u64>,
}

/// Share of the probes that are to be compared with a fresh controller at least: the others have
/// gone through a thin part, one of 1561 in seeds 0 to 1000.
const MIN_COMPARED: f64 = 0.95;

/// What controllers are to come to.
pub const STATES: [&str; 10] = [
    "contact at full resolution",
    "geomorphs in contact",
    "epochs ended",
    "records evicted",
    "samples rejected",
    "forces clamped",
    "models of another version found in contact",
    "models of another scene found",
    "steps left for later",
    "converged",
];

impl Coverage {
    /// A kind happened so often in contact.
    pub fn met(&mut self, kind: Kind, times: u64) {
        if times > 0 {
            *self.in_contact.entry(kind).or_default() += times;
        }
    }

    /// A state was reached so often.
    pub fn reached(&mut self, state: &'static str, times: u64) {
        if times > 0 {
            *self.states.entry(state).or_default() += times;
        }
    }

    /// So many probes were compared with a fresh controller, of so many.
    pub fn compared(&mut self, [compared, all]: [u64; 2]) {
        self.compared[0] += compared;
        self.compared[1] += all;
    }

    /// Adds those of another run.
    pub fn add(&mut self, other: &Self) {
        self.compared(other.compared);
        self.link.add(&other.link);
        for (&kind, &times) in &other.in_contact {
            self.met(kind, times);
        }
        for (&state, &times) in &other.states {
            self.reached(state, times);
        }
    }

    /// What was never reached, in words.
    #[must_use]
    pub fn missing(&self) -> Vec<String> {
        let kinds = Kind::all()
            .iter()
            .filter(|kind| !self.in_contact.contains_key(kind));
        let mut missing: Vec<String> = kinds
            .map(|kind| format!("{} in contact", kind.name()))
            .collect();
        let states = STATES
            .iter()
            .filter(|state| !self.states.contains_key(*state));
        missing.extend(states.map(|state| (*state).to_string()));
        let [compared, all] = self.compared;
        if (compared as f64) < MIN_COMPARED * all as f64 || all == 0 {
            missing.push(format!(
                "{compared} of {all} probes compared with a fresh controller"
            ));
        }
        let done = [
            ("lost", &self.link.lost),
            ("sent twice", &self.link.doubled),
            ("overtaking", &self.link.overtook),
        ];
        for (what, counts) in done {
            for (kind, _) in MESSAGES
                .iter()
                .zip(counts)
                .filter(|(_, count)| **count == 0)
            {
                missing.push(format!("{kind} {what}"));
            }
        }
        missing
    }
}
