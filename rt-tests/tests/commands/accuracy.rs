//! `rt-tests accuracy` as a user types it, on a small shape.

use crate::typed::{json, number, rt_tests, said};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

/// Fields that are times, which no two runs share.
const TIMES: [&str; 4] = ["tick_us", "all_tick_us", "stage_us", "tool_us"];

fn accuracy(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = rt_tests("accuracy");
    command.args(arguments).arg("--out").arg(folder.join("out"));
    command.output().unwrap()
}

fn run(folder: &Path) -> Value {
    let arguments = ["sphere:4096", "--seconds", "2", "--seed", "3", "--json"];
    let output = accuracy(folder, &arguments);
    let said = said(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("checks"), "the table goes to standard error");
    json(&output)
}

#[test]
fn a_short_run_holds_its_checks_and_gives_every_field_and_file_and_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let found = run(folder.path());

    assert_eq!(found["pass"], Value::Bool(true));
    assert!(found["checks"].as_array().unwrap().len() > 10);
    let points = found["points"].as_array().unwrap();
    for point in points {
        let lengths = "value certified_m true_m true_p50_m".split(' ');
        let others = "normal_deg force_n bytes rss_bytes contact_ticks".split(' ');
        for field in lengths.chain(others) {
            assert!(number(point, field) >= 0.0, "{field}");
        }
        for field in ["p50", "p99", "p999"] {
            assert!(number(&point["tick_us"], field) > 0.0);
            assert!(number(&point["stage_us"]["query"], field) > 0.0);
        }
        // A query alone certifies nothing.
        let is_certified = number(point, "true_m") <= number(point, "certified_m") + 1e-12;
        assert!(is_certified || point["knob"] == "precision");
        assert!(number(point, "rss_bytes") > number(point, "cache_bytes"));
    }
    let of = |knob: &'static str| points.iter().filter(move |p| p["knob"] == knob);
    let values: Vec<f64> = of("local").map(|p| number(p, "value")).collect();
    let finest = values.iter().rev().find(|&&value| value > 0.0).unwrap();
    assert!(values[0] / finest >= 1e3, "three decades: {values:?}");
    assert_eq!(values.last(), Some(&0.0), "and the full mesh");
    assert!(of("global").count() > 3 && of("prefix").count() > 3);
    let others = "grid base_mesh cache predictor operations rate geomorph effect tool_faces \
        iterations contact_offset precision";
    for knob in others.split(' ') {
        let points: Vec<&Value> = points.iter().filter(|p| p["knob"] == knob).collect();
        assert!(points.len() > 1, "{knob}");
        let says = |p: &&&Value| !p["setting"].as_str().unwrap().is_empty();
        assert_eq!(points.iter().filter(says).count(), points.len(), "{knob}");
    }

    // Among queries 32 bits alone are off; of a tool's settings the product's own are its own.
    let errors: Vec<f64> = of("precision").map(|p| number(p, "true_m")).collect();
    assert!(errors[0] > 1e-9 && errors[1..].iter().all(|&error| error < 1e-12));
    let forces: Vec<f64> = of("iterations").map(|p| number(p, "force_n")).collect();
    assert!(forces[0] > 1e-3 && forces.last().is_some_and(|&force| force < 1e-6));

    // The base mesh is felt as another shape, the full mesh as itself, and it costs bytes to get
    // there.
    let (first, last) = (
        of("local").next().unwrap(),
        of("local").next_back().unwrap(),
    );
    assert!(number(first, "true_m") > 1e-5 && number(first, "force_n") > 1e-3);
    assert!(number(last, "true_m") < 1e-12 && number(last, "force_n") < 1e-8);
    assert!(number(last, "contact_ticks") > 200.0, "the tour touches");
    assert!(number(first, "bytes") < number(last, "bytes"));
    assert!(number(first, "cache_bytes") < number(last, "cache_bytes"));

    let bytes = &found["bytes"].as_array().unwrap()[0];
    assert_eq!(number(bytes, "faces"), 4096.0);
    assert!(number(bytes, "first_touch_bytes") < number(bytes, "local_full_bytes"));
    assert!(number(bytes, "plain_bytes") > 0.0 && number(bytes, "records_bytes") > 0.0);

    let out = folder.path().join("out");
    let page = std::fs::read_to_string(out.join("accuracy.html")).unwrap();
    assert!(page.contains("sphere-4096") && page.contains("does not"));
    let csv = std::fs::read_to_string(out.join("accuracy.csv")).unwrap();
    assert_eq!(csv.lines().count(), points.len() + 1);
    let json: Value =
        serde_json::from_slice(&std::fs::read(out.join("accuracy.json")).unwrap()).unwrap();
    assert_eq!(json, found, "the file is what was printed");

    let untimed = |mut found: Value| {
        for point in found["points"].as_array_mut().unwrap() {
            for field in TIMES {
                assert!(point.as_object_mut().unwrap().remove(field).is_some());
            }
        }
        found
    };
    let again = run(folder.path());
    assert_eq!(untimed(found), untimed(again), "all but times repeats");
}

#[test]
fn a_bad_model_is_one_sentence_with_status_2_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (typed, expected) in [
        ("nowhere.ply", "nowhere.ply"),
        ("sphere:many", "sphere:20000"),
    ] {
        let output = accuracy(folder.path(), &[typed]);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.lines().last().unwrap().contains(expected), "{said}");
        assert!(!folder.path().join("out").exists());
    }
    let output = accuracy(folder.path(), &["sphere:4096", "--seconds", "0"]);
    assert_eq!(output.status.code(), Some(2));
}
