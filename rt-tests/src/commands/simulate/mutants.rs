//! Each mutant of the crate `mutants` in turn, until a seed finds it: shows that the checks can
//! fail.

use super::MutantFound;
use super::library::Library;
use crate::failure::Failure;

/// Seeds that a mutant is given.
pub const MOST_SEEDS: u64 = 200;

/// Runs every mutant; a seed that fails without it too says nothing of it.
///
/// # Errors
/// In a build without the feature `mutants`.
#[cfg(feature = "mutants")]
pub fn run(library: &Library, is_known: impl Fn(&str)) -> Result<Vec<MutantFound>, Failure> {
    use super::scenario::Reduction;
    use super::shrink::run_seed;
    use mutants::{Mutant, choose};
    use rayon::prelude::*;

    /// Seeds that run at once.
    const AT_ONCE: u64 = 8;
    let run = |seed| run_seed(seed, &Reduction::default(), library).err();
    let mut found = Vec::new();
    for mutant in Mutant::ALL {
        is_known(&format!("{mutant:?}"));
        let mut first = None;
        for from in (0..MOST_SEEDS).step_by(AT_ONCE as usize) {
            choose(Some(mutant));
            let seeds: Vec<u64> = (from..from + AT_ONCE).collect();
            let failed: Vec<_> = seeds.into_par_iter().filter_map(run).collect();
            choose(None);
            first = failed.into_iter().find(|failed| run(failed.seed).is_none());
            if first.is_some() {
                break;
            }
        }
        found.push(MutantFound {
            mutant: format!("{mutant:?}"),
            seeds: first.as_ref().map(|failed| failed.seed + 1),
            check: first.map_or_else(String::new, |failed| failed.violation.check),
        });
    }
    Ok(found)
}

/// Runs every mutant.
///
/// # Errors
/// Always: this build has none.
#[cfg(not(feature = "mutants"))]
pub fn run(_: &Library, _: impl Fn(&str)) -> Result<Vec<MutantFound>, Failure> {
    Err(Failure::Input(
        "this build has no mutants: build it with cargo run --release -p rt-tests --features mutants"
            .to_string(),
    ))
}
