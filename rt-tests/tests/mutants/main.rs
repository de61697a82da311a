//! Mutants are found by the checks that are there for them. Alone in its process: a mutant is in
//! all of it.
#![cfg(feature = "mutants")]

use mutants::{Mutant, choose};
use rt_tests::commands::simulate::library::Library;
use rt_tests::commands::simulate::scenario::Reduction;
use rt_tests::commands::simulate::shrink::run_seed;

/// Seeds that each of these mutants is given.
const SEEDS: u64 = 20;

#[test]
fn a_mutant_is_found_by_its_check() {
    let library = Library::build().expect("the models are built");
    let check_of = |seed| {
        let failed = run_seed(seed, &Reduction::default(), &library).err()?;
        Some(failed.violation.check)
    };
    for (mutant, check) in [
        (Mutant::Slew, "slew limit"),
        (Mutant::Certified, "certified error"),
        (Mutant::Sign, "force of the spring"),
    ] {
        choose(Some(mutant));
        let found: Vec<String> = (0..SEEDS).filter_map(check_of).collect();
        choose(None);
        let is_found = found.iter().any(|of| of == check);
        assert!(is_found, "{mutant:?} is to break \"{check}\": {found:?}");
    }
}
