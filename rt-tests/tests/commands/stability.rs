//! The quick set of the hard cases passes for two seeds, and no case passes with its fault.

use rt_tests::commands::stability::{Stability, StabilityArgs, run_cases};

/// The default of the command, and any other.
const SEEDS: [u64; 2] = [1, 20_261_122];

fn run(seed: u64, faults: bool) -> Stability {
    let args = StabilityArgs {
        cases: Vec::new(),
        full: false,
        seed,
        faults,
        json: false,
    };
    run_cases(&args).expect("the cases run")
}

#[test]
fn every_case_keeps_to_its_limit_for_two_seeds() {
    for seed in SEEDS {
        println!("seed {seed}");
        let failed: Vec<_> = run(seed, false)
            .cases
            .into_iter()
            .filter(|case| !case.pass)
            .collect();
        assert!(failed.is_empty(), "seed {seed}: {failed:?}");
    }
}

#[test]
fn every_case_fails_with_its_fault() {
    let passed: Vec<_> = run(1, true)
        .cases
        .into_iter()
        .filter(|case| case.pass)
        .collect();
    assert!(passed.is_empty(), "{passed:?}");
}

#[test]
fn a_name_that_is_no_case_is_refused_with_those_that_are() {
    let args = StabilityArgs {
        cases: vec!["wall".to_string()],
        full: false,
        seed: 1,
        faults: false,
        json: false,
    };
    let error = run_cases(&args).expect_err("it is no case").to_string();
    assert!(error.contains("head-on-wall"), "{error}");
}
