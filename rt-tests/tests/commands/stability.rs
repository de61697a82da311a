//! The quick set of the hard cases passes for the seed of the command, and for two others.

use crate::typed::{rt_tests, said};
use mutants::Mutant;
use rt_tests::cases::all;
use rt_tests::commands::simulate::mutants::checks_of;
use rt_tests::commands::stability::{Stability, StabilityArgs, run_cases};

/// The default of the command, and two others: a case that one seed does not break another may.
const SEEDS: [u64; 3] = [1, 2, 3];

fn args(seed: u64) -> StabilityArgs {
    StabilityArgs {
        cases: Vec::new(),
        full: false,
        rate: 1e3,
        seed,
        mutants: false,
        parameters: false,
        peers: None,
        models: Vec::new(),
        export: None,
        out: "unused".into(),
        json: false,
    }
}

fn run(seed: u64) -> Stability {
    run_cases(&args(seed)).expect("the cases run")
}

#[test]
fn every_case_keeps_to_its_limit() {
    for seed in SEEDS {
        println!("seed {seed}");
        let cases = run(seed).cases.into_iter();
        let failed: Vec<_> = cases.filter(|case| case.fails()).collect();
        assert!(failed.is_empty(), "seed {seed}: {failed:?}");
    }
}

#[test]
fn a_name_that_is_no_case_is_refused_with_those_that_are() {
    let args = StabilityArgs {
        cases: vec!["wall".to_string()],
        ..args(1)
    };
    let error = run_cases(&args).expect_err("it is no case").to_string();
    assert!(error.contains("head-on-wall"), "{error}");
}

#[test]
fn every_mutant_is_asked_of_a_case_or_a_check() {
    for mutant in Mutant::ALL {
        let mut closed = all().filter(|case| case.open.is_empty());
        let is_asked = closed.any(|case| case.mutant == mutant) || !checks_of(mutant).is_empty();
        assert!(is_asked, "no case and no check is there for {mutant:?}");
    }
}

#[test]
fn a_rate_at_which_nothing_is_tested_is_refused() {
    let output = rt_tests("stability")
        .args(["rest", "--rate", "100"])
        .output()
        .unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        output.stdout.is_empty() && said.contains("250 to 4000"),
        "{said}"
    );
}
