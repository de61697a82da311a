//! Real kills, one of each: what is asked of them but times, which a busy machine or a debug build
//! decides.

use super::typed::{json, number, refusal, rt_tests, said};

#[test]
fn a_kill_of_the_station_and_one_of_the_controller_leave_the_front_and_no_file() {
    let mut command = rt_tests("faults");
    command.args(["--kills=1", "--json", "station-killed", "controller-killed"]);
    let output = command.output().unwrap();
    let found = json(&output);
    let said = said(&output);
    assert_eq!(number(&found, "kills.station"), 1.0, "{said}");
    assert_eq!(number(&found, "kills.controller"), 1.0, "{said}");
    assert_eq!(found["fronts_equal"], true, "{said}");
    assert_eq!(number(&found, "leaked"), 0.0, "{said}");
    assert!(number(&found, "resync_ms.max") > 0.0, "{said}");
    assert!(number(&found, "force_step_n_max") > 0.0, "{said}");
    let cases = found["cases"].as_array().unwrap();
    let names: Vec<&str> = cases
        .iter()
        .filter_map(|case| case["name"].as_str())
        .collect();
    assert_eq!(names, ["station-killed", "controller-killed"]);
    let failed = cases.iter().any(|case| case["pass"] == false);
    assert_eq!(output.status.code(), Some(i32::from(failed)), "{said}");
}

#[test]
fn a_case_that_is_none_and_a_number_out_of_range_are_refused() {
    for (typed, expected) in [
        ("station-kiled", "station-killed"),
        ("--kills=0", "--kills"),
    ] {
        let output = rt_tests("faults").arg(typed).output().unwrap();
        let sentence = refusal(&output);
        assert!(sentence.contains(expected), "{sentence}");
    }
}
