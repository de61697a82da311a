//! Each mutant of the crate `mutants` in turn, until a seed finds it by a check that is there for
//! it: shows that the checks can fail, and that each says what is wrong.

use super::MutantsFound;
use super::library::Library;
use crate::failure::Failure;
use mutants::Mutant;

/// Seeds that a mutant is given.
pub const MOST_SEEDS: u64 = 200;

/// The checks of which one is to find a mutant. Invariants of the caches are asserted: a panic.
#[must_use]
pub fn checks_of(mutant: Mutant) -> &'static [&'static str] {
    match mutant {
        Mutant::Clamp => &["force limit"],
        Mutant::Slew => &["slew limit"],
        Mutant::Fault => &["no force after a fault"],
        Mutant::Sign => &["force of the spring", "energy of a contact"],
        Mutant::Passivity => &["energy of a contact"],
        Mutant::NotFinite => &["numbers of the record"],
        Mutant::Budget => &["operations of a tick"],
        Mutant::Reference
        | Mutant::Dependency
        | Mutant::StaleId
        | Mutant::Box
        | Mutant::TreeFace => &["no panic"],
        Mutant::Certified => &["certified error"],
        Mutant::Timeout => &["resynchronised", "full resolution at the contact"],
        Mutant::NewStation => &["an epoch for each station"],
        Mutant::Gap => &["chunks in their order"],
        Mutant::Constraint => &["proxy out of the front", "proxy on its side"],
        Mutant::LostRequest => &["silence after a lost request"],
        // Of the hard cases: `crate::cases`.
        _ => &[],
    }
}

/// Runs every mutant; a seed that fails without it too says nothing of it, and is told.
///
/// # Errors
/// In a build without the feature `mutants`.
#[cfg(feature = "mutants")]
pub fn run(library: &Library, is_known: impl Fn(&str)) -> Result<MutantsFound, Failure> {
    use super::scenario::Reduction;
    use super::shrink::run_seed;
    use super::{MutantFound, shown};
    use mutants::choose;
    use rayon::prelude::*;
    use std::collections::BTreeMap;

    /// Seeds that run at once.
    const AT_ONCE: u64 = 8;
    let run = |seed| run_seed(seed, &Reduction::default(), library).err();
    let mut found = MutantsFound::default();
    let mut violations = BTreeMap::new();
    let found_here = |mutant: &Mutant| !checks_of(*mutant).is_empty();
    for mutant in Mutant::ALL.into_iter().filter(found_here) {
        is_known(&format!("{mutant:?}"));
        let mut first = None;
        for from in (0..MOST_SEEDS).step_by(AT_ONCE as usize) {
            choose(Some(mutant));
            let seeds: Vec<u64> = (from..from + AT_ONCE).collect();
            let failed: Vec<_> = seeds.into_par_iter().filter_map(run).collect();
            choose(None);
            found.seeds += AT_ONCE;
            let is_named = |check: &String| checks_of(mutant).contains(&check.as_str());
            let mut named = failed
                .into_iter()
                .filter(|of| is_named(&of.violation.check));
            first = named.find(|of| {
                let without = run(of.seed);
                if let Some(own) = &without {
                    violations.entry(own.seed).or_insert_with(|| shown(own));
                }
                without.is_none()
            });
            if first.is_some() {
                break;
            }
        }
        found.mutants.push(MutantFound {
            name: format!("{mutant:?}"),
            killed: first.is_some(),
            seeds_needed: first.as_ref().map_or(-1, |failed| failed.seed as i64 + 1),
            check: first.map_or_else(String::new, |failed| failed.violation.check),
        });
    }
    found.violations = violations.into_values().collect();
    Ok(found)
}

/// Runs every mutant.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "mutants"))]
pub fn run(_: &Library, _: impl Fn(&str)) -> Result<MutantsFound, Failure> {
    Err(Failure::Input(
        "this build has no mutants: build it with cargo run --release -p rt-tests --features mutants"
            .to_string(),
    ))
}
