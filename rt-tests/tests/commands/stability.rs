//! The quick set of the hard cases passes for the seed of the command and another one, and for a
//! third with a small cache over a lossy link.

use crate::typed::{rt_tests, said};
use mutants::Mutant;
use rt_tests::cases::all;
use rt_tests::commands::simulate::mutants::checks_of;
use rt_tests::commands::stability::{Stability, StabilityArgs, run_cases};

/// Seeds, and whether they run with a small cache over a lossy link: the default of the command,
/// and others, since a case that one seed does not break another may.
const RUNS: [(u64, bool); 3] = [(1, false), (2, false), (3, true)];

fn args(seed: u64) -> StabilityArgs {
    StabilityArgs {
        cases: Vec::new(),
        full: false,
        rate: 1e3,
        small_lossy: false,
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

fn run(seed: u64, small_lossy: bool) -> Stability {
    let args = StabilityArgs {
        small_lossy,
        ..args(seed)
    };
    run_cases(&args).expect("the cases run")
}

#[test]
fn every_case_keeps_to_its_limit() {
    for (seed, small_lossy) in RUNS {
        println!("seed {seed}, small and lossy: {small_lossy}");
        let cases = run(seed, small_lossy).cases.into_iter();
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
fn a_case_that_a_lossy_link_leaves_nothing_to_touch_is_refused_with_it() {
    let args = StabilityArgs {
        cases: vec!["moving-object".to_string()],
        small_lossy: true,
        ..args(1)
    };
    let error = run_cases(&args).expect_err("it is not run so").to_string();
    assert!(error.contains("--small-lossy"), "{error}");
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
