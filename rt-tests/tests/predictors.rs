//! `rt-tests predictors` as a user types it, on a small shape.

use serde_json::Value;
use std::process::{Command, Output, Stdio};

fn predictors(folder: &std::path::Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rt-tests"))
        .arg("predictors")
        .args(arguments)
        .env("HRTC_CACHE", folder)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn every_choice_of_sources_feels_the_same_motion_and_prediction_pays() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["relief:60000", "--seed", "3", "--speed", "0.4", "--json"];
    let output = predictors(folder.path(), &arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    println!("seed 3\n{said}");
    assert_eq!(output.status.code(), Some(0), "{said}");
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let runs = found["runs"].as_array().unwrap();
    let of = |sources: &str, field: &str| {
        let run = runs.iter().find(|run| run["sources"] == sources);
        run.unwrap_or_else(|| panic!("{sources} is missing"))[field]
            .as_f64()
            .unwrap()
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
    assert_eq!(output.stdout, predictors(folder.path(), &arguments).stdout);
}

#[test]
fn a_speed_that_is_none_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let output = predictors(folder.path(), &["--speed", "-1"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--speed"), "{said}");
}
