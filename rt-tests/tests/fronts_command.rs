//! `rt-tests fronts` as a user types it.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use ve_station::generate::{Shape, generate, write_mesh};

fn rt_tests(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rt-tests"))
        .args(arguments)
        .output()
        .unwrap()
}

fn number(value: &Value, path: &str) -> f64 {
    value
        .pointer(path)
        .and_then(Value::as_f64)
        .unwrap_or_else(|| panic!("{path} is no number in {value}"))
}

#[test]
fn both_print_one_object_with_the_fields_of_the_design() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("torus.obj");
    write_mesh(&generate(Shape::Torus, 4000, 1), &mesh).unwrap();
    let out = folder.path().join("out");
    let fronts = rt_tests(&[
        "fronts".as_ref(),
        "--json".as_ref(),
        "--out".as_ref(),
        &out,
        &mesh,
    ]);
    let said = String::from_utf8_lossy(&fronts.stderr);
    let found: Value = serde_json::from_slice(&fronts.stdout).unwrap_or_else(|_| panic!("{said}"));
    let broken = found["broken"].as_array().unwrap();
    // The cost is the machine's affair; everything else must hold.
    assert!(
        broken.iter().all(|b| b.as_str().unwrap().contains("_ns.")),
        "{broken:?}"
    );
    let status = i32::from(!broken.is_empty());
    assert_eq!(fronts.status.code(), Some(status), "{said}");
    let model = &found["models"][0];
    for field in [
        "faces",
        "splits",
        "collapses",
        "chain",
        "closure_mean",
        "closure_max",
        "certified_ratio/p50",
        "certified_ratio/p95",
        "dial/asked_over_true_p50",
        "split_ns/p50",
        "split_ns/p99",
        "collapse_ns/p50",
        "collapse_ns/p99",
    ] {
        assert!(number(model, &format!("/{field}")) > 0.0, "{field}");
    }
    for field in ["mismatches", "certified_violations"] {
        assert_eq!(number(model, &format!("/{field}")), 0.0, "{field}");
    }
    assert!(number(model, "/dial/exceeded_share") <= 1e-3);
    assert!(out.join("fronts.json").is_file() && out.join("fronts.txt").is_file());

    let nowhere = folder.path().join("nowhere.obj");
    let refused = rt_tests(&["fronts".as_ref(), &nowhere]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("nowhere.obj"));
}
