//! Verdicts on cases, and what is refused.

use super::*;

/// What a case came to, by an error where there is one.
pub(super) fn verdict(name: &'static str, pass: bool, error: &str) -> Verdict {
    Verdict {
        name,
        number: "",
        measure: "",
        value: 0.0,
        limit: 0.0,
        pass,
        measure_keeps: pass,
        open: "",
        known: None,
        passes_run: 1,
        probe: ProbeOfCase::Ball,
        defaults: Vec::new(),
        facts: "",
        runs: "",
        logged: Vec::new(),
        error: error.to_string(),
        mutant: "Sign".to_string(),
        peers: Vec::new(),
        no_equal: "",
    }
}

fn found(case: Verdict) -> Stability {
    Stability {
        seed: 1,
        full: false,
        rate_hz: 1e3,
        small_lossy: false,
        cases: vec![case],
        step_times: Vec::new(),
        mutants: Vec::new(),
    }
}

/// A case that is known not to keep to its limit.
fn open(pass: bool, error: &str, passes_run: u64) -> Stability {
    found(Verdict {
        open: "so it is",
        known: Some(5.0),
        value: 4.0,
        passes_run,
        ..verdict("ridge", pass, error)
    })
}

#[test]
fn an_open_case_may_be_beyond_its_limit_but_is_to_be_run_to_its_end() {
    assert!(judge(&found(verdict("ridge", false, ""))).is_err());
    assert_eq!(judge(&open(false, "", 1)), Ok(()));
    for broken in [open(false, "it panicked", 1), open(false, "", 0)] {
        assert!(judge(&broken).is_err());
        assert!(table(&broken).contains("FAIL"), "{}", table(&broken));
    }
}

#[test]
fn an_open_case_fails_beyond_what_it_is_known_to_come_to() {
    // As they are shown: what is infinite, or no number, is the largest number.
    for (value, fails) in [(4.0, false), (5.0, false), (5.1, true), (f64::MAX, true)] {
        let mut of = open(false, "", 1);
        of.cases[0].value = value;
        assert_eq!(judge(&of).is_err(), fails, "{value}");
        assert_eq!(table(&of).contains("FAIL"), fails, "{value}");
    }
    for case in all() {
        let is_open = !case.open.is_empty();
        let is_beyond = case.known.is_finite() && case.known > case.limit;
        assert_eq!(case.known().is_some(), is_open, "{}", case.name);
        assert!(
            if is_open {
                is_beyond
            } else {
                case.known == 0.0
            },
            "{}",
            case.name
        );
    }
}

#[test]
fn an_open_case_that_keeps_to_its_limit_is_told() {
    let kept = open(true, "", 1);
    assert_eq!(judge(&kept), Ok(()));
    let said = "ridge keeps to its limit in this run";
    assert!(table(&kept).contains(said), "{}", table(&kept));
    assert!(page::page(&kept).contains(said));
    assert!(!table(&open(false, "", 1)).contains(said));
}

#[test]
fn a_long_run_tells_each_verdict() {
    let said = [verdict("rest", true, ""), verdict("creep", false, "")].map(|of| of.sentence());
    assert_eq!(said, ["rest: pass, 0 of 0", "creep: FAIL, 0 of 0"]);
}

#[test]
fn a_rate_at_which_no_case_is_tested_is_refused() {
    for typed in ["250", "1e3", "4000"] {
        assert!(rate(typed).is_ok(), "{typed}");
    }
    for typed in ["100", "249", "4001", "10000", "nan", "fast"] {
        let said = rate(typed).expect_err("no case is tested there");
        assert!(said.contains("250 to 4000"), "{typed}: {said}");
    }
}
