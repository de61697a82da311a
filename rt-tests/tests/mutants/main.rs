//! Mutants are found by the checks that are there for them. Alone in its process: a mutant is in
//! all of it.
#![cfg(feature = "mutants")]

use mutants::{Mutant, choose};
use rt_tests::cases::all;
use rt_tests::commands::simulate::library::Library;
use rt_tests::commands::simulate::mutants::checks_of;
use rt_tests::commands::simulate::scenario::Reduction;
use rt_tests::commands::simulate::shrink::run_seed;
use rt_tests::commands::stability::{StabilityArgs, judge, run_cases};
use std::process::{Command, Stdio};
use std::sync::Mutex;

/// Seeds that each of these mutants is given; `rt-tests simulate --mutants` gives more, to all.
const SEEDS: u64 = 20;

/// One test after the other: they put mutants into the whole process.
static ALONE: Mutex<()> = Mutex::new(());

/// The quick form of cases; of all where none is named.
fn quick(cases: &[&str], mutants: bool) -> StabilityArgs {
    StabilityArgs {
        cases: cases.iter().map(ToString::to_string).collect(),
        full: false,
        rate: 1e3,
        small_lossy: false,
        seed: 1,
        mutants,
        parameters: false,
        peers: None,
        models: Vec::new(),
        export: None,
        out: "unused".into(),
        json: false,
    }
}

#[test]
fn a_mutant_is_killed_by_its_case() {
    let _alone = ALONE.lock();
    let found = run_cases(&quick(&[], true)).expect("the cases run");
    assert_eq!(judge(&found), Ok(()));
    let closed = all().filter(|case| case.open.is_empty()).count();
    let killed = found.mutants.iter().filter(|of| of.killed).count();
    assert_eq!(killed, closed);
    assert_eq!(found.mutants.len(), all().count());
}

#[test]
fn every_effect_by_itself_tells_that_it_comes_and_goes_at_once() {
    let _alone = ALONE.lock();
    choose(Some(Mutant::Switch));
    let found = run_cases(&quick(&["effects-toggled"], false));
    choose(None);
    let found = found.expect("the case runs");
    let logged = &found.cases[0].logged;
    assert_eq!(logged.len(), 10, "{logged:?}");
    for effect in logged {
        assert!(effect.value > 1.0, "{effect:?}");
    }
}

#[test]
fn open_cases_alone_judge_no_mutant() {
    let open = all().filter(|case| !case.open.is_empty());
    let open: Vec<&str> = open.map(|case| case.name).collect();
    assert!(!open.is_empty());
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_rt-tests"))
        .arg("stability")
        .args(&open)
        .arg("--mutants")
        .arg("--out")
        .arg(folder.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("nothing is judged"), "{said}");
    let table = String::from_utf8_lossy(&output.stdout);
    for case in open {
        assert!(table.contains(case) && said.contains(case), "{case}");
    }
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
