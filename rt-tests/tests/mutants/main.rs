//! Mutants are found by the checks that are there for them. Alone in its process: a mutant is in
//! all of it.
#![cfg(feature = "mutants")]

use mutants::{Mutant, choose};
use rt_tests::commands::simulate::library::Library;
use rt_tests::commands::simulate::mutants::checks_of;
use rt_tests::commands::simulate::scenario::Reduction;
use rt_tests::commands::simulate::shrink::run_seed;
use rt_tests::commands::stability::{StabilityArgs, run_cases};
use std::sync::Mutex;

/// Seeds that each of these mutants is given; `rt-tests simulate --mutants` gives more, to all.
const SEEDS: u64 = 20;

/// One test after the other: both put mutants into the whole process.
static ALONE: Mutex<()> = Mutex::new(());

#[test]
fn a_mutant_is_killed_by_its_case() {
    let _alone = ALONE.lock();
    let args = StabilityArgs {
        cases: Vec::new(),
        full: false,
        rate: 1e3,
        seed: 1,
        mutants: true,
        parameters: false,
        peers: None,
        models: Vec::new(),
        export: None,
        out: "unused".into(),
        json: false,
    };
    let found = run_cases(&args).expect("the cases run").mutants;
    let living: Vec<_> = found.iter().filter(|of| !of.killed).collect();
    assert!(living.is_empty(), "{living:?}");
    assert!(!found.is_empty());
}

#[test]
fn a_mutant_is_found_by_its_check() {
    let _alone = ALONE.lock();
    let library = Library::build().expect("the models are built");
    let check_of = |seed| {
        let failed = run_seed(seed, &Reduction::default(), &library).err()?;
        Some(failed.violation.check)
    };
    for mutant in [
        Mutant::Slew,
        Mutant::Certified,
        Mutant::Sign,
        Mutant::Fault,
        Mutant::NotFinite,
        Mutant::Budget,
        Mutant::NewStation,
        Mutant::Gap,
        Mutant::LostRequest,
    ] {
        choose(Some(mutant));
        let is_named = |check: &String| checks_of(mutant).contains(&check.as_str());
        let found = (0..SEEDS).filter_map(check_of).find(is_named);
        choose(None);
        println!("{mutant:?}: {found:?}");
        assert!(found.is_some(), "{mutant:?}: {:?}", checks_of(mutant));
    }
}
