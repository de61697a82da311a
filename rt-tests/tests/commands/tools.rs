//! `rt-tests tools` as a user types it, on a small shape.

use crate::typed::{json, number, refusal, rt_tests, said};

#[test]
fn a_tool_is_measured_beside_unlimited_work() {
    let arguments = ["relief:10000", "--seeds", "1", "--seconds", "2", "--json"];
    let output = rt_tests("tools").args(arguments).output().unwrap();
    let said = said(&output);
    let found = json(&output);
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 1, "{said}");
    let row = &rows[0];
    assert_eq!(row["model"], "relief-10000");
    assert_eq!(row["tool"], "capsule-968");
    assert_eq!(number(row, "ticks"), 2000.0);
    assert!(number(row, "contact_ticks") > 500.0, "{said}");
    assert!(number(row, "force_n.p50") > 0.1, "{said}");
    assert!(number(row, "units.p50") > 0.0, "{said}");
    let off = |rank: &str| number(row, &format!("force_difference_n.{rank}"));
    assert!(off("p50") <= off("p99") && off("p99") <= off("max"));
    // A tool that hardly lags is mostly where unlimited work takes it.
    assert!(off("p50") < 0.01, "{said}");
    let is_told = said.contains("beyond a limit");
    assert_eq!(output.status.code(), Some(i32::from(is_told)), "{said}");
}

#[test]
fn a_shape_without_faces_is_refused() {
    let output = rt_tests("tools").arg("relief:many").output().unwrap();
    assert!(refusal(&output).contains("relief:many"));
}

#[test]
fn no_seeds_are_refused() {
    let output = rt_tests("tools").args(["--seeds", "0"]).output().unwrap();
    let said = said(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        output.stdout.is_empty() && said.contains("--seeds"),
        "{said}"
    );
}

#[test]
fn faces_that_no_scene_lets_a_tool_have_are_refused() {
    for faces in ["0", "11", "4097", "4294967295"] {
        let arguments = ["relief:1000", "--seconds", "1", "--faces", faces];
        let output = rt_tests("tools").args(arguments).output().unwrap();
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{faces}: {said}");
        assert!(
            output.stdout.is_empty() && said.contains("--faces"),
            "{said}"
        );
    }
}
