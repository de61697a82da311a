//! A run of a seed, and the smallest run that still fails.

use super::kind::Kind;
use super::library::Library;
use super::run::{Outcome, Run};
use super::scenario::{Reduction, Scenario};
use super::trace::{Trace, Violation};
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

/// Halvings of the weight that are tried.
const HALVINGS: u32 = 4;

/// A run that failed.
#[derive(Debug, Clone)]
pub struct Failed {
    /// Its seed.
    pub seed: u64,
    /// What was left of it.
    pub reduction: Reduction,
    /// The kinds that were on.
    pub kinds: BTreeSet<Kind>,
    /// What did not hold.
    pub violation: Violation,
    /// What happened around it.
    pub trace: String,
}

thread_local! {
    static IS_GUARDED: Cell<bool> = const { Cell::new(false) };
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// A panic in a guarded run is a finding: its message is kept instead of printed.
fn guard_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if IS_GUARDED.get() {
                PANIC.with_borrow_mut(|text| *text = info.to_string().replace('\n', " "));
            } else {
                before(info);
            }
        }));
    });
}

/// Runs a seed.
///
/// # Errors
/// When a check does not hold or something panics.
pub fn run_seed(
    seed: u64,
    reduction: &Reduction,
    library: &Library,
) -> Result<Outcome, Box<Failed>> {
    guard_panics();
    let mut trace = Trace::default();
    let mut kinds = BTreeSet::new();
    IS_GUARDED.set(true);
    let result = catch_unwind(AssertUnwindSafe(|| {
        let failed = |failure: crate::failure::Failure| ("set-up", failure.to_string());
        let scenario = Scenario::draw(seed, reduction, library).map_err(failed)?;
        kinds.clone_from(&scenario.kinds);
        Run::new(&scenario, library)
            .map_err(failed)?
            .all(&mut trace)
    }));
    IS_GUARDED.set(false);
    let (check, found) = match result {
        Ok(Ok(outcome)) => return Ok(outcome),
        Ok(Err((check, found))) => (check.to_string(), found),
        Err(_) => ("no panic".to_string(), PANIC.with_borrow(String::clone)),
    };
    Err(Box::new(Failed {
        seed,
        reduction: reduction.clone(),
        kinds,
        trace: trace.text(trace.client),
        violation: Violation {
            check,
            tick: trace.tick,
            client: trace.client,
            found,
        },
    }))
}

/// The smallest run found that fails the same check.
#[must_use]
pub fn shrink(failed: Box<Failed>, library: &Library) -> Box<Failed> {
    let mut least = failed;
    let again = |least: &Failed, reduction: Reduction| {
        let other = run_seed(least.seed, &reduction, library).err()?;
        (other.violation.check == least.violation.check).then_some(other)
    };
    // Nothing after the tick is needed.
    let ticks = least.violation.tick + 1;
    let cut = Reduction {
        ticks: Some(ticks),
        ..least.reduction.clone()
    };
    if let Some(other) = again(&least, cut) {
        least = other;
    }
    // One kind after another, until none can go.
    loop {
        let smaller = least.kinds.iter().find_map(|dropped| {
            let mut only = least.kinds.clone();
            only.remove(dropped);
            let reduction = Reduction {
                only: Some(only),
                ..least.reduction.clone()
            };
            again(&least, reduction)
        });
        let Some(other) = smaller else { break };
        least = other;
    }
    for _ in 0..HALVINGS {
        let lighter = Reduction {
            weight: 0.5 * least.reduction.weight,
            ..least.reduction.clone()
        };
        let Some(other) = again(&least, lighter) else {
            break;
        };
        least = other;
    }
    least
}

impl Failed {
    /// The command that runs it again.
    #[must_use]
    pub fn command(&self) -> String {
        let Reduction { weight, ticks, .. } = &self.reduction;
        let mut command = format!(
            "cargo run --release -p rt-tests -- simulate --seeds {}..{}",
            self.seed,
            self.seed + 1
        );
        if self.reduction.only.is_some() {
            let names: Vec<String> = self.kinds.iter().map(|kind| kind.name()).collect();
            command += &format!(" --only {}", names.join(","));
        }
        if *weight != 1.0 {
            command += &format!(" --weight {weight}");
        }
        if let Some(ticks) = ticks {
            command += &format!(" --ticks {ticks}");
        }
        command
    }

    /// All of it, to read.
    #[must_use]
    pub fn text(&self) -> String {
        let names: Vec<String> = self.kinds.iter().map(|kind| kind.name()).collect();
        let Violation {
            check,
            tick,
            client,
            found,
        } = &self.violation;
        format!(
            "seed {}: \"{check}\" does not hold after tick {tick} of controller {client}: {found}\non: {}\n{}again: {}\n",
            self.seed,
            names.join(", "),
            self.trace,
            self.command()
        )
    }
}
