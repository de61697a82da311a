//! `rt-tests predictors` as a user types it, on a small shape.

use crate::typed::{json, number, refusal, rt_tests, said};
use std::process::Output;

fn predictors(arguments: &[&str]) -> Output {
    rt_tests("predictors").args(arguments).output().unwrap()
}

#[test]
fn every_choice_of_sources_feels_the_same_motion_and_prediction_pays() {
    let arguments = ["relief:60000", "--seed", "3", "--speed", "0.4", "--json"];
    let output = predictors(&arguments);
    let said = said(&output);
    println!("seed 3\n{said}");
    assert_eq!(output.status.code(), Some(0), "{said}");
    let found = json(&output);
    let runs = found["runs"].as_array().unwrap();
    let of = |sources: &str, field: &str| {
        let run = runs.iter().find(|run| run["sources"] == sources);
        number(run.unwrap_or_else(|| panic!("{sources} is missing")), field)
    };
    assert_eq!(runs.len(), 7);
    assert!(
        runs.iter()
            .all(|run| run["contact_ticks"].as_u64().unwrap() > 1000)
    );
    assert!(of("none", "coarser_share") > 0.0);
    assert!(of("all", "coarser_share") < of("none", "coarser_share"));
    assert!(of("all", "vsps_received") >= of("none", "vsps_received"));
    // The same command gives the same figures.
    assert_eq!(output.stdout, predictors(&arguments).stdout);
}

#[test]
fn a_speed_that_is_none_is_refused() {
    let output = predictors(&["--speed", "-1"]);
    let sentence = refusal(&output);
    assert!(sentence.contains("--speed"), "{sentence}");
}
