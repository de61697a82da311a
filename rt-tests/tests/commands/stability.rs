//! The quick set of the hard cases passes for the seed of the command.

use rt_tests::commands::stability::{Stability, StabilityArgs, run_cases};

/// The default of the command.
const SEED: u64 = 1;

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
    println!("seed {SEED}");
    let failed: Vec<_> = run(SEED)
        .cases
        .into_iter()
        .filter(|case| case.fails())
        .collect();
    assert!(failed.is_empty(), "seed {SEED}: {failed:?}");
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
